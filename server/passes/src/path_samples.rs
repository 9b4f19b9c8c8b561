//! Path-traced samples of an image: one unbiased estimate for each pixel and no reuse between them.
//!
//! Light transport is described in `shaders/techniques/path/vertex.wesl`; samples are taken in batches (`batches.rs`).

use surfelcast_gpu::{Buffer, Gpu, GpuError, MemoryKind};
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck;

use crate::batches::Batches;
use crate::frame::FrameView;
use crate::kernels::KernelSet;
use crate::lights::LightBuffers;
use crate::step::{Step, StepBudget};
use crate::upload::SceneBuffers;
use crate::{counters, workgroups_of};

/// The kernel that traces them.
pub const KERNEL: &str = "path_trace";

/// The path-traced samples of one image.
#[derive(Debug)]
pub struct PathSamples {
    kernels: KernelSet,
    seed: u64,
    /// `vec4f` by pixel: mean radiance, sum of squared deviations of the samples' luminance.
    accumulation: Buffer,
    /// Rays by kind and samples that were not finite, of one dispatch.
    counters: Buffer,
    /// `vec4f` by pixel each: light that bounced at most once, and irradiance over pi. Only where requested.
    split: Option<(Buffer, Buffer)>,
    batches: Batches,
}

impl PathSamples {
    /// No samples yet, for an image of this size. `kernels` must contain [`KERNEL`].
    pub fn new(gpu: &Gpu, kernels: KernelSet, size: [u32; 2], is_split: bool, seed: u64) -> Result<Self, GpuError> {
        let pixel_count = u64::from(size[0]) * u64::from(size[1]);
        let view_buffer = |label| gpu.buffer(label, MemoryKind::View, pixel_count * 16);
        let split =
            if is_split { Some((view_buffer("split_direct")?, view_buffer("split_irradiance")?)) } else { None };
        Ok(Self {
            kernels,
            seed,
            accumulation: view_buffer("path_accumulation")?,
            counters: counters::buffer(gpu)?,
            split,
            batches: Batches::new(size),
        })
    }

    /// Takes the next samples that the budget allows and waits for them.
    pub fn step(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        view: &FrameView,
        budget: StepBudget,
    ) -> Result<Step, GpuError> {
        if !self.batches.begin(&budget) {
            return Ok(Step { is_whole: true, ..Step::default() });
        }
        self.kernels.refresh(gpu);
        let frame = view.uniforms(scene, lights, self.kernels.running(), self.seed);
        let range = self.batches.range(frame, budget.max_paths);
        let mut graph = gpu.graph("path");
        graph.clear(&self.counters)?;
        let mut pass = lights.bind(scene.bind(graph.pass(self.kernels.get(KERNEL)?)));
        pass = pass
            .uniform("frame", bytemuck::bytes_of(&range))
            .bind("accumulation", &self.accumulation)
            .bind("counters", &self.counters);
        if let Some((direct, irradiance)) = &self.split {
            pass = pass.bind("split_direct", direct).bind("split_irradiance", irradiance);
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

    /// Discards all samples.
    pub const fn restart(&mut self) {
        self.batches.restart();
    }

    /// Mean radiance (rgb) and squared deviations (w) by pixel.
    pub const fn image(&self) -> &Buffer {
        &self.accumulation
    }

    /// Samples per pixel in whole batches.
    pub const fn count(&self) -> u32 {
        self.batches.samples()
    }

    /// Light that bounced at most once, and irradiance over pi.
    pub fn split(&self) -> Option<(&Buffer, &Buffer)> {
        self.split.as_ref().map(|(direct, irradiance)| (direct, irradiance))
    }

    /// Variant that fits the scene.
    pub fn features(&self) -> Features {
        self.kernels.features()
    }
}
