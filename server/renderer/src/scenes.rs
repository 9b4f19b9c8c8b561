//! Scenes in device memory: admitted before upload, shared by content hash, evicted when memory is needed.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use surfelcast_gpu::Gpu;
use surfelcast_scene::{Scene, SceneKey};
use surfelcast_techniques::SceneBuffers;

use crate::error::RendererError;

/// Uploaded scenes by id and state.
#[derive(Debug, Default)]
pub(crate) struct SceneStore {
    scenes: BTreeMap<SceneKey, Resident>,
}

#[derive(Debug)]
struct Resident {
    buffers: Arc<SceneBuffers>,
    used_at: Instant,
}

impl SceneStore {
    /// The scene's buffers, uploaded if necessary. Unused scenes are evicted to make room, least recently used first.
    pub(crate) fn get(&mut self, gpu: &Gpu, scene: &Scene) -> Result<Arc<SceneBuffers>, RendererError> {
        if let Some(resident) = self.scenes.get_mut(&scene.key()) {
            resident.used_at = Instant::now();
            return Ok(Arc::clone(&resident.buffers));
        }
        self.admit(gpu, scene)?;
        let buffers = Arc::new(SceneBuffers::new(gpu, scene)?);
        self.scenes.insert(scene.key(), Resident { buffers: Arc::clone(&buffers), used_at: Instant::now() });
        Ok(buffers)
    }

    /// Makes room for a scene, or returns why it does not fit.
    pub(crate) fn admit(&mut self, gpu: &Gpu, scene: &Scene) -> Result<(), RendererError> {
        if self.scenes.contains_key(&scene.key()) {
            return Ok(());
        }
        let needed = SceneBuffers::estimate_bytes(scene);
        let budget = gpu.memory().budget_bytes;
        if needed > budget {
            return Err(RendererError::SceneTooLarge { field: "scene".to_owned(), needed, limit: budget });
        }
        while gpu.memory().free_bytes() < needed {
            let idle = self.scenes.iter().filter(|(_, resident)| Arc::strong_count(&resident.buffers) == 1);
            let Some(oldest) = idle.min_by_key(|(_, resident)| resident.used_at).map(|(id, _)| id.clone()) else {
                return Err(RendererError::NoMemory { needed, free: gpu.memory().free_bytes() });
            };
            tracing::info!(scene = %oldest, "dropped from device memory to make room");
            self.scenes.remove(&oldest);
        }
        Ok(())
    }

    /// Drops all scenes: the device is lost.
    pub(crate) fn clear(&mut self) {
        self.scenes.clear();
    }
}
