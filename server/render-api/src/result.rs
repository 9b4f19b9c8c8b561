//! What a render gives back.

use serde::Serialize;

/// Progress of a job.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JobProgress {
    /// Whether rendering has begun.
    pub is_running: bool,
    /// Samples a pixel so far.
    pub samples: u32,
    /// Share done by the nearest stop rule, in [0, 1].
    pub fraction: f32,
    /// Latest audit.
    pub error: Option<ErrorEstimate>,
}

/// Audited error of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ErrorEstimate {
    /// RMSE after the tone map `k = 1 / (1 + max(r, g, b))`.
    pub rmse_tonemapped: f32,
    /// Mean squared error relative to `r^2 + 0.01 mean(r)^2`.
    pub rel_mse: f32,
    /// Standard error of `rmse_tonemapped`.
    pub std_error: f32,
    /// Lower end of the interval that holds the true RMSE in nine cases of ten.
    pub rmse_low: f32,
    /// Its upper end.
    pub rmse_high: f32,
    /// Mean squared error after the tone map: unbiased, and so below 0 by chance where the error is smaller than the
    /// audit can see. Averages over images must take this one.
    pub mse_tonemapped: f32,
}

/// Rays traced.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct RayCounts {
    /// From the camera.
    pub primary: u64,
    /// Continuations.
    pub secondary: u64,
    /// Visibility of lights.
    pub shadow: u64,
}

/// Time of one pass, summed over the job or frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PassTime {
    /// Pass = kernel = file name.
    pub name: String,
    /// Milliseconds on the device (wall time around the submit on CPU devices).
    pub gpu_ms: f64,
    /// Dispatches.
    pub dispatches: u32,
}

/// A pass that was not needed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SkippedPass {
    /// Pass.
    pub name: String,
    /// Why not.
    pub reason: String,
}

/// A finished job.
#[derive(Clone, Debug)]
pub struct RenderOutput {
    /// Linear, unexposed RGB (scalars repeated three times), first row on top.
    pub pixels: Vec<[f32; 3]>,
    /// Size.
    pub size: [u32; 2],
    /// Samples a pixel.
    pub samples: u32,
    /// Error audit; `None` for outputs other than radiance.
    pub error: Option<ErrorEstimate>,
    /// Rays.
    pub rays: RayCounts,
    /// Seconds of rendering, upload and pipelines left out.
    pub render_secs: f64,
    /// Seconds of upload and pipeline creation.
    pub setup_secs: f64,
    /// Entries of the technique's cache in use, and entries that fit; `None` for techniques without one.
    pub occupancy: Option<[u32; 2]>,
    /// Passes that ran.
    pub passes: Vec<PassTime>,
    /// Passes that did not.
    pub skipped: Vec<SkippedPass>,
    /// Non-finite values met in the accumulation; 0 unless there is a bug.
    pub non_finite: u64,
    /// Bytes held on the device by kind: `scene`, `session`, `view`, `staging`.
    pub memory_bytes: Vec<(String, u64)>,
    /// What the technique exports, where it was requested: a file's bytes.
    pub export: Option<Vec<u8>>,
    /// Why it stopped: `samples`, `max_error`, `time_limit`, `canceled`, or `stalled` where a biased technique's error
    /// no longer falls.
    pub stopped_by: &'static str,
}
