//! HTTP: `/v1/renders`.

use std::sync::Arc;
use std::time::Duration;

use axum::Json;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use sha2::{Digest, Sha256};
use surfelcast_render_api::RenderRequest;
use surfelcast_renderer::{DeviceState, ErrorEstimate, RenderOutput};
use utoipa::ToSchema;

use crate::http::body::{BodyReader, media_type};
use crate::http::idempotency::Begin;
use crate::http::negotiate::{Representation, choose, is_none_match_hit, prefer_wait};
use crate::http::problem::ApiError;
use crate::http::render_request::{limits, resolve};
use crate::image_format::ImageFormat;
use crate::jobs::{Job, JobState};
use crate::state::ServiceState;

/// A render as a resource.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct RenderInfo {
    /// Render id.
    id: String,
    /// `queued`, `running`, `succeeded`, `failed` or `canceled`.
    status: &'static str,
    /// Scene id.
    scene: String,
    /// Width, pixels.
    width: u32,
    /// Height, pixels.
    height: u32,
    /// Technique id.
    technique: String,
    /// Share done by the nearest stop rule, 0 to 1.
    progress: f32,
    /// Samples a pixel so far.
    samples: u32,
    /// Latest error audit: `rmse_tonemapped` with its standard error `std_error`; the true RMSE lies between `rmse_low`
    /// and `rmse_high` in nine cases of ten. `mse_tonemapped` is the unbiased mean square, which chance may put below
    /// 0, and `rel_mse` the mean square of linear values relative to their size.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    error_estimate: Option<ErrorEstimate>,
    /// Path of the image, also while there is none yet.
    image: String,
    /// Measurements of a finished render.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    result: Option<serde_json::Value>,
    /// Problem document of a failed render.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    problem: Option<surfelcast_protocol::problem::Problem>,
}

impl RenderInfo {
    fn of(job: &Job) -> Self {
        let progress = job.progress();
        let state = job.state();
        let (status, result, problem) = match &state {
            JobState::Active if progress.is_running => ("running", None, None),
            JobState::Active => ("queued", None, None),
            JobState::Succeeded(output) => ("succeeded", Some(measurements(output)), None),
            JobState::Failed(error) => ("failed", None, Some(ApiError::from(error.clone()).document())),
            JobState::Canceled => ("canceled", None, None),
        };
        let output = if let JobState::Succeeded(output) = &state { Some(output) } else { None };
        Self {
            id: job.id.clone(),
            status,
            scene: job.spec.scene.clone(),
            width: job.spec.size[0],
            height: job.spec.size[1],
            technique: job.spec.technique.clone(),
            progress: if output.is_some() { 1.0 } else { progress.fraction },
            samples: output.map_or(progress.samples, |output| output.samples),
            error_estimate: output.map_or(progress.error, |output| output.error),
            image: format!("/v1/renders/{}/image", job.id),
            result,
            problem,
        }
    }
}

fn measurements(output: &RenderOutput) -> serde_json::Value {
    let memory: serde_json::Map<String, serde_json::Value> =
        output.memory_bytes.iter().map(|(kind, bytes)| (kind.clone(), (*bytes).into())).collect();
    serde_json::json!({
        "samples_per_pixel": output.samples,
        "stopped_by": output.stopped_by,
        "rays": output.rays,
        "time_secs": {"render": output.render_secs, "setup": output.setup_secs},
        "passes": output.passes,
        "skipped": output.skipped,
        "non_finite": output.non_finite,
        "memory_bytes": memory,
    })
}

/// Renders an image: at once with `Prefer: wait=N` and an image type in `Accept`, else as a job.
#[utoipa::path(post, path = "/v1/renders", tag = "renders", request_body = RenderRequest,
    params(
        ("Prefer" = Option<String>, Header, description = "wait=N answers with the image if it is finished within N seconds"),
        ("Idempotency-Key" = Option<String>, Header, description = "A request sent twice does its work once")),
    responses((status = 200, description = "The image, or the finished job for Accept: application/json",
            headers(("Surfelcast-Error-Rmse" = f32, description = "Audited RMSE after the tone map"),
                ("Surfelcast-Error-Std" = f32, description = "Standard error of Surfelcast-Error-Rmse"),
                ("Surfelcast-Samples" = u32, description = "Samples a pixel"),
                ("Surfelcast-Render-Secs" = f64, description = "Seconds of rendering"))),
        (status = 202, body = RenderInfo, description = "Accepted; see Location"),
        (status = 400, description = "Not well formed"), (status = 404, description = "No such scene"),
        (status = 406, description = "No acceptable image type"), (status = 409, description = "Same key in flight"),
        (status = 422, description = "A value that cannot be"), (status = 429, description = "Queue full"),
        (status = 503, description = "No capacity")))]
pub(crate) async fn create(
    State(state): State<ServiceState>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, ApiError> {
    if media_type(&headers).is_none_or(|mime| mime != "application/json") {
        let detail = "Content-Type: must be application/json";
        return Err(ApiError::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "unsupported_media_type", detail));
    }
    let config = state.config();
    let limit = config.bounds.json_bytes as u64;
    let body = BodyReader::new(body, &headers, "body", limit, config.timeouts)?.all().await?;
    let wait = prefer_wait(&headers).map(|secs| Duration::from_secs(secs).min(config.timeouts.prefer_wait));
    let begin = state.idempotency().begin(&headers, &hex::encode(Sha256::digest(&body)))?;
    let (job, format, _in_flight) = match begin {
        Some(Begin::Repeat(id)) => {
            let job = state.jobs().get(&id).ok_or_else(|| {
                let detail = "Idempotency-Key: the render it made is no longer kept; take a new key";
                ApiError::new(StatusCode::GONE, "render_gone", detail)
            })?;
            let format = answer_format(&headers, &job, wait)?;
            (job, format, None)
        }
        Some(Begin::First(mut in_flight)) => {
            let (job, format) = submit(&state, &headers, &body, wait).await?;
            in_flight.made(&job.id);
            (job, format, Some(in_flight))
        }
        None => {
            let (job, format) = submit(&state, &headers, &body, wait).await?;
            (job, format, None)
        }
    };
    let mut response = match wait {
        Some(wait) if tokio::time::timeout(wait, job.finished()).await.is_ok() => match format {
            Representation::Json => Json(RenderInfo::of(&job)).into_response(),
            Representation::Image(format) => image_response(&state, &job, format, &headers, false).await?,
        },
        _ => {
            let location = format!("/v1/renders/{}", job.id);
            let fields = [(header::LOCATION, location), (header::RETRY_AFTER, "1".into())];
            (StatusCode::ACCEPTED, fields, Json(RenderInfo::of(&job))).into_response()
        }
    };
    if let Some(wait) = wait
        && let Ok(value) = HeaderValue::from_str(&format!("wait={}", wait.as_secs()))
    {
        response.headers_mut().insert(HeaderName::from_static("preference-applied"), value);
    }
    Ok(response)
}

async fn submit(
    state: &ServiceState,
    headers: &HeaderMap,
    body: &[u8],
    wait: Option<Duration>,
) -> Result<(Arc<Job>, Representation), ApiError> {
    if state.draining().is_cancelled() {
        return Err(ApiError::draining());
    }
    let config = state.config();
    let request = RenderRequest::parse(body)?;
    let status = state.renderer_status();
    request.check(&status.catalogue, &limits(&config.bounds))?;
    let entry = state.scenes().get(request.scene.as_deref().unwrap_or_default())?;
    if status.state != DeviceState::Ready {
        let detail = "the render device is not ready; try again later";
        return Err(ApiError::new(StatusCode::SERVICE_UNAVAILABLE, "no_device", detail).retry_after(5));
    }
    let scene = state.scenes().load(&entry).await?;
    let render = resolve(&request, scene, &status, &config.bounds, &config.server)?;
    // If no acceptable answer exists, the request is refused before the work, not after it.
    if wait.is_some() {
        choose(headers, &acceptable(render.job.spec.aov.is_some()))?;
    }
    let (job, is_new) = state.jobs().submit(render.job, render.key)?;
    tracing::info!(job = %job.id, is_new, "render requested");
    let format = answer_format(headers, &job, wait)?;
    Ok((job, format))
}

fn acceptable(is_data: bool) -> Vec<Representation> {
    ImageFormat::of_output(is_data).iter().copied().map(Representation::Image).chain([Representation::Json]).collect()
}

fn answer_format(headers: &HeaderMap, job: &Job, wait: Option<Duration>) -> Result<Representation, ApiError> {
    if wait.is_none() { Ok(Representation::Json) } else { choose(headers, &acceptable(job.spec.aov.is_some())) }
}

/// Describes a render.
#[utoipa::path(get, path = "/v1/renders/{id}", tag = "renders",
    params(("id" = String, Path, description = "Render id")),
    responses((status = 200, body = RenderInfo), (status = 404, description = "No such render")))]
pub(crate) async fn get(State(state): State<ServiceState>, Path(id): Path<String>) -> Result<Response, ApiError> {
    let job = find(&state, &id)?;
    let info = Json(RenderInfo::of(&job));
    Ok(match job.state() {
        JobState::Active => ([(header::RETRY_AFTER, "1")], info).into_response(),
        _ => info.into_response(),
    })
}

/// The image of a finished render, in the type that `Accept` prefers.
#[utoipa::path(get, path = "/v1/renders/{id}/image", tag = "renders",
    params(("id" = String, Path, description = "Render id")),
    responses((status = 200, description = "PNG, JPEG, WebP or EXR (linear, unexposed)",
            headers(("Surfelcast-Error-Rmse" = f32, description = "Audited RMSE after the tone map"),
                ("Surfelcast-Error-Std" = f32, description = "Standard error of Surfelcast-Error-Rmse"),
                ("Surfelcast-Samples" = u32, description = "Samples a pixel"),
                ("Surfelcast-Render-Secs" = f64, description = "Seconds of rendering"))),
        (status = 304, description = "If-None-Match holds"), (status = 404, description = "No such render"),
        (status = 406, description = "No acceptable image type"),
        (status = 409, description = "Not finished, failed or canceled")))]
pub(crate) async fn image(
    State(state): State<ServiceState>,
    Path(id): Path<String>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let job = find(&state, &id)?;
    let available: Vec<_> = job.formats().iter().map(|format| Representation::Image(*format)).collect();
    match choose(&headers, &available)? {
        Representation::Image(format) => image_response(&state, &job, format, &headers, true).await,
        Representation::Json => Ok(Json(RenderInfo::of(&job)).into_response()),
    }
}

/// Cancels a render. A finished one stays as it is and keeps its image; a canceled one has none, whatever it had
/// accumulated, and an equal request starts it from the beginning.
#[utoipa::path(post, path = "/v1/renders/{id}/cancel", tag = "renders",
    params(("id" = String, Path, description = "Render id")),
    responses((status = 202, body = RenderInfo), (status = 404, description = "No such render")))]
pub(crate) async fn cancel(State(state): State<ServiceState>, Path(id): Path<String>) -> Result<Response, ApiError> {
    let job = find(&state, &id)?;
    job.cancel();
    // The renderer checks for a cancel between two dispatches, so the outcome usually comes at once.
    let _ = tokio::time::timeout(Duration::from_secs(1), job.finished()).await;
    Ok((StatusCode::ACCEPTED, Json(RenderInfo::of(&job))).into_response())
}

/// Cancels a render and deletes it.
#[utoipa::path(delete, path = "/v1/renders/{id}", tag = "renders",
    params(("id" = String, Path, description = "Render id")),
    responses((status = 204, description = "Gone"), (status = 404, description = "No such render")))]
pub(crate) async fn delete(State(state): State<ServiceState>, Path(id): Path<String>) -> Result<StatusCode, ApiError> {
    let job = find(&state, &id)?;
    state.jobs().remove(&job);
    Ok(StatusCode::NO_CONTENT)
}

fn find(state: &ServiceState, id: &str) -> Result<Arc<Job>, ApiError> {
    let detail = "render: no such render; finished ones are kept for a limited time";
    state.jobs().get(id).ok_or_else(|| ApiError::not_found(detail))
}

/// The image with its headers. `may_be_known`: `If-None-Match` applies (safe methods only).
async fn image_response(
    state: &ServiceState,
    job: &Arc<Job>,
    format: ImageFormat,
    headers: &HeaderMap,
    may_be_known: bool,
) -> Result<Response, ApiError> {
    let etag = job.etag(format);
    let is_known = may_be_known && matches!(job.state(), JobState::Succeeded(_)) && is_none_match_hit(headers, &etag);
    let (status, file) = if is_known {
        (StatusCode::NOT_MODIFIED, bytes::Bytes::new())
    } else {
        (StatusCode::OK, state.jobs().file(job, format).await?)
    };
    let mut response = (status, file).into_response();
    let fields = response.headers_mut();
    let mut set = |name: HeaderName, value: String| {
        if let Ok(value) = HeaderValue::from_str(&value) {
            fields.insert(name, value);
        }
    };
    set(header::CONTENT_TYPE, format.mime().into());
    set(header::ETAG, etag);
    set(header::VARY, "Accept".into());
    set(header::CACHE_CONTROL, "private, no-cache".into());
    set(header::CONTENT_LOCATION, format!("/v1/renders/{}/image", job.id));
    set(header::CONTENT_DISPOSITION, format!("inline; filename=\"render.{}\"", format.extension()));
    if let JobState::Succeeded(output) = job.state() {
        if let Some(error) = output.error {
            set(HeaderName::from_static("surfelcast-error-rmse"), error.rmse_tonemapped.to_string());
            set(HeaderName::from_static("surfelcast-error-std"), error.std_error.to_string());
        }
        set(HeaderName::from_static("surfelcast-samples"), output.samples.to_string());
        set(HeaderName::from_static("surfelcast-render-secs"), output.render_secs.to_string());
    }
    if is_known {
        response.headers_mut().remove(header::CONTENT_TYPE);
    }
    Ok(response)
}
