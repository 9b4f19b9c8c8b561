//! One file in many states: built again from the decoded file, and told apart.
#![allow(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    clippy::needless_for_each,
    clippy::unreadable_literal,
    reason = "a test may stop at the first surprise"
)]

mod support;

use glam::Vec3;
use serde_json::json;
use surfelcast_scene::glb::GlbBuilder;
use surfelcast_scene::trace::closest_hit;
use surfelcast_scene::{AnimationRef, Instant, LoadOptions, Mobility, Scene, SceneAsset, SceneState, load_bytes};

fn at(time_secs: f64) -> Instant {
    Instant { animation: AnimationRef::Index(0), time_secs }
}

fn loaded(bytes: &[u8], instant: Option<Instant>) -> Scene {
    load_bytes(bytes, "everything", &LoadOptions { instant, ..LoadOptions::default() }).unwrap()
}

fn shown(asset: &SceneAsset<'_>, instant: Option<Instant>) -> Scene {
    Scene::build(asset, &SceneState::at(asset, instant).unwrap()).unwrap()
}

#[test]
fn states_of_one_decoded_file_equal_loading_it_again() {
    let bytes = support::everything();
    let asset = SceneAsset::decode(&bytes, "everything", &LoadOptions::default()).unwrap();
    // back and forth, so that a state that left something behind would be noticed
    for instant in [Some(at(0.7)), None, Some(at(1.6)), Some(at(0.7)), None] {
        let (once, again) = (loaded(&bytes, instant.clone()), shown(&asset, instant.clone()));
        support::check(&again);
        assert_eq!(support::contents(&once), support::contents(&again), "{instant:?}");
        assert_eq!(once.key(), again.key(), "{instant:?}");
    }
    assert_ne!(support::contents(&shown(&asset, Some(at(0.7)))), support::contents(&shown(&asset, Some(at(1.6)))));
}

#[test]
fn an_owned_file_outlives_its_bytes() {
    let bytes = support::everything();
    let options = LoadOptions { instant: Some(at(0.7)), ..LoadOptions::default() };
    let borrowed = SceneAsset::decode(&bytes, "everything", &options).unwrap();
    let before = Scene::build(&borrowed, &SceneState::initial(&borrowed).unwrap()).unwrap();
    let owned = borrowed.into_owned();
    drop(bytes);
    let after = Scene::build(&owned, &SceneState::initial(&owned).unwrap()).unwrap();
    assert_eq!(support::contents(&before), support::contents(&after));
}

#[test]
fn instants_share_the_id_and_not_the_key() {
    let bytes = support::everything();
    let named = Some(Instant { animation: AnimationRef::Name("all".to_owned()), time_secs: 0.7 });
    let scenes = [None, Some(at(0.7)), Some(at(0.70001)), named].map(|instant| loaded(&bytes, instant));
    for (k, scene) in scenes.iter().enumerate() {
        assert_eq!(scene.id, scenes[0].id);
        let name = scene.key().to_string();
        assert!(name.starts_with("sha256:") && name.len() == 71, "{name}");
        let others = scenes[..k].iter();
        assert!(others.clone().all(|other| other.key() != scene.key() && other.key().to_string() != name), "{k}");
    }
    assert_eq!(scenes[0].key().to_string(), scenes[0].id.to_string(), "a scene without an instant is named by its id");
}

/// A still floor with two small triangles far away, which hold the bounds; an animated node with a mesh, a child with
/// another mesh and, if `has_lamp`, a lamp below it.
fn moving(has_lamp: bool) -> Vec<u8> {
    let mut glb = GlbBuilder::new();
    let lamp = glb.push("materials", json!({"emissiveFactor": [1.0, 1.0, 1.0]}));
    let plain = glb.push("materials", json!({}));
    let triangle = |center: [f32; 3], size: f32| {
        [[-size, -size], [size, -size], [0.0, size]].map(|[x, z]| [center[0] + x, center[1], center[2] + z])
    };
    let mut mesh = |triangles: &[[[f32; 3]; 3]], material: usize| {
        let position = glb.floats(triangles.as_flattened());
        glb.push("meshes", json!({"primitives": [{"attributes": {"POSITION": position}, "material": material}]}))
    };
    let around = [triangle([0.0; 3], 9.0), triangle([-30.0; 3], 0.1), triangle([30.0; 3], 0.1)];
    let floor = mesh(&around, plain);
    let [mover, rider] = [1.0, 0.5].map(|size| mesh(&[triangle([0.0; 3], size)], plain));
    let bulb = mesh(&[triangle([0.0; 3], 0.25)], if has_lamp { lamp } else { plain });
    let times = glb.floats(&[[0.0f32], [1.0]]);
    let moves = glb.floats(&[[0.0f32, 1.0, 0.0], [2.0, 3.0, 0.0]]);
    let bulb = glb.push("nodes", json!({"name": "bulb", "mesh": bulb, "translation": [0, 2, 0]}));
    let rider = glb.push("nodes", json!({"name": "rider", "mesh": rider, "translation": [0, 1, 0]}));
    let children = if has_lamp { vec![rider, bulb] } else { vec![rider] };
    glb.root_node(json!({"name": "floor", "mesh": floor}));
    let mover = glb.root_node(json!({"name": "mover", "mesh": mover, "children": children}));
    glb.push(
        "animations",
        json!({"samplers": [{"input": times, "output": moves}],
            "channels": [{"sampler": 0, "target": {"node": mover, "path": "translation"}}]}),
    );
    glb.finish()
}

#[test]
fn moving_rigid_nodes_changes_instances_and_the_top_level_alone() {
    let bytes = moving(false);
    let options = LoadOptions { mobility: Mobility::Animated, ..LoadOptions::default() };
    let asset = SceneAsset::decode(&bytes, "moving", &options).unwrap();
    let (before, after) = (shown(&asset, Some(at(0.2))), shown(&asset, Some(at(0.9))));
    assert_eq!(before.origin, after.origin);
    let (a, b) = (&before.geometry, &after.geometry);
    assert_eq!(format!("{:?}", a.bvh_triangles), format!("{:?}", b.bvh_triangles));
    assert!(a.nodes == b.nodes && a.vertices == b.vertices && a.geometries == b.geometries);
    assert!(a.top_nodes != b.top_nodes && a.instances != b.instances);
}

#[test]
fn movable_nodes_are_instances_that_are_hit_where_copies_are() {
    let bytes = moving(true);
    let decode =
        |mobility| SceneAsset::decode(&bytes, "moving", &LoadOptions { mobility, ..LoadOptions::default() }).unwrap();
    let (fixed, animated) = (decode(Mobility::Fixed), decode(Mobility::Animated));
    for time_secs in [0.0, 0.4, 1.0] {
        let (copied, placed) = (shown(&fixed, Some(at(time_secs))), shown(&animated, Some(at(time_secs))));
        support::check(&placed);
        assert_eq!(copied.summary.instance_count, 1);
        let geometry = &placed.geometry;
        let names: Vec<&str> = (0u32..)
            .zip(&geometry.instances)
            .filter(|(index, _)| geometry.baked_instance != Some(*index))
            .map(|(_, instance)| placed.node_names[instance.node as usize].as_str())
            .collect();
        assert!(names.len() == 2 && names.contains(&"mover") && names.contains(&"rider"), "{names:?}");
        assert_eq!(copied.emissive_triangles, placed.emissive_triangles, "lights are copies in both");
        let mut met = 0;
        for (x, z) in (-60..60).flat_map(|x| (-60..60).map(move |z| (x as f32 * 0.1 + 0.013, z as f32 * 0.1 + 0.017))) {
            let hit = |scene: &Scene| {
                let above = Vec3::new(x, 50.0, z);
                closest_hit(&scene.geometry, above, Vec3::NEG_Y, 0.0, f32::INFINITY).map(|hit| hit.t)
            };
            let (a, b) = (hit(&copied), hit(&placed));
            met += u32::from(a.is_some());
            assert!(a.is_some() == b.is_some() && a.zip(b).is_none_or(|(a, b)| (a - b).abs() < 1e-4), "{a:?} {b:?}");
        }
        assert!(met > 5000, "{met}");
    }
}
