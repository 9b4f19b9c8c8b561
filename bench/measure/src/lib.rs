//! How far images are from the truth.
//!
//! [`Image`] has the error metrics, [`flip`] the perceptual one, [`split_error`] takes an error apart into bias and
//! noise, [`Reference`] finds reference images with their noise, [`fit`] draws lines through logarithms and
//! [`Renderer`] runs the finished program. It knows no GPU and no scene: it judges pixels.

pub mod error;
pub mod fit;
mod flip;
mod image;
mod program;
mod reference;
mod split;

pub use error::MeasureError;
pub use flip::flip;
pub use image::{Image, Rectangle};
pub use program::{Measurement, Point, Renderer, error_to_truth};
pub use reference::{Expected, Mode, Reference, shared_folder};
pub use split::{ErrorSplit, Uncertain, split_error};
