//! Materials of the file turned into [`Material`]s.

use super::check::{clip, finite, invalid, within};
use super::document::{Document, MaterialItem, TextureInfo};
use super::image::TextureLoader;
use crate::{AlphaMode, Material, SceneError, SceneLimits, TextureRef};

/// Converts all materials; the default one is appended where the file has none or a primitive needs it.
pub(crate) fn load_materials(
    document: &Document,
    textures: &mut TextureLoader,
    limits: &SceneLimits,
) -> Result<Vec<Material>, SceneError> {
    within("materials", document.materials.len() as u64, u64::from(limits.max_materials))?;
    let mut materials: Vec<Material> = document
        .materials
        .iter()
        .enumerate()
        .map(|(index, item)| convert(item, index, textures))
        .collect::<Result<_, _>>()?;
    let needs_default = document.meshes.iter().flat_map(|mesh| &mesh.primitives).any(|p| p.material.is_none());
    if materials.is_empty() || needs_default {
        materials.push(Material::default());
    }
    Ok(materials)
}

fn convert(item: &MaterialItem, index: usize, textures: &mut TextureLoader) -> Result<Material, SceneError> {
    let field = |name: &str| format!("materials[{index}].{name}");
    let unit = |value: Option<f64>, default: f64| value.unwrap_or(default).clamp(0.0, 1.0) as f32;
    let pbr = &item.pbr_metallic_roughness;
    let extensions = &item.extensions;
    let mut texture = |info: &Option<TextureInfo>, name: &str| -> Result<Option<TextureRef>, SceneError> {
        info.as_ref().map(|info| texture_ref(info, &field(name), textures)).transpose()
    };

    let strength = extensions.emissive_strength.as_ref().and_then(|e| e.emissive_strength).unwrap_or(1.0);
    let factor = item.emissive_factor.unwrap_or_default();
    let mut emissive = [0.0; 3];
    for (out, value) in emissive.iter_mut().zip(factor) {
        *out = finite(value.max(0.0) * strength.max(0.0), &field("emissiveFactor"))?;
    }
    let alpha_mode = match item.alpha_mode.as_deref() {
        None | Some("OPAQUE") => AlphaMode::Opaque,
        Some("MASK") => {
            AlphaMode::Mask { cutoff: finite(item.alpha_cutoff.unwrap_or(0.5).max(0.0), &field("alphaCutoff"))? }
        }
        Some("BLEND") => AlphaMode::Blend,
        Some(other) => return Err(invalid(field("alphaMode"), format!("{:?} is unknown", clip(other)))),
    };
    let ior = finite(extensions.ior.as_ref().and_then(|e| e.ior).unwrap_or(1.5), &field("KHR_materials_ior.ior"))?;
    if ior != 0.0 && ior < 1.0 {
        return Err(invalid(field("KHR_materials_ior.ior"), format!("is {ior}; it must be 0 or at least 1")));
    }
    let transmission = extensions.transmission.as_ref();
    let volume = extensions.volume.as_ref();
    let distance = volume.and_then(|v| v.attenuation_distance).map_or(f32::INFINITY, |d| d as f32);
    if distance.is_nan() || distance <= 0.0 {
        return Err(invalid(field("KHR_materials_volume.attenuationDistance"), "must be greater than 0"));
    }
    Ok(Material {
        name: item.name.clone().unwrap_or_else(|| format!("material {index}")),
        base_color: pbr.base_color_factor.unwrap_or([1.0; 4]).map(|x| unit(Some(x), 1.0)),
        base_color_texture: texture(&pbr.base_color_texture, "baseColorTexture")?,
        metallic: unit(pbr.metallic_factor, 1.0),
        roughness: unit(pbr.roughness_factor, 1.0),
        metallic_roughness_texture: texture(&pbr.metallic_roughness_texture, "metallicRoughnessTexture")?,
        normal_texture: texture(&item.normal_texture, "normalTexture")?,
        normal_scale: finite(
            item.normal_texture.as_ref().and_then(|t| t.scale).unwrap_or(1.0),
            &field("normalTexture.scale"),
        )?,
        occlusion_texture: texture(&item.occlusion_texture, "occlusionTexture")?,
        occlusion_strength: unit(item.occlusion_texture.as_ref().and_then(|t| t.strength), 1.0),
        emissive,
        emissive_texture: texture(&item.emissive_texture, "emissiveTexture")?,
        alpha_mode,
        double_sided: item.double_sided,
        ior,
        transmission: unit(transmission.and_then(|t| t.transmission_factor), 0.0),
        transmission_texture: match transmission {
            Some(transmission) => texture(&transmission.transmission_texture, "transmissionTexture")?,
            None => None,
        },
        is_volume: volume.and_then(|v| v.thickness_factor).unwrap_or(0.0) > 0.0,
        attenuation_distance: distance,
        attenuation_color: volume.and_then(|v| v.attenuation_color).unwrap_or([1.0; 3]).map(|x| unit(Some(x), 1.0)),
        unlit: extensions.unlit.is_some(),
    })
}

fn texture_ref(info: &TextureInfo, field: &str, textures: &mut TextureLoader) -> Result<TextureRef, SceneError> {
    let transform = info.extensions.transform.as_ref();
    let uv_set = transform.and_then(|t| t.tex_coord).unwrap_or(info.tex_coord);
    if uv_set > 1 {
        return Err(invalid(format!("{field}.texCoord"), format!("is {uv_set}; two sets (0 and 1) are supported")));
    }
    let [tx, ty] = transform.and_then(|t| t.offset).unwrap_or_default();
    let [sx, sy] = transform.and_then(|t| t.scale).unwrap_or([1.0; 2]);
    let (sin, cos) = transform.and_then(|t| t.rotation).unwrap_or_default().sin_cos();
    let narrow = |x: f64| finite(x, &format!("{field}.KHR_texture_transform"));
    Ok(TextureRef {
        texture: textures.request(info.index),
        uv_set,
        transform: [
            [narrow(cos * sx)?, narrow(sin * sy)?, narrow(tx)?],
            [narrow(-sin * sx)?, narrow(cos * sy)?, narrow(ty)?],
        ],
    })
}
