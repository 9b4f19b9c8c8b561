//! `Idempotency-Key`s and the renders that their first requests made.

use std::num::NonZeroUsize;
use std::time::{Duration, Instant};

use lru::LruCache;

/// What is known of a key.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum KeyState {
    /// The key is new and is now recorded as in flight.
    New,
    /// The first request with this key is still in flight.
    InFlight,
    /// The key belongs to a request with another body.
    OtherBody,
    /// The first request made this render.
    Done(String),
}

#[derive(Debug)]
struct Record {
    body_hash: String,
    made_at: Instant,
    /// The render that was made; `None` while the request is in flight.
    render: Option<String>,
}

/// Keys seen, bounded in number and time; the oldest key goes first.
#[derive(Debug)]
pub struct IdempotencyKeys {
    records: LruCache<String, Record>,
    lifetime: Duration,
}

impl IdempotencyKeys {
    /// Remembers at most `capacity` keys, each for `lifetime`.
    pub fn new(capacity: usize, lifetime: Duration) -> Self {
        let capacity = NonZeroUsize::new(capacity).unwrap_or(NonZeroUsize::MIN);
        Self { records: LruCache::new(capacity), lifetime }
    }

    /// Looks a key up and records it if it is new.
    pub fn begin(&mut self, key: &str, body_hash: &str, now: Instant) -> KeyState {
        // `peek` does not count as use, so the cache evicts by age.
        let known = self.records.peek(key).filter(|record| now.duration_since(record.made_at) < self.lifetime);
        match known {
            Some(record) if record.body_hash != body_hash => KeyState::OtherBody,
            Some(Record { render: Some(render), .. }) => KeyState::Done(render.clone()),
            Some(_) => KeyState::InFlight,
            None => {
                let record = Record { body_hash: body_hash.to_owned(), made_at: now, render: None };
                self.records.push(key.to_owned(), record);
                KeyState::New
            }
        }
    }

    /// Ends the first request of a key: with the render that it made, or without one, which frees the key.
    pub fn end(&mut self, key: &str, render: Option<String>) {
        match render {
            None => drop(self.records.pop(key)),
            Some(render) => {
                if let Some(record) = self.records.peek_mut(key) {
                    record.render = Some(render);
                }
            }
        }
    }

    /// Keys remembered.
    pub fn len(&self) -> usize {
        self.records.len()
    }

    /// Whether no key is remembered.
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_new_in_flight_done_and_forgotten() {
        let mut keys = IdempotencyKeys::new(8, Duration::from_mins(1));
        let now = Instant::now();
        assert_eq!(keys.begin("k", "h", now), KeyState::New);
        assert_eq!(keys.begin("k", "h", now), KeyState::InFlight);
        assert_eq!(keys.begin("k", "other", now), KeyState::OtherBody);
        keys.end("k", Some("render".into()));
        assert_eq!(keys.begin("k", "h", now), KeyState::Done("render".into()));
        assert_eq!(keys.begin("k", "other", now), KeyState::OtherBody);
        assert_eq!(keys.begin("k", "other", now + Duration::from_secs(61)), KeyState::New, "forgotten");
    }

    #[test]
    fn failures_free_the_key_and_memory_is_bounded() {
        let mut keys = IdempotencyKeys::new(4, Duration::from_mins(1));
        let now = Instant::now();
        keys.begin("k", "h", now);
        keys.end("k", None);
        assert!(keys.is_empty());
        for i in 0..50 {
            let key = format!("k{i}");
            assert_eq!(keys.begin(&key, "h", now), KeyState::New);
            keys.end(&key, Some("render".into()));
            // Looking a key up does not keep it.
            keys.begin("k0", "h", now);
        }
        assert_eq!(keys.len(), 4);
        assert_eq!(keys.begin("k49", "h", now), KeyState::Done("render".into()));
    }
}
