//! What changes while the file stays the same: the instant, the nodes' transforms, the lights.

pub(crate) mod camera;
mod edit;
pub(crate) mod light;
mod nodes;

use sha2::{Digest, Sha256};

pub use edit::SceneEdit;
pub use light::LightState;
pub(crate) use nodes::{Nodes, PlacedNode};

use crate::asset::Clip;
use crate::{AnimationRef, Instant, SceneAsset, SceneError};

/// A state of a scene: where its nodes are.
#[derive(Debug)]
pub struct SceneState {
    /// Instant of an animation; `None` for the nodes' own transforms.
    instant: Option<Instant>,
    pub(crate) nodes: Nodes,
}

impl SceneState {
    /// The state in which the file or its options show the scene.
    pub fn initial(asset: &SceneAsset<'_>) -> Result<Self, SceneError> {
        Self::at(asset, asset.instant.clone())
    }

    /// The state at an instant.
    pub fn at(asset: &SceneAsset<'_>, instant: Option<Instant>) -> Result<Self, SceneError> {
        let overrides = match &instant {
            Some(instant) => Clip::decode(&asset.reader(), &instant.animation)?.at(instant.time_secs),
            None => Vec::new(),
        };
        Ok(Self { nodes: Nodes::place(asset, overrides)?, instant })
    }

    /// What tells this state from others of the same scene.
    pub fn key(&self) -> StateKey {
        StateKey::of(self.instant.as_ref())
    }
}

/// Tells states of one scene apart. Together with the scene's id it names everything that is built from both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct StateKey {
    /// Hash of the instant; `None` where there is none.
    pub(crate) digest: Option<[u8; 32]>,
}

impl StateKey {
    fn of(instant: Option<&Instant>) -> Self {
        let digest = instant.map(|instant| {
            let mut hasher = Sha256::new();
            match &instant.animation {
                AnimationRef::Index(index) => {
                    hasher.update([0]);
                    hasher.update((*index as u64).to_le_bytes());
                }
                AnimationRef::Name(name) => {
                    hasher.update([1]);
                    hasher.update((name.len() as u64).to_le_bytes());
                    hasher.update(name);
                }
            }
            hasher.update(instant.time_secs.to_bits().to_le_bytes());
            hasher.finalize().into()
        });
        Self { digest }
    }
}
