//! Rendering techniques and the passes they share.
//!
//! `passes/` holds what every technique may use: upload, light table, frame uniforms, tone map, first-surface outputs,
//! error audit. Each technique is one folder and one line in [`registry`]. A technique records passes into a frame graph;
//! it owns its history and says what of it survives a change.

pub mod gradient;
pub mod passes;
pub mod path;
pub mod registry;
pub mod session;
pub mod surfel;
pub mod technique;

pub use passes::audit::{Audit, AuditResult};
pub use passes::first_surface::FirstSurfaceOutput;
pub use passes::frame::FrameView;
pub use passes::lights::{LightBuffers, LightState};
pub use passes::upload::SceneBuffers;
pub use session::SessionState;
pub use surfel::{
    Apply, ExportedSurfel, KNOBS, Knob, Reconstruction, SnapshotIdentity, SurfelCache, SurfelOutput, SurfelSettings,
};
pub use surfelcast_shaders::constants::SURFEL_FULL_TRUST as FULL_TRUST;
pub use surfelcast_shaders::records::SurfelContribution;
pub use technique::{
    Change, Conformance, MaterialMode, Step, StepBudget, Technique, TechniqueEntry, TechniqueError, TechniqueOptions,
};
