//! What every command line of surfelcast shares: arguments, the device, scene files, failures and their exit codes.
//!
//! The binary `surfelcast` (serve, render, doctor) and the laboratory `surfelcast-bench` are built on it.

pub mod args;
pub mod cli;
pub mod device;
pub mod failure;
pub mod process;
pub mod scene_file;
pub mod settings;

pub use failure::Failure;
