//! `path`: progressive path tracing, one estimate for each pixel and no reuse between them.
//!
//! The reference: unbiased at any sample count, with an error that falls as one over the root of the samples. Its
//! samples are in the passes (`path_samples.rs`), since settling takes the same.

use std::sync::Arc;

use surfelcast_gpu::{Buffer, Gpu, GpuError};
use surfelcast_render_api::TechniqueDescription;
use surfelcast_shaders::Features;

use crate::technique::{Change, Conformance, Technique, TechniqueEntry, TechniqueError, TechniqueOptions};
use surfelcast_passes::features::{features_for, general_features};
use surfelcast_passes::frame::FrameView;
use surfelcast_passes::kernels::KernelSet;
use surfelcast_passes::lights::LightBuffers;
use surfelcast_passes::path_samples::{KERNEL, PathSamples};
use surfelcast_passes::step::{Step, StepBudget};
use surfelcast_passes::upload::SceneBuffers;

/// Registry line.
pub const ENTRY: TechniqueEntry = TechniqueEntry {
    description: TechniqueDescription {
        id: "path",
        label: "Path tracing",
        summary: "Unbiased reference: every pixel traced on its own, refined until its error is met.",
        aliases: &[],
        settings: &[],
        presets: &[],
        outputs: &[],
        export: None,
    },
    conformance: |_| Conformance::Unbiased,
    kernels: |_| vec![KERNEL],
    needs: |_| Ok(()),
    create: |gpu, scene, lights, _, options| {
        let features = features_for(&scene.summary, options.materials, lights.punctual_count > 0, options.is_split);
        Ok(Box::new(PathTracer::new(gpu, &options, features)?))
    },
    open_session: || Arc::new(()),
};

struct PathTracer {
    samples: PathSamples,
}

impl PathTracer {
    fn new(gpu: &Gpu, options: &TechniqueOptions, features: Features) -> Result<Self, GpuError> {
        let general = general_features(options.materials, options.is_split);
        let kernels = KernelSet::new(gpu, vec![KERNEL], features, general, options.waits_for_kernels)?;
        Ok(Self { samples: PathSamples::new(gpu, kernels, options.size, options.is_split, options.seed)? })
    }
}

impl Technique for PathTracer {
    fn step(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        view: &FrameView,
        budget: StepBudget,
    ) -> Result<Step, TechniqueError> {
        Ok(self.samples.step(gpu, scene, lights, view, budget)?)
    }

    fn invalidate(&mut self, change: Change) {
        match change {
            // Every pixel's estimate belongs to one camera, one set of lights and one arrangement of objects.
            Change::Camera | Change::Lights | Change::Transforms => self.samples.restart(),
        }
    }

    fn picture(&self) -> &Buffer {
        self.samples.image()
    }

    fn samples(&self) -> u32 {
        self.samples.count()
    }

    fn split(&self) -> Option<(&Buffer, &Buffer)> {
        self.samples.split()
    }

    fn features(&self) -> Features {
        self.samples.features()
    }
}

/// A path tracer that keeps the general kernel variant, for comparison with special ones.
pub fn create_general(gpu: &Gpu, options: TechniqueOptions) -> Result<Box<dyn Technique>, TechniqueError> {
    let general = general_features(options.materials, options.is_split);
    let options = TechniqueOptions { waits_for_kernels: true, ..options };
    Ok(Box::new(PathTracer::new(gpu, &options, general)?))
}
