//! Errors that no error scope caught: kept once each, with a count, and logged once each.

use parking_lot::Mutex;

/// Distinct messages kept: a failing driver may produce any number.
const CAPACITY: usize = 64;

/// A message and how often it occurred.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TrackedError {
    /// First text of the error.
    pub message: String,
    /// Times seen.
    pub count: u64,
}

/// De-duplicates errors by text.
#[derive(Debug, Default)]
pub(crate) struct ErrorTracker {
    errors: Mutex<Vec<TrackedError>>,
}

impl ErrorTracker {
    pub(crate) fn report(&self, message: &str) {
        let mut errors = self.errors.lock();
        if let Some(known) = errors.iter_mut().find(|known| known.message == message) {
            known.count += 1;
        } else if errors.len() < CAPACITY {
            tracing::error!(target: "surfelcast::gpu", "uncaptured GPU error: {message}");
            errors.push(TrackedError { message: message.to_owned(), count: 1 });
        }
    }

    pub(crate) fn errors(&self) -> Vec<TrackedError> {
        self.errors.lock().clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_counted_and_bounded() {
        let tracker = ErrorTracker::default();
        tracker.report("a");
        tracker.report("a");
        assert_eq!(tracker.errors(), [TrackedError { message: "a".to_owned(), count: 2 }]);
        for index in 0..1000 {
            tracker.report(&index.to_string());
        }
        assert_eq!(tracker.errors().len(), CAPACITY);
    }
}
