//! Frames on their way to a client, and the one that it sees.

use std::collections::VecDeque;
use std::time::Duration;

use surfelcast_renderer::Frame;
use surfelcast_renderer::scene::Camera;
use surfelcast_stream::Stage;

use crate::live::recent::push_bounded;

/// Frames remembered until they are acknowledged; more than the largest window.
const CAPACITY: usize = 16;

/// The input that a frame contains.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ContainedInput {
    /// The camera in force after it.
    pub(crate) camera: Camera,
    /// When it arrived, if that is known.
    pub(crate) arrived_at: Option<Duration>,
}

/// Camera and size of a frame that the client sees.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AckedView {
    pub(crate) camera: Camera,
    /// Size at which it is shown, pixels; at least 1.
    pub(crate) size: [u32; 2],
}

impl AckedView {
    /// Width over height.
    pub(crate) fn aspect(&self) -> f64 {
        f64::from(self.size[0]) / f64::from(self.size[1])
    }
}

/// A frame that was sent.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SentFrame {
    seq: u32,
    view: AckedView,
    /// When the input that it answers arrived, if no earlier frame answered that.
    pub(crate) input_at: Option<Duration>,
    pub(crate) stage: Stage,
}

/// The newest frames that were sent on one socket.
#[derive(Debug, Default)]
pub(crate) struct SentLog {
    frames: VecDeque<SentFrame>,
    answered_seq: u32,
    acked: Option<AckedView>,
}

impl SentLog {
    /// Records a frame under its number on the socket. Returns when the input that it answers arrived, if it is the
    /// first frame to answer that.
    pub(crate) fn record(&mut self, seq: u32, frame: &Frame, stage: Stage, input: ContainedInput) -> Option<Duration> {
        let is_first_answer = frame.input_seq != self.answered_seq;
        self.answered_seq = frame.input_seq;
        let input_at = input.arrived_at.filter(|_| is_first_answer);
        let view = AckedView { camera: input.camera, size: frame.full_size.map(|side| side.max(1)) };
        push_bounded(&mut self.frames, SentFrame { seq, view, input_at, stage }, CAPACITY);
        input_at
    }

    /// The client has this frame and all before it.
    pub(crate) fn acknowledge(&mut self, seq: u32) -> Option<SentFrame> {
        let at = self.frames.iter().position(|sent| sent.seq == seq)?;
        let sent = self.frames.drain(..=at).next_back()?;
        self.acked = Some(sent.view);
        Some(sent)
    }

    /// The frame that the client sees.
    pub(crate) fn acked(&self) -> Option<AckedView> {
        self.acked
    }
}

#[cfg(test)]
mod tests {
    use surfelcast_renderer::FrameKind;

    use super::*;
    use crate::live::frame::tests::frame;
    use crate::live::view_settings::ViewSettings;

    #[test]
    fn the_client_sees_the_newest_acknowledged_frame() {
        let mut log = SentLog::default();
        let base = ViewSettings::default().camera;
        let at = Duration::from_millis(7);
        let record = |log: &mut SentLog, seq: u32, input_seq: u32| {
            let camera = Camera { position: glam::DVec3::new(f64::from(seq), 0.0, 1.0), ..base };
            let frame = Frame { input_seq, full_size: [0, 48], ..frame(FrameKind::Moving, 1) };
            log.record(seq, &frame, Stage::Moving, ContainedInput { camera, arrived_at: Some(at) })
        };
        assert_eq!(record(&mut log, 1, 5), Some(at));
        assert_eq!(record(&mut log, 2, 5), None, "answered already");
        assert_eq!(record(&mut log, 3, 6), Some(at));
        assert!(log.acked().is_none() && log.acknowledge(9).is_none());
        assert_eq!(log.acknowledge(2).map(|sent| sent.input_at), Some(None));
        assert_eq!(log.acked().map(|view| (view.camera.position.x, view.size)), Some((2.0, [1, 48])));
        assert!(log.acknowledge(1).is_none(), "older ones are gone");
        for seq in 4..1000 {
            record(&mut log, seq, seq);
        }
        assert_eq!(log.frames.len(), CAPACITY);
    }
}
