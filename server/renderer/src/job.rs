//! Batch renders: one picture at a stated error, sample count or deadline.

use std::sync::Arc;
use std::time::Duration;

use surfelcast_scene::{Camera, LightState, Scene};
use surfelcast_techniques::AuditResult;

/// When to stop; whichever holds first. At least one must be set.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StopRules {
    /// Samples a pixel.
    pub samples: Option<u32>,
    /// Tone-mapped RMSE by the error audit.
    pub max_error: Option<f32>,
    /// Wall time of rendering.
    pub time_limit: Option<Duration>,
}

pub use surfelcast_techniques::registry::DEFAULT_OF_JOBS as DEFAULT_TECHNIQUE;
pub use surfelcast_techniques::{KNOBS, Knob, MaterialMode, Reconstruction, SurfelSettings};

/// Extra output instead of radiance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Aov {
    /// Base colour of the first surface.
    Albedo,
    /// World-space shading normal.
    Normal,
    /// Distance along the optical axis, metres; 0 where nothing is hit.
    Depth,
    /// World-space position.
    Position,
    /// Node index + 1; 0 where nothing is hit.
    InstanceId,
    /// Emission and direct light.
    Direct,
    /// Light that bounced at least once.
    Indirect,
    /// Indirect irradiance over pi, albedo left out: B.
    Irradiance,
    /// Samples a pixel.
    SampleCount,
    /// Variance of the pixel's mean radiance (luminance).
    Variance,
    /// Light that arrives over mirrors, gloss and glass: everything but the diffuse lobe.
    Reflection,
    /// What the surfel cache knows of the point at a pixel's centre.
    Surfel(SurfelOutput),
}

pub use surfelcast_techniques::{ExportedSurfel, SurfelOutput};

impl Aov {
    /// All, with the names used on the command line and over HTTP.
    pub const ALL: [(&'static str, Self); 24] = [
        ("albedo", Self::Albedo),
        ("normal", Self::Normal),
        ("depth", Self::Depth),
        ("position", Self::Position),
        ("instance_id", Self::InstanceId),
        ("direct", Self::Direct),
        ("indirect", Self::Indirect),
        ("irradiance", Self::Irradiance),
        ("sample_count", Self::SampleCount),
        ("variance", Self::Variance),
        ("reflection", Self::Reflection),
        ("surfel_id", Self::Surfel(SurfelOutput::Id)),
        ("surfel_radius", Self::Surfel(SurfelOutput::Radius)),
        ("surfel_coverage", Self::Surfel(SurfelOutput::Coverage)),
        ("surfel_weight", Self::Surfel(SurfelOutput::Weight)),
        ("surfel_b", Self::Surfel(SurfelOutput::Irradiance)),
        ("surfel_error", Self::Surfel(SurfelOutput::Error)),
        ("surfel_rays", Self::Surfel(SurfelOutput::Rays)),
        ("surfel_age", Self::Surfel(SurfelOutput::Age)),
        ("surfel_guide", Self::Surfel(SurfelOutput::Guide)),
        ("surfel_depth", Self::Surfel(SurfelOutput::Depth)),
        ("surfel_cells", Self::Surfel(SurfelOutput::Cells)),
        ("surfel_leaks", Self::Surfel(SurfelOutput::Leaks)),
        ("surfel_level", Self::Surfel(SurfelOutput::Level)),
    ];

    /// Whether a view can show it, not only a batch render: it is made from the camera and the session's cache alone.
    pub fn is_live(self) -> bool {
        matches!(self, Self::Albedo | Self::Normal | Self::Depth | Self::Position | Self::InstanceId | Self::Surfel(_))
    }

    /// Its name on the command line and over HTTP.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, aov)| *aov == self).map_or("", |(name, _)| name)
    }

    /// The one of that name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(n, _)| *n == name).map(|(_, aov)| *aov)
    }
}

/// One picture to render.
#[derive(Clone, Debug)]
pub struct RenderJob {
    /// Scene.
    pub scene: Arc<Scene>,
    /// Lights; `None` = the scene's own.
    pub lights: Option<LightState>,
    /// Camera, world space.
    pub camera: Camera,
    /// Pixels.
    pub size: [u32; 2],
    /// Technique id.
    pub technique: String,
    /// Materials.
    pub materials: MaterialMode,
    /// Settings of the surfel cache.
    pub surfel: SurfelSettings,
    /// Seed: the same job on the same device gives the same picture, unless a time limit ended it.
    pub seed: u64,
    /// When to stop.
    pub stop: StopRules,
    /// Exposure used by the error metric (pixels stay unexposed).
    pub exposure: f32,
    /// Output; `None` = radiance.
    pub aov: Option<Aov>,
    /// Whether the cache's surfels come with the picture.
    pub exports_surfels: bool,
}

/// Progress of a job, for a `watch` channel.
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

/// Audited error of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
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
    /// Mean squared error after the tone map: unbiased, and so below 0 by chance where the error is smaller than the audit can
    /// see. What averages over pictures must take.
    pub mse_tonemapped: f32,
}

impl From<&AuditResult> for ErrorEstimate {
    fn from(audit: &AuditResult) -> Self {
        let [low, high] = audit.rmse_interval;
        Self {
            rmse_tonemapped: audit.rmse_tonemapped as f32,
            rel_mse: audit.rel_mse as f32,
            std_error: audit.std_error as f32,
            rmse_low: low as f32,
            rmse_high: high as f32,
            mse_tonemapped: audit.mse as f32,
        }
    }
}

/// Rays traced.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct RayCounts {
    /// From the camera.
    pub primary: u64,
    /// Continuations.
    pub secondary: u64,
    /// Visibility of lights.
    pub shadow: u64,
}

/// Time of one pass, summed over the job or frame.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct PassTime {
    /// Pass = kernel = file name.
    pub name: String,
    /// Milliseconds on the device (wall time around the submit on CPU devices).
    pub gpu_ms: f64,
    /// Dispatches.
    pub dispatches: u32,
}

/// A pass that was not needed.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
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
    /// Surfels in use and surfels that fit; `None` where the technique has none.
    pub surfels: Option<[u32; 2]>,
    /// Passes that ran.
    pub passes: Vec<PassTime>,
    /// Passes that did not.
    pub skipped: Vec<SkippedPass>,
    /// Non-finite values met in the accumulation; 0 unless there is a bug.
    pub non_finite: u64,
    /// Bytes held on the device by kind: `scene`, `view`, `staging`.
    pub memory_bytes: Vec<(String, u64)>,
    /// The cache's surfels, scene space, where asked for.
    pub exported_surfels: Vec<ExportedSurfel>,
    /// Why it stopped: `samples`, `max_error`, `time_limit`, `canceled`, or `stalled` where a biased technique's error no
    /// longer falls.
    pub stopped_by: &'static str,
}
