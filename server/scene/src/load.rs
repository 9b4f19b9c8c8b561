//! Loading: the file is decoded, then shown in its initial state.

use std::path::Path;

use crate::asset::check::within;
use crate::{LoadOptions, Scene, SceneAsset, SceneError, SceneState};

/// Loads a `.glb` or `.gltf` file. Buffers and images beside it are read from its folder only.
pub fn load_file(path: &Path, options: &LoadOptions) -> Result<Scene, SceneError> {
    let started = std::time::Instant::now();
    let read_error = |source| SceneError::Read { path: path.display().to_string(), source };
    let length = std::fs::metadata(path).map_err(read_error)?.len();
    within("file bytes", length, options.limits.max_file_bytes)?;
    let bytes = std::fs::read(path).map_err(read_error)?;
    let read_secs = started.elapsed().as_secs_f64();
    let mut scene = show(&SceneAsset::decode_file(path, &bytes, options)?)?;
    scene.load_secs += read_secs;
    Ok(scene)
}

/// Loads an uploaded GLB, or glTF JSON whose buffers and images are all `data:` URIs. `name` is for people only.
pub fn load_bytes(bytes: &[u8], name: &str, options: &LoadOptions) -> Result<Scene, SceneError> {
    show(&SceneAsset::decode(bytes, name, options)?)
}

fn show(asset: &SceneAsset<'_>) -> Result<Scene, SceneError> {
    Scene::build(asset, &SceneState::initial(asset)?)
}
