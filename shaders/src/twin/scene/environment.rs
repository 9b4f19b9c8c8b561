//! Radiance from infinitely far away.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

/// Image coordinates of a direction in the equirectangular image.
pub fn environment_uv(direction: Vec3) -> Vec2 {
    let u = direction.x.atan2(-direction.z) / (2.0 * PI) + 0.5;
    Vec2::new(u, direction.y.clamp(-1.0, 1.0).acos() / PI)
}

/// Direction of image coordinates.
pub fn environment_direction(uv: Vec2) -> Vec3 {
    let phi = 2.0 * PI * (uv.x - 0.5);
    let theta = PI * uv.y;
    Vec3::new(phi.sin() * theta.sin(), theta.cos(), -phi.cos() * theta.sin())
}

/// Texel of a direction.
pub fn environment_texel(size: [u32; 2], direction: Vec3) -> usize {
    let uv = environment_uv(direction);
    let x = ((uv.x * size[0] as f32) as u32).min(size[0] - 1);
    let y = ((uv.y * size[1] as f32) as u32).min(size[1] - 1);
    (y * size[0] + x) as usize
}

/// Density over solid angle of a direction whose texel is drawn with `probabilities` and which is uniform in (u, v)
/// inside it.
pub fn environment_pdf_solid_angle(size: [u32; 2], probabilities: &[f32], direction: Vec3) -> f32 {
    let sin_theta = (PI * environment_uv(direction).y).sin();
    if sin_theta <= 0.0 {
        return 0.0;
    }
    let probability = probabilities[environment_texel(size, direction)];
    probability * (size[0] * size[1]) as f32 / (2.0 * PI * PI * sin_theta)
}
