//! A view: one camera in the renderer, and its frames.
//!
//! A view knows no client. It takes a state, which replaces the one before, delivers frames while one is requested,
//! and encodes them; an encoded frame is the same for every socket that shows the view. The member that controls the
//! view is apart ([`crate::live::connection`]), and so is what one socket is sent ([`crate::live::outbound`]).

use std::sync::Arc;

use bytes::Bytes;
use surfelcast_renderer::{Frame, FrameSlot, RendererError, RendererHandle, ViewKey, ViewState};
use surfelcast_stream::{StreamError, encode};
use tokio::sync::mpsc;

use crate::blocking::{BlockingPool, WorkFailed};
use crate::live::frame::{EncodeRequest, EncodedFrame};
use crate::sessions::Live;

/// Why a frame could not be encoded.
#[derive(Debug, thiserror::Error)]
pub(crate) enum EncodeError {
    /// The encoder refused it.
    #[error(transparent)]
    Stream(#[from] StreamError),
    /// The encoder panicked.
    #[error(transparent)]
    Panicked(#[from] WorkFailed),
}

/// What a view delivers.
#[derive(Debug)]
pub(crate) enum ViewEvent {
    /// The renderer delivered a frame.
    Frame(Arc<Frame>),
    /// A frame was encoded.
    Encoded(Result<Arc<EncodedFrame>, EncodeError>),
    /// The renderer closed the view.
    Closed,
}

/// A view in the renderer. [`View::close`] ends it.
#[derive(Debug)]
pub(crate) struct View {
    handle: RendererHandle,
    encoders: BlockingPool,
    session: Arc<Live>,
    key: ViewKey,
    slot: FrameSlot,
    results: mpsc::Sender<Result<Arc<EncodedFrame>, EncodeError>>,
    encoded: mpsc::Receiver<Result<Arc<EncodedFrame>, EncodeError>>,
}

impl View {
    /// Opens a view of a session in the renderer.
    pub(crate) async fn open(
        handle: RendererHandle,
        encoders: BlockingPool,
        session: Arc<Live>,
        state: ViewState,
    ) -> Result<Self, RendererError> {
        let slot = FrameSlot::default();
        let key = handle.open_view(session.key, state, slot.clone()).await?;
        let (results, encoded) = mpsc::channel(1);
        Ok(Self { handle, encoders, session, key, slot, results, encoded })
    }

    /// Sends the renderer a state, after the edits of the session that were made before. Newest wins: a state that has
    /// not left yet is replaced.
    pub(crate) fn update(&self, state: ViewState) {
        self.session.update_view(self.key, state);
    }

    /// A frame could be sent now.
    pub(crate) fn request_frame(&self) {
        self.slot.want();
        self.handle.wake();
    }

    /// Encodes a frame off the async threads; [`ViewEvent::Encoded`] follows.
    pub(crate) fn encode(&self, request: EncodeRequest) {
        let (pool, results) = (self.encoders.clone(), self.results.clone());
        drop(tokio::spawn(async move {
            let result = encode_on(&pool, request).await;
            // The view may be gone by now.
            let _ = results.send(result.map(Arc::new)).await;
        }));
    }

    /// Waits for what happens next; frames only where `takes_frames`. Cancel-safe.
    pub(crate) async fn next(&mut self, takes_frames: bool) -> ViewEvent {
        tokio::select! {
            biased;
            // A sender is kept, so that the channel stays open.
            Some(result) = self.encoded.recv() => ViewEvent::Encoded(result),
            frame = self.slot.take(), if takes_frames => frame.map_or(ViewEvent::Closed, ViewEvent::Frame),
        }
    }

    /// Closes the view in the renderer.
    pub(crate) async fn close(self) {
        self.session.remove_view(self.key);
        if let Err(error) = self.handle.close_view(self.key).await {
            tracing::debug!(%error, "view could not be closed");
        }
    }
}

async fn encode_on(pool: &BlockingPool, request: EncodeRequest) -> Result<EncodedFrame, EncodeError> {
    let EncodeRequest { frame, codec, quality } = request;
    let began = std::time::Instant::now();
    let source = Arc::clone(&frame);
    let payload = pool.run(move || encode(&source.pixels, source.size, codec, quality)).await??;
    let encode_secs = began.elapsed().as_secs_f64();
    Ok(EncodedFrame { frame, codec, quality, payload: Bytes::from(payload), encode_secs })
}
