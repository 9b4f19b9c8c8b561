//! An interactive view at work: coarse and quick while its camera moves, refined step by step when it rests, silent when
//! it has converged.

use std::sync::Arc;
use std::time::{Duration, Instant};

use surfelcast_gpu::Gpu;
use surfelcast_passes::first_surface;
use surfelcast_passes::merge_passes;
use surfelcast_passes::step::StepBudget;
use surfelcast_passes::tone_map::tone_map;
use surfelcast_shaders::Features;
use surfelcast_techniques::technique::{Change, Technique, TechniqueOptions};
use surfelcast_techniques::{
    Audit, FrameView, LightBuffers, MaterialMode, SceneBuffers, SessionState, SurfelSettings, registry,
};

use crate::command::SessionKey;
use crate::convergence::{FIRST_AUDIT, next_audit};
use crate::error::RendererError;
use crate::job::{Aov, ErrorEstimate, SkippedPass, SurfelOutput};
use crate::pace::Pace;
use crate::running_job::{pass_times, skipped_passes, surface_output};
use crate::slot::FrameSlot;
use crate::view::{Frame, FrameKind, ViewState};

/// A still is shown when its samples have grown by this factor since the last one shown ...
const SHOW_GROWTH: u32 = 4;
/// ... or after this long, so that a slow device does not look stuck.
const SHOW_INTERVAL: Duration = Duration::from_millis(1500);
/// Largest factor between audits.
const AUDIT_GROWTH: f64 = 2.0;
/// Largest batch: a batch is what a camera move waits for at most in one submission.
const MAX_BATCH: u32 = 16;
/// Samples a pixel while moving, where the device has time for more than one.
const MAX_MOVING_SAMPLES: u32 = 8;
/// Smallest resolution factor.
const MIN_SCALE: f32 = 0.125;
/// Seed of interactive pictures.
const SEED: u64 = 0;

/// Device state of a view: the technique with its history at one size.
struct Work {
    technique: Box<dyn Technique>,
    technique_id: String,
    size: [u32; 2],
    audit: Option<Audit>,
    next_audit: u32,
}

/// What the picture in the making shows.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    /// A frame during a gesture.
    Moving { scale: f32 },
    /// At rest, but coarser than the screen: one sample a pixel, then twice the resolution.
    Sharpening { scale: f32 },
    /// At rest, full size.
    Refining,
    /// Nothing to do until something changes.
    Converged,
}

/// One view.
pub(crate) struct RunningView {
    pub(crate) session: SessionKey,
    pub(crate) slot: FrameSlot,
    /// Seconds of device time used, for fair scheduling.
    pub(crate) used_secs: f64,
    /// Newest wishes.
    state: ViewState,
    /// Wishes that the picture in the making shows.
    shown: ViewState,
    stage: Stage,
    /// `state` asks for another picture than the one in the making.
    is_stale: bool,
    /// Something to show has not been sent yet.
    is_unsent: bool,
    work: Option<Work>,
    pace: Pace,
    /// Full-size pictures that did not fit into memory are made at this factor.
    size_limit: f32,
    error: Option<ErrorEstimate>,
    /// What the error is probably below.
    error_bound: f64,
    /// Samples a pixel of the picture that was audited.
    audited_samples: u32,
    sent_samples: u32,
    sent_at: Instant,
    secs_since_frame: f64,
    passes: Vec<surfelcast_gpu::PassTime>,
    rays: u64,
}

impl RunningView {
    pub(crate) fn new(session: SessionKey, state: ViewState, slot: FrameSlot, used_secs: f64) -> Self {
        Self {
            session,
            slot,
            used_secs,
            shown: state.clone(),
            stage: Stage::Converged,
            is_stale: true,
            is_unsent: false,
            work: None,
            pace: Pace::default(),
            size_limit: 1.0,
            error: None,
            error_bound: f64::INFINITY,
            audited_samples: 0,
            sent_samples: 0,
            sent_at: Instant::now(),
            secs_since_frame: 0.0,
            passes: Vec::new(),
            rays: 0,
            state,
        }
    }

    /// Takes new wishes.
    pub(crate) fn update(&mut self, state: ViewState) {
        let is_same_picture = state.camera == self.state.camera
            && state.size == self.state.size
            && state.technique == self.state.technique;
        if !is_same_picture {
            self.is_stale = true;
        } else if state.is_moving != self.state.is_moving && !state.is_moving {
            // The gesture ended where it stood: sharpen, unless that is under way.
            self.is_stale |= matches!(self.stage, Stage::Moving { .. }) || self.stage == Stage::Converged;
        }
        if state.size != self.state.size {
            self.size_limit = 1.0;
        }
        if is_same_picture
            && (state.exposure != self.state.exposure
                || state.input_seq != self.state.input_seq
                || state.aov != self.state.aov)
        {
            // The same radiance, shown anew. The input number must reach the client even if nothing else changed.
            self.shown.exposure = state.exposure;
            self.shown.aov = state.aov;
            self.shown.input_seq = state.input_seq;
            self.is_unsent = true;
        }
        if is_same_picture
            && self.stage == Stage::Converged
            && (state.max_samples > self.shown.max_samples || state.max_error < self.shown.max_error)
        {
            self.stage = Stage::Refining;
        }
        self.shown.max_samples = state.max_samples;
        self.shown.max_error = state.max_error;
        self.state = state;
    }

    /// The session's lights changed.
    pub(crate) fn relight(&mut self) {
        self.is_stale = true;
        if let Some(work) = &mut self.work {
            work.technique.invalidate(Change::Lights);
        }
    }

    /// The device is gone.
    pub(crate) fn forget_device(&mut self) {
        self.work = None;
        self.is_stale = true;
    }

    /// Whether the view is in a gesture.
    pub(crate) fn is_moving(&self) -> bool {
        self.state.is_moving
    }

    /// Whether nothing is left to render or show.
    pub(crate) fn is_idle(&self) -> bool {
        self.state.is_paused || (!self.is_stale && !self.is_unsent && self.stage == Stage::Converged)
    }

    /// Whether a step would do something now. A picture that nobody can receive yet is not started while moving; a still
    /// goes on refining meanwhile.
    pub(crate) fn wants_step(&self) -> bool {
        if self.state.is_paused {
            return false;
        }
        let is_awaited = self.slot.is_wanted();
        if self.is_stale {
            return is_awaited || !self.state.is_moving;
        }
        match self.stage {
            Stage::Moving { .. } | Stage::Sharpening { .. } => !self.is_whole() || is_awaited,
            Stage::Refining => true,
            Stage::Converged => self.is_unsent && is_awaited && self.work.is_some(),
        }
    }

    /// Rays since the last call.
    pub(crate) fn take_rays(&mut self) -> u64 {
        std::mem::take(&mut self.rays)
    }

    /// Whether the picture in the making has all its samples.
    fn is_whole(&self) -> bool {
        self.work.as_ref().is_some_and(|work| work.technique.samples() >= self.goal_samples())
    }

    fn goal_samples(&self) -> u32 {
        match self.stage {
            // Where a full-size frame leaves time, it is spent on samples.
            Stage::Moving { scale } if scale >= self.state.max_scale.min(1.0) => {
                let pixels = u64::from(self.shown.size[0]) * u64::from(self.shown.size[1]);
                let affordable = self.pace.paths_in(self.shown.target_frame_secs) / pixels.max(1);
                (affordable as u32).clamp(1, MAX_MOVING_SAMPLES)
            }
            Stage::Moving { .. } | Stage::Sharpening { .. } => 1,
            Stage::Refining | Stage::Converged => self.shown.max_samples.max(1),
        }
    }

    /// Does the next piece of work. Returns whether a frame was finished.
    pub(crate) fn step(
        &mut self,
        gpu: &Gpu,
        scene: &Arc<SceneBuffers>,
        lights: &LightBuffers,
        session: &SessionState,
        scene_rev: u32,
    ) -> Result<bool, RendererError> {
        let started = Instant::now();
        let result = self.step_inner(gpu, scene, lights, session, scene_rev);
        let secs = started.elapsed().as_secs_f64();
        self.used_secs += secs;
        self.secs_since_frame += secs;
        match result {
            Err(RendererError::NoMemory { .. } | RendererError::SceneTooLarge { .. })
                if self.size_limit > MIN_SCALE =>
            {
                // The picture does not fit; a smaller one is better than none, and the client scales it up.
                self.size_limit *= 0.5;
                self.work = None;
                self.is_stale = true;
                Ok(false)
            }
            other => other,
        }
    }

    fn step_inner(
        &mut self,
        gpu: &Gpu,
        scene: &Arc<SceneBuffers>,
        lights: &LightBuffers,
        session: &SessionState,
        scene_rev: u32,
    ) -> Result<bool, RendererError> {
        // A frame of a gesture that has begun is finished and shown even if a newer pose is known: a picture of a moment
        // ago beats none. A still is given up at once.
        let is_busy_moving = matches!(self.stage, Stage::Moving { .. }) && self.work.is_some();
        if self.is_stale && !is_busy_moving {
            self.begin();
        }
        if self.stage == Stage::Converged {
            return if self.is_unsent { self.show(gpu, scene, lights, scene_rev) } else { Ok(false) };
        }
        self.prepare(gpu, scene, lights, session)?;
        if !self.is_whole() {
            self.trace(gpu, scene, lights)?;
        }
        self.after_step(gpu, scene, lights, scene_rev)
    }

    /// Starts the picture that the newest wishes ask for.
    fn begin(&mut self) {
        let coarse = self.pace.scale_for(self.state.size, self.state.target_frame_secs, self.state.max_scale);
        let was_sharp = self.stage == Stage::Refining || self.stage == Stage::Converged;
        self.shown = self.state.clone();
        self.is_stale = false;
        self.is_unsent = false;
        self.error = None;
        self.error_bound = f64::INFINITY;
        self.audited_samples = 0;
        self.sent_samples = 0;
        self.stage = if self.state.is_moving {
            Stage::Moving { scale: coarse }
        } else if coarse < 1.0 && (was_sharp || self.work.is_none()) {
            Stage::Sharpening { scale: coarse }
        } else if coarse < 0.5 {
            // The gesture's last frame is on the screen; start sharper than it.
            Stage::Sharpening { scale: coarse * 2.0 }
        } else {
            Stage::Refining
        };
        if let Some(work) = &mut self.work {
            work.technique.invalidate(Change::Camera);
            work.next_audit = FIRST_AUDIT;
            if let Some(audit) = &mut work.audit {
                audit.reset();
            }
        }
    }

    /// Size of the picture in the making.
    fn render_size(&self) -> [u32; 2] {
        let scale = match self.stage {
            Stage::Moving { scale } | Stage::Sharpening { scale } => scale,
            Stage::Refining | Stage::Converged => 1.0,
        };
        let scale = scale.min(self.size_limit);
        self.shown.size.map(|side| ((side as f32 * scale).round() as u32).max(1))
    }

    /// Makes the technique, where its size or kind changed.
    fn prepare(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        session: &SessionState,
    ) -> Result<(), RendererError> {
        let size = self.render_size();
        let needs_features =
            |work: &Work| work.technique.features().contains(Features::PUNCTUAL_LIGHTS) == (lights.punctual_count > 0);
        if self
            .work
            .as_ref()
            .is_some_and(|work| work.size == size && work.technique_id == self.shown.technique && needs_features(work))
        {
            return Ok(());
        }
        // Old buffers are freed first, so that the new ones may take their place; all but what the new picture starts from.
        let earlier = self.work.take().and_then(|mut work| work.technique.leave_frame());
        let entry = registry::by_id(&self.shown.technique)
            .ok_or_else(|| RendererError::Unsupported(format!("technique `{}` is not known", self.shown.technique)))?;
        let options = TechniqueOptions {
            size,
            full_size: self.shown.size,
            materials: MaterialMode::Pbr,
            is_split: false,
            seed: SEED,
            // There, the general variant would only add its own time, and the change to the fitting one stop the picture once more.
            waits_for_kernels: gpu.compiles_when_run(),
            surfel: SurfelSettings::default(),
        };
        let mut technique = (entry.create)(gpu, scene, lights, session, options)?;
        if let Some(earlier) = earlier {
            technique.take_frame(earlier);
        }
        self.work = Some(Work {
            technique,
            technique_id: self.shown.technique.clone(),
            size,
            audit: None,
            next_audit: FIRST_AUDIT,
        });
        Ok(())
    }

    fn trace(&mut self, gpu: &Gpu, scene: &SceneBuffers, lights: &LightBuffers) -> Result<(), RendererError> {
        let goal = self.goal_samples();
        let Some(work) = &mut self.work else { return Ok(()) };
        let view = FrameView { camera: self.shown.camera, size: work.size, exposure: self.shown.exposure };
        let mut until = goal;
        if self.stage == Stage::Refining {
            // Stop where the picture is shown or audited next.
            let samples = work.technique.samples();
            until =
                until.min(self.sent_samples.max(samples).max(1) * SHOW_GROWTH).min(work.next_audit.max(samples + 1));
            if self.sent_samples == 0 {
                until = until.min(1.max(samples));
            }
        }
        let budget =
            StepBudget { max_paths: self.pace.step_paths(), until_samples: until.max(1), max_batch: MAX_BATCH };
        let started = Instant::now();
        let step = work.technique.step(gpu, scene, lights, &view, budget)?;
        self.pace.measure(step.paths, started.elapsed());
        self.rays += step.rays.iter().sum::<u64>();
        merge_passes(&mut self.passes, step.passes);
        Ok(())
    }

    /// Audits, shows, and goes on to the next stage as far as the picture is whole.
    fn after_step(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        scene_rev: u32,
    ) -> Result<bool, RendererError> {
        let Some(samples) = self.work.as_ref().map(|work| work.technique.samples()) else { return Ok(false) };
        match self.stage {
            Stage::Moving { .. } | Stage::Sharpening { .. } => {
                if !self.is_whole() || !self.slot.is_wanted() {
                    return Ok(false);
                }
                self.is_unsent = true;
                let is_shown = self.show(gpu, scene, lights, scene_rev)?;
                self.stage = match self.stage {
                    Stage::Sharpening { scale } if scale < 0.5 => Stage::Sharpening { scale: scale * 2.0 },
                    Stage::Sharpening { .. } => Stage::Refining,
                    // The next pose, or the end of the gesture, starts anew.
                    _ => Stage::Converged,
                };
                if self.stage == Stage::Refining {
                    self.sent_samples = 0;
                }
                Ok(is_shown)
            }
            Stage::Refining => {
                if samples > 0 && self.work.as_ref().is_some_and(|work| samples >= work.next_audit) {
                    self.audit(gpu, scene, lights, false)?;
                }
                let is_good = self.error_bound <= f64::from(self.shown.max_error);
                if samples >= self.shown.max_samples.max(1) || is_good {
                    // What is said of the last picture is about that one, not about one of half its samples.
                    if self.audited_samples < samples {
                        self.audit(gpu, scene, lights, true)?;
                    }
                    self.stage = Stage::Converged;
                    self.is_unsent = true;
                }
                let is_due = samples >= self.sent_samples.max(1) * SHOW_GROWTH
                    || self.sent_samples == 0
                    || self.sent_at.elapsed() >= SHOW_INTERVAL;
                self.is_unsent |= samples > self.sent_samples && is_due;
                if self.is_unsent && samples > 0 { self.show(gpu, scene, lights, scene_rev) } else { Ok(false) }
            }
            Stage::Converged => Ok(false),
        }
    }

    /// Audits the picture. `may_wait` for the kernel: otherwise an audit that is not compiled yet is left out.
    fn audit(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        may_wait: bool,
    ) -> Result<(), RendererError> {
        let Some(work) = &mut self.work else { return Ok(()) };
        if work.audit.is_none() && !Audit::is_ready(gpu, work.technique.features()) && !may_wait {
            return Ok(());
        }
        let samples = work.technique.samples();
        let audit = match &mut work.audit {
            Some(audit) => audit,
            none => none.insert(Audit::new(gpu, work.technique.features(), work.size, SEED)?),
        };
        let view = FrameView { camera: self.shown.camera, size: work.size, exposure: self.shown.exposure };
        let picture = work.technique.picture();
        let found = audit.run(gpu, scene, lights, &view, picture, samples, self.shown.exposure)?;
        work.next_audit = next_audit(samples, found.bound, f64::from(self.shown.max_error), AUDIT_GROWTH);
        self.audited_samples = samples;
        self.rays += found.rays.iter().sum::<u64>();
        self.error_bound = found.bound;
        self.error = Some(ErrorEstimate::from(&found));
        merge_passes(&mut self.passes, found.passes);
        Ok(())
    }

    /// Tone-maps the picture and hands it over, if the slot wants one.
    fn show(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        scene_rev: u32,
    ) -> Result<bool, RendererError> {
        if !self.slot.is_wanted() {
            return Ok(false);
        }
        let Some(work) = &self.work else { return Ok(false) };
        let samples = work.technique.samples();
        let [width, height] = work.size;
        let view = FrameView { camera: self.shown.camera, size: work.size, exposure: self.shown.exposure };
        let features = work.technique.features();
        let output = match self.shown.aov {
            Some(Aov::Surfel(output)) => match work.technique.surfel_cache() {
                Some(cache) => Some(cache.lock().look(gpu, scene, lights, &view, features, output, true)?),
                None => None,
            },
            Some(aov) => match surface_output(Some(aov)) {
                Some(output) => {
                    Some(first_surface::first_surface_for_screen(gpu, scene, lights, &view, MaterialMode::Pbr, output)?)
                }
                None => None,
            },
            None => None,
        };
        let (picture, exposure) = match &output {
            Some((buffer, _)) if !matches!(self.shown.aov, Some(Aov::Surfel(SurfelOutput::Irradiance))) => {
                (buffer, 1.0)
            }
            Some((buffer, _)) => (buffer, self.shown.exposure),
            None => (work.technique.picture(), self.shown.exposure),
        };
        let (pixels, mut passes) = tone_map(gpu, picture, width * height, exposure)?;
        if let Some((_, more)) = output {
            merge_passes(&mut passes, more);
        }
        merge_passes(&mut self.passes, passes);
        let kind = match self.stage {
            Stage::Moving { .. } | Stage::Sharpening { .. } => FrameKind::Moving,
            Stage::Refining => FrameKind::Still,
            Stage::Converged if self.state.is_moving => FrameKind::Moving,
            Stage::Converged => FrameKind::Final,
        };
        let mut skipped = skipped_passes(work.technique.features(), false);
        if self.error.is_none() {
            let reason = format!("the picture has {samples} samples a pixel; audits start at {FIRST_AUDIT}");
            skipped.push(SkippedPass { name: "error_audit".to_owned(), reason });
        }
        self.slot.put(Arc::new(Frame {
            pixels: pixels.into(),
            size: work.size,
            full_size: self.shown.size,
            kind,
            input_seq: self.shown.input_seq,
            scene_rev,
            samples,
            error: self.error,
            render_secs: self.secs_since_frame as f32,
            finished_at: Instant::now(),
            passes: pass_times(&std::mem::take(&mut self.passes)),
            skipped,
        }));
        self.is_unsent = false;
        self.sent_samples = samples;
        self.sent_at = Instant::now();
        self.secs_since_frame = 0.0;
        Ok(true)
    }
}
