//! What techniques keep for a whole session, shared by all its pictures.

use std::sync::Arc;

use parking_lot::Mutex;
use surfelcast_gpu::{Gpu, GpuError};

use crate::surfel::{SnapshotIdentity, SurfelCache, SurfelSettings};
use crate::technique::Change;
use surfelcast_passes::materials::MaterialMode;
use surfelcast_passes::upload::SceneBuffers;

/// State of a session beside its scene and lights. A batch render has one of its own.
#[derive(Debug, Default)]
pub struct SessionState {
    /// A cache as it was saved, until it is first asked for.
    snapshot: Mutex<Option<(SnapshotIdentity, Vec<u8>)>>,
    surfels: Mutex<Option<(MaterialMode, Arc<Mutex<SurfelCache>>)>>,
}

impl SessionState {
    /// The session's surfel cache, made when first asked for. Other settings or materials make a new one.
    pub(crate) fn surfel_cache(
        &self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        materials: MaterialMode,
        settings: SurfelSettings,
        pixel_count: u32,
        seed: u64,
    ) -> Result<Arc<Mutex<SurfelCache>>, GpuError> {
        let mut held = self.surfels.lock();
        if let Some((of, cache)) = &*held
            && *of == materials
            && cache.lock().settings().of_cache() == settings.of_cache()
        {
            return Ok(Arc::clone(cache));
        }
        // The old one is freed first, so that the new one may take its place.
        *held = None;
        let restored = self.snapshot.lock().take().and_then(|(identity, bytes)| {
            let restored = SurfelCache::restore(gpu, scene, settings, pixel_count, seed, &identity, &bytes);
            restored.inspect_err(|reason| tracing::warn!(%reason, "a saved surfel cache is not used")).ok()
        });
        let cache = match restored {
            Some(cache) => cache,
            None => SurfelCache::new(gpu, scene, settings, pixel_count, seed)?,
        };
        let cache = Arc::new(Mutex::new(cache));
        *held = Some((materials, Arc::clone(&cache)));
        Ok(cache)
    }

    /// Keeps a saved cache at hand for when one is asked for.
    pub fn offer_snapshot(&self, identity: SnapshotIdentity, bytes: Vec<u8>) {
        *self.snapshot.lock() = Some((identity, bytes));
    }

    /// The surfel cache, if the session has one by now.
    pub fn surfels(&self) -> Option<Arc<Mutex<SurfelCache>>> {
        self.surfels.lock().as_ref().map(|(_, cache)| Arc::clone(cache))
    }

    /// Forgets what no longer holds.
    pub fn invalidate(&self, change: Change) {
        match (change, &*self.surfels.lock()) {
            (Change::Camera, _) | (_, None) => {}
            // Means are forgotten as first guesses; places stay, since surfels do not follow objects yet.
            (Change::Lights | Change::Transforms, Some((_, cache))) => cache.lock().relight(),
        }
    }
}
