//! What lies under a point of an image.

use glam::DVec3;

use crate::{Camera, Scene, trace};

/// The surface under a point of an image.
#[derive(Clone, Debug, PartialEq)]
pub struct Picked {
    /// World position.
    pub position: DVec3,
    /// Node name; empty where the node has none.
    pub object: String,
}

impl Scene {
    /// Traces one ray on the CPU through `point`, 0 to 1 from the top left of an image with this ratio of width to
    /// height.
    pub fn pick(&self, camera: &Camera, aspect: f64, point: [f32; 2]) -> Option<Picked> {
        let (right, up, forward) = camera.frame();
        let half_height = (camera.vfov * 0.5).tan();
        let x = (f64::from(point[0]) * 2.0 - 1.0) * half_height * aspect;
        let y = (1.0 - f64::from(point[1]) * 2.0) * half_height;
        let direction = (forward + right * x + up * y).normalize_or(forward);
        let origin = (camera.position - self.origin).as_vec3();
        let hit = trace::closest_hit(&self.geometry, origin, direction.as_vec3(), 0.0, f32::MAX)?;
        let triangle = self.geometry.bvh_triangles.get(hit.bvh_triangle as usize)?;
        let geometry = self.geometry.geometries.get(triangle.geometry as usize)?;
        let instance = self.geometry.instances.get(hit.instance as usize)?;
        let is_baked = self.geometry.baked_instance == Some(hit.instance);
        let node = if is_baked { geometry.node } else { instance.node };
        Some(Picked {
            position: camera.position + direction * f64::from(hit.t),
            object: self.node_names.get(node as usize).cloned().unwrap_or_default(),
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::{LoadOptions, ViewFile, demo, load_bytes};

    use super::*;

    #[test]
    fn a_point_finds_the_surface_behind_it() {
        let demo = demo::scenes().into_iter().find(|demo| demo.name == "cornell_box").unwrap();
        let view = ViewFile::parse(demo.view.as_bytes()).unwrap();
        let scene =
            load_bytes(&demo.glb, demo.name, &LoadOptions { view: Some(view), ..LoadOptions::default() }).unwrap();
        let camera = scene.cameras[0].camera;
        let (right, up, forward) = camera.frame();
        for point in [[0.5, 0.5], [0.3, 0.6], [0.7, 0.4]] {
            let picked = scene.pick(&camera, 1.5, point).unwrap();
            assert!(scene.node_names.contains(&picked.object), "{picked:?}");
            let arm = picked.position - camera.position;
            let half_height = (camera.vfov * 0.5).tan() * arm.dot(forward);
            let seen_at = [0.5 + 0.5 * arm.dot(right) / (half_height * 1.5), 0.5 - 0.5 * arm.dot(up) / half_height];
            let distance = (seen_at[0] - f64::from(point[0])).hypot(seen_at[1] - f64::from(point[1]));
            assert!(distance < 1e-6, "{point:?} is seen at {seen_at:?}");
        }
        let bounds = scene.bounds;
        let outside = scene.origin + (bounds.max * 10.0).as_dvec3();
        let away = Camera { position: outside, target: outside * 2.0 - scene.origin, ..camera };
        assert_eq!(scene.pick(&away, 1.5, [0.5, 0.5]), None);
    }
}
