//! The scenes of the server: those that it was started with, and uploads, loaded when they are needed.

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Weak};
use std::time::{SystemTime, UNIX_EPOCH};

use parking_lot::{Mutex, RwLock};
use surfelcast_renderer::scene::{LoadOptions, Scene, SceneError, SceneLimits, ViewFile, load_bytes};
use surfelcast_review::SessionId;
use surfelcast_review::text::clean_name;
use surfelcast_store::{SceneBounds, SceneFiles, SceneRecord, StoreError};
use tempfile::NamedTempFile;

use crate::blocking::BlockingPool;
use crate::config::Bounds;
use crate::error::DomainError;

/// One scene.
#[derive(Debug)]
pub(crate) struct SceneEntry {
    pub(crate) record: SceneRecord,
    /// Its implicit session.
    pub(crate) session: SessionId,
    builtin: Option<Arc<Scene>>,
    loaded: Mutex<Weak<Scene>>,
    loading: tokio::sync::Mutex<()>,
}

impl SceneEntry {
    /// `None` where the record's id is no digest.
    fn new(record: SceneRecord, builtin: Option<Arc<Scene>>) -> Option<Arc<Self>> {
        let session = SessionId::implicit_of(&record.id)?;
        Some(Arc::new(Self {
            record,
            session,
            builtin,
            loaded: Mutex::default(),
            loading: tokio::sync::Mutex::default(),
        }))
    }

    pub(crate) fn is_builtin(&self) -> bool {
        self.builtin.is_some()
    }
}

/// All scenes.
#[derive(Debug)]
pub(crate) struct SceneLibrary {
    files: Arc<SceneFiles>,
    builtin_order: Vec<String>,
    entries: RwLock<BTreeMap<String, Arc<SceneEntry>>>,
    /// Recently used uploads, newest last.
    recent: Mutex<VecDeque<Arc<Scene>>>,
    loads: BlockingPool,
    waiting: AtomicUsize,
    bounds: Bounds,
}

impl SceneLibrary {
    /// The built-in scenes and the uploads of earlier runs, which are kept below `data_dir`.
    pub(crate) fn open(data_dir: &Path, builtin: Vec<Arc<Scene>>, bounds: Bounds) -> Result<Self, StoreError> {
        let store_bounds = SceneBounds { scenes: bounds.stored_scenes, bytes: bounds.stored_bytes };
        let (files, records) = SceneFiles::open(data_dir.join("scenes"), store_bounds)?;
        let builtin_order: Vec<String> = builtin.iter().map(|scene| scene.key().to_string()).collect();
        let stored = records.into_iter().filter_map(|record| SceneEntry::new(record, None));
        let builtin = builtin.into_iter().filter_map(|scene| SceneEntry::new(record_of(&scene, 0, None), Some(scene)));
        // A scene that is both stored and built in counts as built in.
        let entries = stored.chain(builtin).map(|entry| (entry.record.id.clone(), entry)).collect();
        Ok(Self {
            files: Arc::new(files),
            builtin_order,
            entries: RwLock::new(entries),
            recent: Mutex::default(),
            loads: BlockingPool::new("scene loading", bounds.scene_loads),
            waiting: AtomicUsize::new(0),
            bounds,
        })
    }

    /// An empty file for an upload; [`SceneLibrary::import`] takes it.
    pub(crate) fn new_upload(&self) -> Result<NamedTempFile, DomainError> {
        Ok(self.files.new_upload()?)
    }

    /// Built-in scenes in their given order, then uploads, oldest first.
    pub(crate) fn list(&self) -> Vec<Arc<SceneEntry>> {
        let mut list: Vec<Arc<SceneEntry>> = self.entries.read().values().cloned().collect();
        let rank = |entry: &SceneEntry| {
            let place = self.builtin_order.iter().position(|id| *id == entry.record.id);
            (place.unwrap_or(usize::MAX), entry.record.stored_at_unix_secs)
        };
        list.sort_by(|a, b| rank(a).cmp(&rank(b)).then_with(|| a.record.id.cmp(&b.record.id)));
        list
    }

    pub(crate) fn get(&self, id: &str) -> Result<Arc<SceneEntry>, DomainError> {
        self.entries.read().get(id).cloned().ok_or(DomainError::UnknownScene)
    }

    /// The scene whose implicit session has this id.
    pub(crate) fn by_session(&self, session: &str) -> Option<Arc<SceneEntry>> {
        self.entries.read().values().find(|entry| entry.session.as_str() == session).cloned()
    }

    /// The scene itself, from memory or from disk.
    pub(crate) async fn load(&self, entry: &Arc<SceneEntry>) -> Result<Arc<Scene>, DomainError> {
        if let Some(scene) = &entry.builtin {
            return Ok(Arc::clone(scene));
        }
        let _one_at_a_time = entry.loading.lock().await;
        if let Some(scene) = entry.loaded.lock().upgrade() {
            self.keep(&scene);
            return Ok(scene);
        }
        let (files, limits) = (Arc::clone(&self.files), self.limits());
        let SceneRecord { id: expected, name, view, .. } = entry.record.clone();
        let id = expected.clone();
        let loaded = self
            .on_loader(move || {
                let bytes = files.read(&id).map_err(|e| DomainError::internal(&e))?;
                parse_scene(&bytes, &name, limits, view.as_deref()).map_err(|e| DomainError::internal(&e))
            })
            .await?;
        let scene = Arc::new(loaded?);
        if scene.key().to_string() != expected {
            return Err(DomainError::internal(&format!("stored scene {expected} has changed on disk")));
        }
        *entry.loaded.lock() = Arc::downgrade(&scene);
        self.keep(&scene);
        Ok(scene)
    }

    /// Validates an uploaded file, with its view JSON where it has one, and stores it. Returns the entry and whether it
    /// is new.
    pub(crate) async fn import(
        &self,
        file: NamedTempFile,
        view: Option<String>,
        name: &str,
    ) -> Result<(Arc<SceneEntry>, bool), DomainError> {
        let name = match clean_name(name) {
            name if name.is_empty() => "scene".to_owned(),
            name => name,
        };
        let limits = self.limits();
        let (file, view, loaded) = self
            .on_loader(move || {
                let loaded = std::fs::read(file.path()).map_err(|e| DomainError::internal(&e)).and_then(|bytes| {
                    let scene = parse_scene(&bytes, &name, limits, view.as_deref()).map_err(refusal_of)?;
                    Ok((scene, bytes.len() as u64))
                });
                (file, view, loaded)
            })
            .await?;
        let (scene, bytes) = loaded?;
        let scene = Arc::new(scene);
        let record = record_of(&scene, bytes, view);
        if let Ok(entry) = self.get(&record.id) {
            return Ok((entry, false));
        }
        let mut entries = self.entries.write();
        if let Some(entry) = entries.get(&record.id) {
            return Ok((Arc::clone(entry), false));
        }
        self.files.insert(file, &record)?;
        let entry = SceneEntry::new(record, None).ok_or_else(|| DomainError::internal(&"a scene's id is no digest"))?;
        *entry.loaded.lock() = Arc::downgrade(&scene);
        entries.insert(entry.record.id.clone(), Arc::clone(&entry));
        drop(entries);
        self.keep(&scene);
        Ok((entry, true))
    }

    /// Deletes an uploaded scene.
    pub(crate) fn delete(&self, id: &str) -> Result<(), DomainError> {
        let mut entries = self.entries.write();
        if entries.get(id).ok_or(DomainError::UnknownScene)?.is_builtin() {
            return Err(DomainError::BuiltinScene);
        }
        self.files.remove(id)?;
        entries.remove(id);
        drop(entries);
        self.recent.lock().retain(|scene| scene.key().to_string() != id);
        Ok(())
    }

    /// Runs a loader with bounded width and a bounded queue.
    async fn on_loader<T: Send + 'static>(&self, work: impl FnOnce() -> T + Send + 'static) -> Result<T, DomainError> {
        let limit = self.bounds.waiting_scene_loads + self.bounds.scene_loads;
        let waiting = Waiting::enter(&self.waiting, limit).ok_or(DomainError::LoadingBusy { limit })?;
        let result = self.loads.run(work).await.map_err(|e| DomainError::internal(&e));
        drop(waiting);
        result
    }

    fn keep(&self, scene: &Arc<Scene>) {
        let mut recent = self.recent.lock();
        recent.retain(|kept| kept.key() != scene.key());
        recent.push_back(Arc::clone(scene));
        while recent.len() > self.bounds.loaded_scenes.max(1) {
            recent.pop_front();
        }
    }

    fn limits(&self) -> SceneLimits {
        SceneLimits { max_file_bytes: self.bounds.upload_bytes, ..SceneLimits::default() }
    }
}

fn record_of(scene: &Scene, bytes: u64, view: Option<String>) -> SceneRecord {
    SceneRecord {
        id: scene.key().to_string(),
        name: scene.name.clone(),
        triangle_count: scene.summary.triangle_count,
        cameras: scene.cameras.iter().map(|c| c.name.clone()).collect(),
        warnings: scene.warnings.clone(),
        bytes,
        stored_at_unix_secs: SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs()),
        view,
    }
}

fn parse_scene(bytes: &[u8], name: &str, limits: SceneLimits, view: Option<&str>) -> Result<Scene, SceneError> {
    let view = view.map(|view| ViewFile::parse(view.as_bytes())).transpose()?;
    load_bytes(bytes, name, &LoadOptions { limits, view, ..LoadOptions::default() })
}

/// The refusal of an upload that is no valid scene.
fn refusal_of(error: SceneError) -> DomainError {
    match error {
        SceneError::Read { .. } => DomainError::internal(&error),
        error => DomainError::InvalidScene(error),
    }
}

/// A place in a bounded queue; dropping it leaves the queue.
struct Waiting<'a>(&'a AtomicUsize);

impl<'a> Waiting<'a> {
    fn enter(count: &'a AtomicUsize, limit: usize) -> Option<Self> {
        let entered = Self(count);
        (count.fetch_add(1, Ordering::AcqRel) < limit).then_some(entered)
    }
}

impl Drop for Waiting<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::AcqRel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_queue_for_loading_is_bounded() {
        let count = AtomicUsize::new(0);
        let first = Waiting::enter(&count, 1);
        assert!(first.is_some() && Waiting::enter(&count, 1).is_none());
        drop(first);
        assert!(Waiting::enter(&count, 1).is_some());
        assert_eq!(count.load(Ordering::Acquire), 0);
    }
}
