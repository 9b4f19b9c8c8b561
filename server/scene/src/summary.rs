//! What a scene contains, counted once, so that passes it does not need are never made.

use crate::{AlphaMode, Environment, Scene};

/// Counts and flags over a whole scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct SceneSummary {
    /// Triangles in stable order, instances not multiplied.
    pub triangle_count: u32,
    /// Placed hierarchies, the baked one included.
    pub instance_count: u32,
    /// Materials.
    pub material_count: u32,
    /// Textures.
    pub texture_count: u32,
    /// Emissive triangles with positive area and radiance.
    pub emissive_triangle_count: u32,
    /// Punctual lights with positive intensity.
    pub punctual_light_count: u32,
    /// A constant or image environment that is not black.
    pub has_environment: bool,
    /// Any base colour, roughness, normal, emission or transmission texture.
    pub has_textures: bool,
    /// Any normal map.
    pub has_normal_maps: bool,
    /// Any vertex colours.
    pub has_vertex_colors: bool,
    /// Any MASK or BLEND material.
    pub has_alpha: bool,
    /// Any transmissive material.
    pub has_transmission: bool,
    /// Any unlit material.
    pub has_unlit: bool,
    /// Any material that is not a plain Lambertian in `pbr` mode (practically always).
    pub has_glossy: bool,
    /// Any instance besides the baked geometry.
    pub has_instances: bool,
    /// The file has animations, skins or morph targets (posed once at load time).
    pub has_animation: bool,
}

impl SceneSummary {
    /// Counts a scene. Only materials that geometry uses set flags.
    pub(crate) fn of(scene: &Scene, has_animation: bool) -> Self {
        let geometries = &scene.geometry.geometries;
        let mut used = vec![false; scene.materials.len()];
        for geometry in geometries {
            used[geometry.material as usize] = true;
        }
        let materials = || scene.materials.iter().zip(&used).filter(|(_, used)| **used).map(|(material, _)| material);
        let has_radiance = |radiance: &[f32; 3]| radiance.iter().any(|&x| x > 0.0);
        let emitters = scene.emissive_triangles.iter().filter(|t| t.area > 0.0 && has_radiance(&t.mean_radiance));
        Self {
            triangle_count: scene.geometry.triangles.len() as u32,
            instance_count: scene.geometry.instances.len() as u32,
            material_count: scene.materials.len() as u32,
            texture_count: scene.textures.len() as u32,
            emissive_triangle_count: emitters.count() as u32,
            punctual_light_count: scene.punctual_lights.iter().filter(|l| has_radiance(&l.intensity)).count() as u32,
            has_environment: match &scene.environment {
                Environment::None => false,
                Environment::Constant(radiance) => has_radiance(radiance),
                Environment::Map(map) => map.radiance.iter().any(has_radiance),
            },
            has_textures: materials().any(|m| {
                let shading = [&m.base_color_texture, &m.metallic_roughness_texture, &m.normal_texture];
                shading.into_iter().chain([&m.emissive_texture, &m.transmission_texture]).any(Option::is_some)
            }),
            has_normal_maps: materials().any(|m| m.normal_texture.is_some()),
            has_vertex_colors: geometries.iter().any(|geometry| geometry.has_colors),
            has_alpha: materials().any(|m| m.alpha_mode != AlphaMode::Opaque),
            has_transmission: materials().any(|m| m.transmission > 0.0),
            has_unlit: materials().any(|m| m.unlit),
            // glTF's dielectrics reflect 4 % specularly whatever the roughness
            has_glossy: materials().any(|m| !m.unlit),
            has_instances: scene.geometry.instances.len() > usize::from(scene.geometry.baked_instance.is_some()),
            has_animation,
        }
    }
}
