//! How far pictures are from the truth, and how that is written down.
//!
//! [`Picture`] has the error metrics, [`flip`] the perceptual one, [`split_error`] takes an error apart into bias and
//! noise, [`Reference`] finds reference images with their noise, [`fit`] draws lines through logarithms, [`chart`] writes
//! plots and [`replace_between_markers`] puts tables into a document. It knows no GPU and no scene: it judges pixels.

pub mod chart;
pub mod error;
pub mod fit;
mod flip;
mod markers;
mod picture;
mod reference;
mod split;

pub use error::MeasureError;
pub use flip::flip;
pub use markers::replace_between_markers;
pub use picture::{Picture, Rectangle};
pub use reference::{Expected, Mode, Reference, shared_folder};
pub use split::{ErrorSplit, Uncertain, split_error};
