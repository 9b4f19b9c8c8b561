//! What goes out on one WebSocket: two bounded queues and one task that owns the sending half.
//!
//! Control messages are few and must all arrive: a client that lets them pile up is disconnected. The queue of frames
//! holds one, and nothing is encoded while it is full. A message that makes no progress at all for the stall time ends
//! the connection; the socket is not used again, because a half-sent message cannot be taken back.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::Duration;

use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket};
use bytes::{Bytes, BytesMut};
use futures_util::SinkExt;
use futures_util::stream::SplitSink;
use surfelcast_protocol::frame::{FrameHeader, HEADER_BYTES};
use surfelcast_protocol::server::ServerMessage;
use tokio::sync::{mpsc, oneshot};

use crate::config::Bounds;

/// The client does not read what it is sent.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[error("the client does not read: more than {limit} {what} are waiting")]
pub(crate) struct Overflow {
    what: &'static str,
    limit: usize,
}

/// Sending end of a connection.
#[derive(Debug)]
pub(crate) struct Outbox {
    control: mpsc::Sender<Utf8Bytes>,
    frames: mpsc::Sender<OutgoingFrame>,
    waiting_bytes: Arc<AtomicUsize>,
    bounds: Bounds,
    close: oneshot::Sender<CloseFrame>,
    task: tokio::task::JoinHandle<()>,
}

/// A frame for one socket: the header is the socket's own, the payload is shared with others that show the view.
#[derive(Debug)]
struct OutgoingFrame {
    header: [u8; HEADER_BYTES],
    payload: Bytes,
}

impl OutgoingFrame {
    /// Header and payload in one message. The copy of the payload lives only while it is sent.
    fn message(&self) -> Bytes {
        let mut message = BytesMut::with_capacity(HEADER_BYTES + self.payload.len());
        message.extend_from_slice(&self.header);
        message.extend_from_slice(&self.payload);
        message.freeze()
    }
}

/// How the writer distinguishes a slow client from one that does not read.
#[derive(Clone, Debug)]
pub(crate) struct Progress {
    /// Bytes the socket has taken, where that is known.
    pub(crate) written: Option<Arc<AtomicU64>>,
    /// Longest time without any.
    pub(crate) stall: Duration,
}

impl Outbox {
    /// Takes over the sending half.
    pub(crate) fn start(sink: SplitSink<WebSocket, Message>, bounds: Bounds, progress: Progress) -> Self {
        let (control, control_queue) = mpsc::channel(bounds.outbox_messages.max(1));
        let (frames, frame_queue) = mpsc::channel(1);
        let (close, closing) = oneshot::channel();
        let waiting_bytes = Arc::new(AtomicUsize::new(0));
        let writer = Writer {
            sink,
            control: control_queue,
            frames: frame_queue,
            waiting_bytes: Arc::clone(&waiting_bytes),
            progress,
        };
        let task = tokio::spawn(writer.run(closing));
        Self { control, frames, waiting_bytes, bounds, close, task }
    }

    /// Queues a control message.
    pub(crate) fn control(&self, message: &ServerMessage) -> Result<(), Overflow> {
        let text = match serde_json::to_string(message) {
            Ok(text) => text,
            Err(error) => {
                tracing::error!(%error, "control message could not be written");
                return Ok(());
            }
        };
        let limit = self.bounds.outbox_bytes;
        let waiting = self.waiting_bytes.fetch_add(text.len(), Ordering::AcqRel);
        // One message alone may be larger than the bound; two may not.
        if waiting > 0 && waiting + text.len() > limit {
            return Err(Overflow { what: "bytes of control messages", limit });
        }
        match self.control.try_send(text.into()) {
            Err(mpsc::error::TrySendError::Full(_)) => {
                Err(Overflow { what: "control messages", limit: self.bounds.outbox_messages })
            }
            // A closed queue means that the connection is ending; its owner learns that by `ended`.
            Ok(()) | Err(mpsc::error::TrySendError::Closed(_)) => Ok(()),
        }
    }

    /// Whether a frame can be queued now.
    pub(crate) fn has_frame_room(&self) -> bool {
        self.frames.capacity() > 0
    }

    /// Resolves when a frame can be queued.
    pub(crate) async fn frame_room(&self) {
        let _ = self.frames.reserve().await;
    }

    /// Queues a frame; callers check [`Outbox::has_frame_room`].
    pub(crate) fn frame(&self, header: &FrameHeader, payload: Bytes) -> Result<(), Overflow> {
        match self.frames.try_send(OutgoingFrame { header: header.encode(), payload }) {
            Err(mpsc::error::TrySendError::Full(_)) => Err(Overflow { what: "frames", limit: 1 }),
            Ok(()) | Err(mpsc::error::TrySendError::Closed(_)) => Ok(()),
        }
    }

    /// Resolves when the socket has failed or stalled.
    pub(crate) async fn ended(&self) {
        self.control.closed().await;
    }

    /// Sends what is queued, then the close message. Takes as long as the socket makes progress.
    pub(crate) async fn close(self, code: u16, reason: &str) {
        // A close reason may have 123 bytes.
        let reason: String = reason.chars().filter(char::is_ascii).take(120).collect();
        let _ = self.close.send(CloseFrame { code, reason: reason.into() });
        let _ = self.task.await;
    }

    /// Drops the socket as it is.
    pub(crate) fn abort(self) {
        self.task.abort();
    }
}

struct Writer {
    sink: SplitSink<WebSocket, Message>,
    control: mpsc::Receiver<Utf8Bytes>,
    frames: mpsc::Receiver<OutgoingFrame>,
    waiting_bytes: Arc<AtomicUsize>,
    progress: Progress,
}

impl Writer {
    async fn run(mut self, mut closing: oneshot::Receiver<CloseFrame>) {
        loop {
            let (message, control_bytes) = tokio::select! {
                biased;
                // Frames first, so that `stats` follow the frame that they describe. A queue of one frame cannot starve
                // the control messages.
                Some(frame) = self.frames.recv() => (Message::Binary(frame.message()), 0),
                Some(text) = self.control.recv() => { let bytes = text.len(); (Message::Text(text), bytes) }
                close = &mut closing => {
                    if let Ok(frame) = close {
                        let _ = self.send(Message::Close(Some(frame))).await;
                    }
                    return;
                }
            };
            let sent = self.send(message).await;
            self.waiting_bytes.fetch_sub(control_bytes, Ordering::AcqRel);
            if let Err(cause) = sent {
                tracing::debug!(cause, "sending ended");
                return;
            }
        }
    }

    async fn send(&mut self, message: Message) -> Result<(), &'static str> {
        let taken = || self.progress.written.as_ref().map(|written| written.load(Ordering::Relaxed));
        let mut before = taken();
        let mut sending = std::pin::pin!(self.sink.send(message));
        loop {
            match tokio::time::timeout(self.progress.stall, sending.as_mut()).await {
                Ok(Ok(())) => return Ok(()),
                Ok(Err(_)) => return Err("the socket failed"),
                Err(_) => {
                    let now = taken();
                    if now.is_none() || now == before {
                        return Err("the client does not read");
                    }
                    before = now;
                }
            }
        }
    }
}
