//! Reconstruction in the image: the pixels' light from the cache fits what they gather of the surfels' values and slopes (after
//! Noack 2022, section 4.8). The kernels are in `shaders/techniques/surfel/image/`.
//!
//! Values and differences are means over the picture's samples, so each solve serves all of them. Only the change that a solve
//! makes to B is added to the picture; what no surfel lights stays as it is.

use surfelcast_gpu::{Buffer, Gpu, GpuError, Graph, Kernel, MemoryKind};
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::{FrameUniforms, SurfelUniforms};

use crate::surfel::cache::SurfelCache;
use crate::surfel::graph::SurfelGraph;
use crate::surfel::settings::{ImageScheme, Reconstruction};
use crate::surfel::work::Work;
use crate::technique::{TechniqueError, TechniqueOptions};
use surfelcast_passes::poisson::{PoissonProblem, PoissonSettings, PoissonSolver};
use surfelcast_passes::step::Step;
use surfelcast_passes::{merge_passes, workgroups_of};

/// What it runs beside the graph's kernels.
pub(crate) const KERNELS: &[&str] = &["image_slopes", "image_gather"];
/// Iterations of a solve at most, and the residual that ends it sooner.
const ITERATIONS: u32 = 32;
const TOLERANCE: f32 = 1e-3;

/// Of the sample in hand.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Drawn<'a> {
    /// `VisiblePoint` by pixel.
    pub(crate) points: &'a Buffer,
    /// The picture as it was gathered.
    pub(crate) picture: &'a Buffer,
    /// Its mean B, where that is kept apart.
    pub(crate) irradiance: Option<&'a Buffer>,
}

/// What a picture keeps for it; `vec4f` by pixel.
#[derive(Debug)]
pub(crate) struct ImageReconstruction {
    scheme: ImageScheme,
    edges: Kernel,
    compose: Kernel,
    solver: PoissonSolver,
    /// Three a pixel, of the sample in hand.
    slopes: Buffer,
    values: Buffer,
    shares: Buffer,
    weights: Buffer,
    /// Two a pixel.
    differences: Buffer,
    solution: Buffer,
    shown: Buffer,
    shown_irradiance: Option<Buffer>,
    /// A solve is under way.
    is_solving: bool,
}

impl ImageReconstruction {
    /// For a picture with these options; nothing where it reconstructs otherwise.
    pub(crate) fn new(gpu: &Gpu, options: &TechniqueOptions) -> Result<Option<Self>, GpuError> {
        if options.surfel.reconstruction != Reconstruction::Image {
            return Ok(None);
        }
        let pixels = u64::from(options.size[0]) * u64::from(options.size[1]);
        let buffer = |label, vectors: u64| gpu.buffer(label, MemoryKind::View, pixels * 16 * vectors);
        let settings = PoissonSettings { iterations: ITERATIONS, tolerance: TOLERANCE, ..PoissonSettings::default() };
        Ok(Some(Self {
            scheme: options.surfel.image,
            edges: gpu.kernel("image_edges", Features::NONE)?,
            compose: gpu.kernel("image_compose", Features::NONE.with(Features::SPLIT, options.is_split))?,
            solver: PoissonSolver::new(gpu, options.size, settings)?,
            slopes: buffer("pixel_slopes", 3)?,
            values: buffer("image_values", 1)?,
            shares: buffer("image_shares", 1)?,
            weights: buffer("poisson_weights", 1)?,
            differences: buffer("poisson_differences", 2)?,
            solution: buffer("poisson_solution", 1)?,
            shown: buffer("image_shown", 1)?,
            shown_irradiance: options.is_split.then(|| buffer("shown_irradiance", 1)).transpose()?,
            is_solving: false,
        }))
    }

    /// Records what follows the shading of a range of pixels. `seen` is what camera rays meet, and where they need surfels.
    pub(crate) fn record_gather(
        &self,
        graph: &mut Graph,
        work: &Work<'_>,
        cache: &SurfelCache,
        uniforms: &SurfelUniforms,
        frame: &FrameUniforms,
        seen: [&Buffer; 2],
    ) -> Result<(), TechniqueError> {
        let frame = FrameUniforms { selector: self.scheme as u32, ..*frame };
        let slopes = cache.graph.as_ref().map(SurfelGraph::slopes).ok_or_else(|| GpuError::Validation {
            context: "reconstruction in the image".to_owned(),
            message: "the cache has no graph".to_owned(),
        })?;
        let [visible, points] = seen;
        cache
            .bind(work.lights.bind(work.scene.bind(graph.pass(work.kernels.get("image_gather")?))))
            .uniform("cache", bytemuck::bytes_of(uniforms))
            .uniform("frame", bytemuck::bytes_of(&frame))
            .read("visible", visible)
            .read("visible_points", points)
            .read("node_gradients", slopes)
            .read_write("pixel_slopes", &self.slopes)
            .read_write("image_values", &self.values)
            .read_write("image_shares", &self.shares)
            .dispatch(workgroups_of(frame.pixel_count))?;
        Ok(())
    }

    /// One submission's worth of the solve that follows a whole sample; returns whether the picture is finished.
    pub(crate) fn advance(
        &mut self,
        gpu: &Gpu,
        frame: &FrameUniforms,
        drawn: &Drawn<'_>,
        step: &mut Step,
    ) -> Result<bool, TechniqueError> {
        let frame = FrameUniforms { selector: self.scheme as u32, ..*frame };
        let groups = workgroups_of(frame.width * frame.height);
        let problem = PoissonProblem {
            value: &self.values,
            weights: &self.weights,
            differences: &self.differences,
            solution: &self.solution,
        };
        if !self.is_solving {
            let mut graph = gpu.graph("image_edges");
            graph
                .pass(&self.edges)
                .uniform("frame", bytemuck::bytes_of(&frame))
                .read("visible_points", drawn.points)
                .read("pixel_slopes", &self.slopes)
                .read("image_values", &self.values)
                .read_write("poisson_weights", &self.weights)
                .read_write("poisson_differences", &self.differences)
                .dispatch(groups)?;
            merge_passes(&mut step.passes, graph.submit()?.wait()?.passes);
            self.solver.begin(gpu, &problem)?;
            self.is_solving = true;
            return Ok(false);
        }
        if !self.solver.advance(gpu, &problem, u32::MAX)? {
            return Ok(false);
        }
        self.is_solving = false;
        merge_passes(&mut step.passes, self.solver.take_report().passes);
        let mut graph = gpu.graph("image_compose");
        let mut pass = graph
            .pass(&self.compose)
            .uniform("frame", bytemuck::bytes_of(&frame))
            .read("gathered_picture", drawn.picture)
            .read("image_values", &self.values)
            .read("image_shares", &self.shares)
            .read("poisson_solution", &self.solution)
            .read_write("image_shown", &self.shown);
        if let (Some(gathered), Some(shown)) = (drawn.irradiance, &self.shown_irradiance) {
            pass = pass.read("split_irradiance", gathered).read_write("shown_irradiance", shown);
        }
        pass.dispatch(groups)?;
        merge_passes(&mut step.passes, graph.submit()?.wait()?.passes);
        Ok(true)
    }

    /// What was begun is of no use: camera or lights changed.
    pub(crate) fn restart(&mut self) {
        self.is_solving = false;
    }

    /// The picture.
    pub(crate) fn picture(&self) -> &Buffer {
        &self.shown
    }

    /// Its mean B, where that is kept apart.
    pub(crate) fn irradiance(&self) -> Option<&Buffer> {
        self.shown_irradiance.as_ref()
    }
}
