//! Why an edit or a value was refused.

/// A refusal. Its text names the field, the limit and the remedy; nothing has changed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReviewError {
    /// A value is outside what its field allows.
    #[error("{field}: {reason}")]
    InvalidValue {
        /// The field, as the caller's protocol names it.
        field: String,
        /// What the field allows.
        reason: String,
    },
    /// The session holds as many lights as it may.
    #[error("patch.add: the session has {limit} lights already; remove one first")]
    TooManyLights {
        /// The limit.
        limit: u32,
    },
    /// Every light id of the session has been used.
    #[error("patch.add: no light ids are left in this session")]
    NoLightIds,
    /// An edit names a light that the session does not have.
    #[error("{field}: there is no light {id} in this session")]
    UnknownLight {
        /// The field that names it.
        field: &'static str,
        /// The id.
        id: u32,
    },
}

impl ReviewError {
    /// A value that its field does not allow.
    pub fn invalid(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::InvalidValue { field: field.into(), reason: reason.into() }
    }
}

impl From<ReviewError> for String {
    fn from(error: ReviewError) -> Self {
        error.to_string()
    }
}
