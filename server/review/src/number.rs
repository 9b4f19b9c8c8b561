//! Checks of numbers that come from outside: finite and in range.

use glam::DVec3;
use surfelcast_protocol::limits::Limits;

use crate::error::ReviewError;

/// Largest magnitude of a coordinate, metres: beyond it, squares overflow in single precision.
pub const MAX_COORDINATE: f64 = 1e12;
/// Smallest and largest vertical field of view, degrees.
pub const VFOV_DEG: (f64, f64) = (0.1, 179.0);
/// Smallest and largest exposure, linear factor.
pub const EXPOSURE: (f32, f32) = (1e-6, 1e6);
/// Largest intensity of a light.
pub const MAX_INTENSITY: f32 = 1e9;
/// Largest factor on environment and emission.
pub const MAX_STRENGTH: f32 = 1e6;

/// A world-space position.
pub fn position(field: &str, value: [f64; 3]) -> Result<DVec3, ReviewError> {
    if value.iter().all(|c| c.is_finite() && c.abs() <= MAX_COORDINATE) {
        Ok(DVec3::from_array(value))
    } else {
        Err(ReviewError::invalid(field, "each coordinate must be a number within +-1e12 metres"))
    }
}

/// A direction of any length that can be normalised.
pub fn direction(field: &str, value: [f64; 3]) -> Result<DVec3, ReviewError> {
    let vector = position(field, value)?;
    let length = vector.length();
    if length > 1e-12 { Ok(vector / length) } else { Err(ReviewError::invalid(field, "must not have length 0")) }
}

/// A number within a range, bounds included; NaN is within none.
pub fn within<T: PartialOrd + std::fmt::Display + Copy>(
    field: &str,
    value: T,
    low: T,
    high: T,
) -> Result<T, ReviewError> {
    if value >= low && value <= high {
        Ok(value)
    } else {
        Err(ReviewError::invalid(field, format!("must be within {low} to {high}")))
    }
}

/// Width and height of an interactive view, pixels.
pub fn view_size(size: [u32; 2], limits: &Limits) -> Result<[u32; 2], ReviewError> {
    within("w", size[0], 1, limits.max_side)?;
    within("h", size[1], 1, limits.max_side)?;
    if u64::from(size[0]) * u64::from(size[1]) > u64::from(limits.max_pixels) {
        let reason = format!("more than the limit of {} pixels; ask for a smaller view", limits.max_pixels);
        return Err(ReviewError::invalid("w x h", reason));
    }
    Ok(size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extremes_are_refused_by_field() {
        assert!(position("eye", [1e12, -1e12, 0.0]).is_ok());
        for bad in [f64::NAN, f64::INFINITY, 1.1e12] {
            let error = position("eye", [0.0, bad, 0.0]).expect_err("refused").to_string();
            assert!(error.starts_with("eye: "), "{error}");
        }
        assert_eq!(direction("up", [0.0, 0.0, 2.0]).expect("valid"), DVec3::Z);
        assert!(direction("up", [0.0; 3]).is_err());
        assert!(within("x", f32::NAN, 0.0, 1.0).is_err() && within("x", 1.0, 0.0, 1.0).is_ok());
    }

    #[test]
    fn views_are_bounded_by_side_and_area() {
        let limits = Limits::default();
        assert!(view_size([1920, 1080], &limits).is_ok());
        for size in [[0, 10], [10, 0], [4097, 1], [4096, 4096]] {
            assert!(view_size(size, &limits).is_err(), "{size:?}");
        }
    }
}
