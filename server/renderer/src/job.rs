//! Batch renders: one image at a stated error, sample count or deadline.

use std::sync::Arc;

use surfelcast_render_api::RenderSpec;
use surfelcast_scene::{LightState, Scene};

/// One image to render.
#[derive(Clone, Debug)]
pub struct RenderJob {
    /// Scene, the one that the specification names.
    pub scene: Arc<Scene>,
    /// Lights; `None` = the scene's own.
    pub lights: Option<LightState>,
    /// All that the pixels depend on.
    pub spec: RenderSpec,
    /// Whether what the technique can export comes with the image.
    pub exports: bool,
}
