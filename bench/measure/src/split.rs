//! An error split into the part that more samples would remove and the part that would stay.
//!
//! R images that differ by their seed alone have a mean square error of bias² + variance, after the tone map and over
//! pixels. The variance is that between the images; what is left of the error is bias. The truth has noise of its own,
//! which adds to the measured error and looks like bias; its known variance is subtracted.

use crate::Image;

/// A number with its standard error, NaN if unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Uncertain {
    /// Estimate.
    pub value: f64,
    /// Its standard error.
    pub std_error: f64,
}

/// Tone-mapped error of a way to render at one budget.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorSplit {
    /// Root mean square error as measured, the truth's noise included: root of the mean over images.
    pub rmse: Uncertain,
    /// Squared bias, without the noise of the truth. An unbiased estimate, so it may come out below zero.
    pub bias_squared: Uncertain,
    /// Variance of one image.
    pub variance: Uncertain,
}

/// Splits the error of images of different seeds. `truth_noise` is the tone-mapped RMSE left in the truth.
///
/// Standard errors are over the images: of the mean for the error, and by jackknife for the parts, which takes three
/// images. With fewer than two images bias and variance are NaN.
pub fn split_error(images: &[Image], truth: &Image, exposure: f64, truth_noise: f64) -> ErrorSplit {
    let mapped: Vec<_> = images.iter().map(|image| image.tone_mapped(exposure)).collect();
    let truth = truth.tone_mapped(exposure);
    let errors: Vec<f64> = mapped.iter().map(|image| image.mse(&truth)).collect();
    let distances: Vec<Vec<f64>> =
        mapped.iter().enumerate().map(|(i, one)| mapped[..i].iter().map(|other| one.mse(other)).collect()).collect();

    // The variance of one image is half the mean squared difference of two.
    let parts = |left_out: Option<usize>| {
        let is_in = |i: usize| Some(i) != left_out;
        let kept = |count: usize| (0..count).filter(|&i| is_in(i));
        let error = mean(&kept(errors.len()).map(|i| errors[i]).collect::<Vec<_>>());
        let pairs: Vec<f64> =
            kept(distances.len()).flat_map(|i| kept(i).map(move |j| (i, j))).map(|(i, j)| distances[i][j]).collect();
        let variance = mean(&pairs) / 2.0;
        [error - variance - truth_noise.powi(2), variance]
    };
    let [bias_squared, variance] = parts(None);
    let jackknife = |part: usize| {
        let count = images.len() as f64;
        let values: Vec<f64> = (0..images.len()).map(|i| parts(Some(i))[part]).collect();
        let middle = mean(&values);
        ((count - 1.0) / count * values.iter().map(|value| (value - middle).powi(2)).sum::<f64>()).sqrt()
    };
    let mean_square = mean(&errors);
    let spread = errors.iter().map(|error| (error - mean_square).powi(2)).sum::<f64>();
    let count = errors.len() as f64;
    let std_error_of_square = (spread / (count - 1.0) / count).sqrt();
    let rmse = mean_square.sqrt();
    ErrorSplit {
        rmse: Uncertain { value: rmse, std_error: std_error_of_square / (2.0 * rmse) },
        bias_squared: Uncertain { value: bias_squared, std_error: jackknife(0) },
        variance: Uncertain { value: variance, std_error: jackknife(1) },
    }
}

/// NaN for no value.
fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pictures of radiance around `level` with even noise in ±`spread`, channels alike.
    fn noisy(seed: u64, count: usize, level: f64, spread: f64) -> Image {
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 * 2.0 - 1.0
        };
        let pixels = (0..count).map(|_| [level + spread * noise(); 3]).collect();
        Image { size: [count, 1], pixels }
    }

    #[test]
    fn bias_and_variance_of_known_images() {
        // The tone map is x / (1 + x), with slope 1 / (1 + x)².
        let (level, spread) = (1.02, 0.04);
        let truth = noisy(99, 20_000, 0.98, spread);
        let images: Vec<_> = (0..4).map(|seed| noisy(seed, 20_000, level, spread)).collect();
        let noise = |level: f64| spread / 3.0_f64.sqrt() / (1.0 + level).powi(2);
        let bias: f64 = 1.02 / 2.02 - 0.98 / 1.98;
        let split = split_error(&images, &truth, 1.0, noise(0.98));
        assert!((split.variance.value / noise(level).powi(2) - 1.0).abs() < 0.02, "{split:?}");
        assert!((split.bias_squared.value / bias.powi(2) - 1.0).abs() < 0.03, "{split:?}");
        let expected = (bias.powi(2) + noise(level).powi(2) + noise(0.98).powi(2)).sqrt();
        assert!((split.rmse.value / expected - 1.0).abs() < 0.01, "{split:?}");
        for part in [split.rmse, split.bias_squared, split.variance] {
            assert!(part.std_error > 0.0 && part.std_error < 0.05 * part.value, "{split:?}");
        }
    }

    #[test]
    fn one_image_has_an_error_but_no_split() {
        let split = split_error(&[noisy(1, 10, 2.0, 0.0)], &noisy(2, 10, 1.0, 0.0), 1.0, 0.0);
        assert!((split.rmse.value - 1.0 / 6.0).abs() < 1e-12);
        assert!(split.variance.value.is_nan() && split.bias_squared.value.is_nan() && split.rmse.std_error.is_nan());
    }
}
