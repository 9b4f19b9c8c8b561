//! Collects shapes by material and object and writes them as one GLB.

use std::collections::BTreeMap;

use glam::{Quat, Vec3};
use serde_json::{Value, json};

use super::shape::Mesh;
use crate::glb::GlbBuilder;

/// A material registered with the writer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct MaterialId(usize);

/// A thing in the scene: meshes by material, in its own space.
#[derive(Clone, Debug, Default)]
pub(super) struct Object {
    parts: BTreeMap<MaterialId, Mesh>,
}

impl Object {
    /// Appends a mesh of one material.
    pub(super) fn add(&mut self, material: MaterialId, mesh: Mesh) {
        self.parts.entry(material).or_default().add(mesh);
    }
}

/// Builds the file.
pub(super) struct Writer {
    glb: GlbBuilder,
    /// Repetitions of the texture a metre, by material; `None` for plain colours, which need no texture coordinates.
    repeats: Vec<Option<f32>>,
}

impl Writer {
    pub(super) fn new() -> Self {
        Self { glb: GlbBuilder::new(), repeats: Vec::new() }
    }

    /// A material from its glTF JSON.
    pub(super) fn material(&mut self, json: Value) -> MaterialId {
        self.register(json, None)
    }

    /// A material whose texture repeats `repeat` times a metre.
    pub(super) fn textured(&mut self, json: Value, repeat: f32) -> MaterialId {
        self.register(json, Some(repeat))
    }

    fn register(&mut self, json: Value, repeat: Option<f32>) -> MaterialId {
        for extension in json["extensions"].as_object().into_iter().flat_map(|map| map.keys()) {
            self.glb.use_extension(extension);
        }
        self.repeats.push(repeat);
        MaterialId(self.glb.push("materials", json))
    }

    /// A tiling texture from a PNG file.
    pub(super) fn texture(&mut self, png: &[u8]) -> usize {
        self.glb.texture(png, "image/png", json!({"magFilter": 9729, "minFilter": 9729}))
    }

    /// Places one object once.
    pub(super) fn place(&mut self, name: &str, object: Object) {
        self.repeat(name, object, &[(Vec3::ZERO, 0.0)]);
    }

    /// Places one object several times: position and turn about the vertical axis, degrees.
    pub(super) fn repeat(&mut self, name: &str, object: Object, placements: &[(Vec3, f32)]) {
        let primitives: Vec<Value> = object.parts.into_iter().map(|(id, mesh)| self.primitive(id, &mesh)).collect();
        let mesh = self.glb.push("meshes", json!({"name": name, "primitives": primitives}));
        for (position, degrees) in placements {
            let rotation = Quat::from_rotation_y(degrees.to_radians()).to_array();
            self.glb.root_node(json!({"name": name, "mesh": mesh, "translation": position.to_array(),
                "rotation": rotation}));
        }
    }

    fn primitive(&mut self, id: MaterialId, mesh: &Mesh) -> Value {
        let position = self.glb.floats(&mesh.positions.iter().map(Vec3::to_array).collect::<Vec<_>>());
        let mut attributes = json!({"POSITION": position, "NORMAL": self.normals(mesh)});
        if let Some(repeat) = self.repeats[id.0] {
            let uvs: Vec<[f32; 2]> = mesh.uvs.iter().map(|uv| (*uv * repeat).to_array()).collect();
            attributes["TEXCOORD_0"] = json!(self.glb.floats(&uvs));
        }
        let indices = self.glb.indices(&mesh.triangles);
        json!({"attributes": attributes, "indices": indices, "material": id.0})
    }

    /// Normals as 16-bit integers, padded to 8 bytes (KHR_mesh_quantization).
    fn normals(&mut self, mesh: &Mesh) -> usize {
        let quantise = |x: f32| (x.clamp(-1.0, 1.0) * 32767.0).round() as i16;
        let padded: Vec<[i16; 4]> =
            mesh.normals.iter().map(|n| [quantise(n.x), quantise(n.y), quantise(n.z), 0]).collect();
        self.glb.require_extension("KHR_mesh_quantization");
        self.glb.strided(bytemuck::cast_slice(padded.as_flattened()), 8, 5122, padded.len(), "VEC3", true)
    }

    /// A directional light with its irradiance in W/m^2.
    pub(super) fn sun(&mut self, direction: Vec3, color: [f32; 3], irradiance: f32) {
        self.glb.use_extension("KHR_lights_punctual");
        self.glb.set(
            "extensions",
            json!({"KHR_lights_punctual": {"lights": [
                {"name": "sun", "type": "directional", "color": color, "intensity": irradiance}]}}),
        );
        // lights shine along -Z of their node
        let rotation = Quat::from_rotation_arc(Vec3::NEG_Z, direction.normalize_or(Vec3::NEG_Y));
        self.glb.root_node(json!({"name": "sun", "rotation": rotation.to_array(),
            "extensions": {"KHR_lights_punctual": {"light": 0}}}));
    }

    pub(super) fn finish(self) -> Vec<u8> {
        self.glb.finish()
    }
}
