//! The error audit against measured errors, over many images.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]
#![allow(clippy::print_stdout, reason = "a test says what it measured")]

mod promises;
#[path = "../gpu_gradient/rig.rs"]
#[allow(dead_code, reason = "the rig of another suite, of which only some serves here")]
mod rig;
#[path = "../gpu_gradient/scenes.rs"]
#[allow(dead_code, reason = "the scenes of another suite, of which only some serve here")]
mod scenes;
