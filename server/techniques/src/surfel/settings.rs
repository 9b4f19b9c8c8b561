//! Knobs of the surfel cache: what turning each up buys, and what it costs.

/// How a surfel's mean follows its rays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Estimator {
    /// Exact mean with a drift test.
    #[default]
    RunningMean,
    /// Multiscale mean estimator, to compare with.
    Multiscale,
}

/// Settings of a cache.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfelSettings {
    /// Surfels that fit, a power of two in [2^16, 2^22]; 0 chooses by the device's memory. More keep more of the scene at
    /// hand; each takes about 380 bytes.
    pub capacity: u32,
    /// Radius in pixels, [1.5, 32]. Smaller shows more detail; twice as small takes four times the surfels, each of which
    /// needs as many rays.
    pub radius_pixels: f32,
    /// Coverage below which a point gets a surfel, [0.05, 2]. More overlap is smoother and costs surfels and gathering.
    pub coverage: f32,
    /// Rays of an update for each pixel of the picture, [0.01, 16]. More settle sooner and make frames longer.
    pub rays_per_pixel: f32,
    /// Tone-mapped standard error at which a surfel gets no more rays, [0, 0.1]; 0 for never.
    pub target_error: f32,
    /// Share of rays guided to where light came from, [0, 0.9]. Helps where little light comes from few directions.
    pub guided_share: f32,
    /// Gathers respect walls by radial depth. Costs a sixteenth of the gather and removes leaks.
    pub respects_depth: bool,
    /// Young surfels borrow from neighbours.
    pub shares: bool,
    /// Estimator.
    pub estimator: Estimator,
    /// Ray hits are served from the cache. Off, every path is traced to its end.
    pub feeds_back: bool,
}

impl SurfelSettings {
    /// Quick and soft.
    pub const PREVIEW: Self = Self {
        capacity: 0,
        radius_pixels: 6.0,
        coverage: 0.35,
        rays_per_pixel: 0.25,
        target_error: 0.006,
        guided_share: 0.5,
        respects_depth: true,
        shares: true,
        estimator: Estimator::RunningMean,
        feeds_back: true,
    };
    /// The default.
    pub const BALANCED: Self = Self { radius_pixels: 4.0, rays_per_pixel: 0.5, target_error: 0.003, ..Self::PREVIEW };
    /// Slower and exact.
    pub const HIGH: Self = Self { radius_pixels: 2.5, rays_per_pixel: 1.0, target_error: 0.001, ..Self::PREVIEW };

    /// All presets by name.
    pub const PRESETS: [(&'static str, Self); 3] =
        [("preview", Self::PREVIEW), ("balanced", Self::BALANCED), ("high", Self::HIGH)];

    /// The preset of that name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::PRESETS.iter().find(|(known, _)| *known == name).map(|(_, settings)| *settings)
    }
}

impl Default for SurfelSettings {
    fn default() -> Self {
        Self::BALANCED
    }
}
