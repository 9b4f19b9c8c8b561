//! The live connection: one WebSocket, from the handshake to its close.

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
