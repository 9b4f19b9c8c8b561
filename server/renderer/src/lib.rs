//! The render actor: sessions' GPU state, scheduling, frame loop, convergence, error audit. Commands in, frames out.
//!
//! The actor runs on its own named thread and owns the GPU. Everything else talks to it through [`RendererHandle`], whose
//! command channel is bounded, and reads frames from newest-wins [`FrameSlot`]s.

mod actor;
mod audit_schedule;
pub mod command;
pub mod config;
mod device_life;
mod error;
pub mod handle;
pub mod inspection;
pub mod job;
pub mod progressive;
mod refinement;
mod running_job;
mod running_view;
mod scenes;
mod scheduler;
mod session;
pub mod slot;
mod snapshots;
pub mod status;
mod stop;
mod submitted_job;
mod throughput;
pub mod view;

pub use surfelcast_scene as scene;

pub use actor::start;
pub use command::{Command, CommandReceiver, SessionKey, ViewKey};
pub use config::RendererConfig;
pub use error::RendererError;
pub use handle::RendererHandle;
pub use inspection::{Contribution, Inspection};
pub use job::{
    Aov, DEFAULT_TECHNIQUE, ErrorEstimate, ExportedSurfel, JobProgress, KNOBS, Knob, MaterialMode, PassTime, RayCounts,
    Reconstruction, RenderJob, RenderOutput, SkippedPass, StopRules, SurfelOutput, SurfelSettings,
};
pub use progressive::Progressive;
pub use slot::FrameSlot;
pub use status::{DeviceInfo, DeviceState, RendererStatus};
pub use throughput::Throughput;
pub use view::{Frame, FrameKind, ViewState};
