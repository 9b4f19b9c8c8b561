//! Renders over HTTP: the picture, its job, its tag, and doing things once.

use std::time::Duration;

use axum::body::Body;
use axum::http::{HeaderName, Request, StatusCode};
use serde_json::{Value, json};
use surfelcast_renderer::{DeviceState, RendererError};

use crate::fake::{FakeBehaviour, Recorded};
use crate::support::{Answer, Service};
use crate::test_catalogue::catalogue;

fn body(service: &Service, more: &Value) -> String {
    let mut body = json!({"scene": service.scene_id(), "width": 32, "height": 24, "samples_per_pixel": 4});
    body.as_object_mut().expect("an object").extend(more.as_object().expect("an object").clone());
    body.to_string()
}

async fn render(service: &Service, headers: &[(&str, &str)], more: Value) -> Answer {
    let headers: Vec<(&str, &str)> =
        [("content-type", "application/json")].into_iter().chain(headers.iter().copied()).collect();
    service.post("/v1/renders", &headers, body(service, &more)).await
}

fn renders(service: &Service) -> usize {
    service.fake.count(|recorded| matches!(recorded, Recorded::Render { .. }))
}

#[tokio::test]
async fn a_picture_at_once_in_every_format() {
    let service = Service::start().await;
    for (accept, mime) in [
        ("image/png", "image/png"),
        ("image/jpeg", "image/jpeg"),
        ("image/avif, image/webp;q=0.5", "image/webp"),
        ("image/x-exr", "image/x-exr"),
        ("*/*", "image/png"),
    ] {
        let answer = render(&service, &[("accept", accept), ("prefer", "wait=10")], json!({})).await;
        assert_eq!((answer.status, answer.header("content-type")), (StatusCode::OK, mime), "{accept}");
        assert_eq!(answer.header("surfelcast-error-rmse"), "0.0125");
        assert_eq!(answer.header("surfelcast-error-std"), "0.001");
        assert_eq!(answer.header("surfelcast-samples"), "4");
        assert_eq!(answer.header("surfelcast-render-secs"), "0.25");
        assert_eq!((answer.header("vary"), answer.header("preference-applied")), ("Accept", "wait=10"));
        if mime != "image/x-exr" {
            let image = image::load_from_memory(&answer.body).expect("decodes");
            assert_eq!((image.width(), image.height()), (32, 24));
        }
    }
    assert_eq!(renders(&service), 1, "one render serves all formats");
}

#[tokio::test]
async fn equal_requests_give_equal_bytes_and_one_render() {
    let service = Service::start().await;
    let ask = || render(&service, &[("accept", "image/png"), ("prefer", "wait=10")], json!({"seed": 7}));
    let (first, second) = tokio::join!(ask(), ask());
    assert_eq!((first.status, &first.body), (StatusCode::OK, &second.body));
    assert_eq!(first.header("etag"), second.header("etag"));
    assert_eq!(renders(&service), 1);
    let path = first.header("content-location").to_owned();
    let get = |headers: Vec<(&'static str, String)>| {
        let mut request = Request::get(&path).header("host", "localhost").header("accept", "image/png");
        for (name, value) in headers {
            request = request.header(name, value);
        }
        service.ask(request.body(Body::empty()).expect("a request"))
    };
    assert_eq!(get(vec![]).await.body, first.body);
    let known = get(vec![("if-none-match", first.header("etag").to_owned())]).await;
    assert_eq!((known.status, known.body.len()), (StatusCode::NOT_MODIFIED, 0));
    assert_eq!(known.header("etag"), first.header("etag"));
    assert_eq!(get(vec![("if-none-match", "\"other\"".to_owned())]).await.status, StatusCode::OK);
    for (field, value) in [
        ("seed", json!(8)),
        ("exposure", json!(2.0)),
        ("samples_per_pixel", json!(5)),
        ("technique", json!("other")),
        ("materials", json!("lambert")),
        ("preset", json!("high")),
        ("settings", json!({"radius": 4})),
        ("width", json!(33)),
        ("camera", json!({"position": [0, 0, 9], "target": [0, 0, 0], "vfov_deg": 30})),
    ] {
        let headers = [("accept", "image/png"), ("prefer", "wait=10")];
        let mut more = json!({"seed": 7});
        if field == "preset" || field == "settings" {
            more["technique"] = json!("other");
        }
        more[field] = value;
        let other = render(&service, &headers, more).await;
        assert_eq!(other.status, StatusCode::OK, "{other:?}");
        assert_ne!(other.header("etag"), first.header("etag"), "{field} is part of the tag");
    }
}

#[tokio::test]
async fn a_job_can_be_followed_and_fetched() {
    let behaviour = FakeBehaviour { job_time: Duration::from_millis(400), ..FakeBehaviour::default() };
    let service = Service::with(behaviour, |_| {}).await;
    let accepted = render(&service, &[], json!({})).await;
    assert_eq!(accepted.status, StatusCode::ACCEPTED);
    let location = accepted.header("location").to_owned();
    assert!(!accepted.header("retry-after").is_empty());
    let early = service.get(&format!("{location}/image")).await;
    assert_eq!((early.status, early.problem().as_str()), (StatusCode::CONFLICT, "not_ready"));
    service.until("it runs", |fake| fake.count(|t| matches!(t, Recorded::Render { .. })) == 1).await;
    tokio::time::sleep(Duration::from_millis(20)).await;
    let running = service.get(&location).await;
    assert_eq!((running.json()["status"].as_str(), running.json()["progress"].as_f64()), (Some("running"), Some(0.25)));
    assert!(!running.header("retry-after").is_empty());
    let waited = render(&service, &[("prefer", "wait=10"), ("accept", "application/json")], json!({})).await;
    assert_eq!(waited.json()["status"], "succeeded");
    let done = service.get(&location).await.json();
    assert_eq!((done["status"].as_str(), done["samples"].as_u64()), (Some("succeeded"), Some(4)));
    assert_eq!(done["result"]["memory_bytes"]["scene"], 1234);
    assert_eq!(service.get(&format!("{location}/image")).await.status, StatusCode::OK);
    let delete = Request::delete(&location).header("host", "localhost").body(Body::empty()).expect("a request");
    assert_eq!(service.ask(delete).await.status, StatusCode::NO_CONTENT);
    assert_eq!(service.get(&location).await.status, StatusCode::NOT_FOUND);
    assert_eq!(renders(&service), 1);
}

#[tokio::test]
async fn waiting_is_bounded_by_the_request() {
    let behaviour = FakeBehaviour { job_time: Duration::from_hours(1), ..FakeBehaviour::default() };
    let service = Service::with(behaviour, |_| {}).await;
    let answer = render(&service, &[("prefer", "wait=0"), ("accept", "image/png")], json!({})).await;
    assert_eq!(answer.status, StatusCode::ACCEPTED);
    assert_eq!(answer.json()["image"], format!("{}/image", answer.header("location")));
}

#[tokio::test]
async fn cancel_stops_the_renderer() {
    let behaviour = FakeBehaviour { job_time: Duration::from_hours(1), ..FakeBehaviour::default() };
    let service = Service::with(behaviour, |_| {}).await;
    let location = render(&service, &[], json!({})).await.header("location").to_owned();
    let canceled = service.post(&format!("{location}/cancel"), &[], "").await;
    assert_eq!((canceled.status, canceled.json()["status"].as_str()), (StatusCode::ACCEPTED, Some("canceled")));
    assert_eq!(service.get(&format!("{location}/image")).await.problem(), "render_canceled");
    // An equal request after a cancel is work of its own.
    let again = render(&service, &[], json!({})).await;
    assert_ne!(again.header("location"), location);
    service.until("it is rendered", |fake| fake.count(|t| matches!(t, Recorded::Render { .. })) == 2).await;
}

#[tokio::test]
async fn unacceptable_answers_are_refused_before_the_work() {
    let service = Service::start().await;
    let answer = render(&service, &[("accept", "image/avif"), ("prefer", "wait=5")], json!({})).await;
    assert_eq!((answer.status, answer.problem().as_str()), (StatusCode::NOT_ACCEPTABLE, "not_acceptable"));
    let data = render(&service, &[("accept", "image/jpeg"), ("prefer", "wait=5")], json!({"aov": "depth"})).await;
    assert_eq!(data.status, StatusCode::NOT_ACCEPTABLE, "lossy numbers are of no use");
    assert_eq!(renders(&service), 0);
}

/// Other outputs than radiance come as numbers or as an image to look at, which no exposure touches.
#[tokio::test]
async fn outputs_come_as_exr_and_as_png() {
    let service = Service::start().await;
    let ask = |accept: &'static str, exposure: f64| {
        let more = json!({"aov": "depth", "exposure": exposure});
        let service = &service;
        async move { render(service, &[("accept", accept), ("prefer", "wait=5")], more).await }
    };
    let exr = ask("*/*", 1.0).await;
    assert_eq!((exr.status, exr.header("content-type")), (StatusCode::OK, "image/x-exr"));
    assert_eq!(exr.header("surfelcast-error-rmse"), "");
    let (png, exposed) = (ask("image/png", 1.0).await, ask("image/png", 8.0).await);
    assert_eq!((png.status, png.header("content-type")), (StatusCode::OK, "image/png"));
    assert_eq!(png.body, exposed.body);
}

#[tokio::test]
async fn bad_requests_name_the_field() {
    let service = Service::start().await;
    for (more, status, field) in [
        (json!({"spp": 4}), 400, "spp"),
        (json!({"width": 0}), 422, "width"),
        (json!({"width": 16384, "height": 16384}), 422, "width"),
        (json!({"height": null}), 422, "width"),
        (json!({"technique": "warp"}), 422, "technique"),
        (json!({"reconstruction": "poisson"}), 422, "reconstruction"),
        (json!({"preset": "ultra"}), 422, "preset"),
        (json!({"preset": "high"}), 422, "preset: technique path has no presets; leave it out"),
        (json!({"settings": {"radius": 4}}), 422, "settings.radius: technique path has no such setting"),
        (json!({"technique": "other", "settings": {"radius": 1000}}), 422, "settings.radius: must be within 1.5 to 32"),
        (
            json!({"technique": "other", "settings": {"size": 1}}),
            422,
            "settings.size: no such setting; there are radius",
        ),
        (json!({"technique": "other", "settings": {"rays": true}}), 400, "settings.rays: expected a number"),
        (json!({"aov": "other_density"}), 422, "aov: technique path has no other_density; other has"),
        (json!({"camera_name": "nobody"}), 422, "camera_name"),
        (json!({"camera": {"position": [0, 0, 0], "target": [0, 0, 0], "vfov_deg": 40}}), 422, "camera"),
    ] {
        let answer = render(&service, &[], more).await;
        assert_eq!(answer.status.as_u16(), status, "{field}");
        answer.problem();
        let detail = answer.json()["detail"].as_str().expect("text").to_owned();
        assert!(detail.starts_with(field), "{detail}");
    }
    let unknown = service.post("/v1/renders", &[("content-type", "application/json")], r#"{"scene":"sha256:0"}"#).await;
    assert_eq!(unknown.status, StatusCode::NOT_FOUND);
    let long = format!("{{\"scene\":\"{}\"}}", "x".repeat(100_000));
    let long = service.post("/v1/renders", &[("content-type", "application/json")], long).await;
    assert_eq!(long.status, StatusCode::PAYLOAD_TOO_LARGE);
    assert_eq!(renders(&service), 0);
}

#[tokio::test]
async fn settings_and_outputs_reach_the_renderer() {
    let service = Service::start().await;
    let settings =
        |radius: f64, rays: f64| json!({"radius": radius, "rays": rays, "reconstruction": "poisson", "depth": true});
    for (more, aov, settings) in [
        (json!({}), None, json!({})),
        (json!({"technique": "other"}), None, settings(5.0, 0.5)),
        (json!({"technique": "other", "preset": "preview"}), None, settings(8.0, 0.5)),
        (json!({"preset": null, "settings": null, "seed": 1}), None, json!({})),
        (
            json!({"technique": "other", "preset": "high", "settings": {"radius": 4, "rays": 1.5}}),
            None,
            settings(4.0, 1.5),
        ),
        (json!({"technique": "other", "surfel": {"radius": 4}}), None, settings(4.0, 0.5)),
        (json!({"technique": "other_soft"}), None, settings(16.0, 0.5)),
        (json!({"technique": "other", "aov": "other_d"}), Some("other_density".to_owned()), settings(5.0, 0.5)),
    ] {
        let answer = render(&service, &[("prefer", "wait=10"), ("accept", "application/json")], more.clone()).await;
        assert_eq!(answer.json()["status"], "succeeded", "{more}");
        let seed = more["seed"].as_u64().unwrap_or(0);
        let recorded = service.fake.recorded();
        let last = recorded.iter().rev().find(|recorded| matches!(recorded, Recorded::Render { .. }));
        // One that was rendered before is not rendered again.
        let is_last = last == Some(&Recorded::Render { seed, aov: aov.clone(), settings: settings.clone() });
        assert!(is_last, "{more}: {last:?}");
    }
}

#[tokio::test]
async fn the_api_description_lists_techniques_presets_settings_and_outputs() {
    let service = Service::start().await;
    let document = service.get("/v1/openapi.json").await.json();
    let schemas = &document["components"]["schemas"];
    let settings = &schemas["Settings.other"]["properties"];
    let catalogue = catalogue();
    let other = catalogue.choose("other").expect("a technique").technique;
    assert_eq!(settings.as_object().map(serde_json::Map::len), Some(other.settings.len()));
    for setting in other.settings {
        let described = &settings[setting.id];
        assert!(described["description"].as_str().is_some_and(|text| text.starts_with(setting.help)), "{described}");
        assert_eq!(described["default"], serde_json::to_value(setting.default_value()).expect("encodes"));
    }
    assert_eq!(
        (settings["radius"]["minimum"].as_f64(), settings["radius"]["maximum"].as_f64()),
        (Some(1.5), Some(32.0))
    );
    assert_eq!(settings["reconstruction"]["enum"], json!(["none", "poisson"]));
    assert_eq!(settings["depth"]["type"], "boolean");
    let request = &schemas["RenderRequest"];
    assert_eq!(request["required"], json!(["scene"]));
    let fields = &request["properties"];
    assert_eq!(fields["technique"]["enum"], json!(["path", "other", "other_soft"]));
    assert_eq!(fields["technique"]["default"], "path");
    assert_eq!(fields["preset"]["enum"], json!(["preview", "balanced", "high"]));
    assert_eq!(fields["preset"]["default"], "balanced");
    assert_eq!(fields["reconstruction"]["enum"], json!(["none", "poisson"]));
    assert_eq!(fields["aov"]["enum"], json!(["normal", "depth", "variance", "other_density"]));
    assert!(fields["settings"].to_string().contains("#/components/schemas/Settings.other"), "{fields}");
}

#[tokio::test]
async fn the_api_description_names_every_header_of_a_picture() {
    let service = Service::start().await;
    let answer = render(&service, &[("accept", "image/png"), ("prefer", "wait=10")], json!({})).await;
    let document = service.get("/v1/openapi.json").await.json();
    for operation in ["/paths/~1v1~1renders/post", "/paths/~1v1~1renders~1{id}~1image/get"] {
        let described = document.pointer(&format!("{operation}/responses/200/headers")).and_then(Value::as_object);
        let mut described: Vec<String> = described.expect(operation).keys().map(|name| name.to_lowercase()).collect();
        described.sort();
        let sent = answer.headers.keys().map(HeaderName::as_str).filter(|name| name.starts_with("surfelcast-"));
        let mut sent: Vec<&str> = sent.collect();
        sent.sort_unstable();
        assert_eq!(described, sent, "{operation}");
    }
}

#[tokio::test]
async fn the_queue_is_bounded() {
    let behaviour = FakeBehaviour { job_time: Duration::from_hours(1), ..FakeBehaviour::default() };
    let service = Service::with(behaviour, |c| c.bounds.active_renders = 2).await;
    for seed in 0..2 {
        assert_eq!(render(&service, &[], json!({"seed": seed})).await.status, StatusCode::ACCEPTED);
    }
    let full = render(&service, &[], json!({"seed": 2})).await;
    assert_eq!((full.status, full.problem().as_str()), (StatusCode::TOO_MANY_REQUESTS, "render_queue_full"));
    assert!(!full.header("retry-after").is_empty());
    assert_eq!(service.get("/readyz").await.problem(), "queue_full");
    assert_eq!(render(&service, &[], json!({"seed": 1})).await.status, StatusCode::ACCEPTED, "equal to a running one");
}

#[tokio::test]
async fn finished_renders_are_dropped_by_bytes_oldest_first() {
    let bytes = 32 * 24 * 12;
    let service = Service::with(FakeBehaviour::default(), |c| c.bounds.render_cache_bytes = bytes * 5 / 2).await;
    let mut locations = Vec::new();
    for seed in 0..4 {
        let headers = [("prefer", "wait=10"), ("accept", "application/json")];
        let answer = render(&service, &headers, json!({"seed": seed})).await;
        locations.push(format!("/v1/renders/{}", answer.json()["id"].as_str().expect("an id")));
        // The first is used again and again, so others go before it.
        assert_eq!(service.get(&locations[0]).await.status, StatusCode::OK);
    }
    let mut kept = Vec::new();
    for location in &locations {
        kept.push(service.get(location).await.status == StatusCode::OK);
    }
    assert_eq!(kept, [true, false, false, true]);
}

#[tokio::test]
async fn failures_have_their_status() {
    let no_memory = RendererError::NoMemory { needed: 10, free: 5 };
    let too_large = RendererError::SceneTooLarge { field: "triangles".into(), needed: 10, limit: 5 };
    let lost = RendererError::DeviceLost;
    let behaviour = FakeBehaviour { job_errors: vec![no_memory, too_large, lost.clone()], ..FakeBehaviour::default() };
    let service = Service::with(behaviour, |_| {}).await;
    let ask = |seed: u64| render(&service, &[("prefer", "wait=10"), ("accept", "image/png")], json!({"seed": seed}));
    let answer = ask(1).await;
    assert_eq!((answer.status, answer.problem().as_str()), (StatusCode::SERVICE_UNAVAILABLE, "gpu_memory"));
    assert!(!answer.header("retry-after").is_empty());
    let answer = ask(2).await;
    assert_eq!((answer.status, answer.problem().as_str()), (StatusCode::UNPROCESSABLE_ENTITY, "scene_too_large"));
    // The renderer starts jobs over itself: when it answers so, it has given the device up.
    let answer = ask(3).await;
    assert_eq!((answer.status, answer.problem().as_str()), (StatusCode::SERVICE_UNAVAILABLE, "device_lost"));
    assert!(!answer.header("retry-after").is_empty());
    assert_eq!(renders(&service), 3, "nothing is sent twice");
    assert_eq!(ask(1).await.status, StatusCode::OK, "failures are not remembered");
    service.fake.set_state(DeviceState::Lost);
    assert_eq!(ask(9).await.problem(), "no_device");
}

#[tokio::test]
async fn idempotency_keys() {
    let behaviour = FakeBehaviour { job_time: Duration::from_millis(300), ..FakeBehaviour::default() };
    let service = Service::with(behaviour, |_| {}).await;
    let ask = |wait: &'static str, seed: u64| {
        let headers = vec![("idempotency-key", "abc"), ("prefer", wait), ("accept", "application/json")];
        let service = &service;
        async move { render(service, &headers, json!({"seed": seed})).await }
    };
    let (first, during) = tokio::join!(ask("wait=10", 1), async {
        tokio::time::sleep(Duration::from_millis(100)).await;
        ask("wait=10", 1).await
    });
    assert_eq!(first.json()["status"], "succeeded");
    assert_eq!((during.status, during.problem().as_str()), (StatusCode::CONFLICT, "idempotency_in_flight"));
    let repeat = ask("wait=10", 1).await;
    assert_eq!(repeat.json()["id"], first.json()["id"]);
    let other = ask("wait=10", 2).await;
    assert_eq!((other.status, other.problem().as_str()), (StatusCode::UNPROCESSABLE_ENTITY, "idempotency_mismatch"));
    assert_eq!(renders(&service), 1);
}
