//! The render actor: GPU state of sessions, scheduling, refinement of views, batch renders, error audits.
//!
//! The actor runs on a named thread of its own and owns the GPU. Other threads send it commands through
//! [`RendererHandle`], whose channel is bounded, and read frames from [`FrameSlot`]s that hold the newest one.
//!
//! Policy has no device in it and is tested on plain data: who works next (`scheduler`), what a view renders next
//! (`refinement`), when a job is done (`stop`), when errors are audited (`audit_schedule`), when a device is given up
//! (`device_life`). [`progressive`] drives a technique; `running_view` and `running_job` carry the decisions out.

mod actor;
mod audit_schedule;
pub mod command;
pub mod config;
mod device_life;
mod error;
pub mod handle;
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
pub use job::RenderJob;
pub use progressive::Progressive;
pub use slot::FrameSlot;
pub use status::{DeviceInfo, DeviceState, RendererStatus};
pub use surfelcast_render_api::{
    Catalogue, ErrorEstimate, Inspection, JobProgress, MaterialMode, PassTime, RayCounts, RenderOutput, RenderSpec,
    Settings, SkippedPass, StopRules,
};
pub use throughput::Throughput;
pub use view::{Frame, FrameKind, ViewState};
