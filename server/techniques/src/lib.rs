//! Rendering techniques. The passes that they share are in the crate `surfelcast-passes`.
//!
//! Each technique is one folder and one line in [`registry`]. A technique records passes into a frame graph; it owns
//! its history and says what of it survives a change. What can be requested of it is data
//! ([`surfelcast_render_api::TechniqueDescription`]): its settings, presets and outputs appear on the command line, in
//! the HTTP schema and on the page without a line of code there.

pub mod gradient;
pub mod outputs;
pub mod path;
pub mod registry;
pub mod session;
pub mod surfel;
pub mod technique;

pub use outputs::{COMMON_OUTPUTS, CommonOutput};
pub use registry::TECHNIQUES;
pub use session::{SessionState, SnapshotIdentity, TechniqueSession};
pub use surfelcast_passes::audit::{Audit, AuditResult};
pub use surfelcast_passes::first_surface::FirstSurfaceOutput;
pub use surfelcast_passes::frame::FrameView;
pub use surfelcast_passes::lights::LightBuffers;
pub use surfelcast_passes::materials::MaterialMode;
pub use surfelcast_passes::step::{Step, StepBudget};
pub use surfelcast_passes::upload::SceneBuffers;
pub use surfelcast_scene::LightState;
pub use technique::{
    Change, Conformance, EarlierFrame, OutputImage, Technique, TechniqueEntry, TechniqueError, TechniqueOptions,
};
