//! What a client may say, and what it does.

use std::collections::VecDeque;
use std::time::Duration;

use axum::extract::ws::Message;
use surfelcast_protocol::client::{Ack, CameraInput, ClientEnvelope, ClientMessage, LightInput, ViewSet};
use surfelcast_protocol::close;
use surfelcast_protocol::limits::Limits;
use surfelcast_protocol::parse::{ParseError, parse_client};
use surfelcast_protocol::server::ServerMessage;
use surfelcast_renderer::scene::Camera;
use surfelcast_stream::Stage;
use tokio::sync::mpsc;

use crate::live::connection::{Connection, Ending, push_bounded};
use crate::live::points::PointQuestion;
use crate::live::rate::TokenBucket;
use crate::validate::camera;

/// Messages that are no messages, until the connection ends.
const MAX_MALFORMED: u32 = 3;
/// Messages of any kind a second, in multiples of the input rate.
const MESSAGES_PER_INPUT: u32 = 4;
/// Inputs remembered for telling which camera a frame shows; more than a second's worth.
const INPUT_LOG: usize = 256;
/// Least time between two stills asked for.
const STILL_INTERVAL: Duration = Duration::from_secs(1);

/// The one view of a connection.
const VIEW: u16 = 0;

#[derive(Clone, Copy, Debug)]
struct Input {
    seq: u32,
    at: Duration,
    camera: Camera,
}

/// What is remembered of a client's messages.
#[derive(Debug)]
pub(crate) struct Inbound {
    inputs: TokenBucket,
    messages: TokenBucket,
    malformed: u32,
    log: VecDeque<Input>,
    last_still_at: Option<Duration>,
    /// Points that the renderer is looking at.
    pub(crate) points_in_flight: usize,
    pub(crate) late: Option<mpsc::Sender<ServerMessage>>,
}

impl Inbound {
    pub(crate) fn new(limits: &Limits) -> Self {
        Self {
            inputs: TokenBucket::new(limits.inputs_per_sec),
            messages: TokenBucket::new(limits.inputs_per_sec.saturating_mul(MESSAGES_PER_INPUT)),
            malformed: 0,
            log: VecDeque::new(),
            last_still_at: None,
            points_in_flight: 0,
            late: None,
        }
    }

    /// Number of the newest input, 0 before the first.
    pub(crate) fn last_seq(&self) -> u32 {
        self.log.back().map_or(0, |input| input.seq)
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
        self.log.iter().rev().find(|input| !is_after(input.seq, seq))
    }

    /// Records an input; false when it is no newer than the last.
    fn record(&mut self, seq: u32, at: Duration, camera: Camera) -> bool {
        if self.log.back().is_some_and(|last| !is_after(seq, last.seq)) {
            return false;
        }
        push_bounded(&mut self.log, Input { seq, at, camera }, INPUT_LOG);
        true
    }
}

/// Serial-number arithmetic: numbers wrap.
fn is_after(a: u32, b: u32) -> bool {
    let ahead = a.wrapping_sub(b);
    ahead != 0 && ahead < 1 << 31
}

/// Why a request was refused; the connection stays.
pub(crate) struct Refusal {
    pub(crate) code: &'static str,
    pub(crate) detail: String,
}

pub(crate) fn invalid(detail: String) -> Refusal {
    Refusal { code: "invalid_value", detail }
}

impl Connection {
    /// Handles one message. `Err` ends the connection.
    pub(crate) fn receive(&mut self, message: Message) -> Result<(), Ending> {
        let now = self.now();
        if !self.inbound.messages.take(now) {
            return Err(Ending::close(close::RATE, "messages: too many a second"));
        }
        let text = match message {
            Message::Text(text) => text,
            Message::Binary(_) => return Err(Ending::close(close::MALFORMED, "binary messages are the server's")),
            // Answered by the library, or an answer to its own.
            Message::Ping(_) | Message::Pong(_) | Message::Close(_) => return Ok(()),
        };
        match parse_client(&text) {
            Ok(envelope) => self.obey(envelope, now),
            Err(ParseError::Malformed(detail)) => {
                self.inbound.malformed += 1;
                if self.inbound.malformed >= MAX_MALFORMED {
                    return Err(Ending::close(close::MALFORMED, "control message: repeatedly malformed"));
                }
                self.answer_error(None, "malformed", detail)
            }
            Err(error @ ParseError::Unsupported { id, .. }) => self.answer_error(id, "unsupported", error.to_string()),
            Err(error @ ParseError::Invalid { id, .. }) => self.answer_error(id, "invalid_message", error.to_string()),
        }
    }

    fn answer_error(&self, re: Option<u64>, code: &str, detail: String) -> Result<(), Ending> {
        self.outbox.control(&ServerMessage::Error { re, code: code.into(), detail })?;
        Ok(())
    }

    fn obey(&mut self, envelope: ClientEnvelope, now: Duration) -> Result<(), Ending> {
        let ClientEnvelope { id, message } = envelope;
        let is_input =
            !matches!(message, ClientMessage::Ack(_) | ClientMessage::Ping { .. } | ClientMessage::Pong { .. });
        if is_input && !self.inbound.inputs.take(now) {
            return Err(Ending::close(close::RATE, "inputs: more a second than welcome.limits.inputs_per_sec"));
        }
        let done = match message {
            ClientMessage::Camera(input) => self.on_camera(&input, now),
            ClientMessage::Light(input) => self.on_light(&input, now),
            ClientMessage::ViewSet(set) => self.on_view_set(&set),
            ClientMessage::Still { view } => self.on_still(view, now),
            ClientMessage::Ack(ack) => {
                self.on_ack(&ack, now);
                return Ok(());
            }
            ClientMessage::Pick { view, x, y } => match self.on_point(PointQuestion::Pick, id, view, [x, y]) {
                // Answered by `picked` when the renderer has looked.
                Ok(()) => return Ok(()),
                Err(refusal) => Err(refusal),
            },
            ClientMessage::Inspect { view, x, y } => match self.on_point(PointQuestion::Inspect, id, view, [x, y]) {
                // Answered by `inspected`.
                Ok(()) => return Ok(()),
                Err(refusal) => Err(refusal),
            },
            ClientMessage::Ping { ts } => {
                let pong = ServerMessage::Pong { ts, server_ms: self.state.server_ms() };
                self.outbox.control(&pong)?;
                return Ok(());
            }
            // Every message is a sign of life; this one is nothing else.
            ClientMessage::Pong { .. } => return Ok(()),
            ClientMessage::Hello(_) => {
                Err(Refusal { code: "unexpected", detail: "hello: was said already; open a new connection".into() })
            }
        };
        match (done, id) {
            (Ok(()), Some(re)) => self.outbox.control(&ServerMessage::Ok { re })?,
            (Ok(()), None) => {}
            (Err(refusal), re) => self.answer_error(re, refusal.code, refusal.detail)?,
        }
        Ok(())
    }

    fn on_camera(&mut self, input: &CameraInput, now: Duration) -> Result<(), Refusal> {
        check_view(input.view)?;
        let camera = camera("pose", "eye", &input.pose).map_err(invalid)?;
        if !self.inbound.record(input.seq, now, camera) {
            return Err(stale());
        }
        metrics::counter!("surfelcast_inputs_total", "kind" => "camera").increment(1);
        self.wishes.lock().camera = camera;
        self.start();
        self.moved();
        Ok(())
    }

    fn on_light(&mut self, input: &LightInput, now: Duration) -> Result<(), Refusal> {
        let camera = self.wishes.lock().camera;
        let max_lights = self.state.config().limits.max_lights;
        // Numbered only once the edit is accepted, lest a refused one spends the number.
        if self.inbound.log.back().is_some_and(|last| !is_after(input.seq, last.seq)) {
            return Err(stale());
        }
        self.member.live.edit_lights(&input.patch, max_lights).map_err(invalid)?;
        self.inbound.record(input.seq, now, camera);
        metrics::counter!("surfelcast_inputs_total", "kind" => "light").increment(1);
        self.moved();
        Ok(())
    }

    fn on_view_set(&mut self, set: &ViewSet) -> Result<(), Refusal> {
        check_view(set.view)?;
        let status = self.state.renderer_status();
        let techniques: Vec<&str> = status.techniques.iter().map(|technique| technique.id).collect();
        let quality = {
            let mut wishes = self.wishes.lock();
            wishes.apply(set, &self.state.config().limits, &techniques, &self.codecs).map_err(invalid)?;
            wishes.quality
        };
        self.quality.set_limits(quality);
        self.stills.restart();
        self.start();
        self.push_view();
        Ok(())
    }

    fn on_still(&mut self, view: u16, now: Duration) -> Result<(), Refusal> {
        check_view(view)?;
        let busy = |detail: &str| Refusal { code: "busy", detail: detail.into() };
        if self.inbound.last_still_at.is_some_and(|at| now.saturating_sub(at) < STILL_INTERVAL) {
            return Err(busy("still: at most one a second"));
        }
        if self.outbound.is_encoding() || !self.window.has_room(self.quality.frames_per_sec()) {
            return Err(busy("still: frames are on their way; ask again when they have arrived"));
        }
        let Some(frame) = self.outbound.last_frame() else {
            return Err(Refusal { code: "no_frame", detail: "still: there is no picture yet".into() });
        };
        self.inbound.last_still_at = Some(now);
        self.begin_encoding(frame, Stage::Final, true);
        Ok(())
    }

    fn on_ack(&mut self, ack: &Ack, now: Duration) {
        let was_silent = self.window.silence(now) >= self.state.config().timeouts.ack_stop;
        let decode = Duration::from_micros(u64::from(ack.decode_us));
        let acked = if ack.view == VIEW { self.window.acked(ack.seq, decode, now).ok() } else { None };
        let Some(acked) = acked else {
            metrics::counter!("surfelcast_acks_ignored_total").increment(1);
            return;
        };
        if was_silent {
            metrics::counter!("surfelcast_acks_late_total").increment(1);
        }
        if let Some(time) = acked.round_trip {
            metrics::histogram!("surfelcast_round_trip_seconds").record(time.as_secs_f64());
        }
        let Some(shown) = self.outbound.acknowledged(ack.seq) else { return };
        if let Some(at) = shown.input_at {
            let latency = now.saturating_sub(at);
            metrics::histogram!("surfelcast_input_to_ack_seconds").record(latency.as_secs_f64());
        }
        // Stills are large on purpose; only moving pictures tell whether the link keeps up with them.
        if let (Stage::Moving, Some(delay)) = (shown.stage, acked.queue_delay) {
            let before = (self.quality.scale(), self.quality.frames_per_sec());
            self.quality.on_ack(delay);
            if before != (self.quality.scale(), self.quality.frames_per_sec()) {
                self.push_view();
            }
        }
    }
}

pub(crate) fn check_view(view: u16) -> Result<(), Refusal> {
    if view == VIEW {
        return Ok(());
    }
    Err(Refusal {
        code: "unknown_view",
        detail: "view: a connection has the one view 0; open another connection".into(),
    })
}

fn stale() -> Refusal {
    Refusal { code: "stale_input", detail: "seq: must be above that of the input before".into() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::wishes::Wishes;

    #[test]
    fn serial_numbers_wrap() {
        assert!(is_after(1, 0) && is_after(0, u32::MAX) && is_after(5, u32::MAX - 5));
        assert!(!is_after(0, 0) && !is_after(0, 1) && !is_after(u32::MAX, 0));
    }

    #[test]
    fn frames_find_their_camera() {
        let mut inbound = Inbound::new(&Limits::default());
        let base = Wishes::default().camera;
        let at = |x: f64| Camera { position: glam::DVec3::new(x, 0.0, 1.0), ..base };
        assert_eq!(inbound.camera_of(1), None);
        for seq in [1, 3, 4] {
            assert!(inbound.record(seq, Duration::from_millis(u64::from(seq)), at(f64::from(seq))));
        }
        assert!(!inbound.record(4, Duration::ZERO, base) && !inbound.record(2, Duration::ZERO, base));
        assert_eq!(inbound.camera_of(2).map(|c| c.position.x), Some(1.0));
        assert_eq!(inbound.camera_of(9).map(|c| c.position.x), Some(4.0));
        assert_eq!((inbound.arrived_at(3), inbound.arrived_at(2)), (Some(Duration::from_millis(3)), None));
        for seq in 5..5000 {
            inbound.record(seq, Duration::ZERO, base);
        }
        assert_eq!((inbound.log.len(), inbound.last_seq()), (INPUT_LOG, 4999));
    }
}
