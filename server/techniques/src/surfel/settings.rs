//! Knobs of the surfel cache: what turning each up buys, and what it costs.

use surfelcast_shaders::constants::{IMAGE_MASKED, IMAGE_SUMMED, IMAGE_UNMASKED, IMAGE_UNSCREENED, IMAGE_WEIGHED};

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
    /// Each surfel keeps its own mean; the pixels' light solves a screened Poisson problem with what they gather of measured
    /// differences (after Noack 2022), to compare with.
    Image,
}

impl Reconstruction {
    /// All by name.
    pub const ALL: [(&'static str, Self); 4] =
        [("none", Self::None), ("regression", Self::Regression), ("poisson", Self::Poisson), ("image", Self::Image)];

    /// The one of that name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(known, _)| *known == name).map(|(_, reconstruction)| *reconstruction)
    }

    /// All names.
    pub fn names() -> [&'static str; 4] {
        Self::ALL.map(|(name, _)| name)
    }

    /// Its name on the command line and over HTTP.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, known)| *known == self).map_or("none", |(name, _)| name)
    }

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

/// Where [`Reconstruction::Image`] takes its differences from: ours, then in steps back to the scheme of Noack 2022, so that
/// each cause of its failure can be told apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ImageScheme {
    /// Slopes by the normalised weights of a gather; pixels that no smooth surface joins are not tied together, others as far
    /// as values are noisier than slopes are wrong.
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

/// Settings of a cache and of the pictures that it lights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfelSettings {
    /// Surfels that fit, a power of two in [2^16, 2^22]; 0 chooses by the device's memory. More keep more of the scene at
    /// hand; each takes about 400 bytes, and 700 more where light is reconstructed.
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
    /// Share of rays guided to where light came from, [0, 0.9]. Helps where little light comes from few directions; without
    /// it directions come from an even sequence, which helps everywhere.
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
    /// What this picture sees is kept until the picture is gone, however full the cache. A wish of the picture's: pictures that
    /// differ in it share a cache.
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

    /// All presets by name.
    pub const PRESETS: [(&'static str, Self); 3] =
        [("preview", Self::PREVIEW), ("balanced", Self::BALANCED), ("high", Self::HIGH)];

    /// The preset of that name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::PRESETS.iter().find(|(known, _)| *known == name).map(|(_, settings)| *settings)
    }
}

/// A knob: its name on the command line, what it takes, and what turning it up buys and costs.
#[derive(Clone, Copy, Debug)]
pub struct Knob {
    /// Name.
    pub name: &'static str,
    /// Smallest and largest value; switches take 0 and 1.
    pub range: [f32; 2],
    /// What it does.
    pub help: &'static str,
    get: fn(&SurfelSettings) -> f32,
    set: fn(&mut SurfelSettings, f32),
}

/// Every knob.
pub const KNOBS: &[Knob] = &[
    Knob {
        name: "capacity",
        range: [0.0, 4_194_304.0],
        help: "surfels that fit, rounded up to a power of two from 65536; 0 fits the picture. More keep more of the scene; 1100 bytes each",
        get: |settings| settings.capacity as f32,
        set: |settings, value| settings.capacity = value as u32,
    },
    Knob {
        name: "radius",
        range: [1.5, 32.0],
        help: "radius in pixels. Half of it shows finer detail, with four times the surfels and rays for the same noise",
        get: |settings| settings.radius_pixels,
        set: |settings, value| settings.radius_pixels = value,
    },
    Knob {
        name: "coverage",
        range: [0.05, 2.0],
        help: "overlap at which a point counts as covered. More is smoother, with more surfels to trace and gather",
        get: |settings| settings.coverage,
        set: |settings, value| settings.coverage = value,
    },
    Knob {
        name: "rays",
        range: [0.01, 16.0],
        help: "rays of an update for each pixel. More settle in fewer frames, each of which takes longer",
        get: |settings| settings.rays_per_pixel,
        set: |settings, value| settings.rays_per_pixel = value,
    },
    Knob {
        name: "target",
        range: [0.0, 0.1],
        help: "tone-mapped error at which a surfel is done, 0 for never. Less is more exact and keeps tracing longer",
        get: |settings| settings.target_error,
        set: |settings, value| settings.target_error = value,
    },
    Knob {
        name: "guiding",
        range: [0.0, 0.9],
        help: "share of rays sent where light came from. Helps where it comes from few directions; gives up the even sequence of directions",
        get: |settings| settings.guided_share,
        set: |settings, value| settings.guided_share = value,
    },
    Knob {
        name: "depth",
        range: [0.0, 1.0],
        help: "1: surfels do not light what a wall hides from them. Costs a few percent of the frame",
        get: |settings| f32::from(settings.respects_depth),
        set: |settings, value| settings.respects_depth = value >= 0.5,
    },
    Knob {
        name: "image",
        range: [0.0, 4.0],
        help: "with reconstruction in the image, 0: differences by normalised weights, none across folds and steps, each as far as it is believed; 1: believed alike; 2: across folds and steps too; 3: slopes of all overlapping surfels added up, as published; 4: and values all but left out. From 1 on for comparison: worse",
        get: |settings| settings.image as u8 as f32,
        set: |settings, value| {
            settings.image = match value.round() as u8 {
                0 => ImageScheme::Weighed,
                1 => ImageScheme::Masked,
                2 => ImageScheme::Unmasked,
                3 => ImageScheme::Summed,
                _ => ImageScheme::Unscreened,
            };
        },
    },
    Knob {
        name: "sharing",
        range: [0.0, 1.0],
        help: "1: without reconstruction, young surfels borrow from neighbours. Less noise in the first frames, for a pass over the surfels",
        get: |settings| f32::from(settings.shares),
        set: |settings, value| settings.shares = value >= 0.5,
    },
    Knob {
        name: "multiscale",
        range: [0.0, 1.0],
        help: "1: the multiscale mean estimator instead of the exact mean, to compare",
        get: |settings| f32::from(settings.estimator == Estimator::Multiscale),
        set: |settings, value| {
            settings.estimator = if value >= 0.5 { Estimator::Multiscale } else { Estimator::RunningMean };
        },
    },
    Knob {
        name: "feedback",
        range: [0.0, 1.0],
        help: "1: rays end in the cache where it can be trusted. 0 traces every path to its end: slower, no error fed back",
        get: |settings| f32::from(settings.feeds_back),
        set: |settings, value| settings.feeds_back = value >= 0.5,
    },
    Knob {
        name: "grid",
        range: [0.0, 1.0],
        help: "how surfels are found, 0: cells of every size, for any number of cameras; 1: a trapezoidal grid around the first, to compare",
        get: |settings| f32::from(settings.grid == Grid::Trapezoidal),
        set: |settings, value| settings.grid = if value >= 0.5 { Grid::Trapezoidal } else { Grid::Cascades },
    },
    Knob {
        name: "binning",
        range: [0.0, 1.0],
        help: "1: rays are sorted by place and direction before they are traced. The same picture; pays where memory is slower than sorting",
        get: |settings| f32::from(settings.bins_rays),
        set: |settings, value| settings.bins_rays = value >= 0.5,
    },
    Knob {
        name: "initial",
        range: [0.0, 2.0],
        help: "first surfels, 0: where the picture has gaps; 1: on a Fibonacci sphere around the camera; 2: along a Hilbert curve over it, which keeps neighbours together in memory",
        get: |settings| settings.initial as u32 as f32,
        set: |settings, value| {
            settings.initial = match value.round() as u32 {
                0 => Initial::Gaps,
                1 => Initial::Fibonacci,
                _ => Initial::Hilbert,
            };
        },
    },
    Knob {
        name: "pin",
        range: [0.0, 1.0],
        help: "1: surfels that this picture sees are never recycled while it is there, wherever it turns. Fills the cache for others",
        get: |settings| f32::from(settings.pins),
        set: |settings, value| settings.pins = value >= 0.5,
    },
    Knob {
        name: "apply",
        range: [0.0, 2.0],
        help: "0: pixels gather surfels. 1: surfels are drawn as boxes, for about the same picture. 2: as squares, for less than boxes, missing some light at grazing angles",
        get: |settings| settings.apply as u8 as f32,
        set: |settings, value| {
            settings.apply = match value.round() as u8 {
                0 => Apply::Gather,
                1 => Apply::Boxes,
                _ => Apply::Quads,
            };
        },
    },
    Knob {
        name: "reuse",
        range: [0.0, 1.0],
        help: "1: while the camera moves, direct light of the frame before is used again. Less noise, shadows a little softer until it rests; 96 bytes a pixel more",
        get: |settings| f32::from(settings.reuses_direct),
        set: |settings, value| settings.reuses_direct = value >= 0.5,
    },
    Knob {
        name: "filter",
        range: [0.0, 1.0],
        help: "1: direct light is filtered over neighbouring pixels, as far as it is noise. Less noise in the first frames, for a few percent of them; 56 bytes a pixel more",
        get: |settings| f32::from(settings.filters_direct),
        set: |settings, value| settings.filters_direct = value >= 0.5,
    },
    Knob {
        name: "settling",
        range: [0.0, 1.0],
        help: "1: a picture at rest settles to the path-traced truth, by samples of its own once the cache gains less. 0: it stays with the cache, a little off; 32 bytes a pixel less",
        get: |settings| f32::from(settings.settles),
        set: |settings, value| settings.settles = value >= 0.5,
    },
];

impl SurfelSettings {
    /// Turns one knob, given as `name=value`. The answer to what is wrong names the knob and its range.
    pub fn turn(&mut self, assignment: &str) -> Result<(), String> {
        let names = || KNOBS.iter().map(|knob| knob.name).collect::<Vec<_>>().join(", ");
        let Some((name, value)) = assignment.split_once('=') else {
            return Err(format!("{assignment}: expected KNOB=VALUE; knobs are {}", names()));
        };
        let Some(knob) = KNOBS.iter().find(|knob| knob.name == name.trim()) else {
            return Err(format!("{name}: no such knob; there are {}", names()));
        };
        let [least, most] = knob.range;
        let value = value.trim().parse().ok().filter(|value: &f32| (least..=most).contains(value));
        let Some(value) = value else { return Err(format!("{name}: takes a number from {least} to {most}")) };
        (knob.set)(self, value);
        Ok(())
    }

    /// Settings without those that change how the cache works and nothing of what is in it.
    pub(crate) fn of_content(&self) -> Self {
        Self { grid: Grid::default(), bins_rays: false, initial: Initial::default(), ..self.of_cache() }
    }

    /// Settings without the wishes of a single picture: pictures that differ in those share a cache.
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

    /// Value of a knob.
    pub fn value_of(&self, knob: &Knob) -> f32 {
        (knob.get)(self)
    }
}

impl Default for SurfelSettings {
    fn default() -> Self {
        Self::BALANCED
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_knob_turns_within_its_range_and_refuses_beyond() {
        for knob in KNOBS {
            let mut settings = SurfelSettings::BALANCED;
            let [least, most] = knob.range;
            for value in [least, most] {
                settings.turn(&format!("{}={value}", knob.name)).expect(knob.name);
                assert_eq!(settings.value_of(knob), value, "{}", knob.name);
            }
            assert!(
                settings.turn(&format!("{}={}", knob.name, most * 2.0 + 1.0)).is_err_and(|e| e.contains(knob.name))
            );
        }
        let mut settings = SurfelSettings::BALANCED;
        for bad in ["radius", "radius=", "radius=nan", "size=3", "=", "rays=-1"] {
            assert!(settings.turn(bad).is_err(), "{bad}");
        }
        assert_eq!(settings, SurfelSettings::BALANCED);
    }
}
