//! How the actor is started.

use std::path::PathBuf;

use surfelcast_techniques::{TECHNIQUES, TechniqueEntry};

/// Configuration of the render actor.
#[derive(Clone, Debug)]
pub struct RendererConfig {
    /// Adapter by index or part of its name; the best one otherwise.
    pub adapter: Option<String>,
    /// Folder of compiled pipelines.
    pub cache_dir: Option<PathBuf>,
    /// Folder of what techniques keep for sessions over restarts.
    pub snapshot_dir: Option<PathBuf>,
    /// Budget of device memory.
    pub memory_budget_bytes: Option<u64>,
    /// Jobs that may wait.
    pub max_queued_jobs: usize,
    /// Jobs that run side by side.
    pub max_running_jobs: usize,
    /// Whether to compile the variants for any scene at start: a server shows its first frame sooner, a single render
    /// would only lose time.
    pub prepares_general_kernels: bool,
    /// Techniques on offer, the default of views first.
    pub techniques: &'static [TechniqueEntry],
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
            techniques: TECHNIQUES,
            allow_forced_loss: false,
        }
    }
}
