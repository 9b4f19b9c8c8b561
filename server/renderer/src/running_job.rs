//! A batch render at work: steps of the technique until a stop rule holds, then the output.

use std::sync::Arc;
use std::time::Instant;

use surfelcast_gpu::{Buffer, Gpu, MemoryKind};
use surfelcast_passes::merge_passes;
use surfelcast_passes::step::StepBudget;
use surfelcast_passes::{features, first_surface};
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_techniques::technique::{Conformance, Technique, TechniqueOptions};
use surfelcast_techniques::{
    Audit, FirstSurfaceOutput, FrameView, LightBuffers, LightState, SceneBuffers, SessionState, registry,
};

use crate::convergence::{FIRST_AUDIT, next_audit};
use crate::error::RendererError;
use crate::job::{Aov, ErrorEstimate, JobProgress, PassTime, RayCounts, RenderJob, RenderOutput, SkippedPass};
use crate::pace::Pace;
use crate::scenes::SceneStore;

/// Largest factor between audits for `max_error`: an error that falls with the root overshoots its goal by at most 10 %.
const AUDIT_GROWTH: f64 = 1.25;
/// Samples a pixel after which a job without another rule ends.
const MAX_SAMPLES: u32 = 1 << 20;
/// Samples from which a biased technique may be told to stop, and the share of the error at a quarter of the samples above
/// which it is: noise alone would leave a half.
const STALL_SAMPLES: u32 = 512;
const STALL_SHARE: f64 = 0.85;
/// Largest batch; smaller under a time limit, which may cut a batch short and leave it uneven.
const MAX_BATCH: u32 = 64;
const MAX_BATCH_TIMED: u32 = 4;

/// Whether a job goes on.
pub(crate) enum JobState {
    /// Call again.
    Running,
    /// Finished.
    Done(Box<RenderOutput>),
}

/// One job with its device state.
pub(crate) struct RunningJob {
    job: RenderJob,
    view: FrameView,
    scene: Arc<SceneBuffers>,
    lights: LightBuffers,
    technique: Box<dyn Technique>,
    audit: Option<Audit>,
    next_audit: u32,
    error: Option<ErrorEstimate>,
    /// What the error is probably below.
    error_bound: f64,
    /// The technique may stop short of the truth, so a goal may lie out of its reach.
    is_biased: bool,
    /// Bounds at earlier audits by samples, the latest last.
    earlier_bounds: Vec<(u32, f64)>,
    pace: Pace,
    started: Instant,
    setup_secs: f64,
    rays: RayCounts,
    non_finite: u64,
    passes: Vec<surfelcast_gpu::PassTime>,
}

/// Kernels that a job will run, to be compiled before it takes the actor's time.
pub(crate) fn kernels_of(job: &RenderJob) -> Vec<(&'static str, Features)> {
    let Some(entry) = registry::by_id(&job.technique) else { return Vec::new() };
    let is_split = is_split(job.aov);
    let has_punctual = match &job.lights {
        Some(lights) => !lights.punctual.is_empty(),
        None => !job.scene.punctual_lights.is_empty(),
    };
    let features = |is_split| features::features_for(&job.scene.summary, job.materials, has_punctual, is_split);
    (entry.kernels)(&job.surfel)
        .into_iter()
        .filter(|_| surface_output(job.aov).is_none())
        .chain(["error_audit"].into_iter().filter(|_| job.aov.is_none()))
        .map(|kernel| (kernel, features(is_split && kernel != "error_audit")))
        .collect()
}

/// Whether an output needs direct and indirect light apart.
fn is_split(aov: Option<Aov>) -> bool {
    matches!(aov, Some(Aov::Direct | Aov::Indirect | Aov::Irradiance | Aov::Reflection))
}

impl RunningJob {
    /// Uploads and compiles what the job needs.
    pub(crate) fn start(gpu: &Gpu, store: &mut SceneStore, job: RenderJob) -> Result<Self, RendererError> {
        let setup_started = Instant::now();
        let entry = registry::by_id(&job.technique)
            .ok_or_else(|| RendererError::Unsupported(format!("technique `{}` is not known", job.technique)))?;
        (entry.needs)(&job.scene.summary).map_err(RendererError::Unsupported)?;
        let scene = store.get(gpu, &job.scene)?;
        let state = job.lights.clone().unwrap_or_else(|| LightState::of_scene(&job.scene));
        let lights = LightBuffers::new(gpu, &job.scene, &state)?;
        let options = TechniqueOptions {
            size: job.size,
            full_size: job.size,
            materials: job.materials,
            is_split: is_split(job.aov),
            seed: job.seed,
            waits_for_kernels: true,
            surfel: job.surfel,
        };
        // A job starts from nothing, so that it gives the same bytes whatever was rendered before it.
        let technique = (entry.create)(gpu, &scene, &lights, &SessionState::default(), options)?;
        if technique.surfel_cache().is_none() {
            let lacking = match job.aov {
                Some(Aov::Reflection) => Some("reflections kept apart"),
                Some(Aov::Surfel(_)) => Some("surfels"),
                _ => None,
            };
            if let Some(what) = lacking {
                return Err(RendererError::Unsupported(format!("aov: technique {} has no {what}", job.technique)));
            }
        }
        let is_biased = matches!((entry.conformance)(&job.surfel), Conformance::Biased { .. });
        let audited = technique.features().with(Features::SPLIT, false);
        let audit = (job.aov.is_none()).then(|| Audit::new(gpu, audited, job.size, job.seed)).transpose()?;
        Ok(Self {
            view: FrameView { camera: job.camera, size: job.size, exposure: job.exposure },
            scene,
            lights,
            technique,
            audit,
            next_audit: FIRST_AUDIT,
            error: None,
            error_bound: f64::INFINITY,
            is_biased,
            earlier_bounds: Vec::new(),
            pace: Pace::default(),
            started: Instant::now(),
            setup_secs: setup_started.elapsed().as_secs_f64(),
            rays: RayCounts::default(),
            non_finite: 0,
            passes: Vec::new(),
            job,
        })
    }

    /// The job, to start it again on a new device.
    pub(crate) fn job(&self) -> &RenderJob {
        &self.job
    }

    /// Does the next piece of work.
    pub(crate) fn step(&mut self, gpu: &Gpu, is_canceled: bool) -> Result<JobState, RendererError> {
        if let Some(output) = surface_output(self.job.aov) {
            return self.finish_surface(gpu, output).map(|output| JobState::Done(Box::new(output)));
        }
        let stop = self.job.stop;
        let samples = self.technique.samples();
        let is_timed_out = stop.time_limit.is_some_and(|limit| self.started.elapsed() >= limit);
        if is_canceled && samples == 0 {
            return Err(RendererError::Canceled);
        }
        // At least one sample for each pixel is taken, whatever the limit: there is no picture before.
        let reason = if samples == 0 {
            None
        } else if is_canceled {
            Some("canceled")
        } else if stop.samples.is_some_and(|limit| samples >= limit) || samples >= MAX_SAMPLES {
            Some("samples")
        } else if is_timed_out {
            Some("time_limit")
        } else if self.meets_error() {
            Some("max_error")
        } else if self.is_stalled() {
            Some("stalled")
        } else {
            None
        };
        if let Some(stopped_by) = reason {
            return self.finish(gpu, stopped_by).map(|output| JobState::Done(Box::new(output)));
        }

        let is_auditing = stop.max_error.is_some() && self.audit.is_some();
        let mut until = stop.samples.unwrap_or(MAX_SAMPLES).min(MAX_SAMPLES);
        if is_auditing {
            until = until.min(self.next_audit);
        }
        let budget = StepBudget {
            max_paths: self.pace.step_paths(),
            until_samples: until,
            max_batch: if stop.time_limit.is_some() { MAX_BATCH_TIMED } else { MAX_BATCH },
        };
        let step_started = Instant::now();
        let step = self.technique.step(gpu, &self.scene, &self.lights, &self.view, budget)?;
        self.pace.measure(step.paths, step_started.elapsed());
        self.count(step.rays, step.non_finite);
        merge_passes(&mut self.passes, step.passes);
        if is_auditing && step.is_whole && self.technique.samples() >= self.next_audit {
            self.run_audit(gpu)?;
            self.earlier_bounds.push((self.technique.samples(), self.error_bound));
            let goal = stop.max_error.map_or(0.0, f64::from);
            self.next_audit = next_audit(self.technique.samples(), self.error_bound, goal, AUDIT_GROWTH);
        }
        Ok(JobState::Running)
    }

    /// Progress towards the nearest stop rule.
    pub(crate) fn progress(&self) -> JobProgress {
        let stop = self.job.stop;
        let samples = self.technique.samples();
        let by_samples = stop.samples.map_or(0.0, |limit| samples as f32 / limit.max(1) as f32);
        let elapsed = self.started.elapsed().as_secs_f32();
        let by_time = stop.time_limit.map_or(0.0, |limit| elapsed / limit.as_secs_f32().max(1e-3));
        // The error falls with the root of the samples.
        let by_error = stop.max_error.map_or(0.0, |goal| (f64::from(goal) / self.error_bound).powi(2) as f32);
        JobProgress {
            is_running: true,
            samples,
            fraction: by_samples.max(by_time).max(by_error).clamp(0.0, 1.0),
            error: self.error,
        }
    }

    fn meets_error(&self) -> bool {
        self.job.stop.max_error.is_some_and(|goal| self.error_bound <= f64::from(goal))
    }

    /// Whether an error that should have halved since a quarter of the samples hardly fell: then what is left is bias.
    fn is_stalled(&self) -> bool {
        let Some(&(samples, bound)) = self.earlier_bounds.last() else { return false };
        let earlier = self.earlier_bounds.iter().rev().find(|(then, _)| *then <= samples / 4);
        self.is_biased && samples >= STALL_SAMPLES && earlier.is_some_and(|(_, then)| bound > STALL_SHARE * then)
    }

    fn count(&mut self, rays: [u64; 3], non_finite: u64) {
        self.rays.primary += rays[0];
        self.rays.secondary += rays[1];
        self.rays.shadow += rays[2];
        self.non_finite += non_finite;
    }

    fn run_audit(&mut self, gpu: &Gpu) -> Result<(), RendererError> {
        let Some(audit) = &mut self.audit else { return Ok(()) };
        let picture = self.technique.picture();
        let samples = self.technique.samples();
        let found = audit.run(gpu, &self.scene, &self.lights, &self.view, picture, samples, self.job.exposure)?;
        self.count(found.rays, found.non_finite);
        self.error_bound = found.bound;
        self.error = Some(ErrorEstimate::from(&found));
        merge_passes(&mut self.passes, found.passes);
        Ok(())
    }

    fn finish(&mut self, gpu: &Gpu, stopped_by: &'static str) -> Result<RenderOutput, RendererError> {
        if self.audit.is_some() {
            self.run_audit(gpu)?;
        }
        let samples = self.technique.samples();
        let picture = read_vec4(gpu, self.technique.picture())?;
        let rgb = |v: &[f32; 4]| [v[0], v[1], v[2]];
        let pixels = match (self.job.aov, self.technique.split()) {
            (Some(Aov::Direct), Some((direct, _))) => read_vec4(gpu, direct)?.iter().map(rgb).collect(),
            (Some(Aov::Irradiance), Some((_, irradiance))) => read_vec4(gpu, irradiance)?.iter().map(rgb).collect(),
            (Some(Aov::Indirect), Some((direct, _))) => {
                let direct = read_vec4(gpu, direct)?;
                picture.iter().zip(&direct).map(|(all, direct)| [0, 1, 2].map(|i| all[i] - direct[i])).collect()
            }
            (Some(Aov::Reflection), _) => match self.technique.reflection() {
                Some(reflection) => read_vec4(gpu, reflection)?.iter().map(rgb).collect(),
                None => return Err(self.lacks("reflections kept apart")),
            },
            (Some(Aov::Surfel(output)), _) => {
                let Some(cache) = self.technique.surfel_cache() else { return Err(self.lacks("surfels")) };
                let features = self.technique.features();
                let found = cache.lock().look(gpu, &self.scene, &self.lights, &self.view, features, output, false)?;
                merge_passes(&mut self.passes, found.1);
                read_vec4(gpu, &found.0)?.iter().map(rgb).collect()
            }
            (Some(Aov::SampleCount), _) => vec![[samples as f32; 3]; picture.len()],
            (Some(Aov::Variance), _) => {
                // Variance of the mean: squared deviations over n (n - 1).
                let n = f64::from(samples);
                let scale = if samples > 1 { 1.0 / (n * (n - 1.0)) } else { 0.0 };
                picture.iter().map(|v| [(f64::from(v[3]) * scale) as f32; 3]).collect()
            }
            _ => picture.iter().map(rgb).collect(),
        };
        let mut output = self.output(gpu, pixels, samples, stopped_by);
        if self.job.exports_surfels
            && let Some(cache) = self.technique.surfel_cache()
        {
            output.exported_surfels = cache.lock().export(gpu)?;
        }
        Ok(output)
    }

    fn lacks(&self, what: &str) -> RendererError {
        RendererError::Unsupported(format!("aov: technique {} has no {what}", self.job.technique))
    }

    fn finish_surface(&mut self, gpu: &Gpu, output: FirstSurfaceOutput) -> Result<RenderOutput, RendererError> {
        let (pixels, passes) =
            first_surface::first_surface(gpu, &self.scene, &self.lights, &self.view, self.job.materials, output)?;
        self.rays.primary += pixels.len() as u64;
        merge_passes(&mut self.passes, passes);
        Ok(self.output(gpu, pixels, 1, "samples"))
    }

    fn output(&self, gpu: &Gpu, pixels: Vec<[f32; 3]>, samples: u32, stopped_by: &'static str) -> RenderOutput {
        let memory = gpu.memory();
        RenderOutput {
            pixels,
            size: self.job.size,
            samples,
            error: self.error,
            rays: self.rays,
            render_secs: self.started.elapsed().as_secs_f64(),
            setup_secs: self.setup_secs,
            surfels: self.technique.surfels(),
            passes: pass_times(&self.passes),
            skipped: skipped_passes(self.technique.features(), self.audit.is_none()),
            non_finite: self.non_finite,
            exported_surfels: Vec::new(),
            memory_bytes: vec![
                ("scene".to_owned(), memory.scene_bytes),
                ("session".to_owned(), memory.session_bytes),
                ("view".to_owned(), memory.view_bytes),
                ("staging".to_owned(), memory.staging_bytes),
            ],
            stopped_by,
        }
    }
}

/// The first-surface output behind an AOV, where there is one.
pub(crate) fn surface_output(aov: Option<Aov>) -> Option<FirstSurfaceOutput> {
    match aov? {
        Aov::Albedo => Some(FirstSurfaceOutput::Albedo),
        Aov::Normal => Some(FirstSurfaceOutput::Normal),
        Aov::Depth => Some(FirstSurfaceOutput::Depth),
        Aov::Position => Some(FirstSurfaceOutput::Position),
        Aov::InstanceId => Some(FirstSurfaceOutput::Instance),
        Aov::Direct
        | Aov::Indirect
        | Aov::Irradiance
        | Aov::SampleCount
        | Aov::Variance
        | Aov::Reflection
        | Aov::Surfel(_) => None,
    }
}

pub(crate) fn pass_times(passes: &[surfelcast_gpu::PassTime]) -> Vec<PassTime> {
    passes
        .iter()
        .map(|pass| PassTime { name: pass.name.clone(), gpu_ms: pass.gpu_ms, dispatches: pass.dispatches })
        .collect()
}

pub(crate) fn skipped_passes(in_use: Features, is_unaudited: bool) -> Vec<SkippedPass> {
    let mut skipped: Vec<SkippedPass> = features::skipped_parts(in_use)
        .into_iter()
        .map(|(name, reason)| SkippedPass { name: name.to_owned(), reason: reason.to_owned() })
        .collect();
    if is_unaudited {
        let reason = "the output is not radiance".to_owned();
        skipped.push(SkippedPass { name: "error_audit".to_owned(), reason });
    }
    skipped
}

fn read_vec4(gpu: &Gpu, buffer: &Buffer) -> Result<Vec<[f32; 4]>, RendererError> {
    debug_assert_eq!(buffer.kind(), MemoryKind::View);
    let mut graph = gpu.graph("read_back");
    let ticket = graph.read_back(buffer, 0..buffer.size_bytes())?;
    let mut report = graph.submit()?.wait()?;
    Ok(bytemuck::pod_collect_to_vec(&report.take(ticket)?))
}
