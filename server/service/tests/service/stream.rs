//! A client that keeps to the protocol: what it gets, and in which order.

use std::time::Duration;

use serde_json::json;
use surfelcast_protocol::frame::flags;
use surfelcast_protocol::settings::Codec;
use surfelcast_render_api::{Column, Row, Value};
use surfelcast_renderer::Inspection;

use crate::fake::{FakeBehaviour, Recorded};
use crate::support::{Client, Got, Service};

const QUIET: Duration = Duration::from_millis(400);

#[tokio::test]
async fn from_hello_to_converged_and_then_nothing() {
    let service = Service::start().await;
    let mut client = service.client().await;
    let welcome = client.welcome.clone();
    assert_eq!(
        (welcome["v"].as_u64(), welcome["session"]["scene"].as_str()),
        (Some(1), Some(service.scene_id().as_str()))
    );
    assert_eq!(welcome["session"]["id"], service.session());
    assert_eq!((welcome["techniques"][0]["id"].as_str(), welcome["device"].as_str()), (Some("path"), Some("fake")));
    assert!(!welcome["cameras"].as_array().expect("cameras").is_empty() && welcome["grace_ms"] == 120_000);
    assert_eq!(welcome["resume_token"].as_str().map(str::len), Some(32));
    client.small().await;
    let frames = client.until_final().await;
    let spp: Vec<u16> = frames.iter().map(|(header, _)| header.spp).collect();
    assert_eq!(spp, [1, 4, 16, 64], "stills at growing sample counts");
    for (i, (header, payload)) in frames.iter().enumerate() {
        assert_eq!(
            (header.frame_seq, header.view, header.rect, header.full_size),
            (i as u32 + 1, 0, [0, 0, 64, 48], [64, 48])
        );
        let image = image::load_from_memory(payload).expect("decodes");
        assert_eq!((image.width(), image.height()), (64, 48));
        let is_last = header.spp == 64;
        assert_eq!(header.codec, if is_last { Codec::Webp } else { Codec::Jpeg });
        assert_eq!(header.flags & (flags::STILL | flags::KEYFRAME), flags::STILL | flags::KEYFRAME);
        assert_eq!(header.flags & flags::LOSSLESS != 0, is_last);
    }
    let stats = client.text("stats").await;
    assert_eq!((stats["converged"].as_bool(), stats["samples"].as_u64()), (Some(true), Some(64)));
    client.silence(Duration::from_millis(1500)).await;
}

#[tokio::test]
async fn moving_frames_are_lossy_and_refinement_ends_on_the_last_input() {
    let service = Service::start().await;
    let mut client = service.client().await;
    client.small().await;
    client.until_final().await;
    let mut last = client.look_from(1.0, "start").await;
    for i in 2..20 {
        last = client.look_from(f64::from(i), "move").await;
        let (header, _) = client.frame().await;
        assert_eq!((header.codec, header.flags & flags::STILL), (Codec::Jpeg, 0), "moving frames");
        assert!(header.quality <= 80 && header.input_seq <= last);
    }
    last = client.look_from(20.0, "end").await.max(last);
    let frames = client.until_final().await;
    let (header, _) = frames.last().expect("frames");
    assert_eq!((header.input_seq, header.spp), (last, 64), "the end of a gesture is never lost");
    let recorded = service.fake.recorded();
    let resting = Recorded::View { input_seq: last, x: 20.0, is_moving: false };
    assert!(recorded.contains(&resting), "{recorded:?}");
}

#[tokio::test]
async fn stats_tell_the_scale_in_use_and_why() {
    for (device_scale, reason) in [(0.5, "device"), (1.0, "")] {
        let service = Service::with(FakeBehaviour { device_scale, ..FakeBehaviour::default() }, |_| {}).await;
        let mut client = service.client().await;
        client.small().await;
        client.until_final().await;
        assert_eq!(client.text("stats").await["reason"], "");
        client.look_from(1.0, "start").await;
        let (header, _) = client.frame().await;
        assert_eq!(header.rect[2..], [(64.0 * device_scale) as u16, (48.0 * device_scale) as u16]);
        let stats = client.text("stats").await;
        assert_eq!((stats["scale"].as_f64(), stats["reason"].as_str()), (Some(f64::from(device_scale)), Some(reason)));
    }
}

#[tokio::test]
async fn cameras_are_private_and_lights_are_shared() {
    let service = Service::start().await;
    let mut one = service.client().await;
    let mut two = service.client().await;
    for client in [&mut one, &mut two] {
        client.small().await;
        client.until_final().await;
        client.text("stats").await;
    }
    one.look_from(3.0, "end").await;
    one.until_final().await;
    two.silence(QUIET).await;
    let lamp = json!({"id": 0, "name": "Lamp\u{202e}", "kind": "point", "position": [0, 1, 0], "direction": [0, -1, 0],
        "color": [1, 1, 1], "intensity": 5});
    one.send(json!({"id": 7, "t": "light", "seq": 9, "patch": {"add": lamp}, "phase": "end"})).await;
    assert_eq!(one.text("ok").await["re"], 7);
    let lights = two.text("lights").await;
    assert_eq!((lights["scene_rev"].as_u64(), lights["lights"][0]["name"].as_str()), (Some(2), Some("Lamp")));
    let frames = two.until_final().await;
    assert!(frames.iter().all(|(header, _)| header.scene_rev == 2), "frames say which lights they show");
    let frames = one.until_final().await;
    assert_eq!(frames.last().map(|(header, _)| (header.input_seq, header.scene_rev)), Some((9, 2)));
    // The renderer gets the lights before the view whose input contains them.
    let recorded = service.fake.recorded();
    let lights_at = recorded.iter().position(|t| *t == Recorded::Lights { scene_rev: 2, count: 1 }).expect("recorded");
    let view_at = recorded.iter().position(|t| matches!(t, Recorded::View { input_seq: 9, .. })).expect("recorded");
    assert!(lights_at < view_at, "{recorded:?}");
    // A client that joins later gets the same lights.
    let mut three = service.connect().await;
    three.send(json!({"t": "hello", "v": [1], "caps": {"codecs": ["jpeg"]}})).await;
    assert_eq!(three.text("lights").await["lights"].as_array().map(Vec::len), Some(1));
    one.send(json!({"id": 8, "t": "light", "seq": 10, "patch": {"remove": 77}, "phase": "end"})).await;
    let error = one.text("error").await;
    assert_eq!((error["re"].as_u64(), error["code"].as_str()), (Some(8), Some("invalid_value")));
    assert!(error["detail"].as_str().expect("text").starts_with("patch.remove"));
}

#[tokio::test]
async fn picks_answer_for_the_acknowledged_frame() {
    let service = Service::start().await;
    let mut client = service.client().await;
    client.send(json!({"id": 1, "t": "pick", "x": 0.5, "y": 0.5})).await;
    assert_eq!(client.text("error").await["code"], "no_frame");
    client.small().await;
    client.until_final().await;
    client.look_from(3.0, "end").await;
    client.until_final().await;
    // The camera moves on, but no frame of it is acknowledged yet.
    client.look_from(8.0, "end").await;
    client.send(json!({"id": 2, "t": "pick", "x": 0.5, "y": 0.5})).await;
    let picked = client.text("picked").await;
    assert_eq!((picked["re"].as_u64(), picked["position"][0].as_f64()), (Some(2), Some(3.0)));
    assert_eq!(picked["object"], "box");
    client.send(json!({"id": 3, "t": "pick", "x": 1.5, "y": 0.5})).await;
    assert_eq!(client.text("error").await["re"], 3);
}

#[tokio::test]
async fn inspections_answer_for_the_acknowledged_frame() {
    let service = Service::start().await;
    let mut client = service.client().await;
    let inspect = |id: u64, x: f64, y: f64| json!({"id": id, "t": "inspect", "view": 0, "x": x, "y": y});
    client.send(inspect(1, 0.5, 0.5)).await;
    assert_eq!(client.text("error").await["code"], "no_frame");
    client.small().await;
    client.until_final().await;
    client.look_from(3.0, "end").await;
    client.until_final().await;
    // The camera moves on, but no frame of it is acknowledged yet.
    client.look_from(8.0, "end").await;
    client.send(inspect(2, 0.25, 0.75)).await;
    let answer = client.text("inspected").await;
    assert_eq!((answer["re"].as_u64(), answer["inspection"]["position"][0].as_f64()), (Some(2), Some(3.0)));
    assert_eq!(answer["inspection"]["summary"][0]["value"], 1.5);
    assert_eq!(answer["inspection"]["rows"][0]["values"], json!([7]));
    assert!(service.fake.recorded().contains(&Recorded::Inspect { size: [64, 48], point: [0.25, 0.75] }));
    for (message, field) in [(inspect(3, 0.5, -0.1), "y"), (inspect(3, 2.0, 0.5), "x")] {
        client.send(message).await;
        let error = client.text("error").await;
        assert_eq!((error["re"].as_u64(), error["code"].as_str()), (Some(3), Some("invalid_value")));
        assert!(error["detail"].as_str().expect("text").starts_with(field), "{error}");
    }
    client.send(json!({"id": 4, "t": "inspect", "view": 1, "x": 0.5, "y": 0.5})).await;
    assert_eq!(client.text("error").await["code"], "unknown_view");
}

#[tokio::test]
async fn points_that_nothing_is_known_of_are_null_and_broken_numbers_are_named() {
    let columns = vec![Column { id: "std_error", label: "Error", unit: "" }];
    let rows = vec![Row { values: vec![Value::Number(f32::NAN)], disc: None }];
    let broken = Inspection { columns, rows, ..Inspection::default() };
    for inspection in [None, Some(broken)] {
        let service = Service::with(FakeBehaviour { inspection, ..FakeBehaviour::default() }, |_| {}).await;
        let mut client = service.client().await;
        client.small().await;
        client.until_final().await;
        client.send(json!({"id": 5, "t": "inspect", "x": 0.5, "y": 0.5})).await;
        let answer = loop {
            match client.next().await {
                Got::Text(value) if value["re"] == 5 => break value,
                Got::Closed(_) | Got::Broken => panic!("the connection stays"),
                _ => {}
            }
        };
        if answer["t"] == "inspected" {
            assert!(answer.get("inspection").is_some_and(serde_json::Value::is_null), "{answer}");
        } else {
            let detail = "inspect: std_error of row 0 is not a finite number";
            assert_eq!((answer["code"].as_str(), answer["detail"].as_str()), (Some("inspect_failed"), Some(detail)));
        }
    }
}

#[tokio::test]
async fn points_looked_at_are_bounded() {
    let service = Service::with(FakeBehaviour { point_time: QUIET, ..FakeBehaviour::default() }, |_| {}).await;
    let mut client = service.client().await;
    client.small().await;
    client.until_final().await;
    for id in 1..=6 {
        client.send(json!({"id": id, "t": "inspect", "x": 0.5, "y": 0.5})).await;
    }
    for id in [5, 6] {
        let error = client.text("error").await;
        assert_eq!((error["re"].as_u64(), error["code"].as_str()), (Some(id), Some("busy")));
    }
    for id in 1..=4 {
        assert_eq!(client.text("inspected").await["re"], id);
    }
    client.send(json!({"id": 7, "t": "inspect", "x": 0.5, "y": 0.5})).await;
    assert_eq!(client.text("inspected").await["re"], 7, "there is room again");
}

#[tokio::test]
async fn settings_may_follow_hello_at_once() {
    let service = Service::start().await;
    let mut client = service.connect().await;
    client.send(json!({"t": "hello", "v": [1], "caps": {"codecs": ["jpeg"]}})).await;
    client.send(json!({"id": 1, "t": "view.set", "w": 64, "h": 48, "technique": "other"})).await;
    assert_eq!(client.text("ok").await["re"], 1);
    assert_eq!(client.frame().await.0.full_size, [64, 48]);
}

/// The error in the `stats` of the final frame.
async fn final_error(client: &mut Client) -> Option<f64> {
    let stats = loop {
        let stats = client.text("stats").await;
        if stats["converged"] == true {
            break stats;
        }
    };
    stats["error"]["rmse"].as_f64().map(|rmse| (rmse * 1e4).round() / 1e4)
}

#[tokio::test]
async fn views_show_outputs_and_go_back_to_radiance() {
    let service = Service::start().await;
    let mut client = service.client().await;
    let offered: Vec<String> = client.welcome["outputs"]
        .as_array()
        .expect("outputs")
        .iter()
        .map(|output| {
            assert!(!output["label"].as_str().expect("a label").is_empty());
            output["id"].as_str().expect("an id").to_owned()
        })
        .collect();
    assert_eq!(offered, ["normal", "depth", "other_density"]);
    client.small().await;
    client.until_final().await;
    assert_eq!(final_error(&mut client).await, Some(0.0125));
    for bad in ["variance", "soul", ""] {
        client.send(json!({"id": 1, "t": "view.set", "aov": bad})).await;
        let error = client.text("error").await;
        assert_eq!((error["re"].as_u64(), error["code"].as_str()), (Some(1), Some("invalid_value")));
        assert!(error["detail"].as_str().expect("text").starts_with("aov: "), "{error}");
    }
    client.send(json!({"id": 2, "t": "view.set", "aov": 7})).await;
    let error = client.text("error").await;
    assert!(error["detail"].as_str().expect("text").contains("aov: expected"), "{error}");
    client.send(json!({"id": 3, "t": "view.set", "aov": "other_d"})).await;
    assert_eq!(client.text("ok").await["re"], 3);
    client.until_final().await;
    assert_eq!(final_error(&mut client).await, None, "the audit is not of this output");
    // Another setting leaves the output as it is.
    client.send(json!({"id": 4, "t": "view.set", "exposure": 2.0})).await;
    client.until_final().await;
    client.send(json!({"id": 5, "t": "view.set", "aov": null})).await;
    client.until_final().await;
    assert_eq!(final_error(&mut client).await, Some(0.0125));
    let shown: Vec<Recorded> =
        service.fake.recorded().into_iter().filter(|recorded| matches!(recorded, Recorded::Shows(_))).collect();
    assert_eq!(shown, [Recorded::Shows(Some("other_density".to_owned())), Recorded::Shows(None)]);
}

#[tokio::test]
async fn only_what_the_client_offers_is_sent() {
    let service = Service::start().await;
    let mut client = service.connect().await;
    // Unknown codecs are skipped, not refused.
    client.hello(json!(["avif", "png"])).await;
    client.small().await;
    for (header, _) in client.until_final().await {
        assert_eq!(header.codec, Codec::Png);
    }
}

#[tokio::test]
async fn paused_views_cost_nothing() {
    let service = Service::start().await;
    let mut client = service.client().await;
    client.send(json!({"id": 1, "t": "view.set", "w": 64, "h": 48, "paused": true})).await;
    client.text("ok").await;
    client.look_from(2.0, "end").await;
    client.silence(QUIET).await;
    client.send(json!({"t": "view.set", "paused": false})).await;
    let frames = client.until_final().await;
    assert_eq!(frames.last().map(|(header, _)| header.input_seq), Some(1));
}

#[tokio::test]
async fn stills_on_request_are_lossless_and_rare() {
    let behaviour = FakeBehaviour { final_samples: u32::MAX, ..FakeBehaviour::default() };
    let service = Service::with(behaviour, |_| {}).await;
    let mut client = service.client().await;
    client.small().await;
    client.frame().await;
    client.send(json!({"id": 5, "t": "still"})).await;
    let mut is_lossless = false;
    for _ in 0..50 {
        match client.next().await {
            Got::Frame(header, _) => {
                is_lossless |= header.flags & flags::LOSSLESS != 0;
                client.ack(header.frame_seq).await;
            }
            // Frames in flight may refuse it; a client requests it again.
            Got::Text(value) if value["code"] == "busy" => client.send(json!({"id": 5, "t": "still"})).await,
            _ => {}
        }
        if is_lossless {
            break;
        }
    }
    assert!(is_lossless);
    client.send(json!({"id": 6, "t": "still"})).await;
    let error = client.text("error").await;
    assert_eq!((error["re"].as_u64(), error["code"].as_str()), (Some(6), Some("busy")));
}

#[tokio::test]
async fn pings_are_answered_and_sent() {
    let service = Service::with(FakeBehaviour::default(), |c| c.timeouts.ping = Duration::from_millis(200)).await;
    let mut client = service.client().await;
    client.send(json!({"t": "ping", "ts": 12.5})).await;
    let pong = client.text("pong").await;
    assert_eq!(pong["ts"], 12.5);
    assert!(pong["server_ms"].is_number());
    for _ in 0..4 {
        let ping = client.text("ping").await;
        client.send(json!({"t": "pong", "ts": ping["ts"]})).await;
    }
    // Two pings without an answer end the connection.
    assert_eq!(client.close_code().await, 4408);
}

#[tokio::test]
async fn settings_reach_the_renderer() {
    let service = Service::start().await;
    let mut client = service.client().await;
    for (bad, field) in [
        (json!({"w": 0}), "w"),
        (json!({"w": 4096, "h": 4096}), "w x h"),
        (json!({"exposure": 0}), "exposure"),
        (json!({"exposure": 1e300}), "exposure"),
        (json!({"technique": "warp"}), "technique"),
        (json!({"fps": 0}), "fps"),
        (json!({"codec": "jpeg", "min_q": 90, "max_q": 10}), "min_q"),
    ] {
        let mut message = json!({"id": 1, "t": "view.set"});
        message.as_object_mut().expect("an object").extend(bad.as_object().expect("an object").clone());
        client.send(message).await;
        let error = client.text("error").await;
        assert!(error["detail"].as_str().expect("text").starts_with(field), "{error}");
    }
    let good =
        json!({"id": 2, "t": "view.set", "w": 100, "h": 50, "technique": "other", "exposure": 2.5, "max_spp": 9});
    client.send(good).await;
    assert_eq!(client.text("ok").await["re"], 2);
    let (header, _) = client.frame().await;
    assert_eq!(header.full_size, [100, 50]);
}
