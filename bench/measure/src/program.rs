//! Renders a reference's image with the finished program, from outside, and measures it.
//!
//! A reference has noise of its own, and so has an image; a correct renderer differs from the reference by both,
//! added in squares. The first is stated next to the reference, the second is measured from two images of different
//! seeds. So a gate needs no tuned threshold: measured² / (reference noise² + own noise²) is 1 for a correct
//! renderer.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::fit::exponent;
use crate::{Image, MeasureError, Mode, Reference};

/// The program under test.
#[derive(Clone, Debug)]
pub struct Renderer {
    program: PathBuf,
    /// Technique id.
    pub technique: String,
    /// More words for the command line.
    pub arguments: Vec<String>,
}

/// What was measured at one number of samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Samples a pixel.
    pub samples: u32,
    /// Tone-mapped RMSE against the reference, the mean over two seeds in squares.
    pub rmse: f64,
    /// Noise of one image, from two seeds.
    pub own_noise: f64,
    /// The program's own audited error, the mean over two seeds in squares; 0 if there is none.
    pub audited_rmse: f64,
    /// Mean of the image over that of the reference, minus one.
    pub bias: f64,
    /// The same difference in standard errors.
    pub bias_in_errors: f64,
    /// Largest relative distance of the mean from an analytic colour; 0 without one.
    pub analytic_error: f64,
    /// Values that were not finite.
    pub non_finite: usize,
    /// Seconds of rendering, both seeds.
    pub render_secs: f64,
    /// Rays of all kinds of one image.
    pub rays: f64,
    /// Surfels in use at the end; 0 for techniques without surfels.
    pub surfels: u64,
}

/// Everything measured for one reference.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// The reference.
    pub name: String,
    /// Noise of the reference.
    pub reference_noise: f64,
    /// By rising number of samples.
    pub points: Vec<Point>,
}

impl Point {
    /// Measured over expected error, in squares; 1 for a correct renderer, up to chance.
    pub fn ratio(&self, reference_noise: f64) -> f64 {
        self.rmse.powi(2) / (reference_noise.powi(2) + self.own_noise.powi(2))
    }

    /// RMSE against the truth: the reference's own noise taken out.
    pub fn rmse_to_truth(&self, reference_noise: f64) -> f64 {
        (self.rmse.powi(2) - reference_noise.powi(2)).max(0.0).sqrt()
    }
}

impl Measurement {
    /// Slope of log error over log samples, the reference's noise taken out; `None` with less than two
    /// points that stand clear of that noise.
    pub fn slope(&self) -> Option<f64> {
        let points: Vec<_> = self
            .points
            .iter()
            .filter(|point| point.rmse > 1.2 * self.reference_noise)
            .map(|point| (f64::from(point.samples), point.rmse_to_truth(self.reference_noise)))
            .collect();
        exponent(&points)
    }
}

impl Renderer {
    /// The program that `SURFELCAST_BIN` names, else the one that cargo built next to the running test or command.
    pub fn find(technique: &str) -> Result<Self, MeasureError> {
        let program = if let Some(path) = std::env::var_os("SURFELCAST_BIN") {
            PathBuf::from(path)
        } else {
            let exe = std::env::current_exe()
                .map_err(|error| MeasureError::Program(format!("this program's own path is unknown: {error}")))?;
            let folder = exe.parent().unwrap_or(Path::new("."));
            // Tests lie one folder deeper than programs.
            let folder = if folder.ends_with("deps") { folder.parent().unwrap_or(folder) } else { folder };
            folder.join(format!("surfelcast{}", std::env::consts::EXE_SUFFIX))
        };
        if !program.is_file() {
            let program = program.display();
            let reason = format!("{program} does not exist: run `cargo build --release -p surfelcast` first");
            return Err(MeasureError::Program(reason));
        }
        Ok(Self { program, technique: technique.to_owned(), arguments: Vec::new() })
    }

    /// Renders a reference's image; returns it and the rays of all kinds that it took.
    pub fn image(&self, reference: &Reference, samples: u32, seed: u64) -> Result<(Image, f64), MeasureError> {
        let folder = temporary_folder()?;
        let (image, stats) = self.render(reference, samples, seed, folder.path())?;
        Ok((image, rays_of(&stats)))
    }

    fn render(
        &self,
        reference: &Reference,
        samples: u32,
        seed: u64,
        folder: &Path,
    ) -> Result<(Image, Value), MeasureError> {
        let (file, stats) = (folder.join("image.exr"), folder.join("stats.json"));
        let [width, height] = reference.size;
        let mut command = Command::new(&self.program);
        command.arg("render").arg(&reference.scene).arg("-o").arg(&file).arg("--stats").arg(&stats);
        command.args(["--camera", &reference.camera, "--technique", &self.technique]);
        command.args(["--size", &format!("{width}x{height}")]);
        command.args(["--spp", &samples.to_string(), "--seed", &seed.to_string()]);
        command.args(["--materials", if reference.mode == Mode::Pbr { "pbr" } else { "lambert" }]);
        command.args(&self.arguments);
        if reference.mode == Mode::Indirect {
            command.args(["--aov", "irradiance"]);
        }
        let output = command
            .output()
            .map_err(|error| MeasureError::Program(format!("{} cannot be run: {error}", self.program.display())))?;
        if !output.status.success() {
            let message = String::from_utf8_lossy(&output.stderr);
            let reason = format!("{command:?} ended with {}: {}", output.status, message.trim());
            return Err(MeasureError::Program(reason));
        }
        let image = Image::read_exr(&file)?;
        let [image_width, image_height] = image.size;
        if [image_width, image_height] != [width as usize, height as usize] {
            return Err(MeasureError::Program(format!(
                "the image is {image_width} x {image_height}; {width} x {height} were requested"
            )));
        }
        let text = std::fs::read_to_string(&stats).map_err(|error| MeasureError::file(&stats, &error))?;
        let stats = serde_json::from_str(&text).map_err(|error| MeasureError::file(&stats, &error))?;
        Ok((image, stats))
    }

    /// Renders with two seeds and compares.
    pub fn measure(&self, reference: &Reference, samples: u32) -> Result<Point, MeasureError> {
        let folder = temporary_folder()?;
        let truth = Image::read_exr(&reference.image)?;
        let (first, first_stats) = self.render(reference, samples, 1, folder.path())?;
        let (second, second_stats) = self.render(reference, samples, 2, folder.path())?;
        let non_finite = first.non_finite_count() + second.non_finite_count();
        let analytic_error = analytic_error(&reference.expected.colors, &truth, &first, &second);

        let [truth, first, second] = [truth, first, second].map(|image| image.without(&reference.masked));
        let exposure = reference.exposure;
        let mse = f64::midpoint(first.tone_mapped_mse(&truth, exposure), second.tone_mapped_mse(&truth, exposure));
        let audited = |stats: &Value| stats["error_estimate"]["mse_tonemapped"].as_f64().unwrap_or(0.0);
        let seconds = |stats: &Value| stats["time_secs"]["render"].as_f64().unwrap_or(0.0);

        // Noise of the reference's mean: its channels are almost fully correlated, so they count as one value a pixel.
        let reference_variance = reference.noise_rmse_linear.powi(2) / truth.pixels.len() as f64;
        let difference = f64::midpoint(first.mean(), second.mean()) - truth.mean();
        let error = (first.variance_of_mean(&second) + reference_variance).sqrt();
        Ok(Point {
            samples,
            rmse: mse.sqrt(),
            own_noise: (first.tone_mapped_mse(&second, exposure) / 2.0).sqrt(),
            audited_rmse: f64::midpoint(audited(&first_stats), audited(&second_stats)).max(0.0).sqrt(),
            bias: difference / truth.mean().max(1e-30),
            bias_in_errors: if error > 0.0 { difference / error } else { 0.0 },
            analytic_error,
            non_finite,
            render_secs: seconds(&first_stats) + seconds(&second_stats),
            rays: f64::midpoint(rays_of(&first_stats), rays_of(&second_stats)),
            surfels: first_stats["surfels"]["live"].as_u64().unwrap_or(0),
        })
    }
}

/// Tone-mapped RMSE of an image without what the reference masks, and without the truth's mean square noise.
pub fn error_to_truth(reference: &Reference, image: &Image, truth: &Image, noise_mse: f64) -> f64 {
    let [image, truth] = [image, truth].map(|image| image.without(&reference.masked));
    (image.tone_mapped_mse(&truth, reference.exposure) - noise_mse).max(0.0).sqrt()
}

fn temporary_folder() -> Result<tempfile::TempDir, MeasureError> {
    tempfile::tempdir().map_err(|error| MeasureError::file(&std::env::temp_dir(), &error))
}

fn rays_of(stats: &Value) -> f64 {
    ["primary", "secondary", "shadow"].iter().filter_map(|kind| stats["rays"][kind].as_f64()).sum()
}

/// Largest relative distance of a mean from the colour it must have. A pixel belongs to a colour when its reference is
/// within 2 % of it, so that pixels on an outline belong to none.
fn analytic_error(colors: &[[f64; 3]], truth: &Image, first: &Image, second: &Image) -> f64 {
    let mut largest: f64 = 0.0;
    for color in colors {
        let belongs =
            |pixel: &[f64; 3]| pixel.iter().zip(color).all(|(value, color)| (value - color).abs() <= 0.02 * color);
        let mut count = 0;
        let mut sum = [0.0; 3];
        for ((_, first), second) in
            truth.pixels.iter().zip(&first.pixels).zip(&second.pixels).filter(|((truth, _), _)| belongs(truth))
        {
            count += 1;
            for (sum, (first, second)) in sum.iter_mut().zip(first.iter().zip(second)) {
                *sum += f64::midpoint(*first, *second);
            }
        }
        for (sum, color) in sum.iter().zip(color).filter(|_| count > 0) {
            largest = largest.max((sum / f64::from(count) / color - 1.0).abs());
        }
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(samples: u32, rmse: f64) -> Point {
        Point {
            samples,
            rmse,
            own_noise: 0.0,
            audited_rmse: 0.0,
            bias: 0.0,
            bias_in_errors: 0.0,
            analytic_error: 0.0,
            non_finite: 0,
            render_secs: 0.0,
            rays: 0.0,
            surfels: 0,
        }
    }

    #[test]
    fn slope_ignores_the_references_noise() {
        let noise: f64 = 0.001;
        let at = |samples: u32| point(samples, (0.01_f64.powi(2) * 16.0 / f64::from(samples) + noise.powi(2)).sqrt());
        let measurement =
            Measurement { name: String::new(), reference_noise: noise, points: vec![at(16), at(64), at(256)] };
        let slope = measurement.slope().expect("three points");
        assert!((slope + 0.5).abs() < 1e-9, "{slope}");
        let flat = Measurement { points: vec![point(16, 0.001), point(64, 0.001)], ..measurement };
        assert_eq!(flat.slope(), None);
    }

    #[test]
    fn analytic_colors_are_compared_where_they_hold() {
        let image = |values: [f64; 3]| Image { size: [3, 1], pixels: values.map(|value| [value; 3]).to_vec() };
        let truth = image([0.8, 0.9, 1.0]);
        let (first, second) = (image([0.81, 5.0, 1.0]), image([0.79, 7.0, 1.004]));
        let error = analytic_error(&[[0.8; 3], [1.0; 3]], &truth, &first, &second);
        assert!((error - 0.002).abs() < 1e-9, "{error}");
    }
}
