//! One file in many states: built again from the decoded file, and told apart.
#![allow(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    clippy::needless_for_each,
    clippy::unreadable_literal,
    reason = "a test may stop at the first surprise"
)]

mod support;

use surfelcast_scene::{AnimationRef, Instant, LoadOptions, Scene, SceneAsset, SceneState, load_bytes};

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
