//! Scenes named on the command line.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use surfelcast_scene::{
    Environment, EnvironmentMap, LoadOptions, NamedCamera, Scene, SceneLimits, ViewFile, demo, load_bytes, load_file,
};

use crate::failure::Failure;

/// Prefix of built-in scenes.
const DEMO_PREFIX: &str = "demo:";

/// Loads a file or a built-in scene.
pub fn load(scene: &Path, view: Option<&PathBuf>, environment: Option<&PathBuf>) -> Result<Scene, Failure> {
    let mut options = LoadOptions::default();
    if let Some(path) = view {
        options.view = Some(ViewFile::read(path)?);
    }
    if let Some(path) = environment {
        options.environment = Some(Environment::Map(Arc::new(EnvironmentMap::read(path, &SceneLimits::default())?)));
    }
    match scene.to_str().and_then(|text| text.strip_prefix(DEMO_PREFIX)) {
        Some(name) => load_demo(name, options),
        None => Ok(load_file(scene, &options)?),
    }
}

/// All built-in scenes, in the order in which they are offered.
pub fn load_demos() -> Result<Vec<Arc<Scene>>, Failure> {
    demo::scenes().iter().map(|demo| load_demo(demo.name, LoadOptions::default()).map(Arc::new)).collect()
}

fn load_demo(name: &str, mut options: LoadOptions) -> Result<Scene, Failure> {
    let demos = demo::scenes();
    let Some(demo) = demos.iter().find(|demo| demo.name == name) else {
        let known: Vec<&str> = demos.iter().map(|demo| demo.name).collect();
        return Err(Failure::input(format!(
            "{DEMO_PREFIX}{name} is not a built-in scene; there are {}",
            known.join(", ")
        )));
    };
    if options.view.is_none() {
        options.view = Some(ViewFile::parse(demo.view.as_bytes())?);
    }
    Ok(load_bytes(&demo.glb, name, &options)?)
}

/// The camera of that name, the first without one.
pub fn camera_of<'a>(scene: &'a Scene, name: Option<&str>) -> Result<&'a NamedCamera, Failure> {
    let Some(name) = name else {
        return scene.cameras.first().ok_or_else(|| Failure::input("the scene has no camera; give one with --view"));
    };
    scene.camera(name).ok_or_else(|| {
        let known: Vec<&str> = scene.cameras.iter().map(|camera| camera.name.as_str()).collect();
        Failure::input(format!("--camera {name}: the scene has no such camera; there are {}", known.join(", ")))
    })
}
