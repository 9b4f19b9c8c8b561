//! The GPU: device, memory, kernels and the frame graph. Knows no scene and no light.
//!
//! * [`Gpu::open`] picks an adapter and opens a device; [`adapters`] reports what there is.
//! * [`Gpu::kernel`] links and compiles a kernel of `shaders`; [`Gpu::prepare`] does so in the background.
//! * [`Gpu::buffer`] allocates memory, counted against a budget before the driver is called.
//! * [`Gpu::graph`] records passes that bind buffers by name; [`Graph::submit`] runs them and
//!   [`Submission::wait`] brings back times and bytes.
//! * A kernel with a vertex and a fragment shader draws triangles into [`Target`]s: back faces only, so that a closed
//!   mesh covers each of its pixels once from outside and inside alike, with additive blending in the order of the
//!   triangles.
//!
//! Nothing here panics when the device is lost: every call then returns [`GpuError::DeviceLost`], and the owner opens a
//! new device and rebuilds from its data on the host. wgpu's types stay inside this crate.

mod adapter;
mod device;
mod error;
mod execute;
mod graph;
mod kernel;
mod memory;
mod pipeline_cache;
mod staging;
mod target;
mod tracker;
mod wait;

pub use adapter::{AdapterKind, AdapterReport, GpuLimits, Tier, adapters};
pub use device::{Gpu, GpuOptions, PassTiming};
pub use error::GpuError;
pub use execute::{GraphReport, PassTime, Submission};
pub use graph::{Graph, PassBuilder, Ticket};
pub use kernel::Kernel;
pub use memory::{Buffer, MemoryKind, MemoryUse};
pub use target::Target;
pub use tracker::TrackedError;
