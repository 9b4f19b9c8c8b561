//! Constants and small functions.

use glam::{Mat3, Vec3};

/// Largest finite value that a sum of a few terms may still hold.
pub const HUGE: f32 = 1e30;

/// Relative luminance of linear Rec. 709.
pub fn luminance(c: Vec3) -> f32 {
    c.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// Unit vector along `v`, or the fallback where it has no direction.
pub fn normalize_or(v: Vec3, fallback: Vec3) -> Vec3 {
    let scale = v.abs().max_element();
    if !(scale > 0.0) || scale > HUGE {
        return fallback;
    }
    let w = v / scale;
    w / w.length()
}

/// Right-handed orthonormal frame around a unit vector. Columns: tangent, bitangent, n.
pub fn frame_around(n: Vec3) -> Mat3 {
    let s = if n.z >= 0.0 { 1.0 } else { -1.0 };
    let a = -1.0 / (s + n.z);
    let b = n.x * n.y * a;
    Mat3::from_cols(Vec3::new(1.0 + s * n.x * n.x * a, s * b, -s * n.x), Vec3::new(b, s + n.y * n.y * a, -n.y), n)
}
