//! Small rooms made of quads.

use serde_json::json;
use surfelcast_scene::glb::GlbBuilder;
use surfelcast_scene::{Environment, LoadOptions, Scene, load_bytes};

/// A material: base colour, emission, whether it is unlit.
#[derive(Clone, Copy)]
pub(crate) struct Paint {
    pub(crate) albedo: f32,
    pub(crate) emission: f32,
    pub(crate) is_unlit: bool,
}

impl Paint {
    pub(crate) const fn matte(albedo: f32) -> Self {
        Self { albedo, emission: 0.0, is_unlit: false }
    }

    pub(crate) const fn lamp(emission: f32) -> Self {
        Self { albedo: 0.0, emission, is_unlit: false }
    }
}

/// Corners of a triangle or quadrilateral, counter-clockwise seen from its front, and its paint.
pub(crate) type Face = (Vec<[f32; 3]>, Paint);

/// A scene of faces under a constant sky.
pub(crate) fn scene(faces: &[Face], sky: f32) -> Scene {
    let mut glb = GlbBuilder::new();
    glb.use_extension("KHR_materials_unlit");
    glb.use_extension("KHR_materials_emissive_strength");
    for (corners, paint) in faces {
        let mut material = json!({
            "pbrMetallicRoughness": {"baseColorFactor": [paint.albedo, paint.albedo, paint.albedo, 1.0],
                "metallicFactor": 0.0, "roughnessFactor": 1.0},
            "extensions": {}});
        if paint.emission > 0.0 {
            material["emissiveFactor"] = json!([1.0, 1.0, 1.0]);
            material["extensions"]["KHR_materials_emissive_strength"] = json!({"emissiveStrength": paint.emission});
        }
        if paint.is_unlit {
            material["extensions"]["KHR_materials_unlit"] = json!({});
        }
        let material = glb.push("materials", material);
        let positions = glb.floats(corners);
        let triangles: Vec<[u32; 3]> = (1..corners.len() as u32 - 1).map(|i| [0, i, i + 1]).collect();
        let indices = glb.indices(&triangles);
        let mesh = glb.push(
            "meshes",
            json!({"primitives": [{"attributes": {"POSITION": positions}, "indices": indices, "material": material}]}),
        );
        glb.root_node(json!({"mesh": mesh}));
    }
    let environment = if sky > 0.0 { Environment::Constant([sky; 3]) } else { Environment::None };
    let options = LoadOptions { environment: Some(environment), ..LoadOptions::default() };
    load_bytes(&glb.finish(), "test", &options).unwrap()
}

/// The six inner faces of a box.
pub(crate) fn inside_of_box(low: [f32; 3], high: [f32; 3], paint: Paint) -> Vec<Face> {
    let ([x0, y0, z0], [x1, y1, z1]) = (low, high);
    [
        [[x0, y0, z0], [x0, y0, z1], [x1, y0, z1], [x1, y0, z0]],
        [[x0, y1, z0], [x1, y1, z0], [x1, y1, z1], [x0, y1, z1]],
        [[x0, y0, z0], [x1, y0, z0], [x1, y1, z0], [x0, y1, z0]],
        [[x0, y0, z1], [x0, y1, z1], [x1, y1, z1], [x1, y0, z1]],
        [[x0, y0, z0], [x0, y1, z0], [x0, y1, z1], [x0, y0, z1]],
        [[x1, y0, z0], [x1, y0, z1], [x1, y1, z1], [x1, y1, z0]],
    ]
    .map(|corners| (corners.to_vec(), paint))
    .to_vec()
}

/// The four inner faces of a tetrahedron.
pub(crate) fn inside_of_tetrahedron(paint: Paint) -> Vec<Face> {
    let [a, b, c, d] = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0f32]];
    [[a, c, b], [a, b, d], [a, d, c], [b, c, d]].map(|corners| (corners.to_vec(), paint)).to_vec()
}

/// A rectangle of constant z.
pub(crate) fn upright(x: [f32; 2], y: [f32; 2], z: f32, paint: Paint) -> Face {
    (vec![[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]], paint)
}

/// A square lamp below a ceiling.
pub(crate) fn lamp(x: f32, z: f32, half: f32, emission: f32) -> Face {
    let y = 0.98;
    let corners = [[-half, -half], [half, -half], [half, half], [-half, half]];
    (corners.map(|[dx, dz]| [x + dx, y, z + dz]).to_vec(), Paint::lamp(emission))
}

/// A room under many lamps of different strength, with a free-standing wall.
pub(crate) fn many_lamps() -> Scene {
    let mut faces = inside_of_box([-2.0, -1.0, -2.0], [2.0, 1.0, 2.0], Paint::matte(0.3));
    faces.push(upright([-0.5, 0.5], [-1.0, 0.4], 0.0, Paint::matte(0.8)));
    for index in 0..16_u8 {
        let (column, row) = (f32::from(index % 4), f32::from(index / 4));
        faces.push(lamp(column - 1.5, row - 1.5, 0.05, 4.0 + 3.0 * f32::from(index * 7 % 11)));
    }
    scene(&faces, 0.0)
}
