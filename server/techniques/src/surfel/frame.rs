//! A frame of a view, stage by stage: visibility, insert, spawn, allocate rays; trace, integrate, reconstruct, recycle;
//! shade, denoise direct light; solve in the image; combine with the path-traced image.
//!
//! [`SurfelView::next`] names the stages in this order, and the functions below it follow. A frame is cut into pieces,
//! so that no submission holds the device for long and no step exceeds its budget. Another view may work on the same
//! cache between two steps; the update of the cache is therefore a state of the cache, the rest of a frame one of the
//! view.

use std::sync::Arc;

use surfelcast_gpu::Gpu;
use surfelcast_passes::frame::FrameView;
use surfelcast_passes::lights::LightBuffers;
use surfelcast_passes::step::{Step, StepBudget};
use surfelcast_passes::upload::SceneBuffers;
use surfelcast_passes::{counters, merge_passes, visibility, workgroups_of};
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::FrameUniforms;

use crate::surfel::cache::{CacheCamera, SpawnRequest, SurfelCache, Work, count_rays};
use crate::surfel::view::{Gathered, SurfelView, UpdateChoice};
use crate::technique::{Technique as _, TechniqueError};

/// Cost of the passes over one surfel in a frame, in rays.
const SURFEL_COST: f64 = 8.0;

/// The stage of a frame that comes next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stage {
    /// From visibility to the allocation of rays; or path-traced samples, where the budget goes to them.
    Start,
    /// Path-traced samples, up to this number per pixel.
    Paths(u32),
    /// The update of the cache.
    Update,
    /// Shading, from this pixel on.
    Shade(u32),
    /// Visibility of a further sample per pixel.
    FurtherSample,
    /// The solve in the image.
    Solve,
}

/// What remains to do after a piece of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Progress {
    /// The next piece, while the budget lasts.
    Partial,
    /// The next piece, in the next step.
    EndOfStep,
    /// Nothing: every pixel has the same number of samples.
    Whole,
}

/// What a step works with.
struct Context<'a> {
    work: Work<'a>,
    cache: &'a mut SurfelCache,
    view: &'a FrameView,
    frame: FrameUniforms,
    budget: StepBudget,
    step: Step,
}

impl Context<'_> {
    /// Paths left in the budget of the step.
    fn paths_left(&self) -> u64 {
        self.budget.max_paths.saturating_sub(self.step.paths)
    }

    fn rays(&self) -> u64 {
        self.step.rays.iter().sum()
    }
}

impl SurfelView {
    /// Does the next pieces of a frame, as many as the budget allows, up to the end of the frame.
    pub(super) fn advance(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        view: &FrameView,
        budget: StepBudget,
    ) -> Result<Step, TechniqueError> {
        if self.stage == Stage::Start {
            if self.samples() >= budget.until_samples {
                return Ok(Step { is_whole: true, ..Step::default() });
            }
            self.kernels.refresh(gpu);
            if self.frames == 0 {
                self.light.prepare(gpu, lights);
            }
        }
        let shared = Arc::clone(&self.cache);
        let mut cache = shared.lock();
        // A copy for the length of the step, so that the kernels and the rest of the view are borrowed apart.
        let kernels = self.kernels.clone();
        let mut frame = view.uniforms(scene, lights, kernels.running(), self.options.seed);
        frame.sample_count = 1;
        let work = Work { gpu, kernels: &kernels, scene, lights };
        let mut context = Context { work, cache: &mut cache, view, frame, budget, step: Step::default() };
        while context.paths_left() > 0 {
            let is_of_cache = !matches!(self.stage, Stage::Paths(_));
            let rays_before = context.rays();
            let progress = self.next(&mut context)?;
            if is_of_cache {
                self.frame_rays += context.rays() - rays_before;
            }
            match progress {
                Progress::Partial => {}
                Progress::EndOfStep => break,
                Progress::Whole => {
                    if is_of_cache {
                        self.count_frame(context.cache);
                    }
                    self.combine(&mut context)?;
                    context.step.is_whole = true;
                    break;
                }
            }
        }
        Ok(context.step)
    }

    /// The next piece of a frame: every stage, in the order in which they run. [`Self::combine`] follows when the image
    /// is whole.
    fn next(&mut self, context: &mut Context<'_>) -> Result<Progress, TechniqueError> {
        context.frame.first_sample = self.samples;
        match self.stage {
            // Whichever view comes first finishes an update under way: until then nothing else may change the cache.
            Stage::Start | Stage::Update if context.cache.is_updating() => update_cache(context),
            Stage::Start => {
                if let Some(goal) = self.paths_due(context)? {
                    self.stage = Stage::Paths(goal);
                    return Ok(Progress::Partial);
                }
                self.place_camera(context);
                self.trace_visibility(context)?;
                insert(context)?;
                let gain = self.spawn(context)?;
                self.allocate_rays(context, gain)?;
                self.stage = Stage::Update;
                Ok(Progress::Partial)
            }
            Stage::Paths(goal) => self.trace_paths(context, goal),
            Stage::Update => {
                self.seen_update = context.cache.update_number();
                self.stage = Stage::Shade(0);
                Ok(Progress::Partial)
            }
            Stage::Shade(first) => self.shade(context, first),
            Stage::FurtherSample => {
                self.trace_visibility(context)?;
                self.stage = Stage::Shade(0);
                Ok(Progress::Partial)
            }
            Stage::Solve => self.solve(context),
        }
    }

    /// Tells the cache where the view's camera is: radii and the trapezoidal grid follow it.
    fn place_camera(&self, context: &mut Context<'_>) {
        let Context { work, cache, view, .. } = context;
        let camera = CacheCamera::of_view(view, work.scene.origin, self.options.full_size);
        cache.set_camera(self.camera, camera, view.exposure);
    }

    /// Visibility: the camera rays of one sample per pixel.
    fn trace_visibility(&self, context: &mut Context<'_>) -> Result<(), TechniqueError> {
        let Work { gpu, kernels, scene, lights } = context.work;
        let passes = self.visibility.trace(gpu, kernels.get(visibility::KERNEL)?, scene, lights, &context.frame)?;
        merge_passes(&mut context.step.passes, passes);
        context.step.paths += u64::from(self.pixel_count());
        Ok(())
    }

    /// Spawns surfels where the view has gaps. Returns the gain: surfels over tiles.
    fn spawn(&mut self, context: &mut Context<'_>) -> Result<f32, TechniqueError> {
        if !self.budget.looks_for_gaps(self.frames) {
            return Ok(0.0);
        }
        let request = SpawnRequest {
            frame: bytemuck::bytes_of(&context.frame),
            visibility: &self.visibility,
            size: self.options.size,
            pins: self.options.surfel.pins,
            is_coarse: self.budget.is_coarse(),
            radius_pixels: self.budget.requested_radius(),
        };
        let gain = context.cache.spawn(&context.work, &request, &mut context.step)?;
        self.budget.gained(gain);
        Ok(gain)
    }

    /// Allocates the rays of an update, if the view drives one, and chooses the frame's samples per pixel.
    fn allocate_rays(&mut self, context: &mut Context<'_>, gain: f32) -> Result<(), TechniqueError> {
        let Context { work, cache, frame, step, .. } = context;
        let choice = UpdateChoice::of(gain, self.seen_update, cache.update_number(), cache.is_converged());
        if choice != UpdateChoice::Use {
            let rays = self.budget.rays(cache.new_surfels());
            let new_first = choice == UpdateChoice::DriveNewFirst;
            cache.allocate_rays(work, bytemuck::bytes_of(frame), rays, new_first, step)?;
        }
        // A solve in the image takes the differences of one sample.
        let is_single = self.image.is_some();
        self.samples_left = if is_single { 0 } else { self.budget.samples(self.frames, cache.rays_of_update()) - 1 };
        Ok(())
    }

    /// Shades a range of pixels. The submission of the last range also denoises direct light.
    fn shade(&mut self, context: &mut Context<'_>, first: u32) -> Result<Progress, TechniqueError> {
        let limit = u32::try_from(context.paths_left()).unwrap_or(u32::MAX);
        let Context { work, cache, frame, step, .. } = context;
        let range = limit.max(64).min(self.pixel_count() - first);
        let is_last = first + range == self.pixel_count();
        let selector = self.light.selector(self.samples);
        let frame = FrameUniforms { first_pixel: first, pixel_count: range, selector, ..*frame };
        let uniforms = cache.uniforms_for_view(self.budget.is_coarse());
        let mut graph = work.gpu.graph("surfel_shade");
        if let Some(splat) = self.splat.as_ref().filter(|_| first == 0) {
            splat.record(&mut graph, cache, &uniforms, bytemuck::bytes_of(&frame), &self.visibility.points)?;
        }
        graph.clear(&self.counters)?;
        let mut pass = cache
            .bind(work.bind_scene(self.visibility.bind(graph.pass(work.kernels.get("surfel_shade")?))))
            .uniform("cache", bytemuck::bytes_of(&uniforms))
            .uniform("frame", bytemuck::bytes_of(&frame))
            .bind("accumulation", &self.accumulation)
            .bind("direct_mean", &self.direct)
            .bind("counters", &self.counters)
            .bind_if_bound("diffuse_direct", self.light.diffuse());
        if let Some(splat) = &self.splat {
            pass = splat.bind(pass);
        }
        if let Some((irradiance, reflection)) = &self.split {
            pass = pass.bind("split_irradiance", irradiance).bind("split_reflection", reflection);
        }
        pass.dispatch(workgroups_of(range))?;
        if let Some(image) = &self.image {
            image.record_gather(&mut graph, work, cache, &uniforms, &frame, &self.visibility)?;
        }
        if is_last {
            let is_shown = self.samples_left == 0;
            self.light.record(&mut graph, &frame, &self.visibility.points, &self.accumulation, is_shown)?;
        }
        let ticket = graph.read_back(&self.counters, 0..counters::BYTES)?;
        let mut report = graph.submit()?.wait()?;
        merge_passes(&mut step.passes, std::mem::take(&mut report.passes));
        count_rays(step, &report.take(ticket)?);
        step.paths += u64::from(range);
        self.stage = Stage::Shade(first + range);
        Ok(if is_last { self.end_sample() } else { Progress::Partial })
    }

    /// What follows a whole sample per pixel.
    fn end_sample(&mut self) -> Progress {
        if self.samples_left > 0 {
            self.samples_left -= 1;
            self.samples += 1;
            self.stage = Stage::FurtherSample;
            Progress::Partial
        } else if self.image.is_some() {
            // In the next step: it traces no path, and must not count in the measured rate of paths.
            self.stage = Stage::Solve;
            Progress::EndOfStep
        } else {
            Progress::Whole
        }
    }

    /// Solves for the light of the image, where it is reconstructed there; one submission.
    fn solve(&mut self, context: &mut Context<'_>) -> Result<Progress, TechniqueError> {
        let image = self.light.image().unwrap_or(&self.accumulation);
        let irradiance = self.split.as_ref().map(|(irradiance, _)| irradiance);
        let gathered = Gathered { points: &self.visibility.points, image, irradiance };
        let is_solved = match &mut self.image {
            Some(image) => image.advance(context.work.gpu, &context.frame, &gathered, &mut context.step)?,
            None => true,
        };
        Ok(if is_solved { Progress::Whole } else { Progress::EndOfStep })
    }

    /// Counts a whole frame of the cache, and its cost.
    fn count_frame(&mut self, cache: &SurfelCache) {
        self.stage = Stage::Start;
        self.frames += 1;
        self.samples += 1;
        let rays = std::mem::take(&mut self.frame_rays);
        let [live, _] = cache.counts();
        if let Some(settling) = &mut self.settling {
            settling.count_frame(rays as f64 + SURFEL_COST * f64::from(live));
        }
    }

    /// Path-traced samples per pixel to reach before the next frame of the cache, where the budget goes to them.
    fn paths_due(&mut self, context: &Context<'_>) -> Result<Option<u32>, TechniqueError> {
        let left = context.budget.until_samples.saturating_sub(self.samples());
        Ok(match &mut self.settling {
            Some(settling) => settling.due(context.work.gpu, self.frames, left)?,
            None => None,
        })
    }

    /// Takes path-traced samples up to `goal` per pixel. The image is whole after a batch that counts as samples of it.
    fn trace_paths(&mut self, context: &mut Context<'_>, goal: u32) -> Result<Progress, TechniqueError> {
        let budget = StepBudget { max_paths: context.paths_left(), until_samples: goal, ..context.budget };
        let Some(settling) = &mut self.settling else {
            self.stage = Stage::Start;
            return Ok(Progress::Partial);
        };
        let Work { gpu, scene, lights, .. } = context.work;
        let traced = settling.trace(gpu, scene, lights, context.view, budget)?;
        let is_whole = traced.is_whole;
        context.step.add(traced);
        if !is_whole {
            return Ok(Progress::Partial);
        }
        self.stage = Stage::Start;
        Ok(if settling.budget_goes_to_paths() { Progress::Whole } else { Progress::Partial })
    }

    /// Combines the cache's image with the path-traced one.
    fn combine(&mut self, context: &mut Context<'_>) -> Result<(), TechniqueError> {
        let Some(mut settling) = self.settling.take() else { return Ok(()) };
        let (gpu, exposure) = (context.work.gpu, context.view.exposure);
        let combined = settling.combine(gpu, self.cache_image(), self.frames, exposure, &mut context.step);
        self.settling = Some(settling);
        Ok(combined?)
    }
}

/// Inserts surfels into the grid, where it is not up to date.
fn insert(context: &mut Context<'_>) -> Result<(), TechniqueError> {
    Ok(context.cache.insert(&context.work, &mut context.step)?)
}

/// Traces a range of the update's rays. The submission of the last range also integrates them into the surfels' means,
/// reconstructs what lookups read from those, and recycles surfels.
fn update_cache(context: &mut Context<'_>) -> Result<Progress, TechniqueError> {
    let limit = u32::try_from(context.paths_left()).unwrap_or(u32::MAX);
    let Context { work, cache, frame, step, .. } = context;
    let Some(range) = cache.next_rays(limit) else { return Ok(Progress::Partial) };
    let mut graph = work.gpu.graph("surfel_trace");
    let traced = cache.record_trace(&mut graph, work, bytemuck::bytes_of(frame), &range)?;
    let mut left = None;
    if range.is_last() {
        cache.record_integration(&mut graph, work, &range)?;
        cache.record_reconstruction(&mut graph, work, &range)?;
        left = Some(cache.record_recycling(&mut graph, work, &range)?);
    }
    let report = graph.submit()?.wait()?;
    cache.end_rays(work, &range, report, traced, left, step)?;
    step.paths += u64::from(range.count());
    Ok(Progress::Partial)
}
