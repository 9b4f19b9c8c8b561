//! The solver.

use surfelcast_gpu::{Buffer, Gpu, GpuError, Graph, Kernel, MemoryKind, PassBuilder, PassTime};
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::PoissonUniforms;

use super::settings::{Norm, PoissonSettings, Preconditioner, Solver, Start};
use crate::merge_passes;
use crate::workgroups_of;

/// Pixels of the coarsest grid at most: one workgroup of `poisson_coarsest`.
const COARSEST_PIXELS: u32 = 256;
/// Pixels times iterations of a submission, so that none holds the device for long; at least one iteration.
const SUBMISSION_PIXELS: u32 = 1 << 20;
/// Iterations between two measurements of the residual, at most.
const MOST_UNMEASURED: u32 = 4;
/// Bytes of the solver's scalars: four `vec4f`.
const SCALAR_BYTES: u64 = 64;
/// Sums of `poisson_reduce`, by the number that selects them.
const FIRST_RZ: u32 = 0;
const CURVATURE: u32 = 1;
const NEXT_RZ: u32 = 2;
const NORM: u32 = 3;
/// Bits of `poisson_start`'s selector.
const VERTICAL: u32 = 1;
const SIGNED: u32 = 2;
/// Share of an L1 scale that is added to the residuals in the first weighted round.
const L1_SHARE: f32 = 0.05;

/// A problem; see the [module](super) for the buffers.
#[derive(Clone, Copy, Debug)]
pub struct PoissonProblem<'a> {
    /// V.
    pub value: &'a Buffer,
    /// a and b.
    pub weights: &'a Buffer,
    /// D.
    pub differences: &'a Buffer,
    /// u, written.
    pub solution: &'a Buffer,
}

/// Cost and result of a solve.
#[derive(Clone, Debug, Default)]
pub struct PoissonReport {
    /// Iterations of all rounds.
    pub iterations: u32,
    /// Final residual as a share of the residual of V, over all channels.
    pub residual: f64,
    /// The same after each submission, with the iterations until then.
    pub history: Vec<(u32, f64)>,
    /// Passes with their times.
    pub passes: Vec<PassTime>,
}

impl PoissonReport {
    /// Milliseconds on the device.
    pub fn gpu_ms(&self) -> f64 {
        self.passes.iter().map(|pass| pass.gpu_ms).sum()
    }
}

/// A grid of the V-cycle.
#[derive(Debug)]
struct Level {
    size: [u32; 2],
    weights: Buffer,
    right: Buffer,
    values: Buffer,
}

#[derive(Debug)]
struct Kernels {
    right_side: Kernel,
    start: Kernel,
    jacobi: Kernel,
    gauss_seidel: Kernel,
    subtract: Kernel,
    measure: Kernel,
    apply: Kernel,
    step: Kernel,
    diagonal: Kernel,
    dot: Kernel,
    reduce: Kernel,
    direction: Kernel,
    coarsen: Kernel,
    restrict: Kernel,
    prolong: Kernel,
    coarsest: Kernel,
    reweight: Kernel,
}

impl Kernels {
    fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let kernel = |name| gpu.kernel(name, Features::NONE);
        Ok(Self {
            right_side: kernel("poisson_right_side")?,
            start: kernel("poisson_start")?,
            jacobi: kernel("poisson_jacobi")?,
            gauss_seidel: kernel("poisson_gauss_seidel")?,
            subtract: kernel("poisson_subtract")?,
            measure: kernel("poisson_measure")?,
            apply: kernel("poisson_apply")?,
            step: kernel("poisson_step")?,
            diagonal: kernel("poisson_diagonal")?,
            dot: kernel("poisson_dot")?,
            reduce: kernel("poisson_reduce")?,
            direction: kernel("poisson_direction")?,
            coarsen: kernel("poisson_coarsen")?,
            restrict: kernel("poisson_restrict")?,
            prolong: kernel("poisson_prolong")?,
            coarsest: kernel("poisson_coarsest")?,
            reweight: kernel("poisson_reweight")?,
        })
    }
}

/// Solves Poisson problems of one image size; owns the vectors. Call [`begin`](Self::begin), then
/// [`advance`](Self::advance) until it returns true; [`solve`](Self::solve) does both.
#[derive(Debug)]
pub struct PoissonSolver {
    settings: PoissonSettings,
    size: [u32; 2],
    kernels: Kernels,
    /// r of conjugate gradients, the right side of the others.
    residual: Buffer,
    /// A p; the second vector of Jacobi's method; scratch of the start.
    products: Buffer,
    /// z and p of conjugate gradients.
    correction: Option<Buffer>,
    directions: Option<Buffer>,
    /// Coarser grids, the finest of them first; their weights are those of the current round.
    levels: Vec<Level>,
    /// Weights of an L1 round.
    reweighted: Option<Buffer>,
    partials: Buffer,
    scalars: Buffer,
    /// Squared norm of the residual of V, in the current round.
    reference: f64,
    /// Rounds done.
    round: u32,
    round_iterations: u32,
    report: PoissonReport,
}

impl PoissonSolver {
    /// For images of this size.
    pub fn new(gpu: &Gpu, size: [u32; 2], settings: PoissonSettings) -> Result<Self, GpuError> {
        let pixel_bytes = |size: [u32; 2]| u64::from(size[0]) * u64::from(size[1]) * 16;
        let vector = |label, size| gpu.buffer(label, MemoryKind::View, pixel_bytes(size));
        let is_conjugate = matches!(settings.solver, Solver::ConjugateGradients(_));
        let optional = |is_needed: bool, label| is_needed.then(|| vector(label, size)).transpose();
        let mut levels = Vec::new();
        if settings.solver == Solver::ConjugateGradients(Preconditioner::VCycle) {
            let mut coarse = size;
            while levels.is_empty() || coarse[0] * coarse[1] > COARSEST_PIXELS {
                coarse = coarse.map(|side| side.div_ceil(2));
                levels.push(Level {
                    size: coarse,
                    weights: vector("poisson_weights", coarse)?,
                    right: vector("poisson_right", coarse)?,
                    values: vector("poisson_values", coarse)?,
                });
            }
        }
        let [columns, rows, _] = workgroups_of(size[0] * size[1]);
        Ok(Self {
            settings,
            size,
            kernels: Kernels::new(gpu)?,
            residual: vector("poisson_residual", size)?,
            products: vector("poisson_products", size)?,
            correction: optional(is_conjugate, "poisson_correction")?,
            directions: optional(is_conjugate, "poisson_directions")?,
            levels,
            reweighted: optional(matches!(settings.norm, Norm::L1 { .. }), "poisson_reweighted")?,
            partials: gpu.buffer("poisson_partials", MemoryKind::View, u64::from(columns * rows) * 16)?,
            scalars: gpu.buffer("poisson_scalars", MemoryKind::View, SCALAR_BYTES)?,
            reference: 0.0,
            round: 0,
            round_iterations: 0,
            report: PoissonReport::default(),
        })
    }

    /// Changes the scale of an L1 norm; does nothing to others.
    pub fn set_scale(&mut self, new_scale: f32) {
        if let Norm::L1 { scale, .. } = &mut self.settings.norm {
            *scale = new_scale;
        }
    }

    /// Solves to the end.
    pub fn solve(&mut self, gpu: &Gpu, problem: &PoissonProblem<'_>) -> Result<PoissonReport, GpuError> {
        self.begin(gpu, problem)?;
        while !self.advance(gpu, problem, u32::MAX)? {}
        Ok(self.take_report())
    }

    /// Report since [`begin`](Self::begin).
    pub fn report(&self) -> &PoissonReport {
        &self.report
    }

    /// Takes the report.
    pub fn take_report(&mut self) -> PoissonReport {
        std::mem::take(&mut self.report)
    }

    /// Sets up a problem and its first guess.
    pub fn begin(&mut self, gpu: &Gpu, problem: &PoissonProblem<'_>) -> Result<(), GpuError> {
        self.report = PoissonReport::default();
        self.round = 0;
        self.begin_round(gpu, problem)
    }

    /// Runs at most `most` iterations in one submission. Returns whether the problem is solved.
    pub fn advance(&mut self, gpu: &Gpu, problem: &PoissonProblem<'_>, most: u32) -> Result<bool, GpuError> {
        let pixels = self.size[0] * self.size[1];
        let left = self.settings.iterations - self.round_iterations;
        let count = (SUBMISSION_PIXELS / pixels).clamp(1, MOST_UNMEASURED).min(left).min(most.max(1));
        if self.reference > 0.0 && count > 0 {
            let mut graph = gpu.graph("poisson");
            let done = self.iterate(&mut graph, problem, count)?;
            self.round_iterations = (self.round_iterations + done).min(self.settings.iterations);
            self.report.iterations += done;
            let norm = self.submit(graph)?;
            self.report.residual = (norm / self.reference).sqrt();
            self.report.history.push((self.report.iterations, self.report.residual));
            // A residual that is not a number stays so.
            let goes_on = self.report.residual > f64::from(self.settings.tolerance);
            if goes_on && self.round_iterations < self.settings.iterations {
                return Ok(false);
            }
        }
        self.round += 1;
        let Norm::L1 { rounds, .. } = self.settings.norm else { return Ok(true) };
        if self.round > rounds {
            return Ok(true);
        }
        self.begin_round(gpu, problem)?;
        Ok(false)
    }

    /// Residual of the present solution, computed from it, as a share of the residual of V. Conjugate gradients update
    /// the one in the [report](Self::report) recursively, where it keeps falling beyond the precision of `f32`. Not
    /// counted in the report.
    pub fn true_residual(&self, gpu: &Gpu, problem: &PoissonProblem<'_>) -> Result<f64, GpuError> {
        let mut graph = gpu.graph("poisson_residual");
        let groups = workgroups_of(self.size[0] * self.size[1]);
        // Between iterations this vector holds nothing that is still needed.
        pass(&mut graph, &self.kernels.right_side, self.size, 0, 0.0)
            .bind("poisson_weights", self.weights(problem))
            .bind("poisson_value", problem.value)
            .bind("poisson_differences", problem.differences)
            .bind("poisson_right", &self.products)
            .dispatch(groups)?;
        pass(&mut graph, &self.kernels.measure, self.size, 0, 0.0)
            .bind("poisson_weights", self.weights(problem))
            .bind("poisson_values", problem.solution)
            .bind("poisson_right", &self.products)
            .bind("poisson_partials", &self.partials)
            .dispatch(groups)?;
        self.reduce(&mut graph, NORM)?;
        let ticket = graph.read_back(&self.scalars, 0..SCALAR_BYTES)?;
        let scalars: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&graph.submit()?.wait()?.take(ticket)?);
        Ok((squared_norm(&scalars) / self.reference).sqrt())
    }

    /// Weights of the current round.
    fn weights<'a>(&'a self, problem: &PoissonProblem<'a>) -> &'a Buffer {
        match &self.reweighted {
            Some(reweighted) if self.round > 0 => reweighted,
            _ => problem.weights,
        }
    }

    fn begin_round(&mut self, gpu: &Gpu, problem: &PoissonProblem<'_>) -> Result<(), GpuError> {
        let size = self.size;
        let groups = workgroups_of(size[0] * size[1]);
        self.round_iterations = 0;
        let mut graph = gpu.graph("poisson");
        if let (Norm::L1 { scale, .. }, Some(reweighted), 1..) = (self.settings.norm, &self.reweighted, self.round) {
            let added = L1_SHARE * scale * 0.5f32.powi(self.round as i32 - 1);
            pass(&mut graph, &self.kernels.reweight, size, 0, added)
                .bind("base_weights", problem.weights)
                .bind("poisson_value", problem.value)
                .bind("poisson_differences", problem.differences)
                .bind("poisson_solution", problem.solution)
                .bind("new_weights", reweighted)
                .dispatch(groups)?;
        }
        let weights = self.weights(problem).clone();
        pass(&mut graph, &self.kernels.right_side, size, 0, 0.0)
            .bind("poisson_weights", &weights)
            .bind("poisson_value", problem.value)
            .bind("poisson_differences", problem.differences)
            .bind("poisson_right", &self.residual)
            .dispatch(groups)?;
        // Later residuals are relative to that of V, whatever the start.
        pass(&mut graph, &self.kernels.measure, size, 0, 0.0)
            .bind("poisson_weights", &weights)
            .bind("poisson_values", problem.value)
            .bind("poisson_right", &self.residual)
            .bind("poisson_partials", &self.partials)
            .dispatch(groups)?;
        self.reduce(&mut graph, NORM)?;
        if self.round == 0 {
            self.first_guess(&mut graph, problem, &weights)?;
        }
        let mut finer = (size, weights.clone());
        for level in &self.levels {
            pass(&mut graph, &self.kernels.coarsen, finer.0, 0, self.settings.coarse_edge)
                .bind("poisson_weights", &finer.1)
                .bind("coarse_weights", &level.weights)
                .dispatch(workgroups_of(level.size[0] * level.size[1]))?;
            finer = (level.size, level.weights.clone());
        }
        // The norm of V's residual is read before conjugate gradients overwrite the right side.
        self.reference = self.submit(graph)?;
        if let Solver::ConjugateGradients(preconditioner) = self.settings.solver {
            let mut graph = gpu.graph("poisson");
            pass(&mut graph, &self.kernels.subtract, size, 0, 0.0)
                .bind("poisson_weights", &weights)
                .bind("poisson_values", problem.solution)
                .bind("poisson_residual", &self.residual)
                .dispatch(groups)?;
            self.correct(&mut graph, &weights, preconditioner, FIRST_RZ)?;
            merge_passes(&mut self.report.passes, graph.submit()?.wait()?.passes);
        }
        Ok(())
    }

    /// Writes the first guess into the solution.
    fn first_guess(&self, graph: &mut Graph, problem: &PoissonProblem<'_>, weights: &Buffer) -> Result<(), GpuError> {
        let (kind, sigma) = match self.settings.start {
            // A Gaussian without width copies.
            Start::Value => (0, 0.0),
            Start::SignedGaussian { sigma } => (SIGNED, sigma),
            Start::Gaussian { sigma } => (0, sigma),
        };
        let mut axis = |selector, source: &Buffer, target: &Buffer| {
            pass(graph, &self.kernels.start, self.size, selector, sigma)
                .bind("poisson_weights", weights)
                .bind("poisson_source", source)
                .bind("poisson_differences", problem.differences)
                .bind("poisson_started", target)
                .dispatch(workgroups_of(self.size[0] * self.size[1]))
        };
        if sigma > 0.0 {
            axis(kind, problem.value, &self.products)?;
            axis(kind | VERTICAL, &self.products, problem.solution)
        } else {
            axis(kind, problem.value, problem.solution)
        }
    }

    /// Records iterations and a measurement of the residual. Returns the number of iterations.
    fn iterate(&self, graph: &mut Graph, problem: &PoissonProblem<'_>, count: u32) -> Result<u32, GpuError> {
        let weights = self.weights(problem);
        let size = self.size;
        let groups = workgroups_of(size[0] * size[1]);
        let mut done = count;
        match self.settings.solver {
            Solver::Jacobi => {
                for _ in 0..count.div_ceil(2) {
                    for (from, to) in [(problem.solution, &self.products), (&self.products, problem.solution)] {
                        pass(graph, &self.kernels.jacobi, size, 0, 0.0)
                            .bind("poisson_weights", weights)
                            .bind("poisson_right", &self.residual)
                            .bind("poisson_values", from)
                            .bind("poisson_next", to)
                            .dispatch(groups)?;
                    }
                }
                done = count.next_multiple_of(2);
            }
            Solver::GaussSeidel { relaxation } => {
                for _ in 0..count {
                    for color in [0, 1] {
                        let fine = (size, weights, &self.residual, problem.solution);
                        self.smooth(graph, fine, color, relaxation)?;
                    }
                }
            }
            Solver::ConjugateGradients(preconditioner) => {
                for _ in 0..count {
                    self.conjugate(graph, problem, preconditioner)?;
                }
                return Ok(done);
            }
        }
        pass(graph, &self.kernels.measure, size, 0, 0.0)
            .bind("poisson_weights", weights)
            .bind("poisson_values", problem.solution)
            .bind("poisson_right", &self.residual)
            .bind("poisson_partials", &self.partials)
            .dispatch(groups)?;
        self.reduce(graph, NORM)?;
        Ok(done)
    }

    /// One iteration of conjugate gradients.
    fn conjugate(
        &self,
        graph: &mut Graph,
        problem: &PoissonProblem<'_>,
        preconditioner: Preconditioner,
    ) -> Result<(), GpuError> {
        let Some(directions) = &self.directions else { return Ok(()) };
        let weights = self.weights(problem);
        let groups = workgroups_of(self.size[0] * self.size[1]);
        pass(graph, &self.kernels.apply, self.size, 0, 0.0)
            .bind("poisson_weights", weights)
            .bind("poisson_directions", directions)
            .bind("poisson_products", &self.products)
            .bind("poisson_partials", &self.partials)
            .dispatch(groups)?;
        self.reduce(graph, CURVATURE)?;
        pass(graph, &self.kernels.step, self.size, 0, 0.0)
            .bind("poisson_scalars", &self.scalars)
            .bind("poisson_directions", directions)
            .bind("poisson_products", &self.products)
            .bind("poisson_solution", problem.solution)
            .bind("poisson_residual", &self.residual)
            .bind("poisson_partials", &self.partials)
            .dispatch(groups)?;
        self.reduce(graph, NORM)?;
        self.correct(graph, weights, preconditioner, NEXT_RZ)
    }

    /// z from r, r . z, and the next direction.
    fn correct(
        &self,
        graph: &mut Graph,
        weights: &Buffer,
        preconditioner: Preconditioner,
        sum: u32,
    ) -> Result<(), GpuError> {
        let (Some(correction), Some(directions)) = (&self.correction, &self.directions) else { return Ok(()) };
        let groups = workgroups_of(self.size[0] * self.size[1]);
        if preconditioner == Preconditioner::VCycle {
            graph.clear(correction)?;
            self.v_cycle(graph, 0, (self.size, weights, &self.residual, correction))?;
        } else {
            let selector = u32::from(preconditioner == Preconditioner::Diagonal);
            pass(graph, &self.kernels.diagonal, self.size, selector, 0.0)
                .bind("poisson_weights", weights)
                .bind("poisson_residual", &self.residual)
                .bind("poisson_correction", correction)
                .dispatch(groups)?;
        }
        pass(graph, &self.kernels.dot, self.size, 0, 0.0)
            .bind("poisson_residual", &self.residual)
            .bind("poisson_correction", correction)
            .bind("poisson_partials", &self.partials)
            .dispatch(groups)?;
        self.reduce(graph, sum)?;
        pass(graph, &self.kernels.direction, self.size, u32::from(sum == NEXT_RZ), 0.0)
            .bind("poisson_scalars", &self.scalars)
            .bind("poisson_correction", correction)
            .bind("poisson_directions", directions)
            .dispatch(groups)
    }

    /// A V-cycle from 0 on a grid: size, weights, right side, values. Smoothing after the coarser grid runs backwards,
    /// so that the cycle is a symmetric operator.
    fn v_cycle(
        &self,
        graph: &mut Graph,
        depth: usize,
        grid: ([u32; 2], &Buffer, &Buffer, &Buffer),
    ) -> Result<(), GpuError> {
        let (size, weights, right, values) = grid;
        let Some(coarse) = self.levels.get(depth) else {
            return pass(graph, &self.kernels.coarsest, size, 0, 0.0)
                .bind("poisson_weights", weights)
                .bind("poisson_right", right)
                .bind("poisson_values", values)
                .dispatch([1, 1, 1]);
        };
        self.smooth(graph, grid, 0, 1.0)?;
        self.smooth(graph, grid, 1, 1.0)?;
        pass(graph, &self.kernels.restrict, size, 0, 0.0)
            .bind("poisson_weights", weights)
            .bind("poisson_right", right)
            .bind("poisson_values", values)
            .bind("coarse_right", &coarse.right)
            .dispatch(workgroups_of(coarse.size[0] * coarse.size[1]))?;
        graph.clear(&coarse.values)?;
        self.v_cycle(graph, depth + 1, (coarse.size, &coarse.weights, &coarse.right, &coarse.values))?;
        pass(graph, &self.kernels.prolong, size, 0, 0.0)
            .bind("coarse_values", &coarse.values)
            .bind("poisson_values", values)
            .dispatch(workgroups_of(size[0] * size[1]))?;
        self.smooth(graph, grid, 1, 1.0)?;
        self.smooth(graph, grid, 0, 1.0)
    }

    /// Half an iteration of Gauss-Seidel.
    fn smooth(
        &self,
        graph: &mut Graph,
        (size, weights, right, values): ([u32; 2], &Buffer, &Buffer, &Buffer),
        color: u32,
        relaxation: f32,
    ) -> Result<(), GpuError> {
        pass(graph, &self.kernels.gauss_seidel, size, color, relaxation)
            .bind("poisson_weights", weights)
            .bind("poisson_right", right)
            .bind("poisson_values", values)
            .dispatch(workgroups_of(size[0].div_ceil(2) * size[1]))
    }

    /// Adds up the partial sums.
    fn reduce(&self, graph: &mut Graph, sum: u32) -> Result<(), GpuError> {
        let [columns, rows, _] = workgroups_of(self.size[0] * self.size[1]);
        pass(graph, &self.kernels.reduce, [columns * rows, 1], sum, 0.0)
            .bind("poisson_partials", &self.partials)
            .bind("poisson_scalars", &self.scalars)
            .dispatch([1, 1, 1])
    }

    /// Runs the graph; returns the squared norm of the residual over all channels.
    fn submit(&mut self, mut graph: Graph) -> Result<f64, GpuError> {
        let ticket = graph.read_back(&self.scalars, 0..SCALAR_BYTES)?;
        let mut report = graph.submit()?.wait()?;
        let scalars: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&report.take(ticket)?);
        merge_passes(&mut self.report.passes, report.passes);
        Ok(squared_norm(&scalars))
    }
}

/// Squared norm of the residual among the scalars, over all channels.
fn squared_norm(scalars: &[[f32; 4]]) -> f64 {
    scalars.get(NORM as usize).map_or(0.0, |norm| norm[..3].iter().map(|&v| f64::from(v)).sum())
}

/// A pass over a grid: its kernel with the uniforms bound.
fn pass<'g>(graph: &'g mut Graph, kernel: &Kernel, size: [u32; 2], selector: u32, factor: f32) -> PassBuilder<'g> {
    let uniforms = PoissonUniforms { width: size[0], height: size[1], selector, factor };
    graph.pass(kernel).uniform("poisson", bytemuck::bytes_of(&uniforms))
}
