//! Uniforms of a frame: the camera in scene space and the sizes of the light table.

use glam::DVec3;
use surfelcast_scene::Camera;
use surfelcast_shaders::Features;
use surfelcast_shaders::records::FrameUniforms;

use crate::lights::LightBuffers;
use crate::upload::SceneBuffers;

/// Bounces after which a path is terminated. Russian roulette ends nearly all paths long before; the bound keeps a
/// dispatch finite between perfectly white walls.
pub const MAXIMUM_BOUNCES: u32 = 1024;

/// What one image shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameView {
    /// Camera, world space.
    pub camera: Camera,
    /// Pixels.
    pub size: [u32; 2],
    /// Linear factor of the error metric.
    pub exposure: f32,
}

impl FrameView {
    /// Uniforms of a dispatch over all pixels and no samples; the caller fills in the range.
    pub fn uniforms(
        &self,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        features: Features,
        seed: u64,
    ) -> FrameUniforms {
        let [width, height] = self.size;
        let (right, up, forward) = self.camera.frame();
        let half_height = (self.camera.vfov * 0.5).tan();
        let half_width = half_height * f64::from(width) / f64::from(height);
        let to_f32 = |v: DVec3| v.as_vec3().to_array();
        FrameUniforms {
            camera_origin: to_f32(self.camera.position - scene.origin),
            width,
            camera_right: to_f32(right * half_width),
            height,
            camera_up: to_f32(up * half_height),
            first_pixel: 0,
            camera_forward: to_f32(forward),
            pixel_count: width * height,
            seed: [seed as u32, (seed >> 32) as u32],
            first_sample: 0,
            sample_count: 0,
            triangle_light_count: lights.triangle_count,
            punctual_light_count: lights.punctual_count,
            environment_light_count: lights.environment_count,
            emission_scale: lights.emission_scale,
            environment_size: scene.environment_size,
            environment_scale: lights.environment_scale,
            scene_radius: scene.radius,
            top_root: scene.traversal_root(features),
            maximum_bounces: MAXIMUM_BOUNCES,
            exposure: self.exposure,
            selector: 0,
        }
    }
}
