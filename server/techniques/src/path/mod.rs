//! `path`: progressive path tracing, one estimate for each pixel and no reuse between them.
//!
//! The reference of the product: unbiased at any sample count, its error falls as one over the root of the samples. Light
//! transport is described in `shaders/techniques/path/vertex.wesl`.
//!
//! Samples are taken in *batches*: the same number for every pixel, in ranges of pixels small enough that no submission
//! holds the device for long. The numbers drawn and the order in which a pixel's samples are merged depend on the batch
//! sizes only, which follow from the sample count, never on timing. The same job therefore gives the same bytes.

use surfelcast_gpu::{Buffer, Gpu, GpuError, Kernel, MemoryKind, PassTime};
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::{Feature, Features};

use crate::passes::counters;
use crate::passes::features::features_for;
use crate::passes::frame::FrameView;
use crate::passes::lights::LightBuffers;
use crate::passes::upload::SceneBuffers;
use crate::technique::{
    Change, Conformance, MaterialMode, Step, StepBudget, Technique, TechniqueEntry, TechniqueError, TechniqueOptions,
};

/// Registry line.
pub const ENTRY: TechniqueEntry = TechniqueEntry {
    id: "path",
    label: "Path tracing",
    summary: "Unbiased reference: every pixel traced on its own, refined until its error is met.",
    conformance: Conformance::Unbiased,
    kernels: &["path_trace"],
    needs: |_| Ok(()),
    create: |gpu, scene, lights, _, options| Ok(Box::new(PathTracer::new(gpu, scene, lights, options)?)),
};

/// The kernel.
const KERNEL: &str = "path_trace";
/// Threads of a workgroup of it.
const WORKGROUP: u32 = 64;
/// Pixels of one dispatch at most: workgroups of one dimension.
const MAX_PIXELS: u32 = 65_535 * WORKGROUP;

struct PathTracer {
    options: TechniqueOptions,
    /// Variant that fits the scene.
    features: Features,
    kernel: Kernel,
    /// Variant of `kernel`: the general one until the fitting one is compiled.
    running_features: Features,
    /// `vec4f` a pixel: mean radiance, squared deviation of luminance. Written by `path_trace`; read by `tone_map`,
    /// `audit_gather` and the host; lives as long as the view.
    accumulation: Buffer,
    /// Rays by kind and samples that were not finite, of one dispatch.
    counters: Buffer,
    /// `vec4f` a pixel each: direct light and B. Only where asked for.
    split: Option<(Buffer, Buffer)>,
    /// Samples a pixel in whole batches.
    samples: u32,
    /// Size of the batch in hand; 0 between batches.
    batch: u32,
    /// Pixels of the batch in hand that are done.
    batch_pixels: u32,
}

impl PathTracer {
    fn new(
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        options: TechniqueOptions,
    ) -> Result<Self, GpuError> {
        let features = features_for(&scene.summary, options.materials, lights.punctual_count > 0, options.is_split);
        if options.waits_for_kernels || gpu.kernel_if_ready(KERNEL, features).is_some() {
            return Self::with_variant(gpu, options, features, features);
        }
        // The first picture does not wait for a compiler.
        gpu.prepare(KERNEL, features);
        Self::with_variant(gpu, options, features, general_features(options.materials, options.is_split))
    }

    fn with_variant(
        gpu: &Gpu,
        options: TechniqueOptions,
        features: Features,
        running_features: Features,
    ) -> Result<Self, GpuError> {
        let pixel_count = u64::from(options.size[0]) * u64::from(options.size[1]);
        let view_buffer = |label| gpu.buffer(label, MemoryKind::View, pixel_count * 16);
        let split = if options.is_split {
            Some((view_buffer("split_direct")?, view_buffer("split_irradiance")?))
        } else {
            None
        };
        Ok(Self {
            options,
            features,
            kernel: gpu.kernel(KERNEL, running_features)?,
            running_features,
            accumulation: view_buffer("accumulation")?,
            counters: counters::buffer(gpu)?,
            split,
            samples: 0,
            batch: 0,
            batch_pixels: 0,
        })
    }

    /// Size of the batch that follows: as many samples as there are already, so that a first picture comes soon and
    /// later ones cost little overhead.
    fn next_batch(&self, budget: &StepBudget) -> u32 {
        let left = budget.until_samples.saturating_sub(self.samples);
        self.samples.max(1).min(budget.max_batch.max(1)).min(left)
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
        let pixel_count = self.options.size[0] * self.options.size[1];
        if self.batch == 0 {
            self.batch = self.next_batch(&budget);
        }
        if self.batch == 0 {
            return Ok(Step { is_whole: true, ..Step::default() });
        }
        if self.running_features != self.features
            && let Some(kernel) = gpu.kernel_if_ready(KERNEL, self.features)
        {
            self.kernel = kernel;
            self.running_features = self.features;
        }
        let affordable_groups = budget.max_paths / u64::from(self.batch) / u64::from(WORKGROUP);
        let groups = affordable_groups.clamp(1, u64::from(MAX_PIXELS / WORKGROUP)) as u32;
        let range = (groups * WORKGROUP).min(pixel_count - self.batch_pixels);

        let mut uniforms = view.uniforms(scene, lights, self.running_features, self.options.seed);
        uniforms.first_pixel = self.batch_pixels;
        uniforms.pixel_count = range;
        uniforms.first_sample = self.samples;
        uniforms.sample_count = self.batch;

        let mut graph = gpu.graph("path");
        graph.clear(&self.counters)?;
        let mut pass = lights.bind(scene.bind(graph.pass(&self.kernel)));
        pass = pass
            .uniform("frame", bytemuck::bytes_of(&uniforms))
            .read_write("accumulation", &self.accumulation)
            .read_write("counters", &self.counters);
        if let Some((direct, irradiance)) = &self.split {
            pass = pass.read_write("split_direct", direct).read_write("split_irradiance", irradiance);
        }
        pass.dispatch([range.div_ceil(WORKGROUP), 1, 1])?;
        let ticket = graph.read_back(&self.counters, 0..counters::BYTES)?;
        let mut report = graph.submit()?.wait()?;
        let counts = counters::sum(&report.take(ticket)?);

        let paths = u64::from(range) * u64::from(self.batch);
        self.batch_pixels += range;
        let is_whole = self.batch_pixels == pixel_count;
        if is_whole {
            self.samples += self.batch;
            self.batch = 0;
            self.batch_pixels = 0;
        }
        Ok(Step { is_whole, paths, rays: counts.rays, non_finite: counts.non_finite, passes: report.passes })
    }

    fn invalidate(&mut self, change: Change) {
        match change {
            // Every pixel's estimate belongs to one camera and one set of lights.
            Change::Camera | Change::Lights => {
                self.samples = 0;
                self.batch = 0;
                self.batch_pixels = 0;
            }
        }
    }

    fn picture(&self) -> &Buffer {
        &self.accumulation
    }

    fn samples(&self) -> u32 {
        self.samples
    }

    fn split(&self) -> Option<(&Buffer, &Buffer)> {
        self.split.as_ref().map(|(direct, irradiance)| (direct, irradiance))
    }

    fn features(&self) -> Features {
        self.features
    }
}

/// A path tracer that stays with the general variant, to compare special ones with.
pub fn create_general(gpu: &Gpu, options: TechniqueOptions) -> Result<Box<dyn Technique>, TechniqueError> {
    let general = general_features(options.materials, options.is_split);
    Ok(Box::new(PathTracer::with_variant(gpu, options, general, general)?))
}

/// The variant that serves any scene with these materials.
pub fn general_features(materials: MaterialMode, is_split: bool) -> Features {
    // How a cache is applied is chosen, whatever the scene.
    let any_scene = Features::ALL.without(Feature::Splat);
    any_scene.set(Feature::Pbr, materials == MaterialMode::Pbr).set(Feature::Split, is_split)
}

/// Sums the times of passes of one name.
pub fn merge_passes(into: &mut Vec<PassTime>, from: Vec<PassTime>) {
    for pass in from {
        match into.iter_mut().find(|known| known.name == pass.name) {
            Some(known) => {
                known.gpu_ms += pass.gpu_ms;
                known.dispatches += pass.dispatches;
            }
            None => into.push(pass),
        }
    }
}
