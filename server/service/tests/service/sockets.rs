//! Raw sockets against the accept loop: slow, long and many.

use std::time::{Duration, Instant};

use serde_json::json;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

use crate::fake::FakeBehaviour;
use crate::support::{SOON, Service};

async fn read_all(socket: &mut TcpStream) -> String {
    let mut bytes = Vec::new();
    // A reset ends the connection as well.
    let _ = tokio::time::timeout(SOON, socket.read_to_end(&mut bytes)).await.expect("the server ends the connection");
    String::from_utf8_lossy(&bytes).into_owned()
}

async fn alive(service: &Service) {
    let mut socket = TcpStream::connect(service.addr).await.expect("connects");
    let request = "GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
    socket.write_all(request.as_bytes()).await.expect("writes");
    assert!(read_all(&mut socket).await.starts_with("HTTP/1.1 200"), "the server still answers");
}

#[tokio::test]
async fn headers_that_drip_are_cut_off() {
    let service = Service::with(FakeBehaviour::default(), |c| c.timeouts.header = Duration::from_millis(300)).await;
    let began = Instant::now();
    let mut silent = TcpStream::connect(service.addr).await.expect("connects");
    let mut dripping = TcpStream::connect(service.addr).await.expect("connects");
    dripping.write_all(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n").await.expect("writes");
    let drip = async {
        for _ in 0..100 {
            if dripping.write_all(b"X-A: b\r\n").await.is_err() {
                break;
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        began.elapsed()
    };
    let (silent_end, drip_end) = tokio::join!(
        async {
            read_all(&mut silent).await;
            began.elapsed()
        },
        drip
    );
    for end in [silent_end, drip_end] {
        assert!(end >= Duration::from_millis(250) && end < Duration::from_secs(4), "{end:?}");
    }
    alive(&service).await;
}

#[tokio::test]
async fn idle_keep_alive_connections_are_closed() {
    let service = Service::with(FakeBehaviour::default(), |c| c.timeouts.header = Duration::from_millis(300)).await;
    let mut socket = TcpStream::connect(service.addr).await.expect("connects");
    socket.write_all(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n").await.expect("writes");
    assert!(read_all(&mut socket).await.starts_with("HTTP/1.1 200"), "answered, then closed for idleness");
}

#[tokio::test]
async fn header_bombs_are_refused() {
    let service = Service::start().await;
    for bomb in [
        format!("X-Long: {}\r\n", "a".repeat(1 << 20)),
        "X-Many: a\r\n".repeat(10_000),
        format!("Sec-WebSocket-Key: {}\r\nUpgrade: websocket\r\n", "a".repeat(1 << 20)),
    ] {
        let mut socket = TcpStream::connect(service.addr).await.expect("connects");
        let request = format!("GET /v1/scenes HTTP/1.1\r\nHost: localhost\r\n{bomb}\r\n");
        // The server may hang up before it has read all.
        let _ = socket.write_all(request.as_bytes()).await;
        let answer = read_all(&mut socket).await;
        assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 431"), "{answer}");
    }
    alive(&service).await;
}

#[tokio::test]
async fn bodies_that_stall_or_drip_are_cut_off() {
    let service = Service::with(FakeBehaviour::default(), |c| {
        c.timeouts.body_stall = Duration::from_millis(300);
        c.timeouts.body_grace = Duration::from_millis(600);
    })
    .await;
    let head = "POST /v1/scenes HTTP/1.1\r\nHost: localhost\r\nContent-Type: model/gltf+json\r\nContent-Length: 100000\r\n\r\n";
    let mut stalled = TcpStream::connect(service.addr).await.expect("connects");
    stalled.write_all(head.as_bytes()).await.expect("writes");
    let mut dripping = TcpStream::connect(service.addr).await.expect("connects");
    dripping.write_all(head.as_bytes()).await.expect("writes");
    let (mut reader, mut writer) = dripping.into_split();
    let dripper = tokio::spawn(async move {
        while writer.write_all(b"x").await.is_ok() {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    });
    assert!(read_all(&mut stalled).await.contains("body_too_slow"));
    let mut answer = vec![0; 4096];
    let count = tokio::time::timeout(SOON, reader.read(&mut answer)).await.expect("an answer").expect("an answer");
    assert!(String::from_utf8_lossy(&answer[..count]).starts_with("HTTP/1.1 408"));
    dripper.abort();
    alive(&service).await;
}

#[tokio::test]
async fn connections_are_counted() {
    let service = Service::with(FakeBehaviour::default(), |c| c.bounds.connections_per_ip = 3).await;
    let mut held = Vec::new();
    for _ in 0..2 {
        held.push(service.client().await);
    }
    let one = TcpStream::connect(service.addr).await.expect("connects");
    tokio::time::sleep(Duration::from_millis(50)).await;
    let mut refused = TcpStream::connect(service.addr).await.expect("connects");
    assert!(read_all(&mut refused).await.starts_with("HTTP/1.1 503"));
    // WebSockets count as long as they live, and no longer.
    held.pop();
    drop(one);
    tokio::time::sleep(Duration::from_millis(200)).await;
    alive(&service).await;
}

#[tokio::test]
async fn a_client_that_does_not_read_its_answer_is_disconnected() {
    let service =
        Service::with(FakeBehaviour::default(), |c| c.timeouts.write_stall = Duration::from_millis(300)).await;
    let body = json!({"scene": service.scene_id(), "width": 2048, "height": 1024, "seed": 3}).to_string();
    let socket = tokio::net::TcpSocket::new_v4().expect("a socket");
    socket.set_recv_buffer_size(4096).expect("sets");
    let mut socket = socket.connect(service.addr).await.expect("connects");
    let request = format!(
        "POST /v1/renders HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nPrefer: wait=10\r\n\
         Accept: image/x-exr\r\nContent-Length: {}\r\n\r\n{body}",
        body.len()
    );
    socket.write_all(request.as_bytes()).await.expect("writes");
    tokio::time::sleep(Duration::from_secs(3)).await;
    let mut bytes = Vec::new();
    let _ = tokio::time::timeout(SOON, socket.read_to_end(&mut bytes)).await.expect("the server has hung up");
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(2000)]).to_lowercase();
    let stated: usize = head
        .lines()
        .find_map(|line| line.strip_prefix("content-length: "))
        .and_then(|length| length.parse().ok())
        .expect("a length");
    assert!(stated > 5_000_000 && bytes.len() < stated, "{} of {stated} bytes came", bytes.len());
    alive(&service).await;
}
