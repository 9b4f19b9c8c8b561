//! Directions and points from uniform numbers.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::{Vec2, Vec3};

/// Cosine-weighted direction around +z.
pub fn sample_cosine_hemisphere(u: Vec2) -> Vec3 {
    let radius = u.x.sqrt();
    let phi = 2.0 * PI * u.y;
    Vec3::new(radius * phi.cos(), radius * phi.sin(), (1.0 - u.x).max(0.0).sqrt())
}

/// Density of [`sample_cosine_hemisphere`].
pub fn cosine_hemisphere_pdf_solid_angle(cos_theta: f32) -> f32 {
    cos_theta.max(0.0) * FRAC_1_PI
}

/// Barycentric weights of a point of a triangle, uniform over its area.
pub fn sample_triangle(u: Vec2) -> Vec3 {
    let root = u.x.sqrt();
    Vec3::new(1.0 - root, root * (1.0 - u.y), root * u.y)
}

/// Share of a sample by the power heuristic.
pub fn power_heuristic(pdf: f32, other_pdf: f32) -> f32 {
    if !(pdf > 0.0) {
        return 0.0;
    }
    let ratio = other_pdf / pdf;
    1.0 / (1.0 + ratio * ratio)
}
