//! Rough transmissive surfaces: the boundary of a volume, or a thin sheet. The twin covers what has a density;
//! perfectly smooth surfaces have none.

use glam::Vec3;

use super::Evaluation;
use super::fresnel::fresnel_dielectric;
use super::microfacet::{ggx_distribution, ggx_masking, ggx_masking_shadowing, ggx_visible_pdf};
use crate::twin::core::math::normalize_or;

/// A rough transmissive surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dielectric {
    /// Index of refraction behind the surface over that in front of it.
    pub eta: f32,
    /// GGX alpha.
    pub alpha: f32,
    /// A sheet without a volume behind it.
    pub is_thin: bool,
    /// Colour of transmitted light.
    pub tint: Vec3,
}

/// Reflectance.
pub fn reflectance(surface: &Dielectric, cos_o: f32) -> f32 {
    let single = fresnel_dielectric(cos_o, surface.eta);
    if surface.is_thin { 2.0 * single / (1.0 + single) } else { single }
}

/// Value and density of `wi`.
pub fn evaluate_dielectric(surface: &Dielectric, wo: Vec3, wi: Vec3) -> Evaluation {
    if wo.z <= 0.0 || wi.z == 0.0 {
        return Evaluation::default();
    }
    let masking = ggx_masking_shadowing(wo.z, wi.z.abs(), surface.alpha);
    if wi.z > 0.0 || surface.is_thin {
        let h = normalize_or(wo + Vec3::new(wi.x, wi.y, wi.z.abs()), Vec3::Z);
        let reflected = reflectance(surface, wo.dot(h));
        let distribution = ggx_distribution(h.z, surface.alpha);
        let (share, probability) = if wi.z < 0.0 {
            (surface.tint * (1.0 - reflected), 1.0 - reflected)
        } else {
            (Vec3::splat(reflected), reflected)
        };
        return Evaluation {
            value: share * (distribution * masking / (4.0 * wo.z)),
            pdf_solid_angle: probability * ggx_masking(wo.z, surface.alpha) * distribution / (4.0 * wo.z),
        };
    }
    let half = normalize_or(wo + surface.eta * wi, Vec3::Z);
    let h = if half.z < 0.0 { -half } else { half };
    let (cos_o, i_dot_h) = (wo.dot(h), wi.dot(h));
    if cos_o <= 0.0 || i_dot_h >= 0.0 {
        return Evaluation::default();
    }
    let reflected = fresnel_dielectric(cos_o, surface.eta);
    let root = surface.eta * i_dot_h + cos_o;
    let denominator = (root * root).max(1e-20);
    let distribution = ggx_distribution(h.z, surface.alpha);
    let value = (1.0 - reflected) * distribution * masking * i_dot_h.abs() * cos_o / (wo.z * denominator);
    let pdf_solid_angle =
        (1.0 - reflected) * ggx_visible_pdf(wo, h, surface.alpha) * surface.eta * surface.eta * i_dot_h.abs()
            / denominator;
    Evaluation { value: surface.tint * value, pdf_solid_angle }
}
