//! Device layout of the scene and of a frame. Fields are documented in full in the WESL structures of the same names.

pub mod passes;
pub mod scene;
pub mod surfel;

pub use passes::*;
pub use scene::*;
pub use surfel::*;

/// All of them, for the comparison with WGSL.
pub fn structs() -> Vec<crate::layout::HostStruct> {
    [scene::structs(), passes::structs(), surfel::structs()].concat()
}
