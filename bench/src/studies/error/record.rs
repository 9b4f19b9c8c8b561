//! What was measured, as JSON that a later run goes on from, and as CSV.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use surfelcast_measure::fit::{Reached, cost_to_error};

use crate::report::{read_record, write_record};
use crate::studies::error::variant::{Start, Variant};
use surfelcast::Failure;

/// What a curve is of: equal keys need not be measured twice.
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
    /// Samples a pixel at which a replicate ends, and milliseconds of rendering.
    pub(crate) samples: u32,
    pub(crate) time_limit_ms: u64,
    /// Adapter and version of the program.
    pub(crate) device: String,
    pub(crate) version: String,
}

/// Error over cost of one way to render one picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Curve {
    pub(crate) key: Key,
    /// Tone-mapped RMSE left in the truth.
    pub(crate) truth_noise: f64,
    /// Device bytes while it ran: scene, session, view.
    pub(crate) memory_bytes: [u64; 3],
    /// By rising samples.
    pub(crate) points: Vec<Point>,
}

/// One budget. Means over replicates, squares for errors; `None` where it cannot be told.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Point {
    pub(crate) samples: u32,
    /// Wall time of rendering.
    pub(crate) secs: f64,
    pub(crate) secs_std_error: Option<f64>,
    /// Time of passes as the device counts it.
    pub(crate) gpu_secs: f64,
    /// What of it is reconstruction on the graph of surfels.
    #[serde(default)]
    pub(crate) reconstruction_gpu_secs: f64,
    pub(crate) rays_primary: f64,
    pub(crate) rays_secondary: f64,
    pub(crate) rays_shadow: f64,
    /// Tone-mapped, the truth's noise included.
    pub(crate) rmse: f64,
    pub(crate) rmse_std_error: Option<f64>,
    /// The same without the truth's noise.
    pub(crate) error: f64,
    pub(crate) relative_mse: f64,
    pub(crate) flip: f64,
    pub(crate) bias_squared: Option<f64>,
    pub(crate) bias_squared_std_error: Option<f64>,
    pub(crate) variance: Option<f64>,
    pub(crate) variance_std_error: Option<f64>,
    /// Mean of the picture over that of the truth, minus one.
    pub(crate) mean_bias: f64,
    /// The renderer's own word on its error.
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

/// The curves of an output folder.
pub(crate) struct Record {
    path: PathBuf,
    pub(crate) curves: Vec<Curve>,
}

impl Record {
    /// Reads what an earlier run left; an empty record where there is none.
    pub(crate) fn open(path: &Path) -> Result<Self, Failure> {
        let curves = read_record(path)?;
        Ok(Self { path: path.to_owned(), curves })
    }

    pub(crate) fn find(&self, key: &Key) -> Option<&Curve> {
        self.curves.iter().find(|curve| curve.key == *key)
    }

    /// Adds a curve and writes everything down.
    pub(crate) fn add(&mut self, curve: Curve) -> Result<(), Failure> {
        self.curves.push(curve);
        write_record(&self.path, &self.curves, &csv(&self.curves))
    }
}

const COLUMNS: &str = "case,width,height,technique,reconstruction,preset,knobs,start,truth,truth_noise,replicates,seed,device,\
version,samples,secs,secs_std_error,gpu_secs,reconstruction_gpu_secs,rays_primary,rays_secondary,rays_shadow,rmse,rmse_std_error,error,relative_mse,\
flip,bias_squared,bias_squared_std_error,variance,variance_std_error,mean_bias,audited_rmse,audited_std_error,surfels,\
non_finite,scene_bytes,session_bytes,view_bytes";

/// One row a point.
pub(crate) fn csv(curves: &[Curve]) -> String {
    let mut text = format!("{COLUMNS}\n");
    let number = |value: Option<f64>| value.map(|value| format!("{value:.6e}")).unwrap_or_default();
    for Curve { key, truth_noise, memory_bytes: [scene, session, view], points } in curves {
        let variant = &key.variant;
        let start = if variant.start == Start::Warm { "warm" } else { "empty" };
        let head = [
            key.case.clone(),
            key.size[0].to_string(),
            key.size[1].to_string(),
            variant.technique.clone(),
            variant.reconstruction.clone().unwrap_or_default(),
            variant.preset.clone().unwrap_or_default(),
            variant.knobs.join(" "),
            start.to_owned(),
            key.truth.clone(),
            truth_noise.to_string(),
            key.replicates.to_string(),
            key.seed.to_string(),
            key.device.clone(),
            key.version.clone(),
        ]
        .map(|field| quoted(&field))
        .join(",");
        for p in points {
            let values = [
                Some(p.secs),
                p.secs_std_error,
                Some(p.gpu_secs),
                Some(p.reconstruction_gpu_secs),
                Some(p.rays_primary),
                Some(p.rays_secondary),
                Some(p.rays_shadow),
                Some(p.rmse),
                p.rmse_std_error,
                Some(p.error),
                Some(p.relative_mse),
                Some(p.flip),
                p.bias_squared,
                p.bias_squared_std_error,
                p.variance,
                p.variance_std_error,
                Some(p.mean_bias),
                p.audited_rmse,
                p.audited_std_error,
                p.surfels,
            ]
            .map(number)
            .join(",");
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{head},{},{values},{},{scene},{session},{view}", p.samples, p.non_finite);
        }
    }
    text
}

/// A field of a CSV file (RFC 4180).
fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n']) { format!("\"{}\"", field.replace('"', "\"\"")) } else { field.to_owned() }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

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
            knobs: Vec::new(),
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
            device: "a device".to_owned(),
            version: "0".to_owned(),
        };
        Curve { key, truth_noise: 0.0, memory_bytes: [1, 2, 3], points: [1, 4, 16, 64].map(point).to_vec() }
    }

    #[test]
    fn a_record_is_found_again_and_fits_its_columns() {
        let folder = std::env::temp_dir().join(format!("surfelcast-record-{}", std::process::id()));
        let path = folder.join("error.json");
        let mut record = Record::open(&path).unwrap();
        assert!(record.curves.is_empty());
        let curve = curve("scene_main_lambert", "path", 0.5);
        record.add(curve.clone()).unwrap();
        let again = Record::open(&path).unwrap();
        assert_eq!(again.find(&curve.key), Some(&curve));
        let other = Key { replicates: 3, ..curve.key.clone() };
        assert_eq!(again.find(&other), None);
        let text = std::fs::read_to_string(path.with_extension("csv")).unwrap();
        let columns = COLUMNS.split(',').count();
        for line in text.lines().skip(1) {
            // The one field with a comma is quoted.
            assert_eq!(line.split(',').count(), columns + 1, "{line}");
        }
        assert_eq!(text.lines().count(), 5);
        std::fs::write(&path, "[1]").unwrap();
        assert!(matches!(Record::open(&path), Err(Failure::Input(_))));
        std::fs::remove_dir_all(&folder).unwrap();
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
