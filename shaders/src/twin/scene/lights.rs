//! Densities of next-event estimation.

use glam::Vec3;

/// Density over solid angle, seen from `position`, of a point of a triangle that is drawn with `probability` and
/// uniformly over its area. 0 behind it.
pub fn triangle_pdf_solid_angle(corners: [Vec3; 3], probability: f32, position: Vec3, point: Vec3) -> f32 {
    let normal_twice_area = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let area = 0.5 * normal_twice_area.length();
    let to_light = point - position;
    let cos_light = -normal_twice_area.normalize_or_zero().dot(to_light.normalize_or_zero());
    if !(cos_light > 0.0) || !(area > 0.0) {
        return 0.0;
    }
    probability * to_light.length_squared() / (area * cos_light)
}

/// Intensity of a spot light in a direction as a share of that along its axis (KHR_lights_punctual).
pub fn spot_falloff(cos_angle: f32, cone_scale: f32, cone_offset: f32) -> f32 {
    let cone = (cos_angle * cone_scale + cone_offset).clamp(0.0, 1.0);
    cone * cone
}
