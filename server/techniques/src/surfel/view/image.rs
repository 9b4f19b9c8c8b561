//! Reconstruction in the image: a screened Poisson problem over pixels, with the values and slopes that they gather
//! from the surfels (after Noack 2022, section 4.8). The kernels are in `shaders/techniques/surfel/kernels/image/`.
//!
//! Values and differences are means over the image's samples, so each solve serves all of them. Only the change that a
//! solve makes to the irradiance is added to the image; pixels without surfels keep their value.

use surfelcast_gpu::{Buffer, Gpu, GpuError, Graph, Kernel, MemoryKind};
use surfelcast_passes::poisson::{PoissonProblem, PoissonSettings, PoissonSolver};
use surfelcast_passes::step::Step;
use surfelcast_passes::visibility::Visibility;
use surfelcast_passes::{merge_passes, workgroups_of};
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::{FrameUniforms, SurfelUniforms};

use crate::surfel::ViewOptions;
use crate::surfel::cache::{SurfelCache, Work};
use crate::surfel::settings::{ImageScheme, Reconstruction};

/// Kernels of the reconstruction in the image, with those of the neighbours.
pub(in crate::surfel) const KERNELS: &[&str] = &["image_slopes", "image_gather"];
/// Largest number of iterations of a solve, and the residual that ends it sooner.
const ITERATIONS: u32 = 32;
const TOLERANCE: f32 = 1e-3;

/// What pixels gathered, before the solve.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gathered<'a> {
    /// `VisiblePoint` by pixel.
    pub(crate) points: &'a Buffer,
    /// The image as it was gathered.
    pub(crate) image: &'a Buffer,
    /// Its mean irradiance over pi, where the image is split.
    pub(crate) irradiance: Option<&'a Buffer>,
}

/// Buffers and kernels of the solve; `vec4f` by pixel unless it says otherwise.
#[derive(Debug)]
pub(crate) struct ImageReconstruction {
    scheme: ImageScheme,
    edges: Kernel,
    compose: Kernel,
    solver: PoissonSolver,
    /// Three a pixel, of the current sample.
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
    /// `None` where these options choose another reconstruction.
    pub(crate) fn new(gpu: &Gpu, options: &ViewOptions) -> Result<Option<Self>, GpuError> {
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

    /// Gathers values and slopes for a range of pixels, after their shading.
    pub(crate) fn record_gather(
        &self,
        graph: &mut Graph,
        work: &Work<'_>,
        cache: &SurfelCache,
        uniforms: &SurfelUniforms,
        frame: &FrameUniforms,
        visibility: &Visibility,
    ) -> Result<(), GpuError> {
        let frame = FrameUniforms { selector: self.scheme as u32, ..*frame };
        let slopes = cache.slopes().ok_or_else(|| GpuError::Validation {
            context: "reconstruction in the image".to_owned(),
            message: "the cache has no neighbours".to_owned(),
        })?;
        cache
            .bind(work.bind_scene(visibility.bind(graph.pass(work.kernels.get("image_gather")?))))
            .uniform("cache", bytemuck::bytes_of(uniforms))
            .uniform("frame", bytemuck::bytes_of(&frame))
            .bind("node_gradients", slopes)
            .bind("pixel_slopes", &self.slopes)
            .bind("image_values", &self.values)
            .bind("image_shares", &self.shares)
            .dispatch(workgroups_of(frame.pixel_count))
    }

    /// One submission of the solve that follows a whole sample. Returns whether the image is finished.
    pub(crate) fn advance(
        &mut self,
        gpu: &Gpu,
        frame: &FrameUniforms,
        gathered: &Gathered<'_>,
        step: &mut Step,
    ) -> Result<bool, GpuError> {
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
                .bind("visible_points", gathered.points)
                .bind("pixel_slopes", &self.slopes)
                .bind("image_values", &self.values)
                .bind("poisson_weights", &self.weights)
                .bind("poisson_differences", &self.differences)
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
            .bind("gathered_image", gathered.image)
            .bind("image_values", &self.values)
            .bind("image_shares", &self.shares)
            .bind("poisson_solution", &self.solution)
            .bind("image_shown", &self.shown);
        if let (Some(irradiance), Some(shown)) = (gathered.irradiance, &self.shown_irradiance) {
            pass = pass.bind("split_irradiance", irradiance).bind("shown_irradiance", shown);
        }
        pass.dispatch(groups)?;
        merge_passes(&mut step.passes, graph.submit()?.wait()?.passes);
        Ok(true)
    }

    /// Camera or lights changed: a solve under way is abandoned.
    pub(crate) fn restart(&mut self) {
        self.is_solving = false;
    }

    /// The reconstructed image.
    pub(crate) fn image(&self) -> &Buffer {
        &self.shown
    }

    /// Its mean irradiance over pi, where the image is split.
    pub(crate) fn irradiance(&self) -> Option<&Buffer> {
        self.shown_irradiance.as_ref()
    }
}
