//! Twins of `lib/core`.

pub mod math;
pub mod rng;
pub mod sampling;
