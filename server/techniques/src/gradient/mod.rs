//! `gradient`: gradient-domain path tracing (Kettunen et al. 2015). Every path is shifted to the four neighbouring
//! pixels; the differences are far less noisy than the values, and a screened Poisson problem combines both in one
//! image. Light transport and shifts are described in `shaders/techniques/gradient`.
//!
//! Batches of samples are those of `path`; after each whole batch the image is reconstructed again. Weights are the
//! same everywhere and known in advance, so the least-squares image is linear in the measurements, and unbiased.

mod spread;

use std::sync::Arc;

use surfelcast_gpu::{Buffer, Gpu, Kernel, MemoryKind};
use surfelcast_render_api::{Setting, SettingKind, SettingValue, Settings, TechniqueAlias, TechniqueDescription};
use surfelcast_shaders::Features;
use surfelcast_shaders::constants::GRADIENT_SCREEN;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::GradientUniforms;

use crate::technique::{Change, Conformance, Technique, TechniqueEntry, TechniqueError, TechniqueOptions};
use surfelcast_passes::batches::Batches;
use surfelcast_passes::features::{features_for, general_features};
use surfelcast_passes::frame::FrameView;
use surfelcast_passes::kernels::KernelSet;
use surfelcast_passes::lights::LightBuffers;
use surfelcast_passes::poisson::{Norm, PoissonProblem, PoissonSettings, PoissonSolver};
use surfelcast_passes::step::{Step, StepBudget};
use surfelcast_passes::upload::SceneBuffers;
use surfelcast_passes::{counters, merge_passes, workgroups_of};

/// What is minimised: the names are those of [`norm_of`].
const NORM: Setting = Setting {
    id: "norm",
    label: "Norm",
    help: "l2: squared residuals, unbiased. l1: absolute residuals, in which outliers fade at the price of a small bias",
    unit: "",
    kind: SettingKind::Choice { default: "l2", names: &["l2", "l1"] },
};

/// Registry line.
pub const ENTRY: TechniqueEntry = TechniqueEntry {
    description: TechniqueDescription {
        id: "gradient",
        label: "Gradient domain",
        summary: "Path tracing of pixels and of their differences, and the picture that fits both in least squares.",
        aliases: &[TechniqueAlias {
            id: "gradient_l1",
            label: "Gradient domain, robust",
            summary: "The same by absolute instead of squared residuals: outliers fade, at the price of a small bias.",
            values: &[(NORM.id, SettingValue::name("l1"))],
        }],
        settings: &[NORM],
        presets: &[],
        outputs: &[],
        export: None,
    },
    conformance: |settings| match norm_of(settings) {
        Norm::L2 => Conformance::Unbiased,
        Norm::L1 { .. } => Conformance::Consistent,
    },
    kernels: |_| KERNELS.to_vec(),
    needs: |_| Ok(()),
    create: |gpu, scene, lights, _, options| {
        let reconstruction = Reconstruction::Poisson(norm_of(&options.settings));
        Ok(Box::new(GradientTracer::new(gpu, scene, lights, options, reconstruction)?))
    },
    open_session: || Arc::new(()),
};

fn norm_of(settings: &Settings) -> Norm {
    if settings.choice(&NORM) == 0 { Norm::L2 } else { Norm::L1 { rounds: L1_ROUNDS, scale: 1.0 } }
}

/// The kernels that depend on the scene's features.
const KERNELS: &[&str] = &["gradient_trace", "gradient_weights"];
/// Largest number of iterations of a round, and the residual that ends it sooner.
const ITERATIONS: u32 = 32;
const TOLERANCE: f32 = 3e-4;
/// Reweighted rounds of the L1 norm.
const L1_ROUNDS: u32 = 4;

/// How values and differences become an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reconstruction {
    /// A screened Poisson problem in this norm.
    Poisson(Norm),
    /// The values alone: path tracing at a higher cost, to inspect the input of the reconstruction.
    None,
}

/// What the technique does next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Trace,
    /// Sets up the problem of a traced batch.
    Begin,
    /// Solves it.
    Solve,
}

/// A gradient-domain path tracer of one image.
#[derive(Debug)]
pub struct GradientTracer {
    options: TechniqueOptions,
    kernels: KernelSet,
    edges: Kernel,
    compose: Kernel,
    /// `vec4f` by pixel: mean radiance and squared deviation of luminance of the values that are reconstructed.
    accumulation: Buffer,
    /// The same for directly visible light.
    seen_means: Buffer,
    /// Four `vec4f` by pixel: this side's part of the differences to the right, left, below, above.
    shift_means: Buffer,
    /// The problem: two `vec4f` by pixel, one, and its solution.
    differences: Buffer,
    weights: Buffer,
    solution: Buffer,
    /// The reconstruction with its noise.
    picture: Buffer,
    counters: Buffer,
    solver: Option<PoissonSolver>,
    phase: Phase,
    batches: Batches,
}

impl GradientTracer {
    /// For one image.
    pub fn new(
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        options: TechniqueOptions,
        reconstruction: Reconstruction,
    ) -> Result<Self, TechniqueError> {
        if options.is_split {
            return Err(TechniqueError::Unsupported {
                technique: ENTRY.id(),
                reason: "direct and indirect light are not kept apart; ask `path` for them".to_owned(),
            });
        }
        let features = features_for(&scene.summary, options.materials, lights.punctual_count > 0, false);
        let general = general_features(options.materials, false);
        let kernels = KernelSet::new(gpu, KERNELS.to_vec(), features, general, options.waits_for_kernels)?;
        let pixels = u64::from(options.size[0]) * u64::from(options.size[1]);
        let buffer = |label, vectors: u64| gpu.buffer(label, MemoryKind::View, pixels * 16 * vectors);
        let solver = match reconstruction {
            Reconstruction::Poisson(norm) => {
                let settings = PoissonSettings {
                    norm,
                    iterations: ITERATIONS,
                    tolerance: TOLERANCE,
                    ..PoissonSettings::default()
                };
                Some(PoissonSolver::new(gpu, options.size, settings)?)
            }
            Reconstruction::None => None,
        };
        Ok(Self {
            kernels,
            edges: gpu.kernel("gradient_edges", Features::NONE)?,
            compose: gpu.kernel("gradient_picture", Features::NONE)?,
            accumulation: buffer("accumulation", 1)?,
            seen_means: buffer("seen_means", 1)?,
            shift_means: buffer("shift_means", 4)?,
            differences: buffer("poisson_differences", 2)?,
            weights: buffer("poisson_weights", 1)?,
            solution: buffer("poisson_solution", 1)?,
            picture: buffer("picture", 1)?,
            counters: counters::buffer(gpu)?,
            solver,
            phase: Phase::Trace,
            batches: Batches::new(options.size),
            options,
        })
    }

    /// Mean radiance by pixel before reconstruction, without directly visible light; `vec4f`.
    pub fn values(&self) -> &Buffer {
        &self.accumulation
    }

    /// Mean directly visible radiance by pixel; `vec4f`.
    pub fn seen(&self) -> &Buffer {
        &self.seen_means
    }

    /// Measured differences to the right and downwards; two `vec4f` by pixel.
    pub fn differences(&self) -> &Buffer {
        &self.differences
    }

    /// Weights of the reconstruction; `vec4f` by pixel.
    pub fn weights(&self) -> &Buffer {
        &self.weights
    }

    fn pixel_count(&self) -> u32 {
        self.options.size[0] * self.options.size[1]
    }

    fn trace(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        view: &FrameView,
        max_paths: u64,
    ) -> Result<Step, TechniqueError> {
        let frame = view.uniforms(scene, lights, self.kernels.running(), self.options.seed);
        let range = self.batches.range(frame, max_paths);
        let groups = workgroups_of(range.pixel_count);
        let mut graph = gpu.graph("gradient");
        graph.clear(&self.counters)?;
        lights
            .bind(scene.bind(graph.pass(self.kernels.get(KERNELS[0])?)))
            .uniform("frame", bytemuck::bytes_of(&range))
            .bind("accumulation", &self.accumulation)
            .bind("seen_means", &self.seen_means)
            .bind("shift_means", &self.shift_means)
            .bind("counters", &self.counters)
            .dispatch(groups)?;
        if range.first_sample == 0 {
            // Once for a camera, in pieces like the paths.
            lights
                .bind(scene.bind(graph.pass(self.kernels.get(KERNELS[1])?)))
                .uniform("frame", bytemuck::bytes_of(&range))
                .bind("poisson_weights", &self.weights)
                .dispatch(groups)?;
        }
        let ticket = graph.read_back(&self.counters, 0..counters::BYTES)?;
        let mut report = graph.submit()?.wait()?;
        let counts = counters::sum(&report.take(ticket)?);
        let paths = self.batches.advance(&range);
        if self.batches.is_traced() {
            self.phase = Phase::Begin;
        }
        Ok(Step { paths, rays: counts.rays, non_finite: counts.non_finite, passes: report.passes, ..Step::default() })
    }

    /// One submission of the reconstruction. Returns whether the image is finished.
    fn reconstruct(&mut self, gpu: &Gpu, exposure: f32, step: &mut Step) -> Result<bool, TechniqueError> {
        if self.phase == Phase::Begin {
            let mut graph = gpu.graph("gradient_edges");
            graph
                .pass(&self.edges)
                .uniform("gradient", bytemuck::bytes_of(&self.uniforms([0.0; 2])))
                .bind("shift_means", &self.shift_means)
                .bind("poisson_differences", &self.differences)
                .dispatch(workgroups_of(self.pixel_count()))?;
            merge_passes(&mut step.passes, graph.submit()?.wait()?.passes);
        }
        if let Some(solver) = &mut self.solver {
            let problem = PoissonProblem {
                value: &self.accumulation,
                weights: &self.weights,
                differences: &self.differences,
                solution: &self.solution,
            };
            if self.phase == Phase::Begin {
                // The scale of residuals is that of the shown image.
                solver.set_scale(1.0 / exposure.max(1e-6));
                solver.begin(gpu, &problem)?;
                self.phase = Phase::Solve;
                return Ok(false);
            }
            if !solver.advance(gpu, &problem, u32::MAX)? {
                return Ok(false);
            }
            merge_passes(&mut step.passes, solver.take_report().passes);
        }
        self.write_picture(gpu, step)?;
        Ok(true)
    }

    /// Writes the image.
    fn write_picture(&self, gpu: &Gpu, step: &mut Step) -> Result<(), TechniqueError> {
        // Without reconstruction the values are the image, and their noise is its noise.
        let (source, factors) = match self.solver {
            Some(_) => (&self.solution, spread::variance_factors(GRADIENT_SCREEN)),
            None => (&self.accumulation, [1.0, 0.0]),
        };
        let mut graph = gpu.graph("gradient_picture");
        graph
            .pass(&self.compose)
            .uniform("gradient", bytemuck::bytes_of(&self.uniforms(factors)))
            .bind("accumulation", &self.accumulation)
            .bind("poisson_differences", &self.differences)
            .bind("poisson_solution", source)
            .bind("seen_means", &self.seen_means)
            .bind("picture", &self.picture)
            .dispatch(workgroups_of(self.pixel_count()))?;
        merge_passes(&mut step.passes, graph.submit()?.wait()?.passes);
        Ok(())
    }

    fn uniforms(&self, [value_factor, edge_factor]: [f32; 2]) -> GradientUniforms {
        let [width, height] = self.options.size;
        GradientUniforms { width, height, value_factor, edge_factor }
    }
}

impl Technique for GradientTracer {
    fn step(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        view: &FrameView,
        budget: StepBudget,
    ) -> Result<Step, TechniqueError> {
        if self.phase == Phase::Trace {
            if !self.batches.begin(&budget) {
                return Ok(Step { is_whole: true, ..Step::default() });
            }
            self.kernels.refresh(gpu);
            return self.trace(gpu, scene, lights, view, budget.max_paths);
        }
        // A step of the reconstruction traces no path and must not count in the measured rate of paths.
        let mut step = Step::default();
        if self.reconstruct(gpu, view.exposure, &mut step)? {
            self.batches.finish();
            self.phase = Phase::Trace;
            step.is_whole = true;
        }
        Ok(step)
    }

    fn invalidate(&mut self, change: Change) {
        match change {
            // Every estimate belongs to one camera, one set of lights and one arrangement of objects.
            Change::Camera | Change::Lights | Change::Transforms => {
                self.phase = Phase::Trace;
                self.batches.restart();
            }
        }
    }

    fn picture(&self) -> &Buffer {
        &self.picture
    }

    fn samples(&self) -> u32 {
        self.batches.samples()
    }

    fn split(&self) -> Option<(&Buffer, &Buffer)> {
        None
    }

    fn features(&self) -> Features {
        self.kernels.features()
    }
}
