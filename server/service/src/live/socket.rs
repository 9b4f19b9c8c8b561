//! `GET /v1/sessions/{id}/stream`: upgrade, `hello`, then the connection.

use std::time::Duration;

use axum::Extension;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt;
use futures_util::stream::SplitStream;
use surfelcast_protocol::client::{ClientMessage, Hello};
use surfelcast_protocol::parse::parse_client;
use surfelcast_protocol::{SUBPROTOCOL, VERSION};

use crate::http::connection_info::ConnectionInfo;
use crate::http::problem::ApiError;
use crate::live::close::CloseReason;
use crate::live::connection::Connection;
use crate::live::outbox::{Outbox, Progress};
use crate::sessions::Member;
use crate::state::ServiceState;

/// Bytes per pixel that the write buffer of a socket holds for one frame; lossless frames of noise stay below.
const BUFFER_BYTES_PER_PIXEL: usize = 4;
/// Time for the client to answer a close message.
const CLOSE_PATIENCE: Duration = Duration::from_secs(1);

/// Interactive view of a session over WebSocket (subprotocol `surfelcast.v1.json`): JSON control messages, binary
/// frames with a 48-byte header.
#[utoipa::path(get, path = "/v1/sessions/{id}/stream", tag = "sessions",
    params(("id" = String, Path, description = "Session id of a scene, from GET /v1/scenes")),
    responses((status = 101, description = "Upgraded"), (status = 400, description = "Not an upgrade, or no common subprotocol"),
        (status = 403, description = "Host or Origin not allowed")))]
pub(crate) async fn stream(
    State(state): State<ServiceState>,
    Path(session): Path<String>,
    info: Option<Extension<ConnectionInfo>>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    let upgrade = match upgrade {
        Ok(upgrade) => upgrade,
        Err(rejection) => {
            let status = rejection.into_response().status();
            let status = if status.is_client_error() { status } else { StatusCode::BAD_REQUEST };
            let detail = "Upgrade: this path speaks WebSocket (RFC 6455, version 13) over HTTP/1.1 only";
            return ApiError::new(status, "upgrade_required", detail).into_response();
        }
    };
    let mut offered = upgrade.requested_protocols().peekable();
    if offered.peek().is_some() && !offered.any(|protocol| protocol == SUBPROTOCOL) {
        let detail = format!("Sec-WebSocket-Protocol: none in common; this server speaks {SUBPROTOCOL}");
        return ApiError::new(StatusCode::BAD_REQUEST, "no_common_subprotocol", detail).into_response();
    }
    drop(offered);
    let limits = state.config().limits;
    let control_bytes = limits.control_bytes as usize;
    let written = info.map(|Extension(info)| info.written);
    upgrade
        .protocols([SUBPROTOCOL])
        .max_message_size(control_bytes)
        .max_frame_size(control_bytes)
        .max_write_buffer_size(limits.max_pixels as usize * BUFFER_BYTES_PER_PIXEL + state.config().bounds.outbox_bytes)
        .on_upgrade(move |socket| {
            let progress = Progress { written, stall: state.config().timeouts.send_stall };
            let tasks = state.tasks().clone();
            tasks.track_future(serve(state, session, socket, progress))
        })
}

async fn serve(state: ServiceState, session: String, socket: WebSocket, progress: Progress) {
    let (sink, mut stream) = socket.split();
    let outbox = Outbox::start(sink, state.config().bounds, progress);
    let reason = converse(state, &session, &mut stream, &outbox).await;
    let Some(code) = reason.code() else {
        if let CloseReason::Overflow(overflow) = reason {
            tracing::debug!(%overflow, "disconnecting");
            metrics::counter!("surfelcast_closes_total", "code" => "overflow").increment(1);
        }
        return outbox.abort();
    };
    tracing::debug!(code, %reason, "closing");
    metrics::counter!("surfelcast_closes_total", "code" => code.to_string()).increment(1);
    outbox.close(code, &reason.to_string()).await;
    // What the client still sends is read and dropped: otherwise the kernel would reset the connection and lose the
    // close message that is on its way.
    let drained = async { while let Some(Ok(_)) = stream.next().await {} };
    let _ = tokio::time::timeout(CLOSE_PATIENCE, drained).await;
}

/// From `hello` to the end of the connection.
async fn converse(
    state: ServiceState,
    session: &str,
    stream: &mut SplitStream<WebSocket>,
    outbox: &Outbox,
) -> CloseReason {
    let opened = match receive_hello(&state, session, stream).await {
        Ok((hello, member)) => Connection::open(state, member, hello, outbox).await,
        Err(reason) => Err(reason),
    };
    match opened {
        Ok(connection) => connection.run(stream).await,
        Err(reason) => reason,
    }
}

/// Waits for `hello` and joins the session.
async fn receive_hello(
    state: &ServiceState,
    session: &str,
    stream: &mut SplitStream<WebSocket>,
) -> Result<(Hello, Member), CloseReason> {
    let limits = state.config().limits;
    let deadline = Duration::from_millis(u64::from(limits.hello_timeout_ms));
    let first = tokio::select! {
        first = tokio::time::timeout(deadline, stream.next()) => first,
        () = state.draining().cancelled() => return Err(CloseReason::Stopping),
    };
    let text = match first {
        Err(_) => return Err(CloseReason::HelloTimeout),
        Ok(Some(Ok(Message::Text(text)))) => text,
        Ok(Some(Ok(Message::Close(_))) | None) => return Err(CloseReason::Gone),
        Ok(Some(Ok(_))) => return Err(CloseReason::HelloNotFirst),
        Ok(Some(Err(error))) => return Err(CloseReason::of_socket_error(&error)),
    };
    if text.len() > limits.hello_bytes as usize {
        return Err(CloseReason::HelloTooLong);
    }
    let ClientMessage::Hello(hello) = parse_client(&text).map_err(CloseReason::HelloMalformed)?.message else {
        return Err(CloseReason::HelloNotFirst);
    };
    if !hello.v.contains(&VERSION) {
        return Err(CloseReason::HelloVersion);
    }
    if hello.caps.codecs.is_empty() {
        return Err(CloseReason::HelloCodecs);
    }
    let member = state.sessions().join(session).await?;
    Ok((hello, member))
}
