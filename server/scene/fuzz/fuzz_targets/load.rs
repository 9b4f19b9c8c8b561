//! Any bytes: as an uploaded scene, as a view file and as an environment map.
#![no_main]

use libfuzzer_sys::fuzz_target;
use surfelcast_scene::{EnvironmentMap, LoadOptions, SceneLimits, ViewFile, load_bytes};

fuzz_target!(|bytes: &[u8]| {
    let limits = SceneLimits {
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
    };
    let _ = EnvironmentMap::decode(bytes, &limits);
    let _ = ViewFile::parse(bytes);
    let _ = load_bytes(bytes, "fuzz", &LoadOptions { limits, ..LoadOptions::default() });
});
