//! The scenes of the server: those it was started with, and uploads kept by content under the data folder.
//!
//! `DATA/scenes/<64 hex digits>.scene` holds the file as uploaded, `.json` beside it what listing needs. The digits are
//! those of the scene's id, so no name from outside ever becomes a path. Files appear by rename, whole or not at all.

use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Weak};
use std::time::{SystemTime, UNIX_EPOCH};

use axum::http::StatusCode;
use parking_lot::{Mutex, RwLock};
use serde::{Deserialize, Serialize};
use surfelcast_renderer::scene::{LoadOptions, Scene, SceneError, SceneLimits, ViewFile, load_bytes};

use crate::blocking::BlockingPool;
use crate::config::{Bounds, ServiceConfig};
use crate::http::problem::ApiError;
use crate::text::clean_name;

/// Hex digits of a scene id that name its session.
const SESSION_DIGITS: usize = 16;
/// Bytes of a stored description that are read at most.
const MAX_META_BYTES: u64 = 1 << 20;

/// What listing tells of a scene; also the stored description.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct SceneMeta {
    pub(crate) id: String,
    pub(crate) name: String,
    pub(crate) triangle_count: u32,
    pub(crate) cameras: Vec<String>,
    pub(crate) warnings: Vec<String>,
    pub(crate) bytes: u64,
    pub(crate) stored_at_unix_secs: u64,
    /// View JSON that came with an upload; part of what the id stands for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) view: Option<String>,
}

impl SceneMeta {
    fn of(scene: &Scene, bytes: u64) -> Self {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs());
        Self {
            id: scene.id.to_string(),
            name: scene.name.clone(),
            triangle_count: scene.summary.triangle_count,
            cameras: scene.cameras.iter().map(|c| c.name.clone()).collect(),
            warnings: scene.warnings.clone(),
            bytes,
            stored_at_unix_secs: now,
            view: None,
        }
    }

    /// Session of this scene.
    pub(crate) fn session_id(&self) -> &str {
        hex_digits(&self.id).and_then(|hex| hex.get(..SESSION_DIGITS)).unwrap_or_default()
    }
}

/// One scene.
#[derive(Debug)]
pub(crate) struct SceneEntry {
    pub(crate) meta: SceneMeta,
    builtin: Option<Arc<Scene>>,
    loaded: Mutex<Weak<Scene>>,
    loading: tokio::sync::Mutex<()>,
}

impl SceneEntry {
    fn new(meta: SceneMeta, builtin: Option<Arc<Scene>>) -> Arc<Self> {
        Arc::new(Self { meta, builtin, loaded: Mutex::default(), loading: tokio::sync::Mutex::default() })
    }

    pub(crate) fn is_builtin(&self) -> bool {
        self.builtin.is_some()
    }
}

/// All scenes.
#[derive(Debug)]
pub(crate) struct SceneStore {
    dir: PathBuf,
    builtin_order: Vec<String>,
    entries: RwLock<BTreeMap<String, Arc<SceneEntry>>>,
    /// Recently used stored scenes, newest last.
    recent: Mutex<VecDeque<Arc<Scene>>>,
    loads: BlockingPool,
    waiting: AtomicUsize,
    bounds: Bounds,
}

impl SceneStore {
    /// Lists what is stored; unreadable descriptions are skipped with a warning in the log.
    pub(crate) fn open(config: &ServiceConfig, builtin: Vec<Arc<Scene>>) -> io::Result<Self> {
        let dir = config.data_dir.join("scenes");
        std::fs::create_dir_all(&dir)?;
        let mut entries = BTreeMap::new();
        for item in std::fs::read_dir(&dir)? {
            let path = item?.path();
            if path.extension().is_none_or(|extension| extension != "json") {
                continue;
            }
            match read_meta(&path) {
                Ok(meta) => drop(entries.insert(meta.id.clone(), SceneEntry::new(meta, None))),
                Err(error) => tracing::warn!(path = %path.display(), %error, "stored scene skipped"),
            }
        }
        let builtin_order: Vec<String> = builtin.iter().map(|scene| scene.id.to_string()).collect();
        for scene in builtin {
            let meta = SceneMeta::of(&scene, 0);
            entries.insert(meta.id.clone(), SceneEntry::new(meta, Some(scene)));
        }
        Ok(Self {
            dir,
            builtin_order,
            entries: RwLock::new(entries),
            recent: Mutex::default(),
            loads: BlockingPool::new("scene loading", config.bounds.scene_loads),
            waiting: AtomicUsize::new(0),
            bounds: config.bounds,
        })
    }

    /// Folder for uploads in progress; on the same file system as the store, so that a rename is enough.
    pub(crate) fn dir(&self) -> &Path {
        &self.dir
    }

    /// Built-in scenes in their given order, then uploads, oldest first.
    pub(crate) fn list(&self) -> Vec<Arc<SceneEntry>> {
        let mut list: Vec<Arc<SceneEntry>> = self.entries.read().values().cloned().collect();
        let rank = |entry: &SceneEntry| {
            let place = self.builtin_order.iter().position(|id| *id == entry.meta.id);
            (place.unwrap_or(usize::MAX), entry.meta.stored_at_unix_secs)
        };
        list.sort_by(|a, b| rank(a).cmp(&rank(b)).then_with(|| a.meta.id.cmp(&b.meta.id)));
        list
    }

    pub(crate) fn get(&self, id: &str) -> Option<Arc<SceneEntry>> {
        self.entries.read().get(id).cloned()
    }

    /// The scene of a session.
    pub(crate) fn by_session(&self, session: &str) -> Option<Arc<SceneEntry>> {
        if session.len() != SESSION_DIGITS {
            return None;
        }
        self.entries.read().values().find(|entry| entry.meta.session_id() == session).cloned()
    }

    /// The scene itself, from memory or from disk.
    pub(crate) async fn load(&self, entry: &Arc<SceneEntry>) -> Result<Arc<Scene>, ApiError> {
        if let Some(scene) = &entry.builtin {
            return Ok(Arc::clone(scene));
        }
        let _one_at_a_time = entry.loading.lock().await;
        if let Some(scene) = entry.loaded.lock().upgrade() {
            self.keep(&scene);
            return Ok(scene);
        }
        let path = self.path_of(&entry.meta.id, "scene")?;
        let (name, expected, view) = (entry.meta.name.clone(), entry.meta.id.clone(), entry.meta.view.clone());
        let limits = self.limits();
        let loaded = self
            .on_loader(move || {
                let bytes = std::fs::read(&path)
                    .map_err(|source| SceneError::Read { path: "the stored scene".into(), source })?;
                load_bytes(&bytes, &name, &options_of(limits, view.as_deref())?)
            })
            .await?;
        let scene = Arc::new(loaded.map_err(|e| ApiError::internal(&e))?);
        if scene.id.to_string() != expected {
            return Err(ApiError::internal(&format!("stored scene {expected} has changed on disk")));
        }
        *entry.loaded.lock() = Arc::downgrade(&scene);
        self.keep(&scene);
        Ok(scene)
    }

    /// Validates an uploaded file, with its view JSON where it has one, and stores it. Returns the entry and whether it is new.
    pub(crate) async fn import(
        &self,
        file: tempfile::NamedTempFile,
        view: Option<String>,
        name: &str,
    ) -> Result<(Arc<SceneEntry>, bool), ApiError> {
        let name = match clean_name(name) {
            name if name.is_empty() => "scene".to_owned(),
            name => name,
        };
        let limits = self.limits();
        let (file, view, loaded) = self
            .on_loader(move || {
                let bytes = std::fs::read(file.path());
                let loaded =
                    bytes.map_err(|source| SceneError::Read { path: "the upload".into(), source }).and_then(|bytes| {
                        let options = options_of(limits, view.as_deref())?;
                        load_bytes(&bytes, &name, &options).map(|scene| (scene, bytes.len() as u64))
                    });
                (file, view, loaded)
            })
            .await?;
        let (scene, bytes) = loaded.map_err(|error| import_problem(&error))?;
        let scene = Arc::new(scene);
        let meta = SceneMeta { view, ..SceneMeta::of(&scene, bytes) };
        if let Some(entry) = self.get(&meta.id) {
            return Ok((entry, false));
        }
        let path = self.path_of(&meta.id, "scene")?;
        let meta_path = self.path_of(&meta.id, "json")?;
        let mut entries = self.entries.write();
        if let Some(entry) = entries.get(&meta.id) {
            return Ok((Arc::clone(entry), false));
        }
        let stored = entries.values().filter(|entry| !entry.is_builtin());
        let (count, total) = stored.fold((0, 0), |(n, b), entry| (n + 1, b + entry.meta.bytes));
        if count >= self.bounds.stored_scenes || total + bytes > self.bounds.stored_bytes {
            let (scenes, limit) = (self.bounds.stored_scenes, self.bounds.stored_bytes);
            let detail = format!("the store holds at most {scenes} scenes and {limit} bytes; delete a scene first");
            return Err(ApiError::new(StatusCode::INSUFFICIENT_STORAGE, "storage_full", detail));
        }
        // The description comes last: a scene without one is not listed, so a crash between the two leaves no lie.
        file.persist(&path).map_err(|e| ApiError::internal(&e))?;
        write_meta(&self.dir, &meta_path, &meta).map_err(|e| ApiError::internal(&e))?;
        let entry = SceneEntry::new(meta.clone(), None);
        *entry.loaded.lock() = Arc::downgrade(&scene);
        entries.insert(meta.id, Arc::clone(&entry));
        drop(entries);
        self.keep(&scene);
        Ok((entry, true))
    }

    /// Forgets a stored scene and deletes its files.
    pub(crate) fn delete(&self, id: &str) -> Result<(), ApiError> {
        let mut entries = self.entries.write();
        match entries.get(id) {
            None => return Err(unknown_scene()),
            Some(entry) if entry.is_builtin() => {
                let detail = "scene: came with the server's start and cannot be deleted; restart without it";
                return Err(ApiError::new(StatusCode::CONFLICT, "builtin_scene", detail));
            }
            Some(_) => {}
        }
        let (path, meta_path) = (self.path_of(id, "scene")?, self.path_of(id, "json")?);
        std::fs::remove_file(meta_path).map_err(|e| ApiError::internal(&e))?;
        if let Err(error) = std::fs::remove_file(path) {
            tracing::warn!(%error, "a deleted scene's file remains");
        }
        entries.remove(id);
        drop(entries);
        self.recent.lock().retain(|scene| scene.id.to_string() != id);
        Ok(())
    }

    /// Runs a loader with bounded width and a bounded queue.
    async fn on_loader<T: Send + 'static>(&self, work: impl FnOnce() -> T + Send + 'static) -> Result<T, ApiError> {
        let limit = self.bounds.waiting_scene_loads + self.bounds.scene_loads;
        let waiting = Waiting::enter(&self.waiting, limit).ok_or_else(|| {
            let detail = format!("{limit} scenes are being loaded already; try again later");
            ApiError::new(StatusCode::SERVICE_UNAVAILABLE, "loading_busy", detail).retry_after(5)
        })?;
        let result = self.loads.run(work).await.map_err(|e| ApiError::internal(&e));
        drop(waiting);
        result
    }

    fn keep(&self, scene: &Arc<Scene>) {
        let mut recent = self.recent.lock();
        recent.retain(|kept| kept.id != scene.id);
        recent.push_back(Arc::clone(scene));
        while recent.len() > self.bounds.loaded_scenes.max(1) {
            recent.pop_front();
        }
    }

    fn limits(&self) -> SceneLimits {
        SceneLimits { max_file_bytes: self.bounds.upload_bytes, ..SceneLimits::default() }
    }

    fn path_of(&self, id: &str, extension: &str) -> Result<PathBuf, ApiError> {
        let hex = hex_digits(id).ok_or_else(unknown_scene)?;
        Ok(self.dir.join(format!("{hex}.{extension}")))
    }
}

fn options_of(limits: SceneLimits, view: Option<&str>) -> Result<LoadOptions, SceneError> {
    let view = view.map(|view| ViewFile::parse(view.as_bytes())).transpose()?;
    Ok(LoadOptions { limits, view, ..LoadOptions::default() })
}

/// 404 for scenes.
pub(crate) fn unknown_scene() -> ApiError {
    ApiError::not_found("scene: no such scene; GET /v1/scenes lists them")
}

fn import_problem(error: &SceneError) -> ApiError {
    let code = match error {
        SceneError::Read { .. } => return ApiError::internal(error),
        SceneError::Invalid { .. } => "invalid_scene",
        SceneError::UnsupportedExtension { .. } => "unsupported_extension",
        SceneError::TooLarge { .. } => "scene_too_large",
    };
    ApiError::new(StatusCode::UNPROCESSABLE_ENTITY, code, error.to_string())
}

/// The 64 lower-case hex digits of `sha256:...`.
fn hex_digits(id: &str) -> Option<&str> {
    let hex = id.strip_prefix("sha256:")?;
    let is_digit = |b: u8| b.is_ascii_digit() || (b'a'..=b'f').contains(&b);
    (hex.len() == 64 && hex.bytes().all(is_digit)).then_some(hex)
}

fn read_meta(path: &Path) -> io::Result<SceneMeta> {
    if std::fs::metadata(path)?.len() > MAX_META_BYTES {
        return Err(io::Error::other("description is too long"));
    }
    let meta: SceneMeta = serde_json::from_slice(&std::fs::read(path)?)?;
    let stem = path.file_stem().and_then(|stem| stem.to_str());
    if hex_digits(&meta.id).is_none() || hex_digits(&meta.id) != stem {
        return Err(io::Error::other("description and file name disagree"));
    }
    if !path.with_extension("scene").is_file() {
        return Err(io::Error::other("the scene's file is missing"));
    }
    Ok(meta)
}

fn write_meta(dir: &Path, path: &Path, meta: &SceneMeta) -> io::Result<()> {
    let mut file = tempfile::NamedTempFile::new_in(dir)?;
    serde_json::to_writer_pretty(&mut file, meta)?;
    file.as_file().sync_all()?;
    file.persist(path).map_err(|e| e.error)?;
    Ok(())
}

/// Counts those who wait.
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
    fn only_digests_become_paths() {
        assert!(hex_digits(&format!("sha256:{}", "a1".repeat(32))).is_some());
        for id in ["", "sha256:", "sha256:../../etc/passwd", &format!("sha256:{}", "A1".repeat(32)), &"a1".repeat(32)] {
            assert_eq!(hex_digits(id), None, "{id}");
        }
    }

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
