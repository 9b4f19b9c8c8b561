//! Triangles that rays hit on the CPU.

use glam::{Vec3, Vec4};
use surfelcast_scene::SceneGeometry;
use surfelcast_scene::trace::Hit;

/// Corners of the triangle that was hit, in scene space.
pub(crate) fn corners(geometry: &SceneGeometry, hit: &Hit) -> [Vec3; 3] {
    let triangle = &geometry.bvh_triangles[hit.bvh_triangle as usize];
    let rows = geometry.instances[hit.instance as usize].scene_from_object.map(Vec4::from);
    [triangle.v0, triangle.v1, triangle.v2].map(|corner| {
        let corner = Vec3::from(corner);
        if geometry.baked_instance == Some(hit.instance) {
            corner
        } else {
            Vec3::from_array(rows.map(|row| row.dot(corner.extend(1.0))))
        }
    })
}

/// The triangle's normal on the side from which the ray came.
pub(crate) fn facing_normal(geometry: &SceneGeometry, hit: &Hit, direction: Vec3) -> Vec3 {
    let [v0, v1, v2] = corners(geometry, hit);
    let normal = (v1 - v0).cross(v2 - v0).normalize_or(-direction);
    if normal.dot(direction) > 0.0 { -normal } else { normal }
}
