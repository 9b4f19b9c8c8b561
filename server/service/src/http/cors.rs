//! What pages of other, configured origins may do with the HTTP API (the Fetch standard's CORS protocol).
//!
//! The answer names the origin of the request, never `*`, and never allows credentials: the service has none. It is not
//! `tower-http`'s layer, which answers every `OPTIONS` request itself, with 200, and loses the case of header names.

use axum::body::Body;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::response::Response;

use crate::config::ServiceConfig;

const METHODS: HeaderValue = HeaderValue::from_static("GET, POST, DELETE");
/// Request headers the API reads beyond those a browser always lets through.
const REQUEST_HEADERS: HeaderValue =
    HeaderValue::from_static("Accept, Content-Type, Idempotency-Key, If-None-Match, Prefer");
/// Answer headers a page may read beyond those a browser always shows.
const EXPOSED_HEADERS: HeaderValue = HeaderValue::from_static(
    "ETag, Location, Retry-After, Surfelcast-Error-RMSE, Surfelcast-Error-Std, Surfelcast-Render-Secs, Surfelcast-Samples",
);
/// Seconds a browser may remember a preflight.
const MAX_AGE: HeaderValue = HeaderValue::from_static("600");

/// The `Origin` of a request, where it is on the configured list.
pub(crate) fn listed_origin(config: &ServiceConfig, headers: &HeaderMap) -> Option<HeaderValue> {
    let origin = headers.get(header::ORIGIN)?;
    is_listed(config, origin.to_str().ok()?).then(|| origin.clone())
}

/// Whether an origin is on the configured list.
pub(crate) fn is_listed(config: &ServiceConfig, origin: &str) -> bool {
    config.origins.iter().any(|allowed| allowed.trim_end_matches('/').eq_ignore_ascii_case(origin))
}

/// Whether a browser requests permission before it sends the request itself.
pub(crate) fn is_preflight(method: &Method, headers: &HeaderMap) -> bool {
    *method == Method::OPTIONS && headers.contains_key(header::ACCESS_CONTROL_REQUEST_METHOD)
}

/// The answer to a preflight of a listed origin; [`allow`] adds the origin itself.
pub(crate) fn preflight() -> Response {
    let mut response = Response::new(Body::empty());
    *response.status_mut() = StatusCode::NO_CONTENT;
    let headers = response.headers_mut();
    headers.insert(header::ACCESS_CONTROL_ALLOW_METHODS, METHODS);
    headers.insert(header::ACCESS_CONTROL_ALLOW_HEADERS, REQUEST_HEADERS);
    headers.insert(header::ACCESS_CONTROL_MAX_AGE, MAX_AGE);
    response
}

/// Lets the page of a listed origin read an answer. Every answer carries `Vary`, so that no cache hands one origin's
/// answer to another.
pub(crate) fn allow(origin: Option<HeaderValue>, headers: &mut HeaderMap) {
    headers.append(header::VARY, HeaderValue::from_static("Origin"));
    if let Some(origin) = origin {
        headers.insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, origin);
        headers.insert(header::ACCESS_CONTROL_EXPOSE_HEADERS, EXPOSED_HEADERS);
        // The default, `same-origin`, would keep a listed page from showing a render in an `img`.
        headers
            .insert(HeaderName::from_static("cross-origin-resource-policy"), HeaderValue::from_static("cross-origin"));
    }
}
