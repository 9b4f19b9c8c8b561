//! What a scene contains, counted once, so that passes it does not need are never made.

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
