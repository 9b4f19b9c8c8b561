//! Renders small images with the surfel technique.

use glam::DVec3;
use surfelcast_gpu::{Buffer, Gpu, GpuOptions};
use surfelcast_passes::step::StepBudget;
use surfelcast_scene::{Camera, Scene};
use surfelcast_shaders::layout::bytemuck;
use surfelcast_techniques::surfel::SurfelSettings;
use surfelcast_techniques::technique::{Technique, TechniqueOptions};
use surfelcast_techniques::{FrameView, LightBuffers, LightState, MaterialMode, SceneBuffers, SessionState, registry};

pub(crate) fn gpu() -> Gpu {
    Gpu::open(&GpuOptions::default()).unwrap()
}

pub(crate) fn camera(position: [f64; 3], target: [f64; 3]) -> Camera {
    Camera { position: DVec3::from(position), target: DVec3::from(target), up: DVec3::Y, vfov: 1.2 }
}

/// A scene on the device with a session.
pub(crate) struct Rig<'a> {
    pub(crate) gpu: &'a Gpu,
    pub(crate) buffers: SceneBuffers,
    pub(crate) lights: LightBuffers,
    pub(crate) session: SessionState,
    pub(crate) settings: SurfelSettings,
    pub(crate) materials: MaterialMode,
    pub(crate) size: [u32; 2],
    /// Full size, which decides on the radii of surfels.
    pub(crate) full_size: [u32; 2],
    pub(crate) is_split: bool,
}

impl<'a> Rig<'a> {
    pub(crate) fn new(gpu: &'a Gpu, scene: &'a Scene, settings: SurfelSettings, size: [u32; 2]) -> Self {
        Self {
            gpu,
            buffers: SceneBuffers::new(gpu, scene).unwrap(),
            lights: LightBuffers::new(gpu, scene, &LightState::of_scene(scene)).unwrap(),
            session: SessionState::default(),
            settings,
            materials: MaterialMode::Lambert,
            size,
            full_size: size,
            is_split: true,
        }
    }

    pub(crate) fn picture(&self) -> Box<dyn Technique> {
        self.picture_by("surfel", 5)
    }

    pub(crate) fn picture_by(&self, technique: &str, seed: u64) -> Box<dyn Technique> {
        let options = TechniqueOptions {
            size: self.size,
            full_size: self.full_size,
            materials: self.materials,
            is_split: self.is_split,
            seed,
            waits_for_kernels: true,
            settings: self.settings.into(),
        };
        let entry = registry::by_id(technique).unwrap();
        entry.start(self.gpu, &self.buffers, &self.lights, &self.session, options).unwrap()
    }

    /// Renders until the image has `frames` frames. Returns the number of secondary rays, without shadow rays.
    pub(crate) fn frames(&self, picture: &mut dyn Technique, camera: Camera, frames: u32) -> u64 {
        self.frames_in_pieces(picture, camera, frames, u64::MAX)
    }

    /// The same in steps of at most `paths` paths.
    pub(crate) fn frames_in_pieces(&self, picture: &mut dyn Technique, camera: Camera, frames: u32, paths: u64) -> u64 {
        self.rays(picture, camera, frames, paths)[1]
    }

    /// The same; returns the numbers of camera rays, secondary rays and shadow rays.
    pub(crate) fn rays(&self, picture: &mut dyn Technique, camera: Camera, frames: u32, paths: u64) -> [u64; 3] {
        let view = FrameView { camera, size: self.size, exposure: 1.0 };
        let mut rays = [0; 3];
        while picture.samples() < frames {
            let budget = StepBudget { max_paths: paths, until_samples: frames, max_batch: 64 };
            let step = picture.step(self.gpu, &self.buffers, &self.lights, &view, budget).unwrap();
            assert_eq!(step.non_finite, 0);
            rays = std::array::from_fn(|kind| rays[kind] + step.rays[kind]);
        }
        rays
    }

    pub(crate) fn read(&self, buffer: &Buffer) -> Vec<[f32; 4]> {
        let mut graph = self.gpu.graph("read");
        let ticket = graph.read_back(buffer, 0..buffer.size_bytes()).unwrap();
        let bytes = graph.submit().unwrap().wait().unwrap().take(ticket).unwrap();
        bytemuck::pod_collect_to_vec(&bytes)
    }

    /// Red channel of the image.
    pub(crate) fn values(&self, picture: &dyn Technique) -> Vec<f32> {
        self.read(picture.picture()).iter().map(|pixel| pixel[0]).collect()
    }
}

pub(crate) fn mean(values: &[f32]) -> f64 {
    values.iter().map(|&value| f64::from(value)).sum::<f64>() / values.len() as f64
}

/// RMSE of tone-mapped images.
pub(crate) fn tone_mapped_rmse(values: &[f32], truth: &[f32]) -> f64 {
    let tone = |x: &f32| x / (1.0 + x);
    let [values, truth] = [values, truth].map(|picture| picture.iter().map(tone).collect::<Vec<_>>());
    rmse(&values, &truth)
}

pub(crate) fn rmse(a: &[f32], b: &[f32]) -> f64 {
    mean(&a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).collect::<Vec<_>>()).sqrt()
}

/// Means over squares of `side` pixels.
pub(crate) fn blocks(values: &[f32], size: [u32; 2], side: u32) -> Vec<f64> {
    let mut means = Vec::new();
    for y in 0..size[1] / side {
        for x in 0..size[0] / side {
            let inside = (0..side * side).map(|i| ((y * side + i / side) * size[0] + x * side + i % side) as usize);
            means.push(inside.map(|index| f64::from(values[index])).sum::<f64>() / f64::from(side * side));
        }
    }
    means
}
