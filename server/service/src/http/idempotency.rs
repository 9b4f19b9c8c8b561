//! `Idempotency-Key`: a request that is sent twice does its work once.
//!
//! 409 while the first request is being answered, 422 when the same key comes with another body, otherwise the job of
//! the first request again.

use std::sync::Arc;
use std::time::Duration;

use axum::http::{HeaderMap, StatusCode};
use parking_lot::Mutex;
use surfelcast_store::{IdempotencyKeys, KeyState};
use tokio::time::Instant;

use crate::http::problem::ApiError;

const HEADER: &str = "idempotency-key";
const MAX_KEY: usize = 128;

/// Keys of requests, bounded in number and time. Cheap to clone.
#[derive(Clone, Debug)]
pub(crate) struct Idempotency(Arc<Mutex<IdempotencyKeys>>);

/// What to do with a request that carries a key.
#[derive(Debug)]
pub(crate) enum Begin {
    /// Do the work, then report its job by [`InFlight::made`].
    First(InFlight),
    /// The work was done before, as this job.
    Repeat(String),
}

/// The first request of a key, until it is answered. If it is dropped without a job (after an error, or when the client
/// disconnects), the key is free again.
#[derive(Debug)]
pub(crate) struct InFlight {
    keys: Idempotency,
    key: String,
    job: Option<String>,
}

impl Idempotency {
    pub(crate) fn new(capacity: usize, lifetime: Duration) -> Self {
        Self(Arc::new(Mutex::new(IdempotencyKeys::new(capacity, lifetime))))
    }

    /// Looks the request's key up; `None` where it carries none.
    pub(crate) fn begin(&self, headers: &HeaderMap, body_hash: &str) -> Result<Option<Begin>, ApiError> {
        let Some(value) = headers.get(HEADER) else { return Ok(None) };
        let key = value.to_str().ok().filter(|key| !key.is_empty() && key.len() <= MAX_KEY).ok_or_else(|| {
            ApiError::bad_request(format!("Idempotency-Key: must be 1 to {MAX_KEY} visible ASCII characters"))
        })?;
        let state = self.0.lock().begin(key, body_hash, Instant::now().into_std());
        match state {
            KeyState::New => Ok(Some(Begin::First(InFlight { keys: self.clone(), key: key.to_owned(), job: None }))),
            KeyState::Done(job) => Ok(Some(Begin::Repeat(job))),
            KeyState::OtherBody => {
                let detail = "Idempotency-Key: was used with another body; take a new key for a new request";
                Err(ApiError::new(StatusCode::UNPROCESSABLE_ENTITY, "idempotency_mismatch", detail))
            }
            KeyState::InFlight => {
                let detail = "Idempotency-Key: the first request with this key is still being answered; retry later";
                Err(ApiError::new(StatusCode::CONFLICT, "idempotency_in_flight", detail).retry_after(1))
            }
        }
    }
}

impl InFlight {
    /// The work is done by this job, whether or not the answer reaches the client.
    pub(crate) fn made(&mut self, job: &str) {
        self.job = Some(job.to_owned());
    }
}

impl Drop for InFlight {
    fn drop(&mut self) {
        self.keys.0.lock().end(&self.key, self.job.take());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(key: &str) -> HeaderMap {
        let mut headers = HeaderMap::new();
        headers.insert(HEADER, key.parse().expect("a value"));
        headers
    }

    #[tokio::test(start_paused = true)]
    async fn the_four_answers() {
        let keys = Idempotency::new(8, Duration::from_mins(1));
        assert!(keys.begin(&HeaderMap::new(), "h").expect("no key").is_none());
        let Ok(Some(Begin::First(mut first))) = keys.begin(&headers("k"), "h") else { panic!("first") };
        assert_eq!(keys.begin(&headers("k"), "h").expect_err("in flight").status(), StatusCode::CONFLICT);
        first.made("job");
        drop(first);
        assert!(matches!(keys.begin(&headers("k"), "h"), Ok(Some(Begin::Repeat(job))) if job == "job"));
        assert_eq!(keys.begin(&headers("k"), "other").expect_err("body").status(), StatusCode::UNPROCESSABLE_ENTITY);
        tokio::time::advance(Duration::from_secs(61)).await;
        let Ok(Some(Begin::First(again))) = keys.begin(&headers("k"), "other") else { panic!("forgotten") };
        drop(again);
        assert!(matches!(keys.begin(&headers("k"), "h"), Ok(Some(Begin::First(_)))), "failures free the key");
        assert_eq!(keys.begin(&headers(&"x".repeat(129)), "h").expect_err("long").status(), StatusCode::BAD_REQUEST);
    }
}
