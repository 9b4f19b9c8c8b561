//! The file formats of renders.

use surfelcast_renderer::RenderOutput;
use surfelcast_stream::{Codec, Quality, StreamError, encode, encode_exr, tone_map_to_rgba8};

/// JPEG and WebP quality of renders.
const IMAGE_QUALITY: u8 = 92;

/// A file format of renders.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum ImageFormat {
    Png,
    Jpeg,
    Webp,
    /// Linear values, unexposed.
    Exr,
}

impl ImageFormat {
    pub(crate) const ALL: [Self; 4] = [Self::Png, Self::Jpeg, Self::Webp, Self::Exr];

    /// Formats of radiance, or of another output: numbers as they are, or an image to look at.
    pub(crate) fn of_output(is_data: bool) -> &'static [Self] {
        if is_data { &[Self::Exr, Self::Png] } else { &Self::ALL }
    }

    pub(crate) fn mime(self) -> &'static str {
        match self {
            Self::Png => "image/png",
            Self::Jpeg => "image/jpeg",
            Self::Webp => "image/webp",
            Self::Exr => "image/x-exr",
        }
    }

    /// File extension, which is also the end of the entity tag.
    pub(crate) fn extension(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Jpeg => "jpg",
            Self::Webp => "webp",
            Self::Exr => "exr",
        }
    }

    /// The output as a file.
    pub(crate) fn encode(self, output: &RenderOutput, exposure: f32) -> Result<Vec<u8>, StreamError> {
        let display =
            |codec, quality| encode(&tone_map_to_rgba8(&output.pixels, exposure), output.size, codec, quality);
        match self {
            Self::Exr => encode_exr(&output.pixels, output.size),
            Self::Png => display(Codec::Png, Quality::Lossless),
            Self::Jpeg => display(Codec::Jpeg, Quality::Lossy(IMAGE_QUALITY)),
            Self::Webp => display(Codec::Webp, Quality::Lossy(IMAGE_QUALITY)),
        }
    }
}
