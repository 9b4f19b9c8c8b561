//! `GET /v1/sessions/{id}/stream`: upgrade, introduction, then the connection.

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
use surfelcast_protocol::{SUBPROTOCOL, VERSION, close};
use surfelcast_renderer::RendererError;

use crate::http::connection_info::ConnectionInfo;
use crate::http::problem::ApiError;
use crate::live::connection::{Connection, Ending};
use crate::live::outbox::{Outbox, Progress};
use crate::sessions::JoinError;
use crate::state::ServiceState;

/// Bytes of a picture in the socket's own buffer, a pixel; lossless pictures of noise stay below.
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
    let (outbox, ending) = match introduce(&state, &session, &mut stream).await {
        Ok((hello, member)) => match Connection::open(state, member, hello, outbox).await {
            Ok(connection) => connection.run(&mut stream).await,
            Err((outbox, ending)) => (outbox, ending),
        },
        Err(ending) => (outbox, ending),
    };
    match ending {
        Ending::Close(code, reason) => {
            tracing::debug!(code, reason, "closing");
            metrics::counter!("surfelcast_closes_total", "code" => code.to_string()).increment(1);
            outbox.close(code, &reason).await;
            // What the client still sends is read and dropped, lest the kernel resets the connection and with it the
            // close message on its way.
            let drained = async { while let Some(Ok(_)) = stream.next().await {} };
            let _ = tokio::time::timeout(CLOSE_PATIENCE, drained).await;
        }
        Ending::Gone => outbox.abort(),
    }
}

/// Waits for `hello` and joins the session.
async fn introduce(
    state: &ServiceState,
    session: &str,
    stream: &mut SplitStream<WebSocket>,
) -> Result<(Hello, crate::sessions::Member), Ending> {
    let limits = state.config().limits;
    let deadline = Duration::from_millis(u64::from(limits.hello_timeout_ms));
    let first = tokio::select! {
        first = tokio::time::timeout(deadline, stream.next()) => first,
        () = state.draining().cancelled() => {
            return Err(Ending::close(close::RESTART, "the server is stopping; come back"));
        }
    };
    let text = match first {
        Err(_) => return Err(Ending::close(close::TOO_SLOW, "hello: did not come in time")),
        Ok(Some(Ok(Message::Text(text)))) => text,
        Ok(Some(Ok(Message::Close(_))) | None) => return Err(Ending::Gone),
        Ok(Some(Ok(_))) => return Err(Ending::close(close::MALFORMED, "hello: must be the first message")),
        Ok(Some(Err(error))) => return Err(Ending::of_socket_error(&error)),
    };
    if text.len() > limits.hello_bytes as usize {
        return Err(Ending::close(close::TOO_BIG, "hello: too long"));
    }
    let hello = match parse_client(&text) {
        Ok(envelope) => match envelope.message {
            ClientMessage::Hello(hello) => hello,
            _ => return Err(Ending::close(close::MALFORMED, "hello: must be the first message")),
        },
        Err(error) => return Err(Ending::Close(close::MALFORMED, error.to_string())),
    };
    if !hello.v.contains(&VERSION) {
        return Err(Ending::close(close::VERSION, "hello.v: this server speaks version 1"));
    }
    if hello.caps.codecs.is_empty() {
        return Err(Ending::close(close::MALFORMED, "hello.caps.codecs: offer at least one of jpeg, webp, png"));
    }
    let member = state.sessions().join(state, session).await.map_err(|error| match error {
        JoinError::Unknown => Ending::close(close::NO_SESSION, "no such session; GET /v1/scenes lists them"),
        JoinError::Full(limit) => Ending::Close(close::TRY_LATER, format!("the session has {limit} views already")),
        JoinError::Refused(error) => refused(&error),
    })?;
    Ok((hello, member))
}

/// The close code of an error that HTTP would answer with a problem.
fn refused(error: &ApiError) -> Ending {
    let code = match error.code() {
        "gpu_memory" | "scene_too_large" | "unsupported" => close::NO_CAPACITY,
        "not_found" => close::NO_SESSION,
        _ => close::TRY_LATER,
    };
    Ending::Close(code, error.detail().to_owned())
}

impl Ending {
    /// The end that a renderer's refusal means.
    pub(crate) fn of_renderer(error: RendererError) -> Self {
        refused(&ApiError::from(error))
    }
}
