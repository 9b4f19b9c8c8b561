//! How far rendered pictures are from reference images, and how far they may be.
//!
//! A reference has noise of its own, and so has a picture; a correct renderer differs from the reference by both, added
//! in squares. The first is stated beside the reference, the second is measured from two pictures of different seeds. So
//! the gate needs no tuned threshold: measured^2 / (reference noise^2 + own noise^2) is 1 for a correct renderer.

mod measure;
mod picture;
mod reference;
mod table;

pub use measure::{Measurement, Point, Renderer};
pub use picture::{Picture, Rectangle};
pub use reference::{Expected, Mode, Reference, shared_folder};
pub use table::{markdown, replace_between_markers};
