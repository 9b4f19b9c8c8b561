//! Bindings and memory layouts of a linked kernel, read from naga's module.

use std::collections::BTreeMap;

use naga::{AddressSpace, ArraySize, EntryPoint, Module, ShaderStage, StorageAccess, TypeInner};

use crate::mangle::unmangle;

/// Access of a kernel to a binding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Access {
    /// `var<uniform>`.
    Uniform,
    /// `var<storage, read>`.
    StorageRead,
    /// `var<storage, read_write>`.
    StorageReadWrite,
    /// `texture_2d<f32>`, read texel by texel: a target of a raster kernel.
    Texture,
}

impl Access {
    /// Whether it counts against the limit on storage buffers.
    pub const fn is_storage(self) -> bool {
        matches!(self, Access::StorageRead | Access::StorageReadWrite)
    }
}

/// One bound buffer or texture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Binding {
    /// Bind group.
    pub group: u32,
    /// Slot in the group.
    pub binding: u32,
    /// Name in the module that declares it.
    pub name: String,
    /// Access.
    pub access: Access,
    /// Least size in bytes; an array without a length counts as one element.
    pub min_size: u32,
    /// Bytes from element to element, if the binding is or ends in an array.
    pub array_stride: Option<u32>,
    /// Type, such as `array<Node>`.
    pub type_name: String,
}

/// Memory layout of a structure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StructLayout {
    /// Bytes, rounded up to the alignment.
    pub size: u32,
    /// Bytes.
    pub align: u32,
    /// In order of declaration.
    pub members: Vec<MemberLayout>,
}

/// One member of a structure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MemberLayout {
    /// Name.
    pub name: String,
    /// Bytes from the start of the structure.
    pub offset: u32,
    /// Type, such as `vec3<f32>`.
    pub type_name: String,
}

/// Entry point, bindings and structures of a linked kernel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reflection {
    /// Name of the kernel: of the entry point of a compute kernel; a raster kernel has two, see [`VERTEX_SUFFIX`].
    pub entry_point: String,
    /// Invocations of a workgroup in x, y, z; ones for a raster kernel.
    pub workgroup_size: [u32; 3],
    /// Targets that a raster kernel draws into; 0 for a compute kernel.
    pub target_count: u32,
    /// Sorted by group and slot.
    pub bindings: Vec<Binding>,
    /// By name, without the module.
    pub structs: BTreeMap<String, StructLayout>,
}

/// Reads `module`; the error is a sentence about a broken rule of this project.
pub(crate) fn reflect(module: &Module, kernel: &str) -> Result<Reflection, String> {
    let target_count = stages(module, kernel)?;
    let mut layouter = naga::proc::Layouter::default();
    layouter.update(module.to_ctx()).map_err(|error| format!("a type has no layout: {error}"))?;

    let mut bindings = Vec::new();
    for (_, variable) in module.global_variables.iter() {
        let Some(slot) = variable.binding else { continue };
        let name = unmangle(variable.name.as_deref().unwrap_or("")).to_owned();
        let access = match variable.space {
            AddressSpace::Uniform => Access::Uniform,
            AddressSpace::Storage { access } if access.contains(StorageAccess::STORE) => Access::StorageReadWrite,
            AddressSpace::Storage { .. } => Access::StorageRead,
            AddressSpace::Handle if is_plain_texture(module, variable.ty) => Access::Texture,
            _ => {
                return Err(format!(
                    "binding `{name}` is no buffer; kernels bind uniform and storage buffers and texture_2d<f32> only"
                ));
            }
        };
        if target_count > 0 && access == Access::StorageReadWrite {
            return Err(format!("a raster kernel writes its targets only, it may not write `{name}`"));
        }
        bindings.push(Binding {
            group: slot.group,
            binding: slot.binding,
            name,
            access,
            min_size: if access == Access::Texture { 0 } else { layouter[variable.ty].size },
            array_stride: array_stride(module, variable.ty),
            type_name: type_name(module, variable.ty),
        });
    }
    bindings.sort_by_key(|binding| (binding.group, binding.binding));
    for pair in bindings.windows(2) {
        if (pair[0].group, pair[0].binding) == (pair[1].group, pair[1].binding) {
            return Err(format!(
                "`{}` and `{}` share @group({}) @binding({})",
                pair[0].name, pair[1].name, pair[0].group, pair[0].binding
            ));
        }
    }
    for (index, binding) in bindings.iter().enumerate() {
        if let Some(other) = bindings[..index].iter().find(|other| other.name == binding.name) {
            return Err(format!("two bindings are called `{}`: passes bind by name", other.name));
        }
    }

    let mut structs = BTreeMap::new();
    for (handle, ty) in module.types.iter() {
        let (Some(name), TypeInner::Struct { members, .. }) = (&ty.name, &ty.inner) else { continue };
        let members = members.iter().map(|member| MemberLayout {
            name: member.name.clone().unwrap_or_default(),
            offset: member.offset,
            type_name: type_name(module, member.ty),
        });
        let layout = StructLayout {
            size: layouter[handle].size,
            align: layouter[handle].alignment.round_up(1),
            members: members.collect(),
        };
        if structs.insert(unmangle(name).to_owned(), layout).is_some() {
            return Err(format!("two structures are called `{}`: layouts are compared by name", unmangle(name)));
        }
    }
    let workgroup_size = match module.entry_points.as_slice() {
        [entry] => entry.workgroup_size,
        _ => [1; 3],
    };
    Ok(Reflection { entry_point: kernel.to_owned(), workgroup_size, target_count, bindings, structs })
}

/// Suffixes of the names of the entry points of a raster kernel.
pub const VERTEX_SUFFIX: &str = "_vertex";
/// See [`VERTEX_SUFFIX`].
pub const FRAGMENT_SUFFIX: &str = "_fragment";

/// Checks the entry points. Returns the targets of a raster kernel, 0 for a compute kernel.
fn stages(module: &Module, kernel: &str) -> Result<u32, String> {
    let named = |entry: &EntryPoint, expected: &str| {
        if entry.name == expected {
            return Ok(());
        }
        Err(format!("the entry point is called `{}`, where the file `{kernel}` wants `{expected}`", entry.name))
    };
    match module.entry_points.as_slice() {
        [entry] if entry.stage == ShaderStage::Compute => named(entry, kernel).map(|()| 0),
        [a, b] => {
            let (vertex, fragment) = if a.stage == ShaderStage::Vertex { (a, b) } else { (b, a) };
            if vertex.stage != ShaderStage::Vertex || fragment.stage != ShaderStage::Fragment {
                return Err("two entry points are a vertex and a fragment shader".to_owned());
            }
            named(vertex, &format!("{kernel}{VERTEX_SUFFIX}"))?;
            named(fragment, &format!("{kernel}{FRAGMENT_SUFFIX}"))?;
            match fragment.function.result.as_ref().map(|result| (&module.types[result.ty].inner, &result.binding)) {
                Some((TypeInner::Struct { members, .. }, _)) if !members.is_empty() => Ok(members.len() as u32),
                Some((_, Some(naga::Binding::Location { .. }))) => Ok(1),
                _ => Err("the fragment shader returns nothing to draw".to_owned()),
            }
        }
        entries => Err(format!(
            "a kernel has one entry point for compute, or one for vertices and one for fragments; this one has {}",
            entries.len()
        )),
    }
}

fn is_plain_texture(module: &Module, ty: naga::Handle<naga::Type>) -> bool {
    matches!(
        module.types[ty].inner,
        TypeInner::Image {
            dim: naga::ImageDimension::D2,
            arrayed: false,
            class: naga::ImageClass::Sampled { kind: naga::ScalarKind::Float, multi: false },
        }
    )
}

fn array_stride(module: &Module, ty: naga::Handle<naga::Type>) -> Option<u32> {
    match &module.types[ty].inner {
        TypeInner::Array { stride, .. } => Some(*stride),
        TypeInner::Struct { members, .. } => array_stride(module, members.last()?.ty),
        _ => None,
    }
}

fn type_name(module: &Module, ty: naga::Handle<naga::Type>) -> String {
    let scalar = |scalar: naga::Scalar| {
        let kind = match scalar.kind {
            naga::ScalarKind::Sint => "i",
            naga::ScalarKind::Uint => "u",
            naga::ScalarKind::Float => "f",
            naga::ScalarKind::Bool => return "bool".to_owned(),
            naga::ScalarKind::AbstractInt | naga::ScalarKind::AbstractFloat => return "abstract".to_owned(),
        };
        format!("{kind}{}", u32::from(scalar.width) * 8)
    };
    let ty = &module.types[ty];
    match &ty.inner {
        TypeInner::Scalar(s) => scalar(*s),
        TypeInner::Vector { size, scalar: s } => format!("vec{}<{}>", *size as u32, scalar(*s)),
        TypeInner::Matrix { columns, rows, scalar: s } => {
            format!("mat{}x{}<{}>", *columns as u32, *rows as u32, scalar(*s))
        }
        TypeInner::Atomic(s) => format!("atomic<{}>", scalar(*s)),
        TypeInner::Array { base, size, .. } => match size {
            ArraySize::Constant(count) => format!("array<{}, {count}>", type_name(module, *base)),
            ArraySize::Pending(_) => format!("array<{}, override>", type_name(module, *base)),
            ArraySize::Dynamic => format!("array<{}>", type_name(module, *base)),
        },
        _ => ty.name.as_deref().map_or_else(|| "opaque".to_owned(), |name| unmangle(name).to_owned()),
    }
}
