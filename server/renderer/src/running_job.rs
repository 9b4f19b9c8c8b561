//! A batch render at work: steps of the technique until a stop rule holds, then the output.

use std::time::Instant;

use surfelcast_gpu::{Buffer, Gpu, MemoryKind};
use surfelcast_passes::{features, first_surface};
use surfelcast_render_api::{
    ErrorEstimate, JobProgress, OutputDescription, PassTime, RayCounts, RenderOutput, SkippedPass, StopRules,
};
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_techniques::technique::{Conformance, TechniqueOptions};
use surfelcast_techniques::{
    Audit, COMMON_OUTPUTS, CommonOutput, FirstSurfaceOutput, FrameView, LightBuffers, LightState, SceneBuffers,
    SessionState, TechniqueEntry,
};

use crate::error::RendererError;
use crate::job::RenderJob;
use crate::progressive::{Progressive, SceneOnDevice};
use crate::scenes::SceneStore;
use crate::stop::{StopPolicy, StopReason};
use crate::throughput::Throughput;

/// Largest factor of samples between audits: an error that falls with their root overshoots its goal by at most 10 %.
const AUDIT_GROWTH: f64 = 1.25;

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
    entry: &'static TechniqueEntry,
    session: SessionState,
    view: FrameView,
    scene: SceneBuffers,
    lights: LightBuffers,
    progressive: Progressive,
    stop: StopPolicy,
    error: Option<ErrorEstimate>,
    started: Instant,
    setup_secs: f64,
}

/// Kernels that a job will run, to be compiled before it takes the actor's time.
pub(crate) fn kernels_of(entry: &TechniqueEntry, job: &RenderJob) -> Vec<(&'static str, Features)> {
    let spec = &job.spec;
    let is_split = described(entry, spec.aov.as_deref()).is_some_and(|output| output.is_split);
    let has_punctual = match &job.lights {
        Some(lights) => !lights.punctual.is_empty(),
        None => !job.scene.punctual_lights.is_empty(),
    };
    let features = |is_split| features::features_for(&job.scene.summary, spec.materials, has_punctual, is_split);
    (entry.kernels)(&spec.settings)
        .into_iter()
        .filter(|_| surface_output(spec.aov.as_deref()).is_none())
        .chain(["error_audit"].into_iter().filter(|_| spec.aov.is_none()))
        .map(|kernel| (kernel, features(is_split && kernel != "error_audit")))
        .collect()
}

/// The description of an output that a technique has.
fn described(entry: &TechniqueEntry, aov: Option<&str>) -> Option<&'static OutputDescription> {
    let id = aov?;
    COMMON_OUTPUTS.iter().chain(entry.description.outputs).find(|output| output.id == id)
}

impl RunningJob {
    /// Uploads and compiles what the job needs.
    pub(crate) fn start(
        gpu: &Gpu,
        store: &mut SceneStore,
        entry: &'static TechniqueEntry,
        job: RenderJob,
    ) -> Result<Self, RendererError> {
        let setup_started = Instant::now();
        let spec = &job.spec;
        (entry.needs)(&job.scene.summary).map_err(RendererError::Unsupported)?;
        let output = described(entry, spec.aov.as_deref());
        if let (Some(id), None) = (&spec.aov, output) {
            return Err(lacks(entry, id));
        }
        let scene = store.get(gpu, &job.scene)?;
        let state = job.lights.clone().unwrap_or_else(|| LightState::of_scene(&job.scene));
        let lights = LightBuffers::new(gpu, &job.scene, &state)?;
        let options = TechniqueOptions {
            size: spec.size,
            full_size: spec.size,
            materials: spec.materials,
            is_split: output.is_some_and(|output| output.is_split),
            seed: spec.seed,
            waits_for_kernels: true,
            settings: spec.settings.clone(),
        };
        // A job starts from nothing, so that it gives the same bytes whatever was rendered before it.
        let session = SessionState::default();
        let technique = entry.start(gpu, &scene, &lights, &session, options)?;
        let is_biased = matches!((entry.conformance)(&spec.settings), Conformance::Biased { .. });
        let audited = technique.features().with(Features::SPLIT, false);
        let mut progressive = Progressive::new(technique, Throughput::default());
        if spec.aov.is_none() {
            progressive.set_audit(Audit::new(gpu, audited, spec.size, spec.seed)?);
        }
        // What cannot be audited does not stop at an error.
        let rules = StopRules { max_error: spec.stop.max_error.filter(|_| progressive.has_audit()), ..spec.stop };
        Ok(Self {
            view: FrameView { camera: spec.camera, size: spec.size, exposure: spec.exposure },
            entry,
            session,
            scene,
            lights,
            progressive,
            stop: StopPolicy::new(rules, is_biased),
            error: None,
            started: Instant::now(),
            setup_secs: setup_started.elapsed().as_secs_f64(),
            job,
        })
    }

    /// The job, to start it again on a new device.
    pub(crate) fn job(&self) -> &RenderJob {
        &self.job
    }

    /// Does the next piece of work.
    pub(crate) fn step(&mut self, gpu: &Gpu, is_canceled: bool) -> Result<JobState, RendererError> {
        if let Some(output) = surface_output(self.job.spec.aov.as_deref()) {
            return self.finish_surface(gpu, output).map(|output| JobState::Done(Box::new(output)));
        }
        let samples = self.progressive.samples();
        if is_canceled && samples == 0 {
            return Err(RendererError::Canceled);
        }
        if let Some(reason) = self.stop.reason(samples, self.started.elapsed(), is_canceled) {
            return self.finish(gpu, reason).map(|output| JobState::Done(Box::new(output)));
        }
        let on = SceneOnDevice { gpu, scene: &self.scene, lights: &self.lights };
        let next_audit = self.progressive.next_audit();
        let step = self.progressive.advance(on, &self.view, self.stop.until(next_audit))?;
        if let Some(goal) = self.stop.goal()
            && step.is_whole
            && step.samples >= next_audit
            && let Some(bound) = self.audit(gpu)?
        {
            self.stop.record(step.samples, bound);
            self.progressive.plan_audit(bound, goal, AUDIT_GROWTH);
        }
        Ok(JobState::Running)
    }

    /// Progress towards the nearest stop rule.
    pub(crate) fn progress(&self) -> JobProgress {
        let samples = self.progressive.samples();
        JobProgress {
            is_running: true,
            samples,
            fraction: self.stop.fraction(samples, self.started.elapsed()),
            error: self.error,
        }
    }

    /// Audits the image, where its output can be audited. Returns what the error is probably below.
    fn audit(&mut self, gpu: &Gpu) -> Result<Option<f64>, RendererError> {
        let on = SceneOnDevice { gpu, scene: &self.scene, lights: &self.lights };
        let Some(found) = self.progressive.audit(on, &self.view)? else { return Ok(None) };
        self.error = Some(ErrorEstimate::from(&found));
        self.progressive.cost_mut().add(found.rays, found.non_finite, found.passes);
        Ok(Some(found.bound))
    }

    fn finish(&mut self, gpu: &Gpu, reason: StopReason) -> Result<RenderOutput, RendererError> {
        self.audit(gpu)?;
        let technique = self.progressive.technique();
        let samples = technique.samples();
        let picture = read_vec4(gpu, technique.picture())?;
        let rgb = |v: &[f32; 4]| [v[0], v[1], v[2]];
        let aov = self.job.spec.aov.as_deref();
        let common = aov.and_then(CommonOutput::by_id);
        let own = match aov.filter(|_| common.is_none()) {
            Some(id) => {
                let found = technique.output(gpu, &self.scene, &self.lights, &self.view, id, false)?;
                Some(found.ok_or_else(|| lacks(self.entry, id))?)
            }
            None => None,
        };
        let pixels = match (common, technique.split()) {
            (Some(CommonOutput::Direct), Some((direct, _))) => read_vec4(gpu, direct)?.iter().map(rgb).collect(),
            (Some(CommonOutput::Irradiance), Some((_, irradiance))) => {
                read_vec4(gpu, irradiance)?.iter().map(rgb).collect()
            }
            (Some(CommonOutput::Indirect), Some((direct, _))) => {
                let direct = read_vec4(gpu, direct)?;
                picture.iter().zip(&direct).map(|(all, direct)| [0, 1, 2].map(|i| all[i] - direct[i])).collect()
            }
            (Some(CommonOutput::SampleCount), _) => vec![[samples as f32; 3]; picture.len()],
            (Some(CommonOutput::Variance), _) => {
                // Variance of the mean: squared deviations over n (n - 1).
                let n = f64::from(samples);
                let scale = if samples > 1 { 1.0 / (n * (n - 1.0)) } else { 0.0 };
                picture.iter().map(|v| [(f64::from(v[3]) * scale) as f32; 3]).collect()
            }
            _ => match &own {
                Some(own) => read_vec4(gpu, &own.buffer)?.iter().map(rgb).collect(),
                None => picture.iter().map(rgb).collect(),
            },
        };
        if let Some(own) = own {
            self.progressive.cost_mut().add([0; 3], 0, own.passes);
        }
        let mut output = self.output(gpu, pixels, samples, reason);
        if self.job.exports {
            output.export = self.session.of(self.entry).export(gpu, &self.scene)?;
        }
        Ok(output)
    }

    fn finish_surface(&mut self, gpu: &Gpu, output: FirstSurfaceOutput) -> Result<RenderOutput, RendererError> {
        let (pixels, passes) =
            first_surface::first_surface(gpu, &self.scene, &self.lights, &self.view, self.job.spec.materials, output)?;
        self.progressive.cost_mut().add([pixels.len() as u64, 0, 0], 0, passes);
        Ok(self.output(gpu, pixels, 1, StopReason::Samples))
    }

    fn output(&self, gpu: &Gpu, pixels: Vec<[f32; 3]>, samples: u32, reason: StopReason) -> RenderOutput {
        let memory = gpu.memory();
        let cost = self.progressive.cost();
        let [primary, secondary, shadow] = cost.rays;
        RenderOutput {
            pixels,
            size: self.job.spec.size,
            samples,
            error: self.error,
            rays: RayCounts { primary, secondary, shadow },
            render_secs: self.started.elapsed().as_secs_f64(),
            setup_secs: self.setup_secs,
            occupancy: self.progressive.technique().occupancy(),
            passes: pass_times(&cost.passes),
            skipped: skipped_passes(self.progressive.technique().features(), !self.progressive.has_audit()),
            non_finite: cost.non_finite,
            export: None,
            memory_bytes: vec![
                ("scene".to_owned(), memory.scene_bytes),
                ("session".to_owned(), memory.session_bytes),
                ("view".to_owned(), memory.view_bytes),
                ("staging".to_owned(), memory.staging_bytes),
            ],
            stopped_by: reason.name(),
        }
    }
}

/// The first-surface output behind an id, where there is one.
pub(crate) fn surface_output(aov: Option<&str>) -> Option<FirstSurfaceOutput> {
    if let Some(CommonOutput::Surface(output)) = CommonOutput::by_id(aov?) { Some(output) } else { None }
}

fn lacks(entry: &TechniqueEntry, output: &str) -> RendererError {
    RendererError::Unsupported(format!("aov: technique {} has no {output}", entry.id()))
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
