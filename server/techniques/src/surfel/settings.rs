//! Settings of the surfel cache and of its views: what a larger value of each buys, and what it costs.

use surfelcast_render_api::{Preset, SettingValue, Settings};
use surfelcast_shaders::constants::{IMAGE_MASKED, IMAGE_SUMMED, IMAGE_UNMASKED, IMAGE_UNSCREENED, IMAGE_WEIGHED};

use crate::surfel::settings_table::ROWS;

/// How a surfel's mean follows its rays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Estimator {
    /// Exact mean with a drift test.
    #[default]
    RunningMean,
    /// Multiscale mean estimator, to compare with.
    Multiscale,
}

/// How surfels are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Grid {
    /// Hashed cells of power-of-two sizes, which depend on no camera.
    #[default]
    Cascades,
    /// Uniform cells around the first camera and trapezoidal regions beyond (Brinck et al. 2021), to compare with.
    Trapezoidal,
}

impl Grid {
    /// All by name.
    pub const ALL: [(&'static str, Self); 2] = [("cascades", Self::Cascades), ("trapezoidal", Self::Trapezoidal)];
}

/// Where a cache's first surfels go, before gaps are filled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Initial {
    /// Where gaps are, as all later ones.
    #[default]
    Gaps = 0,
    /// Along directions of a Fibonacci sphere around the camera.
    Fibonacci = 1,
    /// Along a Hilbert curve over the sphere around the camera, so that neighbours get neighbouring ids.
    Hilbert = 2,
}

impl Initial {
    /// All by name.
    pub const ALL: [(&'static str, Self); 3] =
        [("gaps", Self::Gaps), ("fibonacci", Self::Fibonacci), ("hilbert", Self::Hilbert)];
}

/// How what surfels measured becomes what is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Reconstruction {
    /// Each surfel shows its own mean.
    None,
    /// A mean and its neighbours' regression, blended by what is known of both.
    Regression,
    /// The screened Poisson problem on the graph of surfels, with differences measured by reconnected rays.
    #[default]
    Poisson,
    /// Each surfel keeps its own mean; the pixels' light solves a screened Poisson problem with what they gather of
    /// measured differences (after Noack 2022), to compare with.
    Image,
}

impl Reconstruction {
    /// All by name.
    pub const ALL: [(&'static str, Self); 4] =
        [("none", Self::None), ("regression", Self::Regression), ("poisson", Self::Poisson), ("image", Self::Image)];

    /// Whether surfels are joined to their neighbours.
    pub(crate) fn uses_graph(self) -> bool {
        self != Self::None
    }

    /// Whether rays are reconnected to neighbours.
    pub(crate) fn measures_differences(self) -> bool {
        matches!(self, Self::Poisson | Self::Image)
    }

    /// Whether surfels show what they measured themselves.
    pub(crate) fn shows_means(self) -> bool {
        matches!(self, Self::None | Self::Image)
    }
}

/// Where [`Reconstruction::Image`] takes its differences from: ours, then in steps back to the scheme of Noack 2022, so
/// that each cause of its failure can be told apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ImageScheme {
    /// Slopes by the normalised weights of a gather; pixels that no smooth surface joins are not tied together, others
    /// as far as values are noisier than slopes are wrong.
    #[default]
    Weighed = IMAGE_WEIGHED as isize,
    /// Others all alike.
    Masked = IMAGE_MASKED as isize,
    /// All neighbouring pixels are.
    Unmasked = IMAGE_UNMASKED as isize,
    /// Slopes of all overlapping surfels, added up.
    Summed = IMAGE_SUMMED as isize,
    /// And values count for next to nothing.
    Unscreened = IMAGE_UNSCREENED as isize,
}

impl ImageScheme {
    /// All by name.
    pub const ALL: [(&'static str, Self); 5] = [
        ("weighed", Self::Weighed),
        ("masked", Self::Masked),
        ("unmasked", Self::Unmasked),
        ("summed", Self::Summed),
        ("unscreened", Self::Unscreened),
    ];
}

/// How surfels come to a picture's pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Apply {
    /// Each pixel looks surfels up in the grid.
    #[default]
    Gather,
    /// Each surfel is drawn as a box over the pixels that it may light (Noack 2022).
    Boxes,
    /// Each surfel is drawn as a square in its plane: fewer triangles, misses a little at grazing angles.
    Quads,
}

impl Apply {
    /// All by name.
    pub const ALL: [(&'static str, Self); 3] =
        [("gather", Self::Gather), ("boxes", Self::Boxes), ("quads", Self::Quads)];
}

/// Settings of a cache and of the pictures that it lights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfelSettings {
    /// Surfels that fit, a power of two in [2^16, 2^22]; 0 chooses by the device's memory. More keep more of the scene
    /// at hand; each takes about 400 bytes, and 700 more where light is reconstructed.
    pub capacity: u32,
    /// Radius in pixels, [1.5, 32]. Smaller shows more detail; twice as small takes four times the surfels, each of
    /// which needs as many rays.
    pub radius_pixels: f32,
    /// Coverage below which a point gets a surfel, [0.05, 2]. More overlap is smoother and costs surfels and gathering.
    pub coverage: f32,
    /// Rays of an update for each pixel of the picture, [0.01, 16]. More settle sooner and make frames longer.
    pub rays_per_pixel: f32,
    /// Tone-mapped standard error at which a surfel gets no more rays, [0, 0.1]; 0 for never.
    pub target_error: f32,
    /// Share of rays guided to where light came from, [0, 0.9]. Helps where little light comes from few directions;
    /// without it directions come from an even sequence, which helps everywhere.
    pub guided_share: f32,
    /// Gathers respect walls by radial depth. Costs a sixteenth of the gather and removes leaks.
    pub respects_depth: bool,
    /// How light is reconstructed from the surfels.
    pub reconstruction: Reconstruction,
    /// How, where that happens in the image. A wish of the picture's.
    pub image: ImageScheme,
    /// Without reconstruction, young surfels borrow from neighbours.
    pub shares: bool,
    /// Estimator.
    pub estimator: Estimator,
    /// Ray hits are served from the cache. Off, every path is traced to its end.
    pub feeds_back: bool,
    /// Grid.
    pub grid: Grid,
    /// Rays of an update are traced in the order of where they start and which way they go.
    pub bins_rays: bool,
    /// Where the first surfels go.
    pub initial: Initial,
    /// What this picture sees is kept until the picture is gone, however full the cache. A wish of the picture's:
    /// pictures that differ in it share a cache.
    pub pins: bool,
    /// How pixels get light from surfels.
    pub apply: Apply,
    /// A moving picture takes direct light over from the frame before.
    pub reuses_direct: bool,
    /// Direct light is filtered over neighbouring pixels as far as it is noise.
    pub filters_direct: bool,
    /// A picture at rest settles to the path-traced truth. Off, it stays with what the cache says.
    pub settles: bool,
}

impl SurfelSettings {
    /// Quick and soft.
    pub const PREVIEW: Self = Self {
        capacity: 0,
        radius_pixels: 8.0,
        coverage: 0.3,
        rays_per_pixel: 0.25,
        target_error: 0.006,
        guided_share: 0.0,
        respects_depth: true,
        reconstruction: Reconstruction::Poisson,
        image: ImageScheme::Weighed,
        shares: true,
        estimator: Estimator::RunningMean,
        feeds_back: true,
        grid: Grid::Cascades,
        bins_rays: false,
        initial: Initial::Gaps,
        pins: false,
        apply: Apply::Gather,
        reuses_direct: true,
        filters_direct: true,
        settles: true,
    };
    /// The default.
    pub const BALANCED: Self = Self { radius_pixels: 5.0, rays_per_pixel: 0.5, target_error: 0.003, ..Self::PREVIEW };
    /// Slower and exact.
    pub const HIGH: Self = Self { radius_pixels: 3.0, rays_per_pixel: 1.0, target_error: 0.001, ..Self::PREVIEW };
}

/// The presets as they are requested; the same as [`SurfelSettings::PREVIEW`] and its like.
pub(crate) const PRESETS: &[Preset] = &[
    Preset { id: "preview", values: &PREVIEW },
    Preset { id: "balanced", values: &BALANCED },
    Preset { id: "high", values: &HIGH },
];
const PREVIEW: [(&str, SettingValue); 3] = quality(8.0, 0.25, 0.006);
const BALANCED: [(&str, SettingValue); 3] = quality(5.0, 0.5, 0.003);
const HIGH: [(&str, SettingValue); 3] = quality(3.0, 1.0, 0.001);

const fn quality(radius: f64, rays: f64, target: f64) -> [(&'static str, SettingValue); 3] {
    let number = SettingValue::Number;
    [("radius", number(radius)), ("rays", number(rays)), ("target", number(target))]
}

impl SurfelSettings {
    /// Settings without those that change how the cache works and nothing of what is in it.
    pub(crate) fn of_content(&self) -> Self {
        Self { grid: Grid::default(), bins_rays: false, initial: Initial::default(), ..self.of_cache() }
    }

    /// Settings without those of a single view: views that differ in them share a cache.
    pub(crate) fn of_cache(&self) -> Self {
        Self {
            pins: false,
            apply: Apply::Gather,
            reuses_direct: true,
            filters_direct: true,
            settles: true,
            image: ImageScheme::Weighed,
            ..*self
        }
    }
}

impl From<&Settings> for SurfelSettings {
    fn from(settings: &Settings) -> Self {
        let mut read = Self::BALANCED;
        for row in &ROWS {
            row.read(settings, &mut read);
        }
        read
    }
}

impl From<SurfelSettings> for Settings {
    fn from(settings: SurfelSettings) -> Self {
        ROWS.iter().map(|row| (row.setting.id, row.value(&settings))).collect()
    }
}

impl Default for SurfelSettings {
    fn default() -> Self {
        Self::BALANCED
    }
}

#[cfg(test)]
mod tests {
    use surfelcast_render_api::SettingKind;

    use super::*;
    use crate::surfel::ENTRY;
    use crate::surfel::settings_table::SETTINGS;

    #[test]
    fn every_setting_takes_effect_and_comes_back() {
        for setting in &SETTINGS {
            let values = match setting.kind {
                SettingKind::Number { range: [least, most], .. } => {
                    vec![SettingValue::Number(least), SettingValue::Number(most)]
                }
                SettingKind::Switch { .. } => vec![SettingValue::Switch(false), SettingValue::Switch(true)],
                SettingKind::Choice { names, .. } => names.iter().map(|name| SettingValue::name(name)).collect(),
            };
            for value in values {
                let mut settings = Settings::default();
                settings.set(setting, &value).expect(setting.id);
                let read = SurfelSettings::from(&settings);
                assert_eq!(Settings::from(read).get(setting), value, "{}", setting.id);
                assert_eq!(read == SurfelSettings::BALANCED, value == setting.default_value(), "{}", setting.id);
            }
        }
    }

    #[test]
    fn presets_and_defaults_are_those_of_the_code() {
        let presets = [SurfelSettings::PREVIEW, SurfelSettings::BALANCED, SurfelSettings::HIGH];
        for (preset, expected) in PRESETS.iter().zip(presets) {
            let settings = ENTRY.description.preset(preset.id).expect(preset.id);
            assert_eq!(SurfelSettings::from(&settings), expected, "{}", preset.id);
        }
        assert_eq!(Settings::from(SurfelSettings::BALANCED), Settings::defaults(&SETTINGS));
        assert_eq!(ENTRY.description.default_preset().map(|preset| preset.id), Some("balanced"));
    }
}
