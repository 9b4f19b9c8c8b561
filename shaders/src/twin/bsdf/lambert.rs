//! Two-sided Lambertian reflection.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;

use super::Evaluation;

/// Value and density of `wi`.
pub fn evaluate_lambert(albedo: Vec3, wi: Vec3) -> Evaluation {
    let pdf_solid_angle = wi.z.max(0.0) * FRAC_1_PI;
    Evaluation { value: albedo * pdf_solid_angle, pdf_solid_angle }
}
