//! The table of settings: how each is called, what it does, and which field of [`SurfelSettings`] it is.

use surfelcast_render_api::{Setting, SettingKind, SettingValue, Settings};

use crate::surfel::settings::{Apply, Estimator, Grid, ImageScheme, Initial, Reconstruction, SurfelSettings};

/// A setting with its field.
pub(crate) struct Row {
    /// Its description.
    pub(crate) setting: Setting,
    field: Field,
}

/// Reads and writes a field. Choices are indices of names.
enum Field {
    Number(fn(&SurfelSettings) -> f32, fn(&mut SurfelSettings, f32)),
    Switch(fn(&SurfelSettings) -> bool, fn(&mut SurfelSettings, bool)),
    Choice(fn(&SurfelSettings) -> usize, fn(&mut SurfelSettings, usize)),
}

impl Row {
    /// Takes the setting's value over.
    pub(crate) fn read(&self, settings: &Settings, into: &mut SurfelSettings) {
        match self.field {
            Field::Number(_, set) => set(into, settings.number(&self.setting) as f32),
            Field::Switch(_, set) => set(into, settings.switch(&self.setting)),
            Field::Choice(_, set) => set(into, settings.choice(&self.setting)),
        }
    }

    /// The field's value.
    pub(crate) fn value(&self, of: &SurfelSettings) -> SettingValue {
        match (&self.field, self.setting.kind) {
            (Field::Number(get, _), _) => SettingValue::Number(decimal(get(of))),
            (Field::Switch(get, _), _) => SettingValue::Switch(get(of)),
            (Field::Choice(get, _), SettingKind::Choice { default, names }) => {
                SettingValue::name(names.get(get(of)).copied().unwrap_or(default))
            }
            (Field::Choice(..), _) => self.setting.default_value(),
        }
    }
}

/// The number as people write it: 0.05 and not 0.05000000074505806.
fn decimal(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

const fn number(
    id: &'static str,
    label: &'static str,
    unit: &'static str,
    default: f64,
    range: [f64; 2],
    help: &'static str,
) -> Setting {
    Setting { id, label, help, unit, kind: SettingKind::Number { default, range, is_integer: false } }
}

const fn switch(id: &'static str, label: &'static str, default: bool, help: &'static str) -> Setting {
    Setting { id, label, help, unit: "", kind: SettingKind::Switch { default } }
}

const fn choice(
    id: &'static str,
    label: &'static str,
    default: &'static str,
    names: &'static [&'static str],
    help: &'static str,
) -> Setting {
    Setting { id, label, help, unit: "", kind: SettingKind::Choice { default, names } }
}

const fn names<T: Copy, const N: usize>(all: &[(&'static str, T); N]) -> [&'static str; N] {
    let mut names = [""; N];
    let mut index = 0;
    while index < N {
        names[index] = all[index].0;
        index += 1;
    }
    names
}

fn index_of<T: PartialEq>(all: &[(&str, T)], value: &T) -> usize {
    all.iter().position(|(_, known)| known == value).unwrap_or(0)
}

const RECONSTRUCTIONS: [&str; 4] = names(&Reconstruction::ALL);
const SCHEMES: [&str; 5] = names(&ImageScheme::ALL);
const GRIDS: [&str; 2] = names(&Grid::ALL);
const INITIALS: [&str; 3] = names(&Initial::ALL);
const APPLIES: [&str; 3] = names(&Apply::ALL);

/// Every setting, as it is requested.
pub(crate) const SETTINGS: [Setting; ROWS.len()] = {
    let mut settings = [ROWS[0].setting; ROWS.len()];
    let mut index = 0;
    while index < ROWS.len() {
        settings[index] = ROWS[index].setting;
        index += 1;
    }
    settings
};

/// Every setting with its field.
pub(crate) const ROWS: [Row; 20] = [
    Row {
        setting: Setting {
            id: "capacity",
            label: "Capacity",
            help: "surfels that fit, rounded up to a power of two from 65536; 0 fits the image and the device. More keep \
                   more of the scene, for 1100 bytes each",
            unit: "surfels",
            kind: SettingKind::Number { default: 0.0, range: [0.0, 4_194_304.0], is_integer: true },
        },
        field: Field::Number(|s| s.capacity as f32, |s, value| s.capacity = value as u32),
    },
    Row {
        setting: number(
            "radius",
            "Radius",
            "pixels",
            5.0,
            [1.5, 32.0],
            "radius of surfels. Half of it shows finer detail, with four times the surfels and rays for the same noise",
        ),
        field: Field::Number(|s| s.radius_pixels, |s, value| s.radius_pixels = value),
    },
    Row {
        setting: number(
            "coverage",
            "Coverage",
            "",
            0.3,
            [0.05, 2.0],
            "overlap at which a point counts as covered. More is smoother, with more surfels to trace and gather",
        ),
        field: Field::Number(|s| s.coverage, |s, value| s.coverage = value),
    },
    Row {
        setting: number(
            "rays",
            "Rays",
            "rays a pixel",
            0.5,
            [0.01, 16.0],
            "rays of an update for each pixel. With more, fewer frames are needed, each of which takes longer",
        ),
        field: Field::Number(|s| s.rays_per_pixel, |s, value| s.rays_per_pixel = value),
    },
    Row {
        setting: number(
            "target",
            "Target error",
            "",
            0.003,
            [0.0, 0.1],
            "tone-mapped standard error at which a surfel gets no more rays, 0 for never. Less is more exact and traces longer",
        ),
        field: Field::Number(|s| s.target_error, |s, value| s.target_error = value),
    },
    Row {
        setting: number(
            "guiding",
            "Guided share",
            "",
            0.0,
            [0.0, 0.9],
            "share of rays sent where light came from. Helps where it comes from few directions; gives up the even sequence \
             of directions",
        ),
        field: Field::Number(|s| s.guided_share, |s, value| s.guided_share = value),
    },
    Row {
        setting: switch(
            "depth",
            "Radial depth",
            true,
            "on: surfels do not light what a wall hides from them. Costs a few percent of the frame",
        ),
        field: Field::Switch(|s| s.respects_depth, |s, value| s.respects_depth = value),
    },
    Row {
        setting: choice(
            "reconstruction",
            "Reconstruction",
            "poisson",
            &RECONSTRUCTIONS,
            "how light is made of what surfels measured. none: each shows its own mean; regression: blended with its \
             neighbours'; poisson: by differences measured to neighbours; image: by differences between pixels, to compare",
        ),
        field: Field::Choice(
            |s| index_of(&Reconstruction::ALL, &s.reconstruction),
            |s, index| s.reconstruction = Reconstruction::ALL[index].1,
        ),
    },
    Row {
        setting: choice(
            "image",
            "Image scheme",
            "weighed",
            &SCHEMES,
            "with reconstruction in the image. weighed: differences by normalised weights, none across folds and steps, each \
             as far as it is believed; masked: believed alike; unmasked: across folds and steps too; summed: slopes of all \
             overlapping surfels added up, as published; unscreened: and values all but left out. All but the first to compare",
        ),
        field: Field::Choice(|s| index_of(&ImageScheme::ALL, &s.image), |s, index| s.image = ImageScheme::ALL[index].1),
    },
    Row {
        setting: switch(
            "sharing",
            "Sharing",
            true,
            "on: without reconstruction, young surfels borrow from neighbours. Less noise in the first frames, for a pass \
             over the surfels",
        ),
        field: Field::Switch(|s| s.shares, |s, value| s.shares = value),
    },
    Row {
        setting: switch(
            "multiscale",
            "Multiscale estimator",
            false,
            "on: the multiscale mean estimator instead of the exact mean, to compare",
        ),
        field: Field::Switch(
            |s| s.estimator == Estimator::Multiscale,
            |s, is_on| s.estimator = if is_on { Estimator::Multiscale } else { Estimator::RunningMean },
        ),
    },
    Row {
        setting: switch(
            "feedback",
            "Feedback",
            true,
            "on: rays end in the cache where it can be trusted. off: every path is traced to its end, which is slower and \
             feeds no error back",
        ),
        field: Field::Switch(|s| s.feeds_back, |s, value| s.feeds_back = value),
    },
    Row {
        setting: choice(
            "grid",
            "Grid",
            "cascades",
            &GRIDS,
            "how surfels are found. cascades: cells of every size, for any number of cameras; trapezoidal: a grid around the \
             first camera, to compare",
        ),
        field: Field::Choice(|s| index_of(&Grid::ALL, &s.grid), |s, index| s.grid = Grid::ALL[index].1),
    },
    Row {
        setting: switch(
            "binning",
            "Ray binning",
            false,
            "on: rays are sorted by place and direction before they are traced. The same image; pays where memory is slower \
             than sorting",
        ),
        field: Field::Switch(|s| s.bins_rays, |s, value| s.bins_rays = value),
    },
    Row {
        setting: choice(
            "initial",
            "First surfels",
            "gaps",
            &INITIALS,
            "gaps: where the image has gaps; fibonacci: on a Fibonacci sphere around the camera; hilbert: along a Hilbert \
             curve over it, which keeps neighbours together in memory",
        ),
        field: Field::Choice(|s| index_of(&Initial::ALL, &s.initial), |s, index| s.initial = Initial::ALL[index].1),
    },
    Row {
        setting: switch(
            "pin",
            "Pinning",
            false,
            "on: surfels that this image sees are never evicted while it is there, wherever it turns. Fills the cache for \
             others",
        ),
        field: Field::Switch(|s| s.pins, |s, value| s.pins = value),
    },
    Row {
        setting: choice(
            "apply",
            "Lookup",
            "gather",
            &APPLIES,
            "gather: pixels look surfels up. boxes: surfels are drawn as boxes, for about the same image. quads: as squares, \
             for less than boxes, missing some light at grazing angles",
        ),
        field: Field::Choice(|s| index_of(&Apply::ALL, &s.apply), |s, index| s.apply = Apply::ALL[index].1),
    },
    Row {
        setting: switch(
            "reuse",
            "Direct light reuse",
            true,
            "on: while the camera moves, direct light of the frame before is used again. Less noise, shadows a little softer \
             until it rests; 96 bytes a pixel more",
        ),
        field: Field::Switch(|s| s.reuses_direct, |s, value| s.reuses_direct = value),
    },
    Row {
        setting: switch(
            "filter",
            "Direct light filter",
            true,
            "on: direct light is filtered over neighbouring pixels, as far as it is noise. Less noise in the first frames, \
             for a few percent of them; 56 bytes a pixel more",
        ),
        field: Field::Switch(|s| s.filters_direct, |s, value| s.filters_direct = value),
    },
    Row {
        setting: switch(
            "settling",
            "Settling",
            true,
            "on: an image at rest converges to the path-traced one, by samples of its own once the cache gains less. off: it \
             stays with the cache, a little off; 32 bytes a pixel less",
        ),
        field: Field::Switch(|s| s.settles, |s, value| s.settles = value),
    },
];
