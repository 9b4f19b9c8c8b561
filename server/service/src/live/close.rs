//! Why a connection ends, and the close code and text that its client gets.

use std::error::Error as StdError;

use surfelcast_protocol::close;
use surfelcast_protocol::parse::ParseError;
use surfelcast_renderer::RendererError;
use tungstenite::error::CapacityError;

use crate::error::DomainError;
use crate::live::outbox::Overflow;

/// How a connection ends. The text of a variant is the reason in the close message.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CloseReason {
    // `hello` or joining the session failed.
    #[error("hello: did not come in time")]
    HelloTimeout,
    #[error("hello: must be the first message")]
    HelloNotFirst,
    #[error("hello: too long")]
    HelloTooLong,
    #[error("{0}")]
    HelloMalformed(ParseError),
    #[error("hello.v: this server speaks version 1")]
    HelloVersion,
    #[error("hello.caps.codecs: offer at least one of jpeg, webp, png")]
    HelloCodecs,
    #[error("hello.resume: come back {least_ms} ms after the last connection began, not before")]
    ResumedTooSoon { least_ms: u128 },
    #[error(transparent)]
    NotJoined(#[from] DomainError),
    // The client broke a rule.
    #[error("message: over the size limit in welcome.limits")]
    MessageTooLong,
    #[error("binary messages are the server's")]
    BinaryMessage,
    #[error("control message: repeatedly malformed")]
    RepeatedlyMalformed,
    #[error("messages: too many a second")]
    TooManyMessages,
    #[error("inputs: more a second than welcome.limits.inputs_per_sec")]
    TooManyInputs,
    #[error("ack: none came for too long")]
    AckTimeout,
    #[error("ping: no sign of life")]
    PingTimeout,
    // The view, its session or the server ends.
    #[error("a newer connection resumed this view")]
    Superseded,
    #[error("the session ended: its scene was deleted")]
    SessionEnded,
    #[error("the view was closed by the renderer")]
    ViewClosed,
    #[error("the render device was lost and did not come back")]
    DeviceLost,
    #[error("{0}")]
    Renderer(#[from] RendererError),
    #[error("the server is stopping; come back")]
    Stopping,
    #[error("the server failed; its log tells why")]
    Internal,
    // Without a close message.
    /// The client does not read what it is sent, so it would not read a close message either.
    #[error(transparent)]
    Overflow(#[from] Overflow),
    /// The socket is closed or broken.
    #[error("the socket is gone")]
    Gone,
}

impl CloseReason {
    /// The close code; `None` where no close message is sent.
    pub(crate) fn code(&self) -> Option<u16> {
        Some(match self {
            Self::HelloTimeout | Self::AckTimeout | Self::PingTimeout => close::TOO_SLOW,
            Self::HelloTooLong | Self::MessageTooLong => close::TOO_BIG,
            Self::HelloNotFirst
            | Self::HelloMalformed(_)
            | Self::HelloCodecs
            | Self::BinaryMessage
            | Self::RepeatedlyMalformed => close::MALFORMED,
            Self::HelloVersion => close::VERSION,
            Self::ResumedTooSoon { .. } | Self::TooManyMessages | Self::TooManyInputs => close::RATE,
            Self::Internal => close::TRY_LATER,
            Self::Superseded => close::SUPERSEDED,
            Self::SessionEnded | Self::ViewClosed => close::ENDED,
            Self::DeviceLost => close::GPU_LOST,
            Self::Renderer(error) => code_of_renderer(error),
            Self::NotJoined(error) => code_of_domain(error),
            Self::Stopping => close::RESTART,
            Self::Overflow(_) | Self::Gone => return None,
        })
    }

    /// The reason behind an error of the socket. A message over the size limit differs from a broken socket by the type
    /// of its cause. That is an error of tungstenite, which must therefore be the version that axum uses.
    pub(crate) fn of_socket_error(error: &axum::Error) -> Self {
        let first: Option<&(dyn StdError + 'static)> = error.source();
        let is_too_long = std::iter::successors(first, |&cause| cause.source()).any(|cause| {
            matches!(cause.downcast_ref(), Some(tungstenite::Error::Capacity(CapacityError::MessageTooLong { .. })))
        });
        if is_too_long { Self::MessageTooLong } else { Self::Gone }
    }
}

fn code_of_renderer(error: &RendererError) -> u16 {
    match error {
        RendererError::NoMemory { .. } | RendererError::SceneTooLarge { .. } | RendererError::Unsupported(_) => {
            close::NO_CAPACITY
        }
        RendererError::Unknown(_) => close::NO_SESSION,
        RendererError::Stopped | RendererError::Busy { .. } | RendererError::DeviceLost | RendererError::Canceled => {
            close::TRY_LATER
        }
    }
}

fn code_of_domain(error: &DomainError) -> u16 {
    match error {
        DomainError::Renderer(error) => code_of_renderer(error),
        DomainError::UnknownSession | DomainError::UnknownScene => close::NO_SESSION,
        _ => close::TRY_LATER,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_over_the_limit_differ_from_broken_sockets() {
        let too_long = tungstenite::Error::Capacity(CapacityError::MessageTooLong { size: 2, max_size: 1 });
        let reason = CloseReason::of_socket_error(&axum::Error::new(too_long));
        assert_eq!(reason.code(), Some(close::TOO_BIG));
        let wrapped = axum::Error::new(axum::Error::new(tungstenite::Error::Capacity(CapacityError::MessageTooLong {
            size: 2,
            max_size: 1,
        })));
        assert_eq!(CloseReason::of_socket_error(&wrapped).code(), Some(close::TOO_BIG));
        for broken in [tungstenite::Error::ConnectionClosed, CapacityError::TooManyHeaders.into()] {
            assert_eq!(CloseReason::of_socket_error(&axum::Error::new(broken)).code(), None);
        }
    }

    #[test]
    fn refusals_of_the_renderer_have_codes() {
        for (error, code) in [
            (RendererError::NoMemory { needed: 2, free: 1 }, close::NO_CAPACITY),
            (RendererError::Unsupported("no".into()), close::NO_CAPACITY),
            (RendererError::Unknown("session"), close::NO_SESSION),
            (RendererError::Busy { what: "commands", limit: 1 }, close::TRY_LATER),
            (RendererError::DeviceLost, close::TRY_LATER),
        ] {
            assert_eq!(CloseReason::from(error.clone()).code(), Some(code), "{error}");
        }
    }
}
