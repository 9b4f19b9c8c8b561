//! How a view is served: the numbers of `stats`.

use std::collections::VecDeque;
use std::time::Duration;

use surfelcast_protocol::server::{ErrorInfo, PassInfo, SkippedInfo, Stats};
use surfelcast_renderer::{ErrorEstimate, Frame, FrameKind};
use surfelcast_stream::{AckWindow, QualityLoop};

use crate::live::recent::push_bounded;

/// Least time between two `stats`.
const INTERVAL: Duration = Duration::from_millis(500);
/// The renderer rounds the resolution factor down to a multiple of this.
const RENDERER_STEP: f32 = 0.125;
/// `stats.reason`: the device needs longer for a frame of full size than a frame may take.
const REASON_DEVICE: &str = "device";
/// `stats.reason`: the link carries less than the view settings allow.
const REASON_LINK: &str = "link";
/// Send times kept for the frame rate.
const RATE_LOG: usize = 256;
/// Passes listed in `stats` at most.
const MAX_PASSES: usize = 64;

/// What is recorded of frames for `stats`. All times since the connection began.
#[derive(Debug, Default)]
pub(crate) struct StatsRecord {
    last_error: Option<ErrorEstimate>,
    has_converged: bool,
    /// Size relative to the full one of the newest moving frame.
    moving_scale: Option<f32>,
    sent_at: VecDeque<Duration>,
    last_message_at: Option<Duration>,
    is_due: bool,
}

impl StatsRecord {
    /// The renderer delivered a frame; `is_first` of a refinement, so that earlier errors are of another image.
    pub(crate) fn on_frame(&mut self, frame: &Frame, is_first: bool) {
        let earlier = self.last_error.filter(|_| !is_first);
        self.last_error = frame.error.or(earlier);
        self.has_converged = frame.kind == FrameKind::Final;
    }

    /// A frame was sent.
    pub(crate) fn on_sent(&mut self, now: Duration) {
        push_bounded(&mut self.sent_at, now, RATE_LOG);
        self.is_due = true;
    }

    /// A frame of a gesture was sent.
    pub(crate) fn on_moving_frame(&mut self, frame: &Frame) {
        self.moving_scale = Some(scale_of(frame.size, frame.full_size));
    }

    /// When `stats` should be sent; `None` while no frame was sent since the last.
    pub(crate) fn due_at(&self) -> Option<Duration> {
        self.is_due.then(|| self.last_message_at.map_or(Duration::ZERO, |at| at + INTERVAL))
    }

    /// The message, which counts as sent. Where the view shows another output than radiance, the audited error is left
    /// out: it is of radiance.
    pub(crate) fn message(
        &mut self,
        frame: Option<&Frame>,
        shows_radiance: bool,
        window: &AckWindow,
        quality: &QualityLoop,
        now: Duration,
    ) -> Option<Stats> {
        self.is_due = false;
        self.last_message_at = Some(now);
        let frame = frame?;
        let error = self.last_error.filter(|_| shows_radiance);
        let (scale, reason) = moving_scale(self.moving_scale, quality);
        let passes = frame.passes.iter().take(MAX_PASSES);
        let skipped = frame.skipped.iter().take(MAX_PASSES);
        Some(Stats {
            view: 0,
            quality: quality.quality(),
            scale,
            fps: self.frames_per_sec(now),
            window: window.frames(quality.frames_per_sec()),
            rtt_ms: window.round_trip_min().map_or(0.0, |time| time.as_secs_f32() * 1e3),
            reason: reason.into(),
            samples: frame.samples,
            error: error.map(|e| ErrorInfo { rmse: e.rmse_tonemapped, std_error: e.std_error }),
            converged: self.has_converged,
            passes: passes.map(|pass| PassInfo { name: pass.name.clone(), ms: pass.gpu_ms as f32 }).collect(),
            skipped: skipped.map(|s| SkippedInfo { name: s.name.clone(), reason: s.reason.clone() }).collect(),
        })
    }

    fn frames_per_sec(&self, now: Duration) -> f32 {
        let since = now.saturating_sub(Duration::from_secs(1));
        self.sent_at.iter().filter(|at| **at > since).count() as f32
    }
}

/// Resolution factor of a frame; exact 1 for a full one.
fn scale_of(size: [u32; 2], full_size: [u32; 2]) -> f32 {
    // The longer side is rounded less.
    let axis = usize::from(full_size[1] > full_size[0]);
    (size[axis] as f32 / full_size[axis].max(1) as f32).min(1.0)
}

/// The resolution factor in use while moving, and what keeps it or the quality below the view settings. The link sets
/// an upper bound; the renderer goes below it, in steps of 1/8, where the device needs longer for a frame.
fn moving_scale(shown: Option<f32>, quality: &QualityLoop) -> (f32, &'static str) {
    let bound = quality.scale();
    let Some(shown) = shown else { return (bound, if quality.is_reduced() { REASON_LINK } else { "" }) };
    let scale = shown.min(bound);
    let is_device = if bound < 1.0 { scale < bound - RENDERER_STEP } else { scale < 1.0 };
    let reason = match (is_device, quality.is_reduced()) {
        (true, _) => REASON_DEVICE,
        (false, true) => REASON_LINK,
        (false, false) => "",
    };
    (scale, reason)
}

#[cfg(test)]
mod tests {
    use surfelcast_stream::QualityLimits;

    use super::*;
    use crate::live::frame::tests::frame;

    fn behind_until(done: impl Fn(&QualityLoop) -> bool) -> QualityLoop {
        let mut quality = QualityLoop::new(QualityLimits::default());
        while !done(&quality) {
            quality.on_ack(Duration::from_millis(100));
        }
        quality
    }

    #[test]
    fn the_scale_is_the_one_in_use_and_has_its_reason() {
        let full = QualityLoop::new(QualityLimits::default());
        assert_eq!(moving_scale(None, &full), (1.0, ""));
        assert_eq!(moving_scale(Some(1.0), &full), (1.0, ""));
        assert_eq!(moving_scale(Some(0.625), &full), (0.625, "device"));
        let soft = behind_until(QualityLoop::is_reduced);
        assert_eq!(moving_scale(Some(1.0), &soft), (1.0, "link"));
        assert_eq!(moving_scale(Some(0.625), &soft), (0.625, "device"));
        let small = behind_until(|quality| quality.scale() < 0.6);
        assert_eq!(small.scale(), 0.5625);
        assert_eq!(moving_scale(Some(1.0), &small), (0.5625, "link"), "that frame was requested before");
        assert_eq!(moving_scale(Some(0.5), &small), (0.5, "link"), "the renderer's step below");
        assert_eq!(moving_scale(Some(0.25), &small), (0.25, "device"));
    }

    #[test]
    fn rounding_of_the_short_side_does_not_show() {
        assert_eq!(scale_of([640, 360], [1280, 720]), 0.5);
        assert_eq!(scale_of([375, 1], [1000, 1]), 0.375);
        assert_eq!(scale_of([1, 375], [1, 1000]), 0.375);
        assert_eq!(scale_of([0, 0], [0, 0]), 0.0);
    }

    #[test]
    fn errors_stay_until_another_image_begins() {
        let error = ErrorEstimate {
            rmse_tonemapped: 0.25,
            rel_mse: 0.0,
            std_error: 0.5,
            rmse_low: 0.0,
            rmse_high: 0.0,
            mse_tonemapped: 0.0,
        };
        let (window, quality) = (AckWindow::default(), QualityLoop::new(QualityLimits::default()));
        let mut record = StatsRecord::default();
        let mut rmse = |frame: &Frame, is_first, shows_radiance| {
            record.on_frame(frame, is_first);
            let stats = record.message(Some(frame), shows_radiance, &window, &quality, Duration::ZERO);
            stats.and_then(|stats| stats.error).map(|error| error.rmse)
        };
        let audited = Frame { error: Some(error), ..frame(FrameKind::Still, 4) };
        let unaudited = frame(FrameKind::Still, 8);
        assert_eq!(rmse(&audited, true, true), Some(0.25));
        assert_eq!(rmse(&unaudited, false, true), Some(0.25), "the last audit");
        assert_eq!(rmse(&unaudited, false, false), None, "another output");
        assert_eq!(rmse(&unaudited, true, true), None);
    }

    #[test]
    fn stats_come_at_most_twice_a_second_and_only_after_frames() {
        let (window, quality) = (AckWindow::default(), QualityLoop::new(QualityLimits::default()));
        let shown = frame(FrameKind::Final, 1);
        let mut record = StatsRecord::default();
        assert_eq!(record.due_at(), None);
        record.on_sent(Duration::from_secs(3));
        assert_eq!(record.due_at(), Some(Duration::ZERO), "at once");
        let stats = record.message(Some(&shown), true, &window, &quality, Duration::from_secs(3));
        assert_eq!(stats.map(|stats| stats.fps), Some(1.0));
        assert_eq!(record.due_at(), None);
        record.on_sent(Duration::from_millis(3100));
        assert_eq!(record.due_at(), Some(Duration::from_millis(3500)));
    }
}
