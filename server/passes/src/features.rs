//! Structural switches from what is in the scene. The one place that decides them.

use surfelcast_scene::SceneSummary;
use surfelcast_shaders::{Feature, Features};

use crate::materials::MaterialMode;

/// Switches a picture of this scene needs.
pub fn features_for(
    summary: &SceneSummary,
    materials: MaterialMode,
    has_punctual_lights: bool,
    is_split: bool,
) -> Features {
    let is_pbr = materials == MaterialMode::Pbr;
    let switches = [
        (Feature::Instances, summary.has_instances),
        (Feature::Textures, summary.has_textures),
        (Feature::NormalMaps, is_pbr && summary.has_normal_maps),
        (Feature::VertexColors, summary.has_vertex_colors),
        (Feature::Alpha, summary.has_alpha),
        (Feature::Transmission, is_pbr && summary.has_transmission),
        (Feature::Environment, summary.has_environment),
        (Feature::EmissiveTriangles, summary.emissive_triangle_count > 0),
        (Feature::PunctualLights, has_punctual_lights),
        (Feature::Pbr, is_pbr),
        (Feature::Unlit, is_pbr && summary.has_unlit),
        (Feature::Split, is_split),
    ];
    switches.into_iter().filter(|(_, is_on)| *is_on).fold(Features::NONE, |set, (feature, _)| set.with(feature))
}

/// The variant that serves any scene with these materials.
pub fn general_features(materials: MaterialMode, is_split: bool) -> Features {
    // How a cache is applied is chosen, whatever the scene.
    let any_scene = Features::ALL.without(Feature::Splat);
    any_scene.set(Feature::Pbr, materials == MaterialMode::Pbr).set(Feature::Split, is_split)
}

/// Parts of the kernels that were left out, with the reason, for the statistics.
pub fn skipped_parts(features: Features) -> Vec<(&'static str, &'static str)> {
    const REASONS: [(Feature, &str, &str); 9] = [
        (Feature::Instances, "top_level_traversal", "all geometry is in one hierarchy"),
        (Feature::Textures, "texture_lookup", "no textures"),
        (Feature::NormalMaps, "normal_mapping", "no normal maps, or lambert materials"),
        (Feature::VertexColors, "vertex_color", "no vertex colours"),
        (Feature::Alpha, "alpha_test", "no masked or blended material"),
        (Feature::Transmission, "transmission", "no transmissive material, or lambert materials"),
        (Feature::Environment, "environment", "no environment"),
        (Feature::EmissiveTriangles, "emissive_triangles", "no emissive material"),
        (Feature::PunctualLights, "punctual_lights", "no punctual light"),
    ];
    REASONS
        .into_iter()
        .filter(|(feature, ..)| !features.contains(*feature))
        .map(|(_, name, reason)| (name, reason))
        .collect()
}
