//! The JSON of `--stats`.

use serde::Serialize;
use serde_json::{Map, Value, json};
use surfelcast_renderer::{DeviceInfo, ErrorEstimate, PassTime, RayCounts, RenderOutput, RenderSpec, SkippedPass};
use surfelcast_scene::{Scene, SceneSummary};

/// Everything known about a finished render.
#[derive(Debug, Serialize)]
pub(crate) struct Stats<'a> {
    device: &'a DeviceInfo,
    scene: SceneStats<'a>,
    technique: &'a str,
    seed: u64,
    size: [u32; 2],
    samples_per_pixel: u32,
    stopped_by: &'a str,
    rays: RayCounts,
    time_secs: TimeStats,
    error_estimate: Option<ErrorEstimate>,
    passes: &'a [PassTime],
    skipped: &'a [SkippedPass],
    non_finite: u64,
    /// Occupancy of the technique's cache, under the name of its entries.
    surfels: Value,
    memory_bytes: Map<String, Value>,
}

#[derive(Debug, Serialize)]
struct SceneStats<'a> {
    id: String,
    name: &'a str,
    summary: SceneSummary,
    warnings: &'a [String],
}

/// Seconds by stage.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct TimeStats {
    /// Reading and validating the file.
    pub(crate) load: f64,
    /// Building hierarchies.
    pub(crate) build: f64,
    /// Upload and pipelines.
    pub(crate) setup: f64,
    /// Rendering.
    pub(crate) render: f64,
    /// Encoding and writing.
    pub(crate) encode: f64,
}

impl<'a> Stats<'a> {
    pub(crate) fn new(
        device: &'a DeviceInfo,
        scene: &'a Scene,
        spec: &'a RenderSpec,
        output: &'a RenderOutput,
        time_secs: TimeStats,
    ) -> Self {
        Self {
            device,
            scene: SceneStats {
                id: scene.key().to_string(),
                name: &scene.name,
                summary: scene.summary,
                warnings: &scene.warnings,
            },
            technique: &spec.technique,
            seed: spec.seed,
            size: output.size,
            samples_per_pixel: output.samples,
            stopped_by: output.stopped_by,
            rays: output.rays,
            time_secs,
            error_estimate: output.error,
            passes: &output.passes,
            skipped: &output.skipped,
            non_finite: output.non_finite,
            surfels: match output.occupancy {
                Some([live, capacity]) => json!({ "live": live, "capacity": capacity }),
                None => json!({ "live": 0, "capacity": 0 }),
            },
            memory_bytes: output.memory_bytes.iter().map(|(kind, bytes)| (kind.clone(), json!(bytes))).collect(),
        }
    }
}
