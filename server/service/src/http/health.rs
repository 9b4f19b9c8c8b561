//! HTTP: health, readiness, metrics, version.

use axum::Json;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use surfelcast_renderer::DeviceInfo;
use utoipa::ToSchema;

use crate::http::problem::ApiError;
use crate::state::ServiceState;

/// Versions of the parts.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct VersionInfo {
    /// Program and version.
    server: String,
    /// Versions of the WebSocket protocol.
    protocol: [u32; 1],
    /// Render device.
    #[schema(value_type = Object)]
    device: DeviceInfo,
    /// Technique ids, the default first.
    techniques: Vec<&'static str>,
}

/// Whether the process is alive. True while draining, so that a supervisor does not end it before it has finished.
#[utoipa::path(get, path = "/healthz", tag = "operation", responses((status = 200, description = "Alive")))]
pub(crate) async fn healthz() -> Json<serde_json::Value> {
    Json(serde_json::json!({"status": "alive"}))
}

/// Whether new work is accepted: not while starting, draining, without a device, or with a full queue.
#[utoipa::path(get, path = "/readyz", tag = "operation",
    responses((status = 200, description = "Ready"), (status = 503, description = "Not ready; the detail says why")))]
pub(crate) async fn readyz(State(state): State<ServiceState>) -> Response {
    match state.unready_reason() {
        None => Json(serde_json::json!({"status": "ready"})).into_response(),
        Some(reason) => {
            let error = ApiError::new(StatusCode::SERVICE_UNAVAILABLE, reason, format!("not ready: {reason}"));
            error.retry_after(5).into_response()
        }
    }
}

/// Metrics in the Prometheus text format.
#[utoipa::path(get, path = "/metrics", tag = "operation", responses((status = 200, description = "Prometheus text")))]
pub(crate) async fn metrics_text(State(state): State<ServiceState>) -> Response {
    let status = state.renderer_status();
    let gauges = [
        ("surfelcast_device_memory_used_bytes", status.memory_used_bytes as f64),
        ("surfelcast_device_memory_budget_bytes", status.memory_budget_bytes as f64),
        ("surfelcast_renderer_sessions", f64::from(status.session_count)),
        ("surfelcast_renderer_views", f64::from(status.view_count)),
        ("surfelcast_renderer_idle_views", f64::from(status.idle_view_count)),
        ("surfelcast_renderer_queued_jobs", f64::from(status.queued_job_count)),
        ("surfelcast_active_jobs", state.jobs().active_count() as f64),
        ("surfelcast_ready", f64::from(u8::from(state.unready_reason().is_none()))),
    ];
    for (name, value) in gauges {
        metrics::gauge!(name).set(value);
    }
    metrics::counter!("surfelcast_device_lost_total").absolute(u64::from(status.device_lost_count));
    metrics::counter!("surfelcast_rays_total").absolute(status.ray_count);
    metrics::counter!("surfelcast_rendered_frames_total").absolute(status.frame_count);
    state.metrics().run_upkeep();
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], state.metrics().render()).into_response()
}

/// What is running.
#[utoipa::path(get, path = "/version", tag = "operation", responses((status = 200, body = VersionInfo)))]
pub(crate) async fn version(State(state): State<ServiceState>) -> Json<VersionInfo> {
    let status = state.renderer_status();
    Json(VersionInfo {
        server: state.config().server.clone(),
        protocol: [surfelcast_protocol::VERSION],
        techniques: status.catalogue.technique_ids().map(|(id, ..)| id).collect(),
        device: status.device,
    })
}
