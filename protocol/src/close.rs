//! WebSocket close codes.

/// The server is going away.
pub const GOING_AWAY: u16 = 1001;
/// The origin is not allowed.
pub const POLICY: u16 = 1008;
/// A message is over the size limit.
pub const TOO_BIG: u16 = 1009;
/// The server restarts; the client should reconnect.
pub const RESTART: u16 = 1012;
/// The server is full or failed; the client should try later.
pub const TRY_LATER: u16 = 1013;
/// A message is malformed.
pub const MALFORMED: u16 = 4400;
/// No such session or scene.
pub const NO_SESSION: u16 = 4404;
/// `hello`, an acknowledgement or the answer to a ping is overdue.
pub const TOO_SLOW: u16 = 4408;
/// A newer connection resumed this one.
pub const SUPERSEDED: u16 = 4409;
/// The session or the view ended.
pub const ENDED: u16 = 4410;
/// There is no common protocol version.
pub const VERSION: u16 = 4426;
/// Too many messages or inputs a second, or a reconnection too soon.
pub const RATE: u16 = 4429;
/// The device cannot hold or render the scene.
pub const NO_CAPACITY: u16 = 4503;
/// The device was lost and could not be rebuilt.
pub const GPU_LOST: u16 = 4507;
