//! Gradient-domain path tracing: unbiased before and after reconstruction.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]
#![allow(clippy::print_stdout, reason = "a test says what it measured")]

mod differences;
mod images;
mod rig;
#[path = "../gpu_surfel/scenes.rs"]
#[allow(dead_code, reason = "the rooms of another suite, of which only some serve here")]
mod rooms;
mod scenes;
