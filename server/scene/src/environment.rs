//! What rays see that leave the scene.

use std::sync::Arc;

/// Radiance from infinitely far away.
#[derive(Clone, Debug, PartialEq, Default)]
pub enum Environment {
    /// Black.
    #[default]
    None,
    /// The same radiance from every direction, linear Rec. 709.
    Constant([f32; 3]),
    /// An equirectangular image.
    Map(Arc<EnvironmentMap>),
}

/// Equirectangular radiance. Row 0 is +Y (up); column `u` in `[0, 1)` looks along
/// `(sin(phi) sin(theta), cos(theta), -cos(phi) sin(theta))` with `phi = 2 pi (u - 0.5)`, `theta = pi v`, so the middle
/// of the image is -Z.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentMap {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Row-major linear radiance, finite and not negative; `width * height` entries.
    pub radiance: Vec<[f32; 3]>,
}
