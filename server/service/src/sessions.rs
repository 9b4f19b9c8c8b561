//! Open sessions: opened when the first member joins, closed soon after the last one has left.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use parking_lot::Mutex;
use surfelcast_protocol::limits::Limits;
use surfelcast_protocol::server::ServerMessage;
use surfelcast_renderer::scene::{Scene, SceneEdit};
use surfelcast_renderer::{RendererHandle, SessionKey, ViewKey, ViewState};
use surfelcast_review::{Edit, ReviewError, Session, SessionId};
use surfelcast_store::SceneRecord;
use tokio::sync::broadcast;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use crate::config::ServiceConfig;
use crate::error::DomainError;
use crate::outgoing::Outgoing;
use crate::scene_library::{SceneEntry, SceneLibrary};
use crate::scene_lights::{light_set_of, light_state_of};

/// Broadcasts that a slow member may be behind; a member that is further behind is sent the whole state.
const EVENT_CAPACITY: usize = 16;

/// All sessions by id. Cheap to clone.
#[derive(Clone, Debug)]
pub(crate) struct Sessions(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    handle: RendererHandle,
    library: Arc<SceneLibrary>,
    limits: Limits,
    /// A session stays open for this time after its last member has left.
    grace: Duration,
    /// A closed session keeps its edits for this time.
    keep: Duration,
    ended: CancellationToken,
    slots: Mutex<HashMap<SessionId, Arc<Slot>>>,
}

/// The place of a session, open or not.
#[derive(Debug, Default)]
struct Slot {
    live: tokio::sync::Mutex<Option<Arc<Live>>>,
    members: AtomicU32,
    /// The session that was closed here last, and when.
    closed: Mutex<Option<(Instant, Session)>>,
}

/// An open session.
#[derive(Debug)]
pub(crate) struct Live {
    pub(crate) key: SessionKey,
    pub(crate) scene: Arc<Scene>,
    pub(crate) record: SceneRecord,
    id: SessionId,
    limits: Limits,
    session: Mutex<Session>,
    events: broadcast::Sender<ServerMessage>,
    outgoing: Outgoing,
    /// Cancelled when the session ends while it has members.
    pub(crate) ended: CancellationToken,
}

impl Live {
    pub(crate) fn id(&self) -> &SessionId {
        &self.id
    }

    /// The session's lights and their revision, as a message.
    pub(crate) fn lights_message(&self) -> ServerMessage {
        lights_message(&self.session.lock())
    }

    /// Number of the session's last edit.
    pub(crate) fn revision(&self) -> u32 {
        self.session.lock().revision()
    }

    /// What happens to the session from now on.
    pub(crate) fn subscribe(&self) -> broadcast::Receiver<ServerMessage> {
        self.events.subscribe()
    }

    /// Applies a member's edit and sends its outcome to the renderer and to every member. Returns the revision that
    /// contains it.
    pub(crate) fn edit(&self, edit: &Edit) -> Result<u32, ReviewError> {
        let mut session = self.session.lock();
        let revision = session.apply(edit, &self.limits)?;
        // Queued under the lock, so that revisions arrive in order.
        self.outgoing.edit_scene(SceneEdit::Lights(light_state_of(session.lights(), self.scene.origin)), revision);
        let _ = self.events.send(lights_message(&session));
        Ok(revision)
    }

    /// Sends a view's state to the renderer, after the edits that were made before it.
    pub(crate) fn update_view(&self, view: ViewKey, state: ViewState) {
        self.outgoing.set_view(view, state);
    }

    /// Drops what is still to be sent of a view that is being closed.
    pub(crate) fn remove_view(&self, view: ViewKey) {
        self.outgoing.remove_view(view);
    }
}

fn lights_message(session: &Session) -> ServerMessage {
    ServerMessage::Lights { scene_rev: session.revision(), state: session.lights().state() }
}

/// Membership of one connection; leaving is dropping it.
#[derive(Debug)]
pub(crate) struct Member {
    pub(crate) live: Arc<Live>,
    slot: Arc<Slot>,
    sessions: Sessions,
}

impl Drop for Member {
    fn drop(&mut self) {
        metrics::gauge!("surfelcast_views").decrement(1.0);
        if self.slot.members.fetch_sub(1, Ordering::AcqRel) == 1 {
            let (slot, sessions) = (Arc::clone(&self.slot), self.sessions.clone());
            drop(tokio::spawn(async move {
                // Not tracked: shutdown need not wait for the grace period.
                tokio::select! {
                    () = tokio::time::sleep(sessions.0.grace) => sessions.close_if_empty(&slot).await,
                    () = sessions.0.ended.cancelled() => {}
                }
            }));
        }
    }
}

impl Sessions {
    /// No session is open. `ended` is cancelled when the service has stopped.
    pub(crate) fn new(
        handle: RendererHandle,
        library: Arc<SceneLibrary>,
        config: &ServiceConfig,
        ended: CancellationToken,
    ) -> Self {
        Self(Arc::new(Inner {
            handle,
            library,
            limits: config.limits,
            grace: config.timeouts.session_grace,
            keep: config.timeouts.resume,
            ended,
            slots: Mutex::default(),
        }))
    }

    /// Joins the session of that id, opening it when it is closed.
    pub(crate) async fn join(&self, id: &str) -> Result<Member, DomainError> {
        let entry = self.0.library.by_session(id).ok_or(DomainError::UnknownSession)?;
        let slot = Arc::clone(self.0.slots.lock().entry(entry.session.clone()).or_default());
        let mut live = slot.live.lock().await;
        let limit = self.0.limits.views_per_session;
        if slot.members.load(Ordering::Acquire) >= limit {
            return Err(DomainError::SessionFull { limit });
        }
        let open = if let Some(open) = live.as_ref() {
            Arc::clone(open)
        } else {
            let closed = slot.closed.lock().take();
            let open = self.open(&entry, closed).await?;
            *live = Some(Arc::clone(&open));
            open
        };
        slot.members.fetch_add(1, Ordering::AcqRel);
        metrics::gauge!("surfelcast_views").increment(1.0);
        drop(live);
        Ok(Member { live: open, slot, sessions: self.clone() })
    }

    /// Whether the session has members.
    pub(crate) fn has_members(&self, id: &SessionId) -> bool {
        self.0.slots.lock().get(id).is_some_and(|slot| slot.members.load(Ordering::Acquire) > 0)
    }

    /// Ends the session of a scene that is being deleted.
    pub(crate) async fn end(&self, id: &SessionId) {
        let slot = self.0.slots.lock().remove(id);
        if let Some(slot) = slot
            && let Some(live) = slot.live.lock().await.take()
        {
            live.ended.cancel();
            self.close_in_renderer(&live).await;
        }
    }

    async fn open(
        &self,
        entry: &Arc<SceneEntry>,
        closed: Option<(Instant, Session)>,
    ) -> Result<Arc<Live>, DomainError> {
        let scene = self.0.library.load(entry).await?;
        let key = self.0.handle.open_session(Arc::clone(&scene)).await?;
        metrics::gauge!("surfelcast_sessions").increment(1.0);
        let outgoing = Outgoing::start(self.0.handle.clone(), key);
        let session = match closed.filter(|(at, _)| at.elapsed() < self.0.keep) {
            Some((_, session)) => {
                outgoing
                    .edit_scene(SceneEdit::Lights(light_state_of(session.lights(), scene.origin)), session.revision());
                session
            }
            None => Session::new(entry.session.clone(), entry.record.id.clone(), light_set_of(&scene)),
        };
        Ok(Arc::new(Live {
            key,
            scene,
            record: entry.record.clone(),
            id: session.id().clone(),
            limits: self.0.limits,
            session: Mutex::new(session),
            events: broadcast::Sender::new(EVENT_CAPACITY),
            outgoing,
            ended: CancellationToken::new(),
        }))
    }

    async fn close_if_empty(&self, slot: &Slot) {
        let mut live = slot.live.lock().await;
        // Someone may have joined in the meantime; joining holds the same lock.
        if slot.members.load(Ordering::Acquire) > 0 {
            return;
        }
        if let Some(open) = live.take() {
            *slot.closed.lock() = Some((Instant::now(), open.session.lock().clone()));
            self.close_in_renderer(&open).await;
        }
    }

    async fn close_in_renderer(&self, live: &Live) {
        metrics::gauge!("surfelcast_sessions").decrement(1.0);
        if let Err(error) = self.0.handle.close_session(live.key).await {
            tracing::debug!(%error, "session could not be closed");
        }
    }
}
