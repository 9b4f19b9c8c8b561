//! The inputs of a client: which camera a frame shows, and when its input arrived.

use std::collections::VecDeque;
use std::time::Duration;

use surfelcast_renderer::scene::Camera;

use crate::live::recent::push_bounded;

/// Inputs that are kept; more than a second's worth.
const CAPACITY: usize = 256;

#[derive(Clone, Copy, Debug)]
struct Input {
    seq: u32,
    at: Duration,
    camera: Camera,
}

/// The newest inputs by their numbers, which rise and wrap.
#[derive(Debug, Default)]
pub(crate) struct InputLog {
    inputs: VecDeque<Input>,
}

impl InputLog {
    /// Number of the newest input, 0 before the first.
    pub(crate) fn last_seq(&self) -> u32 {
        self.inputs.back().map_or(0, |input| input.seq)
    }

    /// Whether an input of this number would be newer than the last.
    pub(crate) fn accepts(&self, seq: u32) -> bool {
        self.inputs.back().is_none_or(|last| is_after(seq, last.seq))
    }

    /// Records an input and the camera in force after it. Callers check [`InputLog::accepts`].
    pub(crate) fn record(&mut self, seq: u32, at: Duration, camera: Camera) {
        push_bounded(&mut self.inputs, Input { seq, at, camera }, CAPACITY);
    }

    /// The camera in force after this input; `None` where that is no longer known.
    pub(crate) fn camera_of(&self, seq: u32) -> Option<Camera> {
        self.newest_up_to(seq).map(|input| input.camera)
    }

    /// When this input arrived.
    pub(crate) fn arrived_at(&self, seq: u32) -> Option<Duration> {
        self.newest_up_to(seq).filter(|input| input.seq == seq).map(|input| input.at)
    }

    fn newest_up_to(&self, seq: u32) -> Option<&Input> {
        self.inputs.iter().rev().find(|input| !is_after(input.seq, seq))
    }
}

/// Serial-number arithmetic: numbers wrap.
fn is_after(a: u32, b: u32) -> bool {
    let ahead = a.wrapping_sub(b);
    ahead != 0 && ahead < 1 << 31
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::view_settings::ViewSettings;

    #[test]
    fn serial_numbers_wrap() {
        assert!(is_after(1, 0) && is_after(0, u32::MAX) && is_after(5, u32::MAX - 5));
        assert!(!is_after(0, 0) && !is_after(0, 1) && !is_after(u32::MAX, 0));
    }

    #[test]
    fn frames_find_their_camera() {
        let mut log = InputLog::default();
        let base = ViewSettings::default().camera;
        let at = |x: f64| Camera { position: glam::DVec3::new(x, 0.0, 1.0), ..base };
        assert_eq!((log.camera_of(1), log.last_seq()), (None, 0));
        for seq in [1, 3, 4] {
            assert!(log.accepts(seq));
            log.record(seq, Duration::from_millis(u64::from(seq)), at(f64::from(seq)));
        }
        assert!(!log.accepts(4) && !log.accepts(2));
        assert_eq!(log.camera_of(2).map(|c| c.position.x), Some(1.0));
        assert_eq!(log.camera_of(9).map(|c| c.position.x), Some(4.0));
        assert_eq!((log.arrived_at(3), log.arrived_at(2)), (Some(Duration::from_millis(3)), None));
        for seq in 5..5000 {
            log.record(seq, Duration::ZERO, base);
        }
        assert_eq!((log.inputs.len(), log.last_seq()), (CAPACITY, 4999));
        assert_eq!(log.camera_of(3), None, "too old");
    }
}
