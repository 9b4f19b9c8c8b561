//! The shader library and its Rust counterpart. Knows no wgpu, so everything here is tested without a GPU.
//!
//! * `lib/` holds WESL modules that kernels import (`import package::lib::core::rng::next_float;`).
//! * `techniques/<id>/kernels/` holds kernels: one entry point per file, named like the file, or two if it draws,
//!   `<file>_vertex` and `<file>_fragment`. That one name is also the label of the pass and of its timer. The modules
//!   that the kernels of a technique import are next to that folder.
//! * [`link`] turns a kernel and a set of [`Features`] into plain WGSL with a [`Reflection`] of what it binds.
//! * [`constants`] are written once, in Rust, and imported by shaders from `package::constants`.
//! * [`layout`] holds the structures that cross from the host to shaders; a test compares each with the WGSL structure
//!   of the same name, in every kernel and variant.

extern crate self as surfelcast_shaders;

mod catalogue;
pub mod constants;
mod features;
pub mod layout;
mod link;
mod mangle;
pub mod records;
mod reflect;
pub mod twin;

pub use catalogue::{KernelInfo, Module, kernels, modules};
pub use features::Features;
pub use link::{LinkError, LinkedKernel, link, link_source, validate};
pub use reflect::{Access, Binding, FRAGMENT_SUFFIX, MemberLayout, Reflection, StructLayout, VERTEX_SUFFIX};

/// naga, for callers that inspect a linked kernel further.
pub use naga;
