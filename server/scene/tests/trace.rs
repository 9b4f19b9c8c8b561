//! The CPU tracer against brute force, and against rays aimed at the edges and corners of closed meshes.
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

use glam::{DVec3, Vec3};
use serde_json::json;
use surfelcast_scene::glb::GlbBuilder;
use surfelcast_scene::trace::{any_hit, closest_hit};
use surfelcast_scene::{LoadOptions, Scene, load_bytes};

/// A counter-based generator: the same number for the same key.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ (x >> 31)) >> 40) as f32 / (1u64 << 24) as f32
    }

    fn point(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0
    }

    fn direction(&mut self) -> Vec3 {
        loop {
            let p = self.point();
            if p.length_squared() > 1e-3 && p.length_squared() < 1.0 {
                return p.normalize();
            }
        }
    }
}

fn mesh_scene(positions: &[Vec3], triangles: &[[u32; 3]], nodes: &[serde_json::Value]) -> Scene {
    let mut glb = GlbBuilder::new();
    let position = glb.floats(&positions.iter().map(Vec3::to_array).collect::<Vec<_>>());
    let indices = glb.indices(triangles);
    let mesh = glb.push("meshes", json!({"primitives": [{"attributes": {"POSITION": position}, "indices": indices}]}));
    for node in nodes {
        let mut node = node.clone();
        node["mesh"] = json!(mesh);
        glb.root_node(node);
    }
    load_bytes(&glb.finish(), "test", &LoadOptions::default()).unwrap()
}

fn soup(count: u32, size: f32, scale: f32, random: &mut Random) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut positions = Vec::new();
    for _ in 0..count {
        let center = random.point();
        positions.extend([random.point(), random.point(), random.point()].map(|p| (center + p * size) * scale));
    }
    (positions, (0..count).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect())
}

/// All triangles in world space through their instances, f64.
fn world_triangles(scene: &Scene) -> Vec<[DVec3; 3]> {
    let geometry = &scene.geometry;
    let mut list = Vec::new();
    let mut seen = std::collections::BTreeSet::new();
    for instance in &geometry.instances {
        // the triangles of an instance's hierarchy: walk its nodes
        let mut stack = vec![instance.root_node];
        while let Some(node) = stack.pop() {
            let node = &geometry.nodes[node as usize];
            stack.extend((0..node.imask.count_ones()).map(|k| node.child_base_idx + k));
            for slot in (0..8).filter(|&slot| !node.is_child_empty(slot) && node.is_leaf(slot)) {
                let (first, count) = node.child_primitives(slot);
                for triangle in &geometry.bvh_triangles[first as usize..(first + count) as usize] {
                    if geometry.instances.len() == 1 && !seen.insert(triangle.triangle) {
                        continue;
                    }
                    let rows = instance.scene_from_object;
                    list.push([triangle.v0, triangle.v1, triangle.v2].map(|v| {
                        let v = v.map(f64::from);
                        DVec3::from_array(rows.map(|r| {
                            f64::from(r[0]) * v[0] + f64::from(r[1]) * v[1] + f64::from(r[2]) * v[2] + f64::from(r[3])
                        }))
                    }));
                }
            }
        }
    }
    list
}

/// Nearest distance in f64 with the smallest barycentric weight there, which tells how close to an edge the hit is.
fn brute_force(triangles: &[[DVec3; 3]], origin: Vec3, direction: Vec3) -> Option<(f64, f64)> {
    let (o, d) = (origin.as_dvec3(), direction.as_dvec3());
    let mut best: Option<(f64, f64)> = None;
    for [a, b, c] in triangles {
        let (e1, e2) = (*b - *a, *c - *a);
        let p = d.cross(e2);
        let det = e1.dot(p);
        if det == 0.0 {
            continue;
        }
        let s = o - *a;
        let u = s.dot(p) / det;
        let q = s.cross(e1);
        let v = d.dot(q) / det;
        let t = e2.dot(q) / det;
        let least = u.min(v).min(1.0 - u - v);
        if least >= 0.0 && t > 0.0 && best.is_none_or(|(nearest, _)| t < nearest) {
            best = Some((t, least));
        }
    }
    best
}

fn compare(scene: &Scene, scale: f32, rays: u32, random: &mut Random) {
    let triangles = world_triangles(scene);
    let (mut hits, mut edge_cases) = (0, 0);
    for k in 0..rays {
        let origin = random.point() * 2.0 * scale;
        let direction = match k % 4 {
            0 => [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y, Vec3::Z, -Vec3::Z][(k / 4 % 6) as usize],
            1 => {
                let mut d = random.direction();
                d[(k / 4 % 3) as usize] = 0.0;
                if d == Vec3::ZERO { Vec3::X } else { d }
            }
            // aimed somewhere near a triangle
            _ => {
                let target = triangles[(random.next() * triangles.len() as f32) as usize % triangles.len()];
                let target = (target[0] + target[1] + target[2]).as_vec3() / 3.0 + random.point() * 0.01 * scale;
                (target - origin).normalize()
            }
        };
        let found = closest_hit(&scene.geometry, origin, direction, 0.0, f32::INFINITY);
        let expected = brute_force(&triangles, origin, direction);
        assert_eq!(found.is_some(), any_hit(&scene.geometry, origin, direction, 0.0, f32::INFINITY));
        let agrees = match (found, expected) {
            (None, None) => true,
            (Some(hit), Some((t, _))) => (f64::from(hit.t) - t).abs() <= 1e-3 * t + 2e-5 * f64::from(scale),
            _ => false,
        };
        if agrees {
            hits += u32::from(found.is_some());
        } else {
            // f32 and f64 may disagree on which side of a free edge a ray passes, and nowhere else
            edge_cases += 1;
        }
    }
    println!("scale {scale:e}: {hits} hits of {rays}, {edge_cases} edge cases");
    assert!(hits > rays / 10, "{hits} hits");
    assert!(edge_cases <= rays / 2000, "{edge_cases} of {rays} rays disagree");
}

#[test]
fn closest_hits_match_brute_force_at_every_scale() {
    let mut random = Random(1);
    for scale in [1e-6, 1e-3, 1.0, 1e6] {
        for (count, size) in [(1, 1.0), (30, 0.5), (400, 0.2), (2000, 0.05)] {
            let (positions, triangles) = soup(count, size, scale, &mut random);
            let scene = mesh_scene(&positions, &triangles, &[json!({})]);
            // a lone triangle is rarely met by random rays
            if count > 1 {
                let shift = scene.origin.as_vec3() / scale;
                assert!(shift.length() < 1.0);
                compare(&scene, scale, 8000, &mut random);
            }
        }
    }
}

#[test]
fn instances_match_brute_force() {
    let mut random = Random(2);
    let (positions, triangles) = soup(40_000, 0.01, 1.0, &mut random);
    let nodes = [
        json!({"translation": [-1.0, 0.0, 0.0], "scale": [0.5, 0.5, 0.5]}),
        json!({"translation": [1.0, 0.3, 0.0], "scale": [-0.5, 0.6, 0.4], "rotation": [0.0, 0.6, 0.0, 0.8]}),
        json!({"translation": [0.0, 1.0, 0.2], "scale": [0.3, 1e-3, 0.3]}),
    ];
    let scene = mesh_scene(&positions, &triangles, &nodes);
    assert_eq!(scene.geometry.instances.len(), 3);
    assert!(scene.geometry.instances.iter().any(|instance| instance.is_mirrored));
    assert!(scene.geometry.baked_instance.is_none() && scene.summary.has_instances);
    assert_eq!(scene.geometry.triangles.len(), 40_000, "instances share their triangles");
    compare(&scene, 1.0, 600, &mut random);
}

/// A closed, bumpy sphere whose triangles share vertices.
fn ball(rings: u32, segments: u32, center: Vec3, radius: f32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut positions = vec![center + Vec3::Y * radius];
    for ring in 1..rings {
        for segment in 0..segments {
            let theta = std::f32::consts::PI * ring as f32 / rings as f32;
            let phi = std::f32::consts::TAU * segment as f32 / segments as f32;
            let bump = 1.0 + 0.1 * (5.0 * phi).sin() * (4.0 * theta).sin();
            let direction = Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin());
            positions.push(center + direction * radius * bump);
        }
    }
    positions.push(center - Vec3::Y * radius);
    let at = |ring: u32, segment: u32| 1 + (ring - 1) * segments + segment % segments;
    let last = positions.len() as u32 - 1;
    let mut triangles = Vec::new();
    for s in 0..segments {
        triangles.push([0, at(1, s + 1), at(1, s)]);
        triangles.push([last, at(rings - 1, s), at(rings - 1, s + 1)]);
        for r in 1..rings - 1 {
            triangles.push([at(r, s), at(r, s + 1), at(r + 1, s)]);
            triangles.push([at(r, s + 1), at(r + 1, s + 1), at(r + 1, s)]);
        }
    }
    (positions, triangles)
}

#[test]
fn closed_meshes_do_not_leak() {
    let mut random = Random(3);
    let mut rays = 0u32;
    for (scale, offset) in
        [(1.0, Vec3::ZERO), (1e-6, Vec3::ZERO), (1e6, Vec3::ZERO), (1.0, Vec3::new(300.0, -200.0, 100.0))]
    {
        let (mut positions, mut triangles) = ball(24, 48, offset * scale, scale);
        // an anchor far away keeps the ball off the centre of the scene
        let anchor = positions.len() as u32;
        positions.extend([
            -offset * scale,
            -offset * scale + Vec3::X * scale * 1e-3,
            -offset * scale + Vec3::Y * scale * 1e-3,
        ]);
        triangles.push([anchor, anchor + 1, anchor + 2]);
        let scene = mesh_scene(&positions, &triangles, &[json!({})]);
        // vertices as the tracer has them
        let corners: Vec<[Vec3; 3]> =
            scene.geometry.bvh_triangles.iter().map(|t| [t.v0, t.v1, t.v2].map(Vec3::from_array)).collect();
        let center = (offset.as_dvec3() * f64::from(scale) - scene.origin).as_vec3();
        for _ in 0..280_000 {
            let triangle = corners[(random.next() * corners.len() as f32) as usize % corners.len()];
            if (triangle[0] - center).length() > 2.0 * scale {
                continue;
            }
            let (a, b) = (triangle[0], triangle[1]);
            let target = match rays % 3 {
                0 => a,
                1 => a + (b - a) * random.next(),
                _ => (a + b) * 0.5,
            };
            let origin = center + random.point() * 0.3 * scale;
            rays += 1;
            let found = any_hit(&scene.geometry, origin, target - origin, 0.0, f32::INFINITY);
            assert!(found, "leak at scale {scale}: from {origin} to {target}");
        }
    }
    println!("{rays} rays");
    assert!(rays > 1_000_000);
}

#[test]
fn building_twice_gives_the_same_hierarchy() {
    let mut random = Random(4);
    let (positions, triangles) = soup(30_000, 0.05, 1.0, &mut random);
    let [a, b] = [0, 1].map(|_| mesh_scene(&positions, &triangles, &[json!({})]));
    assert_eq!(a.id, b.id);
    assert_eq!(a.geometry.nodes, b.geometry.nodes);
    let order = |scene: &Scene| scene.geometry.bvh_triangles.iter().map(|t| t.triangle).collect::<Vec<_>>();
    assert_eq!(order(&a), order(&b));
}

#[test]
fn empty_scenes_have_no_hits() {
    let scene = load_bytes(&GlbBuilder::new().finish(), "empty", &LoadOptions::default()).unwrap();
    assert_eq!(closest_hit(&scene.geometry, Vec3::ZERO, Vec3::Z, 0.0, f32::INFINITY), None);
    assert_eq!(scene.cameras[0].name, "default");
    assert!(scene.bounds.radius() > 0.0);
}
