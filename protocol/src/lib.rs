//! Everything that crosses the wire: control messages, the binary frame header, limits, settings, errors.
//!
//! Control messages are JSON objects with a `t` field; images are binary messages with a fixed header ([`frame`]).
//! Unknown fields are ignored, unknown `t` is answered with an error and the connection stays. `fixtures/` holds golden
//! encodings that the Rust tests and the browser client's tests both decode.

pub mod client;
pub mod close;
pub mod frame;
pub mod inspection;
pub mod limits;
pub mod parse;
pub mod problem;
pub mod server;
pub mod settings;

/// WebSocket subprotocol of this version: JSON control messages, binary frames.
pub const SUBPROTOCOL: &str = "surfelcast.v1.json";

/// Protocol version in `hello` and `welcome`.
pub const VERSION: u32 = 1;
