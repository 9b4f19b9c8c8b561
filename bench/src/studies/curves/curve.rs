//! Error over cost of one way to render one image.

use serde::{Deserialize, Serialize};
use surfelcast_measure::fit::{Reached, cost_to_error};

use crate::report::{Measured, Origin, Table};
use crate::studies::curves::variant::{Start, Variant};

/// What a curve is of.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Key {
    /// `<scene>_<camera>_<mode>`.
    pub(crate) case: String,
    pub(crate) scene_id: String,
    pub(crate) size: [u32; 2],
    pub(crate) variant: Variant,
    /// What it is compared with.
    pub(crate) truth: String,
    pub(crate) replicates: u32,
    pub(crate) seed: u64,
    /// Samples per pixel at which a replicate ends, and milliseconds of rendering.
    pub(crate) samples: u32,
    pub(crate) time_limit_ms: u64,
}

/// Error over cost of one way to render one image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Curve {
    pub(crate) key: Key,
    pub(crate) origin: Origin,
    /// Tone-mapped RMSE left in the truth.
    pub(crate) truth_noise: f64,
    /// Device bytes while it ran: scene, session, view.
    pub(crate) memory_bytes: [u64; 3],
    /// By rising samples.
    pub(crate) points: Vec<Point>,
}

/// One budget. Means over replicates, of squares for errors; `None` where it is unknown.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Point {
    pub(crate) samples: u32,
    /// Wall time of rendering.
    pub(crate) secs: f64,
    pub(crate) secs_std_error: Option<f64>,
    /// Time of passes as measured on the device.
    pub(crate) gpu_secs: f64,
    /// Its share of reconstruction over the neighbours of surfels.
    #[serde(default)]
    pub(crate) reconstruction_gpu_secs: f64,
    pub(crate) rays_primary: f64,
    pub(crate) rays_secondary: f64,
    pub(crate) rays_shadow: f64,
    /// Tone-mapped, including the noise of the truth.
    pub(crate) rmse: f64,
    pub(crate) rmse_std_error: Option<f64>,
    /// The same without the noise of the truth.
    pub(crate) error: f64,
    pub(crate) relative_mse: f64,
    pub(crate) flip: f64,
    pub(crate) bias_squared: Option<f64>,
    pub(crate) bias_squared_std_error: Option<f64>,
    pub(crate) variance: Option<f64>,
    pub(crate) variance_std_error: Option<f64>,
    /// Mean of the image over that of the truth, minus one.
    pub(crate) mean_bias: f64,
    /// The renderer's own estimate of its error.
    pub(crate) audited_rmse: Option<f64>,
    pub(crate) audited_std_error: Option<f64>,
    pub(crate) surfels: Option<f64>,
    pub(crate) non_finite: u64,
}

impl Point {
    pub(crate) fn rays(&self) -> f64 {
        self.rays_primary + self.rays_secondary + self.rays_shadow
    }
}

impl Curve {
    /// Seconds to an error.
    pub(crate) fn secs_to(&self, goal: f64) -> Option<Reached> {
        cost_to_error(&self.points.iter().map(|point| (point.secs, point.error)).collect::<Vec<_>>(), goal)
    }

    /// Error at a cost between that of the first and that of the last budget, on straight lines in logarithms.
    pub(crate) fn error_at(&self, cost: impl Fn(&Point) -> f64, at: f64) -> Option<f64> {
        self.points.windows(2).find_map(|pair| {
            let [low, high] = [cost(&pair[0]), cost(&pair[1])];
            let share = if high > low { (at / low).ln() / (high / low).ln() } else { 0.0 };
            let is_between = low > 0.0 && (low..=high).contains(&at) && pair[0].error > 0.0 && pair[1].error > 0.0;
            is_between.then(|| pair[0].error.powf(1.0 - share) * pair[1].error.powf(share))
        })
    }

    /// Rays of all kinds to an error.
    pub(crate) fn rays_to(&self, goal: f64) -> Option<Reached> {
        cost_to_error(&self.points.iter().map(|point| (point.rays(), point.error)).collect::<Vec<_>>(), goal)
    }
}

/// Columns of a curve's own values and of its points.
const COLUMNS: [&str; 39] = [
    "case",
    "width",
    "height",
    "technique",
    "reconstruction",
    "preset",
    "settings",
    "start",
    "truth",
    "truth_noise",
    "replicates",
    "seed",
    "commit",
    "device",
    "scene_bytes",
    "session_bytes",
    "view_bytes",
    "samples",
    "non_finite",
    "secs",
    "secs_std_error",
    "gpu_secs",
    "reconstruction_gpu_secs",
    "rays_primary",
    "rays_secondary",
    "rays_shadow",
    "rmse",
    "rmse_std_error",
    "error",
    "relative_mse",
    "flip",
    "bias_squared",
    "bias_squared_std_error",
    "variance",
    "variance_std_error",
    "mean_bias",
    "audited_rmse",
    "audited_std_error",
    "surfels",
];

impl Measured for Curve {
    type Key = Key;

    fn key(&self) -> &Key {
        &self.key
    }

    fn origin(&self) -> &Origin {
        &self.origin
    }

    /// One row a point.
    fn table(curves: &[Self]) -> Table {
        let mut table = Table::new(COLUMNS);
        for curve in curves {
            for point in &curve.points {
                table.push(curve.cells().into_iter().chain(point.cells()));
            }
        }
        table
    }
}

impl Curve {
    fn cells(&self) -> Vec<String> {
        let Self { key, origin, truth_noise, memory_bytes, .. } = self;
        let variant = &key.variant;
        let mut cells = vec![
            key.case.clone(),
            key.size[0].to_string(),
            key.size[1].to_string(),
            variant.technique.clone(),
            variant.reconstruction.clone().unwrap_or_default(),
            variant.preset.clone().unwrap_or_default(),
            variant.settings.join(" "),
            if variant.start == Start::Warm { "warm" } else { "empty" }.to_owned(),
            key.truth.clone(),
            truth_noise.to_string(),
            key.replicates.to_string(),
            key.seed.to_string(),
            origin.commit.clone(),
            origin.device.clone(),
        ];
        cells.extend(memory_bytes.map(|bytes| bytes.to_string()));
        cells
    }
}

impl Point {
    fn cells(&self) -> Vec<String> {
        let numbers = [
            Some(self.secs),
            self.secs_std_error,
            Some(self.gpu_secs),
            Some(self.reconstruction_gpu_secs),
            Some(self.rays_primary),
            Some(self.rays_secondary),
            Some(self.rays_shadow),
            Some(self.rmse),
            self.rmse_std_error,
            Some(self.error),
            Some(self.relative_mse),
            Some(self.flip),
            self.bias_squared,
            self.bias_squared_std_error,
            self.variance,
            self.variance_std_error,
            Some(self.mean_bias),
            self.audited_rmse,
            self.audited_std_error,
            self.surfels,
        ]
        .map(|value| value.map(|value| format!("{value:.6e}")).unwrap_or_default());
        [self.samples.to_string(), self.non_finite.to_string()].into_iter().chain(numbers).collect()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::report::Record;
    use surfelcast::Failure;

    /// A curve of a technique with error 0.1 / sqrt(samples) at `secs` a sample.
    pub(crate) fn curve(case: &str, technique: &str, secs: f64) -> Curve {
        let point = |samples: u32| Point {
            samples,
            secs: secs * f64::from(samples),
            error: 0.1 / f64::from(samples).sqrt(),
            rmse: 0.1 / f64::from(samples).sqrt(),
            rays_primary: 100.0 * f64::from(samples),
            ..Point::default()
        };
        let variant = Variant {
            technique: technique.to_owned(),
            reconstruction: None,
            preset: None,
            settings: Vec::new(),
            start: Start::Empty,
        };
        let key = Key {
            case: case.to_owned(),
            scene_id: "sha256:0".to_owned(),
            size: [4, 4],
            variant,
            truth: "path, 4096 samples".to_owned(),
            replicates: 2,
            seed: 1,
            samples: 64,
            time_limit_ms: 10_000,
        };
        let origin = Origin { commit: "c77d3d0 of 2026-11-27".to_owned(), device: "a device".to_owned() };
        Curve { key, origin, truth_noise: 0.0, memory_bytes: [1, 2, 3], points: [1, 4, 16, 64].map(point).to_vec() }
    }

    #[test]
    fn a_record_is_found_again_and_fits_its_columns() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deeper/error.json");
        let mut record = Record::open(&path, false).unwrap();
        let curve = curve("scene_main_lambert", "path", 0.5);
        assert!(record.find(&curve.key, &curve.origin).is_none());
        record.add(curve.clone()).unwrap();
        let again = Record::open(&path, false).unwrap();
        assert_eq!(again.find(&curve.key, &curve.origin), Some(&curve));
        let other = Key { replicates: 3, ..curve.key.clone() };
        assert_eq!(again.find(&other, &curve.origin), None);

        // A number of another commit is not taken for one of this, unless that is requested.
        let newer = Origin { commit: "d88e4e1 of 2026-11-28".to_owned(), ..curve.origin.clone() };
        assert_eq!(again.find(&curve.key, &newer), None);
        assert_eq!(Record::open(&path, true).unwrap().find(&curve.key, &newer), Some(&curve));

        let text = std::fs::read_to_string(path.with_extension("csv")).unwrap();
        assert_eq!(text.lines().count(), 5);
        for line in text.lines().skip(1) {
            // The one field with a comma is quoted.
            assert_eq!(line.split(',').count(), COLUMNS.len() + 1, "{line}");
        }
        std::fs::write(&path, "[1]").unwrap();
        assert!(matches!(Record::<Curve>::open(&path, false), Err(Failure::Input(_))));
    }

    #[test]
    fn errors_at_a_cost_are_read_off_a_curve() {
        let curve = curve("scene_main_lambert", "path", 0.5);
        let error = curve.error_at(|point| point.secs, 4.0).unwrap();
        assert!((error - 0.1 / 8_f64.sqrt()).abs() < 1e-9, "{error}");
        assert_eq!(curve.error_at(|point| point.secs, 0.4), None);
        assert_eq!(curve.error_at(|point| point.secs, 33.0), None);
        assert!(curve.error_at(Point::rays, 6400.0).is_some());
    }

    #[test]
    fn times_to_errors_are_read_off_a_curve() {
        let curve = curve("scene_main_lambert", "path", 0.5);
        // 0.1 / sqrt(n) = 0.05 / sqrt(2) at n = 8.
        let Some(Reached::At(secs)) = curve.secs_to(0.05 / 2_f64.sqrt()) else { panic!("it lies between") };
        assert!((secs - 4.0).abs() < 1e-9, "{secs}");
        assert_eq!(curve.rays_to(0.2), Some(Reached::Below(100.0)));
    }
}
