//! Materials and textures as kernels read them.

use std::sync::Arc;

use surfelcast_scene::{AlphaMode, Material, Scene, Texture, TextureRef, Wrap};
use surfelcast_shaders::records::{MaterialRecord, TextureUse, material_flags};

use super::NO_INDEX;

/// Textures with distinct images, in order of first use.
pub(super) fn unique_images(textures: &[Texture]) -> Vec<&Texture> {
    let mut unique: Vec<&Texture> = Vec::new();
    for texture in textures {
        if !unique.iter().any(|other| Arc::ptr_eq(&other.texels, &texture.texels)) {
            unique.push(texture);
        }
    }
    unique
}

/// Materials, their uses of textures, and the texels of all images.
pub(super) fn material_records(scene: &Scene) -> (Vec<MaterialRecord>, Vec<TextureUse>, Vec<u32>) {
    let mut texels: Vec<u32> = Vec::new();
    let mut offsets: Vec<u32> = Vec::with_capacity(scene.textures.len());
    let mut placed: Vec<(*const u8, u32)> = Vec::new();
    for texture in &scene.textures {
        let pointer = texture.texels.as_ptr();
        let known = placed.iter().find(|(other, _)| *other == pointer).map(|(_, offset)| *offset);
        let offset = known.unwrap_or_else(|| {
            let offset = texels.len() as u32;
            texels.extend(texture.texels.chunks_exact(4).map(|p| u32::from_le_bytes([p[0], p[1], p[2], p[3]])));
            placed.push((pointer, offset));
            offset
        });
        offsets.push(offset);
    }
    let mut uses = Vec::new();
    let mut add_use = |reference: &Option<TextureRef>| {
        let Some(reference) = reference else { return NO_INDEX };
        let texture = &scene.textures[reference.texture as usize];
        let wrap = |mode| match mode {
            Wrap::Repeat => 0u32,
            Wrap::MirroredRepeat => 1,
            Wrap::ClampToEdge => 2,
        };
        let row = |[x, y, t]: [f32; 3]| [x, y, t, 0.0];
        uses.push(TextureUse {
            offset: offsets[reference.texture as usize],
            width: texture.width,
            height: texture.height,
            flags: wrap(texture.wrap_u)
                | wrap(texture.wrap_v) << 2
                | u32::from(texture.is_linear) << 4
                | (reference.uv_set & 1) << 5,
            row_u: row(reference.transform[0]),
            row_v: row(reference.transform[1]),
        });
        uses.len() as u32 - 1
    };
    let records = scene
        .materials
        .iter()
        .map(|material| MaterialRecord {
            base_color: material.base_color,
            emission: material.emissive,
            metallic: material.metallic,
            absorption: absorption(material),
            roughness: material.roughness,
            ior: material.ior,
            transmission: material.transmission,
            normal_scale: material.normal_scale,
            alpha_cutoff: match material.alpha_mode {
                AlphaMode::Mask { cutoff } => cutoff.max(0.0),
                AlphaMode::Opaque | AlphaMode::Blend => -1.0,
            },
            base_color_texture: add_use(&material.base_color_texture),
            metallic_roughness_texture: add_use(&material.metallic_roughness_texture),
            normal_texture: add_use(&material.normal_texture),
            emission_texture: add_use(&material.emissive_texture),
            transmission_texture: add_use(&material.transmission_texture),
            flags: (u32::from(material.unlit) * material_flags::UNLIT)
                | (u32::from(material.is_volume) * material_flags::VOLUME)
                | (u32::from(material.alpha_mode != AlphaMode::Opaque) * material_flags::ALPHA)
                | (u32::from(material.emissive.iter().any(|&c| c > 0.0)) * material_flags::EMISSIVE),
            padding0: 0,
            padding1: 0,
        })
        .collect();
    (records, uses, texels)
}

/// Absorption coefficient of a volume from the colour white light takes on over the attenuation distance
/// (Beer-Lambert).
fn absorption(material: &Material) -> [f32; 3] {
    if !material.is_volume || !material.attenuation_distance.is_finite() || material.attenuation_distance <= 0.0 {
        return [0.0; 3];
    }
    // Black would absorb infinitely; 1e-6 is black to eight bits and keeps the exponential finite.
    material.attenuation_color.map(|c| -c.clamp(1e-6, 1.0).ln() / material.attenuation_distance)
}
