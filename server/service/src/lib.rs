//! The service: HTTP and WebSocket in front of the renderer.
//!
//! It sees the renderer through its handle only, and nothing of a GPU. A program wires it as follows:
//!
//! ```no_run
//! # async fn wire(handle: surfelcast_renderer::RendererHandle) -> Result<(), Box<dyn std::error::Error>> {
//! use surfelcast_service::{ServiceConfig, ServiceState, run};
//! use tokio_util::sync::CancellationToken;
//!
//! let mut config = ServiceConfig::new("data", concat!("surfelcast/", env!("CARGO_PKG_VERSION")));
//! config.hosts.push("render.example.org".into()); // in addition to localhost and addresses
//! let scenes = Vec::new(); // `Arc<Scene>`s; the first is the one the page opens
//! let state = ServiceState::new(handle, scenes, config)?;
//! let listener = tokio::net::TcpListener::bind("127.0.0.1:8080").await?;
//! let shutdown = CancellationToken::new(); // cancel it on SIGINT and SIGTERM
//! run(listener, state, shutdown).await?; // returns when drained; stop the renderer after it
//! # Ok(())
//! # }
//! ```
//!
//! Modules: `http` (accept loop, routes, one file for each resource), `live` (one WebSocket), and what both use:
//! `sessions`, `outgoing`, `scene_library`, `jobs`. Those know no HTTP; they refuse with a `DomainError`, which `http`
//! maps to problem documents and `live` to close codes.

mod blocking;
mod camera;
pub mod config;
mod error;
mod http;
mod image_format;
mod jobs;
mod live;
mod observe;
mod outgoing;
mod random_id;
mod scene_library;
mod scene_lights;
mod sessions;
mod state;
#[cfg(test)]
mod test_catalogue;

pub use config::{Bounds, ServiceConfig, Timeouts};
pub use http::listen::run;
pub use http::router::router;
pub use state::{ServiceError, ServiceState};
