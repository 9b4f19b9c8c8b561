//! Scenes named on the command line.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use surfelcast_scene::{Environment, EnvironmentMap, LoadOptions, Scene, SceneLimits, ViewFile, load_file};

use crate::failure::Failure;

/// Loads a file or a built-in scene.
pub(crate) fn load(scene: &Path, view: Option<&PathBuf>, environment: Option<&PathBuf>) -> Result<Scene, Failure> {
    let mut options = LoadOptions::default();
    if let Some(path) = view {
        options.view = Some(ViewFile::read(path)?);
    }
    if let Some(path) = environment {
        options.environment = Some(Environment::Map(Arc::new(EnvironmentMap::read(path, &SceneLimits::default())?)));
    }
    Ok(load_file(scene, &options)?)
}

pub(crate) fn load_demos() -> Result<Vec<Arc<Scene>>, Failure> {
    Err(Failure::input("none yet"))
}
