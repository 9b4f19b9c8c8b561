//! One queue for each session of what the renderer has still to be sent.
//!
//! It holds at most one scene edit and one state for each view: a newer value replaces an older one of the same key,
//! since the renderer needs only the last. The scene edit goes first. A view's state that counts on an edit was queued
//! after it, so it also arrives after it.

use std::collections::VecDeque;
use std::sync::Arc;

use parking_lot::Mutex;
use surfelcast_renderer::scene::SceneEdit;
use surfelcast_renderer::{RendererError, RendererHandle, SessionKey, ViewKey, ViewState};
use tokio::sync::mpsc;

/// One message to the renderer.
#[derive(Clone, Debug, PartialEq)]
enum Update {
    /// A change of the scene, with the revision after it.
    Scene(SceneEdit, u32),
    /// The state of a view.
    View(ViewKey, Box<ViewState>),
}

#[derive(Debug, Default)]
struct Pending {
    scene: Option<(SceneEdit, u32)>,
    /// Least recently sent first, so that a busy view does not starve the others.
    views: VecDeque<(ViewKey, Box<ViewState>)>,
}

impl Pending {
    fn set_view(&mut self, view: ViewKey, state: ViewState) {
        match self.views.iter_mut().find(|(key, _)| *key == view) {
            Some((_, pending)) => **pending = state,
            None => self.views.push_back((view, Box::new(state))),
        }
    }

    fn pop(&mut self) -> Option<Update> {
        if let Some((edit, revision)) = self.scene.take() {
            return Some(Update::Scene(edit, revision));
        }
        self.views.pop_front().map(|(view, state)| Update::View(view, state))
    }
}

/// The sending end. Its task ends when the queue is dropped.
#[derive(Debug)]
pub(crate) struct Outgoing {
    pending: Arc<Mutex<Pending>>,
    wake: mpsc::Sender<()>,
}

impl Outgoing {
    /// Starts the task that sends what is queued to the renderer.
    pub(crate) fn start(handle: RendererHandle, session: SessionKey) -> Self {
        let pending: Arc<Mutex<Pending>> = Arc::default();
        let (wake, mut woken) = mpsc::channel(1);
        let queued = Arc::clone(&pending);
        drop(tokio::spawn(async move {
            while woken.recv().await.is_some() {
                loop {
                    let Some(update) = queued.lock().pop() else { break };
                    if send(&handle, session, update).await.is_err() {
                        return;
                    }
                }
            }
        }));
        Self { pending, wake }
    }

    /// Queues an edit of the scene in place of the one that is still queued.
    pub(crate) fn edit_scene(&self, edit: SceneEdit, revision: u32) {
        self.pending.lock().scene = Some((edit, revision));
        self.wake();
    }

    /// Queues a view's state in place of the one that is still queued.
    pub(crate) fn set_view(&self, view: ViewKey, state: ViewState) {
        self.pending.lock().set_view(view, state);
        self.wake();
    }

    /// Drops what is queued for a view that is being closed.
    pub(crate) fn remove_view(&self, view: ViewKey) {
        self.pending.lock().views.retain(|(key, _)| *key != view);
    }

    fn wake(&self) {
        // A full channel means that the task is already due to look.
        let _ = self.wake.try_send(());
    }
}

async fn send(handle: &RendererHandle, session: SessionKey, update: Update) -> Result<(), RendererError> {
    match update {
        Update::Scene(edit, revision) => handle.edit_scene(session, edit, revision).await,
        Update::View(view, state) => handle.update_view(view, *state).await,
    }
}

#[cfg(test)]
mod tests {
    use surfelcast_renderer::Command;
    use surfelcast_renderer::scene::{Camera, LightState};

    use super::*;

    fn edit() -> SceneEdit {
        SceneEdit::Lights(LightState { punctual: Vec::new(), environment_strength: 1.0, emissive_strength: 1.0 })
    }

    fn view_state(input_seq: u32) -> ViewState {
        let camera = Camera {
            position: glam::DVec3::Z,
            target: glam::DVec3::ZERO,
            up: glam::DVec3::Y,
            vfov: std::f64::consts::FRAC_PI_4,
        };
        ViewState {
            camera,
            size: [8, 8],
            exposure: 1.0,
            technique: "path".into(),
            settings: surfelcast_renderer::Settings::default(),
            aov: None,
            is_moving: false,
            is_paused: false,
            max_scale: 1.0,
            target_frame_secs: 0.1,
            max_error: 0.1,
            max_samples: 1,
            input_seq,
        }
    }

    #[test]
    fn the_newest_value_of_each_key_is_sent_and_the_scene_first() {
        let mut pending = Pending::default();
        let (a, b) = (ViewKey(1), ViewKey(2));
        pending.set_view(a, view_state(1));
        pending.set_view(b, view_state(2));
        pending.scene = Some((edit(), 2));
        pending.set_view(a, view_state(3));
        pending.scene = Some((edit(), 3));
        assert_eq!(pending.pop(), Some(Update::Scene(edit(), 3)));
        assert_eq!(pending.pop(), Some(Update::View(a, Box::new(view_state(3)))));
        pending.set_view(a, view_state(4));
        pending.scene = Some((edit(), 4));
        assert_eq!(pending.pop(), Some(Update::Scene(edit(), 4)), "even between two views");
        assert_eq!(pending.pop(), Some(Update::View(b, Box::new(view_state(2)))), "a busy view waits for the others");
        assert_eq!(pending.pop(), Some(Update::View(a, Box::new(view_state(4)))));
        assert_eq!(pending.pop(), None);
    }

    #[tokio::test]
    async fn a_view_never_overtakes_the_edit_it_counts_on() {
        let (handle, mut commands, _status) = RendererHandle::channel();
        let outgoing = Outgoing::start(handle, SessionKey(7));
        for n in 1..=1000 {
            outgoing.edit_scene(edit(), n);
            outgoing.set_view(ViewKey(1), view_state(n));
            if n % 10 == 0 {
                tokio::task::yield_now().await;
            }
        }
        let mut revision = 0;
        loop {
            match commands.recv().await.expect("a command") {
                Command::EditScene { session, scene_rev, .. } => {
                    assert_eq!(session, SessionKey(7));
                    assert!(scene_rev > revision, "revisions rise");
                    revision = scene_rev;
                }
                Command::UpdateView { state, .. } => {
                    assert!(state.input_seq <= revision, "view {} before its lights", state.input_seq);
                    if state.input_seq == 1000 {
                        break;
                    }
                }
                other => panic!("{other:?}"),
            }
        }
    }
}
