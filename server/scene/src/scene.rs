//! One validated scene in one state, laid out the way the device reads it.

use std::sync::Arc;

use glam::DVec3;
use sha2::{Digest, Sha256};

use crate::{
    Bounds, EmissiveTriangle, Environment, Material, NamedCamera, PunctualLight, SceneGeometry, SceneId, SceneSummary,
    StateKey, Texture, ViewFile,
};

/// One validated scene, ready for upload. Everything in it is finite and every index is in range.
#[derive(Debug)]
pub struct Scene {
    /// Content hash of what the file says, whatever its state.
    pub id: SceneId,
    /// State that it was built in.
    pub state: StateKey,
    /// File stem or the name given by the uploader; for people only.
    pub name: String,
    /// World position of the scene-space origin, metres.
    pub origin: DVec3,
    /// Bounds of all geometry in scene space; a unit box around 0 for an empty scene.
    pub bounds: Bounds,
    /// Hierarchies, triangles, vertices, instances.
    pub geometry: SceneGeometry,
    /// Materials; index 0 always exists (the glTF default material if the file has none).
    pub materials: Vec<Material>,
    /// Texture images with their sampler; one entry for each (image, sampler) pair in use.
    pub textures: Vec<Texture>,
    /// Emissive triangles of baked geometry, in the order of [`crate::Geometry::first_light`].
    pub emissive_triangles: Vec<EmissiveTriangle>,
    /// Point, spot and directional lights in scene space.
    pub punctual_lights: Vec<PunctualLight>,
    /// What a ray that leaves the scene sees.
    pub environment: Environment,
    /// Viewing exposure by camera name; see [`Scene::exposure_for`].
    pub view: ViewFile,
    /// Cameras of the view file, else of the glTF, else one framing of the bounds (named `default`); never empty.
    pub cameras: Vec<NamedCamera>,
    /// Names of the nodes that geometry refers to by [`crate::Geometry::node`].
    pub node_names: Vec<String>,
    /// What is in the scene, counted once.
    pub summary: SceneSummary,
    /// Optional extensions that are not supported, repaired data, and the like; shown to the user.
    pub warnings: Vec<String>,
    /// Seconds spent reading and validating the file.
    pub load_secs: f64,
    /// Seconds spent building hierarchies.
    pub build_secs: f64,
}

/// A scene shared by sessions and jobs.
pub type SharedScene = Arc<Scene>;

/// Names a scene in one state: equal keys render equal images.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SceneKey {
    /// What the file says.
    pub id: SceneId,
    /// What changes.
    pub state: StateKey,
}

impl std::fmt::Display for SceneKey {
    /// In the form of a [`SceneId`]: the id itself for the state in which nothing is set, else a hash of id and state.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.state.digest {
            None => self.id.fmt(f),
            Some(state) => {
                let digest = Sha256::new().chain_update(&self.id.0).chain_update(state).finalize();
                write!(f, "sha256:{}", hex::encode(digest))
            }
        }
    }
}

impl Scene {
    /// Names the scene in its state.
    pub fn key(&self) -> SceneKey {
        SceneKey { id: self.id.clone(), state: self.state }
    }

    /// Exposure (linear factor) the view file states for a camera, else its general one, else 1.
    pub fn exposure_for(&self, camera_name: &str) -> f32 {
        self.view.exposure_for(camera_name)
    }

    /// The camera of that name.
    pub fn camera(&self, name: &str) -> Option<&NamedCamera> {
        self.cameras.iter().find(|camera| camera.name == name)
    }
}
