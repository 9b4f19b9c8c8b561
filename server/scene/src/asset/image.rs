//! Images and textures: PNG, JPEG and (with EXT_texture_webp) WebP, sized from the header before decoding.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use rayon::prelude::*;

use super::accessor::Reader;
use super::check::{invalid, within};
use super::document::item;
use super::source::Source;
use crate::{SceneError, SceneLimits, Texture, Wrap};

/// Decoded RGBA image.
struct Decoded {
    width: u32,
    height: u32,
    texels: Arc<[u8]>,
}

/// Collects the textures that materials use and loads each image once.
pub(crate) struct TextureLoader {
    /// Texture of the file -> texture of the scene.
    indices: BTreeMap<usize, u32>,
    /// Textures of the file in the order they were first requested.
    wanted: Vec<usize>,
}

impl TextureLoader {
    pub(crate) fn new() -> Self {
        Self { indices: BTreeMap::new(), wanted: Vec::new() }
    }

    /// Index in [`crate::Scene::textures`] of a texture of the file.
    pub(crate) fn request(&mut self, texture: usize) -> u32 {
        *self.indices.entry(texture).or_insert_with(|| {
            self.wanted.push(texture);
            (self.wanted.len() - 1) as u32
        })
    }

    /// Loads everything requested.
    pub(crate) fn load(
        self,
        reader: &Reader<'_>,
        source: &mut Source,
        limits: &SceneLimits,
    ) -> Result<Vec<Texture>, SceneError> {
        let document = reader.document;
        let mut slots: BTreeMap<usize, usize> = BTreeMap::new();
        let mut encoded: Vec<(usize, bool, Cow<'_, [u8]>)> = Vec::new();
        let mut images = Vec::new();
        for &texture in &self.wanted {
            let field = format!("textures[{texture}]");
            let texture = item(&document.textures, texture, "textures", "materials")?;
            let webp = texture.extensions.webp.as_ref().map(|webp| webp.source);
            let Some(image) = webp.or(texture.source) else {
                return Err(invalid(format!("{field}.source"), "is missing; only PNG, JPEG and WebP images are read"));
            };
            if let Some(&slot) = slots.get(&image) {
                images.push(slot);
                continue;
            }
            let field = format!("images[{image}]");
            let described = item(&document.images, image, "images", &field)?;
            let bytes = match (&described.uri, described.buffer_view) {
                (_, Some(view)) => Cow::Borrowed(reader.view(view, &field)?),
                (Some(uri), None) => Cow::Owned(source.resolve(uri, &format!("{field}.uri"))?),
                (None, None) => return Err(invalid(field, "has neither a uri nor a bufferView")),
            };
            slots.insert(image, encoded.len());
            images.push(encoded.len());
            encoded.push((image, webp.is_some(), bytes));
        }
        let mut texel_bytes = 0u64;
        for (image, is_webp, bytes) in &encoded {
            let (width, height) = dimensions(*image, *is_webp, bytes, limits)?;
            texel_bytes = texel_bytes.saturating_add(u64::from(width) * u64::from(height) * 4);
            within(&format!("bytes of decoded images (at images[{image}])"), texel_bytes, limits.max_texel_bytes)?;
        }
        let decoded: Vec<Decoded> = encoded
            .par_iter()
            .map(|(image, is_webp, bytes)| decode(*image, *is_webp, bytes, limits))
            .collect::<Result<_, _>>()?;
        let mut textures = Vec::with_capacity(self.wanted.len());
        for (&texture, &slot) in self.wanted.iter().zip(&images) {
            let image = &decoded[slot];
            let (mut wrap_u, mut wrap_v, mut is_linear) = (Wrap::Repeat, Wrap::Repeat, true);
            if let Some(sampler) = document.textures[texture].sampler {
                let field = format!("textures[{texture}].sampler");
                let chosen = item(&document.samplers, sampler, "samplers", &field)?;
                wrap_u = wrap(chosen.wrap_s, &format!("samplers[{sampler}].wrapS"))?;
                wrap_v = wrap(chosen.wrap_t, &format!("samplers[{sampler}].wrapT"))?;
                is_linear = chosen.mag_filter != Some(9728);
            }
            textures.push(Texture {
                width: image.width,
                height: image.height,
                texels: Arc::clone(&image.texels),
                wrap_u,
                wrap_v,
                is_linear,
            });
        }
        Ok(textures)
    }
}

fn wrap(code: Option<u32>, field: &str) -> Result<Wrap, SceneError> {
    match code {
        None | Some(10497) => Ok(Wrap::Repeat),
        Some(33648) => Ok(Wrap::MirroredRepeat),
        Some(33071) => Ok(Wrap::ClampToEdge),
        Some(other) => Err(invalid(field, format!("{other} is not a wrapping mode"))),
    }
}

fn open<'a>(
    image: usize,
    is_webp: bool,
    bytes: &'a [u8],
    limits: &SceneLimits,
) -> Result<impl ImageDecoder + 'a, SceneError> {
    let field = || format!("images[{image}]");
    let format = image::guess_format(bytes).ok();
    let is_allowed = match format {
        Some(ImageFormat::Png | ImageFormat::Jpeg) => true,
        Some(ImageFormat::WebP) => is_webp,
        _ => false,
    };
    let Some(format) = format.filter(|_| is_allowed) else {
        return Err(invalid(field(), "is not PNG or JPEG (or WebP by EXT_texture_webp)"));
    };
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut strict = image::Limits::default();
    strict.max_image_width = Some(limits.max_image_side);
    strict.max_image_height = Some(limits.max_image_side);
    // 16-bit RGBA plus the decoder's own buffers; the exact size is checked from the header by the caller.
    strict.max_alloc = Some(limits.max_texel_bytes.saturating_mul(4).saturating_add(1 << 20));
    reader.limits(strict);
    reader.into_decoder().map_err(|error| invalid(field(), format!("cannot be decoded: {error}")))
}

fn dimensions(image: usize, is_webp: bool, bytes: &[u8], limits: &SceneLimits) -> Result<(u32, u32), SceneError> {
    let contained = catch_unwind(AssertUnwindSafe(|| Ok(open(image, is_webp, bytes, limits)?.dimensions())));
    let (width, height) = contained.unwrap_or_else(|_| Err(invalid(format!("images[{image}]"), "is broken")))?;
    within(&format!("images[{image}] width"), u64::from(width), u64::from(limits.max_image_side))?;
    within(&format!("images[{image}] height"), u64::from(height), u64::from(limits.max_image_side))?;
    if width == 0 || height == 0 {
        return Err(invalid(format!("images[{image}]"), "is empty"));
    }
    Ok((width, height))
}

/// Decodes to 8-bit RGBA. A panic inside a codec becomes an error of this image.
fn decode(image: usize, is_webp: bool, bytes: &[u8], limits: &SceneLimits) -> Result<Decoded, SceneError> {
    let field = || format!("images[{image}]");
    let contained = catch_unwind(AssertUnwindSafe(|| {
        let decoder = open(image, is_webp, bytes, limits)?;
        DynamicImage::from_decoder(decoder).map_err(|error| invalid(field(), format!("cannot be decoded: {error}")))
    }));
    let picture = contained.unwrap_or_else(|_| Err(invalid(field(), "is broken")))?.into_rgba8();
    let (width, height) = picture.dimensions();
    Ok(Decoded { width, height, texels: picture.into_raw().into() })
}
