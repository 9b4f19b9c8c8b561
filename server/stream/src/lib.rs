//! Pixels to bytes: encoders, display transform, quality and rate control.
//!
//! No GPU type, no async runtime, no clock: everything that depends on time takes a [`std::time::Duration`] since the
//! connection began, so that the state machines are plain values that tests drive step by step.
//!
//! - [`encode`](fn@encode) and [`encode_exr`]: one image in, one file out;
//! - [`tone_map_to_rgba8`]: linear radiance to display pixels;
//! - [`AckWindow`]: how many frames and bytes may be in flight;
//! - [`QualityLoop`]: quality, resolution and rate of frames while the camera moves;
//! - [`StillSchedule`]: which images of a refining view are sent;
//! - [`choose_encoding`]: codec and quality for a stage of refinement.

mod choice;
mod encode;
mod error;
mod exr;
mod quality;
mod still;
mod tone_map;
mod window;

pub use choice::{Stage, choose_encoding};
pub use encode::{Codec, Quality, encode};
pub use error::StreamError;
pub use exr::encode_exr;
pub use quality::{QualityLimits, QualityLoop};
pub use still::StillSchedule;
pub use tone_map::tone_map_to_rgba8;
pub use window::{AckError, AckWindow, Acked};
