//! The error type of HTTP: every error that a client sees is an `application/problem+json` document.

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use surfelcast_protocol::problem::{PROBLEM_JSON, Problem};
use surfelcast_renderer::RendererError;
use surfelcast_renderer::scene::SceneError;
use surfelcast_store::StoreError;

use crate::error::DomainError;

/// An error answer. `detail` names the field, the limit and the remedy.
#[derive(Clone, Debug)]
pub(crate) struct ApiError {
    status: StatusCode,
    code: &'static str,
    detail: String,
    retry_after_secs: Option<u32>,
}

impl ApiError {
    /// An error with a machine-readable code.
    pub(crate) fn new(status: StatusCode, code: &'static str, detail: impl Into<String>) -> Self {
        Self { status, code, detail: detail.into(), retry_after_secs: None }
    }

    /// 400: the request is not well formed.
    pub(crate) fn bad_request(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, "bad_request", detail)
    }

    /// 422: well formed, but a value is not allowed.
    pub(crate) fn unprocessable(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, "invalid_value", detail)
    }

    /// 503: the server is stopping.
    pub(crate) fn draining() -> Self {
        let detail = "the server is stopping; it takes no new work";
        Self::new(StatusCode::SERVICE_UNAVAILABLE, "draining", detail).retry_after(10)
    }

    /// 404.
    pub(crate) fn not_found(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, "not_found", detail)
    }

    /// 500, with a text that hides the cause, which is logged here, once.
    pub(crate) fn internal(cause: &dyn std::fmt::Display) -> Self {
        DomainError::internal(cause).into()
    }

    /// The same error, with the seconds after which a retry may succeed.
    pub(crate) fn retry_after(mut self, secs: u32) -> Self {
        self.retry_after_secs = Some(secs);
        self
    }

    /// HTTP status.
    #[cfg(test)]
    pub(crate) fn status(&self) -> StatusCode {
        self.status
    }

    /// Machine-readable code.
    #[cfg(test)]
    pub(crate) fn code(&self) -> &'static str {
        self.code
    }

    /// Text for people.
    #[cfg(test)]
    pub(crate) fn detail(&self) -> &str {
        &self.detail
    }

    /// The document.
    pub(crate) fn document(&self) -> Problem {
        Problem {
            kind: "about:blank".into(),
            title: self.status.canonical_reason().unwrap_or("Error").into(),
            status: self.status.as_u16(),
            code: self.code.into(),
            detail: self.detail.clone(),
            retry_after_secs: self.retry_after_secs,
        }
    }
}

impl From<RendererError> for ApiError {
    fn from(error: RendererError) -> Self {
        let detail = error.to_string();
        let unavailable = |code| Self::new(StatusCode::SERVICE_UNAVAILABLE, code, detail.clone());
        match error {
            RendererError::Stopped => unavailable("renderer_stopped").retry_after(10),
            RendererError::Busy { .. } => unavailable("renderer_busy").retry_after(2),
            RendererError::NoMemory { .. } => unavailable("gpu_memory").retry_after(10),
            RendererError::DeviceLost => unavailable("device_lost").retry_after(5),
            RendererError::SceneTooLarge { .. } => {
                Self::new(StatusCode::UNPROCESSABLE_ENTITY, "scene_too_large", detail)
            }
            RendererError::Unsupported(_) => Self::new(StatusCode::UNPROCESSABLE_ENTITY, "unsupported", detail),
            RendererError::Canceled => Self::new(StatusCode::CONFLICT, "render_canceled", detail),
            RendererError::Unknown(_) => Self::not_found(detail),
        }
    }
}

impl From<DomainError> for ApiError {
    fn from(error: DomainError) -> Self {
        let detail = error.to_string();
        let new = |status, code| Self::new(status, code, detail);
        match error {
            DomainError::Renderer(error) => error.into(),
            DomainError::StoreLimit(StoreError::TooManyRenders { .. }) => {
                new(StatusCode::TOO_MANY_REQUESTS, "render_queue_full").retry_after(5)
            }
            DomainError::StoreLimit(_) => new(StatusCode::INSUFFICIENT_STORAGE, "storage_full"),
            DomainError::InvalidScene(error) => new(StatusCode::UNPROCESSABLE_ENTITY, scene_code(&error)),
            DomainError::NotEncodable(_) => new(StatusCode::UNPROCESSABLE_ENTITY, "not_encodable"),
            DomainError::UnknownScene | DomainError::UnknownSession => new(StatusCode::NOT_FOUND, "not_found"),
            DomainError::BuiltinScene => new(StatusCode::CONFLICT, "builtin_scene"),
            DomainError::LoadingBusy { .. } => new(StatusCode::SERVICE_UNAVAILABLE, "loading_busy").retry_after(5),
            DomainError::SessionFull { .. } => new(StatusCode::SERVICE_UNAVAILABLE, "session_full").retry_after(5),
            DomainError::NotFinished => new(StatusCode::CONFLICT, "not_ready").retry_after(1),
            DomainError::RenderCanceled => new(StatusCode::CONFLICT, "render_canceled"),
            DomainError::Internal => new(StatusCode::INTERNAL_SERVER_ERROR, "internal"),
        }
    }
}

/// Code of an upload that is no scene this server can render.
fn scene_code(error: &SceneError) -> &'static str {
    match error {
        SceneError::Read { .. } | SceneError::Invalid { .. } => "invalid_scene",
        SceneError::UnsupportedExtension { .. } => "unsupported_extension",
        SceneError::TooLarge { .. } => "scene_too_large",
    }
}

impl IntoResponse for ApiError {
    fn into_response(self) -> Response {
        let body = serde_json::to_vec(&self.document()).unwrap_or_default();
        let mut response = (self.status, [(header::CONTENT_TYPE, PROBLEM_JSON)], body).into_response();
        let headers = response.headers_mut();
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
        if let Some(secs) = self.retry_after_secs {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(secs));
        }
        response
    }
}
