//! Request bodies: bounded in size, and refused when they arrive too slowly.

use std::time::Duration;

use axum::body::Body;
use axum::http::{HeaderMap, StatusCode, header};
use bytes::Bytes;
use futures_util::StreamExt;
use tokio::time::Instant;

use crate::config::Timeouts;
use crate::http::problem::ApiError;

/// Reads a body piece by piece and enforces the size limit and the least rate.
pub(crate) struct BodyReader {
    stream: axum::body::BodyDataStream,
    field: &'static str,
    limit: u64,
    received: u64,
    began: Instant,
    timeouts: Timeouts,
}

impl BodyReader {
    /// Fails at once when `Content-Length` is over the limit. `field` names the body in errors.
    pub(crate) fn new(
        body: Body,
        headers: &HeaderMap,
        field: &'static str,
        limit: u64,
        timeouts: Timeouts,
    ) -> Result<Self, ApiError> {
        let stated = headers.get(header::CONTENT_LENGTH).and_then(|v| v.to_str().ok()).and_then(|v| v.parse().ok());
        if stated.is_some_and(|stated: u64| stated > limit) {
            return Err(too_large(field, limit));
        }
        Ok(Self { stream: body.into_data_stream(), field, limit, received: 0, began: Instant::now(), timeouts })
    }

    /// The next piece; `None` at the end.
    pub(crate) async fn next(&mut self) -> Result<Option<Bytes>, ApiError> {
        // The least rate as a deadline: the time at which the mean rate falls below it without another byte.
        let earned = Duration::from_secs_f64(self.received as f64 / self.timeouts.body_bytes_per_sec.max(1) as f64);
        let floor = self.began + self.timeouts.body_grace + earned;
        let deadline = floor.min(Instant::now() + self.timeouts.body_stall);
        let piece = tokio::time::timeout_at(deadline, self.stream.next()).await.map_err(|_| {
            let rate = self.timeouts.body_bytes_per_sec;
            let detail = format!("{}: arrives too slowly; at least {rate} bytes a second are expected", self.field);
            ApiError::new(StatusCode::REQUEST_TIMEOUT, "body_too_slow", detail)
        })?;
        let Some(piece) = piece else { return Ok(None) };
        let piece = piece.map_err(|_| ApiError::bad_request(format!("{}: the connection broke", self.field)))?;
        self.received += piece.len() as u64;
        if self.received > self.limit {
            return Err(too_large(self.field, self.limit));
        }
        Ok(Some(piece))
    }

    /// The whole body in memory; for small limits.
    pub(crate) async fn all(mut self) -> Result<Vec<u8>, ApiError> {
        let mut whole = Vec::new();
        while let Some(piece) = self.next().await? {
            whole.extend_from_slice(&piece);
        }
        Ok(whole)
    }
}

/// 413.
pub(crate) fn too_large(field: &str, limit: u64) -> ApiError {
    let detail = format!("{field}: larger than the limit of {limit} bytes");
    ApiError::new(StatusCode::PAYLOAD_TOO_LARGE, "body_too_large", detail)
}

/// The media type of a request without its parameters, lower case.
pub(crate) fn media_type(headers: &HeaderMap) -> Option<String> {
    let value = headers.get(header::CONTENT_TYPE)?.to_str().ok()?;
    Some(value.split(';').next()?.trim().to_ascii_lowercase())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reader(body: Body, limit: u64) -> BodyReader {
        BodyReader::new(body, &HeaderMap::new(), "body", limit, Timeouts::default()).expect("no length stated")
    }

    #[tokio::test(start_paused = true)]
    async fn caps_count_what_arrives() {
        assert_eq!(reader(Body::from("12345"), 5).all().await.expect("fits"), b"12345");
        let error = reader(Body::from("123456"), 5).all().await.expect_err("too large");
        assert_eq!(error.status(), StatusCode::PAYLOAD_TOO_LARGE);
        assert!(error.detail().contains('5'));
        let mut headers = HeaderMap::new();
        headers.insert(header::CONTENT_LENGTH, 6.into());
        assert!(BodyReader::new(Body::empty(), &headers, "body", 5, Timeouts::default()).is_err());
    }

    #[tokio::test(start_paused = true)]
    async fn a_body_that_drips_is_cut_off() {
        // One byte every 5 s never stalls for 10 s, but is far under the floor.
        let drip = futures_util::stream::unfold((), |()| async {
            tokio::time::sleep(Duration::from_secs(5)).await;
            Some((Ok::<_, std::io::Error>(Bytes::from_static(b"x")), ()))
        });
        let began = Instant::now();
        let error = reader(Body::from_stream(drip), 1 << 20).all().await.expect_err("too slow");
        assert_eq!(error.status(), StatusCode::REQUEST_TIMEOUT);
        assert!(began.elapsed() < Duration::from_secs(20), "{:?}", began.elapsed());
        let silent = futures_util::stream::pending::<Result<Bytes, std::io::Error>>();
        let error = reader(Body::from_stream(silent), 1 << 20).all().await.expect_err("stalled");
        assert_eq!(error.code(), "body_too_slow");
    }
}
