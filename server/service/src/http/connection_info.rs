//! What the accept loop tells request handlers about their connection.

use std::sync::Arc;
use std::sync::atomic::AtomicU64;

/// What a request handler may know of its connection; a request extension.
#[derive(Clone, Debug)]
pub(crate) struct ConnectionInfo {
    /// Bytes that the socket has accepted so far; WebSocket connections use it to tell a slow client from a stuck one.
    pub(crate) written: Arc<AtomicU64>,
}
