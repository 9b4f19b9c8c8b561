//! A slot that holds one frame: a new frame replaces an unread older one.

use std::sync::Arc;

use parking_lot::Mutex;
use tokio::sync::Notify;

use crate::view::Frame;

/// Passes the newest frame from the render actor to one connection. Clones share the slot.
#[derive(Clone, Debug, Default)]
pub struct FrameSlot {
    inner: Arc<Inner>,
}

#[derive(Debug, Default)]
struct Inner {
    state: Mutex<State>,
    ready: Notify,
}

#[derive(Debug, Default)]
struct State {
    frame: Option<Arc<Frame>>,
    is_wanted: bool,
    is_closed: bool,
}

impl FrameSlot {
    /// Marks a frame as wanted: the reader could send one now. The actor renders moving frames of a view only while one
    /// is wanted, so a slow client costs no rendering. Cleared by [`FrameSlot::put`]. Wake the actor with
    /// [`crate::RendererHandle::wake`].
    pub fn want(&self) {
        self.inner.state.lock().is_wanted = true;
    }

    /// Whether the reader waits for a frame.
    pub fn is_wanted(&self) -> bool {
        self.inner.state.lock().is_wanted
    }

    /// Stores a frame in place of an unread one.
    pub fn put(&self, frame: Arc<Frame>) {
        let mut state = self.inner.state.lock();
        state.frame = Some(frame);
        state.is_wanted = false;
        drop(state);
        self.inner.ready.notify_one();
    }

    /// Ends the slot; readers get `None` once it is empty.
    pub fn close(&self) {
        self.inner.state.lock().is_closed = true;
        self.inner.ready.notify_one();
    }

    /// Waits for a frame; `None` when the view is closed. One reader at a time; cancel-safe.
    pub async fn take(&self) -> Option<Arc<Frame>> {
        loop {
            let notified = self.inner.ready.notified();
            {
                let mut state = self.inner.state.lock();
                if let Some(frame) = state.frame.take() {
                    return Some(frame);
                }
                if state.is_closed {
                    return None;
                }
            }
            notified.await;
        }
    }
}
