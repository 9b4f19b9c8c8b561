//! Promises of the surfel cache, on scenes with a known solution.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]
#![allow(clippy::print_stdout, reason = "a test says what it measured")]

mod binning;
mod change;
mod energy;
mod filter;
mod grid;
mod image;
mod initial;
mod leaks;
mod persistence;
mod pin;
mod reconstruction;
mod repeat;
mod reuse;
mod rig;
mod scenes;
mod settling;
mod splat;
