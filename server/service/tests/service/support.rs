//! A service on a real socket or without one, and a small client.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::http::{HeaderMap, Request, StatusCode};
use futures_util::{SinkExt, StreamExt};
use http_body_util::BodyExt;
use serde_json::{Value, json};
use surfelcast_protocol::frame::{FrameHeader, HEADER_BYTES};
use surfelcast_renderer::scene::{LoadOptions, Scene, load_bytes};
use surfelcast_service::{ServiceConfig, ServiceState, router, run};
use tokio::net::{TcpListener, TcpStream};
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream};
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;
use tungstenite::{Message, client::IntoClientRequest};

use crate::fake::{Fake, FakeBehaviour};

/// Whatever should happen at once happens within this time.
pub(crate) const SOON: Duration = Duration::from_secs(10);

/// One triangle. `width` makes scenes of different content.
pub(crate) fn gltf(width: f32) -> String {
    let corners = [[0.0, 0.0, 0.0], [width, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let bytes: Vec<u8> = corners.iter().flatten().flat_map(|c: &f32| c.to_le_bytes()).collect();
    json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "triangle"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "buffers": [{"byteLength": 36, "uri": format!("data:application/octet-stream;base64,{}", base64(&bytes))}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
            "min": [0.0, 0.0, 0.0], "max": [width, 1.0, 0.0]}],
    })
    .to_string()
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    bytes
        .chunks(3)
        .flat_map(|chunk| {
            let word = chunk.iter().fold(0u32, |word, byte| word << 8 | u32::from(*byte));
            (0..4).map(move |i| char::from(DIGITS[(word >> (18 - 6 * i) & 63) as usize]))
        })
        .collect()
}

pub(crate) fn scene() -> Arc<Scene> {
    Arc::new(load_bytes(gltf(1.0).as_bytes(), "triangle", &LoadOptions::default()).expect("a valid scene"))
}

/// A service over a fake renderer.
pub(crate) struct Service {
    pub(crate) state: ServiceState,
    pub(crate) fake: Fake,
    pub(crate) addr: SocketAddr,
    pub(crate) scene: Arc<Scene>,
    pub(crate) shutdown: CancellationToken,
    pub(crate) task: tokio::task::JoinHandle<std::io::Result<()>>,
    _dir: tempfile::TempDir,
}

impl Service {
    pub(crate) async fn start() -> Self {
        Self::with(FakeBehaviour::default(), |_| {}).await
    }

    pub(crate) async fn with(behaviour: FakeBehaviour, edit: impl FnOnce(&mut ServiceConfig)) -> Self {
        let dir = tempfile::tempdir().expect("a folder");
        let mut config = ServiceConfig::new(dir.path(), "surfelcast/test");
        edit(&mut config);
        let fake = Fake::start(behaviour);
        let scene = scene();
        let state = ServiceState::new(fake.handle.clone(), vec![Arc::clone(&scene)], config).expect("starts");
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let addr = listener.local_addr().expect("an address");
        let shutdown = CancellationToken::new();
        let task = tokio::spawn(run(listener, state.clone(), shutdown.clone()));
        Self { state, fake, addr, scene, shutdown, task, _dir: dir }
    }

    pub(crate) fn router(&self) -> Router {
        router(self.state.clone())
    }

    pub(crate) fn scene_id(&self) -> String {
        self.scene.key().to_string()
    }

    pub(crate) fn session(&self) -> String {
        self.scene_id()["sha256:".len()..][..16].to_owned()
    }

    /// Sends a request to the router without a socket.
    pub(crate) async fn ask(&self, request: Request<Body>) -> Answer {
        ask(self.router(), request).await
    }

    pub(crate) async fn get(&self, path: &str) -> Answer {
        self.ask(Request::get(path).header("host", "localhost").body(Body::empty()).expect("a request")).await
    }

    pub(crate) async fn post(&self, path: &str, headers: &[(&str, &str)], body: impl Into<Body>) -> Answer {
        let mut request = Request::post(path).header("host", "localhost");
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        self.ask(request.body(body.into()).expect("a request")).await
    }

    /// Opens a WebSocket and sends nothing.
    pub(crate) async fn connect(&self) -> Client {
        self.connect_to(&self.session()).await
    }

    pub(crate) async fn connect_to(&self, session: &str) -> Client {
        let socket = TcpStream::connect(self.addr).await.expect("connects");
        Client::upgrade(socket, self.addr, session).await.expect("upgrades")
    }

    /// Opens a WebSocket and sends `hello`; `welcome` and the first `lights` are received.
    pub(crate) async fn client(&self) -> Client {
        let mut client = self.connect().await;
        client.hello(json!(["webp", "jpeg", "png"])).await;
        client
    }

    /// Waits until something holds.
    pub(crate) async fn until(&self, what: &str, holds: impl Fn(&Fake) -> bool) {
        let wait = async {
            while !holds(&self.fake) {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        };
        tokio::time::timeout(SOON, wait).await.unwrap_or_else(|_| panic!("never: {what}; {:?}", self.fake.recorded()));
    }
}

/// A whole answer.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) status: StatusCode,
    pub(crate) headers: HeaderMap,
    pub(crate) body: Vec<u8>,
}

impl Answer {
    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|e| panic!("{e}: {:?}", String::from_utf8_lossy(&self.body)))
    }

    pub(crate) fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |value| value.to_str().expect("ASCII"))
    }

    /// The code of a problem, after checking that it is one.
    pub(crate) fn problem(&self) -> String {
        assert_eq!(self.header("content-type"), "application/problem+json", "{self:?}");
        let problem = self.json();
        assert_eq!(problem["status"], self.status.as_u16());
        assert!(!problem["detail"].as_str().unwrap_or_default().is_empty() && problem["title"].is_string());
        problem["code"].as_str().expect("a code").to_owned()
    }
}

pub(crate) async fn ask(router: Router, request: Request<Body>) -> Answer {
    let response = router.oneshot(request).await.expect("infallible");
    let (parts, body) = response.into_parts();
    let body = body.collect().await.expect("a body").to_bytes().to_vec();
    Answer { status: parts.status, headers: parts.headers, body }
}

/// A client in place of a browser.
pub(crate) struct Client {
    pub(crate) ws: WebSocketStream<MaybeTlsStream<TcpStream>>,
    pub(crate) welcome: Value,
    seq: u32,
}

/// Something the server sent.
#[derive(Debug)]
pub(crate) enum Got {
    Text(Value),
    Frame(FrameHeader, Vec<u8>),
    Closed(u16),
    /// The connection broke without a close message.
    Broken,
}

impl Client {
    pub(crate) async fn upgrade(
        socket: TcpStream,
        addr: SocketAddr,
        session: &str,
    ) -> Result<Self, tungstenite::Error> {
        let mut request = format!("ws://{addr}/v1/sessions/{session}/stream").into_client_request()?;
        request.headers_mut().insert("sec-websocket-protocol", "surfelcast.v1.json".parse().expect("a value"));
        let socket = MaybeTlsStream::Plain(socket);
        let (ws, response) = tokio_tungstenite::client_async(request, socket).await?;
        assert_eq!(response.headers()["sec-websocket-protocol"], "surfelcast.v1.json");
        Ok(Self { ws, welcome: Value::Null, seq: 0 })
    }

    pub(crate) async fn send(&mut self, message: Value) {
        self.send_text(message.to_string()).await;
    }

    pub(crate) async fn send_text(&mut self, text: impl Into<String>) {
        // The server may have closed already; tests then check the close code.
        let _ = self.ws.send(Message::text(text.into())).await;
    }

    pub(crate) async fn hello(&mut self, codecs: Value) {
        self.send(json!({"t": "hello", "v": [1], "client": "test", "caps": {"codecs": codecs}})).await;
        self.welcome = self.text("welcome").await;
        self.text("lights").await;
    }

    pub(crate) async fn next(&mut self) -> Got {
        loop {
            match tokio::time::timeout(SOON, self.ws.next()).await.expect("something comes") {
                Some(Ok(Message::Text(text))) => return Got::Text(serde_json::from_str(&text).expect("JSON")),
                Some(Ok(Message::Binary(bytes))) => {
                    let header = FrameHeader::decode(&bytes).expect("a frame");
                    return Got::Frame(header, bytes[HEADER_BYTES..].to_vec());
                }
                Some(Ok(Message::Close(Some(frame)))) => return Got::Closed(frame.code.into()),
                Some(Ok(_)) => {}
                Some(Err(_)) | None => return Got::Broken,
            }
        }
    }

    /// The next text of this type; other messages on the way are dropped.
    pub(crate) async fn text(&mut self, kind: &str) -> Value {
        loop {
            match self.next().await {
                Got::Text(value) if value["t"] == kind => return value,
                Got::Closed(code) => panic!("closed with {code} while waiting for {kind}"),
                Got::Broken => panic!("broken while waiting for {kind}"),
                _ => {}
            }
        }
    }

    /// The next frame, acknowledged.
    pub(crate) async fn frame(&mut self) -> (FrameHeader, Vec<u8>) {
        let (header, payload) = self.unacked_frame().await;
        self.ack(header.frame_seq).await;
        (header, payload)
    }

    pub(crate) async fn unacked_frame(&mut self) -> (FrameHeader, Vec<u8>) {
        loop {
            match self.next().await {
                Got::Frame(header, payload) => return (header, payload),
                Got::Closed(code) => panic!("closed with {code} while waiting for a frame"),
                Got::Broken => panic!("broken while waiting for a frame"),
                Got::Text(_) => {}
            }
        }
    }

    pub(crate) async fn ack(&mut self, seq: u32) {
        self.send(json!({"t": "ack", "view": 0, "seq": seq, "decode_us": 500})).await;
    }

    /// Frames, acknowledged, until the converged one.
    pub(crate) async fn until_final(&mut self) -> Vec<(FrameHeader, Vec<u8>)> {
        let mut frames = Vec::new();
        loop {
            let frame = self.frame().await;
            let is_final = frame.0.flags & surfelcast_protocol::frame::flags::FINAL != 0;
            frames.push(frame);
            if is_final {
                return frames;
            }
        }
    }

    /// Moves the camera to this x; returns the input number.
    pub(crate) async fn look_from(&mut self, x: f64, phase: &str) -> u32 {
        self.seq += 1;
        let pose = json!({"eye": [x, 1.0, 5.0], "target": [0.0, 0.0, 0.0], "up": [0.0, 1.0, 0.0], "vfov_deg": 40.0});
        self.send(json!({"t": "camera", "seq": self.seq, "ts": 0.0, "pose": pose, "phase": phase})).await;
        self.seq
    }

    pub(crate) async fn small(&mut self) {
        self.send(json!({"t": "view.set", "w": 64, "h": 48})).await;
    }

    /// The close code of the server; earlier messages are dropped.
    pub(crate) async fn close_code(&mut self) -> u16 {
        loop {
            match self.next().await {
                Got::Closed(code) => return code,
                Got::Broken => panic!("broken without a close message"),
                _ => {}
            }
        }
    }

    /// Asserts that nothing comes for a while.
    pub(crate) async fn silence(&mut self, time: Duration) {
        if let Ok(got) = tokio::time::timeout(time, self.ws.next()).await {
            panic!("expected silence, got {got:?}");
        }
    }
}
