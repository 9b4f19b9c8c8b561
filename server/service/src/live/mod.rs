//! The live connection: one WebSocket, from the handshake to its close.

mod connection;
mod inbound;
mod outbound;
mod outbox;
mod outputs;
mod points;
mod rate;
pub(crate) mod resume;
pub(crate) mod socket;
mod welcome;
mod wishes;
