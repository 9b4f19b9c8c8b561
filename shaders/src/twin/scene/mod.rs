//! Twins of `lib/scene`. The tracer's twin is `trace` of the scene crate.

pub mod environment;
pub mod lights;
