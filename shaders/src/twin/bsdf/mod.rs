//! Twins of `lib/bsdf`. Local frame: z is the shading normal, on the side of `wo`. Values are BSDF times cosine.

pub mod dielectric;
pub mod fresnel;
pub mod lambert;
pub mod metallic_roughness;
pub mod microfacet;

use glam::Vec3;

/// BSDF times cosine and density over solid angle of a direction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evaluation {
    /// BSDF times cosine.
    pub value: Vec3,
    /// 1/sr.
    pub pdf_solid_angle: f32,
}
