//! `path`: progressive path tracing, one estimate for each pixel and no reuse between them.
//!
//! The reference of the product: unbiased at any sample count, its error falls as one over the root of the samples. Light
//! transport is described in `shaders/techniques/path/vertex.wesl`.
//!
//! Samples are taken in batches (`passes/batches.rs`).

use surfelcast_gpu::{Buffer, Gpu, GpuError, MemoryKind};
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck;

use crate::passes::batches::Batches;
use crate::passes::features::{features_for, general_features};
use crate::passes::frame::FrameView;
use crate::passes::kernels::KernelSet;
use crate::passes::lights::LightBuffers;
use crate::passes::upload::SceneBuffers;
use crate::passes::{counters, workgroups_of};
use crate::technique::{
    Change, Conformance, Step, StepBudget, Technique, TechniqueEntry, TechniqueError, TechniqueOptions,
};

/// Registry line.
pub const ENTRY: TechniqueEntry = TechniqueEntry {
    id: "path",
    label: "Path tracing",
    summary: "Unbiased reference: every pixel traced on its own, refined until its error is met.",
    conformance: Conformance::Unbiased,
    kernels: |_| KERNELS.to_vec(),
    uses_surfels: false,
    needs: |_| Ok(()),
    create: |gpu, scene, lights, _, options| Ok(Box::new(PathTracer::new(gpu, scene, lights, options)?)),
};

const KERNELS: &[&str] = &["path_trace"];

struct PathTracer {
    options: TechniqueOptions,
    kernels: KernelSet,
    /// `vec4f` a pixel: mean radiance, squared deviation of luminance. Written by `path_trace`; read by `tone_map`,
    /// `audit_gather` and the host; lives as long as the view.
    accumulation: Buffer,
    /// Rays by kind and samples that were not finite, of one dispatch.
    counters: Buffer,
    /// `vec4f` a pixel each: direct light and B. Only where asked for.
    split: Option<(Buffer, Buffer)>,
    batches: Batches,
}

impl PathTracer {
    fn new(
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        options: TechniqueOptions,
    ) -> Result<Self, GpuError> {
        let features = features_for(&scene.summary, options.materials, lights.punctual_count > 0, options.is_split);
        let general = general_features(options.materials, options.is_split);
        let kernels = KernelSet::new(gpu, KERNELS.to_vec(), features, general, options.waits_for_kernels)?;
        Self::with_kernels(gpu, options, kernels)
    }

    fn with_kernels(gpu: &Gpu, options: TechniqueOptions, kernels: KernelSet) -> Result<Self, GpuError> {
        let pixel_count = u64::from(options.size[0]) * u64::from(options.size[1]);
        let view_buffer = |label| gpu.buffer(label, MemoryKind::View, pixel_count * 16);
        let split = if options.is_split {
            Some((view_buffer("split_direct")?, view_buffer("split_irradiance")?))
        } else {
            None
        };
        Ok(Self {
            options,
            kernels,
            accumulation: view_buffer("accumulation")?,
            counters: counters::buffer(gpu)?,
            split,
            batches: Batches::new(options.size),
        })
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
        if !self.batches.begin(&budget) {
            return Ok(Step { is_whole: true, ..Step::default() });
        }
        self.kernels.refresh(gpu);
        let frame = view.uniforms(scene, lights, self.kernels.running(), self.options.seed);
        let range = self.batches.range(frame, budget.max_paths);
        let mut graph = gpu.graph("path");
        graph.clear(&self.counters)?;
        let mut pass = lights.bind(scene.bind(graph.pass(self.kernels.get(KERNELS[0])?)));
        pass = pass
            .uniform("frame", bytemuck::bytes_of(&range))
            .read_write("accumulation", &self.accumulation)
            .read_write("counters", &self.counters);
        if let Some((direct, irradiance)) = &self.split {
            pass = pass.read_write("split_direct", direct).read_write("split_irradiance", irradiance);
        }
        pass.dispatch(workgroups_of(range.pixel_count))?;
        let ticket = graph.read_back(&self.counters, 0..counters::BYTES)?;
        let mut report = graph.submit()?.wait()?;
        let counts = counters::sum(&report.take(ticket)?);

        let paths = self.batches.advance(&range);
        let is_whole = self.batches.is_traced();
        if is_whole {
            self.batches.finish();
        }
        Ok(Step { is_whole, paths, rays: counts.rays, non_finite: counts.non_finite, passes: report.passes })
    }

    fn invalidate(&mut self, change: Change) {
        match change {
            // Every pixel's estimate belongs to one camera and one set of lights.
            Change::Camera | Change::Lights => self.batches.restart(),
        }
    }

    fn picture(&self) -> &Buffer {
        &self.accumulation
    }

    fn samples(&self) -> u32 {
        self.batches.samples()
    }

    fn split(&self) -> Option<(&Buffer, &Buffer)> {
        self.split.as_ref().map(|(direct, irradiance)| (direct, irradiance))
    }

    fn features(&self) -> Features {
        self.kernels.features()
    }
}

/// A path tracer that stays with the general variant, to compare special ones with.
pub fn create_general(gpu: &Gpu, options: TechniqueOptions) -> Result<Box<dyn Technique>, TechniqueError> {
    let general = general_features(options.materials, options.is_split);
    let kernels = KernelSet::new(gpu, KERNELS.to_vec(), general, general, true)?;
    Ok(Box::new(PathTracer::with_kernels(gpu, options, kernels)?))
}
