//! Scenes in device memory: admitted before upload, shared by content hash, evicted when memory is needed.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::Arc;
use std::time::Instant;

use surfelcast_gpu::Gpu;
use surfelcast_passes::upload::StaticBuffers;
use surfelcast_scene::{Scene, SceneKey};
use surfelcast_techniques::SceneBuffers;

use crate::error::RendererError;

/// What sessions and jobs share of each uploaded scene, by id and state.
#[derive(Debug, Default)]
pub(crate) struct SceneStore {
    scenes: BTreeMap<SceneKey, Resident>,
}

#[derive(Debug)]
struct Resident {
    statics: Arc<StaticBuffers>,
    used_at: Instant,
}

impl SceneStore {
    /// The scene's buffers for one session or job: the shared ones, uploaded if necessary, and its own. Unused scenes
    /// are evicted to make room, least recently used first.
    pub(crate) fn get(&mut self, gpu: &Gpu, scene: &Scene) -> Result<SceneBuffers, RendererError> {
        self.admit(gpu, scene)?;
        let resident = match self.scenes.entry(scene.key()) {
            Entry::Occupied(resident) => resident.into_mut(),
            Entry::Vacant(slot) => {
                let statics = Arc::new(StaticBuffers::new(gpu, scene)?);
                slot.insert(Resident { statics, used_at: Instant::now() })
            }
        };
        resident.used_at = Instant::now();
        Ok(SceneBuffers::with_statics(gpu, scene, Arc::clone(&resident.statics))?)
    }

    /// Makes room for what one more session or job of a scene needs, or returns why it does not fit.
    pub(crate) fn admit(&mut self, gpu: &Gpu, scene: &Scene) -> Result<(), RendererError> {
        let key = scene.key();
        let shared = if self.scenes.contains_key(&key) { 0 } else { StaticBuffers::estimate_bytes(scene) };
        let needed = shared + SceneBuffers::estimate_own_bytes(scene);
        let budget = gpu.memory().budget_bytes;
        if needed > budget {
            return Err(RendererError::SceneTooLarge { field: "scene".to_owned(), needed, limit: budget });
        }
        while gpu.memory().free_bytes() < needed {
            let is_idle = |id: &SceneKey, resident: &Resident| *id != key && Arc::strong_count(&resident.statics) == 1;
            let idle = self.scenes.iter().filter(|(id, resident)| is_idle(id, resident));
            let Some(oldest) = idle.min_by_key(|(_, resident)| resident.used_at).map(|(id, _)| id.clone()) else {
                return Err(RendererError::NoMemory { needed, free: gpu.memory().free_bytes() });
            };
            tracing::info!(scene = %oldest, "evicted from device memory to make room");
            self.scenes.remove(&oldest);
        }
        Ok(())
    }

    /// Drops all scenes: the device is lost.
    pub(crate) fn clear(&mut self) {
        self.scenes.clear();
    }
}
