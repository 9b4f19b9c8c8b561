//! The live connection: one WebSocket, from the handshake to its close.
//!
//! - `socket`: upgrade and `hello`; `close`: every reason to end; `outbox`: the sending half and its bounds;
//! - `connection`: the task of one client; it alone applies what the others decide;
//! - the member, control: `inbound` (messages to effects), `input_log`, `rate`, `refusal`, `heartbeat`, `points`,
//!   `welcome`;
//! - the view, frames: `view` (renders and encodes), `frame` (encoded once, a header for each socket), `outbound` (what
//!   one socket is sent, and when), `sent_log`, `stats`, `view_settings`, `outputs`, `resume`.

mod close;
mod connection;
mod frame;
mod heartbeat;
mod inbound;
mod input_log;
mod outbound;
mod outbox;
mod outputs;
mod points;
mod rate;
mod recent;
mod refusal;
pub(crate) mod resume;
mod sent_log;
pub(crate) mod socket;
mod stats;
mod view;
mod view_settings;
mod welcome;
