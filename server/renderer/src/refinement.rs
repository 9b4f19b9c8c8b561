//! What a view renders next: coarse frames while its camera moves, sharper and less noisy ones once it rests, nothing
//! when it has converged.
//!
//! No device in it: clock, throughput, samples and audited errors are handed in, decisions come out, and
//! `running_view.rs` carries them out.

use std::time::{Duration, Instant};

use surfelcast_render_api::ErrorEstimate;

use crate::progressive::Until;
use crate::throughput::Throughput;
use crate::view::{FrameKind, ViewState};

/// A still is shown when its samples have grown by this factor since the last one shown ...
const SHOW_GROWTH: u32 = 4;
/// ... or after this long, so that a slow device does not look stuck.
const SHOW_INTERVAL: Duration = Duration::from_millis(1500);
/// Largest batch: a camera move waits for one batch at most.
const MAX_BATCH: u32 = 16;
/// Samples a pixel while moving, where the device has time for more than one.
const MAX_MOVING_SAMPLES: u32 = 8;
/// Smallest resolution factor.
const MIN_SCALE: f32 = 0.125;

/// What the current image is for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    /// A frame during a gesture.
    Moving { scale: f32 },
    /// At rest, but coarser than the screen: one sample a pixel, then twice the resolution.
    Sharpening { scale: f32 },
    /// At rest, full size: samples accumulate.
    Refining,
    /// Nothing to do until something changes.
    Converged,
}

/// An audit of the current image.
#[derive(Clone, Copy, Debug)]
struct Audited {
    samples: u32,
    /// What the error is probably below.
    bound: f64,
    error: ErrorEstimate,
}

/// The refinement of one view.
#[derive(Debug)]
pub(crate) struct Refinement {
    /// Newest settings of the view.
    newest: ViewState,
    /// Settings of the current image.
    current: ViewState,
    stage: Stage,
    /// The newest settings need another image than the current one.
    is_stale: bool,
    /// Something to show has not been sent yet.
    is_unsent: bool,
    /// Largest resolution factor that fits into memory, as far as known.
    size_limit: f32,
    audited: Option<Audited>,
    /// Samples a pixel of the current image when it was last sent.
    sent_samples: u32,
    sent_at: Instant,
}

impl Refinement {
    pub(crate) fn new(settings: ViewState, now: Instant) -> Self {
        Self {
            current: settings.clone(),
            newest: settings,
            stage: Stage::Converged,
            is_stale: true,
            is_unsent: false,
            size_limit: 1.0,
            audited: None,
            sent_samples: 0,
            sent_at: now,
        }
    }

    /// Takes new settings.
    pub(crate) fn update(&mut self, settings: ViewState) {
        let is_same_image = settings.camera == self.newest.camera
            && settings.size == self.newest.size
            && settings.technique == self.newest.technique
            && settings.settings == self.newest.settings;
        if !is_same_image {
            self.is_stale = true;
        } else if settings.is_moving != self.newest.is_moving && !settings.is_moving {
            // The gesture ended where it stood: sharpen, unless that is under way.
            self.is_stale |= matches!(self.stage, Stage::Moving { .. }) || self.stage == Stage::Converged;
        }
        if settings.size != self.newest.size {
            self.size_limit = 1.0;
        }
        if is_same_image
            && (settings.exposure != self.newest.exposure
                || settings.input_seq != self.newest.input_seq
                || settings.aov != self.newest.aov)
        {
            // The same radiance, shown again. The input number must reach the client even if nothing else changed.
            self.current.exposure = settings.exposure;
            self.current.aov.clone_from(&settings.aov);
            self.current.input_seq = settings.input_seq;
            self.is_unsent = true;
        }
        if is_same_image
            && self.stage == Stage::Converged
            && (settings.max_samples > self.current.max_samples || settings.max_error < self.current.max_error)
        {
            self.stage = Stage::Refining;
        }
        self.current.max_samples = settings.max_samples;
        self.current.max_error = settings.max_error;
        self.newest = settings;
    }

    /// The current image no longer holds: the lights changed, or the device is gone.
    pub(crate) fn discard(&mut self) {
        self.is_stale = true;
    }

    /// The current image does not fit into memory: try a smaller one, which the client scales up. Returns whether one
    /// is left to try.
    pub(crate) fn shrink(&mut self) -> bool {
        let is_possible = self.size_limit > MIN_SCALE;
        if is_possible {
            self.size_limit *= 0.5;
            self.is_stale = true;
        }
        is_possible
    }

    /// Settings of the current image.
    pub(crate) fn current(&self) -> &ViewState {
        &self.current
    }

    /// Whether the view is in a gesture.
    pub(crate) fn is_moving(&self) -> bool {
        self.newest.is_moving
    }

    /// Whether the current image is final.
    pub(crate) fn is_converged(&self) -> bool {
        self.stage == Stage::Converged
    }

    /// Whether nothing is left to render or show.
    pub(crate) fn is_idle(&self) -> bool {
        self.newest.is_paused || (!self.is_stale && !self.is_unsent && self.is_converged())
    }

    /// Whether a step would do something now. `samples` are those of the current image, if there is one, `is_wanted`
    /// tells whether a frame could be sent. A frame that cannot be sent yet is not begun while moving; a still refines
    /// meanwhile.
    pub(crate) fn wants_step(&self, samples: Option<u32>, is_wanted: bool, throughput: Throughput) -> bool {
        if self.newest.is_paused {
            return false;
        }
        if self.is_stale {
            return is_wanted || !self.newest.is_moving;
        }
        match self.stage {
            Stage::Moving { .. } | Stage::Sharpening { .. } => is_wanted || !self.is_whole(samples, throughput),
            Stage::Refining => true,
            Stage::Converged => self.is_unsent && is_wanted && samples.is_some(),
        }
    }

    /// Begins the image of the newest settings where the current one is stale. Returns whether it did.
    pub(crate) fn begin_if_stale(&mut self, has_image: bool, throughput: Throughput) -> bool {
        // A frame of a gesture that has begun is finished and shown even if a newer camera is known: a frame of a
        // moment ago is better than none. A still is given up at once.
        let is_busy_moving = matches!(self.stage, Stage::Moving { .. }) && has_image;
        if !self.is_stale || is_busy_moving {
            return false;
        }
        let coarse = throughput.scale_for(self.newest.size, self.newest.target_frame_secs, self.newest.max_scale);
        let was_sharp = self.stage == Stage::Refining || self.stage == Stage::Converged;
        self.stage = if self.newest.is_moving {
            Stage::Moving { scale: coarse }
        } else if coarse < 1.0 && (was_sharp || !has_image) {
            Stage::Sharpening { scale: coarse }
        } else if coarse < 0.5 {
            // The image that is given up was a coarse one: start sharper than the coarsest.
            Stage::Sharpening { scale: coarse * 2.0 }
        } else {
            Stage::Refining
        };
        self.current = self.newest.clone();
        self.is_stale = false;
        self.is_unsent = false;
        self.audited = None;
        self.sent_samples = 0;
        true
    }

    /// Size of the current image in pixels.
    pub(crate) fn render_size(&self) -> [u32; 2] {
        let scale = match self.stage {
            Stage::Moving { scale } | Stage::Sharpening { scale } => scale,
            Stage::Refining | Stage::Converged => 1.0,
        };
        let scale = scale.min(self.size_limit);
        self.current.size.map(|side| ((side as f32 * scale).round() as u32).max(1))
    }

    /// Samples a pixel that the current image gets in its stage.
    fn goal_samples(&self, throughput: Throughput) -> u32 {
        match self.stage {
            // Where a full-size frame leaves time, it is spent on samples.
            Stage::Moving { scale } if scale >= self.newest.max_scale.min(1.0) => {
                let pixels = u64::from(self.current.size[0]) * u64::from(self.current.size[1]);
                let affordable = throughput.paths_in(self.current.target_frame_secs) / pixels.max(1);
                (affordable as u32).clamp(1, MAX_MOVING_SAMPLES)
            }
            Stage::Moving { .. } | Stage::Sharpening { .. } => 1,
            Stage::Refining | Stage::Converged => self.current.max_samples.max(1),
        }
    }

    /// Whether the current image has all samples of its stage.
    fn is_whole(&self, samples: Option<u32>, throughput: Throughput) -> bool {
        samples.is_some_and(|samples| samples >= self.goal_samples(throughput))
    }

    /// How far to go before the image is shown or audited next; `None` where it has all samples of its stage.
    pub(crate) fn until(&self, samples: u32, next_audit: u32, throughput: Throughput) -> Option<Until> {
        if self.is_whole(Some(samples), throughput) {
            return None;
        }
        let mut until = self.goal_samples(throughput);
        if self.stage == Stage::Refining {
            let next_shown = self.sent_samples.max(samples).max(1) * SHOW_GROWTH;
            until = until.min(next_shown).min(next_audit.max(samples + 1));
            if samples == 0 {
                until = 1;
            }
        }
        Some(Until { samples: until, max_batch: MAX_BATCH })
    }

    /// Whether an audit is due on the way to the goal.
    pub(crate) fn is_audit_due(&self, samples: u32, next_audit: u32) -> bool {
        self.stage == Stage::Refining && samples > 0 && samples >= next_audit
    }

    /// Records an audit of the current image.
    pub(crate) fn audited(&mut self, samples: u32, bound: f64, error: ErrorEstimate) {
        self.audited = Some(Audited { samples, bound, error });
    }

    /// Error of the current image, as last audited.
    pub(crate) fn error(&self) -> Option<ErrorEstimate> {
        self.audited.map(|audited| audited.error)
    }

    /// Whether refinement ends with the current image: it has the samples, or an error below the goal.
    pub(crate) fn is_final(&self, samples: u32) -> bool {
        let goal = f64::from(self.current.max_error);
        let is_good = self.audited.is_some_and(|audited| audited.bound <= goal);
        self.stage == Stage::Refining && (is_good || samples >= self.current.max_samples.max(1))
    }

    /// Whether the final image still needs an audit: the error stated of it must not be that of half its samples.
    pub(crate) fn is_audit_outdated(&self, samples: u32) -> bool {
        self.audited.is_none_or(|audited| audited.samples < samples)
    }

    /// Refinement ends with the current image.
    pub(crate) fn converge(&mut self) {
        self.stage = Stage::Converged;
        self.is_unsent = true;
    }

    /// Whether to show the current image now.
    pub(crate) fn is_shown(&mut self, samples: u32, is_wanted: bool, now: Instant, throughput: Throughput) -> bool {
        let is_due = match self.stage {
            Stage::Moving { .. } | Stage::Sharpening { .. } => self.is_whole(Some(samples), throughput),
            Stage::Refining => {
                let is_new = samples > self.sent_samples;
                let has_grown = samples >= self.sent_samples.max(1) * SHOW_GROWTH || self.sent_samples == 0;
                self.is_unsent |= is_new && (has_grown || now.duration_since(self.sent_at) >= SHOW_INTERVAL);
                self.is_unsent && samples > 0
            }
            Stage::Converged => self.is_unsent,
        };
        is_due && is_wanted
    }

    /// Stage of refinement that a frame of the current image shows.
    pub(crate) fn frame_kind(&self) -> FrameKind {
        match self.stage {
            Stage::Moving { .. } | Stage::Sharpening { .. } => FrameKind::Moving,
            Stage::Refining => FrameKind::Still,
            Stage::Converged if self.newest.is_moving => FrameKind::Moving,
            Stage::Converged => FrameKind::Final,
        }
    }

    /// The current image was sent with these samples: the next stage begins where it had all of its own.
    pub(crate) fn sent(&mut self, samples: u32, now: Instant) {
        self.is_unsent = false;
        self.sent_samples = samples;
        self.sent_at = now;
        match self.stage {
            Stage::Sharpening { scale } if scale < 0.5 => self.stage = Stage::Sharpening { scale: scale * 2.0 },
            Stage::Sharpening { .. } => {
                self.stage = Stage::Refining;
                self.sent_samples = 0;
            }
            // The next camera, or the end of the gesture, begins another image.
            Stage::Moving { .. } => self.stage = Stage::Converged,
            Stage::Refining | Stage::Converged => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use surfelcast_scene::Camera;

    use surfelcast_render_api::Settings;

    use super::*;

    fn settings() -> ViewState {
        ViewState {
            camera: Camera { position: DVec3::ZERO, target: DVec3::X, up: DVec3::Y, vfov: 1.0 },
            size: [400, 300],
            exposure: 1.0,
            technique: "path".to_owned(),
            settings: Settings::default(),
            aov: None,
            is_moving: false,
            is_paused: false,
            max_scale: 1.0,
            target_frame_secs: 0.1,
            max_error: 1e-6,
            max_samples: 64,
            input_seq: 1,
        }
    }

    /// Settings of a gesture whose camera stands at `x`.
    fn moving(x: f64) -> ViewState {
        let mut moving = ViewState { is_moving: true, ..settings() };
        moving.camera.position.x = x;
        moving
    }

    /// A device that traces one sample of each pixel at full size in this many target frame times.
    fn device(frames: f64) -> Throughput {
        let mut throughput = Throughput::default();
        for _ in 0..100 {
            throughput.measure(400 * 300, Duration::from_secs_f64(0.1 * frames * 0.9999));
        }
        throughput
    }

    /// A view on a simulated device.
    struct Simulated {
        refinement: Refinement,
        throughput: Throughput,
        /// Samples and size of the image on the device.
        image: Option<(u32, [u32; 2])>,
        now: Instant,
        step: Duration,
        next_audit: u32,
        /// Bound that audits find.
        bound: f64,
        is_wanted: bool,
    }

    /// A frame that was shown: kind, width, samples, whether its error was stated.
    type Shown = (FrameKind, u32, u32, bool);

    impl Simulated {
        fn new(settings: ViewState, throughput: Throughput) -> Self {
            let now = Instant::now();
            Self {
                refinement: Refinement::new(settings, now),
                throughput,
                image: None,
                now,
                step: Duration::from_millis(10),
                next_audit: 16,
                bound: 1.0,
                is_wanted: true,
            }
        }

        fn samples(&self) -> Option<u32> {
            self.image.map(|(samples, _)| samples)
        }

        /// One step, as `running_view.rs` does it.
        fn step(&mut self) -> Option<Shown> {
            if !self.refinement.wants_step(self.samples(), self.is_wanted, self.throughput) {
                return None;
            }
            self.now += self.step;
            if self.refinement.begin_if_stale(self.image.is_some(), self.throughput)
                && let Some((samples, _)) = &mut self.image
            {
                *samples = 0;
                self.next_audit = 16;
            }
            if !self.refinement.is_converged() {
                let size = self.refinement.render_size();
                let (samples, _) = self.image.filter(|(_, made)| *made == size).unwrap_or((0, size));
                let until = self.refinement.until(samples, self.next_audit, self.throughput);
                let samples =
                    until.map_or(samples, |until| until.samples.min(samples + samples.max(1).min(until.max_batch)));
                self.image = Some((samples, size));
                let found = (samples, self.bound, ErrorEstimate::default());
                if self.refinement.is_audit_due(samples, self.next_audit) {
                    self.refinement.audited(found.0, found.1, found.2);
                    self.next_audit = samples * 2;
                }
                if self.refinement.is_final(samples) {
                    if self.refinement.is_audit_outdated(samples) {
                        self.refinement.audited(found.0, found.1, found.2);
                    }
                    self.refinement.converge();
                }
            }
            let (samples, [width, _]) = self.image?;
            if !self.refinement.is_shown(samples, self.is_wanted, self.now, self.throughput) {
                return None;
            }
            let shown = (self.refinement.frame_kind(), width, samples, self.refinement.error().is_some());
            self.refinement.sent(samples, self.now);
            Some(shown)
        }

        /// All frames until nothing is left to do.
        fn frames(&mut self) -> Vec<Shown> {
            let frames = (0..10_000).filter_map(|_| self.step()).collect();
            assert!(self.refinement.is_idle());
            frames
        }
    }

    use FrameKind::{Final, Moving, Still};

    #[test]
    fn a_still_is_shown_at_once_then_fourfold_and_at_last_with_its_error() {
        let mut view = Simulated::new(settings(), device(1.0));
        let frames = view.frames();
        assert_eq!(
            frames,
            [(Still, 400, 1, false), (Still, 400, 4, false), (Still, 400, 16, true), (Final, 400, 64, true)]
        );
        assert_eq!(view.step(), None, "a converged view costs nothing");
    }

    #[test]
    fn a_slow_still_is_shown_now_and_then() {
        let mut view = Simulated::new(ViewState { max_samples: 1000, ..settings() }, device(1.0));
        view.step = SHOW_INTERVAL;
        let stills: Vec<u32> = view.frames().iter().map(|(_, _, samples, _)| *samples).collect();
        assert!(stills.windows(2).all(|pair| pair[1] - pair[0] <= MAX_BATCH), "{stills:?}");
    }

    #[test]
    fn refinement_ends_at_the_error() {
        let mut view = Simulated::new(ViewState { max_error: 0.01, ..settings() }, device(1.0));
        view.bound = 0.009;
        assert_eq!(view.frames().last(), Some(&(Final, 400, 16, true)));
    }

    #[test]
    fn a_slow_device_sharpens_up_the_ladder_of_sizes() {
        let mut view = Simulated::new(ViewState { max_samples: 4, ..settings() }, device(40.0));
        let sizes: Vec<_> = view.frames().iter().map(|(kind, width, ..)| (*kind, *width)).collect();
        assert_eq!(sizes, [(Moving, 50), (Moving, 100), (Moving, 200), (Still, 400), (Final, 400)]);
    }

    #[test]
    fn a_gesture_is_rendered_at_the_size_that_the_device_can_keep_up_with() {
        let mut view = Simulated::new(moving(0.0), device(4.0));
        assert_eq!(view.step(), Some((Moving, 200, 1, false)));
        assert_eq!(view.step(), None, "one frame for each camera");
        view.refinement.update(moving(1.0));
        assert_eq!(view.step(), Some((Moving, 200, 1, false)));
        // Rate control may ask for less.
        view.refinement.update(ViewState { max_scale: 0.25, ..moving(2.0) });
        assert_eq!(view.step(), Some((Moving, 100, 1, false)));
    }

    #[test]
    fn spare_time_of_a_gesture_is_spent_on_samples() {
        let mut view = Simulated::new(moving(0.0), device(0.25));
        assert_eq!(view.frames(), [(Moving, 400, 4, false)]);
        let mut view = Simulated::new(moving(0.0), device(0.01));
        assert_eq!(view.frames(), [(Moving, 400, MAX_MOVING_SAMPLES, false)]);
    }

    #[test]
    fn a_view_sharpens_after_a_gesture() {
        let mut view = Simulated::new(moving(0.0), device(9.0));
        assert_eq!(view.step(), Some((Moving, 100, 1, false)));
        view.refinement.update(ViewState { is_moving: false, max_samples: 1, ..moving(0.0) });
        let sizes: Vec<_> = view.frames().iter().map(|(kind, width, ..)| (*kind, *width)).collect();
        assert_eq!(sizes, [(Moving, 100), (Moving, 200), (Final, 400)]);
    }

    #[test]
    fn a_frame_of_a_gesture_is_finished_and_a_still_is_given_up() {
        let mut view = Simulated::new(moving(0.0), device(1.0));
        view.refinement.begin_if_stale(false, view.throughput);
        view.image = Some((0, [400, 300]));
        view.refinement.update(moving(1.0));
        assert!(!view.refinement.begin_if_stale(true, view.throughput));
        assert!(view.refinement.current().camera.position.x == 0.0);
        assert_eq!(view.step(), Some((Moving, 400, 1, false)));
        assert!(view.refinement.begin_if_stale(true, view.throughput), "then the newer camera");

        let mut view = Simulated::new(settings(), device(1.0));
        view.step();
        view.refinement.update(moving(1.0));
        assert!(view.refinement.begin_if_stale(true, view.throughput));
        assert!(view.refinement.current().camera.position.x == 1.0);
    }

    #[test]
    fn a_gesture_waits_for_its_reader_and_a_still_does_not() {
        let mut view = Simulated::new(moving(0.0), device(1.0));
        view.is_wanted = false;
        assert!(!view.refinement.wants_step(None, false, view.throughput));
        view.refinement.update(settings());
        while view.refinement.wants_step(view.samples(), false, view.throughput) {
            assert_eq!(view.step(), None);
        }
        assert_eq!(view.samples(), Some(64), "refined meanwhile");
        view.is_wanted = true;
        assert_eq!(view.step(), Some((Final, 400, 64, true)));
    }

    #[test]
    fn a_paused_view_does_nothing() {
        let view = Simulated::new(ViewState { is_paused: true, ..settings() }, device(1.0));
        assert!(!view.refinement.wants_step(None, true, view.throughput) && view.refinement.is_idle());
    }

    #[test]
    fn a_converged_image_is_shown_again_for_its_viewer_and_refined_for_a_new_goal() {
        let mut view = Simulated::new(settings(), device(1.0));
        view.frames();
        view.refinement.update(ViewState { exposure: 2.0, input_seq: 2, ..settings() });
        assert_eq!(view.frames(), [(Final, 400, 64, true)], "no samples for another exposure");
        assert_eq!((view.refinement.current().exposure, view.refinement.current().input_seq), (2.0, 2));
        view.refinement.update(ViewState { max_samples: 256, exposure: 2.0, input_seq: 2, ..settings() });
        assert_eq!(view.frames().last(), Some(&(Final, 400, 256, true)));
        view.refinement.discard();
        assert_eq!(view.frames().first(), Some(&(Still, 400, 1, false)), "other lights begin another image");
    }

    #[test]
    fn an_image_that_does_not_fit_is_made_smaller() {
        let mut view = Simulated::new(settings(), device(1.0));
        assert!(view.refinement.shrink() && view.refinement.shrink());
        assert_eq!(view.frames().last(), Some(&(Final, 100, 64, true)));
        assert!(view.refinement.shrink() && !view.refinement.shrink(), "an eighth is the least");
        view.refinement.update(ViewState { size: [200, 150], ..settings() });
        view.step();
        assert_eq!(view.refinement.render_size(), [200, 150], "another size is tried in full");
    }
}
