//! Surfel caches on disk, one file for each scene.

use std::fs;
use std::path::{Path, PathBuf};

use sha2::{Digest as _, Sha256};
use surfelcast_gpu::Gpu;
use surfelcast_scene::Scene;
use surfelcast_techniques::{LightState, SessionState, SnapshotIdentity};

/// Files kept; the oldest go first.
const MAX_FILES: usize = 64;
/// Bytes of a file that is read at all: the largest cache, and then some.
const MAX_BYTES: u64 = 2 << 30;
const ENDING: &str = "surfels";

fn identity(scene: &Scene, lights: &LightState) -> SnapshotIdentity {
    SnapshotIdentity {
        scene: Sha256::digest(scene.key().to_string()).into(),
        lights: Sha256::digest(format!("{lights:?}")).into(),
    }
}

fn path_of(folder: &Path, identity: &SnapshotIdentity) -> PathBuf {
    let name = hex::encode(&identity.scene[..16]);
    folder.join(name).with_extension(ENDING)
}

/// Offers a session what was saved of its scene, if anything was.
pub(crate) fn offer(folder: &Path, scene: &Scene, lights: &LightState, session: &SessionState) {
    let identity = identity(scene, lights);
    let path = path_of(folder, &identity);
    let Ok(about) = fs::metadata(&path) else { return };
    if about.len() > MAX_BYTES {
        tracing::warn!(path = %path.display(), "a saved surfel cache is larger than any can be and is not read");
        return;
    }
    match fs::read(&path) {
        Ok(bytes) => session.offer_snapshot(identity, bytes),
        Err(error) => tracing::warn!(path = %path.display(), %error, "a saved surfel cache could not be read"),
    }
}

/// Writes a session's cache down. Failing costs the next start some time and nothing else.
pub(crate) fn save(folder: &Path, gpu: &Gpu, scene: &Scene, lights: &LightState, session: &SessionState) {
    let Some(cache) = session.surfels() else { return };
    let identity = identity(scene, lights);
    let path = path_of(folder, &identity);
    let bytes = match cache.lock().save(gpu, &identity) {
        Ok(bytes) => bytes,
        Err(error) => {
            tracing::warn!(%error, "a surfel cache could not be read back to be saved");
            return;
        }
    };
    // Written beside and renamed, so that a crash leaves the old file or the new one.
    let written = path.with_extension("new");
    let result = fs::create_dir_all(folder)
        .and_then(|()| fs::write(&written, &bytes))
        .and_then(|()| fs::rename(&written, &path));
    match result {
        Ok(()) => prune(folder),
        Err(error) => tracing::warn!(path = %path.display(), %error, "a surfel cache could not be saved"),
    }
}

/// Removes the oldest files where there are too many.
fn prune(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    let mut files: Vec<_> = entries
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|ending| ending == ENDING))
        .filter_map(|path| Some((fs::metadata(&path).and_then(|about| about.modified()).ok()?, path)))
        .collect();
    files.sort();
    let surplus = files.len().saturating_sub(MAX_FILES);
    for (_, path) in &files[..surplus] {
        let _ = fs::remove_file(path);
    }
}
