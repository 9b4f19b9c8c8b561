//! A job between its submission and its answer.

use surfelcast_gpu::Gpu;
use surfelcast_render_api::{JobProgress, RenderOutput};
use surfelcast_techniques::TechniqueEntry;
use tokio::sync::watch;

use crate::command::Reply;
use crate::error::RendererError;
use crate::job::RenderJob;
use crate::running_job::{JobState, RunningJob, kernels_of};
use crate::scenes::SceneStore;

/// A job with the channels to its caller.
pub(crate) struct SubmittedJob {
    technique: &'static TechniqueEntry,
    work: Work,
    progress: watch::Sender<JobProgress>,
    cancel: watch::Receiver<bool>,
    reply: Reply<RenderOutput>,
}

enum Work {
    /// Nothing of it is on the device.
    Waiting(Box<RenderJob>),
    Running(Box<RunningJob>),
}

impl SubmittedJob {
    pub(crate) fn new(
        technique: &'static TechniqueEntry,
        job: Box<RenderJob>,
        progress: watch::Sender<JobProgress>,
        cancel: watch::Receiver<bool>,
        reply: Reply<RenderOutput>,
    ) -> Self {
        Self { technique, work: Work::Waiting(job), progress, cancel, reply }
    }

    /// Whether the caller no longer waits for the answer.
    pub(crate) fn is_abandoned(&self) -> bool {
        self.reply.is_closed()
    }

    /// Whether a step would do work rather than wait for a compiler.
    pub(crate) fn is_compiled(&self, gpu: &Gpu) -> bool {
        match &self.work {
            Work::Running(_) => true,
            Work::Waiting(job) => kernels_of(self.technique, job)
                .iter()
                .all(|(name, features)| gpu.kernel_if_ready(name, *features).is_some()),
        }
    }

    /// Starts to compile the job's kernels in the background, so that views need not wait for them.
    pub(crate) fn prepare(&self, gpu: &Gpu) {
        if let Work::Waiting(job) = &self.work {
            for (name, features) in kernels_of(self.technique, job) {
                gpu.prepare(name, features);
            }
        }
    }

    /// Does the next piece of work. Returns the output once there is one.
    pub(crate) fn step(
        &mut self,
        gpu: &Gpu,
        store: &mut SceneStore,
    ) -> Result<Option<Box<RenderOutput>>, RendererError> {
        let is_canceled = *self.cancel.borrow();
        match &mut self.work {
            Work::Waiting(_) if is_canceled => Err(RendererError::Canceled),
            Work::Waiting(job) => {
                self.work = Work::Running(Box::new(RunningJob::start(gpu, store, self.technique, (**job).clone())?));
                Ok(None)
            }
            Work::Running(running) => match running.step(gpu, is_canceled)? {
                JobState::Done(output) => Ok(Some(output)),
                JobState::Running => {
                    self.progress.send_replace(running.progress());
                    Ok(None)
                }
            },
        }
    }

    /// Starts over after the device was lost. A job is deterministic, so this costs time and nothing else.
    pub(crate) fn start_over(&mut self) {
        if let Work::Running(running) = &self.work {
            self.work = Work::Waiting(Box::new(running.job().clone()));
        }
    }

    /// Sends the answer.
    pub(crate) fn answer(self, result: Result<RenderOutput, RendererError>) {
        // The caller may no longer wait.
        let _ = self.reply.send(result);
    }
}
