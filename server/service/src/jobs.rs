//! Renders in progress and finished ones, found again by what they show.
//!
//! Equal requests share one job while it runs and its result while that is cached. Finished jobs are dropped, least
//! recently used first, when their number or their bytes are over the bounds.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::http::StatusCode;
use bytes::Bytes;
use parking_lot::Mutex;
use surfelcast_renderer::{JobProgress, RenderJob, RenderOutput, RendererError};
use surfelcast_stream::{Codec, Quality, encode, encode_exr, tone_map_to_rgba8};
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

use crate::config::Bounds;
use crate::http::negotiate::Format;
use crate::http::problem::ApiError;
use crate::http::render_request::ResolvedRender;
use crate::state::ServiceState;
use crate::text::random_id;

/// A cancelled job must be given up within this time.
const CANCEL_PATIENCE: Duration = Duration::from_secs(30);
/// JPEG and WebP quality of renders.
const IMAGE_QUALITY: u8 = 92;

/// Where a job stands.
#[derive(Clone, Debug)]
pub(crate) enum JobState {
    /// Waiting or running; its progress says which.
    Active,
    /// There is a picture.
    Succeeded(Arc<RenderOutput>),
    /// There is none, and this is why.
    Failed(ApiError),
    /// Someone canceled it.
    Canceled,
}

/// One render.
#[derive(Debug)]
pub(crate) struct Job {
    pub(crate) id: String,
    pub(crate) spec: RenderJob,
    key: String,
    state: watch::Sender<JobState>,
    progress: watch::Receiver<JobProgress>,
    cancel: CancellationToken,
    encoded: tokio::sync::Mutex<BTreeMap<Format, Bytes>>,
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

    /// Asks the job to stop; finished ones stay as they are.
    pub(crate) fn cancel(&self) {
        self.cancel.cancel();
    }

    /// Formats this picture can be had in.
    pub(crate) fn formats(&self) -> &'static [Format] {
        // Values that are no colours survive only in floating point.
        if self.spec.aov.is_some() { &[Format::Exr] } else { &Format::IMAGES }
    }

    /// Strong entity tag: the hash of everything the picture depends on. A deadline makes the outcome a matter of
    /// timing, so there the job itself is part of the tag.
    pub(crate) fn etag(&self, format: Format) -> String {
        let key = self.key.get(..32).unwrap_or_default();
        let end = format.extension();
        if self.spec.stop.time_limit.is_some() {
            format!("\"{key}-{}-{end}\"", self.id)
        } else {
            format!("\"{key}-{end}\"")
        }
    }

    /// The picture as a file; encoded once for each format.
    pub(crate) async fn file(&self, state: &ServiceState, format: Format) -> Result<Bytes, ApiError> {
        let output = match self.state() {
            JobState::Succeeded(output) => output,
            JobState::Failed(error) => return Err(error),
            JobState::Canceled => return Err(canceled()),
            JobState::Active => {
                let detail = "the render is not finished; ask GET /v1/renders/{id} for its progress";
                return Err(ApiError::new(StatusCode::CONFLICT, "not_ready", detail).retry_after(1));
            }
        };
        let mut encoded = self.encoded.lock().await;
        if let Some(file) = encoded.get(&format) {
            return Ok(file.clone());
        }
        let exposure = self.spec.exposure;
        let began = Instant::now();
        let file = state.encoders().run(move || encode_output(&output, exposure, format)).await;
        let file = file
            .map_err(|e| ApiError::internal(&e))?
            .map_err(|e| ApiError::new(StatusCode::UNPROCESSABLE_ENTITY, "not_encodable", e.to_string()))?;
        metrics::histogram!("surfelcast_encode_seconds").record(began.elapsed().as_secs_f64());
        let file = Bytes::from(file);
        encoded.insert(format, file.clone());
        state.jobs().grew(&self.id, file.len() as u64, &state.config().bounds);
        Ok(file)
    }
}

fn encode_output(
    output: &RenderOutput,
    exposure: f32,
    format: Format,
) -> Result<Vec<u8>, surfelcast_stream::StreamError> {
    let display = |codec, quality| encode(&tone_map_to_rgba8(&output.pixels, exposure), output.size, codec, quality);
    match format {
        Format::Exr => encode_exr(&output.pixels, output.size),
        Format::Png | Format::Json => display(Codec::Png, Quality::Lossless),
        Format::Jpeg => display(Codec::Jpeg, Quality::Lossy(IMAGE_QUALITY)),
        Format::Webp => display(Codec::Webp, Quality::Lossy(IMAGE_QUALITY)),
    }
}

fn canceled() -> ApiError {
    let detail = "the render was canceled; send the request again";
    ApiError::new(StatusCode::CONFLICT, "render_canceled", detail)
}

#[derive(Debug, Default)]
struct Table {
    by_id: HashMap<String, Arc<Job>>,
    by_key: HashMap<String, String>,
    /// Finished jobs with their bytes, least recently used first.
    finished: VecDeque<(String, u64)>,
    active: usize,
}

/// All jobs.
#[derive(Debug, Default)]
pub(crate) struct Jobs {
    table: Mutex<Table>,
}

impl Jobs {
    /// Jobs waiting or running.
    pub(crate) fn active_count(&self) -> usize {
        self.table.lock().active
    }

    /// A job by id; asking for it counts as use.
    pub(crate) fn get(&self, id: &str) -> Option<Arc<Job>> {
        self.table.lock().touch(id)
    }

    /// The job of an equal request, or a new one. The flag tells whether it is new.
    pub(crate) fn submit(&self, state: &ServiceState, render: ResolvedRender) -> Result<(Arc<Job>, bool), ApiError> {
        let mut table = self.table.lock();
        let equal = table.by_key.get(&render.key).cloned();
        if let Some(job) = equal.and_then(|id| table.touch(&id)) {
            return Ok((job, false));
        }
        let limit = state.config().bounds.active_renders;
        if table.active >= limit {
            let detail = format!("{limit} renders are waiting or running already; try again later");
            return Err(ApiError::new(StatusCode::TOO_MANY_REQUESTS, "render_queue_full", detail).retry_after(5));
        }
        let ticket = state.handle().render(render.job.clone())?;
        let job = Arc::new(Job {
            id: random_id().map_err(|e| ApiError::internal(&e))?,
            spec: render.job,
            key: render.key,
            state: watch::Sender::new(JobState::Active),
            progress: ticket.progress.clone(),
            cancel: CancellationToken::new(),
            encoded: tokio::sync::Mutex::default(),
        });
        table.by_id.insert(job.id.clone(), Arc::clone(&job));
        table.by_key.insert(job.key.clone(), job.id.clone());
        table.active += 1;
        drop(table);
        state.tasks().spawn(drive(state.clone(), Arc::clone(&job), ticket));
        Ok((job, true))
    }

    /// Forgets a job, stopping it first.
    pub(crate) fn remove(&self, job: &Job) {
        job.cancel();
        let mut table = self.table.lock();
        table.by_id.remove(&job.id);
        table.forget_key(job);
        table.finished.retain(|(id, _)| *id != job.id);
    }

    fn settle(&self, job: &Job, outcome: JobState, bounds: &Bounds) {
        let mut table = self.table.lock();
        table.active -= 1;
        let bytes = if let JobState::Succeeded(output) = &outcome {
            size_of_val(output.pixels.as_slice()) as u64
        } else {
            table.forget_key(job);
            0
        };
        if table.by_id.contains_key(&job.id) {
            table.finished.push_back((job.id.clone(), bytes));
        }
        table.evict(bounds);
        drop(table);
        job.state.send_replace(outcome);
    }

    fn grew(&self, id: &str, bytes: u64, bounds: &Bounds) {
        let mut table = self.table.lock();
        if let Some(record) = table.finished.iter_mut().find(|(finished, _)| finished == id) {
            record.1 += bytes;
        }
        table.evict(bounds);
    }
}

impl Table {
    fn touch(&mut self, id: &str) -> Option<Arc<Job>> {
        let job = self.by_id.get(id).cloned()?;
        if let Some(at) = self.finished.iter().position(|(finished, _)| finished == id)
            && let Some(record) = self.finished.remove(at)
        {
            self.finished.push_back(record);
        }
        Some(job)
    }

    fn forget_key(&mut self, job: &Job) {
        if self.by_key.get(&job.key) == Some(&job.id) {
            self.by_key.remove(&job.key);
        }
    }

    /// Keeps the newest even when it alone is over the bound: someone is about to fetch it.
    fn evict(&mut self, bounds: &Bounds) {
        let mut bytes: u64 = self.finished.iter().map(|(_, bytes)| bytes).sum();
        while self.finished.len() > 1
            && (bytes > bounds.render_cache_bytes || self.finished.len() > bounds.finished_renders)
        {
            let Some((id, gone)) = self.finished.pop_front() else { return };
            bytes -= gone;
            if let Some(job) = self.by_id.remove(&id) {
                self.forget_key(&job);
            }
        }
    }
}

/// Sees a job through: passes on a cancel and records the outcome. A job whose device is lost is the renderer's to start over;
/// if it answers that the device was lost, it has given the device up.
async fn drive(state: ServiceState, job: Arc<Job>, mut ticket: surfelcast_renderer::handle::JobTicket) {
    let began = Instant::now();
    let result = tokio::select! {
        result = &mut ticket.result => Some(result),
        () = job.cancel.cancelled() => {
            let _ = ticket.cancel.send(true);
            tokio::time::timeout(CANCEL_PATIENCE, &mut ticket.result).await.ok()
        }
        () = state.ended().cancelled() => None,
    };
    let outcome = match result {
        _ if job.cancel.is_cancelled() => JobState::Canceled,
        Some(Ok(Ok(output))) => JobState::Succeeded(Arc::new(output)),
        Some(Ok(Err(RendererError::Canceled))) | None => JobState::Canceled,
        Some(Ok(Err(error))) => JobState::Failed(error.into()),
        Some(Err(_)) => JobState::Failed(RendererError::Stopped.into()),
    };
    let label = match &outcome {
        JobState::Succeeded(output) => {
            metrics::histogram!("surfelcast_job_render_seconds").record(output.render_secs);
            let waited = began.elapsed().as_secs_f64() - output.render_secs - output.setup_secs;
            metrics::histogram!("surfelcast_job_queue_seconds").record(waited.max(0.0));
            "succeeded"
        }
        JobState::Failed(error) => {
            tracing::warn!(job = %job.id, error = error.detail(), "render failed");
            "failed"
        }
        _ => "canceled",
    };
    metrics::counter!("surfelcast_jobs_total", "status" => label).increment(1);
    state.jobs().settle(&job, outcome, &state.config().bounds);
}
