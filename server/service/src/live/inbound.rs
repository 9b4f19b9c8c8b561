//! Messages of a client: parsed, limited in rate, ordered and checked.
//!
//! No socket, no renderer and no clock: a message and the time of its arrival come in, an [`Effect`] comes out, and the
//! connection applies it. Every input is applied in the order of arrival and none is queued. What the renderer gets is
//! the newest state, so a `move` may replace a `move`, and the `end` of a gesture is what remains.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::ws::Message;
use surfelcast_protocol::client::{Ack, CameraInput, ClientEnvelope, ClientMessage, LightInput, ViewSet};
use surfelcast_protocol::limits::Limits;
use surfelcast_protocol::parse::{ParseError, parse_client};
use surfelcast_protocol::settings::{Codec, LightPatch};
use surfelcast_renderer::Catalogue;
use surfelcast_renderer::scene::Camera;
use surfelcast_review::number::within;

use crate::camera::camera;
use crate::live::close::CloseReason;
use crate::live::input_log::InputLog;
use crate::live::points::PointQuestion;
use crate::live::rate::TokenBucket;
use crate::live::refusal::{Refusal, check_view};
use crate::live::view_settings::ViewSettings;

/// Malformed messages that end a connection.
const MAX_MALFORMED: u32 = 3;
/// Messages of any kind a second, in multiples of the input rate.
const MESSAGES_PER_INPUT: u32 = 4;

/// What the connection has to do in answer to a message.
#[derive(Debug)]
pub(crate) enum Effect {
    /// Nothing: the message only shows that the client is there.
    Nothing,
    /// The camera moved: [`Inbound::settings`] has it.
    Moved,
    /// The settings of the view changed: [`Inbound::settings`] has them.
    ViewChanged,
    /// The session should apply this edit; [`Inbound::light_edited`] follows if it did.
    LightEdit(LightEdit),
    /// The present frame should be sent as a still.
    StillWanted,
    /// The renderer should look at a point, each coordinate in [0, 1], of the frame that the client sees.
    PointAsked(PointQuestion, [f32; 2]),
    /// Frames arrived.
    Acked(Ack),
    /// The client expects a `pong`.
    Pinged {
        /// The client's `ts`.
        ts: f64,
    },
    /// The message is answered with `error`; nothing changed.
    Refused(Refusal),
    /// The connection ends.
    Close(CloseReason),
}

/// An edit of lights whose number is newer than the last.
#[derive(Debug)]
pub(crate) struct LightEdit {
    pub(crate) seq: u32,
    pub(crate) patch: Box<LightPatch>,
}

/// A message as the connection applies it.
#[derive(Debug)]
pub(crate) struct Received {
    /// Id of the request, for the answer.
    pub(crate) id: Option<u64>,
    pub(crate) effect: Effect,
}

/// State of a client's messages: its settings, its inputs and what it may still send.
#[derive(Debug)]
pub(crate) struct Inbound {
    limits: Limits,
    offered: Vec<Codec>,
    catalogue: Arc<Catalogue>,
    settings: ViewSettings,
    inputs: TokenBucket,
    messages: TokenBucket,
    malformed: u32,
    log: InputLog,
}

impl Inbound {
    /// For a client that begins with these settings and decodes the codecs `offered`, best first.
    pub(crate) fn new(limits: Limits, settings: ViewSettings, offered: Vec<Codec>) -> Self {
        Self {
            inputs: TokenBucket::new(limits.inputs_per_sec),
            messages: TokenBucket::new(limits.inputs_per_sec.saturating_mul(MESSAGES_PER_INPUT)),
            malformed: 0,
            log: InputLog::default(),
            catalogue: Arc::default(),
            limits,
            offered,
            settings,
        }
    }

    /// Techniques and outputs that a view may have.
    pub(crate) fn set_catalogue(&mut self, catalogue: Arc<Catalogue>) {
        self.catalogue = catalogue;
    }

    /// Settings of the view, as the client last set them.
    pub(crate) fn settings(&self) -> &ViewSettings {
        &self.settings
    }

    /// Number of the newest input, 0 before the first.
    pub(crate) fn last_seq(&self) -> u32 {
        self.log.last_seq()
    }

    /// The camera of a frame that contains this input.
    pub(crate) fn camera_of(&self, seq: u32) -> Camera {
        self.log.camera_of(seq).unwrap_or(self.settings.camera)
    }

    /// When this input arrived.
    pub(crate) fn arrived_at(&self, seq: u32) -> Option<Duration> {
        self.log.arrived_at(seq)
    }

    /// Takes one message that arrived at `now`, counted from the beginning of the connection.
    pub(crate) fn receive(&mut self, message: &Message, now: Duration) -> Received {
        let (id, effect) = self.effect_of(message, now).unwrap_or_else(|reason| (None, Effect::Close(reason)));
        Received { id, effect }
    }

    /// The session has applied an edit of lights. Its number counts only now, so that a refused edit does not use it.
    pub(crate) fn light_edited(&mut self, seq: u32, now: Duration) {
        self.log.record(seq, now, self.settings.camera);
    }

    fn effect_of(&mut self, message: &Message, now: Duration) -> Result<(Option<u64>, Effect), CloseReason> {
        if !self.messages.take(now) {
            return Err(CloseReason::TooManyMessages);
        }
        let text = match message {
            Message::Text(text) => text,
            Message::Binary(_) => return Err(CloseReason::BinaryMessage),
            // The library answers pings; a pong answers its own.
            Message::Ping(_) | Message::Pong(_) | Message::Close(_) => return Ok((None, Effect::Nothing)),
        };
        let (id, refusal) = match parse_client(text) {
            Ok(ClientEnvelope { id, message }) => {
                let effect = self.handle(message, now)?.unwrap_or_else(Effect::Refused);
                return Ok((id, effect));
            }
            Err(ParseError::Malformed(detail)) => {
                self.malformed += 1;
                if self.malformed >= MAX_MALFORMED {
                    return Err(CloseReason::RepeatedlyMalformed);
                }
                (None, Refusal::new("malformed", detail))
            }
            Err(error @ ParseError::Unsupported { id, .. }) => (id, Refusal::new("unsupported", error.to_string())),
            Err(error @ ParseError::Invalid { id, .. }) => (id, Refusal::new("invalid_message", error.to_string())),
        };
        Ok((id, Effect::Refused(refusal)))
    }

    fn handle(&mut self, message: ClientMessage, now: Duration) -> Result<Result<Effect, Refusal>, CloseReason> {
        let is_input =
            !matches!(message, ClientMessage::Ack(_) | ClientMessage::Ping { .. } | ClientMessage::Pong { .. });
        if is_input && !self.inputs.take(now) {
            return Err(CloseReason::TooManyInputs);
        }
        Ok(match message {
            ClientMessage::Camera(input) => self.on_camera(&input, now),
            ClientMessage::Light(input) => self.on_light(input),
            ClientMessage::ViewSet(set) => self.on_view_set(&set),
            ClientMessage::Still { view } => check_view(view).map(|()| Effect::StillWanted),
            ClientMessage::Ack(ack) => Ok(Effect::Acked(ack)),
            ClientMessage::Pick { view, x, y } => on_point(PointQuestion::Pick, view, [x, y]),
            ClientMessage::Inspect { view, x, y } => on_point(PointQuestion::Inspect, view, [x, y]),
            ClientMessage::Ping { ts } => Ok(Effect::Pinged { ts }),
            ClientMessage::Pong { .. } => Ok(Effect::Nothing),
            ClientMessage::Hello(_) => {
                Err(Refusal::new("unexpected", "hello: was said already; open a new connection"))
            }
        })
    }

    fn on_camera(&mut self, input: &CameraInput, now: Duration) -> Result<Effect, Refusal> {
        check_view(input.view)?;
        let camera = camera("pose", &input.pose).map_err(Refusal::invalid)?;
        self.check_order(input.seq)?;
        self.log.record(input.seq, now, camera);
        self.settings.camera = camera;
        Ok(Effect::Moved)
    }

    fn on_light(&self, input: LightInput) -> Result<Effect, Refusal> {
        self.check_order(input.seq)?;
        Ok(Effect::LightEdit(LightEdit { seq: input.seq, patch: Box::new(input.patch) }))
    }

    fn on_view_set(&mut self, set: &ViewSet) -> Result<Effect, Refusal> {
        check_view(set.view)?;
        self.settings.apply(set, &self.limits, &self.catalogue, &self.offered).map_err(Refusal::invalid)?;
        Ok(Effect::ViewChanged)
    }

    fn check_order(&self, seq: u32) -> Result<(), Refusal> {
        if self.log.accepts(seq) {
            Ok(())
        } else {
            Err(Refusal::new("stale_input", "seq: must be above that of the input before"))
        }
    }
}

fn on_point(question: PointQuestion, view: u16, point: [f32; 2]) -> Result<Effect, Refusal> {
    check_view(view)?;
    within("x", point[0], 0.0, 1.0).map_err(Refusal::invalid)?;
    within("y", point[1], 0.0, 1.0).map_err(Refusal::invalid)?;
    Ok(Effect::PointAsked(question, point))
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    const START: Duration = Duration::ZERO;

    fn inbound() -> Inbound {
        let limits = Limits { inputs_per_sec: 10, ..Limits::default() };
        let mut inbound = Inbound::new(limits, ViewSettings::default(), vec![Codec::Jpeg]);
        inbound.set_catalogue(Arc::new(crate::test_catalogue::catalogue()));
        inbound
    }

    fn receive(inbound: &mut Inbound, message: &Value, now: Duration) -> Received {
        inbound.receive(&Message::text(message.to_string()), now)
    }

    fn camera_at(x: f64, seq: u32, phase: &str) -> Value {
        let pose = json!({"eye": [x, 1.0, 5.0], "target": [0, 0, 0], "up": [0, 1, 0], "vfov_deg": 40});
        json!({"t": "camera", "seq": seq, "pose": pose, "phase": phase})
    }

    fn refusal(received: Received) -> Refusal {
        match received.effect {
            Effect::Refused(refusal) => refusal,
            effect => panic!("expected a refusal, got {effect:?}"),
        }
    }

    fn close_reason(received: Received) -> String {
        match received.effect {
            Effect::Close(reason) => reason.to_string(),
            effect => panic!("expected a close, got {effect:?}"),
        }
    }

    #[test]
    fn every_input_of_a_gesture_counts_and_the_newest_camera_stands() {
        let mut inbound = inbound();
        for (seq, phase) in [(1, "start"), (2, "move"), (3, "move"), (4, "end"), (5, "start"), (6, "end")] {
            let now = Duration::from_millis(u64::from(seq));
            let received = receive(&mut inbound, &camera_at(f64::from(seq), seq, phase), now);
            assert!(matches!(received.effect, Effect::Moved), "{phase}: {received:?}");
            assert_eq!((inbound.last_seq(), inbound.settings().camera.position.x), (seq, f64::from(seq)));
            assert_eq!(inbound.arrived_at(seq), Some(now), "{phase} keeps a number of its own");
        }
        let xs: Vec<f64> = (1..=6).map(|seq| inbound.camera_of(seq).position.x).collect();
        assert_eq!(xs, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    }

    #[test]
    fn stale_inputs_change_nothing() {
        let mut inbound = inbound();
        receive(&mut inbound, &camera_at(5.0, 5, "end"), START);
        for seq in [5, 4] {
            let mut message = camera_at(4.0, seq, "end");
            message["id"] = json!(8);
            let received = receive(&mut inbound, &message, START);
            assert_eq!(received.id, Some(8));
            assert_eq!(refusal(received).code, "stale_input");
        }
        let light = json!({"t": "light", "seq": 5, "patch": {}, "phase": "end"});
        assert_eq!(refusal(receive(&mut inbound, &light, START)).code, "stale_input");
        assert_eq!((inbound.last_seq(), inbound.settings().camera.position.x), (5, 5.0));
    }

    #[test]
    fn a_light_edit_takes_its_number_once_it_is_applied() {
        let mut inbound = inbound();
        let light = json!({"t": "light", "seq": 1, "patch": {"emissive_strength": 2.0}, "phase": "move"});
        for _ in 0..2 {
            let Effect::LightEdit(edit) = receive(&mut inbound, &light, START).effect else { panic!("an edit") };
            assert_eq!((edit.seq, edit.patch.emissive_strength, inbound.last_seq()), (1, Some(2.0), 0));
        }
        inbound.light_edited(1, START);
        assert_eq!(inbound.last_seq(), 1);
        assert_eq!(refusal(receive(&mut inbound, &light, START)).code, "stale_input");
    }

    #[test]
    fn bad_numbers_are_refused_by_field_and_change_nothing() {
        let mut inbound = inbound();
        let before = inbound.settings().clone();
        let pose = |field: &str, value: Value| {
            let mut message = camera_at(1.0, 1, "end");
            message["pose"][field] = value;
            message
        };
        let messages = [
            (pose("eye", json!([0, 0, 1e300])), "pose.eye"),
            (pose("eye", json!([0, 0, 0])), "pose: eye and target"),
            (pose("up", json!([0, 0, 0])), "pose.up"),
            (pose("vfov_deg", json!(-1)), "pose.vfov_deg"),
            (json!({"t": "view.set", "w": 0}), "w"),
            (json!({"t": "view.set", "fps": 0}), "fps"),
            (json!({"t": "view.set", "codec": "webp"}), "codec"),
            (json!({"t": "view.set", "technique": "warp"}), "technique"),
            (json!({"t": "view.set", "exposure": 1e300}), "exposure"),
            (json!({"t": "pick", "x": 1.5, "y": 0.5}), "x"),
            (json!({"t": "inspect", "x": 0.5, "y": -0.1}), "y"),
            (json!({"t": "still", "view": 1}), "view"),
        ];
        // One message a second, so that the rate does not matter.
        for ((message, field), second) in messages.into_iter().zip(1..) {
            let now = Duration::from_secs(second);
            let refusal = refusal(receive(&mut inbound, &message, now));
            assert!(refusal.detail.starts_with(field), "{message}: {refusal:?}");
        }
        assert_eq!((inbound.settings(), inbound.last_seq()), (&before, 0));
    }

    #[test]
    fn inputs_and_messages_have_rates() {
        let mut inbound = inbound();
        for seq in 1..=10 {
            receive(&mut inbound, &camera_at(1.0, seq, "move"), START);
        }
        assert_eq!(
            close_reason(receive(&mut inbound, &camera_at(1.0, 11, "end"), START)),
            CloseReason::TooManyInputs.to_string()
        );
        let later = Duration::from_millis(100);
        assert!(matches!(receive(&mut inbound, &camera_at(1.0, 12, "end"), later).effect, Effect::Moved));
        // Acknowledgements count as messages and not as inputs.
        let ack = json!({"t": "ack", "seq": 1});
        let mut inbound = self::inbound();
        for _ in 0..40 {
            assert!(matches!(receive(&mut inbound, &ack, START).effect, Effect::Acked(_)));
        }
        assert_eq!(close_reason(receive(&mut inbound, &ack, START)), CloseReason::TooManyMessages.to_string());
        assert_eq!(
            close_reason(inbound.receive(&Message::Ping(Vec::new().into()), START)),
            CloseReason::TooManyMessages.to_string()
        );
    }

    #[test]
    fn unparsable_messages_are_answered_and_the_third_malformed_one_ends_the_connection() {
        let mut inbound = inbound();
        let dance = receive(&mut inbound, &json!({"t": "dance", "id": 3}), START);
        assert_eq!((dance.id, refusal(dance).code), (Some(3), "unsupported"));
        let short = receive(&mut inbound, &json!({"t": "pick", "id": 4}), START);
        assert_eq!((short.id, refusal(short).code), (Some(4), "invalid_message"));
        let hello = json!({"t": "hello", "v": [1], "caps": {"codecs": ["png"]}});
        assert_eq!(refusal(receive(&mut inbound, &hello, START)).code, "unexpected");
        for _ in 1..MAX_MALFORMED {
            assert_eq!(refusal(inbound.receive(&Message::text("{"), START)).code, "malformed");
        }
        assert_eq!(
            close_reason(inbound.receive(&Message::text("{"), START)),
            CloseReason::RepeatedlyMalformed.to_string()
        );
        assert_eq!(
            close_reason(inbound.receive(&Message::binary(vec![1]), START)),
            CloseReason::BinaryMessage.to_string()
        );
    }

    #[test]
    fn requests_become_effects() {
        let mut inbound = inbound();
        let mut effect = |message: Value| receive(&mut inbound, &message, START).effect;
        assert!(matches!(effect(json!({"t": "view.set", "w": 64, "h": 48})), Effect::ViewChanged));
        assert!(matches!(effect(json!({"t": "still"})), Effect::StillWanted));
        let pick = effect(json!({"t": "pick", "x": 0.25, "y": 1}));
        assert!(matches!(pick, Effect::PointAsked(PointQuestion::Pick, [0.25, 1.0])), "{pick:?}");
        let inspect = effect(json!({"t": "inspect", "x": 0, "y": 0.5}));
        assert!(matches!(inspect, Effect::PointAsked(PointQuestion::Inspect, [0.0, 0.5])), "{inspect:?}");
        assert!(matches!(effect(json!({"t": "ping", "ts": 2.5})), Effect::Pinged { ts: 2.5 }));
        assert!(matches!(effect(json!({"t": "pong", "ts": 1})), Effect::Nothing));
        assert_eq!(inbound.settings().size, [64, 48]);
    }
}
