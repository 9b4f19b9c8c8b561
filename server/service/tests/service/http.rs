//! Health, metrics, the embedded client, and how errors look.

use std::io::Read;

use axum::body::Body;
use axum::http::{Method, Request, StatusCode};
use flate2::read::GzDecoder;
use surfelcast_renderer::DeviceState;

use crate::fake::FakeBehaviour;
use crate::support::Service;

#[tokio::test]
async fn health_and_readiness_differ() {
    let service = Service::start().await;
    assert_eq!(service.get("/readyz").await.status, StatusCode::OK);
    for (state, reason) in [
        (DeviceState::Starting, "starting"),
        (DeviceState::Lost, "device_lost"),
        (DeviceState::Failed, "device_failed"),
    ] {
        service.fake.set_state(state);
        let answer = service.get("/readyz").await;
        assert_eq!((answer.status, answer.problem().as_str()), (StatusCode::SERVICE_UNAVAILABLE, reason));
        assert_eq!(service.get("/healthz").await.status, StatusCode::OK);
    }
}

#[tokio::test]
async fn metrics_and_version_are_readable() {
    let service = Service::start().await;
    let mut client = service.client().await;
    client.small().await;
    client.until_final().await;
    let text = String::from_utf8(service.get("/metrics").await.body).expect("text");
    for name in [
        "surfelcast_frames_total{stage=\"final\"}",
        "surfelcast_frame_bytes_total",
        "surfelcast_encode_seconds_bucket",
        "surfelcast_round_trip_seconds_count",
        "surfelcast_sessions 1",
        "surfelcast_views 1",
        "surfelcast_ready 1",
        "surfelcast_device_lost_total",
        "surfelcast_device_memory_used_bytes",
    ] {
        assert!(text.contains(name), "{name} is missing in\n{text}");
    }
    let version = service.get("/version").await.json();
    assert_eq!(
        (version["server"].as_str(), version["device"]["name"].as_str()),
        (Some("surfelcast/test"), Some("fake"))
    );
}

#[tokio::test]
async fn every_error_is_a_problem_document() {
    let service = Service::start().await;
    let scene = format!("/v1/scenes/{}", service.scene_id());
    let cases: [(Method, &str, u16); 14] = [
        (Method::GET, "/nothing", 404),
        (Method::GET, "/v1/scenes/sha256:00", 404),
        (Method::GET, "/v1/scenes/..%2f..%2fetc%2fpasswd", 404),
        (Method::GET, "/v1/renders/none", 404),
        (Method::GET, "/v1/renders/none/image", 404),
        (Method::POST, "/v1/renders/none/cancel", 404),
        (Method::DELETE, "/v1/renders/none", 404),
        (Method::DELETE, "/v1/scenes/none", 404),
        (Method::DELETE, &scene, 409),
        (Method::POST, "/v1/renders", 415),
        (Method::POST, "/v1/scenes", 415),
        (Method::PUT, "/v1/scenes", 405),
        (Method::GET, "/assets/no/such/file.js", 404),
        (Method::GET, "/v1/sessions/0011223344556677/stream", 400),
    ];
    for (method, path, status) in cases {
        let request = Request::builder().method(&method).uri(path).header("host", "localhost");
        let answer = service.ask(request.body(Body::empty()).expect("a request")).await;
        assert_eq!(answer.status.as_u16(), status, "{method} {path}");
        answer.problem();
    }
    let foreign = Request::get("/v1/scenes").header("host", "evil.example").body(Body::empty()).expect("a request");
    let answer = service.ask(foreign).await;
    assert_eq!((answer.status, answer.problem().as_str()), (StatusCode::FORBIDDEN, "host_not_allowed"));
}

#[tokio::test]
async fn the_client_is_embedded_and_fenced_in() {
    let service = Service::start().await;
    let page = service.get("/").await;
    assert_eq!((page.status, page.header("content-type")), (StatusCode::OK, "text/html; charset=utf-8"));
    assert_eq!(page.header("x-content-type-options"), "nosniff");
    let policy = page.header("content-security-policy");
    for part in ["default-src 'self'", "script-src 'self'", "frame-ancestors 'self'", "object-src 'none'"] {
        assert!(policy.contains(part), "{policy}");
    }
    assert!(!policy.contains("unsafe"), "{policy}");
    let known = Request::get("/").header("host", "localhost").header("if-none-match", page.header("etag"));
    let again = service.ask(known.body(Body::empty()).expect("a request")).await;
    assert_eq!((again.status, again.body.len()), (StatusCode::NOT_MODIFIED, 0));
    for path in ["package.json", "node_modules/playwright-core/package.json", "tests/page.test.js", "../Cargo.toml"] {
        assert_eq!(service.get(&format!("/assets/{path}")).await.status, StatusCode::NOT_FOUND, "{path}");
    }
}

const APP: &str = "https://app.example";

async fn cross_origin(service: &Service, method: Method, path: &str, extra: &[(&str, &str)]) -> crate::support::Answer {
    let mut request = Request::builder().method(method).uri(path).header("host", "localhost");
    for (name, value) in extra {
        request = request.header(*name, *value);
    }
    service.ask(request.body(Body::empty()).expect("a request")).await
}

#[tokio::test]
async fn pages_of_listed_origins_may_read_answers() {
    let service = Service::with(FakeBehaviour::default(), |c| c.origins.push(format!("{APP}/"))).await;
    // Errors too: a page must be able to show why.
    for (path, status) in [("/v1/scenes", 200), ("/v1/renders/none", 404), ("/version", 200)] {
        let answer = cross_origin(&service, Method::GET, path, &[("origin", APP)]).await;
        assert_eq!(answer.status.as_u16(), status);
        assert_eq!(answer.header("access-control-allow-origin"), APP);
        assert!(answer.headers.get_all("vary").iter().any(|value| value == "Origin"), "{answer:?}");
        assert!(answer.headers.get("access-control-allow-credentials").is_none());
        for name in ["ETag", "Location", "Retry-After", "Surfelcast-Error-Std", "Surfelcast-Samples"] {
            assert!(answer.header("access-control-expose-headers").contains(name), "{name}");
        }
    }
    let own = cross_origin(&service, Method::GET, "/v1/scenes", &[("origin", "http://localhost")]).await;
    let none = cross_origin(&service, Method::GET, "/v1/scenes", &[]).await;
    for answer in [own, none] {
        assert_eq!(answer.status, StatusCode::OK);
        assert!(answer.headers.get("access-control-allow-origin").is_none());
        assert!(answer.headers.get_all("vary").iter().any(|value| value == "Origin"), "{answer:?}");
    }
    let foreign = cross_origin(&service, Method::GET, "/v1/scenes", &[("origin", "https://evil.example")]).await;
    assert_eq!(foreign.problem(), "origin_not_allowed");
    assert!(foreign.headers.get("access-control-allow-origin").is_none());
}

#[tokio::test]
async fn preflights_of_listed_origins_are_answered() {
    let service = Service::with(FakeBehaviour::default(), |c| c.origins.push(APP.into())).await;
    let ask = [("access-control-request-method", "POST"), ("access-control-request-headers", "content-type,prefer")];
    let answer = cross_origin(&service, Method::OPTIONS, "/v1/renders", &[("origin", APP), ask[0], ask[1]]).await;
    assert_eq!((answer.status, answer.body.len()), (StatusCode::NO_CONTENT, 0));
    assert_eq!(answer.header("access-control-allow-origin"), APP);
    assert_eq!(answer.header("access-control-allow-methods"), "GET, POST, DELETE");
    for name in ["Content-Type", "Prefer", "Accept", "Idempotency-Key", "If-None-Match"] {
        assert!(answer.header("access-control-allow-headers").contains(name), "{name}");
    }
    let foreign =
        cross_origin(&service, Method::OPTIONS, "/v1/renders", &[("origin", "https://evil.example"), ask[0]]).await;
    assert_eq!(foreign.status, StatusCode::FORBIDDEN);
    assert!(foreign.headers.get("access-control-allow-methods").is_none());
    let plain = cross_origin(&service, Method::OPTIONS, "/v1/renders", &[("origin", APP)]).await;
    assert_eq!(plain.status, StatusCode::METHOD_NOT_ALLOWED, "not a preflight");
}

#[tokio::test]
async fn text_is_compressed_where_accepted() {
    let service = Service::start().await;
    let get = |path: &'static str, extra: Vec<(&'static str, String)>| {
        let mut request = Request::get(path).header("host", "localhost");
        for (name, value) in extra {
            request = request.header(name, value);
        }
        service.ask(request.body(Body::empty()).expect("a request"))
    };
    for path in ["/", "/docs", "/assets/src/page/main.js", "/assets/styles/page.css", "/assets/styles/icon.svg"] {
        let plain = get(path, vec![]).await;
        let small = get(path, vec![("accept-encoding", "br, gzip".into())]).await;
        assert_eq!((plain.status, small.status), (StatusCode::OK, StatusCode::OK), "{path}");
        assert_eq!((plain.header("content-encoding"), small.header("content-encoding")), ("", "gzip"), "{path}");
        assert_eq!(plain.header("content-type"), small.header("content-type"));
        assert_ne!(plain.header("etag"), small.header("etag"));
        let mut unpacked = Vec::new();
        GzDecoder::new(small.body.as_slice()).read_to_end(&mut unpacked).expect("gzip");
        assert!(unpacked == plain.body && small.body.len() < plain.body.len(), "{path}");
        for answer in [&plain, &small] {
            assert!(answer.headers.get_all("vary").iter().any(|value| value == "Accept-Encoding"), "{path}");
        }
        let tag = || ("if-none-match", small.header("etag").to_owned());
        let known = get(path, vec![("accept-encoding", "gzip".into()), tag()]).await;
        assert_eq!((known.status, known.body.len()), (StatusCode::NOT_MODIFIED, 0));
        assert_eq!(get(path, vec![tag()]).await.status, StatusCode::OK, "that tag is of another representation");
    }
}
