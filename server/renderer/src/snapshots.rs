//! What techniques keep for sessions, on disk: one file for each scene and technique.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::json;
use sha2::{Digest as _, Sha256};
use surfelcast_gpu::Gpu;
use surfelcast_render_api::identity::identity;
use surfelcast_scene::{PunctualKind, PunctualLight, Scene};
use surfelcast_techniques::{LightState, SessionState, SnapshotIdentity, TechniqueEntry};

/// Files kept; the oldest go first.
const MAX_FILES: usize = 64;
/// Bytes of a file that is read at all: the largest state, and then some.
const MAX_BYTES: u64 = 2 << 30;
/// Digits of a file's name before the technique's id.
const NAME_DIGITS: usize = 32;

fn identity_of(scene: &Scene, lights: &LightState) -> SnapshotIdentity {
    SnapshotIdentity {
        scene: Sha256::digest(scene.key().to_string()).into(),
        // Maps of names always encode.
        lights: identity(&lights_json(lights)).unwrap_or_default(),
    }
}

/// All that the light of a session depends on.
fn lights_json(lights: &LightState) -> serde_json::Value {
    let kind = |kind: PunctualKind| match kind {
        PunctualKind::Point => json!("point"),
        PunctualKind::Spot { inner_angle, outer_angle } => json!({ "spot": [inner_angle, outer_angle] }),
        PunctualKind::Directional => json!("directional"),
    };
    let light = |light: &PunctualLight| {
        json!({
            "kind": kind(light.kind),
            "position": light.position.to_array(),
            "direction": light.direction.to_array(),
            "intensity": light.intensity,
            // Null where there is no end of it.
            "range": light.range,
        })
    };
    json!({
        "punctual": lights.punctual.iter().map(light).collect::<Vec<_>>(),
        "environment_strength": lights.environment_strength,
        "emissive_strength": lights.emissive_strength,
    })
}

fn path_of(folder: &Path, identity: &SnapshotIdentity, technique: &str) -> PathBuf {
    let name = hex::encode(&identity.scene[..NAME_DIGITS / 2]);
    folder.join(name).with_extension(technique)
}

/// Offers a session what was saved of its scene, if anything was.
pub(crate) fn offer(
    folder: &Path,
    techniques: &'static [TechniqueEntry],
    scene: &Scene,
    lights: &LightState,
    session: &SessionState,
) {
    let identity = identity_of(scene, lights);
    for entry in techniques {
        let path = path_of(folder, &identity, entry.id());
        let Ok(about) = fs::metadata(&path) else { continue };
        if about.len() > MAX_BYTES {
            tracing::warn!(path = %path.display(), "a saved state is larger than any can be and is not read");
            continue;
        }
        match fs::read(&path) {
            Ok(bytes) => session.of(entry).restore(identity, bytes),
            Err(error) => tracing::warn!(path = %path.display(), %error, "a saved state could not be read"),
        }
    }
}

/// Writes a session's state down. Failing costs the next start some time and nothing else.
pub(crate) fn save(folder: &Path, gpu: &Gpu, scene: &Scene, lights: &LightState, session: &SessionState) {
    let identity = identity_of(scene, lights);
    for (technique, part) in session.parts() {
        match part.save(gpu, &identity) {
            Ok(Some(bytes)) => write(folder, &path_of(folder, &identity, technique), &bytes),
            Ok(None) => {}
            Err(error) => tracing::warn!(%error, technique, "a state could not be read back to be saved"),
        }
    }
}

fn write(folder: &Path, path: &Path, bytes: &[u8]) {
    // Written next to it and renamed, so that a crash leaves the old file or the new one.
    let written = path.with_extension("new");
    let result =
        fs::create_dir_all(folder).and_then(|()| fs::write(&written, bytes)).and_then(|()| fs::rename(&written, path));
    match result {
        Ok(()) => prune(folder),
        Err(error) => tracing::warn!(path = %path.display(), %error, "a state could not be saved"),
    }
}

/// Removes the oldest files where there are too many.
fn prune(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    let mut files: Vec<_> = entries
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.file_stem().is_some_and(|stem| stem.len() == NAME_DIGITS))
        .filter_map(|path| Some((fs::metadata(&path).and_then(|about| about.modified()).ok()?, path)))
        .collect();
    files.sort();
    let surplus = files.len().saturating_sub(MAX_FILES);
    for (_, path) in &files[..surplus] {
        let _ = fs::remove_file(path);
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn lamp(intensity: f32) -> LightState {
        let lamp = PunctualLight {
            name: "lamp".to_owned(),
            kind: PunctualKind::Spot { inner_angle: 0.1, outer_angle: 0.2 },
            position: Vec3::ONE,
            direction: Vec3::NEG_Y,
            intensity: [intensity; 3],
            range: f32::INFINITY,
        };
        LightState { punctual: vec![lamp], environment_strength: 1.0, emissive_strength: 1.0 }
    }

    /// Fixed for good: files of earlier runs are told by it.
    #[test]
    fn lights_are_told_apart_by_their_numbers_and_by_no_printer() {
        let of = |lights: &LightState| hex::encode(identity(&lights_json(lights)).expect("encodes"));
        assert_eq!(of(&lamp(1.0)), "6de346cd3549169ab57ff4979a8d2f4177856aecb2234d6f4cda04b2c234b074");
        assert_ne!(of(&lamp(1.0_f32.next_up())), of(&lamp(1.0)));
        let renamed = {
            let mut lights = lamp(1.0);
            lights.punctual[0].name = "another name".to_owned();
            lights
        };
        assert_eq!(of(&renamed), of(&lamp(1.0)), "a name gives no light");
    }
}
