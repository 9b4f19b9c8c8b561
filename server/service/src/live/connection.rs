//! One client and its view: what it sent, what it should see, what is on its way.
//!
//! One task owns the connection. It reads messages, pushes the newest wish to the renderer, takes frames only while
//! they can be sent, has them encoded elsewhere and hands them to the writer. Everything that waits has a deadline, and
//! nothing here runs while nothing happens: a converged view costs one timer.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::ws::{Message, WebSocket};
use futures_util::StreamExt;
use futures_util::stream::SplitStream;
use parking_lot::Mutex;
use surfelcast_protocol::client::Hello;
use surfelcast_protocol::close;
use surfelcast_protocol::server::{NoticeKind, ServerMessage};
use surfelcast_protocol::settings::Codec;
use surfelcast_renderer::scene::Camera;
use surfelcast_renderer::{DeviceState, Frame, FrameSlot, RendererStatus, ViewKey};
use surfelcast_stream::{AckWindow, QualityLoop, StillSchedule};
use tokio::sync::{broadcast, mpsc};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use crate::live::inbound::Inbound;
use crate::live::outbound::{Encoded, Outbound};
use crate::live::outbox::{Outbox, Overflow};
use crate::live::resume::{Resumable, TooSoon};
use crate::live::wishes::Wishes;
use crate::sessions::Member;
use crate::state::ServiceState;
use crate::text::{clean_name, random_id};

/// The first frame waits this long for the client to say its size.
const FIRST_SIZE_PATIENCE: Duration = Duration::from_millis(250);
/// A frame being encoded when the server drains may take this long.
const DRAIN_PATIENCE: Duration = Duration::from_secs(1);
/// Pings without a sign of life that end a connection.
const MISSED_PINGS: u32 = 2;
/// Points of the picture that may be looked at for one client at a time.
pub(crate) const POINT_QUESTIONS: usize = 4;

/// How a connection ends.
#[derive(Debug)]
pub(crate) enum Ending {
    /// With this code and reason.
    Close(u16, String),
    /// Without a word: the socket is gone or does not take one.
    Gone,
}

impl Ending {
    pub(crate) fn close(code: u16, reason: &str) -> Self {
        Self::Close(code, reason.to_owned())
    }

    pub(crate) fn of_socket_error(error: &axum::Error) -> Self {
        // The library's error is boxed twice; its text is the only handle on "message too long".
        if error.to_string().contains("too long") {
            Self::close(close::TOO_BIG, "message: over the size limit in welcome.limits")
        } else {
            Self::Gone
        }
    }
}

impl From<Overflow> for Ending {
    fn from(overflow: Overflow) -> Self {
        tracing::debug!(%overflow, "disconnecting");
        metrics::counter!("surfelcast_closes_total", "code" => "overflow").increment(1);
        Self::Gone
    }
}

/// Whether the view is in a gesture.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Motion {
    pub(crate) is_moving: bool,
    pub(crate) last_input_at: Duration,
}

/// State of one connection.
#[derive(Debug)]
pub(crate) struct Connection {
    pub(crate) state: ServiceState,
    pub(crate) member: Member,
    pub(crate) outbox: Outbox,
    pub(crate) codecs: Vec<Codec>,
    pub(crate) wishes: Arc<Mutex<Wishes>>,
    pub(crate) motion: Motion,
    pub(crate) window: AckWindow,
    pub(crate) quality: QualityLoop,
    pub(crate) stills: StillSchedule,
    pub(crate) inbound: Inbound,
    pub(crate) outbound: Outbound,
    pub(crate) device: DeviceState,
    began: Instant,
    view: ViewKey,
    slot: FrameSlot,
    /// A frame was asked for and has not come.
    is_waiting_for_frame: bool,
    start_at: Duration,
    next_ping: Duration,
    missed_pings: u32,
    draining_until: Option<Duration>,
    pub(crate) token: String,
    superseded: CancellationToken,
}

impl Connection {
    /// Opens the view and greets the client.
    pub(crate) async fn open(
        state: ServiceState,
        member: Member,
        hello: Hello,
        outbox: Outbox,
    ) -> Result<Self, (Outbox, Ending)> {
        let status = state.renderer_status();
        let session = member.live.meta.session_id().to_owned();
        let resumed = match hello.resume.as_deref().map(|token| state.resume().take(token, &session)) {
            Some(Err(TooSoon)) => {
                let least = state.config().timeouts.reconnect.as_millis();
                let reason = format!("hello.resume: come back {least} ms after the last connection began, not before");
                return Err((outbox, Ending::Close(close::RATE, reason)));
            }
            Some(Ok(resumed)) => resumed,
            None => None,
        };
        let wishes = if let Some(resumed) = resumed {
            metrics::counter!("surfelcast_resumes_total").increment(1);
            let wishes = resumed.wishes.lock().clone();
            // The codecs on offer may be others now.
            Wishes { codec: wishes.codec.filter(|codec| hello.caps.codecs.contains(codec)), ..wishes }
        } else {
            let technique = status.techniques.first().map_or("", |technique| technique.id);
            Wishes::of_scene(&member.live.scene, technique, hello.caps.max_px.unwrap_or(u64::MAX))
        };
        let token = match random_id() {
            Ok(token) => token,
            Err(error) => {
                tracing::error!(%error, "no randomness for a resume token");
                return Err((outbox, Ending::close(close::TRY_LATER, "the server failed; its log tells why")));
            }
        };
        let quality = QualityLoop::new(wishes.quality);
        let first = wishes.view_state(false, quality.scale(), quality.frames_per_sec(), 0);
        let slot = FrameSlot::default();
        let opened = state.handle().open_view(member.live.key, first, slot.clone()).await;
        let view = match opened {
            Ok(view) => view,
            Err(error) => return Err((outbox, Ending::of_renderer(error))),
        };
        let wishes = Arc::new(Mutex::new(wishes));
        let superseded = CancellationToken::new();
        state
            .resume()
            .insert(token.clone(), Resumable { session, wishes: Arc::clone(&wishes), superseded: superseded.clone() });
        let next_ping = state.config().timeouts.ping;
        let connection = Self {
            inbound: Inbound::new(&state.config().limits),
            outbound: Outbound::default(),
            device: status.state,
            began: Instant::now(),
            motion: Motion::default(),
            window: AckWindow::default(),
            stills: StillSchedule::default(),
            is_waiting_for_frame: false,
            start_at: FIRST_SIZE_PATIENCE,
            missed_pings: 0,
            draining_until: None,
            codecs: hello.caps.codecs,
            state,
            member,
            outbox,
            wishes,
            quality,
            view,
            slot,
            next_ping,
            token,
            superseded,
        };
        let welcome = connection.welcome(&status);
        let lights = connection.member.live.lights_message();
        let conn = welcome.conn.clone();
        tracing::info!(conn, client = %clean_name(&hello.client), scene = %connection.member.live.meta.name, "connected");
        let sent = connection.outbox.control(&ServerMessage::Welcome(Box::new(welcome)));
        match sent.and_then(|()| connection.outbox.control(&lights)) {
            Ok(()) => Ok(connection),
            Err(overflow) => Err(connection.finish(overflow.into()).await),
        }
    }

    /// Serves the client until either side ends it.
    pub(crate) async fn run(mut self, stream: &mut SplitStream<WebSocket>) -> (Outbox, Ending) {
        let mut events = self.member.live.subscribe();
        let mut status = self.state.handle().status();
        status.mark_changed();
        let (encoded_sender, mut encoded) = mpsc::channel(1);
        let (late_sender, mut late) = mpsc::channel(POINT_QUESTIONS);
        self.outbound.encoded = Some(encoded_sender);
        self.inbound.late = Some(late_sender);
        let draining = self.state.draining().clone();
        let superseded = self.superseded.clone();
        let ended = self.member.live.ended.clone();
        let ending = loop {
            if let Err(ending) = self.tick() {
                break ending;
            }
            let deadline = self.began + self.next_deadline();
            let step = tokio::select! {
                biased;
                () = superseded.cancelled() => Err(Ending::close(close::SUPERSEDED, "a newer connection resumed this view")),
                () = ended.cancelled() => Err(Ending::close(close::ENDED, "the session ended: its scene was deleted")),
                () = self.outbox.ended() => Err(Ending::Gone),
                () = draining.cancelled(), if self.draining_until.is_none() => self.begin_drain(),
                message = stream.next() => self.on_message(message),
                Ok(()) = status.changed() => { let now = status.borrow_and_update().clone(); self.on_status(&now) }
                event = events.recv() => self.on_event(event),
                Some(message) = late.recv() => self.on_late(&message),
                Some(done) = encoded.recv() => self.on_encoded(done),
                () = self.outbox.frame_room(), if !self.outbox.has_frame_room() => Ok(()),
                frame = self.slot.take(), if self.can_take() => self.on_frame(frame),
                () = tokio::time::sleep_until(deadline) => Ok(()),
            };
            if let Err(ending) = step {
                break ending;
            }
        };
        self.finish(ending).await
    }

    /// Since the connection began.
    pub(crate) fn now(&self) -> Duration {
        self.began.elapsed()
    }

    /// Sends the view's state to the renderer.
    pub(crate) fn push_view(&self) {
        let wishes = self.wishes.lock();
        let state = wishes.view_state(
            self.motion.is_moving,
            self.quality.scale(),
            self.quality.frames_per_sec(),
            self.inbound.last_seq(),
        );
        drop(wishes);
        self.member.live.update_view(self.view, state);
    }

    /// The client said how large its view is; the first frame need not wait any more.
    pub(crate) fn start(&mut self) {
        self.start_at = Duration::ZERO;
    }

    /// An input arrived: the view moves until it has been quiet for a while.
    pub(crate) fn moved(&mut self) {
        self.motion = Motion { is_moving: true, last_input_at: self.now() };
        self.stills.restart();
        self.push_view();
    }

    fn quiet_at(&self) -> Duration {
        self.motion.last_input_at + StillSchedule::quiet_time(self.quality.frames_per_sec())
    }

    fn is_silenced(&self) -> bool {
        self.window.silence(self.now()) >= self.state.config().timeouts.ack_stop
    }

    /// Whether a frame taken now could be encoded and sent.
    fn can_take(&self) -> bool {
        !self.outbound.is_encoding()
            && self.outbox.has_frame_room()
            && self.window.has_room(self.quality.frames_per_sec())
            && !self.is_silenced()
            && self.draining_until.is_none()
    }

    /// Earliest time at which the next frame may be asked for; `None` while something else must happen first.
    fn want_at(&self) -> Option<Duration> {
        let frames_per_sec = self.quality.frames_per_sec();
        let coming = self.window.in_flight() + u32::from(self.outbound.is_encoding());
        let has_room = self.window.has_room(frames_per_sec) && coming < self.window.frames(frames_per_sec);
        let is_stopped = self.is_waiting_for_frame || self.draining_until.is_some() || self.is_silenced();
        if is_stopped || !has_room || !self.outbox.has_frame_room() || self.wishes.lock().is_paused {
            return None;
        }
        let paced = if self.motion.is_moving { self.window.next_send_at(frames_per_sec) } else { Duration::ZERO };
        Some(paced.max(self.start_at))
    }

    /// Does what is due.
    fn tick(&mut self) -> Result<(), Ending> {
        let now = self.now();
        let timeouts = self.state.config().timeouts;
        if self.motion.is_moving && now >= self.quiet_at() {
            self.motion.is_moving = false;
            self.push_view();
        }
        if self.want_at().is_some_and(|at| now >= at) {
            self.is_waiting_for_frame = true;
            self.slot.want();
            self.state.handle().wake();
        }
        if self.window.silence(now) >= timeouts.ack_close {
            return Err(Ending::close(close::TOO_SLOW, "ack: none came for too long"));
        }
        if now >= self.next_ping {
            if self.missed_pings >= MISSED_PINGS {
                return Err(Ending::close(close::TOO_SLOW, "ping: no sign of life"));
            }
            self.missed_pings += 1;
            self.next_ping = now + timeouts.ping;
            self.outbox.control(&ServerMessage::Ping { ts: self.state.server_ms() })?;
        }
        if self.outbound.stats_at().is_some_and(|at| now >= at) {
            self.send_stats()?;
        }
        match self.draining_until {
            Some(until) if now >= until || !self.outbound.is_encoding() => {
                Err(Ending::close(close::RESTART, "the server is stopping; come back"))
            }
            _ => Ok(()),
        }
    }

    /// When [`Connection::tick`] has something to do if nothing happens before.
    fn next_deadline(&self) -> Duration {
        let now = self.now();
        let timeouts = &self.state.config().timeouts;
        let mut next = self.next_ping;
        let mut by = |at: Duration| next = next.min(at);
        if self.motion.is_moving {
            by(self.quiet_at());
        }
        if let Some(at) = self.want_at() {
            by(at);
        }
        if self.window.in_flight() > 0 {
            let silence = self.window.silence(now);
            by(now + timeouts.ack_close.saturating_sub(silence));
        }
        if let Some(at) = self.outbound.stats_at() {
            by(at);
        }
        if let Some(until) = self.draining_until {
            by(until);
        }
        // A deadline in the past would spin: what is due was done in `tick`, the rest can wait a moment.
        next.max(now + Duration::from_millis(1))
    }

    fn on_message(&mut self, message: Option<Result<Message, axum::Error>>) -> Result<(), Ending> {
        let message = match message {
            None | Some(Ok(Message::Close(_))) => return Err(Ending::Gone),
            Some(Err(error)) => return Err(Ending::of_socket_error(&error)),
            Some(Ok(message)) => message,
        };
        self.missed_pings = 0;
        self.receive(message)
    }

    fn on_status(&mut self, status: &RendererStatus) -> Result<(), Ending> {
        let before = std::mem::replace(&mut self.device, status.state);
        let notice = |kind, detail: String| ServerMessage::Notice { kind, detail };
        match (before, status.state) {
            (_, DeviceState::Failed) => {
                return Err(Ending::close(close::GPU_LOST, "the render device was lost and did not come back"));
            }
            (DeviceState::Ready, DeviceState::Lost) => {
                let detail = "the render device was lost and is being rebuilt".into();
                self.outbox.control(&notice(NoticeKind::DeviceLost, detail))?;
            }
            (DeviceState::Lost, DeviceState::Ready) => {
                let detail = format!("the render device is back (epoch {})", status.epoch);
                self.outbox.control(&notice(NoticeKind::Restored, detail))?;
                self.stills.restart();
            }
            _ => {}
        }
        Ok(())
    }

    fn on_event(&mut self, event: Result<ServerMessage, broadcast::error::RecvError>) -> Result<(), Ending> {
        // Events are whole states, so one sent now makes up for any number missed. The sender lives in the session, so
        // the channel cannot be closed while this connection is a member.
        let message = event.unwrap_or_else(|_| self.member.live.lights_message());
        self.outbox.control(&message)?;
        Ok(())
    }

    fn on_late(&mut self, message: &ServerMessage) -> Result<(), Ending> {
        self.inbound.points_in_flight = self.inbound.points_in_flight.saturating_sub(1);
        self.outbox.control(message)?;
        Ok(())
    }

    fn on_encoded(&mut self, done: Encoded) -> Result<(), Ending> {
        self.encoded(done)
    }

    fn on_frame(&mut self, frame: Option<Arc<Frame>>) -> Result<(), Ending> {
        self.is_waiting_for_frame = false;
        match frame {
            Some(frame) => {
                self.taken(&frame);
                Ok(())
            }
            None => Err(Ending::close(close::ENDED, "the view was closed by the renderer")),
        }
    }

    fn begin_drain(&mut self) -> Result<(), Ending> {
        self.draining_until = Some(self.now() + DRAIN_PATIENCE);
        let detail = "the server is stopping; it can be resumed when it is back".into();
        self.outbox.control(&ServerMessage::Notice { kind: NoticeKind::Draining, detail })?;
        Ok(())
    }

    /// Leaves: the token lives on for a while, the view does not.
    async fn finish(self, ending: Ending) -> (Outbox, Ending) {
        self.state.resume().left(&self.token);
        self.member.live.remove_view(self.view);
        if let Err(error) = self.state.handle().close_view(self.view).await {
            tracing::debug!(%error, "view could not be closed");
        }
        (self.outbox, ending)
    }

    /// The camera of a frame that contains this input.
    pub(crate) fn camera_of(&self, input_seq: u32) -> Camera {
        self.inbound.camera_of(input_seq).unwrap_or_else(|| self.wishes.lock().camera)
    }
}

/// The newest few of something, oldest first.
pub(crate) fn push_bounded<T>(queue: &mut VecDeque<T>, item: T, capacity: usize) {
    while queue.len() >= capacity.max(1) {
        queue.pop_front();
    }
    queue.push_back(item);
}
