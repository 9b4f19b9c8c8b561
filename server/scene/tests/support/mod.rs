//! Generated files that touch every feature of the loader, and what must hold of any scene that loads.
#![allow(dead_code, reason = "each test program uses a part of this")]

use std::io::Cursor;

use glam::DVec3;
use serde_json::{Value, json};
use surfelcast_scene::glb::GlbBuilder;
use surfelcast_scene::{Environment, Scene};

pub(crate) fn image_bytes(format: image::ImageFormat, width: u32, height: u32) -> Vec<u8> {
    let picture = image::RgbaImage::from_fn(width, height, |x, y| image::Rgba([x as u8 * 30, y as u8 * 30, 128, 200]));
    let mut out = Cursor::new(Vec::new());
    let picture = image::DynamicImage::ImageRgba8(picture);
    let picture = if format == image::ImageFormat::Jpeg { picture.to_rgb8().into() } else { picture };
    picture.write_to(&mut out, format).unwrap();
    out.into_inner()
}

/// A file with every supported feature in it.
pub(crate) fn everything() -> Vec<u8> {
    let mut glb = GlbBuilder::new();
    let repeat = json!({"wrapS": 33648, "wrapT": 33071, "magFilter": 9728});
    let png = glb.texture(&image_bytes(image::ImageFormat::Png, 4, 3), "image/png", repeat);
    let jpeg = glb.texture(&image_bytes(image::ImageFormat::Jpeg, 8, 8), "image/jpeg", json!({}));
    let view = glb.view(&image_bytes(image::ImageFormat::WebP, 4, 4));
    let image = glb.push("images", json!({"bufferView": view, "mimeType": "image/webp"}));
    let webp = glb.push("textures", json!({"extensions": {"EXT_texture_webp": {"source": image}}}));
    for name in [
        "EXT_texture_webp",
        "KHR_lights_punctual",
        "KHR_materials_emissive_strength",
        "KHR_materials_ior",
        "KHR_materials_transmission",
        "KHR_materials_unlit",
        "KHR_materials_volume",
        "KHR_mesh_quantization",
        "KHR_texture_transform",
        "EXT_unheard_of",
    ] {
        glb.use_extension(name);
    }
    let rich = glb.push(
        "materials",
        json!({"name": "rich", "doubleSided": true, "alphaMode": "MASK", "alphaCutoff": 0.4,
            "emissiveFactor": [1.0, 0.5, 0.25], "emissiveTexture": {"index": jpeg},
            "normalTexture": {"index": png, "scale": 0.5}, "occlusionTexture": {"index": png, "strength": 0.5},
            "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.7, 0.6, 0.9], "metallicFactor": 0.5,
                "roughnessFactor": 0.25, "metallicRoughnessTexture": {"index": webp},
                "baseColorTexture": {"index": png, "texCoord": 0, "extensions": {"KHR_texture_transform":
                    {"offset": [0.25, 0.5], "rotation": 0.5, "scale": [2.0, 3.0], "texCoord": 1}}}},
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4.0}}}),
    );
    let glass = glb.push(
        "materials",
        json!({"alphaMode": "BLEND", "normalTexture": {"index": jpeg}, "extensions": {
            "KHR_materials_transmission": {"transmissionFactor": 0.9, "transmissionTexture": {"index": png}},
            "KHR_materials_volume": {"thicknessFactor": 0.1, "attenuationDistance": 0.5,
                "attenuationColor": [0.5, 0.9, 0.5]}, "KHR_materials_ior": {"ior": 1.33}}}),
    );
    let flat = glb.push("materials", json!({"extensions": {"KHR_materials_unlit": {}}}));

    // a quad with everything: floats, tangents, two UV sets, 8-bit colours, 8-bit indices, a morph target
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    let position = glb.floats(&corners);
    let normal = glb.floats(&[[0.0f32, 0.0, 1.0]; 4]);
    let tangent = glb.floats(&[[1.0f32, 0.0, 0.0, -1.0]; 4]);
    let uv = glb.floats(&[[0.0f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
    let uv_short: Vec<u8> = [0u16, 0, 65535, 0, 65535, 65535, 0, 65535].iter().flat_map(|x| x.to_le_bytes()).collect();
    let uv1 = glb.accessor(&uv_short, 5123, 4, "VEC2", true);
    let color = glb.accessor(&[255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255, 9, 9, 9, 9], 5121, 4, "VEC4", true);
    let bytes = glb.accessor(&[0, 1, 2, 0, 2, 3], 5121, 6, "SCALAR", false);
    let target = glb.floats(&[[0.0f32, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.5], [0.0, 0.0, 0.5]]);
    let quad = glb.push(
        "meshes",
        json!({"weights": [0.25], "primitives": [{"material": rich, "indices": bytes,
            "attributes": {"POSITION": position, "NORMAL": normal, "TANGENT": tangent, "TEXCOORD_0": uv,
                "TEXCOORD_1": uv1, "COLOR_0": color},
            "targets": [{"POSITION": target, "NORMAL": target, "TANGENT": target}]}]}),
    );
    // quantised positions with a stride, made sparse, as a strip, a fan and a list without indices
    let mut strided = Vec::new();
    for [x, y, z] in corners.map(|c| c.map(|v: f32| (v * 127.0) as i8 as u8)) {
        strided.extend([x, y, z, 0]);
    }
    let view = glb.view(&strided);
    let mut patched = glb.json();
    patched["bufferViews"][view]["byteStride"] = json!(4);
    glb.set("bufferViews", patched["bufferViews"].clone());
    let sparse_indices = glb.view(&[2, 0, 0, 0]);
    let sparse_values = glb.view(&[100, 100, 20, 0]);
    let quantised = glb.push(
        "accessors",
        json!({"bufferView": view, "componentType": 5120, "count": 4, "type": "VEC3", "normalized": true,
            "sparse": {"count": 1, "indices": {"bufferView": sparse_indices, "componentType": 5121},
                "values": {"bufferView": sparse_values}}}),
    );
    let shorts: Vec<u8> = [0u16, 1, 3, 2].iter().flat_map(|x| x.to_le_bytes()).collect();
    let strip = glb.accessor(&shorts, 5123, 4, "SCALAR", false);
    let words: Vec<u8> = [0u32, 1, 2, 3].iter().flat_map(|x| x.to_le_bytes()).collect();
    let fan = glb.accessor(&words, 5125, 4, "SCALAR", false);
    let mixed = glb.push(
        "meshes",
        json!({"primitives": [
            {"attributes": {"POSITION": quantised, "TEXCOORD_0": uv}, "indices": strip, "mode": 5, "material": glass},
            {"attributes": {"POSITION": quantised}, "indices": fan, "mode": 6, "material": flat},
            {"attributes": {"POSITION": quantised}, "mode": 4},
            {"attributes": {"POSITION": quantised}, "mode": 1}]}),
    );
    // a skinned triangle under two joints, animated in all three ways
    let joints = glb.accessor(&[0, 1, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0], 5121, 3, "VEC4", false);
    let weights = glb.floats(&[[0.5f32, 0.5, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.25, 0.75, 0.0, 0.0]]);
    let triangle = glb.floats(&[[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let skinned = glb.push(
        "meshes",
        json!({"primitives": [{"attributes": {"POSITION": triangle, "JOINTS_0": joints, "WEIGHTS_0": weights}}]}),
    );
    let mut identity = [[0.0f32; 16]; 2];
    identity.iter_mut().for_each(|m| [0, 5, 10, 15].iter().for_each(|&k| m[k] = 1.0));
    let bind = glb.accessor(bytemuck::cast_slice(identity.as_flattened()), 5126, 2, "MAT4", false);
    let times = glb.floats(&[[0.0f32], [1.0], [2.0]]);
    let moves = glb.floats(&[[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0]]);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let turns = glb.floats(&[[0.0f32, 0.0, 0.0, 1.0], [0.0, half, 0.0, half], [0.0, 1.0, 0.0, 0.0]]);
    let cubic = glb.floats(&[[0.0f32], [0.25], [0.1], [0.0], [0.5], [0.0], [0.1], [1.0], [0.0]]);

    let tip = glb.push("nodes", json!({"name": "tip", "translation": [0, 1, 0]}));
    let root = glb.push("nodes", json!({"name": "root", "children": [tip]}));
    glb.push("skins", json!({"joints": [root, tip], "inverseBindMatrices": bind, "skeleton": root}));
    let morphing = glb.push("nodes", json!({"name": "quad", "mesh": quad}));
    let bulb = json!({"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [0, 3, 0]});
    let bulb = glb.push("nodes", bulb);
    let eye = glb.push("cameras", json!({"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.01}}));
    let parallel = json!({"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "zfar": 9, "znear": 0.1}});
    let parallel = glb.push("cameras", parallel);
    glb.set(
        "extensions",
        json!({"KHR_lights_punctual": {"lights": [
            {"type": "spot", "color": [1, 0.5, 0.25], "intensity": 10, "range": 20,
                "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.5}},
            {"type": "directional", "intensity": 3}, {"type": "point", "name": "bulb"}]}}),
    );
    glb.push(
        "animations",
        json!({"name": "all", "samplers": [
            {"input": times, "output": moves, "interpolation": "STEP"}, {"input": times, "output": turns},
            {"input": times, "output": cubic, "interpolation": "CUBICSPLINE"}],
            "channels": [{"sampler": 0, "target": {"node": tip, "path": "translation"}},
                {"sampler": 1, "target": {"node": root, "path": "rotation"}},
                {"sampler": 2, "target": {"node": morphing, "path": "weights"}}]}),
    );
    glb.root_node(json!({"name": "group", "children": [root, morphing, bulb],
        "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1000000, 0, 0, 1]}));
    glb.root_node(json!({"name": "mirror", "mesh": mixed, "scale": [-1, 2, 1], "translation": [1000000, 0, 0]}));
    glb.root_node(json!({"mesh": mixed, "rotation": [0, half, 0, half], "translation": [1000001, 0, 0]}));
    glb.root_node(json!({"name": "skinned", "mesh": skinned, "skin": 0}));
    glb.root_node(json!({"camera": eye, "translation": [1000000, 1, 5]}));
    glb.root_node(json!({"camera": parallel, "extensions": {"KHR_lights_punctual": {"light": 1}}}));
    glb.finish()
}

/// The JSON and binary chunks of a GLB.
pub(crate) fn unpack(glb: &[u8]) -> (Value, Vec<u8>) {
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let binary = glb.get(28 + length..).unwrap_or_default().to_vec();
    (serde_json::from_slice(&glb[20..20 + length]).unwrap(), binary)
}

/// The same file as glTF JSON with `data:` URIs.
pub(crate) fn as_json(glb: &[u8]) -> Vec<u8> {
    use base64::Engine as _;
    let (mut json, binary) = unpack(glb);
    let payload = base64::engine::general_purpose::STANDARD.encode(binary);
    json["buffers"][0]["uri"] = json!(format!("data:application/octet-stream;base64,{payload}"));
    json.to_string().into_bytes()
}

/// Everything the types promise: indices in range, numbers finite.
pub(crate) fn check(scene: &Scene) {
    let geometry = &scene.geometry;
    for triangle in &geometry.triangles {
        assert!(triangle.vertices.iter().all(|&v| (v as usize) < geometry.vertices.len()));
        assert!((triangle.geometry as usize) < geometry.geometries.len());
    }
    for (k, part) in geometry.geometries.iter().enumerate() {
        assert!((part.material as usize) < scene.materials.len());
        assert!((part.node as usize) < scene.node_names.len());
        let range = part.first_triangle as usize..(part.first_triangle + part.triangle_count) as usize;
        assert!(geometry.triangles[range].iter().all(|t| t.geometry as usize == k));
        if part.first_light != u32::MAX {
            for t in 0..part.triangle_count {
                let light = &scene.emissive_triangles[(part.first_light + t) as usize];
                assert_eq!(light.triangle, part.first_triangle + t);
                assert!(light.area.is_finite() && light.mean_radiance.iter().all(|x| x.is_finite()));
            }
        }
    }
    for triangle in &geometry.bvh_triangles {
        assert!((triangle.triangle as usize) < geometry.triangles.len());
        assert!([triangle.v0, triangle.v1, triangle.v2].as_flattened().iter().all(|x| x.is_finite()));
    }
    for level in [&geometry.nodes, &geometry.top_nodes] {
        for node in level {
            let inner = node.imask.count_ones();
            assert!(inner == 0 || (node.child_base_idx + inner) as usize <= level.len());
        }
    }
    for instance in &geometry.instances {
        assert!((instance.root_node as usize) < geometry.nodes.len());
        let rows = instance.scene_from_object.iter().chain(&instance.object_from_scene).flatten();
        assert!(rows.into_iter().all(|x| x.is_finite()));
    }
    for material in &scene.materials {
        let used = [
            &material.base_color_texture,
            &material.metallic_roughness_texture,
            &material.normal_texture,
            &material.occlusion_texture,
            &material.emissive_texture,
            &material.transmission_texture,
        ];
        assert!(used.into_iter().flatten().all(|t| (t.texture as usize) < scene.textures.len() && t.uv_set < 2));
        assert!(material.emissive.iter().chain(&material.base_color).all(|x| x.is_finite()));
    }
    for texture in &scene.textures {
        assert_eq!(texture.texels.len(), texture.width as usize * texture.height as usize * 4);
    }
    for light in &scene.punctual_lights {
        assert!(light.position.is_finite() && light.direction.is_normalized());
        assert!(light.intensity.iter().all(|x| x.is_finite()));
    }
    assert!(scene.origin.is_finite() && scene.bounds.min.is_finite() && scene.bounds.max.is_finite());
    assert!(scene.cameras.iter().all(|camera| camera.camera.is_valid()) && !scene.cameras.is_empty());
    assert!(matches!(scene.environment, Environment::None | Environment::Constant(_)));
    // and tracing it ends
    let eye = (scene.cameras[0].camera.position - scene.origin).as_vec3();
    let aim = (DVec3::ZERO - eye.as_dvec3()).as_vec3();
    if aim.is_finite() && aim.length_squared() > 0.0 && aim.length_squared().is_finite() {
        surfelcast_scene::trace::closest_hit(geometry, eye, aim, 0.0, f32::INFINITY);
    }
}

/// Everything that a scene holds but its identity and how long it took.
pub(crate) fn contents(scene: &Scene) -> String {
    let Scene { name, origin, bounds, geometry, materials, textures, emissive_triangles, punctual_lights, .. } = scene;
    let Scene { environment, view, cameras, node_names, summary, warnings, .. } = scene;
    format!(
        "{name:?} {origin:?} {bounds:?} {geometry:?} {materials:?} {textures:?} {emissive_triangles:?} \
         {punctual_lights:?} {environment:?} {view:?} {cameras:?} {node_names:?} {summary:?} {warnings:?}"
    )
}
