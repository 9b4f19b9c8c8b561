//! How surfaces scatter, as requests state it.

pub use surfelcast_render_api::MaterialMode;
