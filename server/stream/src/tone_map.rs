//! Display transform: exposure, tone map, sRGB encoding.

/// Maps linear radiance to display pixels: `x k` with `k = exposure / (1 + exposure max(r, g, b))` (Noack 2022, eq.
/// 6.1, applied to the exposed value), then the sRGB curve, then 8 bits. Alpha is 255. Values that are negative or not
/// a number become black.
pub fn tone_map_to_rgba8(pixels: &[[f32; 3]], exposure: f32) -> Vec<u8> {
    pixels.iter().flat_map(|&rgb| display_pixel(rgb, exposure)).collect()
}

fn display_pixel(rgb: [f32; 3], exposure: f32) -> [u8; 4] {
    // `max` with 0 also turns NaN into 0; the upper bound keeps an infinite channel finite.
    let rgb = rgb.map(|c| c.max(0.0).min(f32::MAX.sqrt()) * exposure);
    let peak = rgb[0].max(rgb[1]).max(rgb[2]);
    let [r, g, b] = rgb.map(|c| quantise(srgb_oetf(c / (1.0 + peak))));
    [r, g, b, 255]
}

/// sRGB opto-electronic transfer function on [0, 1].
fn srgb_oetf(x: f32) -> f32 {
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

fn quantise(x: f32) -> u8 {
    (x * 255.0 + 0.5).clamp(0.0, 255.0) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        // 1 maps to 0.5, whose sRGB code is 188; 0 to 0; the hue survives any brightness.
        assert_eq!(tone_map_to_rgba8(&[[1.0; 3]], 1.0), [188, 188, 188, 255]);
        assert_eq!(tone_map_to_rgba8(&[[0.5; 3]], 2.0), [188, 188, 188, 255]);
        assert_eq!(tone_map_to_rgba8(&[[0.0; 3]], 1.0), [0, 0, 0, 255]);
        assert_eq!(tone_map_to_rgba8(&[[1e9, 0.0, 0.0]], 1.0), [255, 0, 0, 255]);
        let dim = tone_map_to_rgba8(&[[0.001; 3]], 1.0)[0];
        assert_eq!(dim, 3, "the linear part of the curve: 0.000999 x 12.92 x 255 = 3.29");
    }

    #[test]
    fn values_that_are_no_colours_are_black_or_bounded() {
        let out = tone_map_to_rgba8(&[[f32::NAN, -1.0, 0.0], [f32::INFINITY, 1.0, 0.0]], 1e6);
        assert_eq!(out[..4], [0, 0, 0, 255]);
        assert_eq!(out[4], 255);
    }

    #[test]
    fn brighter_is_never_darker() {
        let ramp: Vec<[f32; 3]> = (0..2000).map(|i| [(i as f32 / 100.0).exp2() * 1e-3; 3]).collect();
        let out = tone_map_to_rgba8(&ramp, 1.0);
        assert!(out.chunks_exact(4).map(|p| p[0]).is_sorted());
    }
}
