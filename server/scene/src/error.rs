//! Why a scene was refused.

/// A file that cannot become a scene. Messages name the field, the limit and, where there is one, the remedy.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// The file or a sibling could not be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// Path as given.
        path: String,
        /// Cause.
        source: std::io::Error,
    },
    /// The bytes are not glTF 2.0 or GLB, or break the specification.
    #[error("{field}: {problem}")]
    Invalid {
        /// Where in the file, as a JSON path, e.g. `accessors[3].count`.
        field: String,
        /// What is wrong with it.
        problem: String,
    },
    /// A required extension is not supported.
    #[error("extensionsRequired: {name} is not supported")]
    UnsupportedExtension {
        /// Extension name.
        name: String,
    },
    /// A bound of [`crate::SceneLimits`] is exceeded.
    #[error("{field} is {value}, over the limit of {limit}")]
    TooLarge {
        /// What was counted.
        field: String,
        /// Its value.
        value: u64,
        /// The limit.
        limit: u64,
    },
}
