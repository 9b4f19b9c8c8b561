//! A frame on its way to clients.
//!
//! Encoding belongs to the view: an [`EncodedFrame`] is the same for every socket that it is sent on. What differs from
//! socket to socket, the number of the frame and the time of sending, stands in the header, which is made for each.

use std::sync::Arc;

use bytes::Bytes;
use surfelcast_protocol::frame::{FrameHeader, HEADER_BYTES, flags};
use surfelcast_protocol::settings;
use surfelcast_renderer::{Frame, FrameKind};
use surfelcast_stream::{Codec, Quality};

/// A frame to encode, and how.
#[derive(Clone, Debug)]
pub(crate) struct EncodeRequest {
    pub(crate) frame: Arc<Frame>,
    pub(crate) codec: Codec,
    pub(crate) quality: Quality,
}

/// A frame that was encoded once, for any number of sockets.
#[derive(Clone, Debug)]
pub(crate) struct EncodedFrame {
    pub(crate) frame: Arc<Frame>,
    pub(crate) codec: Codec,
    pub(crate) quality: Quality,
    pub(crate) payload: Bytes,
    pub(crate) encode_secs: f64,
}

impl EncodedFrame {
    /// Length of the whole message, bytes.
    pub(crate) fn message_bytes(&self) -> u64 {
        (HEADER_BYTES + self.payload.len()) as u64
    }

    /// The header on one socket: its number there and the time at which it is sent.
    pub(crate) fn header(&self, frame_seq: u32, server_us: u32) -> FrameHeader {
        let frame = &self.frame;
        FrameHeader {
            codec: protocol_codec(self.codec),
            flags: self.flags(),
            view: 0,
            frame_seq,
            input_seq: frame.input_seq,
            scene_rev: frame.scene_rev,
            rect: [0, 0, saturating(frame.size[0]), saturating(frame.size[1])],
            full_size: frame.full_size.map(saturating),
            server_us,
            render_10us: ten_micros(f64::from(frame.render_secs)),
            encode_10us: ten_micros(self.encode_secs),
            spp: saturating(frame.samples),
            quality: self.quality.number(),
            payload_len: self.payload.len() as u32,
        }
    }

    fn flags(&self) -> u16 {
        let mut bits = flags::KEYFRAME;
        if self.frame.kind != FrameKind::Moving {
            bits |= flags::STILL;
        }
        if self.frame.kind == FrameKind::Final {
            bits |= flags::FINAL;
        }
        if self.quality == Quality::Lossless && self.codec != Codec::Jpeg {
            bits |= flags::LOSSLESS;
        }
        bits
    }
}

/// The encoder's name of a codec of the protocol.
pub(crate) fn stream_codec(codec: settings::Codec) -> Codec {
    match codec {
        settings::Codec::Jpeg => Codec::Jpeg,
        settings::Codec::Webp => Codec::Webp,
        settings::Codec::Png => Codec::Png,
    }
}

fn protocol_codec(codec: Codec) -> settings::Codec {
    match codec {
        Codec::Jpeg => settings::Codec::Jpeg,
        Codec::Webp => settings::Codec::Webp,
        Codec::Png => settings::Codec::Png,
    }
}

fn saturating(value: u32) -> u16 {
    u16::try_from(value).unwrap_or(u16::MAX)
}

/// The header's unit of time; float to integer casts saturate.
fn ten_micros(secs: f64) -> u16 {
    (secs * 1e5) as u16
}

#[cfg(test)]
pub(crate) mod tests {
    use std::time::Instant;

    use super::*;

    /// A grey frame.
    pub(crate) fn frame(kind: FrameKind, samples: u32) -> Frame {
        Frame {
            pixels: vec![128; 64 * 48 * 4].into(),
            size: [64, 48],
            full_size: [64, 48],
            kind,
            input_seq: 1,
            scene_rev: 1,
            samples,
            error: None,
            render_secs: 0.25,
            finished_at: Instant::now(),
            passes: Vec::new(),
            skipped: Vec::new(),
        }
    }

    /// The result of encoding, without an encoder.
    pub(crate) fn encoded(request: EncodeRequest, payload_bytes: usize) -> EncodedFrame {
        let EncodeRequest { frame, codec, quality } = request;
        EncodedFrame { frame, codec, quality, payload: vec![0; payload_bytes].into(), encode_secs: 0.125 }
    }

    #[test]
    fn sockets_share_a_payload_and_have_headers_of_their_own() {
        let request = EncodeRequest {
            frame: Arc::new(frame(FrameKind::Final, 70_000)),
            codec: Codec::Webp,
            quality: Quality::Lossless,
        };
        let encoded = encoded(request, 1000);
        let (one, other) = (encoded.header(1, 100), encoded.header(7, 250));
        assert_eq!(FrameHeader { frame_seq: 1, server_us: 100, ..other }, one);
        assert_eq!((one.payload_len, one.spp, one.quality), (1000, u16::MAX, 100));
        assert_eq!((one.render_10us, one.encode_10us), (25_000, 12_500));
        assert_eq!(one.flags, flags::KEYFRAME | flags::STILL | flags::FINAL | flags::LOSSLESS);
        assert_eq!(encoded.message_bytes(), 1048);
        assert_eq!(encoded.clone().payload.as_ptr(), encoded.payload.as_ptr(), "shared, not copied");
    }

    #[test]
    fn flags_follow_kind_and_quality() {
        let flags_of = |kind, codec, quality| {
            encoded(EncodeRequest { frame: Arc::new(frame(kind, 1)), codec, quality }, 1).header(1, 0).flags
        };
        assert_eq!(flags_of(FrameKind::Moving, Codec::Jpeg, Quality::Lossy(80)), flags::KEYFRAME);
        let still = flags::KEYFRAME | flags::STILL;
        assert_eq!(flags_of(FrameKind::Still, Codec::Jpeg, Quality::Lossless), still, "JPEG is never lossless");
        assert_eq!(flags_of(FrameKind::Still, Codec::Png, Quality::Lossless), still | flags::LOSSLESS);
    }
}
