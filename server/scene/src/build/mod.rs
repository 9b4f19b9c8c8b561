//! From a file and a state to what the device uploads: placement, deformation, hierarchies, light triangles.

mod assemble;
pub mod bvh;
mod deform;
mod emission;
mod emit;
mod placement;
mod tangent;

use glam::{DVec3, Vec3};

use crate::asset::document::MAX_WARNINGS;
use crate::state::{camera, light};
use crate::{Bounds, Scene, SceneAsset, SceneError, SceneState, SceneSummary};

impl Scene {
    /// Builds the scene that a file shows in a state of it. Equal states give equal scenes.
    pub fn build(asset: &SceneAsset<'_>, state: &SceneState) -> Result<Self, SceneError> {
        let started = std::time::Instant::now();
        let assembled = assemble::assemble(asset, &state.nodes)?;
        let mut warnings = asset.warnings.clone();
        warnings.extend(assembled.warnings);
        let origin = assembled.origin;
        let bounds = assembled.bounds.unwrap_or(Bounds { min: Vec3::splat(-0.5), max: Vec3::splat(0.5) });

        let emissive_triangles =
            emission::measure(&assembled.emitters, &assembled.geometry, &asset.materials, &asset.textures);
        let punctual_lights = light::punctual(asset, &state.nodes, origin)?;
        let center: DVec3 = origin + bounds.center().as_dvec3();
        let mut cameras = asset.view.cameras.clone();
        if cameras.is_empty() {
            cameras = camera::cameras(asset, &state.nodes, center, &mut warnings)?;
        }
        if cameras.is_empty() {
            cameras.push(camera::framing(&bounds, origin));
        }
        if warnings.len() > MAX_WARNINGS {
            let more = warnings.len() - MAX_WARNINGS;
            warnings.truncate(MAX_WARNINGS);
            warnings.push(format!("and {more} more"));
        }
        let mut scene = Self {
            id: asset.id.clone(),
            state: state.key(),
            name: asset.name.clone(),
            origin,
            bounds,
            geometry: assembled.geometry,
            materials: asset.materials.clone(),
            textures: asset.textures.clone(),
            emissive_triangles,
            punctual_lights,
            environment: asset.environment.clone(),
            view: asset.view.clone(),
            cameras,
            node_names: assembled.node_names,
            summary: SceneSummary::default(),
            warnings,
            load_secs: (asset.load_secs + started.elapsed().as_secs_f64() - assembled.build_secs).max(0.0),
            build_secs: assembled.build_secs,
        };
        scene.summary = SceneSummary::of(&scene, asset.has_animation());
        Ok(scene)
    }
}
