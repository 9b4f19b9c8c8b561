//! The identity of a scene: a hash over everything that the file and its options say.

use sha2::{Digest, Sha256};

use crate::{Environment, ViewFile};

/// Changes whenever the same bytes would load into a different scene.
const LOADER_VERSION: u32 = 1;

/// Identity of a scene: `sha256:` and 64 lower-case hex digits over the bytes of the file, its siblings, cameras,
/// exposure and environment. States of one scene share it; [`crate::SceneKey`] tells them apart.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SceneId(pub String);

impl std::fmt::Display for SceneId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl SceneId {
    /// Finishes a hash of all file bytes with the options. Uploads are stored under their ids, so the order and the
    /// texts below must not change without a new [`LOADER_VERSION`].
    pub(crate) fn of(mut hasher: Sha256, view: &ViewFile, environment: &Environment) -> Self {
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
        // separates exposures from the environment
        text("no pose");
        match environment {
            Environment::None => text("no environment"),
            Environment::Constant(radiance) => text(&format!("constant {radiance:?}")),
            Environment::Map(map) => {
                text(&format!("map {} x {}", map.width, map.height));
                hasher.update(bytemuck::cast_slice::<[f32; 3], u8>(&map.radiance));
            }
        }
        Self(format!("sha256:{}", hex::encode(hasher.finalize())))
    }
}
