//! WebSocket close codes.

/// Server is going away.
pub const GOING_AWAY: u16 = 1001;
/// Origin or policy.
pub const POLICY: u16 = 1008;
/// Message over the limit.
pub const TOO_BIG: u16 = 1009;
/// Server restarts; come back.
pub const RESTART: u16 = 1012;
/// Server is full; try later.
pub const TRY_LATER: u16 = 1013;
/// Malformed message.
pub const MALFORMED: u16 = 4400;
/// No such session or scene.
pub const NO_SESSION: u16 = 4404;
/// `hello` or acknowledgements came too late.
pub const TOO_SLOW: u16 = 4408;
/// A newer connection resumed this one.
pub const SUPERSEDED: u16 = 4409;
/// The session ended.
pub const ENDED: u16 = 4410;
/// No common protocol version.
pub const VERSION: u16 = 4426;
/// Too many inputs, or connections of one client in too short a time.
pub const RATE: u16 = 4429;
/// No GPU capacity.
pub const NO_CAPACITY: u16 = 4503;
/// The GPU was lost and did not come back.
pub const GPU_LOST: u16 = 4507;
