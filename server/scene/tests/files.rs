//! Where the loader looks for files, what it refuses, and what its numbers must be in closed form.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::print_stderr,
    clippy::disallowed_methods,
    clippy::needless_for_each,
    clippy::unreadable_literal,
    clippy::trivially_copy_pass_by_ref,
    reason = "a test may stop at the first surprise and talk to its terminal"
)]

mod support;

use std::path::Path;

use serde_json::{Value, json};
use surfelcast_scene::glb::{GlbBuilder, pack};
use surfelcast_scene::{LoadOptions, PunctualKind, Scene, SceneError, SceneLimits, load_bytes, load_file};

fn message(result: Result<Scene, SceneError>) -> String {
    result.map(|scene| scene.name).unwrap_err().to_string()
}

/// A glTF of one triangle whose buffer has the given URI.
fn triangle_json(uri: &str) -> Vec<u8> {
    json!({"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"byteLength": 36, "uri": uri}]})
    .to_string()
    .into_bytes()
}

fn triangle_buffer() -> Vec<u8> {
    [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect()
}

fn load_with_uri(folder: &Path, uri: &str) -> Result<Scene, SceneError> {
    let path = folder.join("scene.gltf");
    std::fs::write(&path, triangle_json(uri)).unwrap();
    load_file(&path, &LoadOptions::default())
}

#[test]
fn siblings_are_read_and_nothing_else() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("scene");
    std::fs::create_dir_all(folder.join("data")).unwrap();
    for place in [folder.join("a b.bin"), folder.join("data/c.bin"), root.path().join("secret.bin")] {
        std::fs::write(place, triangle_buffer()).unwrap();
    }
    for uri in ["a b.bin", "a%20b.bin", "data/c.bin", "./data/c.bin"] {
        assert_eq!(load_with_uri(&folder, uri).unwrap().summary.triangle_count, 1, "{uri}");
    }
    let absolute = root.path().join("secret.bin").display().to_string();
    for uri in [
        "../secret.bin",
        "data/../../secret.bin",
        "%2e%2e/secret.bin",
        "..%2fsecret.bin",
        "%252e%252e/secret.bin",
        "..\\secret.bin",
        "file:///etc/passwd",
        "https://example.org/c.bin",
        "//host/c.bin",
        "c:secret.bin",
        "c.bin%00",
        "",
        &absolute,
    ] {
        let refused = message(load_with_uri(&folder, uri));
        assert!(refused.contains("buffers[0].uri"), "{uri}: {refused}");
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(root.path().join("secret.bin"), folder.join("link.bin")).unwrap();
        std::os::unix::fs::symlink(root.path(), folder.join("up")).unwrap();
        assert!(load_with_uri(&folder, "link.bin").is_err(), "a symbolic link leads out");
        assert!(load_with_uri(&folder, "up/secret.bin").is_err(), "a linked folder leads out");
    }
    assert!(message(load_with_uri(&folder, "data")).contains("not a regular file"));
    assert!(message(load_bytes(&triangle_json("a b.bin"), "upload", &LoadOptions::default())).contains("embed"));
}

#[test]
fn the_identity_covers_siblings_and_options() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("a.bin");
    std::fs::write(&place, triangle_buffer()).unwrap();
    let first = load_with_uri(folder.path(), "a.bin").unwrap().id;
    assert_eq!(first, load_with_uri(folder.path(), "a.bin").unwrap().id);
    assert!(first.0.starts_with("sha256:") && first.0.len() == 71);
    let mut other = triangle_buffer();
    other[12] ^= 1;
    std::fs::write(&place, other).unwrap();
    assert_ne!(first, load_with_uri(folder.path(), "a.bin").unwrap().id);
    std::fs::write(&place, triangle_buffer()).unwrap();
    std::fs::write(folder.path().join("scene.json"), r#"{"exposure": 2}"#).unwrap();
    let with_view = load_with_uri(folder.path(), "a.bin").unwrap();
    assert_ne!(first, with_view.id);
    assert_eq!(with_view.exposure_for("any"), 2.0);
}

/// A small file changed by one JSON edit.
fn edited(edit: impl FnOnce(&mut Value)) -> Result<Scene, SceneError> {
    let (mut json, binary) = support::unpack(&support::everything());
    edit(&mut json);
    load_bytes(&pack(json.to_string().as_bytes(), &binary), "edited", &LoadOptions::default())
}

#[test]
fn errors_name_the_field_and_the_limit() {
    assert!(edited(|_| {}).is_ok());
    let cases: [(&str, &str, Value); 14] = [
        ("/accessors/0/count", "vertices", json!(u64::MAX)),
        ("/accessors/0/count", "bufferViews", json!(5_000)),
        ("/bufferViews/0/byteLength", "bufferViews[0]", json!(u64::MAX)),
        ("/bufferViews/0/byteOffset", "bufferViews[0]", json!(u64::MAX)),
        ("/buffers/0/byteLength", "buffers[0].byteLength", json!(1_000_000)),
        ("/meshes/0/primitives/0/material", "meshes[0].primitives[0].material", json!(99)),
        ("/meshes/0/primitives/0/attributes/POSITION", "accessors[999]", json!(999)),
        ("/meshes/0/primitives/0/mode", "meshes[0].primitives[0].mode", json!(7)),
        ("/nodes/1/children", "nodes[", json!([1])),
        ("/nodes/1/rotation", "nodes[1].rotation", json!([0, 0, 0, 0])),
        ("/materials/0/alphaMode", "materials[0].alphaMode", json!("FUZZY")),
        ("/materials/0/pbrMetallicRoughness/baseColorFactor", "materials[0].pbrMetallicRoughness", json!([1])),
        ("/asset/version", "asset.version", json!("1.0")),
        ("/scene", "scene", json!(4)),
    ];
    for (pointer, expected, value) in cases {
        let text = message(edited(|json| {
            let (parent, key) = pointer.rsplit_once('/').unwrap();
            json.pointer_mut(parent).unwrap()[key] = value.clone();
        }));
        assert!(text.contains(expected), "{pointer} = {value}: {text}");
    }
    let required = edited(|json| json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]));
    assert!(matches!(required, Err(SceneError::UnsupportedExtension { name }) if name == "KHR_draco_mesh_compression"));
    assert!(edited(|json| json["extensionsRequired"] = json!(["KHR_mesh_quantization"])).is_ok());
}

#[test]
fn bounds_hold_before_anything_is_allocated() {
    let everything = support::everything();
    let refused = |limits: SceneLimits| {
        message(load_bytes(&everything, "bounded", &LoadOptions { limits, ..LoadOptions::default() }))
    };
    let base = SceneLimits::default();
    assert!(refused(SceneLimits { max_file_bytes: 100, ..base }).contains("over the limit of 100"));
    assert!(refused(SceneLimits { max_json_bytes: 100, ..base }).contains("JSON bytes"));
    assert!(refused(SceneLimits { max_vertices: 20, ..base }).contains("over the limit of 20"));
    assert!(refused(SceneLimits { max_triangles: 5, ..base }).contains("triangles"));
    assert!(refused(SceneLimits { max_nodes: 3, ..base }).contains("nodes"));
    assert!(refused(SceneLimits { max_node_depth: 2, ..base }).contains("depth"));
    assert!(refused(SceneLimits { max_materials: 1, ..base }).contains("materials"));
    assert!(refused(SceneLimits { max_image_side: 4, ..base }).contains("images[1]"));
    assert!(refused(SceneLimits { max_texel_bytes: 100, ..base }).contains("decoded images"));
    assert!(refused(SceneLimits { max_punctual_lights: 1, ..base }).contains("punctual lights"));
    // a PNG that claims 60,000 x 60,000 pixels is refused by its header
    let mut glb = GlbBuilder::new();
    let mut png = support::image_bytes(image::ImageFormat::Png, 4, 4);
    png[16..24].copy_from_slice(&[0, 0, 0xea, 0x60, 0, 0, 0xea, 0x60]);
    let texture = glb.texture(&png, "image/png", json!({}));
    glb.push("materials", json!({"emissiveTexture": {"index": texture}}));
    assert!(message(load_bytes(&glb.finish(), "bomb", &LoadOptions::default())).contains("images[0]"));
}

#[test]
fn numbers_that_are_not_finite_are_refused_by_accessor() {
    for bad in [f32::NAN, f32::INFINITY] {
        let mut glb = GlbBuilder::new();
        let position = glb.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]);
        let broken = glb.accessor(
            bytemuck::cast_slice(&[0.0f32, 0.0, 0.0, 1.0, bad, 0.0, 0.0, 1.0, 0.0]),
            5126,
            3,
            "VEC3",
            false,
        );
        assert_eq!((position, broken), (0, 1));
        let mesh = glb.push("meshes", json!({"primitives": [{"attributes": {"POSITION": broken}}]}));
        glb.root_node(json!({"mesh": mesh}));
        let text = message(load_bytes(&glb.finish(), "nan", &LoadOptions::default()));
        assert!(text.contains("accessors[1]") && text.contains("element 1"), "{text}");
    }
}

#[test]
fn emitters_and_lights_have_their_closed_forms() {
    let mut glb = GlbBuilder::new();
    let white = support::image_bytes(image::ImageFormat::Png, 1, 1);
    let texture = glb.texture(&white, "image/png", json!({}));
    let lamp = glb.push(
        "materials",
        json!({"emissiveFactor": [1.0, 0.5, 0.25], "emissiveTexture": {"index": texture},
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 10.0}}}),
    );
    let position = glb.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let mesh = json!({"primitives": [{"attributes": {"POSITION": position}, "material": lamp}]});
    let mesh = glb.push("meshes", mesh);
    glb.root_node(json!({"mesh": mesh, "scale": [2, 3, 1]}));
    glb.root_node(json!({"mesh": mesh, "scale": [-2, 3, 1], "translation": [0, 0, 5]}));
    glb.set(
        "extensions",
        json!({"KHR_lights_punctual": {"lights": [{"type": "spot", "intensity": 4.0,
        "color": [1, 0.5, 0.25], "spot": {"outerConeAngle": 0.5}}]}}),
    );
    let half = std::f64::consts::FRAC_1_SQRT_2;
    // turned by 90 degrees about +Y, -Z becomes -X
    let light = json!({"rotation": [0, half, 0, half], "scale": [7, 7, 7], "translation": [0, 0, 2],
        "extensions": {"KHR_lights_punctual": {"light": 0}}});
    glb.root_node(light);
    let scene = load_bytes(&glb.finish(), "lamps", &LoadOptions::default()).unwrap();

    let texel = surfelcast_scene::sample::srgb_to_linear(128.0 / 255.0);
    for triangle in &scene.emissive_triangles {
        assert!((triangle.area - 3.0).abs() < 1e-6, "half of 2 x 3");
        // the texture is one texel of (0, 0, 128 / 255)
        assert_eq!(triangle.mean_radiance[0], 0.0);
        assert!((triangle.mean_radiance[2] - 2.5 * texel).abs() < 1e-5, "{:?}", triangle.mean_radiance);
        let [a, b, c] = triangle.corners;
        let normal = (b - a).cross(c - a).normalize();
        assert!((normal - glam::Vec3::Z).length() < 1e-6, "mirroring keeps the front: {normal}");
    }
    let light = &scene.punctual_lights[0];
    assert!(matches!(light.kind, PunctualKind::Spot { inner_angle, .. } if inner_angle == 0.0));
    assert!((light.direction - glam::Vec3::NEG_X).length() < 1e-6, "{}", light.direction);
    assert_eq!(light.intensity, [4.0, 2.0, 1.0]);
    assert!(light.range.is_infinite());
    let world = scene.origin + light.position.as_dvec3();
    assert!((world - glam::DVec3::new(0.0, 0.0, 2.0)).length() < 1e-6);
}
