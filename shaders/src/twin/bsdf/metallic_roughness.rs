//! glTF metallic-roughness.

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::Evaluation;
use super::fresnel::fresnel_schlick;
use super::microfacet::{ggx_distribution, ggx_masking, ggx_masking_shadowing, sample_ggx_visible_normal};
use crate::twin::core::math::{luminance, normalize_or};
use crate::twin::core::sampling::sample_cosine_hemisphere;

/// Both lobes and the choice between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MetallicRoughness {
    /// Albedo of the diffuse lobe.
    pub diffuse_color: Vec3,
    /// Reflectance at normal incidence.
    pub f0: Vec3,
    /// GGX alpha.
    pub alpha: f32,
    /// Probability of drawing from the specular lobe.
    pub specular_probability: f32,
}

/// Smallest GGX alpha.
pub const MINIMUM_ALPHA: f32 = 1e-3;

/// Lobes of a material seen under a cosine.
pub fn metallic_roughness(base_color: Vec3, metallic: f32, roughness: f32, ior: f32, cos_o: f32) -> MetallicRoughness {
    let m = metallic.clamp(0.0, 1.0);
    let r = roughness.clamp(0.0, 1.0);
    let root = (ior - 1.0) / (ior + 1.0);
    let f0 = Vec3::splat((root * root).min(1.0)).lerp(base_color, m);
    let diffuse_color = base_color * (1.0 - m);
    let fresnel = luminance(fresnel_schlick(f0, cos_o));
    let diffuse = luminance(diffuse_color) * (1.0 - fresnel);
    let specular_probability =
        if diffuse <= 0.0 { 1.0 } else { (fresnel / (fresnel + diffuse).max(1e-6)).clamp(0.1, 1.0) };
    MetallicRoughness { diffuse_color, f0, alpha: (r * r).max(MINIMUM_ALPHA), specular_probability }
}

/// Value and density of `wi`.
pub fn evaluate_metallic_roughness(lobes: &MetallicRoughness, wo: Vec3, wi: Vec3) -> Evaluation {
    if wi.z <= 0.0 || wo.z <= 0.0 {
        return Evaluation::default();
    }
    let h = normalize_or(wo + wi, Vec3::Z);
    let o_dot_h = wo.dot(h).clamp(0.0, 1.0);
    let distribution = ggx_distribution(h.z, lobes.alpha);
    let fresnel = fresnel_schlick(lobes.f0, o_dot_h);
    let specular = fresnel * (distribution * ggx_masking_shadowing(wo.z, wi.z, lobes.alpha) / (4.0 * wo.z));
    let diffuse = (1.0 - fresnel) * lobes.diffuse_color * (FRAC_1_PI * wi.z);
    let specular_pdf = ggx_masking(wo.z, lobes.alpha) * distribution / (4.0 * wo.z);
    let diffuse_pdf = wi.z * FRAC_1_PI;
    let pdf_solid_angle = diffuse_pdf + (specular_pdf - diffuse_pdf) * lobes.specular_probability;
    Evaluation { value: specular + diffuse, pdf_solid_angle }
}

/// Direction from the mixture of both lobes; may lie below the surface.
pub fn sample_metallic_roughness(lobes: &MetallicRoughness, wo: Vec3, u: Vec3) -> Vec3 {
    let plane = Vec2::new(u.x, u.y);
    if u.z < lobes.specular_probability {
        let h = sample_ggx_visible_normal(wo, lobes.alpha, plane);
        return 2.0 * wo.dot(h) * h - wo;
    }
    sample_cosine_hemisphere(plane)
}
