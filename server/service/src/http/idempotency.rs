//! `Idempotency-Key`: a request sent twice does its work once.
//!
//! 409 while the first is being answered, 422 when the same key comes with another body, else the first answer again.

use std::collections::{HashMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use axum::http::{HeaderMap, StatusCode};
use parking_lot::Mutex;
use tokio::time::Instant;

use crate::http::problem::ApiError;

const HEADER: &str = "idempotency-key";
const MAX_KEY: usize = 128;

#[derive(Clone, Debug)]
struct Record {
    body_hash: String,
    made_at: Instant,
    is_in_flight: bool,
    job: Option<String>,
}

#[derive(Debug, Default)]
struct Records {
    by_key: HashMap<String, Record>,
    order: VecDeque<String>,
}

/// Keys seen, bounded in number and time. Cheap to clone.
#[derive(Clone, Debug)]
pub(crate) struct IdempotencyKeys {
    records: Arc<Mutex<Records>>,
    capacity: usize,
    lifetime: Duration,
}

/// What to do with a request that carries a key.
#[derive(Debug)]
pub(crate) enum Begin {
    /// Do the work; report the job to the guard.
    First(InFlight),
    /// The work was done before, as this job.
    Repeat(String),
}

/// The first request of a key, until it is answered. Dropped without a job (an error, a client that left) the key is
/// free again.
#[derive(Debug)]
pub(crate) struct InFlight {
    keys: IdempotencyKeys,
    key: String,
    job: Option<String>,
}

impl IdempotencyKeys {
    pub(crate) fn new(capacity: usize, lifetime: Duration) -> Self {
        Self { records: Arc::default(), capacity: capacity.max(1), lifetime }
    }

    /// Looks the request's key up; `None` where it carries none.
    pub(crate) fn begin(&self, headers: &HeaderMap, body_hash: &str) -> Result<Option<Begin>, ApiError> {
        let Some(value) = headers.get(HEADER) else { return Ok(None) };
        let key = value.to_str().ok().filter(|key| !key.is_empty() && key.len() <= MAX_KEY).ok_or_else(|| {
            ApiError::bad_request(format!("Idempotency-Key: must be 1 to {MAX_KEY} visible ASCII characters"))
        })?;
        let mut records = self.records.lock();
        if let Some(record) = records.by_key.get(key)
            && record.made_at.elapsed() < self.lifetime
        {
            if record.body_hash != body_hash {
                let detail = "Idempotency-Key: was used with another body; take a new key for a new request";
                return Err(ApiError::new(StatusCode::UNPROCESSABLE_ENTITY, "idempotency_mismatch", detail));
            }
            if record.is_in_flight {
                let detail = "Idempotency-Key: the first request with this key is still being answered; retry later";
                return Err(ApiError::new(StatusCode::CONFLICT, "idempotency_in_flight", detail).retry_after(1));
            }
            if let Some(job) = &record.job {
                return Ok(Some(Begin::Repeat(job.clone())));
            }
        }
        while records.order.len() >= self.capacity {
            if let Some(oldest) = records.order.pop_front() {
                records.by_key.remove(&oldest);
            }
        }
        let record = Record { body_hash: body_hash.into(), made_at: Instant::now(), is_in_flight: true, job: None };
        if records.by_key.insert(key.to_owned(), record).is_none() {
            records.order.push_back(key.to_owned());
        }
        Ok(Some(Begin::First(InFlight { keys: self.clone(), key: key.to_owned(), job: None })))
    }
}

impl InFlight {
    /// The work is done by this job, whatever becomes of the answer.
    pub(crate) fn made(&mut self, job: &str) {
        self.job = Some(job.to_owned());
    }
}

impl Drop for InFlight {
    fn drop(&mut self) {
        let mut records = self.keys.records.lock();
        match (self.job.take(), records.by_key.get_mut(&self.key)) {
            (Some(job), Some(record)) => {
                record.job = Some(job);
                record.is_in_flight = false;
            }
            (None, _) => {
                records.by_key.remove(&self.key);
                records.order.retain(|key| *key != self.key);
            }
            (Some(_), None) => {}
        }
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
        let keys = IdempotencyKeys::new(8, Duration::from_mins(1));
        assert!(keys.begin(&HeaderMap::new(), "h").expect("no key").is_none());
        let Ok(Some(Begin::First(mut first))) = keys.begin(&headers("k"), "h") else { panic!("first") };
        assert_eq!(keys.begin(&headers("k"), "h").expect_err("in flight").status(), StatusCode::CONFLICT);
        first.made("job");
        drop(first);
        assert!(matches!(keys.begin(&headers("k"), "h"), Ok(Some(Begin::Repeat(job))) if job == "job"));
        assert_eq!(keys.begin(&headers("k"), "other").expect_err("body").status(), StatusCode::UNPROCESSABLE_ENTITY);
        tokio::time::advance(Duration::from_secs(61)).await;
        assert!(matches!(keys.begin(&headers("k"), "other"), Ok(Some(Begin::First(_)))), "forgotten");
        assert_eq!(keys.begin(&headers(&"x".repeat(129)), "h").expect_err("long").status(), StatusCode::BAD_REQUEST);
    }

    #[tokio::test(start_paused = true)]
    async fn failures_free_the_key_and_memory_is_bounded() {
        let keys = IdempotencyKeys::new(4, Duration::from_mins(1));
        drop(keys.begin(&headers("k"), "h").expect("first"));
        assert!(matches!(keys.begin(&headers("k"), "h"), Ok(Some(Begin::First(_)))));
        for i in 0..50 {
            if let Ok(Some(Begin::First(mut first))) = keys.begin(&headers(&format!("k{i}")), "h") {
                first.made("job");
            }
        }
        let records = keys.records.lock();
        assert!(records.by_key.len() <= 4 && records.order.len() <= 4);
    }
}
