//! One picture that looks at a cache: its frames, and what it shows of them.
//!
//! A frame goes through [`Phase`]s, each in pieces, so that no submission holds the device for long.

use std::sync::Arc;

use parking_lot::Mutex;
use surfelcast_gpu::{Buffer, Gpu, GpuError, MemoryKind};
use surfelcast_shaders::Features;
use surfelcast_shaders::constants::SURFEL_COARSENESS;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::{FrameUniforms, VisiblePoint};

use crate::session::SessionState;
use crate::surfel::cache::{SurfelCache, UpdateStage, cache_camera};
use crate::surfel::direct::DirectLight;
use crate::surfel::image::{Drawn, ImageReconstruction};
use crate::surfel::kernels_for;
use crate::surfel::reuse::EarlierFrame;
use crate::surfel::settle::{FRAMES_BEFORE, Settle};
use crate::surfel::spawn::Asking;
use crate::surfel::splat::{SPLAT, Splat};
use crate::surfel::work::{Work, count_rays};
use crate::technique::{Change, Technique, TechniqueError, TechniqueOptions};
use surfelcast_passes::features::{features_for, general_features};
use surfelcast_passes::frame::FrameView;
use surfelcast_passes::kernels::KernelSet;
use surfelcast_passes::lights::LightBuffers;
use surfelcast_passes::step::{Step, StepBudget};
use surfelcast_passes::upload::SceneBuffers;
use surfelcast_passes::{counters, merge_passes, workgroups_of};

/// Rays of an update at least: a tiny picture still has a whole scene behind it.
const FEWEST_RAYS: u32 = 4096;
const MOST_RAYS: u32 = 1 << 22;
/// Rays of an update at least for each surfel born since the last one. Surfels are denser among the pixels of a small picture, whose
/// rays go by its pixels: they would have hardly one each, and pixels would trace noisy paths in their stead.
const RAYS_OF_NEWBORN: u32 = 8;
/// Surfels that a picture has to get, as a share of its tiles, to drive an update out of turn, in which they come first.
const MUCH_GAIN: f32 = 0.1;
/// Pixels whose camera rays are traced in one submission.
const VISIBILITY_PIXELS: u32 = 1 << 18;
/// Samples of each pixel in the first frames of a picture whose cache traces as many rays as the settings ask for; those after them
/// take one. Then a sample takes about a quarter of what the rest of a frame does, so that noise per second is least with as many of
/// them as twice the root of its share in the noise of a frame: two where half of the noise is that of pixels, more where edges and
/// shadows make up most of it. Where the cache traces more, as a tiny picture's does, it is as many more as the root of that. Later,
/// paths that the picture settles to bring samples of their own, and it is up to their weighing whether pixels or surfels need more.
const SAMPLES_OF_FRAME: [f32; FRAMES_BEFORE as usize] = [2.0, 3.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0];
/// Samples of a frame at most.
const MOST_SAMPLES: f32 = 16.0;
/// Pixels for each ray of the cache up to which a frame takes a further sample of them: that of a settled cache is nothing but its
/// pixels, and the next one takes them again.
const PIXELS_PER_RAY: f32 = 8.0;
/// Share of the tiles that gained a surfel below which the next frames need not look, and how many those are.
const QUIET_GAIN: f32 = 0.01;
const QUIET_FRAMES: u32 = 3;

/// What a piece of a frame leaves to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Progress {
    Partial,
    /// The rest waits for the next step.
    EndOfStep,
    Whole,
}

/// Where a frame stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Start,
    /// Paths are traced, until there are so many samples of them.
    Paths(u32),
    /// The cache is being updated.
    Update,
    /// Camera rays of a further sample are to be traced.
    Look,
    /// Pixels from here on are still to be shaded.
    Shade(u32),
    /// Their light is being reconstructed in the image.
    Reconstruct,
}

pub(super) struct SurfelPicture {
    options: TechniqueOptions,
    kernels: KernelSet,
    cache: Arc<Mutex<SurfelCache>>,
    camera: u64,
    /// Update that this picture has seen.
    seen_update: u32,
    phase: Phase,
    /// Frames of the cache.
    samples: u32,
    /// Samples of each pixel that they took.
    pixel_samples: u32,
    /// Samples that the frame in hand still takes after this one.
    samples_left: u32,
    /// Where the picture settles to the truth.
    settle: Option<Settle>,
    /// Rays of the frame in hand.
    frame_rays: u64,
    /// Frames until surfels are looked for again, while the picture stands still and is covered.
    quiet_frames: u32,
    /// What camera rays meet, 16 bytes a pixel.
    visible: Buffer,
    /// Where they need surfels, 32 bytes a pixel.
    points: Buffer,
    accumulation: Buffer,
    direct: Buffer,
    /// What direct light is shown with instead of its plain mean.
    light: DirectLight,
    /// Where surfels are drawn instead of gathered.
    splat: Option<Splat>,
    /// B and reflections, where asked for.
    split: Option<(Buffer, Buffer)>,
    /// Where light is reconstructed in the image.
    image: Option<ImageReconstruction>,
    counters: Buffer,
}

/// Samples of each pixel in a frame, before which there were `frames`, whose cache traces so many rays a pixel, and is to trace `asked`.
fn samples_of_frame(frames: u32, cache_rays: f32, asked: f32) -> u32 {
    let more = (cache_rays / asked).max(1.0);
    let samples = SAMPLES_OF_FRAME.get(frames as usize).copied().unwrap_or(1.0) * more.sqrt();
    // A first frame comes as soon as it can, and while something moves there is no other.
    let most = if frames == 0 { more } else { MOST_SAMPLES };
    let worth = 1.0 + (cache_rays * PIXELS_PER_RAY).floor();
    samples.min(most).min(worth).min(MOST_SAMPLES).round() as u32
}

impl SurfelPicture {
    pub(super) fn new(
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        session: &SessionState,
        options: TechniqueOptions,
    ) -> Result<Self, GpuError> {
        let splat = Splat::new(gpu, options.surfel.apply, options.size)?;
        let features = features_for(&scene.summary, options.materials, lights.punctual_count > 0, options.is_split)
            .with(SPLAT, splat.is_some());
        let general = general_features(options.materials, options.is_split).with(SPLAT, splat.is_some());
        let kernels = KernelSet::new(gpu, kernels_for(&options.surfel), features, general, options.waits_for_kernels)?;
        let pixels = u64::from(options.size[0]) * u64::from(options.size[1]);
        let view_buffer = |label| gpu.buffer(label, MemoryKind::View, pixels * 16);
        let full_pixels = options.full_size[0].saturating_mul(options.full_size[1]);
        let cache = session.surfel_cache(gpu, scene, options.materials, options.surfel, full_pixels, options.seed)?;
        let camera = cache.lock().add_camera(options.surfel.pins);
        Ok(Self {
            kernels,
            cache,
            camera,
            seen_update: 0,
            phase: Phase::Start,
            samples: 0,
            pixel_samples: 0,
            samples_left: 0,
            // What is split apart is the cache's alone.
            settle: (options.surfel.settles && !options.is_split)
                .then(|| Settle::new(options, features.with(SPLAT, false))),
            frame_rays: 0,
            quiet_frames: 0,
            visible: view_buffer("visible")?,
            points: gpu.buffer("visible_points", MemoryKind::View, pixels * size_of::<VisiblePoint>() as u64)?,
            accumulation: view_buffer("accumulation")?,
            direct: view_buffer("direct_mean")?,
            light: DirectLight::new(gpu, &options)?,
            splat,
            split: if options.is_split {
                Some((view_buffer("split_irradiance")?, view_buffer("split_reflection")?))
            } else {
                None
            },
            image: ImageReconstruction::new(gpu, &options)?,
            counters: counters::buffer(gpu)?,
            options,
        })
    }

    fn pixel_count(&self) -> u32 {
        self.options.size[0] * self.options.size[1]
    }

    /// Surfels are as dense as the full picture needs them, so that those of a gesture fit the still after it. A much smaller
    /// picture could neither cover itself with so many nor light them: where there are none it asks for coarser ones, which a larger one
    /// refines.
    fn is_small(&self) -> bool {
        self.options.size[1].saturating_mul(2) < self.options.full_size[1]
    }

    /// Radius of surfels it asks for, in its own pixels.
    fn wanted_pixels(&self) -> f32 {
        let coarseness = if self.is_small() { SURFEL_COARSENESS } else { 1.0 };
        let share = self.options.size[1] as f32 / self.options.full_size[1].max(1) as f32;
        self.options.surfel.radius_pixels * coarseness * share
    }

    fn ray_budget(&self, newborn: u32) -> u32 {
        // Pictures of a gesture are small so that they come soon; their rays are fewer likewise.
        let [width, height] = self.options.size;
        let rays = width as f32 * height as f32 * self.options.surfel.rays_per_pixel;
        (rays as u32).max(newborn.saturating_mul(RAYS_OF_NEWBORN)).clamp(FEWEST_RAYS, MOST_RAYS)
    }

    /// Camera rays, then surfels for what they meet, then the start of an update if one is due.
    fn start(
        &mut self,
        work: &Work<'_>,
        cache: &mut SurfelCache,
        view: &FrameView,
        frame: &FrameUniforms,
        step: &mut Step,
    ) -> Result<(), TechniqueError> {
        cache.set_camera(self.camera, cache_camera(view, work.scene.origin, self.options.full_size), view.exposure);
        self.look(work, cache, frame, step)?;
        cache.file(work, step)?;
        let mut gain = 0.0;
        if self.samples == 0 || self.quiet_frames == 0 {
            let asking = Asking {
                frame: bytemuck::bytes_of(frame),
                visible: &self.visible,
                points: &self.points,
                size: self.options.size,
                pins: self.options.surfel.pins,
                is_small: self.is_small(),
                radius_pixels: self.wanted_pixels(),
            };
            gain = cache.spawn(work, &asking, step)?;
            self.quiet_frames = if gain < QUIET_GAIN { QUIET_FRAMES } else { 0 };
        } else {
            self.quiet_frames -= 1;
        }
        // A picture that has not seen the newest update uses that one, unless it came upon much new ground; else it drives the next.
        let has_news = gain >= MUCH_GAIN || cache.update <= 1;
        if self.seen_update >= cache.update && !cache.is_settled || has_news {
            let rays = self.ray_budget(cache.newborn);
            cache.begin_update(work, bytemuck::bytes_of(frame), rays, has_news, step)?;
        }
        self.samples_left = self.further_samples(cache.rays_under_way());
        self.phase = Phase::Update;
        Ok(())
    }

    /// Samples of each pixel that a frame takes beyond its first, where the cache traces so many rays for it.
    fn further_samples(&self, cache_rays: u32) -> u32 {
        // A solve over pixels takes its differences once a frame.
        if self.image.is_some() {
            return 0;
        }
        let rays_per_pixel = cache_rays as f32 / self.pixel_count().max(1) as f32;
        samples_of_frame(self.samples, rays_per_pixel, self.options.surfel.rays_per_pixel) - 1
    }

    /// Camera rays of a sample.
    fn look(
        &self,
        work: &Work<'_>,
        cache: &SurfelCache,
        frame: &FrameUniforms,
        step: &mut Step,
    ) -> Result<(), TechniqueError> {
        // In pieces, so that no submission of a large picture holds the device for long.
        for first in (0..self.pixel_count()).step_by(VISIBILITY_PIXELS as usize) {
            let mut piece = *frame;
            piece.first_pixel = first;
            piece.pixel_count = VISIBILITY_PIXELS.min(self.pixel_count() - first);
            let mut graph = work.gpu.graph("surfel_visibility");
            work.lights
                .bind(work.scene.bind(graph.pass(self.kernels.get("surfel_visibility")?)))
                .uniform("frame", bytemuck::bytes_of(&piece))
                .uniform("cache", bytemuck::bytes_of(&cache.uniforms(0)))
                .read_write("visible", &self.visible)
                .read_write("visible_points", &self.points)
                .dispatch(workgroups_of(piece.pixel_count))?;
            merge_passes(&mut step.passes, graph.submit()?.wait()?.passes);
        }
        Ok(())
    }

    fn shade(
        &mut self,
        work: &Work<'_>,
        cache: &SurfelCache,
        frame: &FrameUniforms,
        first: u32,
        limit: u64,
        step: &mut Step,
    ) -> Result<u32, TechniqueError> {
        let range = u32::try_from(limit).unwrap_or(u32::MAX).max(64).min(self.pixel_count() - first);
        let mut frame = *frame;
        (frame.first_pixel, frame.pixel_count) = (first, range);
        frame.selector = self.light.selector(self.pixel_samples);
        let uniforms = cache.uniforms_for_picture(self.is_small());
        let mut graph = work.gpu.graph("surfel_shade");
        if let Some(splat) = self.splat.as_ref().filter(|_| first == 0) {
            splat.record(&mut graph, cache, &uniforms, bytemuck::bytes_of(&frame), &self.points)?;
        }
        graph.clear(&self.counters)?;
        let mut pass = cache
            .bind(work.lights.bind(work.scene.bind(graph.pass(self.kernels.get("surfel_shade")?))))
            .uniform("cache", bytemuck::bytes_of(&uniforms))
            .uniform("frame", bytemuck::bytes_of(&frame))
            .read("visible", &self.visible)
            .read_write("accumulation", &self.accumulation)
            .read_write("direct_mean", &self.direct)
            .read_write("counters", &self.counters)
            .read_write_if_bound("diffuse_direct", self.light.diffuse());
        if let Some(splat) = &self.splat {
            pass = splat.bind(pass);
        }
        if let Some((irradiance, reflection)) = &self.split {
            pass = pass.read_write("split_irradiance", irradiance).read_write("split_reflection", reflection);
        }
        pass.dispatch(workgroups_of(range))?;
        if let Some(image) = &self.image {
            image.record_gather(&mut graph, work, cache, &uniforms, &frame, [&self.visible, &self.points])?;
        }
        if first + range == self.pixel_count() {
            let is_last = self.samples_left == 0;
            self.light.record(&mut graph, &frame, &self.points, &self.accumulation, is_last)?;
        }
        let ticket = graph.read_back(&self.counters, 0..counters::BYTES)?;
        let mut report = graph.submit()?.wait()?;
        merge_passes(&mut step.passes, std::mem::take(&mut report.passes));
        count_rays(step, &report.take(ticket)?);
        Ok(range)
    }

    /// The next piece of a frame of the cache, of so many paths.
    fn advance_frame(
        &mut self,
        work: &Work<'_>,
        cache: &mut SurfelCache,
        view: &FrameView,
        frame: &FrameUniforms,
        left: u64,
        step: &mut Step,
    ) -> Result<Progress, TechniqueError> {
        match self.phase {
            // Whoever comes first finishes the update under way: nothing else may touch the cache meanwhile.
            Phase::Start | Phase::Update if cache.stage != UpdateStage::Idle => {
                let limit = u32::try_from(left).unwrap_or(u32::MAX);
                step.paths += u64::from(cache.advance(work, bytemuck::bytes_of(frame), limit, step)?);
            }
            Phase::Start | Phase::Paths(_) => {
                self.start(work, cache, view, frame, step)?;
                step.paths += u64::from(self.pixel_count());
            }
            Phase::Update => {
                self.seen_update = cache.update;
                self.phase = Phase::Shade(0);
            }
            Phase::Look => {
                self.look(work, cache, frame, step)?;
                step.paths += u64::from(self.pixel_count());
                self.phase = Phase::Shade(0);
            }
            Phase::Shade(first) => {
                let done = self.shade(work, cache, frame, first, left, step)?;
                step.paths += u64::from(done);
                self.phase = Phase::Shade(first + done);
                if first + done < self.pixel_count() {
                    return Ok(Progress::Partial);
                }
                if self.samples_left > 0 {
                    self.samples_left -= 1;
                    self.pixel_samples += 1;
                    self.phase = Phase::Look;
                    return Ok(Progress::Partial);
                } else if self.image.is_none() {
                    return Ok(Progress::Whole);
                }
                // The next step solves: it traces no path, so it says nothing of the rate of paths.
                self.phase = Phase::Reconstruct;
                return Ok(Progress::EndOfStep);
            }
            Phase::Reconstruct => {
                let picture = self.light.picture().unwrap_or(&self.accumulation);
                let irradiance = self.split.as_ref().map(|(irradiance, _)| irradiance);
                let drawn = Drawn { points: &self.points, picture, irradiance };
                let is_solved = match &mut self.image {
                    Some(image) => image.advance(work.gpu, frame, &drawn, step)?,
                    None => true,
                };
                return Ok(if is_solved { Progress::Whole } else { Progress::EndOfStep });
            }
        }
        Ok(Progress::Partial)
    }

    /// What the cache has to show.
    fn cache_picture(&self) -> &Buffer {
        let gathered = || self.light.picture().unwrap_or(&self.accumulation);
        self.image.as_ref().map_or_else(gathered, ImageReconstruction::picture)
    }

    /// A frame of the cache is whole.
    fn end_frame(
        &mut self,
        gpu: &Gpu,
        cache: &SurfelCache,
        view: &FrameView,
        step: &mut Step,
    ) -> Result<(), TechniqueError> {
        self.phase = Phase::Start;
        self.samples += 1;
        self.pixel_samples += 1;
        step.is_whole = true;
        let rays = std::mem::take(&mut self.frame_rays);
        if let Some(settle) = &mut self.settle {
            settle.count_cache(rays, cache.counts()[0]);
        }
        self.combine(gpu, view, step)
    }

    /// Goes over to paths where it is their turn.
    fn begin_paths(&mut self, gpu: &Gpu, budget: &StepBudget) -> Result<(), TechniqueError> {
        let left = budget.until_samples.saturating_sub(self.samples());
        if let Some(settle) = &mut self.settle
            && let Some(goal) = settle.due(gpu, self.samples, left)?
        {
            self.phase = Phase::Paths(goal);
        }
        Ok(())
    }

    /// Traces paths. Returns whether they made a whole picture.
    fn trace_paths(
        &mut self,
        work: &Work<'_>,
        view: &FrameView,
        budget: StepBudget,
        step: &mut Step,
    ) -> Result<bool, TechniqueError> {
        let Some(settle) = &mut self.settle else {
            self.phase = Phase::Start;
            return Ok(false);
        };
        let traced = settle.trace(work.gpu, work.scene, work.lights, view, budget)?;
        step.paths += traced.paths;
        step.non_finite += traced.non_finite;
        for (sum, count) in step.rays.iter_mut().zip(traced.rays) {
            *sum += count;
        }
        merge_passes(&mut step.passes, traced.passes);
        if !traced.is_whole {
            return Ok(false);
        }
        self.phase = Phase::Start;
        step.is_whole = settle.is_turn_of_paths();
        if step.is_whole {
            self.combine(work.gpu, view, step)?;
        }
        Ok(step.is_whole)
    }

    /// Weighs the cache's picture and the paths'.
    fn combine(&mut self, gpu: &Gpu, view: &FrameView, step: &mut Step) -> Result<(), TechniqueError> {
        let Some(mut settle) = self.settle.take() else { return Ok(()) };
        let combined = settle.combine(gpu, self.cache_picture(), self.samples, view.exposure, step);
        self.settle = Some(settle);
        Ok(combined?)
    }
}

impl Technique for SurfelPicture {
    fn step(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        view: &FrameView,
        budget: StepBudget,
    ) -> Result<Step, TechniqueError> {
        let mut step = Step::default();
        if self.phase == Phase::Start && self.samples() >= budget.until_samples {
            step.is_whole = true;
            return Ok(step);
        }
        if self.phase == Phase::Start {
            self.kernels.refresh(gpu);
            if self.samples == 0 {
                self.light.prepare(gpu, lights);
            }
        }
        let shared = Arc::clone(&self.cache);
        let mut cache = shared.lock();
        let mut frame = view.uniforms(scene, lights, self.kernels.running(), self.options.seed);
        frame.sample_count = 1;
        // The kernels are taken out for the length of the step, so that they and the rest can be borrowed apart.
        let kernels = self.kernels.clone();
        let work = Work { gpu, kernels: &kernels, scene, lights };
        while step.paths < budget.max_paths {
            let left = budget.max_paths - step.paths;
            if self.phase == Phase::Start && cache.stage == UpdateStage::Idle {
                self.begin_paths(gpu, &budget)?;
            }
            if let Phase::Paths(goal) = self.phase {
                let budget = StepBudget { max_paths: left, until_samples: goal, ..budget };
                if self.trace_paths(&work, view, budget, &mut step)? {
                    return Ok(step);
                }
                continue;
            }
            frame.first_sample = self.pixel_samples;
            let rays_before = step.rays.iter().sum::<u64>();
            let progress = self.advance_frame(&work, &mut cache, view, &frame, left, &mut step)?;
            self.frame_rays += step.rays.iter().sum::<u64>() - rays_before;
            if progress == Progress::Whole {
                self.end_frame(gpu, &cache, view, &mut step)?;
            }
            if progress != Progress::Partial {
                return Ok(step);
            }
        }
        Ok(step)
    }

    fn invalidate(&mut self, change: Change) {
        self.light.restart(change, self.samples);
        if let Some(settle) = &mut self.settle {
            settle.restart();
        }
        if let Some(image) = &mut self.image {
            image.restart();
        }
        self.samples = 0;
        self.pixel_samples = 0;
        self.samples_left = 0;
        self.frame_rays = 0;
        self.phase = Phase::Start;
    }

    fn leave_frame(&mut self) -> Option<EarlierFrame> {
        self.light.leave()
    }

    fn take_frame(&mut self, earlier: EarlierFrame) {
        self.light.take(earlier);
    }

    fn picture(&self) -> &Buffer {
        let settled = self.settle.as_ref().and_then(Settle::picture);
        settled.unwrap_or_else(|| self.cache_picture())
    }

    fn samples(&self) -> u32 {
        self.samples + self.settle.as_ref().map_or(0, Settle::counted)
    }

    fn split(&self) -> Option<(&Buffer, &Buffer)> {
        let reconstructed = self.image.as_ref().and_then(ImageReconstruction::irradiance);
        self.split.as_ref().map(|(irradiance, _)| (&self.direct, reconstructed.unwrap_or(irradiance)))
    }

    fn reflection(&self) -> Option<&Buffer> {
        self.split.as_ref().map(|(_, reflection)| reflection)
    }

    fn surfel_cache(&self) -> Option<Arc<Mutex<SurfelCache>>> {
        Some(Arc::clone(&self.cache))
    }

    fn features(&self) -> Features {
        self.kernels.features()
    }

    fn surfels(&self) -> Option<[u32; 2]> {
        Some(self.cache.lock().counts())
    }
}

impl Drop for SurfelPicture {
    fn drop(&mut self) {
        self.cache.lock().remove_camera(self.camera);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_takes_as_many_samples_as_its_rays_are_worth() {
        let of = |rays: f32| [0, 1, 2, 20].map(|frames| samples_of_frame(frames, rays, 0.5));
        assert_eq!(of(0.5), [1, 3, 2, 1], "the cache traces what it is to trace");
        assert_eq!(of(2.0), [4, 6, 4, 2], "four times that, as in a tiny picture");
        assert_eq!(of(0.1), [1, 1, 1, 1], "a settled cache");
        assert_eq!(of(1e9), [16; 4]);
        assert_eq!(of(0.0), [1; 4]);
    }
}
