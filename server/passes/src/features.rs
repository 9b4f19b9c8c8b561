//! Feature switches of kernels, derived from the content of the scene. Nothing else derives them.

use surfelcast_scene::SceneSummary;
use surfelcast_shaders::Features;

use crate::materials::MaterialMode;

/// Switches that an image of this scene needs.
pub fn features_for(
    summary: &SceneSummary,
    materials: MaterialMode,
    has_punctual_lights: bool,
    is_split: bool,
) -> Features {
    let is_pbr = materials == MaterialMode::Pbr;
    let switches = [
        (Features::INSTANCES, summary.has_instances),
        (Features::TEXTURES, summary.has_textures),
        (Features::NORMAL_MAPS, is_pbr && summary.has_normal_maps),
        (Features::VERTEX_COLORS, summary.has_vertex_colors),
        (Features::ALPHA, summary.has_alpha),
        (Features::TRANSMISSION, is_pbr && summary.has_transmission),
        (Features::ENVIRONMENT, summary.has_environment),
        (Features::EMISSIVE_TRIANGLES, summary.emissive_triangle_count > 0),
        (Features::PUNCTUAL_LIGHTS, has_punctual_lights),
        (Features::PBR, is_pbr),
        (Features::UNLIT, is_pbr && summary.has_unlit),
        (Features::SPLIT, is_split),
    ];
    switches.into_iter().filter(|(_, is_on)| *is_on).map(|(feature, _)| feature).collect()
}

/// The variant that serves any scene with these materials.
pub fn general_features(materials: MaterialMode, is_split: bool) -> Features {
    // The alternate form of a kernel is chosen by the technique, not by the scene.
    let any_scene = Features::ALL.with(Features::ALTERNATE, false);
    any_scene.with(Features::PBR, materials == MaterialMode::Pbr).with(Features::SPLIT, is_split)
}

/// Parts that are compiled out of the kernels, with the reason, for the statistics.
pub fn skipped_parts(features: Features) -> Vec<(&'static str, &'static str)> {
    const REASONS: [(Features, &str, &str); 9] = [
        (Features::INSTANCES, "top_level_traversal", "all geometry is in one hierarchy"),
        (Features::TEXTURES, "texture_lookup", "no textures"),
        (Features::NORMAL_MAPS, "normal_mapping", "no normal maps, or lambert materials"),
        (Features::VERTEX_COLORS, "vertex_color", "no vertex colours"),
        (Features::ALPHA, "alpha_test", "no masked or blended material"),
        (Features::TRANSMISSION, "transmission", "no transmissive material, or lambert materials"),
        (Features::ENVIRONMENT, "environment", "no environment"),
        (Features::EMISSIVE_TRIANGLES, "emissive_triangles", "no emissive material"),
        (Features::PUNCTUAL_LIGHTS, "punctual_lights", "no punctual light"),
    ];
    REASONS
        .into_iter()
        .filter(|(feature, ..)| !features.contains(*feature))
        .map(|(_, name, reason)| (name, reason))
        .collect()
}
