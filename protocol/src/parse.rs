//! Parsing of untrusted control messages.

use serde_json::Value;

use crate::client::{ClientEnvelope, ClientMessage};

/// Types of messages from the client, in the order of [`ClientMessage`].
pub const CLIENT_TYPES: [&str; 10] =
    ["hello", "camera", "light", "view.set", "ack", "still", "pick", "inspect", "ping", "pong"];

/// Why a text message cannot be parsed. The texts repeat no more than a few characters of the input.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum ParseError {
    /// Not a JSON object with a string `t`: the peer does not use this protocol.
    #[error("control message: {0}")]
    Malformed(String),
    /// `t` is none of [`CLIENT_TYPES`]; a newer client may send such messages.
    #[error("t: message type `{kind}` is not known to this server")]
    Unsupported {
        /// The request's id.
        id: Option<u64>,
        /// The type, shortened to 32 characters.
        kind: String,
    },
    /// A known type with a missing or ill-typed field.
    #[error("{kind}: {detail}")]
    Invalid {
        /// The request's id.
        id: Option<u64>,
        /// The type.
        kind: String,
        /// Which field, and what is wrong with it.
        detail: String,
    },
}

/// Parses one control message. Unknown fields are ignored; nesting is bounded by `serde_json`'s depth limit of 128.
pub fn parse_client(text: &str) -> Result<ClientEnvelope, ParseError> {
    let value: Value = serde_json::from_str(text).map_err(|e| ParseError::Malformed(e.to_string()))?;
    let object = value.as_object().ok_or_else(|| ParseError::Malformed("expected a JSON object".into()))?;
    let kind = match object.get("t") {
        Some(Value::String(kind)) => kind.clone(),
        Some(_) => return Err(ParseError::Malformed("t: expected a string".into())),
        None => return Err(ParseError::Malformed("t: missing; it names the message type".into())),
    };
    let id = match object.get("id") {
        None | Some(Value::Null) => None,
        Some(id) => {
            Some(id.as_u64().ok_or_else(|| ParseError::Malformed("id: expected an integer from 0 to 2^64-1".into()))?)
        }
    };
    if !CLIENT_TYPES.contains(&kind.as_str()) {
        return Err(ParseError::Unsupported { id, kind: kind.chars().take(32).collect() });
    }
    let message: ClientMessage = serde_json::from_value(value).map_err(|e| {
        let detail: String = e.to_string().chars().take(200).collect();
        ParseError::Invalid { id, kind, detail }
    })?;
    Ok(ClientEnvelope { id, message })
}
