//! How fast the device traces paths: an estimate from measured steps, from which the length of the next one follows.

use std::time::Duration;

/// Paths per second before anything was measured: those of a slow CPU device, so that the first submission is short.
const FIRST_PATHS_PER_SEC: f64 = 1e5;
/// Weight of the newest measurement.
const SMOOTHING: f64 = 0.3;
/// Device time of one submission: how long others wait for it at most.
const STEP_SECS: f64 = 0.08;
/// Paths in a submission at least: with fewer, submitting costs more than tracing.
const MIN_PATHS: u64 = 4096;

/// Estimated throughput of one technique on one scene.
#[derive(Clone, Copy, Debug)]
pub struct Throughput {
    paths_per_sec: f64,
}

impl Default for Throughput {
    fn default() -> Self {
        Self { paths_per_sec: FIRST_PATHS_PER_SEC }
    }
}

impl Throughput {
    /// Blends in a measured step. The estimate never falls below half of the newest rate, so that it rises quickly from
    /// its first value.
    pub fn measure(&mut self, paths: u64, elapsed: Duration) {
        if paths == 0 {
            return;
        }
        let rate = paths as f64 / elapsed.as_secs_f64().max(1e-5);
        self.paths_per_sec += (rate - self.paths_per_sec) * SMOOTHING;
        self.paths_per_sec = self.paths_per_sec.max(rate * 0.5);
    }

    /// Paths of one submission.
    pub fn step_paths(self) -> u64 {
        ((self.paths_per_sec * STEP_SECS) as u64).max(MIN_PATHS)
    }

    /// Paths in `secs` seconds.
    pub fn paths_in(self, secs: f32) -> u64 {
        (self.paths_per_sec * f64::from(secs.max(0.0))) as u64
    }

    /// Resolution factor at which one sample a pixel takes `secs`, in steps of 1/8 and at most `max_scale`.
    pub fn scale_for(self, size: [u32; 2], secs: f32, max_scale: f32) -> f32 {
        let pixels = f64::from(size[0]) * f64::from(size[1]);
        let affordable = self.paths_per_sec * f64::from(secs);
        let scale = (affordable / pixels.max(1.0)).sqrt().min(f64::from(max_scale));
        ((scale * 8.0).floor() / 8.0).clamp(0.125, 1.0) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn follows_the_device_and_bounds_a_step() {
        let mut throughput = Throughput::default();
        for _ in 0..50 {
            throughput.measure(1_000_000, Duration::from_secs(1));
        }
        assert!((throughput.paths_per_sec - 1e6).abs() < 1e4);
        assert_eq!(throughput.step_paths(), (throughput.paths_per_sec * STEP_SECS) as u64);
        assert!(throughput.scale_for([1000, 1000], 0.26, 1.0) == 0.5);
        assert!(throughput.scale_for([1000, 1000], 100.0, 0.75) == 0.75);
        assert!(throughput.scale_for([100_000, 1000], 0.01, 1.0) == 0.125);
        throughput.measure(0, Duration::from_secs(1));
        assert!(throughput.paths_per_sec > 9e5);
    }
}
