//! Linear RGB images and the error metrics over them.

use std::path::Path;

use crate::MeasureError;

/// Linear radiance, first row on top.
#[derive(Clone, Debug)]
pub struct Image {
    /// Width and height.
    pub size: [usize; 2],
    /// Row by row.
    pub pixels: Vec<[f64; 3]>,
}

/// Pixels from (x0, y0) up to, not including, (x1, y1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rectangle {
    /// Left and top.
    pub start: [usize; 2],
    /// Right and bottom, exclusive.
    pub end: [usize; 2],
}

impl Rectangle {
    /// The pixels that contain any of these once the image is [averaged down](Image::averaged_down).
    #[must_use]
    pub fn averaged_down(self, factor: usize) -> Self {
        Self { start: self.start.map(|at| at / factor), end: self.end.map(|at| at.div_ceil(factor)) }
    }
}

impl Image {
    /// Reads an OpenEXR file's colour channels.
    pub fn read_exr(path: &Path) -> Result<Self, MeasureError> {
        let image = exr::prelude::read_first_rgba_layer_from_file(
            path,
            |size, _| (size.width(), vec![[0.0; 3]; size.width() * size.height()]),
            |(width, pixels), position, (r, g, b, _): (f32, f32, f32, f32)| {
                pixels[position.y() * *width + position.x()] = [f64::from(r), f64::from(g), f64::from(b)];
            },
        )
        .map_err(|error| MeasureError::file(path, &format!("cannot be read: {error}")))?;
        let (width, pixels) = image.layer_data.channel_data.pixels;
        if width == 0 || pixels.is_empty() {
            return Err(MeasureError::file(path, &"has no pixel"));
        }
        Ok(Self { size: [width, pixels.len() / width], pixels })
    }

    /// Values that are not finite; a correct image has none.
    pub fn non_finite_count(&self) -> usize {
        self.pixels.iter().filter(|pixel| pixel.iter().any(|value| !value.is_finite())).count()
    }

    /// The image without some rectangles, as one row of pixels: only sums over pixels mean anything after that.
    pub fn without(&self, rectangles: &[Rectangle]) -> Self {
        let [width, _] = self.size;
        let is_inside = |index: usize| {
            let at = [index % width, index / width];
            rectangles.iter().any(|Rectangle { start, end }| (0..2).all(|i| at[i] >= start[i] && at[i] < end[i]))
        };
        let pixels: Vec<_> =
            self.pixels.iter().enumerate().filter(|(index, _)| !is_inside(*index)).map(|(_, pixel)| *pixel).collect();
        Self { size: [pixels.len(), 1], pixels }
    }

    /// The image that a camera with fewer pixels makes: each pixel is the mean of `factor` x `factor` of these.
    /// `None` if they do not divide evenly.
    pub fn averaged_down(&self, factor: usize) -> Option<Self> {
        let [width, height] = self.size;
        if factor == 0 || width % factor != 0 || height % factor != 0 {
            return None;
        }
        let size = [width / factor, height / factor];
        let mut pixels = vec![[0.0; 3]; size[0] * size[1]];
        let share = ((factor * factor) as f64).recip();
        for (index, pixel) in self.pixels.iter().enumerate() {
            let (x, y) = (index % width / factor, index / width / factor);
            for (sum, value) in pixels[y * size[0] + x].iter_mut().zip(pixel) {
                *sum += value * share;
            }
        }
        Some(Self { size, pixels })
    }

    /// The average of two images of one size.
    pub fn mean_with(&self, other: &Self) -> Self {
        debug_assert_eq!(self.pixels.len(), other.pixels.len(), "images of one size are averaged");
        let average = |(a, b): (&[f64; 3], &[f64; 3])| std::array::from_fn(|i| f64::midpoint(a[i], b[i]));
        Self { size: self.size, pixels: self.pixels.iter().zip(&other.pixels).map(average).collect() }
    }

    /// Mean of all pixels and channels.
    pub fn mean(&self) -> f64 {
        self.pixels.iter().flatten().sum::<f64>() / (3 * self.pixels.len()) as f64
    }

    /// The image after `x / (1 + max(r, g, b))` of exposed values.
    pub fn tone_mapped(&self, exposure: f64) -> Self {
        Self { size: self.size, pixels: self.pixels.iter().map(|pixel| tone_map(*pixel, exposure)).collect() }
    }

    /// Mean squared difference over pixels and channels.
    pub fn mse(&self, other: &Self) -> f64 {
        debug_assert_eq!(self.pixels.len(), other.pixels.len(), "images of one size are compared");
        let sum: f64 = self.pixels.iter().zip(&other.pixels).map(|(a, b)| squared_distance(*a, *b)).sum();
        sum / (3 * self.pixels.len()) as f64
    }

    /// Mean squared difference after the tone map of [`Image::tone_mapped`].
    pub fn tone_mapped_mse(&self, other: &Self, exposure: f64) -> f64 {
        self.tone_mapped(exposure).mse(&other.tone_mapped(exposure))
    }

    /// Mean of (x - r)² / (r² + 0.01 mean(r)²) against a reference r.
    pub fn relative_mse(&self, reference: &Self) -> f64 {
        let floor = 0.01 * reference.mean().powi(2) + 1e-30;
        let pairs = self.pixels.as_flattened().iter().zip(reference.pixels.as_flattened());
        pairs.map(|(x, r)| (x - r).powi(2) / (r * r + floor)).sum::<f64>() / (3 * self.pixels.len()) as f64
    }

    /// Variance of [`Image::mean`] of the average of two images that differ only by their seed.
    pub fn variance_of_mean(&self, other: &Self) -> f64 {
        // Each pixel's mean over channels has variance (a - b)² / 2, the average of two images half of that.
        let sum: f64 = self
            .pixels
            .iter()
            .zip(&other.pixels)
            .map(|(a, b)| {
                let difference = (a.iter().sum::<f64>() - b.iter().sum::<f64>()) / 3.0;
                difference * difference / 4.0
            })
            .sum();
        sum / (self.pixels.len() as f64).powi(2)
    }
}

fn tone_map(pixel: [f64; 3], exposure: f64) -> [f64; 3] {
    let exposed = pixel.map(|value| value * exposure);
    let brightest = exposed.iter().copied().fold(0.0, f64::max);
    exposed.map(|value| value / (1.0 + brightest))
}

fn squared_distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(pixels: &[[f64; 3]]) -> Image {
        Image { size: [pixels.len(), 1], pixels: pixels.to_vec() }
    }

    #[test]
    fn tone_mapped_error_of_known_images() {
        // 1 becomes 1/2 and 3 becomes 3/4: a difference of 1/4 in each channel.
        let mse = image(&[[1.0; 3]]).tone_mapped_mse(&image(&[[3.0; 3]]), 1.0);
        assert!((mse - 0.0625).abs() < 1e-12, "{mse}");
        // Exposure 3 makes the first what the second was; the second becomes 9/10.
        let mse = image(&[[1.0; 3]]).tone_mapped_mse(&image(&[[3.0; 3]]), 3.0);
        assert!((mse - 0.15_f64.powi(2)).abs() < 1e-12, "{mse}");
        // The brightest channel scales all three: (2, 1, 0) / 3.
        let mse = image(&[[2.0, 1.0, 0.0]]).tone_mapped_mse(&image(&[[0.0; 3]]), 1.0);
        assert!((mse - (4.0 + 1.0) / 9.0 / 3.0).abs() < 1e-12, "{mse}");
    }

    #[test]
    fn relative_error_of_known_images() {
        // Mean of the reference is 2, so the floor is 0.04: (1 / 1.04 + 4 / 9.04) / 2.
        let error = image(&[[2.0; 3], [5.0; 3]]).relative_mse(&image(&[[1.0; 3], [3.0; 3]]));
        assert!((error - f64::midpoint(1.0 / 1.04, 4.0 / 9.04)).abs() < 1e-12, "{error}");
    }

    #[test]
    fn rectangles_are_left_out() {
        let mut whole = Image { size: [4, 2], pixels: vec![[1.0; 3]; 8] };
        whole.pixels[5] = [100.0; 3];
        assert!(whole.mean() > 10.0);
        let rest = whole.without(&[Rectangle { start: [1, 1], end: [2, 2] }]);
        assert_eq!(rest.pixels.len(), 7);
        assert!((rest.mean() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn averaging_down_keeps_the_mean_and_its_place() {
        let mut whole = Image { size: [4, 2], pixels: vec![[1.0; 3]; 8] };
        whole.pixels[7] = [5.0, 1.0, 1.0];
        let small = whole.averaged_down(2).unwrap();
        assert_eq!((small.size, small.pixels.as_slice()), ([2, 1], [[1.0; 3], [2.0, 1.0, 1.0]].as_slice()));
        assert!(whole.averaged_down(4).is_none() && whole.averaged_down(0).is_none());
        let masked = Rectangle { start: [1, 1], end: [3, 2] }.averaged_down(2);
        assert_eq!(masked, Rectangle { start: [0, 0], end: [2, 1] }, "every pixel that holds any of them");
    }

    #[test]
    fn variance_of_mean_matches_many_images() {
        // A fixed linear congruence stands for noise: uniform in [0, 1), variance 1/12 a channel, channels independent.
        let mut state = 1_u64;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let count = 20_000;
        let mut draw = || Image { size: [count, 1], pixels: (0..count).map(|_| [noise(), noise(), noise()]).collect() };
        let (a, b) = (draw(), draw());
        let expected = 1.0 / 12.0 / 3.0 / 2.0 / count as f64;
        let measured = a.variance_of_mean(&b);
        assert!((measured / expected - 1.0).abs() < 0.05, "{measured} against {expected}");
    }

    #[test]
    fn bad_values_are_counted() {
        assert_eq!(image(&[[1.0; 3], [f64::NAN, 0.0, 0.0], [0.0, f64::INFINITY, 0.0]]).non_finite_count(), 2);
    }
}
