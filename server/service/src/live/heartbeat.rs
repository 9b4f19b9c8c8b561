//! Pings of the application: a client that is silent for too long is gone.

use std::time::Duration;

use crate::live::close::CloseReason;

/// Pings without any message in return that end a connection.
const MISSED_PINGS: u32 = 2;

/// When to ping. All times since the connection began.
#[derive(Clone, Debug)]
pub(crate) struct Heartbeat {
    interval: Duration,
    next_at: Duration,
    missed: u32,
}

impl Heartbeat {
    pub(crate) fn new(interval: Duration) -> Self {
        Self { interval, next_at: interval, missed: 0 }
    }

    /// The client sent a message of any kind.
    pub(crate) fn on_message(&mut self) {
        self.missed = 0;
    }

    /// Whether a ping is due now. Fails when the earlier ones met silence.
    pub(crate) fn on_tick(&mut self, now: Duration) -> Result<bool, CloseReason> {
        if now < self.next_at {
            return Ok(false);
        }
        if self.missed >= MISSED_PINGS {
            return Err(CloseReason::PingTimeout);
        }
        self.missed += 1;
        self.next_at = now + self.interval;
        Ok(true)
    }

    /// When the next ping is due.
    pub(crate) fn deadline(&self) -> Duration {
        self.next_at
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INTERVAL: Duration = Duration::from_secs(10);

    #[test]
    fn silence_for_three_intervals_ends_the_connection() {
        let mut heartbeat = Heartbeat::new(INTERVAL);
        assert!(matches!(heartbeat.on_tick(INTERVAL / 2), Ok(false)));
        assert!(matches!(heartbeat.on_tick(INTERVAL), Ok(true)));
        assert!(matches!(heartbeat.on_tick(INTERVAL), Ok(false)), "once an interval");
        assert!(matches!(heartbeat.on_tick(INTERVAL * 2), Ok(true)));
        assert!(matches!(heartbeat.on_tick(INTERVAL * 3), Err(CloseReason::PingTimeout)));
    }

    #[test]
    fn any_message_counts_as_a_sign_of_life() {
        let mut heartbeat = Heartbeat::new(INTERVAL);
        for beat in 1..20 {
            assert!(matches!(heartbeat.on_tick(INTERVAL * beat), Ok(true)));
            heartbeat.on_message();
        }
        assert_eq!(heartbeat.deadline(), INTERVAL * 20);
    }
}
