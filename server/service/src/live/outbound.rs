//! From a rendered frame to bytes on the wire, and the numbers shown beside it.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use surfelcast_protocol::frame::{FrameHeader, HEADER_BYTES, flags};
use surfelcast_protocol::server::{ErrorInfo, PassInfo, ServerMessage, SkippedInfo, Stats};
use surfelcast_protocol::settings::Codec;
use surfelcast_renderer::scene::Camera;
use surfelcast_renderer::{ErrorEstimate, Frame, FrameKind};
use surfelcast_stream::{Quality, QualityLoop, Stage, StreamError, choose_encoding, encode};
use tokio::sync::mpsc;

use crate::live::connection::{Connection, Ending, push_bounded};

/// Least time between two `stats`.
const STATS_INTERVAL: Duration = Duration::from_millis(500);
/// The renderer rounds the resolution factor down to a multiple of this.
const RENDERER_STEP: f32 = 0.125;
/// `stats.reason`: the device needs longer for a frame of full size than a frame may take.
const REASON_DEVICE: &str = "device";
/// `stats.reason`: the link carries less than the wish.
const REASON_LINK: &str = "link";
/// Frames remembered until they are acknowledged; more than the largest window.
const SHOWN_LOG: usize = 16;
/// Send times kept for the frame rate.
const RATE_LOG: usize = 256;
/// Passes listed in `stats` at most.
const MAX_PASSES: usize = 64;

/// Camera and size of a picture that the client sees.
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

/// A frame on its way to the client.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shown {
    seq: u32,
    view: AckedView,
    /// When the input it answers arrived, if no earlier frame answered that.
    pub(crate) input_at: Option<Duration>,
    pub(crate) stage: Stage,
}

/// An encoder's result.
#[derive(Debug)]
pub(crate) struct Encoded {
    frame: Arc<Frame>,
    stage: Stage,
    is_asked_for: bool,
    codec: Codec,
    quality: Quality,
    /// Header's room, then the payload. `None` when the encoder panicked.
    message: Option<Result<Vec<u8>, StreamError>>,
    secs: f64,
}

/// What is remembered of frames.
#[derive(Debug, Default)]
pub(crate) struct Outbound {
    pub(crate) encoded: Option<mpsc::Sender<Encoded>>,
    is_encoding: bool,
    last_frame: Option<Arc<Frame>>,
    last_error: Option<ErrorEstimate>,
    has_converged: bool,
    /// Size relative to the full one of the newest moving frame.
    moving_scale: Option<f32>,
    answered_seq: u32,
    shown: VecDeque<Shown>,
    acked: Option<AckedView>,
    sent_at: VecDeque<Duration>,
    last_stats_at: Option<Duration>,
    is_stats_due: bool,
}

impl Outbound {
    pub(crate) fn is_encoding(&self) -> bool {
        self.is_encoding
    }

    pub(crate) fn last_frame(&self) -> Option<Arc<Frame>> {
        self.last_frame.clone()
    }

    /// The picture the client sees.
    pub(crate) fn acked_view(&self) -> Option<AckedView> {
        self.acked
    }

    /// The client has this frame and all before it.
    pub(crate) fn acknowledged(&mut self, seq: u32) -> Option<Shown> {
        let at = self.shown.iter().position(|shown| shown.seq == seq)?;
        let shown = self.shown.drain(..=at).next_back()?;
        self.acked = Some(shown.view);
        Some(shown)
    }

    /// When `stats` should be sent; `None` while no frame was sent since the last.
    pub(crate) fn stats_at(&self) -> Option<Duration> {
        self.is_stats_due.then(|| self.last_stats_at.map_or(Duration::ZERO, |at| at + STATS_INTERVAL))
    }

    fn frames_per_sec(&self, now: Duration) -> f32 {
        let since = now.saturating_sub(Duration::from_secs(1));
        self.sent_at.iter().filter(|at| **at > since).count() as f32
    }

    /// Follows the refinement: a picture with fewer samples or other lights begins a new one.
    fn follow(&mut self, frame: &Arc<Frame>) -> bool {
        let is_new = self.last_frame.as_ref().is_none_or(|last| {
            frame.samples < last.samples || frame.scene_rev != last.scene_rev || frame.input_seq != last.input_seq
        });
        if is_new {
            self.last_error = None;
        }
        self.last_error = frame.error.or(self.last_error);
        self.has_converged = frame.kind == FrameKind::Final;
        self.last_frame = Some(Arc::clone(frame));
        is_new
    }
}

fn stage_of(kind: FrameKind) -> Stage {
    match kind {
        FrameKind::Moving => Stage::Moving,
        FrameKind::Still => Stage::Still,
        FrameKind::Final => Stage::Final,
    }
}

fn stream_codec(codec: Codec) -> surfelcast_stream::Codec {
    match codec {
        Codec::Jpeg => surfelcast_stream::Codec::Jpeg,
        Codec::Webp => surfelcast_stream::Codec::Webp,
        Codec::Png => surfelcast_stream::Codec::Png,
    }
}

fn protocol_codec(codec: surfelcast_stream::Codec) -> Codec {
    match codec {
        surfelcast_stream::Codec::Jpeg => Codec::Jpeg,
        surfelcast_stream::Codec::Webp => Codec::Webp,
        surfelcast_stream::Codec::Png => Codec::Png,
    }
}

fn dropped(reason: &'static str) {
    metrics::counter!("surfelcast_frames_dropped_total", "reason" => reason).increment(1);
}

impl Connection {
    /// The renderer delivered a frame that could be sent now.
    pub(crate) fn taken(&mut self, frame: &Arc<Frame>) {
        metrics::histogram!("surfelcast_frame_render_seconds").record(f64::from(frame.render_secs));
        metrics::histogram!("surfelcast_frame_queue_seconds").record(frame.finished_at.elapsed().as_secs_f64());
        let stage = stage_of(frame.kind);
        if self.outbound.follow(frame) {
            self.stills.restart();
        }
        if stage != Stage::Moving {
            if self.motion.is_moving {
                return dropped("superseded");
            }
            if !self.stills.is_due(frame.samples, stage == Stage::Final, self.now()) {
                return dropped("not_due");
            }
        }
        self.begin_encoding(Arc::clone(frame), stage, false);
    }

    /// Has a frame encoded off the async threads; [`Connection::encoded`] follows.
    pub(crate) fn begin_encoding(&mut self, frame: Arc<Frame>, stage: Stage, is_asked_for: bool) {
        let offered: Vec<_> = self.codecs.iter().copied().map(stream_codec).collect();
        let wish = self.wishes.lock().codec.map(stream_codec);
        let pixel_count = u64::from(frame.size[0]) * u64::from(frame.size[1]);
        let throughput = self.window.throughput();
        let choice = choose_encoding(stage, &offered, wish, self.quality.quality(), pixel_count, throughput);
        let (Some((codec, quality)), Some(sender)) = (choice, self.outbound.encoded.clone()) else { return };
        self.outbound.is_encoding = true;
        let pool = self.state.encoders().clone();
        drop(tokio::spawn(async move {
            let began = std::time::Instant::now();
            let pixels = Arc::clone(&frame);
            let message = pool
                .run(move || {
                    encode(&pixels.pixels, pixels.size, codec, quality).map(|payload| {
                        let mut message = vec![0; HEADER_BYTES];
                        message.extend_from_slice(&payload);
                        message
                    })
                })
                .await;
            let codec = protocol_codec(codec);
            let secs = began.elapsed().as_secs_f64();
            let done = Encoded { frame, stage, is_asked_for, codec, quality, message: message.ok(), secs };
            // The connection may be gone by now.
            let _ = sender.send(done).await;
        }));
    }

    /// An encoder is done: the frame goes out, unless it was overtaken.
    pub(crate) fn encoded(&mut self, mut done: Encoded) -> Result<(), Ending> {
        self.outbound.is_encoding = false;
        metrics::histogram!("surfelcast_encode_seconds").record(done.secs);
        let mut message = match done.message.take() {
            Some(Ok(message)) => message,
            Some(Err(error)) => {
                tracing::warn!(%error, "frame could not be encoded");
                dropped("encode_failed");
                return Ok(());
            }
            None => {
                tracing::error!("an encoder panicked");
                dropped("encode_failed");
                return Ok(());
            }
        };
        if done.stage != Stage::Moving && self.motion.is_moving && !done.is_asked_for {
            dropped("superseded");
            return Ok(());
        }
        let frame = &done.frame;
        let now = self.now();
        let seq = self.window.sent(message.len() as u64, now);
        let payload_len = (message.len() - HEADER_BYTES) as u32;
        let header = FrameHeader {
            codec: done.codec,
            flags: frame_flags(&done, frame.kind),
            view: 0,
            frame_seq: seq,
            input_seq: frame.input_seq,
            scene_rev: frame.scene_rev,
            rect: [0, 0, saturating(frame.size[0]), saturating(frame.size[1])],
            full_size: frame.full_size.map(saturating),
            server_us: self.state.server_us(),
            render_10us: ten_micros(f64::from(frame.render_secs)),
            encode_10us: ten_micros(done.secs),
            spp: saturating(frame.samples),
            quality: done.quality.number(),
            payload_len,
        };
        message[..HEADER_BYTES].copy_from_slice(&header.encode());
        metrics::counter!("surfelcast_frames_total", "stage" => stage_label(done.stage)).increment(1);
        metrics::counter!("surfelcast_frame_bytes_total").increment(message.len() as u64);
        self.outbox.frame(Bytes::from(message))?;
        self.note_sent(&done.frame, done.stage, seq, now);
        if done.stage == Stage::Final && !done.is_asked_for {
            return self.send_stats();
        }
        Ok(())
    }

    fn note_sent(&mut self, frame: &Frame, stage: Stage, seq: u32, now: Duration) {
        if stage == Stage::Moving {
            self.outbound.moving_scale = Some(scale_of(frame.size, frame.full_size));
            self.stills.restart();
        } else {
            self.stills.sent(frame.samples, now);
        }
        let is_first_answer = frame.input_seq != self.outbound.answered_seq;
        let input_at = self.inbound.arrived_at(frame.input_seq).filter(|_| is_first_answer);
        self.outbound.answered_seq = frame.input_seq;
        if let Some(at) = input_at {
            metrics::histogram!("surfelcast_input_to_send_seconds").record(now.saturating_sub(at).as_secs_f64());
        }
        let size = frame.full_size.map(|side| side.max(1));
        let view = AckedView { camera: self.camera_of(frame.input_seq), size };
        let shown = Shown { seq, view, input_at, stage };
        push_bounded(&mut self.outbound.shown, shown, SHOWN_LOG);
        push_bounded(&mut self.outbound.sent_at, now, RATE_LOG);
        self.outbound.is_stats_due = true;
    }

    /// Tells the client how it is being served.
    pub(crate) fn send_stats(&mut self) -> Result<(), Ending> {
        let now = self.now();
        self.outbound.is_stats_due = false;
        self.outbound.last_stats_at = Some(now);
        let Some(frame) = self.outbound.last_frame.clone() else { return Ok(()) };
        // The audit is of radiance; beside another output its number would be about a picture nobody sees.
        let shows_radiance = self.wishes.lock().aov.is_none();
        let error = self.outbound.last_error.filter(|_| shows_radiance);
        let (scale, reason) = moving_scale(self.outbound.moving_scale, &self.quality);
        let passes = frame.passes.iter().take(MAX_PASSES);
        let skipped = frame.skipped.iter().take(MAX_PASSES);
        let stats = Stats {
            view: 0,
            quality: self.quality.quality(),
            scale,
            fps: self.outbound.frames_per_sec(now),
            window: self.window.frames(self.quality.frames_per_sec()),
            rtt_ms: self.window.round_trip_min().map_or(0.0, |time| time.as_secs_f32() * 1e3),
            reason: reason.into(),
            samples: frame.samples,
            error: error.map(|e| ErrorInfo { rmse: e.rmse_tonemapped, std_error: e.std_error }),
            converged: self.outbound.has_converged,
            passes: passes.map(|pass| PassInfo { name: pass.name.clone(), ms: pass.gpu_ms as f32 }).collect(),
            skipped: skipped.map(|s| SkippedInfo { name: s.name.clone(), reason: s.reason.clone() }).collect(),
        };
        self.outbox.control(&ServerMessage::Stats(Box::new(stats)))?;
        Ok(())
    }
}

/// Resolution factor of a frame; exact 1 for a full one.
fn scale_of(size: [u32; 2], full_size: [u32; 2]) -> f32 {
    // The longer side is rounded less.
    let axis = usize::from(full_size[1] > full_size[0]);
    (size[axis] as f32 / full_size[axis].max(1) as f32).min(1.0)
}

/// The resolution factor in use while moving, and why it or the quality is below the wish. The link sets an upper
/// bound; the renderer goes below it, in steps of 1/8, where the device needs longer for a frame.
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

fn frame_flags(done: &Encoded, kind: FrameKind) -> u16 {
    let mut bits = flags::KEYFRAME;
    if kind != FrameKind::Moving {
        bits |= flags::STILL;
    }
    if kind == FrameKind::Final {
        bits |= flags::FINAL;
    }
    if done.quality == Quality::Lossless && done.codec != Codec::Jpeg {
        bits |= flags::LOSSLESS;
    }
    bits
}

fn stage_label(stage: Stage) -> &'static str {
    match stage {
        Stage::Moving => "moving",
        Stage::Still => "still",
        Stage::Final => "final",
    }
}

fn saturating(value: u32) -> u16 {
    u16::try_from(value).unwrap_or(u16::MAX)
}

/// The header's unit of time; float to integer casts saturate.
fn ten_micros(secs: f64) -> u16 {
    (secs * 1e5) as u16
}

#[cfg(test)]
mod tests {
    use surfelcast_stream::QualityLimits;

    use super::*;

    fn behind_until(done: impl Fn(&QualityLoop) -> bool) -> QualityLoop {
        let mut quality = QualityLoop::new(QualityLimits::default());
        while !done(&quality) {
            quality.on_ack(Duration::from_millis(100));
        }
        quality
    }

    #[test]
    fn the_scale_is_the_one_in_use_and_has_its_reason() {
        let wish = QualityLoop::new(QualityLimits::default());
        assert_eq!(moving_scale(None, &wish), (1.0, ""));
        assert_eq!(moving_scale(Some(1.0), &wish), (1.0, ""));
        assert_eq!(moving_scale(Some(0.625), &wish), (0.625, "device"));
        let soft = behind_until(QualityLoop::is_reduced);
        assert_eq!(moving_scale(Some(1.0), &soft), (1.0, "link"));
        assert_eq!(moving_scale(Some(0.625), &soft), (0.625, "device"));
        let small = behind_until(|quality| quality.scale() < 0.6);
        assert_eq!(small.scale(), 0.5625);
        assert_eq!(moving_scale(Some(1.0), &small), (0.5625, "link"), "that frame was asked for before");
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
}
