//! An image in the making: a technique advanced step by step, with its error audits and what it has cost.
//!
//! Views, jobs and benches drive their techniques through this one type, so that what is measured is what is served.

use std::time::Instant;

use surfelcast_gpu::{Gpu, PassTime};
use surfelcast_passes::merge_passes;
use surfelcast_passes::step::StepBudget;
use surfelcast_techniques::technique::{Change, Technique, TechniqueError};
use surfelcast_techniques::{Audit, AuditResult, FrameView, LightBuffers, SceneBuffers};

use crate::audit_schedule::AuditSchedule;
use crate::throughput::Throughput;

/// Largest batch of a job, samples a pixel.
pub const MAX_JOB_BATCH: u32 = 64;

/// A scene and its lights on the device.
#[derive(Clone, Copy, Debug)]
pub struct SceneOnDevice<'a> {
    /// Device.
    pub gpu: &'a Gpu,
    /// Scene.
    pub scene: &'a SceneBuffers,
    /// Light table.
    pub lights: &'a LightBuffers,
}

/// How far to go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Until {
    /// Samples a pixel at which the caller reads the image next; the technique does not go beyond them.
    pub samples: u32,
    /// Largest batch, samples a pixel. A fixed bound keeps images reproducible.
    pub max_batch: u32,
}

/// Where one step has led.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Advance {
    /// Samples a pixel of the image.
    pub samples: u32,
    /// Whether all pixels have the same number of samples.
    pub is_whole: bool,
}

/// What an image has cost.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cost {
    /// Wall time of the steps, seconds.
    pub secs: f64,
    /// Device time of the passes, seconds.
    pub gpu_secs: f64,
    /// Rays: primary, secondary, shadow.
    pub rays: [u64; 3],
    /// Samples that were not finite.
    pub non_finite: u64,
    /// Passes with their device times.
    pub passes: Vec<PassTime>,
}

impl Cost {
    /// Adds rays and passes: those of a step, or of an audit where audits count.
    pub fn add(&mut self, rays: [u64; 3], non_finite: u64, passes: Vec<PassTime>) {
        self.rays.iter_mut().zip(rays).for_each(|(sum, count)| *sum += count);
        self.non_finite += non_finite;
        self.gpu_secs += passes.iter().map(|pass| pass.gpu_ms * 1e-3).sum::<f64>();
        merge_passes(&mut self.passes, passes);
    }

    /// Device time of the passes whose names begin with `prefix`, seconds.
    pub fn gpu_secs_of(&self, prefix: &str) -> f64 {
        self.passes.iter().filter(|pass| pass.name.starts_with(prefix)).map(|pass| pass.gpu_ms * 1e-3).sum()
    }
}

/// A technique at work on one image.
pub struct Progressive<T: Technique + ?Sized = dyn Technique> {
    technique: Box<T>,
    audit: Option<Audit>,
    schedule: AuditSchedule,
    throughput: Throughput,
    cost: Cost,
}

impl<T: Technique + ?Sized> Progressive<T> {
    /// An image without samples, on a device of about this throughput.
    pub fn new(technique: Box<T>, throughput: Throughput) -> Self {
        Self { technique, audit: None, schedule: AuditSchedule::default(), throughput, cost: Cost::default() }
    }

    /// Takes samples for the time of one submission.
    pub fn advance(
        &mut self,
        on: SceneOnDevice<'_>,
        view: &FrameView,
        until: Until,
    ) -> Result<Advance, TechniqueError> {
        let budget = StepBudget {
            max_paths: self.throughput.step_paths(),
            until_samples: until.samples,
            max_batch: until.max_batch,
        };
        let started = Instant::now();
        let step = self.technique.step(on.gpu, on.scene, on.lights, view, budget)?;
        let elapsed = started.elapsed();
        self.throughput.measure(step.paths, elapsed);
        self.cost.secs += elapsed.as_secs_f64();
        self.cost.add(step.rays, step.non_finite, step.passes);
        Ok(Advance { samples: self.technique.samples(), is_whole: step.is_whole })
    }

    /// Lets the image be audited.
    pub fn set_audit(&mut self, audit: Audit) {
        self.audit = Some(audit);
    }

    /// Whether the image can be audited.
    pub fn has_audit(&self) -> bool {
        self.audit.is_some()
    }

    /// Estimates the error of the image, where it can be audited. What that costs is the caller's to count: benches
    /// leave it out.
    pub fn audit(&mut self, on: SceneOnDevice<'_>, view: &FrameView) -> Result<Option<AuditResult>, TechniqueError> {
        let Some(audit) = &mut self.audit else { return Ok(None) };
        let (picture, samples) = (self.technique.picture(), self.technique.samples());
        Ok(Some(audit.run(on.gpu, on.scene, on.lights, view, picture, samples, view.exposure)?))
    }

    /// Samples a pixel at which to audit next.
    pub(crate) fn next_audit(&self) -> u32 {
        self.schedule.next()
    }

    /// Plans the next audit on the way to `goal`, after one that found the error to be below `bound`.
    pub(crate) fn plan_audit(&mut self, bound: f64, goal: f64, most_growth: f64) {
        self.schedule.plan(self.technique.samples(), bound, goal, most_growth);
    }

    /// Starts the image over for another camera. The technique keeps what does not depend on it.
    pub(crate) fn restart(&mut self) {
        self.technique.invalidate(Change::Camera);
        self.schedule = AuditSchedule::default();
        if let Some(audit) = &mut self.audit {
            audit.reset();
        }
    }

    /// The technique.
    pub fn technique(&self) -> &T {
        &self.technique
    }

    /// The technique.
    pub fn technique_mut(&mut self) -> &mut T {
        &mut self.technique
    }

    /// Samples a pixel.
    pub fn samples(&self) -> u32 {
        self.technique.samples()
    }

    /// Throughput measured so far.
    pub fn throughput(&self) -> Throughput {
        self.throughput
    }

    /// What the image has cost.
    pub fn cost(&self) -> &Cost {
        &self.cost
    }

    /// What the image has cost, to add to.
    pub fn cost_mut(&mut self) -> &mut Cost {
        &mut self.cost
    }
}

impl<T: Technique + ?Sized> std::fmt::Debug for Progressive<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Progressive")
            .field("samples", &self.samples())
            .field("throughput", &self.throughput)
            .field("cost", &self.cost)
            .finish_non_exhaustive()
    }
}
