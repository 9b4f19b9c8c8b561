//! Structures that cross from the host to shaders, and the check that both sides agree on them.
//!
//! Declare them with [`gpu_structs!`](crate::gpu_structs). A WGSL structure of the same name must then have the same
//! members at the same offsets; Rust fields whose names start with `padding` fill the gaps of the WGSL layout.

use std::fmt::Write as _;

use crate::{Access, Reflection};

/// A structure as Rust lays it out.
#[derive(Clone, Debug)]
pub struct HostStruct {
    /// Name on both sides.
    pub name: &'static str,
    /// Bytes.
    pub size: usize,
    /// In order.
    pub fields: Vec<HostField>,
}

/// One field of a [`HostStruct`].
#[derive(Clone, Debug)]
pub struct HostField {
    /// Name on both sides.
    pub name: &'static str,
    /// Bytes from the start.
    pub offset: usize,
    /// WGSL types with the same bytes.
    pub wgsl_types: Vec<String>,
}

/// A type that means the same bytes in WGSL.
pub trait WgslType {
    /// The matching type names, as [`Reflection`] writes them.
    fn wgsl_types() -> Vec<String>;
}

macro_rules! wgsl_types {
    ($($rust:ty => [$($wgsl:literal),+],)+) => {
        $(impl WgslType for $rust {
            fn wgsl_types() -> Vec<String> {
                vec![$($wgsl.to_owned()),+]
            }
        })+
    };
}

wgsl_types! {
    f32 => ["f32"],
    u32 => ["u32", "atomic<u32>"],
    i32 => ["i32", "atomic<i32>"],
    glam::Vec2 => ["vec2<f32>"],
    glam::Vec3 => ["vec3<f32>"],
    glam::Vec4 => ["vec4<f32>"],
    glam::UVec2 => ["vec2<u32>"],
    glam::UVec3 => ["vec3<u32>"],
    glam::UVec4 => ["vec4<u32>"],
    glam::IVec2 => ["vec2<i32>"],
    glam::IVec3 => ["vec3<i32>"],
    glam::IVec4 => ["vec4<i32>"],
    glam::Mat4 => ["mat4x4<f32>"],
}

impl<T: WgslType, const N: usize> WgslType for [T; N] {
    fn wgsl_types() -> Vec<String> {
        let mut names = Vec::new();
        for element in T::wgsl_types() {
            names.push(format!("array<{element}, {N}>"));
            if !(2..=4).contains(&N) {
                continue;
            }
            if matches!(element.as_str(), "f32" | "u32" | "i32") {
                names.push(format!("vec{N}<{element}>"));
            }
            // Columns of two or four: three would be padded to sixteen bytes.
            if matches!(element.as_str(), "vec2<f32>" | "vec4<f32>") {
                names.push(format!("mat{N}x{}", &element[3..]));
            }
        }
        names
    }
}

/// Declares plain-old-data structures shared with shaders and lists them in `STRUCTS`.
///
/// ```
/// surfelcast_shaders::gpu_structs! {
///     /// A sphere.
///     pub struct Sphere {
///         /// Centre, metres.
///         pub center: [f32; 3],
///         /// Radius, metres.
///         pub radius: f32,
///     }
/// }
/// assert_eq!(structs()[0].fields[1].offset, 12);
/// ```
#[macro_export]
macro_rules! gpu_structs {
    ($($(#[$doc:meta])* pub struct $name:ident { $($(#[$field_doc:meta])* pub $field:ident: $type:ty,)+ })+) => {
        $(
            $(#[$doc])*
            #[repr(C)]
            #[derive(Clone, Copy, Debug, Default, PartialEq, $crate::layout::bytemuck::Pod, $crate::layout::bytemuck::Zeroable)]
            #[bytemuck(crate = "::surfelcast_shaders::layout::bytemuck")]
            pub struct $name {
                $($(#[$field_doc])* pub $field: $type,)+
            }
        )+

        /// The structures declared here, for the comparison with WGSL.
        pub fn structs() -> Vec<$crate::layout::HostStruct> {
            vec![$($crate::layout::HostStruct {
                name: stringify!($name),
                size: size_of::<$name>(),
                fields: vec![$($crate::layout::HostField {
                    name: stringify!($field),
                    offset: std::mem::offset_of!($name, $field),
                    wgsl_types: <$type as $crate::layout::WgslType>::wgsl_types(),
                },)+],
            },)+]
        }
    };
}

pub use bytemuck;

gpu_structs! {
    /// Workgroup counts of an indirect dispatch, as the GPU reads them.
    pub struct DispatchArguments {
        /// Workgroups in x.
        pub x: u32,
        /// Workgroups in y.
        pub y: u32,
        /// Workgroups in z.
        pub z: u32,
    }
}

/// Compares `structs` with the structures of a linked kernel; every difference is one sentence.
pub fn differences(structs: &[HostStruct], reflection: &Reflection) -> Vec<String> {
    let mut found = Vec::new();
    for host in structs {
        if let Some(shader) = reflection.structs.get(host.name) {
            compare(host, shader, &mut found);
        }
        for binding in &reflection.bindings {
            let (element, expected) = match binding.array_stride {
                Some(stride) => (format!("array<{}", host.name), stride),
                None if binding.access == Access::Uniform => (host.name.to_owned(), binding.min_size),
                None => continue,
            };
            let is_of_struct = binding.type_name == element
                || binding.type_name.strip_prefix(&element).is_some_and(|rest| rest.starts_with(['>', ',']));
            if is_of_struct && expected as usize != host.size {
                found.push(format!(
                    "binding `{}`: an element of {} takes {expected} bytes in WGSL and {} in Rust",
                    binding.name, host.name, host.size
                ));
            }
        }
    }
    found
}

fn compare(host: &HostStruct, shader: &crate::StructLayout, found: &mut Vec<String>) {
    if shader.size as usize != host.size {
        found.push(format!("{}: {} bytes in WGSL, {} in Rust", host.name, shader.size, host.size));
    }
    for member in &shader.members {
        let Some(field) = host.fields.iter().find(|field| field.name == member.name) else {
            found.push(format!("{}.{}: missing in Rust", host.name, member.name));
            continue;
        };
        let mut difference = String::new();
        if field.offset != member.offset as usize {
            let _ = write!(difference, " at byte {} in WGSL and {} in Rust;", member.offset, field.offset);
        }
        if !field.wgsl_types.contains(&member.type_name) {
            let _ =
                write!(difference, " {} in WGSL, where Rust fits {};", member.type_name, field.wgsl_types.join(" or "));
        }
        if !difference.is_empty() {
            found.push(format!("{}.{}:{}", host.name, member.name, difference.trim_end_matches(';')));
        }
    }
    for field in host.fields.iter().filter(|field| !field.name.starts_with("padding")) {
        if !shader.members.iter().any(|member| member.name == field.name) {
            found.push(format!("{}.{}: missing in WGSL", host.name, field.name));
        }
    }
}
