//! The domain: sessions, what people edit in them, and the checks that every value passes before it is accepted.
//!
//! Nothing here waits, reads a clock or does I/O. A session either refuses an edit and changes nothing, or applies all
//! of it and numbers it; who sent the edit and who is notified is the caller's concern.

pub mod error;
pub mod lights;
pub mod number;
pub mod session;
pub mod text;

pub use error::ReviewError;
pub use lights::LightSet;
pub use session::{Edit, Session, SessionId};
