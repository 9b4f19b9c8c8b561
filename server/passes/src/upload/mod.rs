//! The scene in device memory. Names of buffers are those of `lib/scene/bindings.wesl`.

mod dynamics;
mod materials;
mod statics;

use std::sync::Arc;

use glam::DVec3;
use surfelcast_gpu::{Buffer, Gpu, GpuError, MemoryKind, PassBuilder};
use surfelcast_scene::{Scene, SceneSummary};
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck::{self, Pod};

use dynamics::DynamicBuffers;
pub use statics::StaticBuffers;

/// No texture, no light.
const NO_INDEX: u32 = u32::MAX;

/// A scene as one session or job shows it: buffers shared with all that show the same scene, and those that a change of
/// transforms replaces.
#[derive(Debug)]
pub struct SceneBuffers {
    /// World position of scene space's origin.
    pub origin: DVec3,
    /// Radius of the sphere around the scene, metres.
    pub radius: f32,
    /// Size of the environment image; 1x1 for a constant.
    pub environment_size: [u32; 2],
    /// What is in the scene.
    pub summary: SceneSummary,
    /// Root of the first bottom level: the only one where there are no instances.
    first_root: u32,
    statics: Arc<StaticBuffers>,
    dynamics: DynamicBuffers,
}

impl SceneBuffers {
    /// Uploads a scene that nobody else shows.
    pub fn new(gpu: &Gpu, scene: &Scene) -> Result<Self, GpuError> {
        Self::with_statics(gpu, scene, Arc::new(StaticBuffers::new(gpu, scene)?))
    }

    /// Uploads what a session or job has of its own. `statics` are those of the same scene in the same state.
    pub fn with_statics(gpu: &Gpu, scene: &Scene, statics: Arc<StaticBuffers>) -> Result<Self, GpuError> {
        Ok(Self {
            origin: scene.origin,
            radius: scene.bounds.radius(),
            environment_size: statics.environment_size,
            summary: scene.summary,
            first_root: scene.geometry.instances.first().map_or(0, |instance| instance.root_node),
            dynamics: DynamicBuffers::new(gpu, scene)?,
            statics,
        })
    }

    /// Device bytes that [`SceneBuffers::with_statics`] and a light table will take, for admission.
    pub fn estimate_own_bytes(scene: &Scene) -> u64 {
        DynamicBuffers::estimate_bytes(scene)
    }

    /// Numbers of triangles and of instances, for the validation of attachments to them.
    pub fn attachment_counts(&self) -> [u32; 2] {
        [self.statics.triangle_count(), self.dynamics.instance_count()]
    }

    /// Root at which a kernel's variant starts to traverse: that of the top level, or of the only bottom level.
    pub fn traversal_root(&self, features: Features) -> u32 {
        if features.contains(Features::INSTANCES) { 0 } else { self.first_root }
    }

    /// Binds to a pass every scene buffer its kernel uses.
    pub fn bind<'g>(&self, pass: PassBuilder<'g>) -> PassBuilder<'g> {
        self.dynamics.bind(self.statics.bind(pass))
    }
}

/// A buffer of a slice. Empty slices become one zeroed element, since a binding may not be empty.
fn upload<T: Pod>(gpu: &Gpu, label: &str, items: &[T]) -> Result<Buffer, GpuError> {
    let size = size_of_val(items).max(size_of::<T>()) as u64;
    let buffer = gpu.buffer(label, MemoryKind::Scene, size.next_multiple_of(16))?;
    if items.is_empty() {
        gpu.upload(&buffer, 0, bytemuck::bytes_of(&T::zeroed()))?;
    } else {
        gpu.upload(&buffer, 0, bytemuck::cast_slice(items))?;
    }
    Ok(buffer)
}
