//! Sessions: one for each scene, opened at the first connection, closed soon after the last one left.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use parking_lot::Mutex;
use surfelcast_protocol::server::ServerMessage;
use surfelcast_protocol::settings::LightPatch;
use surfelcast_renderer::scene::Scene;
use surfelcast_renderer::{SessionKey, ViewKey, ViewState};
use tokio::sync::broadcast;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use crate::http::problem::ApiError;
use crate::lights::LightSet;
use crate::outgoing::Outgoing;
use crate::scene_store::{SceneEntry, SceneMeta};
use crate::state::ServiceState;
use crate::validate::Checked;

/// Broadcasts a slow member may be behind; it is sent the whole state when it is further.
const EVENT_CAPACITY: usize = 16;

/// Why a connection could not join.
#[derive(Debug)]
pub(crate) enum JoinError {
    /// No such session.
    Unknown,
    /// The session has as many members as it may.
    Full(u32),
    /// The scene could not be loaded or the renderer refused it.
    Refused(ApiError),
}

/// All sessions by id.
#[derive(Debug, Default)]
pub(crate) struct Sessions {
    slots: Mutex<HashMap<String, Arc<Slot>>>,
}

/// The place of a session, open or not.
#[derive(Debug)]
struct Slot {
    live: tokio::sync::Mutex<Option<Arc<Live>>>,
    members: AtomicU32,
    /// Lights of the session that was closed here last, with their revision.
    kept: Mutex<Option<(Instant, LightSet, u32)>>,
}

/// An open session.
#[derive(Debug)]
pub(crate) struct Live {
    pub(crate) key: SessionKey,
    pub(crate) scene: Arc<Scene>,
    pub(crate) meta: SceneMeta,
    lights: Mutex<(LightSet, u32)>,
    events: broadcast::Sender<ServerMessage>,
    outgoing: Outgoing,
    /// Cancelled when the session ends while it has members.
    pub(crate) ended: CancellationToken,
}

impl Live {
    /// The session's lights and their revision, as a message.
    pub(crate) fn lights_message(&self) -> ServerMessage {
        let lights = self.lights.lock();
        ServerMessage::Lights { scene_rev: lights.1, state: lights.0.state() }
    }

    /// Revision of scene and lights.
    pub(crate) fn revision(&self) -> u32 {
        self.lights.lock().1
    }

    /// What happens to the session from now on.
    pub(crate) fn subscribe(&self) -> broadcast::Receiver<ServerMessage> {
        self.events.subscribe()
    }

    /// Applies a member's edit and tells everyone. Returns the revision that contains it.
    pub(crate) fn edit_lights(&self, patch: &LightPatch, max_lights: u32) -> Checked<u32> {
        let mut lights = self.lights.lock();
        lights.0.apply(patch, max_lights)?;
        lights.1 += 1;
        // Queued under the lock, so that revisions arrive in order.
        self.outgoing.set_lights(lights.0.session_lights(), lights.1);
        let message = ServerMessage::Lights { scene_rev: lights.1, state: lights.0.state() };
        let _ = self.events.send(message);
        Ok(lights.1)
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

/// Membership of one connection; leaving is dropping it.
#[derive(Debug)]
pub(crate) struct Member {
    pub(crate) live: Arc<Live>,
    slot: Arc<Slot>,
    state: ServiceState,
}

impl Drop for Member {
    fn drop(&mut self) {
        metrics::gauge!("surfelcast_views").decrement(1.0);
        if self.slot.members.fetch_sub(1, Ordering::AcqRel) == 1 {
            let (slot, state) = (Arc::clone(&self.slot), self.state.clone());
            let ended = state.ended().clone();
            drop(tokio::spawn(async move {
                // Not tracked: shutdown need not wait for the grace period.
                tokio::select! {
                    () = tokio::time::sleep(state.config().timeouts.session_grace) => slot.close(&state).await,
                    () = ended.cancelled() => {}
                }
            }));
        }
    }
}

impl Sessions {
    /// Joins the session of that id, opening it when it is closed.
    pub(crate) async fn join(&self, state: &ServiceState, id: &str) -> Result<Member, JoinError> {
        let entry = state.scenes().by_session(id).ok_or(JoinError::Unknown)?;
        let slot = Arc::clone(self.slots.lock().entry(id.to_owned()).or_insert_with(|| Arc::new(Slot::new())));
        let mut live = slot.live.lock().await;
        let limit = state.config().limits.views_per_session;
        if slot.members.load(Ordering::Acquire) >= limit {
            return Err(JoinError::Full(limit));
        }
        let open = if let Some(open) = live.as_ref() {
            Arc::clone(open)
        } else {
            let kept = slot.kept.lock().take();
            let open = open(state, &entry, kept).await.map_err(JoinError::Refused)?;
            *live = Some(Arc::clone(&open));
            open
        };
        slot.members.fetch_add(1, Ordering::AcqRel);
        metrics::gauge!("surfelcast_views").increment(1.0);
        drop(live);
        Ok(Member { live: open, slot, state: state.clone() })
    }

    /// Whether anyone is connected.
    pub(crate) fn has_members(&self, id: &str) -> bool {
        self.slots.lock().get(id).is_some_and(|slot| slot.members.load(Ordering::Acquire) > 0)
    }

    /// Ends the session of a scene that is being deleted.
    pub(crate) async fn end(&self, state: &ServiceState, id: &str) {
        let slot = self.slots.lock().remove(id);
        if let Some(slot) = slot
            && let Some(live) = slot.live.lock().await.take()
        {
            live.ended.cancel();
            close_in_renderer(state, &live).await;
        }
    }
}

impl Slot {
    fn new() -> Self {
        Self { live: tokio::sync::Mutex::default(), members: AtomicU32::new(0), kept: Mutex::default() }
    }

    async fn close(&self, state: &ServiceState) {
        let mut live = self.live.lock().await;
        // Someone may have joined in the meantime; joining holds the same lock.
        if self.members.load(Ordering::Acquire) > 0 {
            return;
        }
        if let Some(open) = live.take() {
            let lights = open.lights.lock().clone();
            *self.kept.lock() = Some((Instant::now(), lights.0, lights.1));
            close_in_renderer(state, &open).await;
        }
    }
}

async fn open(
    state: &ServiceState,
    entry: &Arc<SceneEntry>,
    kept: Option<(Instant, LightSet, u32)>,
) -> Result<Arc<Live>, ApiError> {
    let scene = state.scenes().load(entry).await?;
    let key = state.handle().open_session(Arc::clone(&scene)).await?;
    metrics::gauge!("surfelcast_sessions").increment(1.0);
    let kept = kept.filter(|(at, _, _)| at.elapsed() < state.config().timeouts.resume);
    let is_edited = kept.is_some();
    let lights = kept.map_or_else(|| (LightSet::of_scene(&scene), 1), |(_, lights, revision)| (lights, revision));
    let outgoing = Outgoing::start(state.handle().clone(), key);
    if is_edited {
        outgoing.set_lights(lights.0.session_lights(), lights.1);
    }
    Ok(Arc::new(Live {
        key,
        scene,
        meta: entry.meta.clone(),
        lights: Mutex::new(lights),
        events: broadcast::Sender::new(EVENT_CAPACITY),
        outgoing,
        ended: CancellationToken::new(),
    }))
}

async fn close_in_renderer(state: &ServiceState, live: &Live) {
    metrics::gauge!("surfelcast_sessions").decrement(1.0);
    if let Err(error) = state.handle().close_session(live.key).await {
        tracing::debug!(%error, "session could not be closed");
    }
}
