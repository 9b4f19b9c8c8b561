//! glTF 2.0 materials and textures.

use std::sync::Arc;

/// How the alpha channel of the base colour is used.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum AlphaMode {
    /// Ignored.
    #[default]
    Opaque,
    /// Surface exists where alpha is at least the cutoff, after filtering.
    Mask {
        /// Threshold.
        cutoff: f32,
    },
    /// The share `1 - alpha` of the light passes straight through.
    Blend,
}

/// Use of a texture by a material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureRef {
    /// Index into [`crate::Scene::textures`].
    pub texture: u32,
    /// Texture coordinate set, 0 or 1.
    pub uv_set: u32,
    /// Affine map of texture coordinates (KHR_texture_transform), rows `[a, b, tx], [c, d, ty]`:
    /// `u' = a u + b v + tx`, `v' = c u + d v + ty`. Identity where there is none.
    pub transform: [[f32; 3]; 2],
}

/// One glTF material with its extensions. Colours are linear.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name in the file, else `material N`.
    pub name: String,
    /// Base colour factor, linear RGB and alpha, each in [0, 1].
    pub base_color: [f32; 4],
    /// Base colour texture: sRGB colour, linear alpha.
    pub base_color_texture: Option<TextureRef>,
    /// Metalness factor in [0, 1].
    pub metallic: f32,
    /// Perceptual roughness factor in [0, 1]; GGX alpha is its square.
    pub roughness: f32,
    /// G = roughness, B = metalness, linear.
    pub metallic_roughness_texture: Option<TextureRef>,
    /// Tangent-space normal map.
    pub normal_texture: Option<TextureRef>,
    /// Scale of the normal map's x and y.
    pub normal_scale: f32,
    /// Occlusion map (R). A path tracer computes occlusion, so it is loaded for other techniques and debug views only.
    pub occlusion_texture: Option<TextureRef>,
    /// Strength of the occlusion map in [0, 1].
    pub occlusion_strength: f32,
    /// Emitted radiance: factor x KHR_materials_emissive_strength. Leaves the front (counter-clockwise) side only.
    pub emissive: [f32; 3],
    /// Emission texture, sRGB.
    pub emissive_texture: Option<TextureRef>,
    /// Alpha mode.
    pub alpha_mode: AlphaMode,
    /// The file's `doubleSided`. Light transport is always two-sided; for other uses.
    pub double_sided: bool,
    /// Index of refraction (KHR_materials_ior), 1.5 by default; 0 means total reflection and is kept as given.
    pub ior: f32,
    /// Share of light that enters the surface instead of being scattered diffusely (KHR_materials_transmission).
    pub transmission: f32,
    /// Transmission texture (R), linear.
    pub transmission_texture: Option<TextureRef>,
    /// Whether KHR_materials_volume gives the surface an inside (thickness > 0); else transmission is thin-walled.
    pub is_volume: bool,
    /// Distance at which white light has taken on the attenuation colour, metres; infinite where there is none.
    pub attenuation_distance: f32,
    /// Attenuation colour.
    pub attenuation_color: [f32; 3],
    /// KHR_materials_unlit: the base colour is shown as it is and the surface does not take part in lighting.
    pub unlit: bool,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: "default".to_owned(),
            base_color: [1.0; 4],
            base_color_texture: None,
            metallic: 1.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            occlusion_texture: None,
            occlusion_strength: 1.0,
            emissive: [0.0; 3],
            emissive_texture: None,
            alpha_mode: AlphaMode::Opaque,
            double_sided: false,
            ior: 1.5,
            transmission: 0.0,
            transmission_texture: None,
            is_volume: false,
            attenuation_distance: f32::INFINITY,
            attenuation_color: [1.0; 3],
            unlit: false,
        }
    }
}

/// Texture wrapping of one axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Wrap {
    /// Repeat.
    #[default]
    Repeat,
    /// Repeat, mirrored every other time.
    MirroredRepeat,
    /// Clamp to the edge texel.
    ClampToEdge,
}

/// An image with its sampler: RGBA, 8 bits a channel as stored in the file (colour space is the user's matter:
/// base colour and emission are sRGB, all others linear). Filtering is on the full image; there are no mip levels.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Columns.
    pub width: u32,
    /// Rows; row 0 is at v = 0.
    pub height: u32,
    /// `width * height * 4` bytes, row-major RGBA. Shared between textures that use one image.
    pub texels: Arc<[u8]>,
    /// Wrapping of u.
    pub wrap_u: Wrap,
    /// Wrapping of v.
    pub wrap_v: Wrap,
    /// Bilinear (after decoding) or nearest.
    pub is_linear: bool,
}
