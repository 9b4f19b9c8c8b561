//! The settings of an operator.

use std::path::PathBuf;
use std::time::Duration;

use surfelcast_protocol::limits::Limits;

/// Settings of the service. [`ServiceConfig::new`] gives defaults that are safe on a shared network.
#[derive(Clone, Debug)]
pub struct ServiceConfig {
    /// Folder for uploaded scenes; created when missing.
    pub data_dir: PathBuf,
    /// Program and version, for `welcome`, `/version` and the cache keys of renders.
    pub server: String,
    /// Host names (without port) accepted in `Host`, in addition to loopback names and, on other binds, IP addresses.
    /// `*` accepts any; use it only behind a proxy that checks.
    pub hosts: Vec<String>,
    /// Origins (`https://example.org`) accepted in addition to the server's own.
    pub origins: Vec<String>,
    /// Accept WebSocket upgrades without `Origin` (programs, not browsers) on binds that are not loopback.
    pub allow_missing_origin: bool,
    /// Sources for the CSP `frame-ancestors` directive, e.g. `https://wiki.example.org`; `'self'` always is.
    pub frame_ancestors: Vec<String>,
    /// Limits of a WebSocket connection.
    pub limits: Limits,
    /// Limits of everything else.
    pub bounds: Bounds,
    /// Timeouts.
    pub timeouts: Timeouts,
}

impl ServiceConfig {
    /// Defaults, with a data folder and the program's name and version.
    pub fn new(data_dir: impl Into<PathBuf>, server: impl Into<String>) -> Self {
        Self {
            data_dir: data_dir.into(),
            server: server.into(),
            hosts: Vec::new(),
            origins: Vec::new(),
            allow_missing_origin: false,
            frame_ancestors: Vec::new(),
            limits: Limits::default(),
            bounds: Bounds::default(),
            timeouts: Timeouts::default(),
        }
    }

    /// The content security policy of every answer.
    pub(crate) fn content_security_policy(&self) -> String {
        let ancestors = self.frame_ancestors.join(" ");
        format!(
            "default-src 'self'; img-src 'self' blob: data:; connect-src 'self' ws: wss:; style-src 'self'; \
             script-src 'self'; object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'self' \
             {ancestors}"
        )
        .trim_end()
        .to_owned()
    }
}

/// Bounds on what all clients together may request and keep.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// Open TCP connections.
    pub connections: usize,
    /// Open TCP connections from one address.
    pub connections_per_ip: usize,
    /// Bytes of a request's header section.
    pub header_bytes: usize,
    /// Header fields of a request.
    pub header_count: usize,
    /// Bytes of a JSON request body.
    pub json_bytes: usize,
    /// Bytes of an uploaded scene.
    pub upload_bytes: u64,
    /// Uploads at a time.
    pub uploads: usize,
    /// Stored scenes.
    pub stored_scenes: usize,
    /// Bytes of stored scenes.
    pub stored_bytes: u64,
    /// Stored scenes kept in memory after use.
    pub loaded_scenes: usize,
    /// Scenes being loaded at a time; loading is heavy on CPU and memory.
    pub scene_loads: usize,
    /// Requests that may wait for a scene load.
    pub waiting_scene_loads: usize,
    /// Renders waiting or running.
    pub active_renders: usize,
    /// Finished renders kept.
    pub finished_renders: usize,
    /// Bytes of finished renders kept.
    pub render_cache_bytes: u64,
    /// Width or height of a render.
    pub render_side: u32,
    /// Pixels of a render.
    pub render_pixels: u64,
    /// Samples a pixel of a render.
    pub render_samples: u32,
    /// Time limit of a render, seconds.
    pub render_secs: f64,
    /// `Idempotency-Key`s kept.
    pub idempotency_keys: usize,
    /// Control messages waiting for a client.
    pub outbox_messages: usize,
    /// Bytes of control messages waiting for a client.
    pub outbox_bytes: usize,
    /// Frames and renders encoded at a time.
    pub encoders: usize,
    /// Resume tokens kept.
    pub resume_tokens: usize,
}

impl Default for Bounds {
    fn default() -> Self {
        Self {
            connections: 1024,
            connections_per_ip: 256,
            header_bytes: 32 << 10,
            header_count: 64,
            json_bytes: 64 << 10,
            upload_bytes: 1 << 30,
            uploads: 4,
            stored_scenes: 256,
            stored_bytes: 16 << 30,
            loaded_scenes: 4,
            scene_loads: 1,
            waiting_scene_loads: 16,
            active_renders: 64,
            finished_renders: 1024,
            render_cache_bytes: 512 << 20,
            render_side: 16_384,
            render_pixels: 64_000_000,
            render_samples: 1 << 20,
            render_secs: 3600.0,
            idempotency_keys: 4096,
            outbox_messages: 256,
            outbox_bytes: 1 << 20,
            encoders: std::thread::available_parallelism().map_or(2, usize::from),
            resume_tokens: 4096,
        }
    }
}

/// How long the service waits.
#[derive(Clone, Copy, Debug)]
pub struct Timeouts {
    /// For a request's headers, and between two requests of a connection.
    pub header: Duration,
    /// For the next bytes of a body.
    pub body_stall: Duration,
    /// Grace before [`Timeouts::body_bytes_per_sec`] counts.
    pub body_grace: Duration,
    /// Least mean rate of a body.
    pub body_bytes_per_sec: u64,
    /// A response that makes no progress for this long ends its connection.
    pub write_stall: Duration,
    /// A WebSocket message that makes no progress for this long ends its connection.
    pub send_stall: Duration,
    /// Without acknowledgement, the view stops.
    pub ack_stop: Duration,
    /// Without acknowledgement, the connection ends.
    pub ack_close: Duration,
    /// Between two pings; two without any message from the client end the connection.
    pub ping: Duration,
    /// A session stays open for this time after its last view has closed, so that a page reload finds it open.
    pub session_grace: Duration,
    /// Lifetime of a resume token, and of the edits of a closed session.
    pub resume: Duration,
    /// Two connections of one client, the second resuming the first, begin at least this long apart.
    pub reconnect: Duration,
    /// Longest `Prefer: wait`.
    pub prefer_wait: Duration,
    /// Work in flight may take this long after shutdown began.
    pub drain: Duration,
    /// `Idempotency-Key`s are kept this long.
    pub idempotency: Duration,
}

impl Default for Timeouts {
    fn default() -> Self {
        Self {
            header: Duration::from_secs(10),
            body_stall: Duration::from_secs(10),
            body_grace: Duration::from_secs(10),
            body_bytes_per_sec: 4 << 10,
            write_stall: Duration::from_secs(30),
            send_stall: Duration::from_secs(1),
            ack_stop: Duration::from_secs(4),
            ack_close: Duration::from_secs(15),
            ping: Duration::from_secs(15),
            session_grace: Duration::from_secs(3),
            resume: Duration::from_mins(2),
            reconnect: Duration::from_millis(500),
            prefer_wait: Duration::from_mins(1),
            drain: Duration::from_secs(10),
            idempotency: Duration::from_hours(24),
        }
    }
}
