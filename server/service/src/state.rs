//! The state that all handlers share.

use std::net::{Ipv4Addr, SocketAddr};
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use axum::http::HeaderValue;
use metrics_exporter_prometheus::PrometheusHandle;
use surfelcast_renderer::scene::Scene;
use surfelcast_renderer::{DeviceState, RendererHandle, RendererStatus};
use surfelcast_store::{RenderBounds, StoreError};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::blocking::BlockingPool;
use crate::config::ServiceConfig;
use crate::http::idempotency::Idempotency;
use crate::jobs::Jobs;
use crate::live::resume::ResumeTokens;
use crate::observe;
use crate::scene_library::SceneLibrary;
use crate::sessions::Sessions;

/// Why the service could not start.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError {
    /// The data folder cannot be used.
    #[error("data folder {path}: {source}; name another with --data or make it writable")]
    DataDir {
        /// The folder.
        path: String,
        /// Cause.
        source: StoreError,
    },
    /// A configured value cannot be sent in a header.
    #[error("frame_ancestors: not usable in a content security policy: {0}")]
    FrameAncestors(String),
}

/// State of the service; cheap to clone.
#[derive(Clone, Debug)]
pub struct ServiceState(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    config: ServiceConfig,
    csp: HeaderValue,
    handle: RendererHandle,
    scenes: Arc<SceneLibrary>,
    sessions: Sessions,
    resume: ResumeTokens,
    jobs: Jobs,
    idempotency: Idempotency,
    encoders: BlockingPool,
    uploads: tokio::sync::Semaphore,
    draining: CancellationToken,
    ended: CancellationToken,
    tasks: TaskTracker,
    local_addr: OnceLock<SocketAddr>,
    started: Instant,
    metrics: PrometheusHandle,
}

impl ServiceState {
    /// The state of one service. `scenes` are built in (the page opens the first); uploads of earlier runs are found in
    /// the data folder. Fails when that folder cannot be used.
    pub fn new(handle: RendererHandle, scenes: Vec<Arc<Scene>>, config: ServiceConfig) -> Result<Self, ServiceError> {
        let csp = config.content_security_policy();
        let csp = HeaderValue::from_str(&csp).map_err(|_| ServiceError::FrameAncestors(csp))?;
        let scenes = SceneLibrary::open(&config.data_dir, scenes, config.bounds)
            .map_err(|source| ServiceError::DataDir { path: config.data_dir.display().to_string(), source })?;
        let scenes = Arc::new(scenes);
        let (draining, ended, tasks) = (CancellationToken::new(), CancellationToken::new(), TaskTracker::new());
        let encoders = BlockingPool::new("encoding", config.bounds.encoders);
        let render_bounds = RenderBounds {
            active: config.bounds.active_renders,
            finished: config.bounds.finished_renders,
            finished_bytes: config.bounds.render_cache_bytes,
        };
        Ok(Self(Arc::new(Inner {
            csp,
            sessions: Sessions::new(handle.clone(), Arc::clone(&scenes), &config, ended.clone()),
            jobs: Jobs::new(handle.clone(), encoders.clone(), tasks.clone(), ended.clone(), render_bounds),
            handle,
            scenes,
            resume: ResumeTokens::new(config.bounds.resume_tokens, config.timeouts.resume, config.timeouts.reconnect),
            idempotency: Idempotency::new(config.bounds.idempotency_keys, config.timeouts.idempotency),
            encoders,
            uploads: tokio::sync::Semaphore::new(config.bounds.uploads),
            draining,
            ended,
            tasks,
            local_addr: OnceLock::new(),
            started: Instant::now(),
            metrics: observe::recorder(),
            config,
        })))
    }

    pub(crate) fn config(&self) -> &ServiceConfig {
        &self.0.config
    }

    pub(crate) fn csp(&self) -> &HeaderValue {
        &self.0.csp
    }

    pub(crate) fn handle(&self) -> &RendererHandle {
        &self.0.handle
    }

    pub(crate) fn renderer_status(&self) -> RendererStatus {
        self.0.handle.status().borrow().clone()
    }

    pub(crate) fn scenes(&self) -> &SceneLibrary {
        &self.0.scenes
    }

    pub(crate) fn sessions(&self) -> &Sessions {
        &self.0.sessions
    }

    pub(crate) fn resume(&self) -> &ResumeTokens {
        &self.0.resume
    }

    pub(crate) fn jobs(&self) -> &Jobs {
        &self.0.jobs
    }

    pub(crate) fn idempotency(&self) -> &Idempotency {
        &self.0.idempotency
    }

    pub(crate) fn encoders(&self) -> &BlockingPool {
        &self.0.encoders
    }

    pub(crate) fn uploads(&self) -> &tokio::sync::Semaphore {
        &self.0.uploads
    }

    /// Cancelled when shutdown begins.
    pub(crate) fn draining(&self) -> &CancellationToken {
        &self.0.draining
    }

    /// Connections and jobs in progress; shutdown waits for them.
    pub(crate) fn tasks(&self) -> &TaskTracker {
        &self.0.tasks
    }

    pub(crate) fn metrics(&self) -> &PrometheusHandle {
        &self.0.metrics
    }

    pub(crate) fn begin_drain(&self) {
        self.0.draining.cancel();
    }

    pub(crate) fn end(&self) {
        self.0.ended.cancel();
    }

    /// The address listened on; loopback while not listening.
    pub(crate) fn local_addr(&self) -> SocketAddr {
        self.0.local_addr.get().copied().unwrap_or_else(|| (Ipv4Addr::LOCALHOST, 0).into())
    }

    pub(crate) fn set_local_addr(&self, addr: SocketAddr) {
        let _ = self.0.local_addr.set(addr);
    }

    /// Monotonic milliseconds since the service started: the server's clock in messages.
    pub(crate) fn server_ms(&self) -> f64 {
        self.0.started.elapsed().as_secs_f64() * 1e3
    }

    /// The same in microseconds, low 32 bits, for frame headers.
    pub(crate) fn server_us(&self) -> u32 {
        self.0.started.elapsed().as_micros() as u32
    }

    /// Why new work is not accepted, if it is not.
    pub(crate) fn unready_reason(&self) -> Option<&'static str> {
        if self.draining().is_cancelled() {
            return Some("draining");
        }
        match self.0.handle.status().borrow().state {
            DeviceState::Starting => Some("starting"),
            DeviceState::Lost => Some("device_lost"),
            DeviceState::Failed => Some("device_failed"),
            DeviceState::Ready if self.jobs().active_count() >= self.config().bounds.active_renders => {
                Some("queue_full")
            }
            DeviceState::Ready => None,
        }
    }
}
