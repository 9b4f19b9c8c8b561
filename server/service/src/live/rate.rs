//! Token bucket.

use std::time::Duration;

/// Allows a mean rate and bursts of one second's worth.
#[derive(Clone, Debug)]
pub(crate) struct TokenBucket {
    per_sec: f64,
    tokens: f64,
    filled_at: Duration,
}

impl TokenBucket {
    pub(crate) fn new(per_sec: u32) -> Self {
        Self { per_sec: f64::from(per_sec), tokens: f64::from(per_sec), filled_at: Duration::ZERO }
    }

    /// Takes a token, if there is one. `now` since any fixed instant.
    pub(crate) fn take(&mut self, now: Duration) -> bool {
        let gained = now.saturating_sub(self.filled_at).as_secs_f64() * self.per_sec;
        self.filled_at = self.filled_at.max(now);
        self.tokens = (self.tokens + gained).min(self.per_sec);
        let has_token = self.tokens >= 1.0;
        if has_token {
            self.tokens -= 1.0;
        }
        has_token
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_burst_then_the_rate() {
        let mut bucket = TokenBucket::new(240);
        let taken = |bucket: &mut TokenBucket, ms| (0..1000).filter(|_| bucket.take(Duration::from_millis(ms))).count();
        assert_eq!(taken(&mut bucket, 0), 240);
        assert_eq!(taken(&mut bucket, 0), 0);
        assert_eq!(taken(&mut bucket, 500), 120);
        assert_eq!(taken(&mut bucket, 60_000), 240, "no more than a second's worth is saved up");
        assert_eq!(taken(&mut bucket, 10), 0, "a clock that goes back gives nothing");
    }
}
