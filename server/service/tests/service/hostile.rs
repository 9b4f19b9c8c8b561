//! Clients that do not keep to the protocol, or do not read.

use std::time::{Duration, Instant};

use serde_json::json;
use tokio::net::TcpSocket;
use tungstenite::Message;

use crate::fake::{FakeBehaviour, Recorded};
use crate::support::{Client, Got, Service};

use futures_util::SinkExt;

#[tokio::test]
async fn hello_must_come_first_whole_and_in_time() {
    let service = Service::with(FakeBehaviour::default(), |c| c.limits.hello_timeout_ms = 200).await;
    assert_eq!(service.connect().await.close_code().await, 4408);
    let first = |message: serde_json::Value| {
        let service = &service;
        async move {
            let mut client = service.connect().await;
            client.send(message).await;
            client.close_code().await
        }
    };
    let caps = json!({"codecs": ["jpeg"]});
    assert_eq!(first(json!({"t": "camera"})).await, 4400);
    assert_eq!(first(json!({"t": "ping", "ts": 1})).await, 4400);
    assert_eq!(first(json!({"t": "hello", "v": [1]})).await, 4400);
    assert_eq!(first(json!({"t": "hello", "v": [2, 3], "caps": caps})).await, 4426);
    assert_eq!(first(json!({"t": "hello", "v": [1], "caps": {"codecs": []}})).await, 4400);
    assert_eq!(first(json!({"t": "hello", "v": [1], "caps": caps, "client": "x".repeat(20_000)})).await, 1009);
    assert_eq!(first(json!({"t": "hello", "v": [1], "caps": caps, "client": "x".repeat(100_000)})).await, 1009);
    for session in ["0000000000000000", "x", "..", &service.session().to_uppercase()] {
        let mut client = service.connect_to(session).await;
        client.send(json!({"t": "hello", "v": [1], "caps": caps})).await;
        assert_eq!(client.close_code().await, 4404, "{session}");
    }
}

#[tokio::test]
async fn foreign_pages_cannot_connect() {
    let service = Service::start().await;
    for (name, value) in [("origin", "http://evil.example"), ("origin", "null"), ("host", "evil.example")] {
        let url = format!("ws://{}/v1/sessions/{}/stream", service.addr, service.session());
        let mut request = tungstenite::client::IntoClientRequest::into_client_request(url).expect("a URL");
        request.headers_mut().insert(name, value.parse().expect("a value"));
        let error = tokio_tungstenite::connect_async(request).await.expect_err("refused");
        assert!(error.to_string().contains("403"), "{name}: {value}: {error}");
    }
}

#[tokio::test]
async fn nonsense_is_answered_and_survived() {
    let service = Service::start().await;
    let mut client = service.client().await;
    client.small().await;
    client.until_final().await;
    let pose = |eye: &str, up: &str, vfov: &str| {
        format!(
            r#"{{"t":"camera","id":1,"seq":5,"pose":{{"eye":{eye},"target":[0,0,0],"up":{up},"vfov_deg":{vfov}}},"phase":"end"}}"#
        )
    };
    for (text, code) in [
        (pose("[0,0,1e300]", "[0,1,0]", "40"), "invalid_value"),
        (pose("[0,0,0]", "[0,1,0]", "40"), "invalid_value"),
        (pose("[0,0,1]", "[0,0,0]", "40"), "invalid_value"),
        (pose("[0,0,1]", "[0,0,1]", "40"), "invalid_value"),
        (pose("[0,0,1]", "[0,1,0]", "-1"), "invalid_value"),
        (pose("[0,0,null]", "[0,1,0]", "40"), "invalid_message"),
        (pose("[0,0]", "[0,1,0]", "40"), "invalid_message"),
        (r#"{"t":"dance","id":1}"#.to_owned(), "unsupported"),
        (r#"{"t":"still","id":1,"view":3}"#.to_owned(), "unknown_view"),
        (r#"{"t":"hello","id":1,"v":[1],"caps":{"codecs":["png"]}}"#.to_owned(), "unexpected"),
    ] {
        client.send_text(text.clone()).await;
        let error = client.text("error").await;
        assert_eq!((error["code"].as_str(), error["re"].as_u64()), (Some(code), Some(1)), "{text}");
    }
    client.send_text(pose("[0,0,1e999]", "[0,1,0]", "40")).await;
    assert_eq!(client.text("error").await["code"], "malformed", "a number beyond any float is no JSON number");
    // Refused inputs have not spent their number, and the view still works.
    client.send_text(pose("[0,0,4]", "[0,1,0]", "40")).await;
    let frames = client.until_final().await;
    assert_eq!(frames.last().map(|(header, _)| header.input_seq), Some(5));
    client.send_text(pose("[0,0,9]", "[0,1,0]", "40")).await;
    assert_eq!(client.text("error").await["code"], "stale_input");
    assert!(
        !service.fake.recorded().iter().any(|recorded| matches!(recorded, Recorded::View { x, .. } if !x.is_finite()))
    );
}

#[tokio::test]
async fn repeated_rubbish_ends_the_connection() {
    let service = Service::start().await;
    let mut client = service.client().await;
    for _ in 0..3 {
        client.send_text("{").await;
    }
    assert_eq!(client.close_code().await, 4400);
    let mut client = service.client().await;
    client.ws.send(Message::binary(vec![1, 2, 3])).await.expect("sends");
    assert_eq!(client.close_code().await, 4400);
    let mut client = service.client().await;
    client.send_text(format!("{{\"t\":\"ping\",\"ts\":1,\"x\":\"{}\"}}", "y".repeat(70_000))).await;
    assert_eq!(client.close_code().await, 1009);
    let mut client = service.client().await;
    client.send_text("[".repeat(60_000)).await;
    assert_eq!(client.text("error").await["code"], "malformed", "depth is bounded");
    service.until("all views are closed", |fake| fake.count(|t| *t == Recorded::CloseView) == 3).await;
}

#[tokio::test]
async fn inputs_are_rationed() {
    let service = Service::start().await;
    let mut client = service.client().await;
    for i in 0..400 {
        client.look_from(f64::from(i), "move").await;
    }
    assert_eq!(client.close_code().await, 4429);
    // The renderer saw the newest states, not all of them: the slot holds one.
    let updates = service.fake.count(|recorded| matches!(recorded, Recorded::View { .. }));
    assert!(updates <= 260, "{updates}");
}

#[tokio::test]
async fn lying_acks_change_nothing() {
    let service = Service::start().await;
    let mut client = service.client().await;
    client.small().await;
    let (first, _) = client.unacked_frame().await;
    for seq in [0, 999, u32::MAX, first.frame_seq + 1000] {
        client.ack(seq).await;
    }
    client.send(json!({"t": "ack", "view": 9, "seq": first.frame_seq})).await;
    client.send(json!({"t": "ack", "seq": first.frame_seq, "decode_us": u32::MAX})).await;
    client.ack(first.frame_seq).await;
    client.until_final().await;
    let metrics = String::from_utf8(service.get("/metrics").await.body).expect("text");
    let ignored = metrics.lines().find_map(|line| line.strip_prefix("surfelcast_acks_ignored_total "));
    assert!(ignored.and_then(|count| count.parse::<u32>().ok()).is_some_and(|count| count >= 6), "{ignored:?}");
}

#[tokio::test]
async fn without_acks_the_view_stops_and_then_ends() {
    let behaviour = FakeBehaviour { final_samples: u32::MAX, ..FakeBehaviour::default() };
    let service = Service::with(behaviour, |c| {
        c.timeouts.ack_stop = Duration::from_millis(900);
        c.timeouts.ack_close = Duration::from_millis(1800);
    })
    .await;
    let mut client = service.client().await;
    client.small().await;
    let began = Instant::now();
    let mut frames = 0;
    let code = loop {
        match client.next().await {
            Got::Frame(..) => frames += 1,
            Got::Closed(code) => break code,
            Got::Broken => panic!("no close message"),
            Got::Text(_) => {}
        }
    };
    assert_eq!((code, frames), (4408, 2), "no more than the window");
    assert!(began.elapsed() >= Duration::from_millis(1700), "{:?}", began.elapsed());
    service.until("the view is closed", |fake| fake.count(|t| *t == Recorded::CloseView) == 1).await;
}

/// A client with the smallest receive buffer, so that the server feels it early.
async fn narrow_client(service: &Service) -> Client {
    let socket = TcpSocket::new_v4().expect("a socket");
    socket.set_recv_buffer_size(2048).expect("sets");
    let socket = socket.connect(service.addr).await.expect("connects");
    let mut client = Client::upgrade(socket, service.addr, &service.session()).await.expect("upgrades");
    client.hello(json!(["png"])).await;
    client
}

#[tokio::test]
async fn a_frozen_reader_is_let_go_and_disturbs_nobody() {
    let service = Service::with(FakeBehaviour::default(), |c| c.timeouts.ack_close = Duration::from_mins(1)).await;
    let mut frozen = narrow_client(&service).await;
    // Lossless frames of noise, 3 MB each: the socket buffers fill at once.
    frozen.send(json!({"t": "view.set", "w": 1280, "h": 800})).await;
    frozen.look_from(2.0, "end").await;
    let mut lively = service.client().await;
    lively.small().await;
    let began = Instant::now();
    let mut slowest = Duration::ZERO;
    for i in 0..20 {
        let asked = Instant::now();
        let seq = lively.look_from(f64::from(i), "move").await;
        while lively.frame().await.0.input_seq < seq {}
        slowest = slowest.max(asked.elapsed());
    }
    // Long enough for any machine, short against the patience of a blocked queue.
    assert!(slowest < Duration::from_secs(3), "{slowest:?}");
    service.until("the frozen view is closed", |fake| fake.count(|t| *t == Recorded::CloseView) == 1).await;
    assert!(began.elapsed() < Duration::from_secs(10));
    drop(frozen);
}

#[tokio::test]
async fn control_messages_that_pile_up_disconnect_by_number() {
    pile_up(16, usize::MAX >> 8).await;
}

#[tokio::test]
async fn control_messages_that_pile_up_disconnect_by_bytes() {
    pile_up(100_000, 64 << 10).await;
}

async fn pile_up(messages: usize, bytes: usize) {
    // The frozen client gets no frames (paused), only other people's light edits.
    let service = Service::with(FakeBehaviour::default(), |c| {
        c.bounds.outbox_messages = messages;
        c.bounds.outbox_bytes = bytes;
        c.timeouts.send_stall = Duration::from_mins(1);
    })
    .await;
    let mut frozen = narrow_client(&service).await;
    frozen.send(json!({"id": 1, "t": "view.set", "paused": true})).await;
    frozen.text("ok").await;
    let mut editor = service.client().await;
    editor.send(json!({"t": "view.set", "paused": true})).await;
    let lamp = json!({"id": 0, "name": "n".repeat(100), "kind": "point", "position": [0.123, 1, 0], "direction": [0, -1, 0],
        "color": [1, 1, 1], "intensity": 5});
    let mut seq = 0;
    let began = Instant::now();
    while service.fake.count(|t| *t == Recorded::CloseView) == 0 {
        seq += 1;
        let patch = if seq < 200 { json!({"add": lamp}) } else { json!({"emissive_strength": f64::from(seq % 7)}) };
        editor.send(json!({"t": "light", "seq": seq, "patch": patch, "phase": "move"})).await;
        editor.text("lights").await;
        tokio::time::sleep(Duration::from_millis(5)).await;
        assert!(began.elapsed() < Duration::from_secs(25), "still connected after {seq} edits");
    }
    editor.send(json!({"t": "ping", "ts": 1})).await;
    editor.text("pong").await;
    drop(frozen);
}

#[tokio::test]
async fn a_reader_of_a_kilobyte_a_second_only_slows_itself() {
    let service = Service::with(FakeBehaviour::default(), |c| {
        c.timeouts.ack_stop = Duration::from_millis(500);
        c.timeouts.ack_close = Duration::from_secs(2);
    })
    .await;
    let socket = TcpSocket::new_v4().expect("a socket");
    socket.set_recv_buffer_size(2048).expect("sets");
    let socket = socket.connect(service.addr).await.expect("connects");
    let mut slow = Client::upgrade(socket, service.addr, &service.session()).await.expect("upgrades");
    slow.hello(json!(["png"])).await;
    slow.send(json!({"t": "view.set", "w": 1280, "h": 800})).await;
    let reader = tokio::spawn(async move {
        let tokio_tungstenite::MaybeTlsStream::Plain(socket) = slow.ws.get_mut() else { return };
        let mut piece = [0; 256];
        while tokio::io::AsyncReadExt::read(socket, &mut piece).await.is_ok_and(|count| count > 0) {
            tokio::time::sleep(Duration::from_millis(250)).await;
        }
    });
    service.until("the slow view is closed", |fake| fake.count(|t| *t == Recorded::CloseView) == 1).await;
    reader.abort();
    let mut other = service.client().await;
    other.small().await;
    other.until_final().await;
}
