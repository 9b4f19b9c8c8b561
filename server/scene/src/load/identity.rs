//! The identity of a scene: a hash over everything that shapes its picture.

use sha2::{Digest, Sha256};

use crate::view::AnimationRef;
use crate::{Environment, Instant, SceneId, ViewFile};

/// Changes whenever the same bytes would load into a different scene.
const LOADER_VERSION: u32 = 1;

/// Finishes a hash of all file bytes with the options.
pub(crate) fn scene_id(
    mut hasher: Sha256,
    view: &ViewFile,
    instant: Option<&Instant>,
    environment: &Environment,
) -> SceneId {
    hasher.update(LOADER_VERSION.to_le_bytes());
    let mut text = |text: &str| {
        hasher.update((text.len() as u64).to_le_bytes());
        hasher.update(text);
    };
    for camera in &view.cameras {
        text(&camera.name);
        let pinhole = &camera.camera;
        for vector in [pinhole.position, pinhole.target, pinhole.up] {
            vector.to_array().iter().for_each(|x| text(&x.to_string()));
        }
        text(&pinhole.vfov.to_string());
        text(&format!("{:?}", camera.resolution));
    }
    text(&format!("exposure {:?}", view.exposure));
    for (name, exposure) in &view.camera_exposure {
        text(name);
        text(&exposure.to_string());
    }
    match instant {
        None => text("no pose"),
        Some(instant) => {
            match &instant.animation {
                AnimationRef::Index(index) => text(&format!("animation {index}")),
                AnimationRef::Name(name) => text(name),
            }
            text(&instant.time_secs.to_string());
        }
    }
    match environment {
        Environment::None => text("no environment"),
        Environment::Constant(radiance) => text(&format!("constant {radiance:?}")),
        Environment::Map(map) => {
            text(&format!("map {} x {}", map.width, map.height));
            hasher.update(bytemuck::cast_slice::<[f32; 3], u8>(&map.radiance));
        }
    }
    SceneId(format!("sha256:{}", hex::encode(hasher.finalize())))
}
