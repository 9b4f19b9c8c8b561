//! Interactive views and the frames they produce.

use std::sync::Arc;
use std::time::Instant;

use surfelcast_render_api::{ErrorEstimate, PassTime, Settings, SkippedPass};
use surfelcast_scene::Camera;

/// Settings of a view. The actor keeps only the newest.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewState {
    /// Camera, world space.
    pub camera: Camera,
    /// Full size in pixels, at least 1. The service sets further limits.
    pub size: [u32; 2],
    /// Linear exposure.
    pub exposure: f32,
    /// Technique id or alias, one of [`crate::RendererStatus::catalogue`].
    pub technique: String,
    /// Values of its settings; those that are missing are as the technique's id or alias has them.
    pub settings: Settings,
    /// Shown instead of radiance: id of an output that views can show, for inspecting the renderer.
    pub aov: Option<String>,
    /// A gesture is in progress: render fast and coarse.
    pub is_moving: bool,
    /// Nothing is rendered while true.
    pub is_paused: bool,
    /// Largest resolution factor while moving, in (0, 1]; lowered by rate control.
    pub max_scale: f32,
    /// Target time of a frame while moving, seconds.
    pub target_frame_secs: f32,
    /// Refinement ends at this tone-mapped RMSE.
    pub max_error: f32,
    /// Refinement ends at this number of samples a pixel.
    pub max_samples: u32,
    /// Last client input contained in this state.
    pub input_seq: u32,
}

/// Stage of refinement of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameKind {
    /// During a gesture; possibly at reduced size.
    Moving,
    /// At rest, still refining; full size.
    Still,
    /// Converged: no frame follows until something changes.
    Final,
}

/// One rendered image, ready for an encoder.
#[derive(Clone, Debug)]
pub struct Frame {
    /// RGBA8, sRGB-encoded after exposure and tone map, first row on top; alpha is 255. `size[0] * size[1] * 4` bytes.
    pub pixels: Arc<[u8]>,
    /// Size of `pixels`.
    pub size: [u32; 2],
    /// Size at which the client shows it.
    pub full_size: [u32; 2],
    /// Stage.
    pub kind: FrameKind,
    /// Last client input contained.
    pub input_seq: u32,
    /// Revision of scene and lights contained.
    pub scene_rev: u32,
    /// Accumulated samples a pixel.
    pub samples: u32,
    /// Audited error of this image, once it was audited.
    pub error: Option<ErrorEstimate>,
    /// Wall seconds of rendering since the previous frame.
    pub render_secs: f32,
    /// When it was finished.
    pub finished_at: Instant,
    /// Passes that ran.
    pub passes: Vec<PassTime>,
    /// Passes that did not.
    pub skipped: Vec<SkippedPass>,
}
