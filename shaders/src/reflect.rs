//! What a linked kernel binds and how its structures lie in memory, read from naga's module.

use std::collections::BTreeMap;

use naga::{AddressSpace, ArraySize, Module, ShaderStage, StorageAccess, TypeInner};

use crate::link::unmangle;

/// What a kernel may do with a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Access {
    /// `var<uniform>`.
    Uniform,
    /// `var<storage, read>`.
    StorageRead,
    /// `var<storage, read_write>`.
    StorageReadWrite,
}

/// One bound buffer.
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
    /// Bytes from element to element, where the binding is or ends in an array.
    pub array_stride: Option<u32>,
    /// Type, such as `array<Node>`.
    pub type_name: String,
}

/// How a structure lies in memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StructLayout {
    /// Bytes, rounded up to the alignment.
    pub size: u32,
    /// Bytes.
    pub align: u32,
    /// In order.
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

/// What there is to know of a linked kernel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reflection {
    /// Name of the entry point, which is the kernel's.
    pub entry_point: String,
    /// Invocations of a workgroup in x, y, z.
    pub workgroup_size: [u32; 3],
    /// Sorted by group and slot.
    pub bindings: Vec<Binding>,
    /// By name, without the module.
    pub structs: BTreeMap<String, StructLayout>,
}

/// Reads `module`; the answer to a module that breaks a rule of ours is a sentence.
pub(crate) fn reflect(module: &Module, kernel: &str) -> Result<Reflection, String> {
    let [entry] = module.entry_points.as_slice() else {
        return Err(format!("a kernel has exactly one entry point, this one has {}", module.entry_points.len()));
    };
    if entry.stage != ShaderStage::Compute {
        return Err("the entry point is no compute shader".to_owned());
    }
    if entry.name != kernel {
        return Err(format!("the entry point is called `{}`, the file `{kernel}`: they must agree", entry.name));
    }
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
            _ => return Err(format!("binding `{name}` is no buffer; kernels bind uniform and storage buffers only")),
        };
        bindings.push(Binding {
            group: slot.group,
            binding: slot.binding,
            name,
            access,
            min_size: layouter[variable.ty].size,
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
    Ok(Reflection { entry_point: entry.name.clone(), workgroup_size: entry.workgroup_size, bindings, structs })
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
