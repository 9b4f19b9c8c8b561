//! Which pixels are audited: the image is divided into cells, and one random pixel of each is audited.

/// Audited pixels at most.
const MAX_PIXELS: u64 = 1024;
/// And at least, if the image has as many: the standard error of fewer would be too uncertain.
const MIN_PIXELS: u64 = 256;
/// Pixels of the image for each audited one, between these bounds.
const CELL_PIXELS: u64 = 32;

/// A pixel that represents its cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct AuditPixel {
    /// Index in the image, in row order.
    pub(super) index: u32,
    /// Pixels of its cell over those of a mean cell. Cells differ by a row or a column where they do not divide the
    /// image evenly.
    pub(super) weight: f64,
}

/// One random pixel in each cell of a grid over the image, in row order.
pub(super) fn audit_pixels(size: [u32; 2], seed: u64) -> Vec<AuditPixel> {
    let [width, height] = size.map(u64::from);
    let pixel_count = width * height;
    let wanted = (pixel_count / CELL_PIXELS).clamp(pixel_count.min(MIN_PIXELS), MAX_PIXELS).max(1);
    let aspect = width as f64 / height as f64;
    let columns = ((wanted as f64 * aspect).sqrt().round() as u64).clamp(1, width);
    let rows = (wanted / columns).clamp(1, height);
    let mean_cell = pixel_count as f64 / (columns * rows) as f64;
    let mut state = seed;
    let mut random = |below: u64| {
        // SplitMix64 (Steele et al. 2014): unlike with a plain xorshift, neighbouring seeds are uncorrelated.
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = state;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (mixed ^ (mixed >> 31)) % below.max(1)
    };
    let mut pixels = Vec::with_capacity((columns * rows) as usize);
    for row in 0..rows {
        let (top, bottom) = (row * height / rows, (row + 1) * height / rows);
        for column in 0..columns {
            let (left, right) = (column * width / columns, (column + 1) * width / columns);
            let x = left + random(right - left);
            let y = top + random(bottom - top);
            let weight = ((right - left) * (bottom - top)) as f64 / mean_cell;
            pixels.push(AuditPixel { index: (y * width + x) as u32, weight });
        }
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_pixel_of_each_cell() {
        let pixels = audit_pixels([320, 180], 7);
        assert!((900..=1024).contains(&pixels.len()), "{}", pixels.len());
        let mut indices: Vec<u32> = pixels.iter().map(|pixel| pixel.index).collect();
        indices.sort_unstable();
        indices.dedup();
        assert_eq!(indices.len(), pixels.len());
        assert_eq!(audit_pixels([1, 1], 3), [AuditPixel { index: 0, weight: 1.0 }]);
        assert!(audit_pixels([4096, 1], 3).iter().all(|pixel| pixel.index < 4096));
    }

    /// All pixels have the same mean weight over seeds, whatever the size.
    #[test]
    fn every_pixel_has_the_same_mean_weight() {
        let size = [25, 23];
        let mut weights = vec![0.0; (size[0] * size[1]) as usize];
        let seeds = 4000;
        for seed in 0..seeds {
            let pixels = audit_pixels(size, seed);
            let mean = pixels.iter().map(|pixel| pixel.weight).sum::<f64>() / pixels.len() as f64;
            assert!((mean - 1.0).abs() < 1e-12, "{mean}");
            for pixel in &pixels {
                weights[pixel.index as usize] += pixel.weight;
            }
        }
        let mean = weights.iter().sum::<f64>() / weights.len() as f64;
        // A pixel alone in its cell always counts; one of four varies by the root of 3 / 4000 in each seed.
        let worst = weights.iter().map(|weight| (weight / mean - 1.0).abs()).fold(0.0, f64::max);
        assert!(worst < 0.15, "{worst}");
    }
}
