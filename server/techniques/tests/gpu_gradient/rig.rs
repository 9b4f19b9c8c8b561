//! Renders small images.

use surfelcast_gpu::{Buffer, Gpu, GpuOptions};
use surfelcast_passes::step::{Step, StepBudget};
use surfelcast_render_api::Settings;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_techniques::gradient::{GradientTracer, Reconstruction};
use surfelcast_techniques::technique::{Technique, TechniqueOptions};
use surfelcast_techniques::{FrameView, LightBuffers, MaterialMode, SceneBuffers, SessionState, TECHNIQUES, registry};

use crate::scenes::Setting;

pub(crate) fn gpu() -> Gpu {
    Gpu::open(&GpuOptions::default()).unwrap()
}

/// A setting on the device.
pub(crate) struct Rig<'a> {
    pub(crate) gpu: &'a Gpu,
    pub(crate) buffers: SceneBuffers,
    pub(crate) lights: LightBuffers,
    pub(crate) view: FrameView,
    pub(crate) materials: MaterialMode,
}

impl<'a> Rig<'a> {
    pub(crate) fn new(gpu: &'a Gpu, setting: &Setting, size: [u32; 2]) -> Self {
        Self {
            gpu,
            buffers: SceneBuffers::new(gpu, &setting.scene).unwrap(),
            lights: LightBuffers::new(gpu, &setting.scene, &setting.lights).unwrap(),
            view: FrameView { camera: setting.camera, size, exposure: 1.0 },
            materials: MaterialMode::Pbr,
        }
    }

    pub(crate) fn options(&self, seed: u64) -> TechniqueOptions {
        TechniqueOptions {
            size: self.view.size,
            full_size: self.view.size,
            materials: self.materials,
            is_split: false,
            seed,
            waits_for_kernels: true,
            settings: Settings::default(),
        }
    }

    pub(crate) fn gradient(&self, seed: u64, reconstruction: Reconstruction) -> GradientTracer {
        GradientTracer::new(self.gpu, &self.buffers, &self.lights, self.options(seed), reconstruction).unwrap()
    }

    pub(crate) fn technique(&self, id: &str, seed: u64) -> Box<dyn Technique> {
        let (entry, settings) = registry::find(TECHNIQUES, id).unwrap();
        let options = TechniqueOptions { settings, ..self.options(seed) };
        entry.start(self.gpu, &self.buffers, &self.lights, &SessionState::default(), options).unwrap()
    }

    /// Renders until the image has `samples` samples per pixel, in steps of at most `max_paths` paths. Returns its
    /// number of rays.
    pub(crate) fn render(&self, technique: &mut dyn Technique, samples: u32, max_paths: u64) -> u64 {
        let mut rays = 0;
        while technique.samples() < samples {
            let budget = StepBudget { max_paths, until_samples: samples, max_batch: 64 };
            let step: Step = technique.step(self.gpu, &self.buffers, &self.lights, &self.view, budget).unwrap();
            assert_eq!(step.non_finite, 0);
            rays += step.rays.iter().sum::<u64>();
        }
        rays
    }

    pub(crate) fn read(&self, buffer: &Buffer) -> Vec<[f32; 4]> {
        let mut graph = self.gpu.graph("read");
        let ticket = graph.read_back(buffer, 0..buffer.size_bytes()).unwrap();
        let bytes = graph.submit().unwrap().wait().unwrap().take(ticket).unwrap();
        bytemuck::pod_collect_to_vec(&bytes)
    }

    /// The image after `samples` samples per pixel.
    pub(crate) fn picture(&self, id: &str, seed: u64, samples: u32) -> Vec<[f32; 4]> {
        let mut technique = self.technique(id, seed);
        self.render(technique.as_mut(), samples, u64::MAX);
        self.read(technique.picture())
    }
}

/// Mean of a running sum of numbers with its standard error.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Mean {
    count: f64,
    sum: f64,
    squares: f64,
}

impl Mean {
    pub(crate) fn add(&mut self, value: f64) {
        self.count += 1.0;
        self.sum += value;
        self.squares += value * value;
    }

    pub(crate) fn mean(&self) -> f64 {
        self.sum / self.count
    }

    pub(crate) fn std_error(&self) -> f64 {
        let variance = (self.squares - self.sum * self.sum / self.count) / (self.count - 1.0);
        (variance.max(0.0) / self.count).sqrt()
    }
}
