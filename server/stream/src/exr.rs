//! OpenEXR: linear radiance, unexposed, 32-bit floats, ZIP.

use std::io::Cursor;

use exr::prelude::{Compression, Encoding, Image, LineOrder, SpecificChannels, Vec2, WritableImage};

use crate::StreamError;

/// Encodes linear RGB of `size` (width, height), first row on top, as scan lines with ZIP compression. The same pixels
/// give the same bytes.
pub fn encode_exr(pixels: &[[f32; 3]], size: [u32; 2]) -> Result<Vec<u8>, StreamError> {
    let [width, height] = size;
    let needed = u64::from(width) * u64::from(height);
    if needed != pixels.len() as u64 || needed == 0 {
        return Err(StreamError::Size { width, height, needed, present: pixels.len() as u64 });
    }
    let columns = width as usize;
    let channels = SpecificChannels::rgb(|at: Vec2<usize>| {
        let [r, g, b] = pixels[at.y() * columns + at.x()];
        (r, g, b)
    });
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: exr::prelude::Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let image = Image::from_encoded_channels((columns, height as usize), encoding, channels);
    let mut out = Cursor::new(Vec::new());
    image.write().to_buffered(&mut out).map_err(|e| StreamError::Encoder { codec: "EXR", detail: e.to_string() })?;
    Ok(out.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_survive_exactly() {
        let pixels: Vec<[f32; 3]> = (0..37 * 23).map(|i| [i as f32 * 0.37, 1e-8 * i as f32, 1e6 - i as f32]).collect();
        let bytes = encode_exr(&pixels, [37, 23]).expect("encodes");
        assert_eq!(bytes, encode_exr(&pixels, [37, 23]).expect("encodes"), "same pixels, same bytes");
        let path = std::env::temp_dir().join(format!("surfelcast-exr-{}.exr", std::process::id()));
        std::fs::write(&path, &bytes).expect("writes");
        let read = exr::prelude::read_first_rgba_layer_from_file(
            &path,
            |size: Vec2<usize>, _: &_| vec![vec![[0f32; 3]; size.width()]; size.height()],
            |rows, at, (r, g, b, _): (f32, f32, f32, f32)| rows[at.y()][at.x()] = [r, g, b],
        )
        .expect("decodes");
        std::fs::remove_file(&path).expect("removes");
        let rows = &read.layer_data.channel_data.pixels;
        let flat: Vec<[f32; 3]> = rows.iter().flatten().copied().collect();
        assert_eq!(flat, pixels);
    }

    #[test]
    fn wrong_sizes_are_errors() {
        assert!(encode_exr(&[[0.0; 3]; 6], [2, 2]).is_err());
        assert!(encode_exr(&[], [0, 0]).is_err());
    }
}
