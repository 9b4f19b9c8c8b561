//! Limits in force, sent in `welcome`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Limits on a connection, its view and its session.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Limits {
    /// Bytes of a control message.
    pub control_bytes: u32,
    /// Bytes of a message before `welcome`.
    pub hello_bytes: u32,
    /// Time within which `hello` must arrive, milliseconds.
    pub hello_timeout_ms: u32,
    /// Inputs per second of a connection.
    pub inputs_per_sec: u32,
    /// Width or height of a view, pixels.
    pub max_side: u32,
    /// Pixels of a view.
    pub max_pixels: u32,
    /// Views of a session.
    pub views_per_session: u32,
    /// Punctual lights of a session.
    pub max_lights: u32,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            control_bytes: 64 << 10,
            hello_bytes: 16 << 10,
            hello_timeout_ms: 5_000,
            inputs_per_sec: 240,
            max_side: 4096,
            max_pixels: 8_300_000,
            views_per_session: 32,
            max_lights: 256,
        }
    }
}
