//! The Cornell box with other blocks and other lights.

use std::sync::Arc;

use serde_json::{Value, json};
use surfelcast_scene::environment::EnvironmentMap;
use surfelcast_scene::glb::pack;
use surfelcast_scene::{Camera, Environment, LoadOptions, PunctualKind, PunctualLight, Scene, demo, load_bytes};
use surfelcast_techniques::LightState;

/// A scene with its lights.
pub(crate) struct Setting {
    pub(crate) name: &'static str,
    pub(crate) scene: Scene,
    pub(crate) lights: LightState,
    pub(crate) camera: Camera,
}

fn number(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

/// The box with its tall and its short block of these materials.
fn cornell(tall: &Value, short: &Value, room: &Value, environment: Environment) -> Scene {
    let bytes = demo::cornell_box();
    let json_bytes = number(&bytes, 12);
    let mut json: Value = serde_json::from_slice(&bytes[20..20 + json_bytes]).unwrap();
    let binary = &bytes[20 + json_bytes + 8..];
    for (mesh, material) in [("tall block", tall), ("short block", short)] {
        if material.is_null() {
            continue;
        }
        let materials = json["materials"].as_array_mut().unwrap();
        materials.push(material.clone());
        let index = materials.len() - 1;
        let meshes = json["meshes"].as_array_mut().unwrap();
        let mesh = meshes.iter_mut().find(|one| one["name"] == mesh).unwrap();
        mesh["primitives"].as_array_mut().unwrap().iter_mut().for_each(|part| part["material"] = json!(index));
    }
    if !room.is_null() {
        json["materials"][0]["pbrMetallicRoughness"] = room.clone();
    }
    let used = json!([
        "KHR_materials_emissive_strength",
        "KHR_mesh_quantization",
        "KHR_materials_transmission",
        "KHR_materials_volume",
        "KHR_materials_ior"
    ]);
    json["extensionsUsed"] = used;
    let glb = pack(&serde_json::to_vec(&json).unwrap(), binary);
    load_bytes(&glb, "box", &LoadOptions { environment: Some(environment), ..LoadOptions::default() }).unwrap()
}

fn metal(roughness: f64) -> Value {
    json!({"pbrMetallicRoughness": {"baseColorFactor": [0.9, 0.8, 0.6, 1.0], "metallicFactor": 1.0, "roughnessFactor": roughness}})
}

fn plastic(roughness: f64) -> Value {
    json!({"pbrMetallicRoughness": {"baseColorFactor": [0.2, 0.4, 0.8, 1.0], "metallicFactor": 0.0, "roughnessFactor": roughness}})
}

fn glass(roughness: f64, is_solid: bool) -> Value {
    let mut extensions =
        json!({"KHR_materials_transmission": {"transmissionFactor": 1.0}, "KHR_materials_ior": {"ior": 1.5}});
    if is_solid {
        extensions["KHR_materials_volume"] =
            json!({"thicknessFactor": 1.0, "attenuationDistance": 0.8, "attenuationColor": [0.9, 0.5, 0.4]});
    }
    json!({"pbrMetallicRoughness": {"baseColorFactor": [0.9, 0.95, 1.0, 1.0], "metallicFactor": 0.0, "roughnessFactor": roughness},
        "extensions": extensions})
}

/// A dim sky with a bright spot.
fn sky() -> Environment {
    let (width, height) = (16, 8);
    let pixels = (0..width * height).map(|i| if i == 2 * width + 9 { [30.0, 28.0, 20.0] } else { [0.2, 0.3, 0.5] });
    Environment::Map(Arc::new(EnvironmentMap { width, height, radiance: pixels.collect() }))
}

fn setting(name: &'static str, scene: Scene) -> Setting {
    let lights = LightState::of_scene(&scene);
    // The lamp is out of view: at few samples the noise of its edges would dominate in any technique.
    let camera = Camera {
        position: glam::DVec3::new(0.0, 1.0, 3.6),
        target: glam::DVec3::new(0.0, 0.6, 0.0),
        up: glam::DVec3::Y,
        vfov: 0.6,
    };
    Setting { name, scene, lights, camera }
}

pub(crate) fn matte() -> Setting {
    setting("matte", cornell(&Value::Null, &Value::Null, &Value::Null, Environment::None))
}

pub(crate) fn glossy() -> Setting {
    setting("glossy", cornell(&metal(0.15), &plastic(0.1), &Value::Null, Environment::None))
}

pub(crate) fn settings() -> Vec<Setting> {
    // The camera is inside, at an angle; the sky is visible through the open front.
    let floor = json!({"baseColorFactor": [0.7, 0.7, 0.7, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.25});
    let mut open = setting("sky, sun and spot", cornell(&metal(0.3), &plastic(0.5), &floor, sky()));
    open.lights.punctual = vec![
        PunctualLight {
            name: "sun".to_owned(),
            kind: PunctualKind::Directional,
            position: glam::Vec3::ZERO,
            direction: glam::Vec3::new(0.2, -0.5, -1.0).normalize_or(glam::Vec3::NEG_Y),
            intensity: [2.0, 1.8, 1.5],
            range: f32::INFINITY,
        },
        PunctualLight {
            name: "bulb".to_owned(),
            kind: PunctualKind::Point,
            position: glam::Vec3::new(-0.5, 0.3, 0.8),
            direction: glam::Vec3::NEG_Y,
            intensity: [0.5, 0.7, 0.9],
            range: f32::INFINITY,
        },
    ];
    vec![
        matte(),
        glossy(),
        setting("mirror and glass", cornell(&metal(0.0), &glass(0.0, true), &Value::Null, Environment::None)),
        setting("rough glass", cornell(&glass(0.3, true), &glass(0.2, false), &Value::Null, Environment::None)),
        setting("sheet", cornell(&glass(0.0, false), &metal(0.02), &Value::Null, sky())),
        open,
    ]
}
