//! One client: the member of a session that it is, and the view that it sees.
//!
//! The two are apart. The member's half is control: messages in ([`Inbound`]), answers, events and pings out. The
//! view's half is frames: [`View`] renders and encodes, [`Outbound`] decides which of them go out on this socket. Both
//! halves decide without a socket and without a clock; only this file applies what they return.
//!
//! One task owns the connection. Everything that waits has a deadline, and nothing runs while nothing happens: a
//! converged view costs one timer.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::ws::{Message, WebSocket};
use futures_util::StreamExt;
use futures_util::stream::SplitStream;
use surfelcast_protocol::client::Hello;
use surfelcast_protocol::server::{NoticeKind, ServerMessage};
use surfelcast_renderer::{DeviceState, Frame, RendererStatus, ViewState};
use surfelcast_review::Edit;
use surfelcast_review::text::clean_name;
use tokio::sync::{broadcast, watch};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use crate::live::close::CloseReason;
use crate::live::frame::EncodedFrame;
use crate::live::heartbeat::Heartbeat;
use crate::live::inbound::{Effect, Inbound, LightEdit, Received};
use crate::live::outbound::Outbound;
use crate::live::outbox::Outbox;
use crate::live::points::PointQuestions;
use crate::live::refusal::Refusal;
use crate::live::resume::{Resumable, TooSoon};
use crate::live::sent_log::ContainedInput;
use crate::live::view::{EncodeError, View, ViewEvent};
use crate::live::view_settings::ViewSettings;
use crate::live::welcome::welcome;
use crate::random_id::random_id;
use crate::sessions::Member;
use crate::state::ServiceState;

/// A frame being encoded when the server drains may take this long.
const DRAIN_PATIENCE: Duration = Duration::from_secs(1);

/// State of one connection.
#[derive(Debug)]
pub(crate) struct Connection<'a> {
    state: ServiceState,
    outbox: &'a Outbox,
    began: Instant,
    /// Token under which a later connection takes up this view.
    token: String,
    superseded: CancellationToken,
    draining_until: Option<Duration>,
    // The member.
    member: Member,
    inbound: Inbound,
    points: PointQuestions,
    heartbeat: Heartbeat,
    device: DeviceState,
    client: String,
    // The view.
    view: View,
    outbound: Outbound,
    /// The settings of the view, for the connection that resumes it.
    resumable: watch::Sender<ViewSettings>,
}

impl<'a> Connection<'a> {
    /// Opens the view of a client that has introduced itself.
    pub(crate) async fn open(
        state: ServiceState,
        member: Member,
        hello: Hello,
        outbox: &'a Outbox,
    ) -> Result<Self, CloseReason> {
        let status = state.renderer_status();
        let (limits, timeouts) = (state.config().limits, state.config().timeouts);
        let settings = settings_of(&state, &member, &hello, &status)?;
        let token = random_id().map_err(|error| {
            tracing::error!(%error, "no randomness for a resume token");
            CloseReason::Internal
        })?;
        let outbound = Outbound::new(&settings, &hello.caps.codecs, &timeouts);
        let first = view_state(&settings, &outbound, 0);
        let live = Arc::clone(&member.live);
        let view = View::open(state.handle().clone(), state.encoders().clone(), live, first).await?;
        let resumable = watch::Sender::new(settings.clone());
        let superseded = CancellationToken::new();
        let entry = Resumable {
            session: member.live.id().to_string(),
            settings: resumable.subscribe(),
            superseded: superseded.clone(),
        };
        state.resume().insert(token.clone(), entry);
        let mut inbound = Inbound::new(limits, settings, hello.caps.codecs);
        inbound.set_catalogue(Arc::clone(&status.catalogue));
        Ok(Self {
            began: Instant::now(),
            draining_until: None,
            points: PointQuestions::new(state.handle().clone(), member.live.key),
            heartbeat: Heartbeat::new(timeouts.ping),
            device: status.state,
            client: clean_name(&hello.client),
            state,
            outbox,
            token,
            superseded,
            member,
            view,
            outbound,
            inbound,
            resumable,
        })
    }

    /// Serves the client until either side ends it. The token lives on for a while, the view does not.
    pub(crate) async fn run(mut self, stream: &mut SplitStream<WebSocket>) -> CloseReason {
        let Err(reason) = self.serve(stream).await;
        self.state.resume().left(&self.token);
        self.view.close().await;
        reason
    }

    async fn serve(&mut self, stream: &mut SplitStream<WebSocket>) -> Result<Infallible, CloseReason> {
        let mut events = self.member.live.subscribe();
        self.welcome()?;
        let mut status = self.state.handle().status();
        status.mark_changed();
        let draining = self.state.draining().clone();
        let superseded = self.superseded.clone();
        let ended = self.member.live.ended.clone();
        loop {
            self.tick()?;
            let deadline = self.began + self.deadline();
            let has_frame_room = self.outbox.has_frame_room();
            let takes_frames = self.outbound.can_take(self.now(), has_frame_room);
            tokio::select! {
                biased;
                () = superseded.cancelled() => return Err(CloseReason::Superseded),
                () = ended.cancelled() => return Err(CloseReason::SessionEnded),
                () = self.outbox.ended() => return Err(CloseReason::Gone),
                () = draining.cancelled(), if self.draining_until.is_none() => self.begin_drain()?,
                message = stream.next() => self.on_message(message)?,
                Ok(()) = status.changed() => { let now = status.borrow_and_update().clone(); self.on_status(&now)?; }
                event = events.recv() => self.on_session_event(event)?,
                answer = self.points.answer() => self.outbox.control(&answer)?,
                event = self.view.next(takes_frames) => self.on_view_event(event)?,
                () = self.outbox.frame_room(), if !has_frame_room => {}
                () = tokio::time::sleep_until(deadline) => {}
            }
        }
    }

    /// Since the connection began.
    fn now(&self) -> Duration {
        self.began.elapsed()
    }

    /// Everything that the client must know before its first frame.
    fn welcome(&self) -> Result<(), CloseReason> {
        let live = &self.member.live;
        let welcome = welcome(&self.state, live, &self.token);
        tracing::info!(conn = welcome.conn, client = %self.client, scene = %live.record.name, "connected");
        self.outbox.control(&ServerMessage::Welcome(Box::new(welcome)))?;
        self.outbox.control(&live.lights_message())?;
        Ok(())
    }

    /// Does what is due.
    fn tick(&mut self) -> Result<(), CloseReason> {
        let now = self.now();
        let due = self.outbound.on_tick(now, self.outbox.has_frame_room())?;
        if due.view_update {
            self.update_view();
        }
        if due.frame {
            self.view.request_frame();
        }
        if self.heartbeat.on_tick(now)? {
            self.outbox.control(&ServerMessage::Ping { ts: self.state.server_ms() })?;
        }
        if due.stats {
            self.send_stats(now)?;
        }
        match self.draining_until {
            Some(until) if now >= until || !self.outbound.is_encoding() => Err(CloseReason::Stopping),
            _ => Ok(()),
        }
    }

    /// When [`Connection::tick`] has something to do if nothing happens before.
    fn deadline(&self) -> Duration {
        let now = self.now();
        let frames = self.outbound.deadline(now, self.outbox.has_frame_room());
        let next = [frames, self.draining_until].into_iter().flatten().fold(self.heartbeat.deadline(), Duration::min);
        // A deadline in the past would spin: what is due was done in `tick`, the rest can wait a moment.
        next.max(now + Duration::from_millis(1))
    }

    fn on_message(&mut self, message: Option<Result<Message, axum::Error>>) -> Result<(), CloseReason> {
        let message = match message {
            None | Some(Ok(Message::Close(_))) => return Err(CloseReason::Gone),
            Some(Err(error)) => return Err(CloseReason::of_socket_error(&error)),
            Some(Ok(message)) => message,
        };
        self.heartbeat.on_message();
        let now = self.now();
        let received = self.inbound.receive(&message, now);
        self.apply(received, now)
    }

    fn apply(&mut self, received: Received, now: Duration) -> Result<(), CloseReason> {
        let Received { id, effect } = received;
        let done = match effect {
            Effect::Nothing => return Ok(()),
            Effect::Close(reason) => return Err(reason),
            Effect::Pinged { ts } => {
                self.outbox.control(&ServerMessage::Pong { ts, server_ms: self.state.server_ms() })?;
                return Ok(());
            }
            Effect::Acked(ack) => {
                if self.outbound.on_ack(&ack, now) {
                    self.update_view();
                }
                return Ok(());
            }
            Effect::PointAsked(question, point) => {
                match self.points.ask(question, self.outbound.acked_view(), point, id) {
                    // Answered when the renderer has looked.
                    Ok(()) => return Ok(()),
                    Err(refusal) => Err(refusal),
                }
            }
            Effect::Moved => {
                metrics::counter!("surfelcast_inputs_total", "kind" => "camera").increment(1);
                self.outbound.start();
                self.outbound.on_input(now);
                self.settings_changed();
                Ok(())
            }
            Effect::ViewChanged => {
                self.outbound.on_settings(self.inbound.settings());
                self.settings_changed();
                Ok(())
            }
            Effect::LightEdit(edit) => self.edit_lights(edit, now),
            Effect::StillWanted => self.outbound.on_still(now).map(|request| self.view.encode(request)),
            Effect::Refused(refusal) => Err(refusal),
        };
        match (done, id) {
            (Ok(()), Some(re)) => self.outbox.control(&ServerMessage::Ok { re })?,
            (Ok(()), None) => {}
            (Err(refusal), re) => self.outbox.control(&refusal.message(re))?,
        }
        Ok(())
    }

    fn edit_lights(&mut self, edit: LightEdit, now: Duration) -> Result<(), Refusal> {
        self.member.live.edit(&Edit::Lights(*edit.patch)).map_err(Refusal::invalid)?;
        metrics::counter!("surfelcast_inputs_total", "kind" => "light").increment(1);
        self.inbound.light_edited(edit.seq, now);
        self.outbound.on_input(now);
        self.update_view();
        Ok(())
    }

    fn settings_changed(&self) {
        self.resumable.send_replace(self.inbound.settings().clone());
        self.update_view();
    }

    /// Sends the renderer the newest state of the view.
    fn update_view(&self) {
        let state = view_state(self.inbound.settings(), &self.outbound, self.inbound.last_seq());
        self.view.update(state);
    }

    fn on_status(&mut self, status: &RendererStatus) -> Result<(), CloseReason> {
        self.inbound.set_catalogue(Arc::clone(&status.catalogue));
        let before = std::mem::replace(&mut self.device, status.state);
        match (before, status.state) {
            (_, DeviceState::Failed) => return Err(CloseReason::DeviceLost),
            (DeviceState::Ready, DeviceState::Lost) => {
                self.notify(NoticeKind::DeviceLost, "the render device was lost and is being rebuilt".into())?;
            }
            (DeviceState::Lost, DeviceState::Ready) => {
                self.notify(NoticeKind::Restored, format!("the render device is back (epoch {})", status.epoch))?;
                self.outbound.on_restored();
            }
            _ => {}
        }
        Ok(())
    }

    fn on_session_event(&self, event: Result<ServerMessage, broadcast::error::RecvError>) -> Result<(), CloseReason> {
        // Events are whole states, so one sent now makes up for any number missed. The sender lives in the session, so
        // the channel cannot be closed while this connection is a member.
        let message = event.unwrap_or_else(|_| self.member.live.lights_message());
        self.outbox.control(&message)?;
        Ok(())
    }

    fn on_view_event(&mut self, event: ViewEvent) -> Result<(), CloseReason> {
        match event {
            ViewEvent::Frame(frame) => self.on_frame(&frame),
            ViewEvent::Encoded(Ok(encoded)) => return self.on_encoded(&encoded),
            ViewEvent::Encoded(Err(error)) => {
                match error {
                    EncodeError::Stream(error) => tracing::warn!(%error, "frame could not be encoded"),
                    EncodeError::Panicked(error) => tracing::error!(%error, "an encoder panicked"),
                }
                self.outbound.on_encoding_failed();
            }
            ViewEvent::Closed => return Err(CloseReason::ViewClosed),
        }
        Ok(())
    }

    fn on_frame(&mut self, frame: &Arc<Frame>) {
        metrics::histogram!("surfelcast_frame_render_seconds").record(f64::from(frame.render_secs));
        metrics::histogram!("surfelcast_frame_queue_seconds").record(frame.finished_at.elapsed().as_secs_f64());
        if let Some(request) = self.outbound.on_frame(frame, self.now()) {
            self.view.encode(request);
        }
    }

    fn on_encoded(&mut self, encoded: &EncodedFrame) -> Result<(), CloseReason> {
        metrics::histogram!("surfelcast_encode_seconds").record(encoded.encode_secs);
        let now = self.now();
        let seq = encoded.frame.input_seq;
        let input = ContainedInput { camera: self.inbound.camera_of(seq), arrived_at: self.inbound.arrived_at(seq) };
        let Some(delivery) = self.outbound.on_encoded(encoded, input, now) else { return Ok(()) };
        let header = encoded.header(delivery.seq, self.state.server_us());
        self.outbox.frame(&header, encoded.payload.clone())?;
        if delivery.with_stats {
            self.send_stats(now)?;
        }
        Ok(())
    }

    /// Tells the client how it is being served.
    fn send_stats(&mut self, now: Duration) -> Result<(), CloseReason> {
        if let Some(stats) = self.outbound.stats(now) {
            self.outbox.control(&ServerMessage::Stats(Box::new(stats)))?;
        }
        Ok(())
    }

    fn begin_drain(&mut self) -> Result<(), CloseReason> {
        self.draining_until = Some(self.now() + DRAIN_PATIENCE);
        self.outbound.drain();
        self.notify(NoticeKind::Draining, "the server is stopping; it can be resumed when it is back".into())
    }

    fn notify(&self, kind: NoticeKind, detail: String) -> Result<(), CloseReason> {
        self.outbox.control(&ServerMessage::Notice { kind, detail })?;
        Ok(())
    }
}

/// The settings that a client begins with: those of the connection that it resumes, or the scene's.
fn settings_of(
    state: &ServiceState,
    member: &Member,
    hello: &Hello,
    status: &RendererStatus,
) -> Result<ViewSettings, CloseReason> {
    let resumed = match &hello.resume {
        Some(token) => state.resume().take(token, member.live.id().as_str()).map_err(|TooSoon| {
            CloseReason::ResumedTooSoon { least_ms: state.config().timeouts.reconnect.as_millis() }
        })?,
        None => None,
    };
    let Some(resumed) = resumed else {
        let technique = status.catalogue.techniques.first().map_or("", |technique| technique.id);
        let max_pixels = hello.caps.max_px.unwrap_or(u64::MAX);
        return Ok(ViewSettings::of_scene(&member.live.scene, technique, max_pixels));
    };
    metrics::counter!("surfelcast_resumes_total").increment(1);
    let settings = resumed.settings.borrow().clone();
    // The client may offer other codecs now.
    let codec = settings.codec.filter(|codec| hello.caps.codecs.contains(codec));
    Ok(ViewSettings { codec, ..settings })
}

fn view_state(settings: &ViewSettings, outbound: &Outbound, input_seq: u32) -> ViewState {
    let quality = outbound.quality();
    settings.view_state(outbound.is_moving(), quality.scale(), quality.frames_per_sec(), input_seq)
}
