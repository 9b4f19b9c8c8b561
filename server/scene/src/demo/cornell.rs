//! The well-known box: white room, red and green walls, two blocks, a lamp in the ceiling.

use glam::Vec3;
use serde_json::json;

use super::shape::Mesh;
use super::writer::{Object, Writer};

const SIZE: f32 = 2.0;

/// A Cornell box two metres wide, as GLB.
pub fn cornell_box() -> Vec<u8> {
    let mut writer = Writer::new();
    let mut matte = |name: &str, color: [f32; 3]| {
        let [r, g, b] = color;
        writer.material(json!({"name": name, "pbrMetallicRoughness":
            {"baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0}}))
    };
    let white = matte("white", [0.73, 0.73, 0.73]);
    let red = matte("red", [0.63, 0.06, 0.05]);
    let green = matte("green", [0.14, 0.45, 0.09]);
    let lamp = writer.material(json!({"name": "lamp", "emissiveFactor": [1.0, 0.78, 0.48],
        "pbrMetallicRoughness": {"baseColorFactor": [0.0, 0.0, 0.0, 1.0], "metallicFactor": 0.0},
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 16.0}}}));

    let half = SIZE / 2.0;
    let (x, y, z) = (Vec3::X * SIZE, Vec3::Y * SIZE, Vec3::Z * SIZE);
    let corner = |cx: f32, cy: f32, cz: f32| Vec3::new(cx * half, cy * SIZE, cz * half);
    let mut room = Object::default();
    room.add(white, Mesh::rectangle(corner(-1.0, 0.0, 1.0), x, -z));
    room.add(white, Mesh::rectangle(corner(-1.0, 1.0, -1.0), x, z));
    room.add(white, Mesh::rectangle(corner(-1.0, 0.0, -1.0), x, y));
    room.add(red, Mesh::rectangle(corner(-1.0, 0.0, 1.0), -z, y));
    room.add(green, Mesh::rectangle(corner(1.0, 0.0, -1.0), z, y));
    writer.place("room", room);

    let mut light = Object::default();
    let (width, depth) = (Vec3::X * 0.5, Vec3::Z * 0.4);
    light.add(lamp, Mesh::rectangle(Vec3::new(-0.25, SIZE - 0.002, -0.2), width, depth));
    writer.place("lamp", light);

    let mut tall = Object::default();
    tall.add(white, Mesh::block(0.58, 1.2, 0.58).turned(17.0).at(-0.33, 0.0, -0.3));
    writer.place("tall block", tall);
    let mut short = Object::default();
    short.add(white, Mesh::block(0.58, 0.6, 0.58).turned(-17.0).at(0.35, 0.0, 0.32));
    writer.place("short block", short);
    writer.finish()
}

/// View file of the box.
pub(super) fn view() -> String {
    json!({"cameras": [
        {"name": "front", "position": [0.0, 1.0, 3.9], "target": [0.0, 1.0, 0.0], "up": [0, 1, 0], "vfov_deg": 39.0,
         "resolution": [512, 512]},
        {"name": "inside", "position": [0.75, 1.5, 0.85], "target": [-0.25, 0.6, -0.3], "up": [0, 1, 0],
         "vfov_deg": 60.0, "resolution": [640, 480]}],
        "environment": null, "exposure": 1.0})
    .to_string()
}
