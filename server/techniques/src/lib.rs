//! Rendering techniques. The passes that they share are in the crate `surfelcast-passes`.
//!
//! Each technique is one folder and one line in [`registry`]. A technique records passes into a frame graph;
//! it owns its history and decides what of it survives a change.

pub mod gradient;
pub mod path;
pub mod registry;
pub mod session;
pub mod surfel;
pub mod technique;

pub use session::SessionState;
pub use surfel::{
    Apply, ExportedSurfel, KNOBS, Knob, Reconstruction, SnapshotIdentity, SurfelCache, SurfelOutput, SurfelSettings,
};
pub use surfelcast_passes::audit::{Audit, AuditResult};
pub use surfelcast_passes::first_surface::FirstSurfaceOutput;
pub use surfelcast_passes::frame::FrameView;
pub use surfelcast_passes::lights::LightBuffers;
pub use surfelcast_passes::materials::MaterialMode;
pub use surfelcast_passes::step::{Step, StepBudget};
pub use surfelcast_passes::upload::SceneBuffers;
pub use surfelcast_scene::LightState;
pub use surfelcast_shaders::constants::SURFEL_FULL_TRUST as FULL_TRUST;
pub use surfelcast_shaders::records::SurfelContribution;
pub use technique::{Change, Conformance, Technique, TechniqueEntry, TechniqueError, TechniqueOptions};
