//! What the server keeps: uploaded scenes on disk, finished renders and idempotency keys in memory, all bounded.
//!
//! The store holds bytes and records and knows nothing of what they mean. Its calls block for as long as the disk
//! takes, and the clock is handed in.

pub mod error;
pub mod idempotency;
pub mod renders;
pub mod scenes;

pub use error::StoreError;
pub use idempotency::{IdempotencyKeys, KeyState};
pub use renders::{RenderBounds, RenderTable};
pub use scenes::{SceneBounds, SceneFiles, SceneRecord};
