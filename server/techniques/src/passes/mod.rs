//! Passes that every technique may use.

pub mod audit;
pub mod counters;
pub mod features;
pub mod first_surface;
pub mod frame;
pub mod lights;
pub mod tone_map;
pub mod upload;
