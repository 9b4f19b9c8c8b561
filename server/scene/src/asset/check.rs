//! Checks and errors that every part of the loader uses: limits, text for messages, faults of a file.

use crate::SceneError;

/// An error that names the field of the file at fault.
pub(crate) fn invalid(field: impl Into<String>, problem: impl Into<String>) -> SceneError {
    SceneError::Invalid { field: field.into(), problem: problem.into() }
}

/// Compares a count with its limit.
pub(crate) fn within(field: &str, value: u64, limit: u64) -> Result<(), SceneError> {
    if value > limit { Err(SceneError::TooLarge { field: field.to_owned(), value, limit }) } else { Ok(()) }
}

/// Narrows a number of the file to `f32`; refuses those that overflow.
pub(crate) fn finite(value: f64, field: &str) -> Result<f32, SceneError> {
    let narrow = value as f32;
    if narrow.is_finite() { Ok(narrow) } else { Err(invalid(field, format!("{value} is out of range"))) }
}

/// The first 160 characters of untrusted text, for messages: a `data:` URI may have millions.
pub(crate) fn clip(text: &str) -> String {
    text.chars().take(160).map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect()
}
