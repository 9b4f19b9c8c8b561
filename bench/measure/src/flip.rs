//! FLIP: the perceived difference of two images that are shown in alternation.
//!
//! Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström and Fairchild, "FLIP: A Difference Evaluator for Alternating
//! Images", HPG 2020, for display-referred images. Colours are blurred by the eye's contrast sensitivity and compared
//! in a uniform space (§4.1); edges and points are compared apart (§4.2) and raise the colour difference (§4.3). All
//! filters are products of one-dimensional ones.

use std::f64::consts::PI;

use crate::Image;

/// Pixels a degree: 0.7 m from a monitor 0.7 m and 3840 pixels wide, the paper's default.
const PIXELS_PER_DEGREE: f64 = 3840.0 * PI / 180.0;
/// Contrast sensitivity of the achromatic, red-green and blue-yellow channels as sums of Gaussians: (weight, width).
const SENSITIVITY: [&[(f64, f64)]; 3] = [&[(1.0, 0.0047)], &[(1.0, 0.0053)], &[(34.1, 0.04), (13.5, 0.025)]];
/// Width of the feature detectors, degrees.
const FEATURE_WIDTH: f64 = 0.082;
/// Exponents of colour and feature differences.
const COLOR_EXPONENT: f64 = 0.7;
const FEATURE_EXPONENT: f64 = 0.5;
/// Colour differences up to LARGE of the largest are mapped to RANGE of the result.
const LARGE: f64 = 0.4;
const RANGE: f64 = 0.95;

const XYZ_FROM_RGB: [[f64; 3]; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];

/// Mean FLIP of two images of one size whose values are linear and as displayed, in [0, 1]; the order does not matter.
pub fn flip(image: &Image, reference: &Image) -> f64 {
    let [one, other] = [image, reference].map(Look::new);
    let largest = largest_difference();
    let knee = LARGE * largest;
    let sum: f64 = (0..image.pixels.len())
        .map(|i| {
            let difference = hyab(one.colors[i], other.colors[i]).powf(COLOR_EXPONENT);
            let color = if difference < knee {
                difference * RANGE / knee
            } else {
                RANGE + (difference - knee) / (largest - knee) * (1.0 - RANGE)
            };
            let feature = [0, 1].map(|kind| (one.features[i][kind] - other.features[i][kind]).abs());
            let feature = (feature[0].max(feature[1]) / 2.0_f64.sqrt()).powf(FEATURE_EXPONENT);
            color.powf(1.0 - feature)
        })
        .sum();
    sum / image.pixels.len() as f64
}

/// The features of an image that are compared, by pixel.
struct Look {
    /// Blurred, in the Hunt-adjusted CIELAB space.
    colors: Vec<[f64; 3]>,
    /// Strength of edges and of points.
    features: Vec<[f64; 2]>,
}

impl Look {
    fn new(image: &Image) -> Self {
        let opponent: Vec<_> =
            image.pixels.iter().map(|pixel| opponent(xyz(pixel.map(|value| value.clamp(0.0, 1.0))))).collect();
        let plane = |channel: usize, of: fn(f64) -> f64| Plane {
            width: image.size[0],
            values: opponent.iter().map(|pixel| of(pixel[channel])).collect(),
        };
        let blurred = [0, 1, 2].map(|channel| plane(channel, |value| value).blurred(SENSITIVITY[channel]));
        let colors = (0..image.pixels.len())
            .map(|i| hunt(rgb(xyz_of_opponent([0, 1, 2].map(|channel| blurred[channel].values[i])))))
            .collect();

        let deviation = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
        let radius = (3.0 * deviation).ceil() as i64;
        let at = |weight: &dyn Fn(f64) -> f64| -> Vec<f64> {
            let gauss = |x: f64| (-x * x / (2.0 * deviation * deviation)).exp();
            (-radius..=radius).map(|x| x as f64).map(|x| weight(x) * gauss(x)).collect()
        };
        let smooth = normalised(at(&|_| 1.0));
        let detectors = [at(&|x| -x), at(&|x| x * x / (deviation * deviation) - 1.0)].map(normalised);
        let luminance = plane(0, |value| (value + 16.0) / 116.0);
        let strengths = detectors.map(|detector| {
            let along = luminance.filtered(&detector, &smooth);
            let across = luminance.filtered(&smooth, &detector);
            along.values.iter().zip(&across.values).map(|(x, y)| x.hypot(*y)).collect::<Vec<_>>()
        });
        let features = strengths[0].iter().zip(&strengths[1]).map(|(edge, point)| [*edge, *point]).collect();
        Self { colors, features }
    }
}

/// One channel, row by row.
struct Plane {
    width: usize,
    values: Vec<f64>,
}

impl Plane {
    /// Blurred by a sum of Gaussians, given as (weight, width).
    fn blurred(&self, sensitivity: &[(f64, f64)]) -> Self {
        // One radius for all channels, that of the widest Gaussian.
        let widest = SENSITIVITY.iter().flat_map(|sum| sum.iter()).map(|(_, width)| *width).fold(0.0, f64::max);
        let radius = (3.0 * (widest / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as i64;
        let mut total = 0.0;
        let mut values = vec![0.0; self.values.len()];
        for &(weight, width) in sensitivity {
            let gauss = |x: i64| (-(PI * x as f64 / PIXELS_PER_DEGREE).powi(2) / width).exp();
            let kernel: Vec<f64> = (-radius..=radius).map(gauss).collect();
            // The kernels are not normalised: their heights are the weights of the sum.
            let height = weight * (PI / width).sqrt();
            total += height * kernel.iter().sum::<f64>().powi(2);
            for (value, part) in values.iter_mut().zip(self.filtered(&kernel, &kernel).values) {
                *value += height * part;
            }
        }
        Self { width: self.width, values: values.into_iter().map(|value| value / total).collect() }
    }

    /// Convolved along rows and then along columns; the border is repeated.
    fn filtered(&self, along: &[f64], across: &[f64]) -> Self {
        let (width, height) = (self.width, self.values.len() / self.width);
        let convolve = |source: &[f64], kernel: &[f64], count: usize, step: usize, at: usize, base: usize| {
            let radius = kernel.len() / 2;
            let inside = |k: usize| (at + k).saturating_sub(radius).min(count - 1);
            kernel.iter().enumerate().map(|(k, weight)| weight * source[base + inside(k) * step]).sum::<f64>()
        };
        let rows: Vec<f64> =
            (0..self.values.len()).map(|i| convolve(&self.values, along, width, 1, i % width, i - i % width)).collect();
        let values = (0..rows.len()).map(|i| convolve(&rows, across, height, width, i / width, i % width)).collect();
        Self { width, values }
    }
}

/// Scales the positive weights to a sum of 1 and the negative ones to a sum of -1.
fn normalised(kernel: Vec<f64>) -> Vec<f64> {
    let positive: f64 = kernel.iter().filter(|value| **value > 0.0).sum();
    let negative: f64 = kernel.iter().filter(|value| **value < 0.0).map(|value| -value).sum();
    // A kernel without negative weights has only zeros on that side.
    let negative = negative.max(f64::MIN_POSITIVE);
    kernel.into_iter().map(|value| value / if value > 0.0 { positive } else { negative }).collect()
}

fn xyz(rgb: [f64; 3]) -> [f64; 3] {
    XYZ_FROM_RGB.map(|row| row.iter().zip(rgb).map(|(weight, value)| weight * value).sum())
}

/// Relative to the white of (1, 1, 1).
fn over_white(color: [f64; 3]) -> [f64; 3] {
    let white = xyz([1.0; 3]);
    [0, 1, 2].map(|i| color[i] / white[i])
}

/// YCxCz, a linear CIELAB.
fn opponent(color: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = over_white(color);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn xyz_of_opponent([luminance, red_green, blue_yellow]: [f64; 3]) -> [f64; 3] {
    let y = (luminance + 16.0) / 116.0;
    let relative = [y + red_green / 500.0, y, y - blue_yellow / 200.0];
    let white = xyz([1.0; 3]);
    [0, 1, 2].map(|i| relative[i] * white[i])
}

/// Solves the three equations of [`xyz`] by Cramer's rule, and clamps to what a display can show.
fn rgb(color: [f64; 3]) -> [f64; 3] {
    let determinant = |m: [[f64; 3]; 3]| {
        let minor = |a: usize, b: usize| m[1][a] * m[2][b] - m[1][b] * m[2][a];
        m[0][0] * minor(1, 2) - m[0][1] * minor(0, 2) + m[0][2] * minor(0, 1)
    };
    let whole = determinant(XYZ_FROM_RGB);
    [0, 1, 2].map(|column| {
        let mut replaced = XYZ_FROM_RGB;
        for (row, value) in replaced.iter_mut().zip(color) {
            row[column] = value;
        }
        (determinant(replaced) / whole).clamp(0.0, 1.0)
    })
}

/// CIELAB of linear RGB, with colour differences that grow with lightness (Hunt).
fn hunt(rgb: [f64; 3]) -> [f64; 3] {
    let curve = |t: f64| {
        const DELTA: f64 = 6.0 / 29.0;
        if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
    };
    let [x, y, z] = over_white(xyz(rgb)).map(curve);
    let lightness = 116.0 * y - 16.0;
    [lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z)]
}

/// Distance for large colour differences: city block in lightness, Euclidean in colour.
fn hyab(one: [f64; 3], other: [f64; 3]) -> f64 {
    (one[0] - other[0]).abs() + (one[1] - other[1]).hypot(one[2] - other[2])
}

/// The difference of green and blue, the largest in the gamut.
fn largest_difference() -> f64 {
    hyab(hunt([0.0, 1.0, 0.0]), hunt([0.0, 0.0, 1.0])).powf(COLOR_EXPONENT)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ramp with a disc and stripes, and the same with the disc moved and noise by a fixed rule.
    fn images() -> [Image; 2] {
        let size = [64, 48];
        let image = |is_second: bool| {
            let mut pixels = Vec::new();
            for y in 0..size[1] {
                for x in 0..size[0] {
                    let centre = if is_second { 24.0 } else { 20.0 };
                    let is_inside = (x as f64 - centre).hypot(y as f64 - 20.0) < 9.0;
                    let stripe = if x > 40 && (x / 3) % 2 == 0 { 0.3 } else { 0.0 };
                    let noise = if is_second { ((x * 7 + y * 13) % 5) as f64 * 0.02 } else { 0.0 };
                    let ramp = x as f64 / 64.0 * 0.5;
                    let red = if is_inside { 0.8 } else { ramp };
                    pixels.push([red + noise, ramp + stripe, y as f64 / 48.0 * 0.6 + noise]);
                }
            }
            Image { size, pixels }
        };
        [image(false), image(true)]
    }

    #[test]
    fn agrees_with_the_authors_program() {
        let [one, other] = images();
        // flip-evaluator 1.7, LDR, sRGB-encoded 32-bit values of the same two images, 67.0206 pixels a degree.
        let expected = 0.230_854_87;
        assert!((flip(&other, &one) - expected).abs() < 1e-6, "{} against {expected}", flip(&other, &one));
        assert!((flip(&one, &other) - flip(&other, &one)).abs() < 1e-12);
        assert_eq!(flip(&one, &one), 0.0);
    }

    #[test]
    fn flat_images_agree_too() {
        let flat = |value: f64| Image { size: [8, 8], pixels: vec![[value; 3]; 64] };
        let difference = flip(&flat(0.0), &flat(1.0));
        assert!((difference - 0.967_388).abs() < 1e-5, "{difference}");
        // The authors compute in single precision, which is visible in nearly equal greys.
        let slight = flip(&flat(0.5), &flat(0.51));
        assert!((slight - 0.040_72).abs() < 5e-5, "{slight}");
    }
}
