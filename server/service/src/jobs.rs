//! Renders over HTTP: submitted to the renderer, followed to their end, encoded when their image is fetched.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use parking_lot::Mutex;
use surfelcast_renderer::handle::JobTicket;
use surfelcast_renderer::{JobProgress, RenderJob, RenderOutput, RenderSpec, RendererError, RendererHandle};
use surfelcast_store::{RenderBounds, RenderTable};
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::blocking::BlockingPool;
use crate::error::DomainError;
use crate::image_format::ImageFormat;
use crate::random_id::random_id;

/// The renderer must give up a canceled job within this time.
const CANCEL_PATIENCE: Duration = Duration::from_secs(30);

/// Where a job stands.
#[derive(Clone, Debug)]
pub(crate) enum JobState {
    /// Waiting or running; its progress says which.
    Active,
    /// There is an image.
    Succeeded(Arc<RenderOutput>),
    /// There is no image, for this reason.
    Failed(RendererError),
    /// A client canceled it.
    Canceled,
}

/// One render.
#[derive(Debug)]
pub(crate) struct Job {
    pub(crate) id: String,
    pub(crate) spec: RenderSpec,
    key: String,
    state: watch::Sender<JobState>,
    progress: watch::Receiver<JobProgress>,
    cancel: CancellationToken,
    encoded: tokio::sync::Mutex<BTreeMap<ImageFormat, Bytes>>,
}

impl Job {
    pub(crate) fn state(&self) -> JobState {
        self.state.borrow().clone()
    }

    pub(crate) fn progress(&self) -> JobProgress {
        *self.progress.borrow()
    }

    /// Waits until the job is no longer active.
    pub(crate) async fn finished(&self) -> JobState {
        let mut state = self.state.subscribe();
        // The sender lives in `self`, so waiting cannot fail.
        match state.wait_for(|state| !matches!(state, JobState::Active)).await {
            Ok(state) => state.clone(),
            Err(_) => JobState::Canceled,
        }
    }

    /// Stops the job; finished ones stay as they are.
    pub(crate) fn cancel(&self) {
        self.cancel.cancel();
    }

    /// Formats in which the image is available.
    pub(crate) fn formats(&self) -> &'static [ImageFormat] {
        ImageFormat::of_output(self.spec.aov.is_some())
    }

    /// Strong entity tag: the hash of everything the image depends on. With a time limit the image also depends on how
    /// fast the device was, so the job itself is part of the tag.
    pub(crate) fn etag(&self, format: ImageFormat) -> String {
        let key = self.key.get(..32).unwrap_or_default();
        let extension = format.extension();
        if self.spec.stop.time_limit.is_some() {
            format!("\"{key}-{}-{extension}\"", self.id)
        } else {
            format!("\"{key}-{extension}\"")
        }
    }
}

/// All jobs. Cheap to clone.
#[derive(Clone, Debug)]
pub(crate) struct Jobs(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    handle: RendererHandle,
    encoders: BlockingPool,
    tasks: TaskTracker,
    ended: CancellationToken,
    table: Mutex<RenderTable<Arc<Job>>>,
}

impl Jobs {
    /// Jobs run on the renderer behind `handle`. `tasks` follows each to its end, which `ended` brings about at once.
    pub(crate) fn new(
        handle: RendererHandle,
        encoders: BlockingPool,
        tasks: TaskTracker,
        ended: CancellationToken,
        bounds: RenderBounds,
    ) -> Self {
        Self(Arc::new(Inner { handle, encoders, tasks, ended, table: Mutex::new(RenderTable::new(bounds)) }))
    }

    /// Jobs waiting or running.
    pub(crate) fn active_count(&self) -> usize {
        self.0.table.lock().active_count()
    }

    /// A job by id; looking it up counts as use.
    pub(crate) fn get(&self, id: &str) -> Option<Arc<Job>> {
        self.0.table.lock().get(id)
    }

    /// The job of the same key, or a new one. The flag says whether it is new.
    pub(crate) fn submit(&self, job: RenderJob, key: String) -> Result<(Arc<Job>, bool), DomainError> {
        let mut table = self.0.table.lock();
        if let Some(job) = table.get_by_key(&key) {
            return Ok((job, false));
        }
        table.check_limit()?;
        let spec = job.spec.clone();
        let ticket = self.0.handle.render(job)?;
        let job = Arc::new(Job {
            id: random_id().map_err(|e| DomainError::internal(&e))?,
            spec,
            key,
            state: watch::Sender::new(JobState::Active),
            progress: ticket.progress.clone(),
            cancel: CancellationToken::new(),
            encoded: tokio::sync::Mutex::default(),
        });
        table.insert(&job.id, &job.key, Arc::clone(&job));
        drop(table);
        self.0.tasks.spawn(drive(self.clone(), Arc::clone(&job), ticket));
        Ok((job, true))
    }

    /// The image as a file; encoded once for each format.
    pub(crate) async fn file(&self, job: &Job, format: ImageFormat) -> Result<Bytes, DomainError> {
        let output = match job.state() {
            JobState::Succeeded(output) => output,
            JobState::Failed(error) => return Err(error.into()),
            JobState::Canceled => return Err(DomainError::RenderCanceled),
            JobState::Active => return Err(DomainError::NotFinished),
        };
        let mut encoded = job.encoded.lock().await;
        if let Some(file) = encoded.get(&format) {
            return Ok(file.clone());
        }
        // Exposure belongs to radiance; other outputs are shown as they are.
        let exposure = if job.spec.aov.is_some() { 1.0 } else { job.spec.exposure };
        let began = Instant::now();
        let file = self.0.encoders.run(move || format.encode(&output, exposure)).await;
        let file = file.map_err(|e| DomainError::internal(&e))?.map_err(DomainError::NotEncodable)?;
        metrics::histogram!("surfelcast_encode_seconds").record(began.elapsed().as_secs_f64());
        let file = Bytes::from(file);
        encoded.insert(format, file.clone());
        self.0.table.lock().grow(&job.id, file.len() as u64);
        Ok(file)
    }

    /// Removes a job, stopping it first.
    pub(crate) fn remove(&self, job: &Job) {
        job.cancel();
        self.0.table.lock().remove(&job.id);
    }

    fn finish(&self, job: &Job, outcome: JobState) {
        let bytes = match &outcome {
            JobState::Succeeded(output) => Some(size_of_val(output.pixels.as_slice()) as u64),
            _ => None,
        };
        self.0.table.lock().finish(&job.id, bytes);
        job.state.send_replace(outcome);
    }
}

/// Follows a job to its end: passes on a cancel and records the outcome. A job whose device is lost is the renderer's
/// to start over; if it answers that the device was lost, it has given the device up.
async fn drive(jobs: Jobs, job: Arc<Job>, mut ticket: JobTicket) {
    let began = Instant::now();
    let result = tokio::select! {
        result = &mut ticket.result => Some(result),
        () = job.cancel.cancelled() => {
            let _ = ticket.cancel.send(true);
            tokio::time::timeout(CANCEL_PATIENCE, &mut ticket.result).await.ok()
        }
        () = jobs.0.ended.cancelled() => None,
    };
    let outcome = match result {
        _ if job.cancel.is_cancelled() => JobState::Canceled,
        Some(Ok(Ok(output))) => JobState::Succeeded(Arc::new(output)),
        Some(Ok(Err(RendererError::Canceled))) | None => JobState::Canceled,
        Some(Ok(Err(error))) => JobState::Failed(error),
        Some(Err(_)) => JobState::Failed(RendererError::Stopped),
    };
    let label = match &outcome {
        JobState::Succeeded(output) => {
            metrics::histogram!("surfelcast_job_render_seconds").record(output.render_secs);
            let waited = began.elapsed().as_secs_f64() - output.render_secs - output.setup_secs;
            metrics::histogram!("surfelcast_job_queue_seconds").record(waited.max(0.0));
            "succeeded"
        }
        JobState::Failed(error) => {
            tracing::warn!(job = %job.id, %error, "render failed");
            "failed"
        }
        _ => "canceled",
    };
    metrics::counter!("surfelcast_jobs_total", "status" => label).increment(1);
    jobs.finish(&job, outcome);
}
