//! Which images of a refining view are sent.

use std::time::Duration;

/// Samples must grow by this factor between two stills: error falls by half.
const GROWTH: u32 = 4;
/// After this long without an image a smaller growth suffices, so that slow scenes show progress.
const PATIENCE: Duration = Duration::from_secs(2);
/// The smaller growth, as a ratio: 5/4.
const PATIENT_GROWTH: (u64, u64) = (5, 4);
/// Least quiet time after the last input before a view counts as still.
const MIN_QUIET: Duration = Duration::from_millis(150);
/// The same in frame periods: at low frame rates a gesture has long pauses between inputs.
const QUIET_FRAMES: u32 = 5;

/// Sends stills at about 1, 4, 16, 64 ... samples a pixel, and each final one.
#[derive(Clone, Copy, Debug, Default)]
pub struct StillSchedule {
    last: Option<(u32, Duration)>,
}

impl StillSchedule {
    /// The image changed: the next still is due.
    pub fn restart(&mut self) {
        self.last = None;
    }

    /// Whether a still of `samples` per pixel should be sent at `now`.
    pub fn is_due(&self, samples: u32, is_final: bool, now: Duration) -> bool {
        let Some((sent, at)) = self.last else { return true };
        let grown = u64::from(samples) * PATIENT_GROWTH.1 >= u64::from(sent) * PATIENT_GROWTH.0;
        is_final || samples >= sent.saturating_mul(GROWTH) || (now.saturating_sub(at) >= PATIENCE && grown)
    }

    /// A still of `samples` per pixel was sent.
    pub fn sent(&mut self, samples: u32, now: Duration) {
        self.last = Some((samples, now));
    }

    /// How long a view must be without input to count as still, at a frame rate.
    pub fn quiet_time(frames_per_sec: f32) -> Duration {
        let period = Duration::try_from_secs_f32(1.0 / frames_per_sec.max(1.0)).unwrap_or(MIN_QUIET);
        MIN_QUIET.max(period * QUIET_FRAMES)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_geometric_series_and_the_end() {
        let mut schedule = StillSchedule::default();
        let mut sent = Vec::new();
        for samples in 1..=300 {
            let now = Duration::from_millis(u64::from(samples));
            if schedule.is_due(samples, samples == 300, now) {
                schedule.sent(samples, now);
                sent.push(samples);
            }
        }
        assert_eq!(sent, [1, 4, 16, 64, 256, 300]);
    }

    #[test]
    fn slow_scenes_go_on_and_a_change_restarts() {
        let mut schedule = StillSchedule::default();
        schedule.sent(100, Duration::ZERO);
        assert!(!schedule.is_due(130, false, Duration::from_millis(1900)));
        assert!(schedule.is_due(130, false, Duration::from_secs(2)));
        assert!(!schedule.is_due(110, false, Duration::from_secs(9)));
        schedule.restart();
        assert!(schedule.is_due(1, false, Duration::ZERO));
    }

    #[test]
    fn quiet_time_follows_the_frame_rate() {
        assert_eq!(StillSchedule::quiet_time(60.0), Duration::from_millis(150));
        assert_eq!(StillSchedule::quiet_time(10.0).as_millis(), 500);
        assert_eq!(StillSchedule::quiet_time(f32::NAN), Duration::from_secs(5));
    }
}
