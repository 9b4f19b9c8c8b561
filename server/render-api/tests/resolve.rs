//! From requests to specifications: defaults, checks, aliases and identities.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use std::time::Duration;

use serde_json::{Value, json};
use surfelcast_render_api::identity::{canonical_json, identity_hex};
use surfelcast_render_api::{
    CameraDefaults, Catalogue, Fault, MaterialMode, OutputDescription, Preset, RenderRequest, RenderSpec,
    RequestLimits, SceneDefaults, Setting, SettingKind, SettingValue, TechniqueAlias, TechniqueDescription,
};
use surfelcast_scene::Camera;

const LIMITS: RequestLimits = RequestLimits { side: 16_384, pixels: 64_000_000, samples: 1 << 20, secs: 3600.0 };

const fn output(id: &'static str, aliases: &'static [&'static str]) -> OutputDescription {
    OutputDescription { id, aliases, label: id, help: "", is_live: true, is_split: false }
}

const PLAIN: TechniqueDescription = TechniqueDescription {
    id: "plain",
    label: "Plain",
    summary: "No settings.",
    aliases: &[],
    settings: &[],
    presets: &[],
    outputs: &[],
    export: None,
};

const RICH: TechniqueDescription = TechniqueDescription {
    id: "rich",
    label: "Rich",
    summary: "Two settings.",
    aliases: &[TechniqueAlias {
        id: "rich_smooth",
        label: "Rich, smooth",
        summary: "Smooth.",
        values: &[("norm", SettingValue::name("l1"))],
    }],
    settings: &[
        Setting {
            id: "norm",
            label: "Norm",
            help: "",
            unit: "",
            kind: SettingKind::Choice { default: "l2", names: &["l2", "l1"] },
        },
        Setting {
            id: "radius",
            label: "Radius",
            help: "",
            unit: "pixels",
            kind: SettingKind::Number { default: 5.0, range: [1.5, 32.0], is_integer: false },
        },
        Setting {
            id: "reconstruction",
            label: "Reconstruction",
            help: "",
            unit: "",
            kind: SettingKind::Choice { default: "full", names: &["none", "full"] },
        },
    ],
    presets: &[
        Preset { id: "coarse", values: &[("radius", SettingValue::Number(8.0))] },
        Preset { id: "usual", values: &[("radius", SettingValue::Number(5.0))] },
    ],
    outputs: &[output("rich_density", &["rich_d"])],
    export: None,
};

fn catalogue() -> Catalogue {
    Catalogue {
        techniques: vec![RICH, PLAIN],
        outputs: const { &[output("albedo", &[]), output("normal", &[])] },
        default_technique: "plain",
    }
}

fn scene() -> SceneDefaults {
    let camera = |x: f64| Camera {
        position: [x, 0.0, 3.0].into(),
        target: [0.0; 3].into(),
        up: [0.0, 1.0, 0.0].into(),
        vfov: 0.7,
    };
    let named =
        |name: &str, x, size, exposure| CameraDefaults { name: name.to_owned(), camera: camera(x), size, exposure };
    SceneDefaults {
        id: "sha256:00".to_owned(),
        cameras: vec![named("front", 0.0, Some([320, 180]), 2.0), named("side", 1.0, None, 1.0)],
    }
}

fn resolve(more: &Value) -> Result<RenderSpec, Fault> {
    let mut body = json!({"scene": "sha256:00"});
    body.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    RenderRequest::parse(body.to_string().as_bytes())?.resolve(&catalogue(), &scene(), &LIMITS)
}

#[test]
fn one_table_fills_in_what_is_left_out() {
    let spec = resolve(&json!({})).unwrap();
    assert_eq!((spec.technique.as_str(), spec.size, spec.exposure), ("plain", [320, 180], 2.0));
    assert_eq!((spec.stop.samples, spec.stop.max_error, spec.stop.time_limit), (Some(64), None, None));
    assert_eq!((spec.seed, spec.materials, spec.aov), (0, MaterialMode::Pbr, None));
    assert_eq!((spec.camera, spec.scene.as_str()), (scene().cameras[0].camera, "sha256:00"));
    let side = resolve(&json!({"camera_name": "side"})).unwrap();
    assert_eq!((side.size, side.exposure), ([1280, 720], 1.0));
    let own = resolve(&json!({"camera": {"position": [0, 0, 2], "target": [0, 0, 0], "vfov_deg": 40}})).unwrap();
    assert_eq!((own.size, own.exposure), ([1280, 720], 1.0));
    let by_error = resolve(&json!({"max_error": 0.01})).unwrap().stop;
    assert_eq!((by_error.samples, by_error.max_error), (None, Some(0.01)));
    assert_eq!(resolve(&json!({"frames": 9})).unwrap().stop.samples, Some(9));
    let limited = resolve(&json!({"time_limit_secs": 2.5})).unwrap().stop;
    assert_eq!((limited.samples, limited.time_limit), (None, Some(Duration::from_millis(2500))));
}

#[test]
fn refusals_name_the_field_the_limit_and_the_remedy() {
    for (more, text) in [
        (json!({"width": 0, "height": 1}), "width: must be within 1 to 16384"),
        (json!({"width": -5, "height": 1}), "width: must be within 1 to 16384"),
        (json!({"width": 1, "height": 99_999}), "height: must be within 1 to 16384"),
        (json!({"width": 4}), "width, height: give both or none"),
        (json!({"width": 16_384, "height": 16_384}), "width x height: more than the limit of 64000000 pixels"),
        (json!({"seed": -1}), "seed: must be within 0 to 18446744073709551615"),
        (json!({"samples_per_pixel": 0}), "samples_per_pixel: must be within 1 to 1048576"),
        (json!({"samples_per_pixel": 1, "frames": 1}), "samples_per_pixel, frames: only one of the two may be given"),
        (json!({"max_error": 2}), "max_error: must be within 0.000001 to 1"),
        (json!({"time_limit_secs": 0}), "time_limit_secs: must be within 0.001 to 3600"),
        (json!({"materials": "wood"}), "materials: must be pbr or lambert"),
        (json!({"exposure": 0}), "exposure: must be within 0.000001 to 1000000"),
        (json!({"camera_name": "back"}), "camera_name: the scene has no such camera; it has front, side"),
        (json!({"technique": "magic"}), "technique: must be one of rich, rich_smooth, plain"),
        (json!({"technique": "rich", "preset": "best"}), "preset: must be one of coarse, usual"),
        (
            json!({"preset": "usual"}),
            "preset: technique plain has no presets; leave it out, or take a technique that has: rich",
        ),
        (
            json!({"settings": {"radius": 3}}),
            "settings.radius: technique plain has no such setting; leave it out, or take a technique that has: rich",
        ),
        (
            json!({"reconstruction": "full"}),
            "reconstruction: technique plain has no such setting; leave it out, or take a technique that has: rich",
        ),
        (json!({"technique": "rich", "reconstruction": "best"}), "reconstruction: must be one of none, full"),
        (json!({"technique": "rich", "settings": {"radius": 1}}), "settings.radius: must be within 1.5 to 32"),
        (
            json!({"technique": "rich", "settings": {"size": 1}}),
            "settings.size: no such setting; there are norm, radius, reconstruction",
        ),
        (json!({"aov": "soul"}), "aov: must be one of albedo, normal, rich_density"),
        (json!({"aov": "rich_density"}), "aov: technique plain has no rich_density; rich has"),
        (
            json!({"camera": {"position": [0, 0, 1e300], "target": [0, 0, 0], "vfov_deg": 40}}),
            "camera.position: each coordinate must be a number within +-1e12 metres",
        ),
        (
            json!({"camera": {"position": [0, 0, 1], "target": [0, 0, 0], "vfov_deg": 400}}),
            "camera.vfov_deg: must be within 0.1 to 179 degrees",
        ),
    ] {
        let fault = resolve(&more).expect_err(&more.to_string());
        assert_eq!((fault.to_string().as_str(), fault.is_malformed), (text, false), "{more}");
    }
    for (more, text) in [
        (json!({"technique": "rich", "settings": {"radius": "4"}}), "settings.radius: expected a number"),
        (json!({"camera": {"position": [0, 0, 1], "target": [0, 0, 0]}}), "camera.vfov_deg: missing"),
    ] {
        let fault = resolve(&more).expect_err(&more.to_string());
        assert_eq!((fault.to_string().as_str(), fault.is_malformed), (text, true), "{more}");
    }
}

#[test]
fn settings_go_over_the_preset_and_an_alias_stands_for_settings() {
    let values = |more: Value| {
        let spec = resolve(&more).unwrap();
        (spec.technique, serde_json::to_value(spec.settings).unwrap())
    };
    let (technique, settings) = values(json!({"technique": "rich_smooth"}));
    assert_eq!(technique, "rich");
    assert_eq!(settings, json!({"norm": "l1", "radius": 5.0, "reconstruction": "full"}));
    let body = json!({"technique": "rich", "preset": "coarse", "settings": {"norm": "l1", "radius": null}});
    assert_eq!(values(body).1, json!({"norm": "l1", "radius": 8.0, "reconstruction": "full"}));
    let body = json!({"technique": "rich", "preset": "coarse", "reconstruction": "none", "settings": {"radius": 3}});
    assert_eq!(values(body).1, json!({"norm": "l2", "radius": 3.0, "reconstruction": "none"}));
    // A technique that reconstructs nothing may be told so, and no settings are none.
    assert_eq!(values(json!({"reconstruction": "none", "settings": {}})).1, json!({}));
    assert_eq!(resolve(&json!({"technique": "rich", "aov": "rich_d"})).unwrap().aov.as_deref(), Some("rich_density"));
    assert_eq!(RICH.default_preset().map(|preset| preset.id), Some("usual"));
}

#[test]
fn equal_requests_have_one_identity_and_others_another() {
    let of = |more: Value| identity_hex(&resolve(&more).unwrap()).unwrap();
    let plain = of(json!({}));
    for same in [
        json!({"technique": "plain", "samples_per_pixel": 64}),
        json!({"camera_name": "front", "width": 320, "height": 180, "exposure": 2, "materials": "pbr", "seed": 0}),
    ] {
        assert_eq!(of(same.clone()), plain, "{same}");
    }
    for other in [
        json!({"seed": 1}),
        json!({"exposure": 2.000_000_2}),
        json!({"aov": "normal"}),
        json!({"technique": "rich"}),
        json!({"max_error": 0.5}),
        json!({"camera_name": "side", "width": 320, "height": 180, "exposure": 2}),
    ] {
        assert_ne!(of(other.clone()), plain, "{other}");
    }
    assert_eq!(of(json!({"technique": "rich_smooth"})), of(json!({"technique": "rich", "settings": {"norm": "l1"}})));
}

#[test]
fn specifications_survive_the_round_trip_to_the_bit() {
    let spec = resolve(&json!({"technique": "rich", "exposure": 0.1, "max_error": 0.007, "aov": "rich_d"})).unwrap();
    let text = serde_json::to_string(&spec).unwrap();
    let back: RenderSpec = serde_json::from_str(&text).unwrap();
    assert_eq!(canonical_json(&back).unwrap(), canonical_json(&spec).unwrap());
    assert_eq!(back, spec);
}
