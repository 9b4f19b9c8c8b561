//! A room with clutter, at any number of triangles: always the same shapes, only finer, so that light and image stay
//! the same while the geometry grows.

use std::f32::consts::{PI, TAU};

use glam::{DVec3, Vec3};
use serde_json::json;
use surfelcast::Failure;
use surfelcast_scene::glb::GlbBuilder;
use surfelcast_scene::{Camera, LoadOptions, Scene, load_bytes};

/// Half the room's width and depth, and its height, metres.
const HALF: f32 = 3.0;
const HEIGHT: f32 = 3.0;
/// Boulders on the floor, and their share of the triangles.
const BOULDERS: usize = 24;
const BOULDER_SHARE: f64 = 0.75;
/// Angle between neighbours on a spiral, radians: no two are in line.
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

#[derive(Default)]
struct Mesh {
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// A grid of `columns` x `rows` cells with corners at `place(s, t)`; normals are along ds x dt.
    fn add_grid(&mut self, columns: u32, rows: u32, place: impl Fn(f32, f32) -> Vec3) {
        let base = self.positions.len() as u32;
        for row in 0..=rows {
            for column in 0..=columns {
                self.positions.push(place(column as f32 / columns as f32, row as f32 / rows as f32).to_array());
            }
        }
        for row in 0..rows {
            for column in 0..columns {
                let a = base + row * (columns + 1) + column;
                let (b, c, d) = (a + 1, a + columns + 2, a + columns + 1);
                self.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
}

/// A smooth function without a period that a grid could match.
fn waves(p: Vec3) -> f32 {
    let wave = |x: f32, y: f32, z: f32, phase: f32| (p.x * x + p.y * y + p.z * z + phase).sin();
    wave(2.1, 1.3, 0.7, 0.0) * 0.5 + wave(-3.7, 4.1, 2.9, 1.0) * 0.3 + wave(7.3, -5.9, 8.3, 2.0) * 0.2
}

fn room(triangles: f64) -> Mesh {
    // Six sides with cells² cells each, two triangles a cell.
    let cells = ((triangles / 12.0).sqrt().round() as u32).max(1);
    let mut mesh = Mesh::default();
    let (low, high) = (Vec3::new(-HALF, 0.0, -HALF), Vec3::new(HALF, HEIGHT, HALF));
    let (x, y, z) = (Vec3::X * 2.0 * HALF, Vec3::Y * HEIGHT, Vec3::Z * 2.0 * HALF);
    for (origin, u, v) in [(low, z, x), (low, x, y), (low, y, z), (high, -x, -z), (high, -y, -x), (high, -z, -y)] {
        let inward = u.cross(v).normalize_or(Vec3::Y);
        mesh.add_grid(cells, cells, |s, t| {
            let p = origin + u * s + v * t;
            // Flat at the edges, where the sides meet.
            let edge = 16.0 * s * (1.0 - s) * t * (1.0 - t);
            p + inward * (0.04 * edge * (1.0 + waves(p)))
        });
    }
    mesh
}

fn boulder(number: usize, triangles: f64) -> Mesh {
    // Twice as many columns as rows.
    let rows = ((triangles / 4.0).sqrt().round() as u32).max(3);
    let radius = 0.18 + 0.14 * (number as f32 * 1.7).sin().abs();
    let distance = 0.6 + 2.0 * ((number as f32 + 0.5) / BOULDERS as f32).sqrt();
    let (sin, cos) = (number as f64 * GOLDEN_ANGLE).sin_cos();
    let centre = Vec3::new(distance * cos as f32, radius * 0.9, distance * sin as f32);
    let mut mesh = Mesh::default();
    mesh.add_grid(2 * rows, rows, |s, t| {
        let (polar, around) = (t * PI, -s * TAU);
        let ring = if t == 0.0 || t == 1.0 { 0.0 } else { polar.sin() };
        let normal = Vec3::new(ring * around.cos(), -polar.cos(), ring * around.sin());
        centre + normal * radius * (1.0 + 0.2 * waves(normal * 1.5 + centre * 3.0))
    });
    // At the poles a row of corners is one.
    let corner = |index: u32| Vec3::from_array(mesh.positions[index as usize]);
    mesh.triangles.retain(|&[a, b, c]| (corner(b) - corner(a)).cross(corner(c) - corner(a)).length() > 0.0);
    mesh
}

/// The room with about that number of triangles.
pub(super) fn tessellated_room(triangles: u32) -> Result<Scene, Failure> {
    let mut glb = GlbBuilder::new();
    let mut material = |color: [f32; 3], emission: f32| {
        let [r, g, b] = color;
        glb.push(
            "materials",
            json!({"pbrMetallicRoughness": {"baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0},
                   "emissiveFactor": [emission, emission, emission],
                   "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 12.0}}}),
        )
    };
    let (wall, lamp) = (material([0.7, 0.68, 0.62], 0.0), material([0.0; 3], 1.0));
    let stones = [material([0.6, 0.3, 0.2], 0.0), material([0.3, 0.45, 0.6], 0.0), material([0.55, 0.6, 0.3], 0.0)];
    glb.use_extension("KHR_materials_emissive_strength");

    let total = f64::from(triangles);
    let mut lamp_mesh = Mesh::default();
    lamp_mesh.add_grid(1, 1, |s, t| Vec3::new(0.5 - s, HEIGHT - 0.15, t - 0.5));
    // The lamp shines down.
    lamp_mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    let mut parts = vec![(wall, room(total * (1.0 - BOULDER_SHARE))), (lamp, lamp_mesh)];
    for number in 0..BOULDERS {
        parts.push((stones[number % stones.len()], boulder(number, total * BOULDER_SHARE / BOULDERS as f64)));
    }
    for (material, mesh) in parts {
        let position = glb.floats(&mesh.positions);
        let indices = glb.indices(&mesh.triangles);
        let primitive = json!({"attributes": {"POSITION": position}, "indices": indices, "material": material});
        let mesh = glb.push("meshes", json!({"primitives": [primitive]}));
        glb.root_node(json!({"mesh": mesh}));
    }
    Ok(load_bytes(&glb.finish(), "tessellated_room", &LoadOptions::default())?)
}

/// A camera near the wall at an angle about the room's centre, radians, that looks across the room.
pub(super) fn camera_at(angle: f64) -> Camera {
    let (sin, cos) = angle.sin_cos();
    Camera {
        position: DVec3::new(2.5 * cos, 1.7, 2.5 * sin),
        target: DVec3::new(-0.4 * cos, 0.4, -0.4 * sin),
        up: DVec3::Y,
        vfov: 1.1,
    }
}

/// One of a series of cameras, each at another place.
pub(super) fn camera(number: u32) -> Camera {
    camera_at(f64::from(number) * GOLDEN_ANGLE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_room_has_the_requested_triangles_and_is_closed() {
        for wanted in [10_000, 100_000] {
            let scene = tessellated_room(wanted).unwrap();
            let count = f64::from(scene.summary.triangle_count);
            assert!((count / f64::from(wanted) - 1.0).abs() < 0.15, "{count} for {wanted}");
            assert_eq!(scene.summary.emissive_triangle_count, 2);
            assert_eq!(scene.warnings, Vec::<String>::new());
            for number in 0..8 {
                let camera = camera(number);
                let (right, up, forward) = camera.frame();
                let eye = (camera.position - scene.origin).as_vec3();
                for (x, y) in [(0.0, 0.0), (-0.7, -0.5), (0.7, -0.5), (-0.7, 0.5), (0.7, 0.5)] {
                    let direction = (forward + right * x + up * y).as_vec3();
                    let hit = surfelcast_scene::trace::closest_hit(&scene.geometry, eye, direction, 0.0, f32::MAX);
                    assert!(hit.is_some_and(|hit| hit.t > 0.2), "camera {number} sees nothing, or a wall before it");
                }
            }
        }
    }

    #[test]
    fn the_lamp_shines_down() {
        let scene = tessellated_room(10_000).unwrap();
        let [a, b, c] = scene.emissive_triangles[0].corners;
        assert!((b - a).cross(c - a).y < 0.0);
    }
}
