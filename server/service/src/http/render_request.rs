//! From the body of `POST /v1/renders` to a job with its key.

use std::sync::Arc;

use serde::Serialize;
use surfelcast_render_api::identity::identity_hex;
use surfelcast_render_api::{Fault, RenderRequest, RenderSpec, RequestLimits, SceneDefaults};
use surfelcast_renderer::scene::Scene;
use surfelcast_renderer::{DeviceInfo, RenderJob, RendererStatus};

use crate::config::Bounds;
use crate::http::problem::ApiError;

/// A job with its key.
#[derive(Clone, Debug)]
pub(crate) struct ResolvedRender {
    pub(crate) job: RenderJob,
    /// Hash over everything that the image depends on.
    pub(crate) key: String,
}

/// Everything that an image depends on.
#[derive(Serialize)]
struct Key<'a> {
    server: &'a str,
    device: &'a DeviceInfo,
    request: &'a RenderSpec,
}

/// What this service lets a request have.
pub(crate) fn limits(bounds: &Bounds) -> RequestLimits {
    RequestLimits {
        side: bounds.render_side,
        pixels: bounds.render_pixels,
        samples: bounds.render_samples,
        secs: bounds.render_secs,
    }
}

/// Fills in what depends on the scene and the renderer.
pub(crate) fn resolve(
    request: &RenderRequest,
    scene: Arc<Scene>,
    status: &RendererStatus,
    bounds: &Bounds,
    server: &str,
) -> Result<ResolvedRender, ApiError> {
    let spec = request.resolve(&status.catalogue, &SceneDefaults::of(&scene), &limits(bounds))?;
    let key = identity_hex(&Key { server, device: &status.device, request: &spec });
    Ok(ResolvedRender {
        key: key.map_err(|error| ApiError::internal(&error))?,
        job: RenderJob { scene, lights: None, spec, exports: false },
    })
}

/// 400 for what is not well formed, 422 for values that cannot be.
impl From<Fault> for ApiError {
    fn from(fault: Fault) -> Self {
        if fault.is_malformed { Self::bad_request(fault.to_string()) } else { Self::unprocessable(fault.to_string()) }
    }
}
