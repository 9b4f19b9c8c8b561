//! GGX microfacets.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use crate::twin::core::math::normalize_or;

/// Distribution of normals.
pub fn ggx_distribution(n_dot_h: f32, alpha: f32) -> f32 {
    let a2 = alpha * alpha;
    let s2 = (1.0 - n_dot_h * n_dot_h).max(0.0);
    let d = s2 + a2 * n_dot_h * n_dot_h;
    a2 / (PI * d * d)
}

/// Smith's Lambda.
pub fn ggx_lambda(cos_theta: f32, alpha: f32) -> f32 {
    let c2 = cos_theta * cos_theta;
    let tan2 = (1.0 - c2).max(0.0) / c2.max(1e-12);
    0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0)
}

/// Masking of one direction.
pub fn ggx_masking(cos_theta: f32, alpha: f32) -> f32 {
    1.0 / (1.0 + ggx_lambda(cos_theta, alpha))
}

/// Height-correlated masking and shadowing.
pub fn ggx_masking_shadowing(cos_o: f32, cos_i: f32, alpha: f32) -> f32 {
    1.0 / (1.0 + ggx_lambda(cos_o, alpha) + ggx_lambda(cos_i, alpha))
}

/// Visible normal by spherical caps.
pub fn sample_ggx_visible_normal(wo: Vec3, alpha: f32, u: Vec2) -> Vec3 {
    let w = normalize_or(Vec3::new(alpha * wo.x, alpha * wo.y, wo.z), Vec3::Z);
    let phi = 2.0 * PI * u.x;
    let z = (1.0 - u.y) * (1.0 + w.z) - w.z;
    let sin_theta = (1.0 - z * z).clamp(0.0, 1.0).sqrt();
    let h = Vec3::new(sin_theta * phi.cos(), sin_theta * phi.sin(), z) + w;
    normalize_or(Vec3::new(alpha * h.x, alpha * h.y, h.z.max(0.0)), Vec3::Z)
}

/// Density of [`sample_ggx_visible_normal`].
pub fn ggx_visible_pdf(wo: Vec3, h: Vec3, alpha: f32) -> f32 {
    ggx_masking(wo.z, alpha) * ggx_distribution(h.z, alpha) * wo.dot(h).max(0.0) / wo.z.max(1e-9)
}
