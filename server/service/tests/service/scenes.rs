//! Uploads: what is accepted, what is refused, what is still stored after a restart.

use axum::body::Body;
use axum::http::{Request, StatusCode};
use serde_json::json;
use surfelcast_service::{ServiceConfig, ServiceState, router};

use crate::fake::{Fake, FakeBehaviour};
use crate::support::{Answer, Service, ask, gltf, scene};

const GLTF: [(&str, &str); 1] = [("content-type", "model/gltf+json")];

#[tokio::test]
async fn the_list_has_its_shape() {
    let service = Service::start().await;
    let list = service.get("/v1/scenes").await.json();
    let first = &list["scenes"][0];
    assert_eq!(first["id"], service.scene_id());
    assert_eq!(first["session"], service.session());
    assert_eq!((&first["name"], &first["triangle_count"]), (&json!("triangle"), &json!(1)));
    assert!(!first["cameras"].as_array().expect("cameras").is_empty() && first["warnings"].is_array());
    assert_eq!(service.get(&format!("/v1/scenes/{}", service.scene_id())).await.json(), *first);
}

#[tokio::test]
async fn uploads_are_kept_by_content() {
    let service = Service::start().await;
    let upload = || service.post("/v1/scenes?name=My%20scene", &GLTF, gltf(2.0));
    let first = upload().await;
    assert_eq!(first.status, StatusCode::CREATED, "{first:?}");
    let id = first.json()["id"].as_str().expect("an id").to_owned();
    assert_eq!(first.header("location"), format!("/v1/scenes/{id}"));
    assert_eq!(first.json()["name"], "My scene");
    let second = upload().await;
    assert_eq!((second.status, &second.json()["id"]), (StatusCode::OK, &json!(id)));
    assert_eq!(service.get("/v1/scenes").await.json()["scenes"].as_array().expect("a list").len(), 2);
    // It can be looked at and rendered like any other.
    let session = first.json()["session"].as_str().expect("a session").to_owned();
    let mut client = service.connect_to(&session).await;
    client.hello(json!(["jpeg"])).await;
    let path = format!("/v1/scenes/{id}");
    let delete = || Request::delete(&path).header("host", "localhost").body(Body::empty()).expect("a request");
    assert_eq!(service.ask(delete()).await.problem(), "scene_in_use");
    drop(client);
    service.until("the view is closed", |fake| fake.count(|t| *t == crate::fake::Recorded::CloseView) == 1).await;
    assert_eq!(service.ask(delete()).await.status, StatusCode::NO_CONTENT);
    assert_eq!(service.get(&path).await.status, StatusCode::NOT_FOUND);
}

const FORM: [(&str, &str); 1] = [("content-type", "multipart/form-data; boundary=bOuNd")];

fn form(parts: &[(&str, &str)]) -> String {
    let part = |(name, text): &(&str, &str)| {
        format!("--bOuNd\r\nContent-Disposition: form-data; name=\"{name}\"\r\n\r\n{text}\r\n")
    };
    parts.iter().map(part).collect::<String>() + "--bOuNd--\r\n"
}

#[tokio::test]
async fn a_view_can_come_with_the_scene() {
    let service = Service::with(FakeBehaviour::default(), |c| c.bounds.loaded_scenes = 1).await;
    let view = r#"{"cameras": [{"name": "door", "position": [0, 1, 9], "target": [0, 0, 0], "vfov_deg": 30}]}"#;
    let bare = service.post("/v1/scenes", &GLTF, gltf(2.0)).await;
    let upload = || service.post("/v1/scenes?name=House", &FORM, form(&[("view", view), ("scene", &gltf(2.0))]));
    let answer = upload().await;
    assert_eq!(answer.status, StatusCode::CREATED, "{:?}", String::from_utf8_lossy(&answer.body));
    let scene = answer.json();
    assert_eq!((&scene["name"], &scene["cameras"]), (&json!("House"), &json!(["door"])));
    assert_ne!(scene["id"], bare.json()["id"], "another view is another scene");
    assert_eq!(upload().await.status, StatusCode::OK);
    let plain = service.post("/v1/scenes", &FORM, form(&[("scene", &gltf(2.0))])).await;
    assert_eq!((plain.status, &plain.json()["id"]), (StatusCode::OK, &bare.json()["id"]));
    // Loaded from disk again, it is still the scene that its id names.
    service.post("/v1/scenes", &GLTF, gltf(5.0)).await;
    let body = json!({"scene": scene["id"], "camera_name": "door", "width": 8, "height": 8}).to_string();
    let headers = [("content-type", "application/json"), ("prefer", "wait=10")];
    assert_eq!(service.post("/v1/renders", &headers, body).await.status, StatusCode::OK);
}

#[tokio::test]
async fn bad_forms_are_refused_with_the_reason() {
    let service = Service::with(FakeBehaviour::default(), |c| c.bounds.json_bytes = 100).await;
    let gltf = gltf(2.0);
    let long = "x".repeat(101);
    for (parts, status, word) in [
        (vec![("view", "{}")], 400, "scene"),
        (vec![("scene", gltf.as_str()), ("scene", &gltf)], 400, "one part"),
        (vec![("scene", &gltf), ("other", "")], 400, "one part"),
        (vec![("scene", &gltf), ("view", &long)], 413, "view"),
        (vec![("scene", &gltf), ("view", "{\"exposure\": -1}")], 422, "view"),
        (vec![("scene", "rubbish")], 422, ""),
    ] {
        let answer = service.post("/v1/scenes", &FORM, form(&parts)).await;
        assert_eq!(answer.status.as_u16(), status, "{parts:?}");
        answer.problem();
        assert!(answer.json()["detail"].as_str().expect("text").contains(word), "{:?}", answer.json());
    }
    assert_eq!(service.get("/v1/scenes").await.json()["scenes"].as_array().expect("a list").len(), 1);
}

#[tokio::test]
async fn bad_uploads_are_refused_with_the_reason() {
    let service = Service::with(FakeBehaviour::default(), |c| c.bounds.upload_bytes = 4096).await;
    let broken = service.post("/v1/scenes", &GLTF, "{\"asset\":{\"version\":\"2.0\"},\"scene\":7}").await;
    assert_eq!((broken.status, broken.problem().as_str()), (StatusCode::UNPROCESSABLE_ENTITY, "invalid_scene"));
    let extension = r#"{"asset":{"version":"2.0"},"extensionsUsed":["X_y"],"extensionsRequired":["X_y"]}"#;
    let unsupported = service.post("/v1/scenes", &GLTF, extension).await;
    assert_eq!(unsupported.problem(), "unsupported_extension");
    assert!(unsupported.json()["detail"].as_str().expect("text").contains("X_y"));
    let stated = service.post("/v1/scenes", &[GLTF[0], ("content-length", "5000")], "x").await;
    assert_eq!(stated.status, StatusCode::PAYLOAD_TOO_LARGE);
    // Without a stated length the bytes are counted as they come.
    let pieces = futures_util::stream::iter((0..100).map(|_| Ok::<_, std::io::Error>(vec![b' '; 100])));
    let counted = service.post("/v1/scenes", &GLTF, Body::from_stream(pieces)).await;
    assert_eq!((counted.status, counted.problem().as_str()), (StatusCode::PAYLOAD_TOO_LARGE, "body_too_large"));
    let packed = service.post("/v1/scenes", &[GLTF[0], ("content-encoding", "gzip")], "x").await;
    assert_eq!(packed.status, StatusCode::UNSUPPORTED_MEDIA_TYPE);
    let html = service.post("/v1/scenes", &[("content-type", "text/html")], "x").await;
    assert_eq!(html.status, StatusCode::UNSUPPORTED_MEDIA_TYPE);
    assert_eq!(service.get("/v1/scenes").await.json()["scenes"].as_array().expect("a list").len(), 1);
}

#[tokio::test]
async fn the_store_is_bounded() {
    let service = Service::with(FakeBehaviour::default(), |c| c.bounds.stored_scenes = 1).await;
    assert_eq!(service.post("/v1/scenes", &GLTF, gltf(2.0)).await.status, StatusCode::CREATED);
    let full = service.post("/v1/scenes", &GLTF, gltf(3.0)).await;
    assert_eq!((full.status, full.problem().as_str()), (StatusCode::INSUFFICIENT_STORAGE, "storage_full"));
}

#[tokio::test]
async fn uploads_survive_a_restart_and_leave_no_rubbish() {
    let dir = tempfile::tempdir().expect("a folder");
    let start = || {
        let fake = Fake::start(FakeBehaviour::default());
        let config = ServiceConfig::new(dir.path(), "surfelcast/test");
        ServiceState::new(fake.handle.clone(), vec![scene()], config).expect("starts")
    };
    let post = |state: &ServiceState, body: String| {
        let request = Request::post("/v1/scenes").header("host", "localhost").header("content-type", GLTF[0].1);
        ask(router(state.clone()), request.body(Body::from(body)).expect("a request"))
    };
    let first = start();
    let stored: Answer = post(&first, gltf(2.0)).await;
    assert_eq!(stored.status, StatusCode::CREATED);
    assert_eq!(post(&first, "rubbish".into()).await.status, StatusCode::UNPROCESSABLE_ENTITY);
    let names = || {
        let entries = std::fs::read_dir(dir.path().join("scenes")).expect("a folder");
        let mut names: Vec<String> =
            entries.map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    };
    let hex = stored.json()["id"].as_str().expect("an id")["sha256:".len()..].to_owned();
    assert_eq!(names(), [format!("{hex}.json"), format!("{hex}.scene")], "temporary files are deleted");
    drop(first);
    std::fs::write(dir.path().join("scenes/torn.json"), "{\"id\":").expect("writes");
    let second = start();
    let get = |path: &str| Request::get(path).header("host", "localhost").body(Body::empty()).expect("a request");
    let list = ask(router(second.clone()), get("/v1/scenes")).await.json();
    assert_eq!(list["scenes"].as_array().expect("a list").len(), 2, "a torn description is skipped");
    let body = json!({"scene": format!("sha256:{hex}"), "width": 8, "height": 8}).to_string();
    let render = Request::post("/v1/renders")
        .header("host", "localhost")
        .header("content-type", "application/json")
        .header("prefer", "wait=10")
        .body(Body::from(body))
        .expect("a request");
    let answer = ask(router(second.clone()), render).await;
    assert_eq!(answer.status, StatusCode::OK, "loaded again from disk: {answer:?}");
    // A file that was changed behind the server's back is not the scene its id names.
    std::fs::write(dir.path().join(format!("scenes/{hex}.scene")), gltf(9.0)).expect("writes");
    drop(second);
    let third = start();
    let body = json!({"scene": format!("sha256:{hex}"), "width": 9, "height": 8}).to_string();
    let render = Request::post("/v1/renders").header("host", "localhost").header("content-type", "application/json");
    let answer = ask(router(third), render.body(Body::from(body)).expect("a request")).await;
    assert_eq!(answer.status, StatusCode::INTERNAL_SERVER_ERROR);
}
