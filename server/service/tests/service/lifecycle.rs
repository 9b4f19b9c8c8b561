//! Coming, going, coming back, and the end of the server or the device.

use std::time::{Duration, Instant};

use axum::http::StatusCode;
use serde_json::json;
use surfelcast_renderer::{DeviceState, RendererError};

use crate::fake::{FakeBehaviour, Recorded};
use crate::support::{Got, Service};

#[tokio::test]
async fn sessions_open_at_the_first_view_and_close_after_the_last() {
    let service =
        Service::with(FakeBehaviour::default(), |c| c.timeouts.session_grace = Duration::from_millis(300)).await;
    assert!(service.fake.recorded().is_empty(), "nothing is uploaded for nobody");
    let one = service.client().await;
    let two = service.client().await;
    assert_eq!(service.fake.count(|t| *t == Recorded::OpenSession), 1, "one session for all");
    drop((one, two));
    service.until("both views are closed", |fake| fake.count(|t| *t == Recorded::CloseView) == 2).await;
    let again = service.client().await;
    tokio::time::sleep(Duration::from_millis(600)).await;
    assert_eq!(service.fake.count(|t| *t == Recorded::CloseSession), 0, "a reload within the grace finds it warm");
    drop(again);
    service.until("the session is closed", |fake| fake.count(|t| *t == Recorded::CloseSession) == 1).await;
    let _late = service.client().await;
    assert_eq!(service.fake.count(|t| *t == Recorded::OpenSession), 2);
}

#[tokio::test]
async fn light_edits_outlive_a_short_absence() {
    let service =
        Service::with(FakeBehaviour::default(), |c| c.timeouts.session_grace = Duration::from_millis(50)).await;
    let mut client = service.client().await;
    client.send(json!({"id": 1, "t": "light", "seq": 1, "patch": {"emissive_strength": 2.5}, "phase": "end"})).await;
    client.text("ok").await;
    drop(client);
    service.until("the session is closed", |fake| fake.count(|t| *t == Recorded::CloseSession) == 1).await;
    let mut client = service.connect().await;
    client.send(json!({"t": "hello", "v": [1], "caps": {"codecs": ["jpeg"]}})).await;
    let lights = client.text("lights").await;
    assert_eq!((lights["emissive_strength"].as_f64(), lights["scene_rev"].as_u64()), (Some(2.5), Some(2)));
    service
        .until("the renderer knows them", |fake| {
            fake.count(|t| matches!(t, Recorded::Lights { scene_rev: 2, .. })) == 2
        })
        .await;
}

#[tokio::test]
async fn a_view_can_be_resumed() {
    let service = Service::with(FakeBehaviour::default(), |c| c.timeouts.reconnect = Duration::ZERO).await;
    let mut client = service.client().await;
    client.small().await;
    client.send(json!({"t": "view.set", "aov": "normal"})).await;
    client.look_from(6.0, "end").await;
    client.until_final().await;
    let token = client.welcome["resume_token"].clone();
    let resume =
        |token: serde_json::Value| json!({"t": "hello", "v": [1], "caps": {"codecs": ["jpeg"]}, "resume": token});
    let mut second = service.connect().await;
    second.send(resume(token.clone())).await;
    let welcome = second.text("welcome").await;
    assert_ne!(welcome["resume_token"], token, "tokens change");
    assert_eq!(client.close_code().await, 4409, "the old connection is superseded");
    let (header, _) = second.frame().await;
    assert_eq!(header.full_size, [64, 48], "the view stands where it stood");
    assert_eq!(service.fake.count(|t| *t == Recorded::Shows(Some("normal".to_owned()))), 2, "and shows what it showed");
    second.send(json!({"id": 1, "t": "pick", "x": 0.5, "y": 0.5})).await;
    assert_eq!(second.text("picked").await["position"][0], 6.0);
    // A used token resumes nothing; the client begins with the view of the scene.
    let mut third = service.connect().await;
    third.send(resume(token)).await;
    third.text("welcome").await;
    assert_eq!(third.frame().await.0.full_size, [1280, 720]);
}

#[tokio::test]
async fn coming_back_at_once_is_refused() {
    let service = Service::with(FakeBehaviour::default(), |c| {
        assert_eq!(c.timeouts.reconnect, Duration::from_millis(500));
        c.timeouts.reconnect = Duration::from_secs(2);
    })
    .await;
    let began = Instant::now();
    let client = service.client().await;
    let token = client.welcome["resume_token"].clone();
    drop(client);
    let resume = json!({"t": "hello", "v": [1], "caps": {"codecs": ["jpeg"]}, "resume": token});
    let mut refusals = 0;
    loop {
        let mut again = service.connect().await;
        again.send(resume.clone()).await;
        match again.next().await {
            Got::Closed(4429) => refusals += 1,
            Got::Text(welcome) if welcome["t"] == "welcome" => break,
            other => panic!("{other:?}"),
        }
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    assert!(refusals > 0 && began.elapsed() >= Duration::from_secs(2), "{refusals} in {:?}", began.elapsed());
    // Others are not meant, not even from the same address.
    service.client().await;
    service.client().await;
}

#[tokio::test]
async fn sessions_are_bounded_and_refusals_have_codes() {
    let service = Service::with(FakeBehaviour::default(), |c| c.limits.views_per_session = 2).await;
    let _held = (service.client().await, service.client().await);
    let hello = json!({"t": "hello", "v": [1], "caps": {"codecs": ["jpeg"]}});
    let mut third = service.connect().await;
    third.send(hello.clone()).await;
    assert_eq!(third.close_code().await, 1013);
    let no_memory = RendererError::NoMemory { needed: 10, free: 5 };
    let full =
        Service::with(FakeBehaviour { session_error: Some(no_memory), ..FakeBehaviour::default() }, |_| {}).await;
    let mut client = full.connect().await;
    client.send(hello).await;
    assert_eq!(client.close_code().await, 4503);
}

#[tokio::test]
async fn a_lost_device_is_announced_and_survived() {
    let service = Service::start().await;
    let mut client = service.client().await;
    client.small().await;
    client.until_final().await;
    service.fake.set_state(DeviceState::Lost);
    assert_eq!(client.text("notice").await["kind"], "device_lost");
    assert_eq!(service.get("/readyz").await.status, StatusCode::SERVICE_UNAVAILABLE);
    service.fake.set_state(DeviceState::Ready);
    assert_eq!(client.text("notice").await["kind"], "restored");
    client.look_from(2.0, "end").await;
    client.until_final().await;
    assert_eq!(service.client().await.welcome["session"]["epoch"], 1);
    service.fake.set_state(DeviceState::Failed);
    assert_eq!(client.close_code().await, 4507);
}

#[tokio::test]
async fn draining_lets_work_finish() {
    let behaviour = FakeBehaviour { job_time: Duration::from_millis(700), ..FakeBehaviour::default() };
    let mut service = Service::with(behaviour, |_| {}).await;
    let mut client = service.client().await;
    client.small().await;
    client.until_final().await;
    let mut waiting = service.connect().await;
    let body = json!({"scene": service.scene_id(), "width": 16, "height": 16}).to_string();
    let request = format!(
        "POST /v1/renders HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nPrefer: wait=10\r\n\
         Accept: image/png\r\nContent-Length: {}\r\n\r\n{body}",
        body.len()
    );
    let mut socket = tokio::net::TcpStream::connect(service.addr).await.expect("connects");
    tokio::io::AsyncWriteExt::write_all(&mut socket, request.as_bytes()).await.expect("writes");
    service.until("the job runs", |fake| fake.count(|t| matches!(t, Recorded::Render { .. })) == 1).await;
    let began = Instant::now();
    service.shutdown.cancel();
    assert_eq!(client.text("notice").await["kind"], "draining");
    assert_eq!(client.close_code().await, 1012);
    assert_eq!(waiting.close_code().await, 1012, "even before hello");
    assert_eq!(service.get("/readyz").await.problem(), "draining");
    assert_eq!(service.get("/healthz").await.status, StatusCode::OK, "alive while draining");
    let refused = service.post("/v1/renders", &[("content-type", "application/json")], body).await;
    assert_eq!(refused.problem(), "draining");
    let mut answer = Vec::new();
    tokio::io::AsyncReadExt::read_to_end(&mut socket, &mut answer).await.expect("reads");
    let head = String::from_utf8_lossy(&answer[..answer.len().min(400)]).into_owned();
    assert!(head.starts_with("HTTP/1.1 200") && head.contains("image/png"), "the render in flight is answered: {head}");
    (&mut service.task).await.expect("no panic").expect("no error");
    assert!(began.elapsed() < Duration::from_secs(8), "{:?}", began.elapsed());
    assert!(tokio::net::TcpStream::connect(service.addr).await.is_err(), "nobody listens any more");
}

#[tokio::test]
async fn draining_has_a_deadline() {
    let behaviour = FakeBehaviour { job_time: Duration::from_hours(1), ..FakeBehaviour::default() };
    let mut service = Service::with(behaviour, |c| c.timeouts.drain = Duration::from_millis(300)).await;
    let body = json!({"scene": service.scene_id()}).to_string();
    service.post("/v1/renders", &[("content-type", "application/json")], body).await;
    let began = Instant::now();
    service.shutdown.cancel();
    (&mut service.task).await.expect("no panic").expect("no error");
    assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());
}

/// Resident memory of this process, bytes.
fn resident() -> usize {
    let statm = std::fs::read_to_string("/proc/self/statm").expect("Linux");
    statm.split_whitespace().nth(1).and_then(|pages| pages.parse::<usize>().ok()).expect("a number") * 4096
}

#[tokio::test]
async fn a_thousand_visits_leave_nothing_behind() {
    let service =
        Service::with(FakeBehaviour::default(), |c| c.timeouts.session_grace = Duration::from_millis(1)).await;
    let mut after_warmup = 0;
    for visit in 0..1000 {
        let mut client = service.client().await;
        client.small().await;
        if visit % 10 == 0 {
            client.frame().await;
        }
        drop(client);
        if visit == 300 {
            after_warmup = resident();
        }
    }
    service.until("all views are closed", |fake| fake.count(|t| *t == Recorded::CloseView) == 1000).await;
    let grown = resident().saturating_sub(after_warmup);
    assert!(grown < 12 << 20, "{grown} bytes more after 700 visits");
    let metrics = String::from_utf8(service.get("/metrics").await.body).expect("text");
    assert!(metrics.contains("surfelcast_views 0"), "{metrics}");
}
