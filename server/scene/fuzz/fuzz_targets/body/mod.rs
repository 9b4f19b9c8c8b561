//! What the fuzz target does with its input. The tests of the scene crate run it over their seeds and mutations.

use surfelcast_scene::{EnvironmentMap, LoadOptions, SceneLimits, ViewFile, load_bytes};

/// Limits low enough that no accepted file takes long.
pub(crate) fn limits() -> SceneLimits {
    SceneLimits {
        max_file_bytes: 1 << 20,
        max_json_bytes: 1 << 20,
        max_vertices: 20_000,
        max_triangles: 20_000,
        max_nodes: 1000,
        max_node_depth: 32,
        max_instances: 1000,
        max_materials: 100,
        max_image_side: 512,
        max_texel_bytes: 4 << 20,
        max_punctual_lights: 100,
        max_environment_pixels: 1 << 16,
    }
}

/// Reads the bytes as every kind of file that an upload or the command line accepts.
pub(crate) fn load(bytes: &[u8]) {
    let limits = limits();
    let _ = EnvironmentMap::decode(bytes, &limits);
    let _ = ViewFile::parse(bytes);
    let _ = load_bytes(bytes, "fuzz", &LoadOptions { limits, ..LoadOptions::default() });
}
