//! The estimate of an audit: mean squared error, its standard error, and an interval.
//!
//! **The tone map is non-linear**, so the tone-mapped mean of few samples has the bias `t'' var / 2`, which is always
//! negative. An image much better than the audit's samples would seem to have the square of that bias as its error. So
//! each half consists of lanes, and a jackknife over them (Quenouille 1956) removes the first-order bias: L times the
//! tone map of the mean, minus L - 1 times the mean tone map of means without one lane. What remains falls with the
//! square of the number of samples, and enters the product squared once more.
//!
//! **All splits are used.** Which lanes form half a and which half b is arbitrary. The 15 splits of 16 streams by the
//! Walsh functions separate each pair of streams equally often, so their mean equals the mean over all pairs, and the
//! noise of a product of halves falls by half at no further ray.
//!
//! **Errors are skewed**: squares of noise, most of them small. The mean of a sample with few large ones is often too
//! low, together with its own standard error, and an interval of plain standard errors then lies below the truth too
//! often. Hall's (1992) transformation removes the skewness of the studentised mean; its inverse widens the interval
//! upwards. The fewer values dominate, the less certain is the standard error itself: Student's t replaces the normal
//! distribution, with the degrees of freedom that the kurtosis leaves (Satterthwaite 1946).

use super::AuditResult;
use super::pixels::AuditPixel;

/// Streams of samples of an audited pixel. A power of two, for the Walsh functions.
pub(super) const STREAMS: usize = 16;
/// Streams of a half.
const HALF: usize = STREAMS / 2;
/// 95th percentile of the normal distribution: a twentieth of the cases on either side of an interval.
const Z: f64 = 1.644_853_6;

/// Input of the estimate.
pub(super) struct Evidence<'a> {
    /// Audited pixels.
    pub(super) pixels: &'a [AuditPixel],
    /// Shown radiance of each audited pixel, and its predicted squared error.
    pub(super) values: &'a [[f32; 4]],
    /// Mean radiance of each stream of each pixel.
    pub(super) means: &'a [[f32; 4]],
    /// Mean of the prediction over the whole image.
    pub(super) predicted: f64,
    /// Linear factor before the tone map.
    pub(super) exposure: f32,
}

type Rgb = [f64; 3];

fn tone_map(c: Rgb, exposure: f64) -> Rgb {
    let e = c.map(|v| v * exposure);
    let scale = 1.0 / (1.0 + e[0].max(e[1]).max(e[2]).max(0.0));
    e.map(|v| v * scale)
}

fn sum(values: impl Iterator<Item = Rgb>) -> Rgb {
    values.fold([0.0; 3], |sum, value| [sum[0] + value[0], sum[1] + value[1], sum[2] + value[2]])
}

/// Tone-mapped mean of a half, without the first-order bias of the tone map.
fn tone_map_of_mean(lanes: &[Rgb; HALF], exposure: f64) -> Rgb {
    let count = HALF as f64;
    let total = sum(lanes.iter().copied());
    let whole = tone_map(total.map(|v| v / count), exposure);
    let without_one = |lane: &Rgb| tone_map([0, 1, 2].map(|i| (total[i] - lane[i]) / (count - 1.0)), exposure);
    let others = sum(lanes.iter().map(without_one));
    [0, 1, 2].map(|i| count * whole[i] - (count - 1.0) / count * others[i])
}

/// Estimates of one pixel: its squared tone-mapped error, that of its linear value, and its mean.
struct PixelEstimate {
    square: f64,
    linear_squares: Rgb,
    mean: Rgb,
}

fn estimate_pixel(shown: Rgb, streams: &[Rgb; STREAMS], exposure: f64) -> PixelEstimate {
    let tone_mapped = tone_map(shown, exposure);
    let (mut square, mut linear_squares) = (0.0, [0.0; 3]);
    for split in 1..STREAMS {
        let mut halves = [[[0.0; 3]; HALF]; 2];
        let mut filled = [0; 2];
        for (index, &stream) in streams.iter().enumerate() {
            let side = ((index & split).count_ones() % 2) as usize;
            halves[side][filled[side]] = stream;
            filled[side] += 1;
        }
        let [a, b] = halves.each_ref().map(|half| tone_map_of_mean(half, exposure));
        square += (0..3).map(|i| (tone_mapped[i] - a[i]) * (tone_mapped[i] - b[i])).sum::<f64>() / 3.0;
        let [a, b] = halves.map(|half| sum(half.into_iter()).map(|v| v / HALF as f64));
        for i in 0..3 {
            linear_squares[i] += (shown[i] - a[i]) * (shown[i] - b[i]);
        }
    }
    let splits = (STREAMS - 1) as f64;
    PixelEstimate {
        square: square / splits,
        linear_squares: linear_squares.map(|v| v / splits),
        mean: sum(streams.iter().copied()).map(|v| v / STREAMS as f64),
    }
}

/// Means over pixels, in fixed order.
pub(super) fn evaluate(evidence: &Evidence<'_>, result: &mut AuditResult) {
    let exposure = f64::from(evidence.exposure);
    let count = evidence.pixels.len().max(1) as f64;
    let rgb = |v: &[f32; 4]| [v[0], v[1], v[2]].map(f64::from);
    let mean_value = evidence.values.iter().map(|v| rgb(v).iter().sum::<f64>()).sum::<f64>() / (3.0 * count);
    let mut corrections = Vec::with_capacity(evidence.pixels.len());
    let mut relative = 0.0;
    for ((pixel, value), means) in
        evidence.pixels.iter().zip(evidence.values).zip(evidence.means.as_chunks::<STREAMS>().0)
    {
        let (shown, streams) = (rgb(value), means.each_ref().map(rgb));
        let found = estimate_pixel(shown, &streams, exposure);
        corrections.push((pixel.weight, found.square - f64::from(value[3])));
        relative += pixel.weight
            * (0..3)
                .map(|i| {
                    let r = 0.5 * (shown[i] + found.mean[i]);
                    found.linear_squares[i] / (r * r + 0.01 * mean_value * mean_value + 1e-30)
                })
                .sum::<f64>()
            / 3.0;
    }
    let found = moments(&corrections);
    let mse = evidence.predicted + found.mean;
    result.mse = mse;
    result.mse_std_error = found.std_error;
    let seen = mse.max(0.0);
    result.rmse_tonemapped = seen.sqrt();
    // Change of the root over one standard error of the mean square. Where the error is too small for the audit,
    // nothing else is known.
    result.std_error = (seen + found.std_error).sqrt() - seen.sqrt();
    result.rmse_interval = interval(mse, &found);
    result.bound = result.rmse_interval[1].max(evidence.predicted.max(0.0).sqrt());
    result.rel_mse = (relative / count).max(0.0);
}

/// Weighted mean, and moments of its distribution.
struct Moments {
    mean: f64,
    std_error: f64,
    /// Of the mean: the standard deviation of the values over the root of their count.
    skewness: f64,
    /// Degrees of freedom of the standard error.
    freedom: f64,
}

fn moments(values: &[(f64, f64)]) -> Moments {
    let count = values.len().max(1) as f64;
    let mean = values.iter().map(|(weight, value)| weight * value).sum::<f64>() / count;
    let central =
        |power| values.iter().map(|(weight, value)| (weight * (value - mean)).powi(power)).sum::<f64>() / count;
    // Cells are strata: their variance is at most that of the whole, so this is conservative.
    let variance = central(2) * count / (count - 1.0).max(1.0);
    let (skewness, kurtosis) =
        if variance > 0.0 { (central(3) / variance.powf(1.5), central(4) / variance.powi(2)) } else { (0.0, 3.0) };
    Moments {
        mean,
        std_error: (variance / count).sqrt(),
        skewness: skewness / count.sqrt(),
        freedom: (2.0 * count / (kurtosis - 1.0).max(1e-3)).max(2.0),
    }
}

/// Quantile of Student's t distribution for the normal quantile `z` (Abramowitz & Stegun 26.7.5).
fn student(z: f64, freedom: f64) -> f64 {
    let first = (z.powi(3) + z) / 4.0;
    let second = (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / 96.0;
    z + first / freedom + second / freedom.powi(2)
}

/// Ends of the interval of the RMSE.
fn interval(mse: f64, found: &Moments) -> [f64; 2] {
    let skewness = found.skewness;
    // Quantile of the studentised mean by the inverse of Hall's transformation; without skewness it changes nothing.
    let quantile = |z: f64| {
        let t = student(z, found.freedom);
        if skewness.abs() < 1e-6 { t } else { 3.0 / skewness * ((1.0 + skewness * (t - skewness / 6.0)).cbrt() - 1.0) }
    };
    // A squared error is not negative; where the whole interval lies below 0, only its scale is known.
    let low = (mse - found.std_error * quantile(Z)).max(0.0);
    let high = (mse - found.std_error * quantile(-Z)).max(found.std_error);
    [low.sqrt(), high.sqrt()]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Uniform in [0, 1), from a fixed start.
    struct Random(u64);

    impl Random {
        fn next(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        }

        /// Exponential with this mean: skewed, as light is.
        fn exponential(&mut self, mean: f64) -> f64 {
            -mean * (1.0 - self.next()).ln()
        }

        fn normal(&mut self) -> f64 {
            (-2.0 * (1.0 - self.next()).ln()).sqrt() * (std::f64::consts::TAU * self.next()).cos()
        }
    }

    fn judged(shown: f32, means: &[[f32; 4]], predicted: f64) -> AuditResult {
        let count = means.len() / STREAMS;
        let pixels: Vec<_> = (0..count).map(|i| AuditPixel { index: i as u32, weight: 1.0 }).collect();
        let values = vec![[shown, shown, shown, predicted as f32]; count];
        let mut result = AuditResult::default();
        let evidence = Evidence { pixels: &pixels, values: &values, means, predicted, exposure: 1.0 };
        evaluate(&evidence, &mut result);
        result
    }

    #[test]
    fn halves_measure_bias_and_not_their_own_noise() {
        let mut random = Random(1);
        let means: Vec<_> = (0..1000 * STREAMS).map(|_| [(0.5 + 0.02 * random.normal()) as f32; 4]).collect();
        let result = judged(0.6, &means, 0.0);
        let expected = 0.6 / 1.6 - 0.5 / 1.5;
        assert!((result.rmse_tonemapped - expected).abs() < 3.0 * result.std_error, "{result:?}");
        assert!(result.rmse_interval[0] < expected && expected < result.rmse_interval[1], "{result:?}");
    }

    #[test]
    fn the_jackknife_removes_the_bias_of_the_tone_map() {
        // The image is the truth, streams are single samples of an exponential: without the jackknife the audit
        // measures an RMSE of 0.0098 from its own noise alone, seven standard errors from 0.
        let mut random = Random(2);
        let means: Vec<_> = (0..100_000 * STREAMS).map(|_| [random.exponential(0.5) as f32; 4]).collect();
        let result = judged(0.5, &means, 0.0);
        println!("audited {:.2e} with standard error {:.1e}", result.mse, result.mse_std_error);
        assert!(result.mse.abs() < 3.0 * result.mse_std_error, "{result:?}");
    }

    #[test]
    fn splits_equal_the_mean_over_all_pairs() {
        // Far below 1 the tone map is linear, and the splits must give the mean over pairs of streams.
        let mut random = Random(3);
        let streams: [Rgb; STREAMS] = std::array::from_fn(|_| [1e-6 * random.next(); 3]);
        let shown = 4e-7;
        let mut pairs = 0.0;
        for i in 0..STREAMS {
            for j in 0..i {
                pairs += (shown - streams[i][0]) * (shown - streams[j][0]);
            }
        }
        let expected = pairs / (STREAMS * (STREAMS - 1) / 2) as f64;
        let found = estimate_pixel([shown; 3], &streams, 1.0).square;
        assert!((found - expected).abs() < 1e-4 * expected.abs(), "{found} {expected}");
    }

    #[test]
    fn intervals_contain_the_mean_of_skewed_values() {
        // Squares of normal noise whose scale differs from pixel to pixel, as errors are.
        let mut random = Random(4);
        let (trials, count) = (4000, 256);
        let (mut below, mut above) = (0, 0);
        for _ in 0..trials {
            let squares: Vec<_> =
                (0..count).map(|_| (1.0, random.exponential(1.0) * random.normal().powi(2))).collect();
            let found = moments(&squares);
            let [low, high] = interval(found.mean, &found);
            below += i32::from(high < 1.0);
            above += i32::from(low > 1.0);
        }
        println!("of {trials} intervals {below} lie below the truth and {above} above it");
        assert!((below + above) * 10 <= trials, "{below} {above}");
    }

    #[test]
    fn an_interval_is_finite_and_ordered_whatever_was_found() {
        for (mse, std_error, skewness) in
            [(-1.0, 0.1, 0.0), (-1.0, 0.1, 1.0), (1e-4, 1e-4, 1.0), (1e-4, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.5, -0.9)]
        {
            let found = Moments { mean: 0.0, std_error, skewness, freedom: 2.0 };
            let [low, high] = interval(mse, &found);
            assert!(low.is_finite() && high.is_finite() && 0.0 <= low && low <= high, "{mse} {std_error} {skewness}");
        }
    }
}
