//! How far rendered pictures are from reference images, and how far they may be.
//!
//! A reference has noise of its own, and so has a picture; a correct renderer differs from the reference by both, added
//! in squares. The first is stated beside the reference, the second is measured from two pictures of different seeds. So
//! the gate needs no tuned threshold: measured^2 / (reference noise^2 + own noise^2) is 1 for a correct renderer.

mod measure;
mod table;

use std::path::{Path, PathBuf};

pub use measure::{Measurement, Point, Renderer, error_to_truth};
pub use surfelcast_measure::{Expected, Mode, Picture, Rectangle, Reference, replace_between_markers};
pub use table::markdown;

/// The folder of shared scenes and references, beside the repository or where `SURFELCAST_SHARED` says; `None` if there is
/// none.
pub fn shared_folder() -> Option<PathBuf> {
    surfelcast_measure::shared_folder(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."))
}
