//! What is wrong with a request.

/// A refused field: which one, why, and what would be accepted.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {reason}")]
pub struct Fault {
    /// The field, with a path where it is nested: `settings.radius`.
    pub field: String,
    /// The limit and the remedy.
    pub reason: String,
    /// The request is not well formed, as opposed to a value that cannot be.
    pub is_malformed: bool,
}

impl Fault {
    /// A value that cannot be.
    pub fn value(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self { field: field.into(), reason: reason.into(), is_malformed: false }
    }

    /// A request that is not well formed.
    pub fn malformed(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self { field: field.into(), reason: reason.into(), is_malformed: true }
    }

    /// The same fault of a field inside another one.
    #[must_use]
    pub fn inside(self, parent: &str) -> Self {
        Self { field: format!("{parent}.{}", self.field), ..self }
    }
}
