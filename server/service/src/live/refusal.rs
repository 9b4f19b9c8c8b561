//! Refusals of single requests; the connection stays.

use surfelcast_protocol::server::ServerMessage;
use surfelcast_review::ReviewError;

/// The one view of a connection.
const VIEW: u16 = 0;

/// Content of `error`: a code for programs, and the field, the limit and the remedy for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Refusal {
    pub(crate) code: &'static str,
    pub(crate) detail: String,
}

impl Refusal {
    pub(crate) fn new(code: &'static str, detail: impl Into<String>) -> Self {
        Self { code, detail: detail.into() }
    }

    /// A field has a value that it cannot have.
    pub(crate) fn invalid(error: ReviewError) -> Self {
        Self::new("invalid_value", error)
    }

    /// Other work must end first.
    pub(crate) fn busy(detail: impl Into<String>) -> Self {
        Self::new("busy", detail)
    }

    /// The request needs a frame, and none was sent or acknowledged yet.
    pub(crate) fn no_frame(detail: impl Into<String>) -> Self {
        Self::new("no_frame", detail)
    }

    /// The message, with the id of the request where it had one.
    pub(crate) fn message(self, re: Option<u64>) -> ServerMessage {
        ServerMessage::Error { re, code: self.code.into(), detail: self.detail }
    }
}

/// Refuses any view but the one of the connection.
pub(crate) fn check_view(view: u16) -> Result<(), Refusal> {
    if is_own_view(view) {
        return Ok(());
    }
    Err(Refusal::new("unknown_view", "view: a connection has the one view 0; open another connection"))
}

/// Whether this is the view of the connection.
pub(crate) fn is_own_view(view: u16) -> bool {
    view == VIEW
}
