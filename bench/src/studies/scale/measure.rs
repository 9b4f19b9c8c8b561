//! Measures one point of a series.

use std::collections::BTreeMap;

use surfelcast::Failure;
use surfelcast_gpu::Gpu;
use surfelcast_measure::Mode;
use surfelcast_render_api::Settings;
use surfelcast_renderer::progressive::Cost;
use surfelcast_scene::Scene;
use surfelcast_techniques::SessionState;
use surfelcast_techniques::surfel::SurfelSettings;

use crate::stage::{Shot, Stage};
use crate::studies::scale::scene::camera;
use crate::studies::scale::second_camera;

/// The technique under test, and the one that it is compared with as triangles grow.
pub(super) const SURFEL: &str = "surfel";
const PATH: &str = "path";
/// The pass that gathers surfels for pixels.
const LOOKUP_PASS: &str = "surfel_shade";
/// Frames before the timed ones: the first frames spawn surfels.
pub(super) const FRAMES_BEFORE: u32 = 8;
/// Frames of each camera that has rendered the room before.
const FRAMES_OF_OTHERS: u32 = 4;
pub(super) const SEED: u64 = 1;

/// What is measured, with its value.
#[derive(Clone, Copy, Debug)]
pub(super) enum Point {
    Triangles(u32),
    Capacity(u32),
    Radius(f32),
    Cameras(u32),
    SecondCamera,
}

impl Point {
    pub(super) fn series(self) -> &'static str {
        match self {
            Self::Triangles(_) => "triangles",
            Self::Capacity(_) => "capacity",
            Self::Radius(_) => "radius",
            Self::Cameras(_) => "cameras",
            Self::SecondCamera => "second_camera",
        }
    }

    pub(super) fn at(self) -> String {
        match self {
            Self::Triangles(count) | Self::Cameras(count) => count.to_string(),
            Self::Capacity(power) => (1_u32 << power).to_string(),
            Self::Radius(radius) => radius.to_string(),
            Self::SecondCamera => "1".to_owned(),
        }
    }

    fn measure(self, stage: &Stage<'_>, frames: u32) -> Result<BTreeMap<String, f64>, Failure> {
        let settings = SurfelSettings::default();
        match self {
            Self::SecondCamera => second_camera::measure(stage, frames),
            Self::Triangles(_) => {
                let mut values = measure_surfels(stage, settings, 0, frames)?;
                let mut shot = stage.shot(PATH, &Settings::default(), camera(0), SEED, &SessionState::default())?;
                values.insert("path_ms".to_owned(), median_frame(&mut shot, 1, frames)?.secs * 1e3);
                values.insert("triangles".to_owned(), f64::from(stage.scene.summary.triangle_count));
                values.insert("build_secs".to_owned(), stage.scene.build_secs);
                Ok(values)
            }
            Self::Capacity(power) => {
                measure_surfels(stage, SurfelSettings { capacity: 1 << power, ..settings }, 0, frames)
            }
            Self::Radius(radius) => {
                measure_surfels(stage, SurfelSettings { radius_pixels: radius, ..settings }, 0, frames)
            }
            Self::Cameras(others) => measure_surfels(stage, settings, others, frames),
        }
    }
}

/// Measures a point on a stage of its own, so that nothing of the one before is still held.
pub(super) fn measure(
    gpu: &Gpu,
    scene: &Scene,
    size: [u32; 2],
    frames: u32,
    point: Point,
) -> Result<BTreeMap<String, f64>, Failure> {
    let stage = Stage::new(gpu, scene, Mode::Lambert, size, 1.0)?;
    // Compiles the kernels.
    stage.shot(SURFEL, &Settings::default(), camera(0), SEED, &SessionState::default())?.render(1, f64::INFINITY)?;
    point.measure(&stage, frames)
}

/// Cost of what was rendered between two states.
fn between(before: &Cost, after: &Cost) -> Cost {
    let pass_ms = |cost: &Cost, name: &str| cost.passes.iter().find(|pass| pass.name == name).map_or(0.0, |p| p.gpu_ms);
    Cost {
        secs: after.secs - before.secs,
        gpu_secs: after.gpu_secs - before.gpu_secs,
        rays: [0, 1, 2].map(|i| after.rays[i] - before.rays[i]),
        non_finite: after.non_finite - before.non_finite,
        passes: after
            .passes
            .iter()
            .map(|pass| {
                let mut pass = pass.clone();
                pass.gpu_ms -= pass_ms(before, &pass.name);
                pass
            })
            .collect(),
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Medians over `frames` frames after `before` others.
fn median_frame(shot: &mut Shot<'_>, before: u32, frames: u32) -> Result<Cost, Failure> {
    let mut costs = Vec::new();
    shot.render(before, f64::INFINITY)?;
    for frame in 1..=frames {
        let cost = shot.cost().clone();
        shot.render(before + frame, f64::INFINITY)?;
        costs.push(between(&cost, shot.cost()));
    }
    let over = |value: &dyn Fn(&Cost) -> f64| median(costs.iter().map(value).collect());
    let names = costs.last().map(|cost| cost.passes.clone()).unwrap_or_default();
    Ok(Cost {
        secs: over(&|cost| cost.secs),
        gpu_secs: over(&|cost| cost.gpu_secs),
        rays: [0, 1, 2].map(|i| over(&|cost| cost.rays[i] as f64) as u64),
        non_finite: costs.iter().map(|cost| cost.non_finite).sum(),
        passes: names
            .into_iter()
            .map(|mut pass| {
                let of = |cost: &Cost| cost.passes.iter().find(|one| one.name == pass.name).map_or(0.0, |p| p.gpu_ms);
                pass.gpu_ms = median(costs.iter().map(of).collect());
                pass
            })
            .collect(),
    })
}

/// Time and memory of frames on a session that other cameras have used before.
fn measure_surfels(
    stage: &Stage<'_>,
    settings: SurfelSettings,
    others: u32,
    frames: u32,
) -> Result<BTreeMap<String, f64>, Failure> {
    let session = SessionState::default();
    for other in 1..=others {
        let mut shot = stage.shot(SURFEL, &settings.into(), camera(other), SEED, &session)?;
        shot.render(FRAMES_OF_OTHERS, f64::INFINITY)?;
    }
    let mut shot = stage.shot(SURFEL, &settings.into(), camera(0), SEED, &session)?;
    let cost = median_frame(&mut shot, FRAMES_BEFORE, frames)?;
    let lookup_ms = cost.passes.iter().find(|pass| pass.name == LOOKUP_PASS).map_or(0.0, |pass| pass.gpu_ms);
    let pixels = f64::from(stage.size[0]) * f64::from(stage.size[1]);
    let memory = stage.gpu.memory();
    let values = [
        ("frame_ms", cost.secs * 1e3),
        ("gpu_ms", cost.gpu_secs * 1e3),
        ("lookup_ns_a_pixel", lookup_ms * 1e6 / pixels),
        ("cache_rays", cost.rays[1] as f64),
        ("surfels", f64::from(shot.surfels().unwrap_or(0))),
        ("scene_mib", memory.scene_bytes as f64 / f64::from(1 << 20)),
        ("session_mib", memory.session_bytes as f64 / f64::from(1 << 20)),
    ];
    Ok(values.map(|(name, value)| (name.to_owned(), value)).into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_what_lies_between() {
        let cost = |secs: f64, ms: f64, rays: u64| Cost {
            secs,
            gpu_secs: secs / 2.0,
            rays: [rays; 3],
            non_finite: 0,
            passes: vec![surfelcast_gpu::PassTime { name: LOOKUP_PASS.to_owned(), gpu_ms: ms, dispatches: 1 }],
        };
        let frame = between(&cost(1.0, 10.0, 5), &cost(1.5, 30.0, 9));
        assert!((frame.secs - 0.5).abs() < 1e-12 && frame.rays == [4; 3]);
        assert!((frame.passes[0].gpu_ms - 20.0).abs() < 1e-12);
        assert_eq!(median(vec![3.0, 1.0, 2.0]), 2.0);
    }
}
