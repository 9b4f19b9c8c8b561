//! Quality loop: lowers quality, resolution and rate of frames while the link delays them, and raises them again.

use std::time::Duration;

/// Delay above which a frame counts as late.
const LATE: Duration = Duration::from_millis(60);
/// Delay below which a frame counts as early.
const EARLY: Duration = Duration::from_millis(15);
/// Late frames in a row before a step down.
const LATE_FRAMES: u32 = 3;
/// Early frames in a row before a step up.
const EARLY_FRAMES: u32 = 20;
/// JPEG quality of one step.
const QUALITY_STEP: u8 = 8;
/// JPEG quality below which edges of geometry suffer more than from a lower resolution.
const EDGE_QUALITY: u8 = 40;
/// Factor of a step in resolution or frame rate.
const FACTOR: f32 = 0.75;
/// Steps in resolution (down to 0.32) and in frame rate.
const FACTOR_STEPS: i32 = 4;

/// Limits that a client sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QualityLimits {
    /// Lowest JPEG quality, 1 to 100.
    pub min_quality: u8,
    /// Highest JPEG quality, 1 to 100.
    pub max_quality: u8,
    /// Frame rate aimed at, at least 1.
    pub frames_per_sec: u16,
}

impl Default for QualityLimits {
    fn default() -> Self {
        Self { min_quality: 30, max_quality: 80, frames_per_sec: 30 }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Rung {
    quality: u8,
    scale: f32,
    frames_per_sec: f32,
}

/// A ladder from the client's limits down to the least useful frame: first lower JPEG quality, then lower resolution,
/// then quality below `EDGE_QUALITY` where the client allows it, then a lower frame rate.
#[derive(Clone, Debug)]
pub struct QualityLoop {
    ladder: Vec<Rung>,
    level: usize,
    late_count: u32,
    early_count: u32,
}

impl QualityLoop {
    /// Starts at the client's limits.
    pub fn new(limits: QualityLimits) -> Self {
        Self { ladder: ladder(limits), level: 0, late_count: 0, early_count: 0 }
    }

    /// Sets new limits; the level below them is kept.
    pub fn set_limits(&mut self, limits: QualityLimits) {
        self.ladder = ladder(limits);
        self.level = self.level.min(self.ladder.len() - 1);
    }

    /// A frame was acknowledged `queue_delay` after the smallest round trip.
    pub fn on_ack(&mut self, queue_delay: Duration) {
        self.late_count = if queue_delay > LATE { self.late_count + 1 } else { 0 };
        self.early_count = if queue_delay < EARLY { self.early_count + 1 } else { 0 };
        if self.late_count >= LATE_FRAMES {
            self.late_count = 0;
            self.level = (self.level + 1).min(self.ladder.len() - 1);
        } else if self.early_count >= EARLY_FRAMES {
            self.early_count = 0;
            self.level = self.level.saturating_sub(1);
        }
    }

    /// JPEG quality, 1 to 100.
    pub fn quality(&self) -> u8 {
        self.rung().quality
    }

    /// Resolution factor, in (0, 1].
    pub fn scale(&self) -> f32 {
        self.rung().scale
    }

    /// Frames per second, above 0.
    pub fn frames_per_sec(&self) -> f32 {
        self.rung().frames_per_sec
    }

    /// Whether it is below the client's limits.
    pub fn is_reduced(&self) -> bool {
        self.level > 0
    }

    fn rung(&self) -> Rung {
        self.ladder[self.level]
    }
}

/// At least one rung.
fn ladder(limits: QualityLimits) -> Vec<Rung> {
    let top_quality = limits.max_quality.clamp(1, 100);
    let floor = limits.min_quality.clamp(1, top_quality);
    let edge = floor.max(EDGE_QUALITY).min(top_quality);
    let mut rung = Rung { quality: top_quality, scale: 1.0, frames_per_sec: f32::from(limits.frames_per_sec.max(1)) };
    let mut rungs = vec![rung];
    while rung.quality > edge {
        rung.quality = rung.quality.saturating_sub(QUALITY_STEP).max(edge);
        rungs.push(rung);
    }
    for step in 1..=FACTOR_STEPS {
        rung.scale = FACTOR.powi(step);
        rungs.push(rung);
    }
    while rung.quality > floor {
        rung.quality = rung.quality.saturating_sub(QUALITY_STEP).max(floor);
        rungs.push(rung);
    }
    for _ in 0..FACTOR_STEPS {
        rung.frames_per_sec = (rung.frames_per_sec * FACTOR).max(1.0);
        rungs.push(rung);
    }
    rungs
}

#[cfg(test)]
mod tests {
    use super::*;

    const SLOW: Duration = Duration::from_millis(61);
    const FAST: Duration = Duration::from_millis(14);
    const BETWEEN: Duration = Duration::from_millis(30);

    #[test]
    fn three_late_frames_lower_quality_by_eight() {
        let mut state = QualityLoop::new(QualityLimits::default());
        assert_eq!((state.quality(), state.is_reduced()), (80, false));
        for delay in [SLOW, SLOW, BETWEEN, SLOW, SLOW] {
            state.on_ack(delay);
        }
        assert_eq!(state.quality(), 80, "not in a row");
        state.on_ack(SLOW);
        assert_eq!(state.quality(), 72);
        assert!(state.is_reduced());
    }

    #[test]
    fn then_resolution_then_frame_rate_and_back() {
        let limits = QualityLimits { min_quality: 30, max_quality: 50, frames_per_sec: 40 };
        let mut state = QualityLoop::new(limits);
        let mut seen = Vec::new();
        for _ in 0..100 {
            for _ in 0..3 {
                state.on_ack(SLOW);
            }
            let rung = (state.quality(), state.scale(), state.frames_per_sec());
            if seen.last() != Some(&rung) {
                seen.push(rung);
            }
        }
        assert_eq!(seen[0], (42, 1.0, 40.0));
        assert_eq!(seen[1], (40, 1.0, 40.0));
        assert_eq!(seen[2], (40, 0.75, 40.0));
        assert_eq!(seen[6], (32, 0.316_406_25, 40.0));
        assert_eq!(seen[8], (30, 0.316_406_25, 30.0));
        assert_eq!(seen.len(), 12, "a floor is reached: {seen:?}");
        for _ in 0..20 * 13 {
            state.on_ack(FAST);
        }
        assert_eq!((state.quality(), state.scale(), state.frames_per_sec()), (50, 1.0, 40.0));
    }

    #[test]
    fn odd_limits_make_a_usable_ladder() {
        for (min_quality, max_quality, frames_per_sec) in [(0, 0, 0), (100, 1, 1), (255, 255, u16::MAX)] {
            let mut state = QualityLoop::new(QualityLimits { min_quality, max_quality, frames_per_sec });
            for _ in 0..300 {
                state.on_ack(SLOW);
                assert!((1..=100).contains(&state.quality()));
                assert!(state.scale() > 0.3 && state.frames_per_sec() >= 1.0);
            }
            state.set_limits(QualityLimits { min_quality: 90, max_quality: 90, frames_per_sec: 1 });
            assert_eq!(state.quality(), 90);
        }
    }
}
