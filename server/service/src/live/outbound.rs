//! Which frames of a view go out on one socket, when, and in which quality.
//!
//! No socket, no encoder and no clock: events and the time come in, requests come out, and the connection carries them
//! out. A frame is requested from the renderer only while it could be encoded and sent, so that a slow client costs no
//! rendering; a frame that a newer state has overtaken is dropped.

use std::sync::Arc;
use std::time::Duration;

use surfelcast_protocol::client::Ack;
use surfelcast_protocol::server::Stats;
use surfelcast_protocol::settings;
use surfelcast_renderer::{Frame, FrameKind};
use surfelcast_stream::{AckWindow, Codec, QualityLoop, Stage, StillSchedule, choose_encoding};

use crate::config::Timeouts;
use crate::live::close::CloseReason;
use crate::live::frame::{EncodeRequest, EncodedFrame, stream_codec};
use crate::live::refusal::{Refusal, is_own_view};
use crate::live::sent_log::{AckedView, ContainedInput, SentLog};
use crate::live::stats::StatsRecord;
use crate::live::view_settings::ViewSettings;

/// The first frame waits this long for the client to state its size.
const FIRST_SIZE_PATIENCE: Duration = Duration::from_millis(250);
/// Least time between two requested stills.
const STILL_INTERVAL: Duration = Duration::from_secs(1);

/// What is due now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Due {
    /// The state of the view changed: the gesture has ended.
    pub(crate) view_update: bool,
    /// A frame should be requested from the renderer.
    pub(crate) frame: bool,
    /// `stats` should be sent.
    pub(crate) stats: bool,
}

/// An encoded frame that is sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Delivery {
    /// Its number on this socket.
    pub(crate) seq: u32,
    /// `stats` follow it at once.
    pub(crate) with_stats: bool,
}

/// Whether the view is in a gesture.
#[derive(Clone, Copy, Debug, Default)]
struct Motion {
    is_moving: bool,
    last_input_at: Duration,
}

/// A frame that is being encoded.
#[derive(Clone, Copy, Debug)]
struct Encoding {
    stage: Stage,
    /// The client requested this still.
    is_requested: bool,
}

/// The part of the view settings that decides what is sent.
#[derive(Clone, Copy, Debug)]
struct Wanted {
    codec: Option<Codec>,
    is_paused: bool,
    shows_radiance: bool,
}

impl Wanted {
    fn of(settings: &ViewSettings) -> Self {
        Self {
            codec: settings.codec.map(stream_codec),
            is_paused: settings.is_paused,
            shows_radiance: settings.aov.is_none(),
        }
    }
}

/// State of one view on one socket. All times since the connection began.
#[derive(Debug)]
pub(crate) struct Outbound {
    /// Codecs that the client decodes, best first.
    offered: Vec<Codec>,
    ack_stop: Duration,
    ack_close: Duration,
    wanted: Wanted,
    motion: Motion,
    window: AckWindow,
    quality: QualityLoop,
    stills: StillSchedule,
    stats: StatsRecord,
    start_at: Duration,
    /// A frame was requested and has not come.
    is_waiting_for_frame: bool,
    encoding: Option<Encoding>,
    last_frame: Option<Arc<Frame>>,
    last_still_at: Option<Duration>,
    sent: SentLog,
    is_draining: bool,
}

impl Outbound {
    /// For a client that begins with these settings and decodes the codecs `offered`, best first.
    pub(crate) fn new(settings: &ViewSettings, offered: &[settings::Codec], timeouts: &Timeouts) -> Self {
        Self {
            offered: offered.iter().copied().map(stream_codec).collect(),
            ack_stop: timeouts.ack_stop,
            ack_close: timeouts.ack_close,
            wanted: Wanted::of(settings),
            motion: Motion::default(),
            window: AckWindow::default(),
            quality: QualityLoop::new(settings.quality),
            stills: StillSchedule::default(),
            stats: StatsRecord::default(),
            start_at: FIRST_SIZE_PATIENCE,
            is_waiting_for_frame: false,
            encoding: None,
            last_frame: None,
            last_still_at: None,
            sent: SentLog::default(),
            is_draining: false,
        }
    }

    /// Whether the view is in a gesture.
    pub(crate) fn is_moving(&self) -> bool {
        self.motion.is_moving
    }

    /// How fast and how large moving frames may be.
    pub(crate) fn quality(&self) -> &QualityLoop {
        &self.quality
    }

    /// Whether a frame is being encoded.
    pub(crate) fn is_encoding(&self) -> bool {
        self.encoding.is_some()
    }

    /// The frame that the client sees.
    pub(crate) fn acked_view(&self) -> Option<AckedView> {
        self.sent.acked()
    }

    /// The view moves until there was no input for a while.
    pub(crate) fn on_input(&mut self, now: Duration) {
        self.motion = Motion { is_moving: true, last_input_at: now };
        self.stills.restart();
    }

    /// The client stated its camera or its size: the first frame need not wait any more.
    pub(crate) fn start(&mut self) {
        self.start_at = Duration::ZERO;
    }

    /// The client changed its view settings.
    pub(crate) fn on_settings(&mut self, settings: &ViewSettings) {
        self.wanted = Wanted::of(settings);
        self.quality.set_limits(settings.quality);
        self.stills.restart();
        self.start();
    }

    /// The device was rebuilt: refinement begins again.
    pub(crate) fn on_restored(&mut self) {
        self.stills.restart();
    }

    /// Nothing is requested any more; what is being encoded still goes out.
    pub(crate) fn drain(&mut self) {
        self.is_draining = true;
    }

    /// What is due at `now`. `has_frame_room`: the socket can queue a frame. Fails when acknowledgements are overdue
    /// for too long.
    pub(crate) fn on_tick(&mut self, now: Duration, has_frame_room: bool) -> Result<Due, CloseReason> {
        let mut due = Due::default();
        if self.motion.is_moving && now >= self.rest_at() {
            self.motion.is_moving = false;
            due.view_update = true;
        }
        if self.frame_at(now, has_frame_room).is_some_and(|at| now >= at) {
            self.is_waiting_for_frame = true;
            due.frame = true;
        }
        if self.window.silence(now) >= self.ack_close {
            return Err(CloseReason::AckTimeout);
        }
        due.stats = self.stats.due_at().is_some_and(|at| now >= at);
        Ok(due)
    }

    /// When [`Outbound::on_tick`] has something to do if nothing happens before.
    pub(crate) fn deadline(&self, now: Duration, has_frame_room: bool) -> Option<Duration> {
        let rest = self.motion.is_moving.then(|| self.rest_at());
        let silence =
            (self.window.in_flight() > 0).then(|| now + self.ack_close.saturating_sub(self.window.silence(now)));
        let deadlines = [rest, self.frame_at(now, has_frame_room), silence, self.stats.due_at()];
        deadlines.into_iter().flatten().min()
    }

    /// Whether a frame taken from the renderer now could be encoded and sent.
    pub(crate) fn can_take(&self, now: Duration, has_frame_room: bool) -> bool {
        self.encoding.is_none()
            && has_frame_room
            && self.window.has_room(self.quality.frames_per_sec())
            && !self.is_silent(now)
            && !self.is_draining
    }

    /// The renderer delivered a frame: what to encode, unless the frame is not worth sending.
    pub(crate) fn on_frame(&mut self, frame: &Arc<Frame>, now: Duration) -> Option<EncodeRequest> {
        self.is_waiting_for_frame = false;
        self.follow(frame);
        let stage = stage_of(frame.kind);
        if stage != Stage::Moving {
            if self.motion.is_moving {
                return drop_frame("superseded");
            }
            if !self.stills.is_due(frame.samples, stage == Stage::Final, now) {
                return drop_frame("not_due");
            }
        }
        self.encode(Arc::clone(frame), Encoding { stage, is_requested: false })
    }

    /// The client requests a still of the present frame.
    pub(crate) fn on_still(&mut self, now: Duration) -> Result<EncodeRequest, Refusal> {
        if self.last_still_at.is_some_and(|at| now.saturating_sub(at) < STILL_INTERVAL) {
            return Err(Refusal::busy("still: at most one a second"));
        }
        if self.is_encoding() || !self.window.has_room(self.quality.frames_per_sec()) {
            return Err(Refusal::busy("still: frames are on their way; ask again when they have arrived"));
        }
        let encoding = Encoding { stage: Stage::Final, is_requested: true };
        let request = self.last_frame.clone().and_then(|frame| self.encode(frame, encoding));
        let request = request.ok_or_else(|| Refusal::no_frame("still: there is no picture yet"))?;
        self.last_still_at = Some(now);
        Ok(request)
    }

    /// A frame was encoded: how to send it, unless a newer state has overtaken it.
    pub(crate) fn on_encoded(
        &mut self,
        encoded: &EncodedFrame,
        input: ContainedInput,
        now: Duration,
    ) -> Option<Delivery> {
        let Encoding { stage, is_requested } = self.encoding.take()?;
        if stage != Stage::Moving && self.motion.is_moving && !is_requested {
            return drop_frame("superseded");
        }
        let frame = &encoded.frame;
        let seq = self.window.sent(encoded.message_bytes(), now);
        metrics::counter!("surfelcast_frames_total", "stage" => stage_label(stage)).increment(1);
        metrics::counter!("surfelcast_frame_bytes_total").increment(encoded.message_bytes());
        if stage == Stage::Moving {
            self.stats.on_moving_frame(frame);
            self.stills.restart();
        } else {
            self.stills.sent(frame.samples, now);
        }
        self.stats.on_sent(now);
        if let Some(at) = self.sent.record(seq, frame, stage, input) {
            metrics::histogram!("surfelcast_input_to_send_seconds").record(now.saturating_sub(at).as_secs_f64());
        }
        Some(Delivery { seq, with_stats: stage == Stage::Final && !is_requested })
    }

    /// The frame that was being encoded could not be.
    pub(crate) fn on_encoding_failed(&mut self) {
        self.encoding = None;
        count_dropped("encode_failed");
    }

    /// The client acknowledges frames. Returns whether the limits on moving frames changed, so that the renderer needs
    /// the new state of the view.
    pub(crate) fn on_ack(&mut self, ack: &Ack, now: Duration) -> bool {
        let was_silent = self.is_silent(now);
        let decode = Duration::from_micros(u64::from(ack.decode_us));
        let acked = if is_own_view(ack.view) { self.window.acked(ack.seq, decode, now).ok() } else { None };
        let Some(acked) = acked else {
            metrics::counter!("surfelcast_acks_ignored_total").increment(1);
            return false;
        };
        if was_silent {
            metrics::counter!("surfelcast_acks_late_total").increment(1);
        }
        if let Some(time) = acked.round_trip {
            metrics::histogram!("surfelcast_round_trip_seconds").record(time.as_secs_f64());
        }
        let Some(sent) = self.sent.acknowledge(ack.seq) else { return false };
        if let Some(at) = sent.input_at {
            let latency = now.saturating_sub(at);
            metrics::histogram!("surfelcast_input_to_ack_seconds").record(latency.as_secs_f64());
        }
        // Stills are large by design; only the delay of moving frames shows whether the link keeps up.
        let (Stage::Moving, Some(delay)) = (sent.stage, acked.queue_delay) else { return false };
        let before = (self.quality.scale(), self.quality.frames_per_sec());
        self.quality.on_ack(delay);
        before != (self.quality.scale(), self.quality.frames_per_sec())
    }

    /// How the view is served; `None` before the first frame.
    pub(crate) fn stats(&mut self, now: Duration) -> Option<Stats> {
        let frame = self.last_frame.as_deref();
        self.stats.message(frame, self.wanted.shows_radiance, &self.window, &self.quality, now)
    }

    fn rest_at(&self) -> Duration {
        self.motion.last_input_at + StillSchedule::quiet_time(self.quality.frames_per_sec())
    }

    /// Whether acknowledgements are overdue, so that nothing more is sent.
    fn is_silent(&self, now: Duration) -> bool {
        self.window.silence(now) >= self.ack_stop
    }

    /// Earliest time at which the next frame may be requested; `None` while something else must happen first.
    fn frame_at(&self, now: Duration, has_frame_room: bool) -> Option<Duration> {
        let frames_per_sec = self.quality.frames_per_sec();
        let coming = self.window.in_flight() + u32::from(self.is_encoding());
        let has_window = self.window.has_room(frames_per_sec) && coming < self.window.frames(frames_per_sec);
        let is_stopped = self.is_waiting_for_frame || self.is_draining || self.wanted.is_paused || self.is_silent(now);
        if is_stopped || !has_window || !has_frame_room {
            return None;
        }
        let paced = if self.motion.is_moving { self.window.next_send_at(frames_per_sec) } else { Duration::ZERO };
        Some(paced.max(self.start_at))
    }

    /// Follows the refinement: a frame with fewer samples, another input or other lights begins a new one.
    fn follow(&mut self, frame: &Arc<Frame>) {
        let is_first = self.last_frame.as_ref().is_none_or(|last| {
            frame.samples < last.samples || frame.scene_rev != last.scene_rev || frame.input_seq != last.input_seq
        });
        if is_first {
            self.stills.restart();
        }
        self.stats.on_frame(frame, is_first);
        self.last_frame = Some(Arc::clone(frame));
    }

    fn encode(&mut self, frame: Arc<Frame>, encoding: Encoding) -> Option<EncodeRequest> {
        let pixel_count = u64::from(frame.size[0]) * u64::from(frame.size[1]);
        let throughput = self.window.throughput();
        let moving_quality = self.quality.quality();
        let wanted = self.wanted.codec;
        let (codec, quality) =
            choose_encoding(encoding.stage, &self.offered, wanted, moving_quality, pixel_count, throughput)?;
        self.encoding = Some(encoding);
        Some(EncodeRequest { frame, codec, quality })
    }
}

fn stage_of(kind: FrameKind) -> Stage {
    match kind {
        FrameKind::Moving => Stage::Moving,
        FrameKind::Still => Stage::Still,
        FrameKind::Final => Stage::Final,
    }
}

fn stage_label(stage: Stage) -> &'static str {
    match stage {
        Stage::Moving => "moving",
        Stage::Still => "still",
        Stage::Final => "final",
    }
}

fn count_dropped(reason: &'static str) {
    metrics::counter!("surfelcast_frames_dropped_total", "reason" => reason).increment(1);
}

fn drop_frame<T>(reason: &'static str) -> Option<T> {
    count_dropped(reason);
    None
}

#[cfg(test)]
mod tests {
    use surfelcast_stream::Quality;

    use super::*;
    use crate::live::frame::tests::{encoded, frame};

    const ROOM: bool = true;

    fn ms(value: u64) -> Duration {
        Duration::from_millis(value)
    }

    /// A started view, after the time that a first frame waits.
    fn outbound() -> Outbound {
        let offered = [settings::Codec::Webp, settings::Codec::Jpeg, settings::Codec::Png];
        let mut outbound = Outbound::new(&ViewSettings::default(), &offered, &Timeouts::default());
        outbound.start();
        outbound
    }

    fn wants_frame(outbound: &mut Outbound, now: Duration) -> bool {
        outbound.on_tick(now, ROOM).expect("stays").frame
    }

    fn take(outbound: &mut Outbound, frame: Frame, now: Duration) -> Option<EncodeRequest> {
        outbound.on_frame(&Arc::new(frame), now)
    }

    fn finish(
        outbound: &mut Outbound,
        request: EncodeRequest,
        payload_bytes: usize,
        now: Duration,
    ) -> Option<Delivery> {
        let input = ContainedInput { camera: ViewSettings::default().camera, arrived_at: None };
        outbound.on_encoded(&encoded(request, payload_bytes), input, now)
    }

    /// Renders, encodes and sends a frame.
    fn send(outbound: &mut Outbound, frame: Frame, now: Duration) -> Option<Delivery> {
        let request = take(outbound, frame, now)?;
        finish(outbound, request, 1000, now)
    }

    fn ack(seq: u32) -> Ack {
        Ack { view: 0, seq, decode_us: 500, present_ms: 0.0, dropped: 0, queue: 0 }
    }

    #[test]
    fn the_first_frame_waits_for_a_size_for_a_limited_time() {
        let mut outbound = Outbound::new(&ViewSettings::default(), &[settings::Codec::Jpeg], &Timeouts::default());
        assert!(!wants_frame(&mut outbound, ms(0)));
        assert_eq!(outbound.deadline(ms(0), ROOM), Some(FIRST_SIZE_PATIENCE));
        assert!(wants_frame(&mut outbound, FIRST_SIZE_PATIENCE));
        assert!(!wants_frame(&mut outbound, ms(999)), "requested once");
    }

    #[test]
    fn a_client_that_does_not_acknowledge_costs_no_rendering() {
        let mut outbound = outbound();
        for seq in 1..=2 {
            assert!(wants_frame(&mut outbound, ms(1)));
            let sent = send(&mut outbound, frame(FrameKind::Still, 4_u32.pow(seq)), ms(1));
            assert_eq!(sent.map(|sent| sent.seq), Some(seq));
        }
        assert!(!wants_frame(&mut outbound, ms(100)) && !outbound.can_take(ms(100), ROOM), "two frames are in flight");
        outbound.on_ack(&ack(2), ms(120));
        assert!(wants_frame(&mut outbound, ms(120)) && outbound.can_take(ms(120), ROOM));
    }

    #[test]
    fn the_frame_that_is_being_encoded_counts_as_in_flight() {
        let mut outbound = outbound();
        send(&mut outbound, frame(FrameKind::Still, 1), ms(1));
        let request = take(&mut outbound, frame(FrameKind::Still, 4), ms(2)).expect("due");
        assert!(!wants_frame(&mut outbound, ms(3)) && !outbound.can_take(ms(3), ROOM));
        finish(&mut outbound, request, 1000, ms(4));
        outbound.on_ack(&ack(2), ms(9));
        assert!(wants_frame(&mut outbound, ms(9)));
    }

    #[test]
    fn nothing_is_requested_while_it_could_not_be_sent_or_is_not_wanted() {
        let mut outbound = outbound();
        assert_eq!(outbound.on_tick(ms(1), false).expect("stays"), Due::default(), "the socket has no room");
        assert!(!outbound.can_take(ms(1), false));
        let paused = ViewSettings { is_paused: true, ..ViewSettings::default() };
        outbound.on_settings(&paused);
        assert!(!wants_frame(&mut outbound, ms(1)));
        outbound.on_settings(&ViewSettings::default());
        outbound.drain();
        assert!(!wants_frame(&mut outbound, ms(1)) && !outbound.can_take(ms(1), ROOM));
    }

    #[test]
    fn owed_acknowledgements_stop_the_view_and_then_the_connection() {
        let mut outbound = outbound();
        let Timeouts { ack_stop, ack_close, .. } = Timeouts::default();
        send(&mut outbound, frame(FrameKind::Still, 1), ms(0));
        assert!(wants_frame(&mut outbound, ack_stop / 2), "one more fits into the window");
        assert!(!outbound.can_take(ack_stop, ROOM));
        assert_eq!(outbound.deadline(ack_stop, ROOM), Some(Duration::ZERO), "stats first");
        outbound.stats(ack_stop);
        assert_eq!(outbound.deadline(ack_stop, ROOM), Some(ack_close));
        assert!(matches!(outbound.on_tick(ack_close, ROOM), Err(CloseReason::AckTimeout)));
    }

    #[test]
    fn acknowledgements_of_other_frames_or_views_change_nothing() {
        let mut outbound = outbound();
        send(&mut outbound, frame(FrameKind::Still, 1), ms(1));
        for ack in [ack(0), ack(2), ack(u32::MAX), Ack { view: 9, ..ack(1) }] {
            outbound.on_ack(&ack, ms(2));
            assert!(outbound.acked_view().is_none());
        }
        outbound.on_ack(&ack(1), ms(2));
        assert_eq!(outbound.acked_view().map(|view| view.size), Some([64, 48]));
    }

    #[test]
    fn moving_frames_are_paced_and_follow_the_link() {
        let mut outbound = outbound();
        let moving = || frame(FrameKind::Moving, 1);
        let (mut now, mut changes) = (ms(10), 0);
        let mut qualities = Vec::new();
        for seq in 1..=12 {
            outbound.on_input(now);
            assert!(wants_frame(&mut outbound, now));
            let request = take(&mut outbound, moving(), now).expect("moving frames always go out");
            assert_eq!(request.codec, Codec::Jpeg);
            qualities.push(request.quality);
            assert!(finish(&mut outbound, request, 1000, now).is_some_and(|sent| !sent.with_stats));
            assert!(!wants_frame(&mut outbound, now + ms(5)), "no faster than the frame rate");
            // The first round trip is fast, the others are late by 100 ms.
            let round_trip = if seq == 1 { ms(20) } else { ms(120) };
            changes += u32::from(outbound.on_ack(&ack(seq), now + round_trip));
            now += ms(200);
        }
        assert_eq!((qualities[0], qualities[3]), (Quality::Lossy(80), Quality::Lossy(80)));
        assert_eq!((qualities[4], qualities[7]), (Quality::Lossy(72), Quality::Lossy(64)), "three late frames each");
        assert_eq!(changes, 0, "quality first; the renderer need not know");
        for seq in 13..=30 {
            outbound.on_input(now);
            send(&mut outbound, moving(), now);
            changes += u32::from(outbound.on_ack(&ack(seq), now + ms(120)));
            now += ms(200);
        }
        assert!(changes > 0 && outbound.quality().scale() < 1.0, "then resolution, which the renderer must know");
    }

    #[test]
    fn a_view_comes_to_rest_when_inputs_stop() {
        let mut outbound = outbound();
        outbound.on_input(ms(100));
        assert!(outbound.is_moving());
        let rest = ms(100) + StillSchedule::quiet_time(30.0);
        assert!(
            !outbound.on_tick(rest.saturating_sub(ms(1)), ROOM).expect("stays").view_update && outbound.is_moving()
        );
        assert!(outbound.on_tick(rest, ROOM).expect("stays").view_update && !outbound.is_moving());
        assert!(!outbound.on_tick(rest, ROOM).expect("stays").view_update, "once");
    }

    #[test]
    fn stills_go_out_as_samples_grow_fourfold_and_the_last_is_lossless() {
        let mut outbound = outbound();
        let mut sent = Vec::new();
        for samples in 1..=64 {
            let kind = if samples == 64 { FrameKind::Final } else { FrameKind::Still };
            let now = ms(u64::from(samples));
            let Some(request) = take(&mut outbound, frame(kind, samples), now) else { continue };
            sent.push((samples, request.codec, request.quality));
            let delivery = finish(&mut outbound, request, 1000, now).expect("not overtaken");
            assert_eq!(delivery.with_stats, samples == 64, "with stats at once");
            outbound.on_ack(&ack(delivery.seq), now);
        }
        let still = |samples| (samples, Codec::Jpeg, Quality::Lossy(90));
        assert_eq!(sent, [still(1), still(4), still(16), (64, Codec::Webp, Quality::Lossless)]);
    }

    #[test]
    fn a_slow_link_gets_a_lossy_end_and_a_chosen_codec_is_kept() {
        let mut outbound = outbound();
        let large = |samples| Frame { size: [2000, 2000], full_size: [2000, 2000], ..frame(FrameKind::Final, samples) };
        let request = take(&mut outbound, large(1), ms(0)).expect("due");
        finish(&mut outbound, request, 100_000, ms(0));
        outbound.on_ack(&ack(1), ms(1000));
        let request = take(&mut outbound, large(2), ms(1001)).expect("due");
        assert_eq!((request.codec, request.quality), (Codec::Jpeg, Quality::Lossy(95)), "100 kB a second");
        outbound.on_encoding_failed();
        outbound.on_settings(&ViewSettings { codec: Some(settings::Codec::Webp), ..ViewSettings::default() });
        let request = take(&mut outbound, frame(FrameKind::Still, 1), ms(1002)).expect("due");
        assert_eq!((request.codec, request.quality), (Codec::Webp, Quality::Lossy(90)));
    }

    #[test]
    fn frames_that_a_gesture_overtook_are_dropped() {
        let mut outbound = outbound();
        let request = take(&mut outbound, frame(FrameKind::Still, 1), ms(1)).expect("due");
        outbound.on_input(ms(2));
        assert_eq!(finish(&mut outbound, request, 1000, ms(3)), None, "overtaken while it was encoded");
        assert!(!outbound.is_encoding());
        assert!(take(&mut outbound, frame(FrameKind::Final, 64), ms(4)).is_none(), "overtaken in the slot");
        let sent = send(&mut outbound, frame(FrameKind::Moving, 1), ms(5));
        assert_eq!(sent.map(|sent| sent.seq), Some(1), "dropped frames have no number");
    }

    #[test]
    fn requested_stills_are_of_the_present_frame_and_rare() {
        let mut outbound = outbound();
        assert_eq!(outbound.on_still(ms(1)).map_err(|refusal| refusal.code).err(), Some("no_frame"));
        let request = take(&mut outbound, frame(FrameKind::Moving, 1), ms(2)).expect("due");
        assert_eq!(outbound.on_still(ms(3)).map_err(|refusal| refusal.code).err(), Some("busy"), "encoding");
        finish(&mut outbound, request, 1000, ms(4));
        outbound.on_input(ms(5));
        let request = outbound.on_still(ms(6)).expect("there is a frame");
        assert_eq!((request.codec, request.quality), (Codec::Webp, Quality::Lossless));
        let delivery = finish(&mut outbound, request, 1000, ms(7));
        assert_eq!(delivery, Some(Delivery { seq: 2, with_stats: false }), "a gesture does not overtake it");
        outbound.on_ack(&ack(2), ms(8));
        assert_eq!(outbound.on_still(ms(1000)).map_err(|refusal| refusal.code).err(), Some("busy"), "one a second");
        assert!(outbound.on_still(ms(1006)).is_ok());
    }
}
