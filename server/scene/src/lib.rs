//! glTF in, validated CPU scene out.
//!
//! A [`SceneAsset`] is what a file says, decoded once; a [`SceneState`] is what may change (the instant of an
//! animation); a [`Scene`] is built from both, immutable, and laid out the way the GPU reads it: bottom-level
//! hierarchies and the top-level one, triangles in leaf order, packed vertices, materials, lights. The crate knows no
//! GPU and no async runtime.
//!
//! Spaces: *world* is the file's own space in metres (`f64` on the CPU); *scene* space is world minus
//! [`Scene::origin`], the centre of the bounds, in `f32`; *object* space is that of one instanced mesh. Angles are
//! radians, colours linear Rec. 709, emission is radiance (W sr^-1 m^-2).

mod asset;
mod bounds;
mod build;
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
mod scene;
mod state;
pub mod summary;
pub mod trace;

pub use asset::view::ViewFile;
pub use asset::{AnimationRef, Instant, LoadOptions, Mobility, SceneAsset, SceneId};
pub use bounds::Bounds;
pub use build::bvh;
pub use camera::{Camera, NamedCamera};
pub use environment::{Environment, EnvironmentMap};
pub use error::SceneError;
pub use geometry::{BvhTriangle, Geometry, Instance, PackedVertex, SceneGeometry, TriangleRecord, pack_octahedral};
pub use lights::{EmissiveTriangle, PunctualKind, PunctualLight};
pub use limits::SceneLimits;
pub use load::{load_bytes, load_file};
pub use material::{AlphaMode, Material, Texture, TextureRef, Wrap};
pub use pick::Picked;
pub use scene::{Scene, SceneKey, SharedScene};
pub use state::{LightState, SceneEdit, SceneState, StateKey};
pub use summary::SceneSummary;
