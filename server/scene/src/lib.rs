//! glTF in, validated CPU scene out.
//!
//! A [`Scene`] is immutable, posed at one instant, and laid out the way the GPU reads it: one node array holding the
//! bottom-level hierarchies and the top-level one, triangles in leaf order, packed vertices, materials, lights. It knows
//! no GPU and no async runtime.
//!
//! Spaces: *world* is the file's own space in metres (`f64` on the CPU); *scene* space is world minus [`Scene::origin`],
//! the centre of the bounds, in `f32`; *object* space is that of one instanced mesh. Angles are radians, colours linear
//! Rec. 709, emission is radiance (W sr^-1 m^-2).

mod bounds;
pub mod bvh;
pub mod camera;
pub mod demo;
pub mod environment;
pub mod error;
pub mod geometry;
pub mod glb;
pub mod lights;
pub mod limits;
mod load;
pub mod material;
mod pick;
pub mod sample;
pub mod summary;
pub mod trace;
pub mod view;

use std::sync::Arc;

use glam::DVec3;

pub use bounds::Bounds;
pub use camera::{Camera, NamedCamera};
pub use environment::{Environment, EnvironmentMap};
pub use error::SceneError;
pub use geometry::{BvhTriangle, Geometry, Instance, PackedVertex, SceneGeometry, TriangleRecord, pack_octahedral};
pub use lights::{EmissiveTriangle, PunctualKind, PunctualLight};
pub use limits::SceneLimits;
pub use load::{LoadOptions, load_bytes, load_file};
pub use material::{AlphaMode, Material, Texture, TextureRef, Wrap};
pub use pick::Picked;
pub use summary::SceneSummary;
pub use view::{Instant, ViewFile};

/// Identity of a scene: `sha256:` and 64 lower-case hex digits over the bytes of the file, its siblings, the instant
/// and the view file, so that equal ids render equal pictures.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SceneId(pub String);

impl std::fmt::Display for SceneId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// One validated scene, ready for upload. Everything in it is finite and every index is in range.
#[derive(Debug)]
pub struct Scene {
    /// Content hash.
    pub id: SceneId,
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
    /// Emissive triangles of baked geometry, in the order of [`Geometry::first_light`].
    pub emissive_triangles: Vec<EmissiveTriangle>,
    /// Point, spot and directional lights in scene space.
    pub punctual_lights: Vec<PunctualLight>,
    /// What a ray that leaves the scene sees.
    pub environment: Environment,
    /// Viewing exposure by camera name; see [`Scene::exposure_for`].
    pub view: ViewFile,
    /// Cameras of the view file, else of the glTF, else one framing of the bounds (named `default`); never empty.
    pub cameras: Vec<NamedCamera>,
    /// Names of the nodes that geometry refers to by [`Geometry::node`].
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

impl Scene {
    /// Exposure (linear factor) the view file states for a camera, else its general one, else 1.
    pub fn exposure_for(&self, camera_name: &str) -> f32 {
        self.view.exposure_for(camera_name)
    }

    /// The camera of that name.
    pub fn camera(&self, name: &str) -> Option<&NamedCamera> {
        self.cameras.iter().find(|camera| camera.name == name)
    }
}
