//! Traversal on the device against traversal on the CPU, over the same hierarchies.

use glam::{Vec3, Vec4};
use serde_json::json;
use surfelcast_gpu::MemoryKind;
use surfelcast_scene::glb::GlbBuilder;
use surfelcast_scene::trace::closest_hit;
use surfelcast_scene::{LoadOptions, Scene, load_bytes};
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::twin::core::rng::{PathKey, random4};
use surfelcast_techniques::SceneBuffers;

use crate::device;

const NO_HIT: u32 = u32::MAX;
const RAYS: u32 = 20_000;

fn random(index: u32, dimension: u32) -> [f32; 4] {
    random4(PathKey { pixel: index, sample: 0, seed: [3, 4] }, dimension)
}

fn point(index: u32, dimension: u32) -> Vec3 {
    let [x, y, z, _] = random(index, dimension);
    Vec3::new(x, y, z) * 2.0 - 1.0
}

/// Triangles of all sizes; with `copies` also rotated, scaled and mirrored instances.
fn soup(count: u32, scale: f32, copies: bool) -> Scene {
    let mut glb = GlbBuilder::new();
    let mut positions = Vec::new();
    for index in 0..count {
        let size = 0.6 * random(index, 9)[0].powi(4) + 0.01;
        let center = point(index, 0);
        positions.extend((1..4).map(|corner| ((center + point(index, corner) * size) * scale).to_array()));
    }
    let indices: Vec<[u32; 3]> = (0..count).map(|index| [3 * index, 3 * index + 1, 3 * index + 2]).collect();
    let position = glb.floats(&positions);
    let indices = glb.indices(&indices);
    let mesh = glb.push("meshes", json!({"primitives": [{"attributes": {"POSITION": position}, "indices": indices}]}));
    glb.root_node(json!({"mesh": mesh}));
    if copies {
        for index in 0..12 {
            let place = point(index, 20) * scale * 2.0;
            let turn = point(index, 21).normalize_or(Vec3::X);
            let size = if index % 3 == 0 { [-0.5, 0.7, 0.4] } else { [0.3, 0.3, 0.3] };
            let rotation = [turn.x * 0.6, turn.y * 0.6, turn.z * 0.6, 0.8];
            glb.root_node(json!({
                "mesh": mesh, "translation": place.to_array(), "rotation": rotation, "scale": size
            }));
        }
    }
    load_bytes(&glb.finish(), "soup", &LoadOptions::default()).expect("a valid scene")
}

/// Rays from around the scene into it, between points inside, along axes, and past it.
fn rays(scene: &Scene) -> Vec<[Vec4; 2]> {
    let radius = scene.bounds.radius();
    (0..RAYS)
        .map(|index| {
            let (from, to) = (point(index, 30) * radius, point(index, 31) * radius * 0.5);
            let (origin, direction) = match index % 4 {
                0 => (from.normalize_or(Vec3::X) * radius * 2.0, to - from.normalize_or(Vec3::X) * radius * 2.0),
                1 => (from * 0.4, to - from * 0.4),
                2 => (from * 0.4, [Vec3::X, -Vec3::Y, Vec3::Z][index as usize % 3]),
                _ => (from * 0.5, point(index, 32)),
            };
            [origin.extend(1e30), direction.normalize_or(Vec3::Y).extend(0.0)]
        })
        .collect()
}

fn compare(scene: &Scene, features: Features) {
    let gpu = device::gpu();
    let text = include_str!("../../../bench/src/studies/rays/trace_rays.wesl");
    let kernel = gpu.kernel_from_source("trace_rays", text, features).unwrap_or_else(|error| panic!("{error}"));
    let buffers = SceneBuffers::new(&gpu, scene).expect("fits");
    let rays = rays(scene);
    let ray_buffer = gpu.buffer("rays", MemoryKind::Scene, size_of_val(rays.as_slice()) as u64).expect("fits");
    gpu.upload(&ray_buffer, 0, bytemuck::cast_slice(&rays)).expect("uploads");
    let root = buffers.traversal_root(features);
    let hits: Vec<[u32; 2]> = device::run(&gpu, &kernel, "hits", RAYS, |pass| {
        buffers.bind(pass).uniform("batch", bytemuck::bytes_of(&[RAYS, root, 0, 0])).read("rays", &ray_buffer)
    });

    let (mut met, mut disagreements) = (0, 0);
    for ([start, direction], [t, triangle]) in rays.iter().zip(&hits) {
        let expected = closest_hit(&scene.geometry, start.truncate(), direction.truncate(), 0.0, start.w);
        let found = (*triangle != NO_HIT).then(|| f32::from_bits(*t));
        let agrees = match (expected, found) {
            (None, None) => true,
            // Of two triangles at the same distance either may be the hit; the distance must agree.
            (Some(hit), Some(t)) => {
                met += 1;
                (t - hit.t).abs() <= 2e-5 * (hit.t + scene.bounds.radius())
            }
            _ => false,
        };
        disagreements += u32::from(!agrees);
    }
    assert!(met > RAYS / 5, "only {met} rays met anything");
    // The two triangle tests round differently for rays that graze an outline, and the soup has many.
    assert!(disagreements <= RAYS / 2000, "{disagreements} of {RAYS} rays disagree");
}

#[test]
fn one_hierarchy_gives_the_same_hits() {
    compare(&soup(3000, 1.0, false), Features::NONE);
}

#[test]
fn two_levels_give_the_same_hits() {
    let scene = soup(6000, 1.0, true);
    assert!(scene.summary.has_instances);
    compare(&scene, Features::INSTANCES);
}

#[test]
fn tiny_and_huge_scenes_give_the_same_hits() {
    for scale in [1e-5, 1e5] {
        compare(&soup(800, scale, false), Features::NONE);
    }
}

#[test]
fn the_general_variant_gives_the_same_hits() {
    compare(&soup(800, 1.0, true), Features::ALL);
}
