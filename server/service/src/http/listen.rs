//! The accept loop: it bounds the number of connections, times headers and writes, and drains requests at the end.
//!
//! `axum::serve` gives hyper no timer, so its header timeout would never fire; hence a loop of our own.

use std::collections::HashMap;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::{Context, Poll};
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use hyper_util::rt::{TokioIo, TokioTimer};
use parking_lot::Mutex;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::time::{Instant, Sleep};
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

use crate::http::connection_info::ConnectionInfo;
use crate::http::router::router;
use crate::state::ServiceState;

/// Pause after a failed accept, so that running out of file descriptors does not spin.
const ACCEPT_PAUSE: Duration = Duration::from_millis(50);
/// How often metrics fold their samples.
const UPKEEP: Duration = Duration::from_secs(5);

/// Serves until `shutdown`, then drains: `/readyz` fails, WebSocket clients get a notice and close code 1012, requests
/// in flight may finish until the drain deadline. Returns when all connections have ended or the deadline has passed.
pub async fn run(listener: TcpListener, state: ServiceState, shutdown: CancellationToken) -> io::Result<()> {
    let local = listener.local_addr()?;
    state.set_local_addr(local);
    tracing::info!(address = %local, "listening");
    let app = router(state.clone());
    let slots = Arc::new(Slots::default());
    let mut upkeep = tokio::time::interval(UPKEEP);
    loop {
        tokio::select! {
            () = shutdown.cancelled() => break,
            _ = upkeep.tick() => state.metrics().run_upkeep(),
            accepted = listener.accept() => match accepted {
                Ok((socket, peer)) => accept(&state, &app, &slots, socket, peer),
                Err(error) => {
                    tracing::warn!(%error, "accept failed");
                    tokio::time::sleep(ACCEPT_PAUSE).await;
                }
            },
        }
    }
    drop(listener);
    tracing::info!("draining");
    state.begin_drain();
    state.tasks().close();
    if tokio::time::timeout(state.config().timeouts.drain, state.tasks().wait()).await.is_err() {
        tracing::warn!("connections were still open at the drain deadline");
    }
    state.end();
    Ok(())
}

fn accept(state: &ServiceState, app: &Router, slots: &Arc<Slots>, socket: TcpStream, peer: SocketAddr) {
    let bounds = state.config().bounds;
    let ip = peer.ip().to_canonical();
    let Some(slot) = slots.take(ip, bounds.connections, bounds.connections_per_ip) else {
        metrics::counter!("surfelcast_connections_refused_total").increment(1);
        // Best effort: the kernel's send buffer takes this; no task is spent on a flood.
        let _ = socket.try_write(
            b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nRetry-After: 5\r\nContent-Length: 0\r\n\r\n",
        );
        return;
    };
    let _ = socket.set_nodelay(true);
    state.tasks().spawn(serve(state.clone(), app.clone(), socket, slot));
}

async fn serve(state: ServiceState, app: Router, socket: TcpStream, slot: Slot) {
    let config = state.config();
    let written = Arc::new(AtomicU64::new(0));
    let info = ConnectionInfo { written: Arc::clone(&written) };
    let io = TokioIo::new(TimedIo { socket, written, stall: config.timeouts.write_stall, deadline: None, _slot: slot });
    let service = hyper::service::service_fn(move |request: hyper::Request<hyper::body::Incoming>| {
        let mut request = request.map(Body::new);
        request.extensions_mut().insert(info.clone());
        app.clone().oneshot(request)
    });
    let connection = hyper::server::conn::http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(config.timeouts.header)
        .max_buf_size(config.bounds.header_bytes.max(8 << 10))
        .max_headers(config.bounds.header_count)
        .serve_connection(io, service)
        .with_upgrades();
    let mut connection = std::pin::pin!(connection);
    let drain = state.draining();
    let result = tokio::select! {
        result = connection.as_mut() => result,
        () = drain.cancelled() => {
            connection.as_mut().graceful_shutdown();
            connection.await
        }
    };
    if let Err(error) = result {
        tracing::debug!(%error, "connection broke");
    }
}

/// Open connections, in total and by address.
#[derive(Debug, Default)]
struct Slots(Mutex<HashMap<IpAddr, usize>>);

impl Slots {
    fn take(self: &Arc<Self>, ip: IpAddr, total: usize, per_ip: usize) -> Option<Slot> {
        let mut map = self.0.lock();
        // The map holds one entry for each address with an open connection, so this sum is over at most `total`
        // entries.
        if map.values().sum::<usize>() >= total || map.get(&ip).copied().unwrap_or(0) >= per_ip {
            return None;
        }
        *map.entry(ip).or_default() += 1;
        Some(Slot { slots: Arc::clone(self), ip })
    }
}

#[derive(Debug)]
struct Slot {
    slots: Arc<Slots>,
    ip: IpAddr,
}

impl Drop for Slot {
    fn drop(&mut self) {
        let mut map = self.slots.0.lock();
        if let Some(count) = map.get_mut(&self.ip) {
            *count -= 1;
            if *count == 0 {
                map.remove(&self.ip);
            }
        }
    }
}

/// A socket that counts the bytes it sends and fails when a write makes no progress for too long.
struct TimedIo {
    socket: TcpStream,
    written: Arc<AtomicU64>,
    stall: Duration,
    deadline: Option<Pin<Box<Sleep>>>,
    /// Released when the socket closes, whether it carried requests or a WebSocket.
    _slot: Slot,
}

impl TimedIo {
    fn watch(&mut self, result: Poll<io::Result<usize>>, cx: &mut Context<'_>) -> Poll<io::Result<usize>> {
        match result {
            Poll::Ready(result) => {
                self.deadline = None;
                if let Ok(count) = result {
                    self.written.fetch_add(count as u64, Ordering::Relaxed);
                }
                Poll::Ready(result)
            }
            Poll::Pending => {
                let stall = self.stall;
                let sleep = || Box::pin(tokio::time::sleep_until(Instant::now() + stall));
                match self.deadline.get_or_insert_with(sleep).as_mut().poll(cx) {
                    Poll::Ready(()) => {
                        Poll::Ready(Err(io::Error::new(io::ErrorKind::TimedOut, "the client does not read")))
                    }
                    Poll::Pending => Poll::Pending,
                }
            }
        }
    }
}

impl AsyncRead for TimedIo {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.socket).poll_read(cx, buffer)
    }
}

impl AsyncWrite for TimedIo {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let result = Pin::new(&mut self.socket).poll_write(cx, bytes);
        self.watch(result, cx)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        pieces: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let result = Pin::new(&mut self.socket).poll_write_vectored(cx, pieces);
        self.watch(result, cx)
    }

    fn is_write_vectored(&self) -> bool {
        self.socket.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.socket).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.socket).poll_shutdown(cx)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn connections_are_counted_by_address_and_in_total() {
        let slots = Arc::new(Slots::default());
        let ip = |last| IpAddr::from([10, 0, 0, last]);
        let first = slots.take(ip(1), 3, 2).expect("free");
        let second = slots.take(ip(1), 3, 2).expect("free");
        assert!(slots.take(ip(1), 3, 2).is_none(), "two from one address");
        let third = slots.take(ip(2), 3, 2).expect("free");
        assert!(slots.take(ip(3), 3, 2).is_none(), "three in total");
        drop((first, second, third));
        assert!(slots.0.lock().is_empty(), "closed connections leave no entry");
    }
}
