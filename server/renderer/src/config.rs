//! How the actor is started.

use std::path::PathBuf;

/// Configuration of the render actor.
#[derive(Clone, Debug)]
pub struct RendererConfig {
    /// Adapter by index or part of its name; the best one otherwise.
    pub adapter: Option<String>,
    /// Where compiled pipelines are kept.
    pub cache_dir: Option<PathBuf>,
    /// Where surfel caches of sessions are kept over restarts.
    pub snapshot_dir: Option<PathBuf>,
    /// Device bytes that may be used.
    pub memory_budget_bytes: Option<u64>,
    /// Jobs that may wait.
    pub max_queued_jobs: usize,
    /// Jobs that run side by side.
    pub max_running_jobs: usize,
    /// Compile at once the variants that serve any scene: a server shows its first picture sooner, a single render would
    /// only lose time.
    pub prepares_general_kernels: bool,
    /// Tests may lose the device on purpose.
    pub allow_forced_loss: bool,
}

impl Default for RendererConfig {
    fn default() -> Self {
        Self {
            adapter: None,
            cache_dir: None,
            snapshot_dir: None,
            memory_budget_bytes: None,
            max_queued_jobs: 64,
            max_running_jobs: 2,
            prepares_general_kernels: false,
            allow_forced_loss: false,
        }
    }
}
