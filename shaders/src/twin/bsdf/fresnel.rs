//! Fresnel reflectance.

use glam::Vec3;

/// Schlick's approximation.
pub fn fresnel_schlick(f0: Vec3, cos_theta: f32) -> Vec3 {
    let m = (1.0 - cos_theta).clamp(0.0, 1.0);
    let m2 = m * m;
    f0 + (1.0 - f0) * (m2 * m2 * m)
}

/// Exact reflectance of a dielectric; `eta` is the index of refraction behind the surface over that in front of it.
pub fn fresnel_dielectric(cos_o: f32, eta: f32) -> f32 {
    let sin2_t = (1.0 - cos_o * cos_o).max(0.0) / (eta * eta);
    if sin2_t >= 1.0 {
        return 1.0;
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    let parallel = (eta * cos_o - cos_t) / (eta * cos_o + cos_t);
    let perpendicular = (cos_o - eta * cos_t) / (cos_o + eta * cos_t);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}
