//! Loads every scene of the shared test set and compares its counts with the set's own table. Skips where it is absent
//! (`SURFELCAST_SHARED` or `../shared` beside the repository).
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::print_stderr,
    clippy::disallowed_methods,
    clippy::needless_for_each,
    clippy::unreadable_literal,
    clippy::trivially_copy_pass_by_ref,
    reason = "a test may stop at the first surprise and talk to its terminal"
)]

use std::path::{Path, PathBuf};

use surfelcast_scene::{Environment, LoadOptions, load_file};

fn shared_scenes() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let root = std::env::var_os("SURFELCAST_SHARED").map_or(beside, PathBuf::from).join("scenes");
    if root.is_dir() {
        return Some(root);
    }
    eprintln!("skipped: {} is absent", root.display());
    None
}

/// Name, triangles, textures, emissive triangles, punctual lights, sky.
const TABLE: [(&str, u32, u32, u32, u32, bool); 22] = [
    ("bars", 1638, 0, 2, 0, false),
    ("classroom", 103_832, 3, 0, 1, true),
    ("cornell_box", 32, 0, 2, 0, false),
    ("cornell_glossy", 2240, 0, 2, 0, false),
    ("far_origin", 3346, 0, 2, 1, false),
    ("feature_alpha", 20, 4, 4, 0, true),
    ("feature_metal_rough", 83_336, 0, 4, 0, true),
    ("feature_punctual", 2226, 0, 0, 3, false),
    ("feature_transmission", 29_526, 0, 2, 0, true),
    ("furnace_box", 984, 0, 984, 0, false),
    ("furnace_sphere", 3968, 0, 0, 0, true),
    ("furnace_white_spheres", 8832, 0, 0, 0, true),
    ("khr_alpha_blend_mode", 67, 9, 2, 0, true),
    ("khr_animated_morph_cube", 18, 0, 2, 0, true),
    ("khr_cesium_man", 4678, 1, 2, 0, true),
    ("khr_damaged_helmet", 15_458, 5, 15_454, 0, true),
    ("khr_texture_settings", 74, 3, 2, 0, true),
    ("many_lights", 3832, 0, 2000, 400, false),
    ("maze_small", 1156, 0, 4, 0, false),
    ("sponza", 66_445, 10, 0, 1, true),
    ("terrain", 166_288, 0, 0, 1, true),
    ("tiny", 3346, 0, 2, 0, false),
];

#[test]
fn counts_match_the_table() {
    let Some(folder) = shared_scenes() else { return };
    for (name, triangles, textures, emissive, punctual, has_sky) in TABLE {
        let scene = load_file(&folder.join(format!("{name}.glb")), &LoadOptions::default())
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        let summary = scene.summary;
        println!(
            "{name}: load {:.3} s, build {:.3} s, stack {}, {} nodes, {} leaf triangles, {:?}, {summary:?}",
            scene.load_secs,
            scene.build_secs,
            scene.geometry.stack_depth,
            scene.geometry.nodes.len(),
            scene.geometry.bvh_triangles.len(),
            scene.warnings
        );
        assert_eq!(summary.triangle_count, triangles, "{name}");
        assert_eq!(scene.emissive_triangles.len() as u32, emissive, "{name}");
        assert_eq!(summary.punctual_light_count, punctual, "{name}");
        assert_eq!(summary.has_environment, has_sky, "{name}");
        let images: std::collections::BTreeSet<_> = scene.textures.iter().map(|t| t.texels.as_ptr()).collect();
        assert_eq!(images.len() as u32, textures, "{name}");
        assert!(!scene.cameras.is_empty() && scene.cameras.iter().all(|camera| camera.camera.is_valid()), "{name}");
        assert!(scene.geometry.stack_depth <= surfelcast_scene::bvh::MAX_STACK_DEPTH, "{name}");
    }
}

#[test]
fn view_files_are_read_beside_the_scene() {
    let Some(folder) = shared_scenes() else { return };
    let scene = load_file(&folder.join("sponza.glb"), &LoadOptions::default()).unwrap();
    assert_eq!(scene.environment, Environment::Constant([1.1, 1.35, 1.7]));
    assert_eq!(scene.cameras[0].name, "atrium");
    assert_eq!(scene.cameras[0].resolution, Some([320, 180]));
    assert_eq!(scene.exposure_for("atrium"), 0.7);
}

#[test]
fn far_translations_keep_local_precision() {
    let Some(folder) = shared_scenes() else { return };
    let far = load_file(&folder.join("far_origin.glb"), &LoadOptions::default()).unwrap();
    // its light bulb stands at (-2.2, 0.5, 1.5) within it
    let bulb = far.origin + far.punctual_lights[0].position.as_dvec3();
    let expected = glam::DVec3::new(1e6 - 2.2, 2.5e5 + 0.5, -1e6 + 1.5);
    assert!((bulb - expected).length() < 1e-6, "{bulb}");
    let tiny = load_file(&folder.join("tiny.glb"), &LoadOptions::default()).unwrap();
    assert!(tiny.bounds.radius() < 1e-4);
    let ratio = f64::from(far.bounds.radius()) / f64::from(tiny.bounds.radius());
    assert!((ratio - 1e5).abs() < 1.0, "the same room at two scales, but {ratio}");
}
