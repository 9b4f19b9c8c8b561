//! The service: HTTP and WebSocket in front of the renderer.
//!
//! It sees the renderer through its handle only, and nothing of a GPU. A program wires it so:
//!
//! ```no_run
//! # async fn wire(handle: surfelcast_renderer::RendererHandle) -> Result<(), Box<dyn std::error::Error>> {
//! use surfelcast_service::{ServiceConfig, ServiceState, run};
//! use tokio_util::sync::CancellationToken;
//!
//! let mut config = ServiceConfig::new("data", concat!("surfelcast/", env!("CARGO_PKG_VERSION")));
//! config.hosts.push("render.example.org".into()); // names beside localhost and addresses
//! let scenes = Vec::new(); // `Arc<Scene>`s; the first is the one the page opens
//! let state = ServiceState::new(handle, scenes, config)?;
//! let listener = tokio::net::TcpListener::bind("127.0.0.1:8080").await?;
//! let shutdown = CancellationToken::new(); // cancel it on SIGINT and SIGTERM
//! run(listener, state, shutdown).await?; // returns when drained; stop the renderer after it
//! # Ok(())
//! # }
//! ```
//!
//! Rooms: `guard` and `cors` (Host, Origin, headers), `listen` (sockets, timeouts), `router` (all routes), `scenes` and
//! `scene_store`, `renders`, `render_request`, `surfel_request` and `jobs`, `socket` to `outbox` and `points` (one
//! WebSocket), `sessions` and `lights` (what the views of a scene share), `outputs` (what a view can show).

mod assets;
mod blocking;
mod body;
pub mod config;
mod connection;
mod cors;
mod guard;
mod health;
mod idempotency;
mod inbound;
mod jobs;
mod lights;
mod listen;
mod multipart;
mod negotiate;
mod observe;
mod openapi;
mod outbound;
mod outbox;
mod outputs;
mod points;
mod problem;
mod rate;
mod render_request;
mod renders;
mod resume;
mod router;
mod scene_store;
mod scenes;
mod sessions;
mod socket;
mod state;
mod surfel_request;
mod text;
mod validate;
mod welcome;
mod wishes;

pub use config::{Bounds, ServiceConfig, Timeouts};
pub use listen::run;
pub use router::router;
pub use state::{ServiceError, ServiceState};
