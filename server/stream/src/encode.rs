//! RGBA8 images to JPEG, WebP and PNG.

use image::ImageEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};

use crate::StreamError;

/// Largest side a WebP file can state.
const WEBP_MAX_SIDE: u32 = 16_383;
/// Largest side a JPEG file can state.
const JPEG_MAX_SIDE: u32 = 65_500;
/// Lowest quality with full colour resolution: below it, 4:2:0 saves a third of the bytes without a visible difference.
const FULL_COLOR_QUALITY: u8 = 90;
/// libwebp effort (0 to 6) of lossy images: 2 takes half the time of 4 for 6 % more bytes.
const WEBP_METHOD: i32 = 2;
/// libwebp effort of lossless images, low because the viewer waits for them.
const WEBP_LOSSLESS_METHOD: i32 = 1;

/// Image file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Codec {
    /// JPEG; always lossy.
    Jpeg,
    /// WebP.
    Webp,
    /// PNG; always lossless.
    Png,
}

/// How much detail may be lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Quality {
    /// 1 (worst) to 100. PNG ignores it.
    Lossy(u8),
    /// Nothing; JPEG takes quality 100.
    Lossless,
}

impl Quality {
    /// The number in frame headers: 100 for lossless.
    pub fn number(self) -> u8 {
        match self {
            Self::Lossy(quality) => quality.clamp(1, 100),
            Self::Lossless => 100,
        }
    }
}

/// Encodes an image of `size` (width, height), first row on top, alpha ignored. Fails when pixels and size disagree or
/// a side exceeds the codec's limit.
pub fn encode(pixels: &[u8], size: [u32; 2], codec: Codec, quality: Quality) -> Result<Vec<u8>, StreamError> {
    let [width, height] = size;
    let needed = (u64::from(width) * u64::from(height)).saturating_mul(4);
    if needed != pixels.len() as u64 || needed == 0 {
        return Err(StreamError::Size { width, height, needed, present: pixels.len() as u64 });
    }
    match codec {
        Codec::Jpeg => jpeg(pixels, size, quality.number()),
        Codec::Webp => webp(pixels, size, quality),
        Codec::Png => png(pixels, size),
    }
}

fn check_side(size: [u32; 2], codec: &'static str, limit: u32) -> Result<(), StreamError> {
    let side = size[0].max(size[1]);
    if side > limit { Err(StreamError::TooLarge { codec, side, limit }) } else { Ok(()) }
}

fn jpeg(pixels: &[u8], size: [u32; 2], quality: u8) -> Result<Vec<u8>, StreamError> {
    check_side(size, "JPEG", JPEG_MAX_SIDE)?;
    let fail = |e: turbojpeg::Error| StreamError::Encoder { codec: "JPEG", detail: e.to_string() };
    let mut compressor = turbojpeg::Compressor::new().map_err(fail)?;
    compressor.set_quality(i32::from(quality)).map_err(fail)?;
    let subsampling = if quality >= FULL_COLOR_QUALITY { turbojpeg::Subsamp::None } else { turbojpeg::Subsamp::Sub2x2 };
    compressor.set_subsamp(subsampling).map_err(fail)?;
    let width = size[0] as usize;
    let image = turbojpeg::Image {
        pixels,
        width,
        pitch: width * 4,
        height: size[1] as usize,
        format: turbojpeg::PixelFormat::RGBX,
    };
    compressor.compress_to_vec(image).map_err(fail)
}

fn webp(pixels: &[u8], size: [u32; 2], quality: Quality) -> Result<Vec<u8>, StreamError> {
    check_side(size, "WebP", WEBP_MAX_SIDE)?;
    let fail = |detail: String| StreamError::Encoder { codec: "WebP", detail };
    let mut config = webp::WebPConfig::new().map_err(|()| fail("library version mismatch".into()))?;
    match quality {
        Quality::Lossy(quality) => {
            config.quality = f32::from(quality.clamp(1, 100));
            config.method = WEBP_METHOD;
        }
        Quality::Lossless => {
            config.lossless = 1;
            config.quality = 20.0;
            config.method = WEBP_LOSSLESS_METHOD;
        }
    }
    // Alpha is dropped first: it is constant, and libwebp would spend time and bytes on it.
    let rgb = rgb_of(pixels);
    let encoder = webp::Encoder::from_rgb(&rgb, size[0], size[1]);
    let file = encoder.encode_advanced(&config).map_err(|e| fail(format!("{e:?}")))?;
    Ok(file.to_vec())
}

fn png(pixels: &[u8], size: [u32; 2]) -> Result<Vec<u8>, StreamError> {
    let rgb = rgb_of(pixels);
    let mut out = Vec::with_capacity(rgb.len() / 2);
    PngEncoder::new_with_quality(&mut out, CompressionType::Fast, FilterType::Adaptive)
        .write_image(&rgb, size[0], size[1], image::ExtendedColorType::Rgb8)
        .map_err(|e| StreamError::Encoder { codec: "PNG", detail: e.to_string() })?;
    Ok(out)
}

fn rgb_of(pixels: &[u8]) -> Vec<u8> {
    pixels.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A smooth image with an edge and arbitrary alpha.
    fn test_image(width: u32, height: u32) -> Vec<u8> {
        let pixel = |x: u32, y: u32| {
            let red = if x > width / 2 { 220 } else { 30 };
            [red, (y * 255 / height) as u8, (x * 255 / width) as u8, (x ^ y) as u8]
        };
        (0..height).flat_map(|y| (0..width).flat_map(move |x| pixel(x, y))).collect()
    }

    fn decoded(bytes: &[u8]) -> image::RgbImage {
        image::load_from_memory(bytes).expect("decodes").to_rgb8()
    }

    fn rmse(a: &[u8], b: &[u8]) -> f64 {
        assert_eq!(a.len(), b.len());
        let sum: f64 = a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
        (sum / a.len() as f64).sqrt()
    }

    #[test]
    fn lossless_means_lossless() {
        let pixels = test_image(67, 41);
        for codec in [Codec::Png, Codec::Webp] {
            let bytes = encode(&pixels, [67, 41], codec, Quality::Lossless).expect("encodes");
            assert_eq!(decoded(&bytes).as_raw(), &rgb_of(&pixels), "{codec:?}");
        }
    }

    #[test]
    fn lossy_images_are_close_and_grow_with_quality() {
        let pixels = test_image(128, 96);
        let rgb = rgb_of(&pixels);
        for codec in [Codec::Jpeg, Codec::Webp] {
            let mut last = 0;
            for quality in [30, 60, 95] {
                let bytes = encode(&pixels, [128, 96], codec, Quality::Lossy(quality)).expect("encodes");
                let image = decoded(&bytes);
                assert_eq!((image.width(), image.height()), (128, 96));
                let error = rmse(image.as_raw(), &rgb);
                assert!(error < 9.0, "{codec:?} q{quality}: {error}");
                assert!(bytes.len() > last, "{codec:?} q{quality} is larger than the quality below");
                last = bytes.len();
            }
        }
    }

    #[test]
    fn color_is_full_resolution_from_quality_90() {
        // One-pixel red and blue columns: 4:2:0 mixes them, 4:4:4 does not.
        let pixels: Vec<u8> =
            (0..64 * 64).flat_map(|i| if i % 2 == 0 { [255, 0, 0, 255] } else { [0, 0, 255, 255] }).collect();
        let rgb = rgb_of(&pixels);
        let error = |quality| {
            let bytes = encode(&pixels, [64, 64], Codec::Jpeg, Quality::Lossy(quality)).expect("encodes");
            rmse(decoded(&bytes).as_raw(), &rgb)
        };
        assert!(error(90) < 20.0, "4:4:4 keeps the columns: {}", error(90));
        assert!(error(89) > 60.0, "4:2:0 mixes them: {}", error(89));
    }

    #[test]
    fn wrong_sizes_are_errors() {
        let pixels = test_image(8, 8);
        for size in [[8, 9], [0, 0], [u32::MAX, u32::MAX]] {
            for codec in [Codec::Jpeg, Codec::Webp, Codec::Png] {
                assert!(matches!(encode(&pixels, size, codec, Quality::Lossless), Err(StreamError::Size { .. })));
            }
        }
        let strip = vec![7; 20_000 * 4];
        let too_large = encode(&strip, [20_000, 1], Codec::Webp, Quality::Lossless);
        assert!(matches!(too_large, Err(StreamError::TooLarge { limit: 16_383, .. })));
        assert!(encode(&strip, [20_000, 1], Codec::Png, Quality::Lossless).is_ok());
    }

    #[test]
    fn same_pixels_same_bytes() {
        let pixels = test_image(50, 30);
        for codec in [Codec::Jpeg, Codec::Webp, Codec::Png] {
            let once = encode(&pixels, [50, 30], codec, Quality::Lossy(80)).expect("encodes");
            assert_eq!(once, encode(&pixels, [50, 30], codec, Quality::Lossy(80)).expect("encodes"));
        }
    }
}
