//! HTTP: the accept loop and the routes, what every request passes (guard, CORS, bodies, problems), and one file for
//! each resource.

mod assets;
mod body;
pub(crate) mod connection_info;
mod cors;
pub(crate) mod guard;
mod health;
pub(crate) mod idempotency;
pub(crate) mod listen;
mod multipart;
pub(crate) mod negotiate;
mod openapi;
pub(crate) mod problem;
pub(crate) mod render_request;
pub(crate) mod renders;
pub(crate) mod router;
pub(crate) mod scenes;
mod schema;
