//! Errors as `application/problem+json` (RFC 9457).

use serde::{Deserialize, Serialize};

/// A problem document.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Problem {
    /// `about:blank` or a URI reference to documentation.
    #[serde(rename = "type")]
    pub kind: String,
    /// Short summary of the kind of problem.
    pub title: String,
    /// HTTP status.
    pub status: u16,
    /// Machine-readable code, e.g. `scene_too_large`.
    pub code: String,
    /// What is wrong in this case: the field, the limit, the remedy.
    pub detail: String,
    /// Seconds after which a retry may succeed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub retry_after_secs: Option<u32>,
}

/// MIME type.
pub const PROBLEM_JSON: &str = "application/problem+json";
