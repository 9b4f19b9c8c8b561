//! Metrics: their names, buckets and the recorder behind `/metrics`.

use std::sync::OnceLock;

use metrics_exporter_prometheus::{Matcher, PrometheusBuilder, PrometheusHandle};

/// Seconds; from a fast encode to a slow render.
const SECONDS: [f64; 15] = [0.001, 0.002, 0.005, 0.01, 0.02, 0.035, 0.05, 0.075, 0.1, 0.2, 0.5, 1.0, 5.0, 30.0, 300.0];

/// The recorder of this process; made at the first call.
pub(crate) fn recorder() -> PrometheusHandle {
    static RECORDER: OnceLock<PrometheusHandle> = OnceLock::new();
    RECORDER
        .get_or_init(|| {
            let builder = PrometheusBuilder::new();
            let builder = match builder.set_buckets_for_metric(Matcher::Suffix("_seconds".into()), &SECONDS) {
                Ok(builder) => builder,
                // Only an empty list of buckets is refused.
                Err(_) => PrometheusBuilder::new(),
            };
            let recorder = builder.build_recorder();
            let handle = recorder.handle();
            if metrics::set_global_recorder(recorder).is_err() {
                tracing::warn!("another metrics recorder is installed; /metrics stays empty");
            }
            describe();
            handle
        })
        .clone()
}

fn describe() {
    use metrics::{Unit, describe_counter, describe_gauge, describe_histogram};
    let seconds = [
        (
            "surfelcast_input_to_send_seconds",
            "From a camera or light input to the send of the first frame that contains it.",
        ),
        (
            "surfelcast_input_to_ack_seconds",
            "From an input to the acknowledgement of the first frame that contains it.",
        ),
        ("surfelcast_frame_render_seconds", "Rendering of a frame."),
        ("surfelcast_frame_queue_seconds", "Wait of a finished frame for its encoder."),
        ("surfelcast_encode_seconds", "Encoding of a frame or a render."),
        ("surfelcast_job_render_seconds", "Rendering of a job."),
        ("surfelcast_job_queue_seconds", "Wait of a job for the renderer."),
        ("surfelcast_round_trip_seconds", "Round trip of a frame and its acknowledgement."),
    ];
    for (name, text) in seconds {
        describe_histogram!(name, Unit::Seconds, text);
    }
    let counters = [
        ("surfelcast_frames_total", "Frames sent, by stage."),
        ("surfelcast_frame_bytes_total", "Bytes of frames sent."),
        ("surfelcast_frames_dropped_total", "Frames rendered but not sent, by reason."),
        ("surfelcast_acks_late_total", "Acknowledgements that came after the view had stopped because none came."),
        ("surfelcast_acks_ignored_total", "Acknowledgements of frames not in flight."),
        ("surfelcast_inputs_total", "Inputs accepted."),
        ("surfelcast_closes_total", "WebSocket connections closed by the server, by code."),
        ("surfelcast_jobs_total", "Renders finished, by status."),
        ("surfelcast_resumes_total", "Connections that resumed an earlier view."),
        ("surfelcast_connections_refused_total", "TCP connections over the limit."),
    ];
    for (name, text) in counters {
        describe_counter!(name, text);
    }
    describe_gauge!("surfelcast_sessions", "Open sessions.");
    describe_gauge!("surfelcast_views", "Connected views.");
}
