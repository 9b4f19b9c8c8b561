//! What rays see that leave the scene.

use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;

use image::codecs::hdr::HdrDecoder;
use image::{DynamicImage, ImageDecoder};

use crate::asset::check::{invalid, within};
use crate::{SceneError, SceneLimits};

/// Radiance from infinitely far away.
#[derive(Clone, Debug, PartialEq, Default)]
pub enum Environment {
    /// Black.
    #[default]
    None,
    /// The same radiance from every direction, linear Rec. 709.
    Constant([f32; 3]),
    /// An equirectangular image.
    Map(Arc<EnvironmentMap>),
}

/// Equirectangular radiance. Row 0 is +Y (up); column `u` in `[0, 1)` looks along
/// `(sin(phi) sin(theta), cos(theta), -cos(phi) sin(theta))` with `phi = 2 pi (u - 0.5)`, `theta = pi v`, so the middle
/// of the image is -Z.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentMap {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Row-major linear radiance, finite and not negative; `width * height` entries.
    pub radiance: Vec<[f32; 3]>,
}

/// Longest side of an environment map.
const MAX_SIDE: u32 = 1 << 16;

impl EnvironmentMap {
    /// Reads a lat-long map from a `.hdr` (Radiance) or `.exr` (OpenEXR) file, told apart by their first bytes. The
    /// size is checked from the header before pixels are decoded. Negative and non-finite values become 0 (infinities
    /// the largest half float), which is logged.
    pub fn read(path: &Path, limits: &SceneLimits) -> Result<Self, SceneError> {
        let read_error = |source| SceneError::Read { path: path.display().to_string(), source };
        let length = std::fs::metadata(path).map_err(read_error)?.len();
        within("environment file bytes", length, limits.max_file_bytes)?;
        Self::decode(&std::fs::read(path).map_err(read_error)?, limits)
    }

    /// Decodes the bytes of a `.hdr` or `.exr` file.
    pub fn decode(bytes: &[u8], limits: &SceneLimits) -> Result<Self, SceneError> {
        let decode = || {
            if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
                decode_exr(bytes, limits)
            } else if bytes.starts_with(b"#?") {
                decode_hdr(bytes, limits)
            } else {
                Err(invalid("environment", "is neither Radiance HDR nor OpenEXR"))
            }
        };
        // a panic inside a codec must not take the process down
        let mut map =
            catch_unwind(AssertUnwindSafe(decode)).unwrap_or_else(|_| Err(invalid("environment", "is broken")))?;
        let mut repaired = 0usize;
        for value in map.radiance.as_flattened_mut() {
            if !(value.is_finite() && *value >= 0.0) {
                *value = if *value == f32::INFINITY { 65504.0 } else { 0.0 };
                repaired += 1;
            }
        }
        if repaired > 0 {
            tracing::warn!(repaired, "environment map has negative or non-finite values, which were replaced");
        }
        Ok(map)
    }
}

fn check_size(width: u64, height: u64, limits: &SceneLimits) -> Result<(u32, u32), SceneError> {
    within("environment width", width, u64::from(MAX_SIDE))?;
    within("environment height", height, u64::from(MAX_SIDE))?;
    within("environment pixels", width * height, u64::from(limits.max_environment_pixels))?;
    if width == 0 || height == 0 {
        return Err(invalid("environment", "has no pixels"));
    }
    Ok((width as u32, height as u32))
}

fn decode_hdr(bytes: &[u8], limits: &SceneLimits) -> Result<EnvironmentMap, SceneError> {
    let broken = |error: image::ImageError| invalid("environment", format!("cannot be decoded: {error}"));
    let decoder = HdrDecoder::new(Cursor::new(bytes)).map_err(broken)?;
    let (width, height) = decoder.dimensions();
    let (width, height) = check_size(u64::from(width), u64::from(height), limits)?;
    let picture = DynamicImage::from_decoder(decoder).map_err(broken)?.into_rgb32f();
    Ok(EnvironmentMap { width, height, radiance: picture.pixels().map(|pixel| pixel.0).collect() })
}

fn decode_exr(bytes: &[u8], limits: &SceneLimits) -> Result<EnvironmentMap, SceneError> {
    use exr::prelude::*;
    let broken = |error: Error| invalid("environment", format!("cannot be decoded: {error}"));
    let header = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(broken)?;
    let first = header.headers.first().ok_or_else(|| invalid("environment", "has no layer"))?;
    within("environment channels", first.channels.list.len() as u64, 64)?;
    let size = first.layer_size;
    let (width, height) = check_size(size.width() as u64, size.height() as u64, limits)?;
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .rgba_channels(
            |size, _| (size.width(), vec![[0.0f32; 3]; size.width() * size.height()]),
            |(width, pixels), position, (r, g, b, _): (f32, f32, f32, f32)| {
                pixels[position.y() * *width + position.x()] = [r, g, b];
            },
        )
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(broken)?;
    let (decoded_width, radiance) = image.layer_data.channel_data.pixels;
    if decoded_width != width as usize || radiance.len() != width as usize * height as usize {
        return Err(invalid("environment", "has layers of different sizes"));
    }
    Ok(EnvironmentMap { width, height, radiance })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hdr(width: u32, height: u32, pixel: [f32; 3]) -> Vec<u8> {
        let mut out = Vec::new();
        let pixels = vec![image::Rgb(pixel); (width * height) as usize];
        image::codecs::hdr::HdrEncoder::new(&mut out).encode(&pixels, width as usize, height as usize).unwrap();
        out
    }

    fn exr(width: usize, height: usize, pixel: impl Fn(usize, usize) -> [f32; 3] + Sync) -> Vec<u8> {
        use exr::prelude::*;
        let mut out = Cursor::new(Vec::new());
        let channels = SpecificChannels::rgb(|p: Vec2<usize>| {
            let [r, g, b] = pixel(p.x(), p.y());
            (r, g, b)
        });
        Image::from_channels((width, height), channels).write().to_buffered(&mut out).unwrap();
        out.into_inner()
    }

    #[test]
    fn both_formats_keep_their_pixels() {
        let map = EnvironmentMap::decode(&hdr(16, 8, [0.5, 2.0, 8.0]), &SceneLimits::default()).unwrap();
        assert_eq!((map.width, map.height), (16, 8));
        assert_eq!(map.radiance[37], [0.5, 2.0, 8.0]);
        let bytes = exr(4, 2, |x, y| [x as f32, y as f32, 1e4]);
        let map = EnvironmentMap::decode(&bytes, &SceneLimits::default()).unwrap();
        assert_eq!(map.radiance[4 + 3], [3.0, 1.0, 1e4], "row 1, column 3");
    }

    #[test]
    fn broken_values_are_repaired() {
        let bytes = exr(2, 1, |x, _| if x == 0 { [f32::NAN, -1.0, f32::INFINITY] } else { [1.0; 3] });
        let map = EnvironmentMap::decode(&bytes, &SceneLimits::default()).unwrap();
        assert_eq!(map.radiance, [[0.0, 0.0, 65504.0], [1.0; 3]]);
    }

    #[test]
    fn sizes_are_checked_from_the_header() {
        let limits = SceneLimits { max_environment_pixels: 100, ..SceneLimits::default() };
        let refused = |bytes: &[u8]| EnvironmentMap::decode(bytes, &limits).unwrap_err().to_string();
        assert!(refused(&exr(16, 8, |_, _| [1.0; 3])).contains("environment pixels is 128, over the limit of 100"));
        let mut lying = hdr(16, 4, [1.0; 3]);
        let at = lying.windows(5).position(|w| w == b"-Y 4 ").unwrap();
        lying.splice(at..at + 5, *b"-Y 60000 ");
        assert!(refused(&lying).contains("environment pixels"));
        assert!(refused(b"not an image").contains("neither"));
    }

    #[test]
    fn cut_files_are_refused() {
        let whole = [exr(16, 8, |x, _| [x as f32; 3]), hdr(16, 8, [1.0, 2.0, 3.0])];
        for bytes in whole {
            for length in 0..bytes.len() {
                // must not panic; a cut at the very end may still be readable
                let _ = EnvironmentMap::decode(&bytes[..length], &SceneLimits::default());
            }
            assert!(EnvironmentMap::decode(&bytes[..bytes.len() / 2], &SceneLimits::default()).is_err());
        }
    }
}
