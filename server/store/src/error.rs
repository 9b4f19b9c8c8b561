//! Why the store refused or failed.

use std::io;

/// A refusal, whose text names the limit and the remedy, or a failure of the disk.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// There is no such record.
    #[error("no such record is stored")]
    Missing,
    /// The scenes take all the space that they may.
    #[error("the store holds at most {scenes} scenes and {bytes} bytes; delete a scene first")]
    Full {
        /// Most scenes.
        scenes: usize,
        /// Most bytes of all scenes.
        bytes: u64,
    },
    /// As many renders are active as may be.
    #[error("{limit} renders are waiting or running already; try again later")]
    TooManyRenders {
        /// The limit.
        limit: usize,
    },
    /// The disk failed.
    #[error("{0}")]
    Io(#[from] io::Error),
}
