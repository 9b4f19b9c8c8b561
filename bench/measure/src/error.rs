//! What can go wrong while measuring.

use std::path::{Path, PathBuf};

/// A file or a document is not as it has to be.
#[derive(Debug, thiserror::Error)]
pub enum MeasureError {
    /// A file could not be read or written.
    #[error("{}: {reason}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The program under test is missing or failed.
    #[error("{0}")]
    Program(String),
}

impl MeasureError {
    pub(crate) fn file(path: &Path, reason: &impl ToString) -> Self {
        Self::File { path: path.to_owned(), reason: reason.to_string() }
    }
}
