//! Texture look-ups on the CPU, by the rules the shaders follow: decode each texel, then filter.

use crate::{Texture, TextureRef, Wrap};

impl TextureRef {
    /// Applies the texture transform.
    pub fn apply(&self, uv: [f32; 2]) -> [f32; 2] {
        self.transform.map(|[a, b, t]| a * uv[0] + b * uv[1] + t)
    }
}

/// Decodes an sRGB component in [0, 1].
pub fn srgb_to_linear(x: f32) -> f32 {
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

/// Filtered RGBA at `uv`; `decode` is applied to red, green and blue of each texel before filtering.
pub fn sample_texture(texture: &Texture, uv: [f32; 2], decode: impl Fn(f32) -> f32) -> [f32; 4] {
    let (width, height) = (texture.width as f32, texture.height as f32);
    let texel = |x: i64, y: i64| -> [f32; 4] {
        let x = wrap(x, texture.width, texture.wrap_u);
        let y = wrap(y, texture.height, texture.wrap_v);
        let at = (y as usize * texture.width as usize + x as usize) * 4;
        let mut rgba: [f32; 4] = std::array::from_fn(|k| f32::from(texture.texels[at + k]) / 255.0);
        rgba[..3].iter_mut().for_each(|c| *c = decode(*c));
        rgba
    };
    // Coordinates beyond 2^30 texels have no fraction left in f32; bounding them keeps the integers in range.
    let bounded = |x: f32| if x.is_finite() { x.clamp(-1e9, 1e9) } else { 0.0 };
    let (x, y) = (bounded(uv[0] * width), bounded(uv[1] * height));
    if !texture.is_linear {
        return texel(x.floor() as i64, y.floor() as i64);
    }
    let (x, y) = (x - 0.5, y - 0.5);
    let (fx, fy) = (x - x.floor(), y - y.floor());
    let (x, y) = (x.floor() as i64, y.floor() as i64);
    let [a, b, c, d] = [texel(x, y), texel(x + 1, y), texel(x, y + 1), texel(x + 1, y + 1)];
    std::array::from_fn(|k| {
        let (low, high) = (a[k] + (b[k] - a[k]) * fx, c[k] + (d[k] - c[k]) * fx);
        low + (high - low) * fy
    })
}

fn wrap(x: i64, size: u32, mode: Wrap) -> u32 {
    let size = i64::from(size);
    let wrapped = match mode {
        Wrap::Repeat => x.rem_euclid(size),
        Wrap::MirroredRepeat => {
            let folded = x.rem_euclid(2 * size);
            folded.min(2 * size - 1 - folded)
        }
        Wrap::ClampToEdge => x.clamp(0, size - 1),
    };
    wrapped as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrapping_follows_the_modes() {
        let row = |mode| (-4..8).map(|x| wrap(x, 4, mode)).collect::<Vec<_>>();
        assert_eq!(row(Wrap::Repeat), [0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3]);
        assert_eq!(row(Wrap::MirroredRepeat), [3, 2, 1, 0, 0, 1, 2, 3, 3, 2, 1, 0]);
        assert_eq!(row(Wrap::ClampToEdge), [0, 0, 0, 0, 0, 1, 2, 3, 3, 3, 3, 3]);
    }

    #[test]
    fn extreme_coordinates_are_harmless() {
        let texture = Texture {
            width: 2,
            height: 2,
            texels: vec![255; 16].into(),
            wrap_u: Wrap::Repeat,
            wrap_v: Wrap::MirroredRepeat,
            is_linear: true,
        };
        for x in [f32::MAX, f32::MIN, f32::INFINITY, f32::NAN, 1e20, -1e-40] {
            assert_eq!(sample_texture(&texture, [x, x], srgb_to_linear), [1.0; 4], "{x}");
        }
    }
}
