//! What the outside may know of the renderer at any time.

use std::sync::Arc;

use surfelcast_render_api::Catalogue;

/// The device in use.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct DeviceInfo {
    /// Adapter name.
    pub name: String,
    /// `discrete`, `integrated`, `virtual`, `cpu` or `other`.
    pub kind: String,
    /// Driver and version.
    pub driver: String,
    /// API, e.g. `vulkan`.
    pub backend: String,
}

/// Health of the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceState {
    /// Being opened.
    #[default]
    Starting,
    /// Renders.
    Ready,
    /// Lost and being rebuilt.
    Lost,
    /// Lost too often (3 times in 5 minutes), or never found.
    Failed,
}

/// Snapshot, published through a `watch` channel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RendererStatus {
    /// Health.
    pub state: DeviceState,
    /// Device.
    pub device: DeviceInfo,
    /// Rises by one when the device was rebuilt.
    pub epoch: u32,
    /// What may be requested.
    pub catalogue: Arc<Catalogue>,
    /// Open sessions.
    pub session_count: u32,
    /// Open views.
    pub view_count: u32,
    /// Views that have converged or are paused.
    pub idle_view_count: u32,
    /// Jobs waiting.
    pub queued_job_count: u32,
    /// Device bytes in use.
    pub memory_used_bytes: u64,
    /// Device bytes that may be used.
    pub memory_budget_bytes: u64,
    /// Frames finished since start.
    pub frame_count: u64,
    /// Rays traced since start.
    pub ray_count: u64,
    /// Devices lost since start.
    pub device_lost_count: u32,
}
