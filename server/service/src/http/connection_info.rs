//! What request handlers know about their connection.

use std::sync::Arc;
use std::sync::atomic::AtomicU64;

/// An extension of every request, set by the accept loop.
#[derive(Clone, Debug)]
pub(crate) struct ConnectionInfo {
    /// Bytes that the socket has accepted so far; it tells a slow client of a WebSocket from a stuck one.
    pub(crate) written: Arc<AtomicU64>,
}
