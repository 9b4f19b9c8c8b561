//! Binary frame header: 48 bytes, little endian, then the payload.
//!
//! | off | type | field |
//! |---|---|---|
//! | 0 | u8 | magic `0xB7` |
//! | 1 | u8 | header version, 1 |
//! | 2 | u8 | kind: 1 full frame |
//! | 3 | u8 | codec, see [`Codec`] |
//! | 4 | u16 | flags, see [`flags`] |
//! | 6 | u16 | view |
//! | 8 | u32 | `frame_seq`, per connection and view, from 1, wraps |
//! | 12 | u32 | `input_seq`, the last client input contained in this image |
//! | 16 | u32 | `scene_rev` |
//! | 20 | 4 x u16 | x, y, w, h of the payload's rectangle |
//! | 28 | 2 x u16 | full width and height, at which the client shows it |
//! | 32 | u32 | server's monotonic microseconds, low 32 bits |
//! | 36 | 2 x u16 | render and encode time in 10 us units, saturating |
//! | 40 | u16 | samples a pixel, saturating |
//! | 42 | u8 | quality, 1 to 100 |
//! | 43 | u8 | reserved, 0 |
//! | 44 | u32 | payload length; equals the rest of the message |

use crate::settings::Codec;

/// First byte of every frame.
pub const MAGIC: u8 = 0xB7;
/// Header version.
pub const HEADER_VERSION: u8 = 1;
/// Length of the header, bytes.
pub const HEADER_BYTES: usize = 48;
/// Kind: a full frame.
pub const KIND_FULL: u8 = 1;

/// Bits of [`FrameHeader::flags`].
pub mod flags {
    /// Decodable on its own.
    pub const KEYFRAME: u16 = 1;
    /// Rendered at rest and at full resolution.
    pub const STILL: u16 = 2;
    /// Converged: no frame follows until something changes.
    pub const FINAL: u16 = 4;
    /// The payload is lossless.
    pub const LOSSLESS: u16 = 16;
}

/// Decoded header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameHeader {
    /// Codec of the payload.
    pub codec: Codec,
    /// See [`flags`].
    pub flags: u16,
    /// View.
    pub view: u16,
    /// Number of this frame.
    pub frame_seq: u32,
    /// Last input that the frame contains.
    pub input_seq: u32,
    /// Scene revision.
    pub scene_rev: u32,
    /// x, y, width and height of the payload.
    pub rect: [u16; 4],
    /// Size at which the client shows it.
    pub full_size: [u16; 2],
    /// Server's monotonic microseconds, low 32 bits.
    pub server_us: u32,
    /// Render time, 10 us units.
    pub render_10us: u16,
    /// Encode time, 10 us units.
    pub encode_10us: u16,
    /// Samples a pixel.
    pub spp: u16,
    /// Quality.
    pub quality: u8,
    /// Payload length, bytes.
    pub payload_len: u32,
}

/// Why a binary message is not a valid frame.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum FrameError {
    /// Shorter than the header.
    #[error("frame of {0} bytes is shorter than its 48-byte header")]
    Short(usize),
    /// Unknown magic, version, kind or codec.
    #[error("frame {field} is {value}, expected {expected}")]
    Field {
        /// Header field.
        field: &'static str,
        /// Value found.
        value: u8,
        /// Accepted values.
        expected: &'static str,
    },
    /// The length field disagrees with the message.
    #[error("frame payload_len is {stated} but {present} bytes follow the header")]
    Length {
        /// Length field.
        stated: u32,
        /// Bytes present.
        present: usize,
    },
}

impl FrameHeader {
    /// The 48 bytes.
    pub fn encode(&self) -> [u8; HEADER_BYTES] {
        let mut b = [0u8; HEADER_BYTES];
        b[0] = MAGIC;
        b[1] = HEADER_VERSION;
        b[2] = KIND_FULL;
        b[3] = self.codec as u8;
        b[4..6].copy_from_slice(&self.flags.to_le_bytes());
        b[6..8].copy_from_slice(&self.view.to_le_bytes());
        b[8..12].copy_from_slice(&self.frame_seq.to_le_bytes());
        b[12..16].copy_from_slice(&self.input_seq.to_le_bytes());
        b[16..20].copy_from_slice(&self.scene_rev.to_le_bytes());
        for (i, v) in self.rect.iter().chain(&self.full_size).enumerate() {
            b[20 + 2 * i..22 + 2 * i].copy_from_slice(&v.to_le_bytes());
        }
        b[32..36].copy_from_slice(&self.server_us.to_le_bytes());
        b[36..38].copy_from_slice(&self.render_10us.to_le_bytes());
        b[38..40].copy_from_slice(&self.encode_10us.to_le_bytes());
        b[40..42].copy_from_slice(&self.spp.to_le_bytes());
        b[42] = self.quality;
        b[44..48].copy_from_slice(&self.payload_len.to_le_bytes());
        b
    }

    /// Reads the header of a whole message and checks that the payload is all there.
    pub fn decode(message: &[u8]) -> Result<Self, FrameError> {
        let b: &[u8; HEADER_BYTES] = message.first_chunk().ok_or(FrameError::Short(message.len()))?;
        let u16_at = |i: usize| u16::from_le_bytes([b[i], b[i + 1]]);
        let u32_at = |i: usize| u32::from_le_bytes([b[i], b[i + 1], b[i + 2], b[i + 3]]);
        let expect = |field, value, expected: u8, text| {
            if value == expected { Ok(()) } else { Err(FrameError::Field { field, value, expected: text }) }
        };
        expect("magic", b[0], MAGIC, "183")?;
        expect("version", b[1], HEADER_VERSION, "1")?;
        expect("kind", b[2], KIND_FULL, "1")?;
        let codec = match b[3] {
            1 => Codec::Jpeg,
            2 => Codec::Webp,
            4 => Codec::Png,
            value => return Err(FrameError::Field { field: "codec", value, expected: "1, 2 or 4" }),
        };
        let payload_len = u32_at(44);
        let present = message.len() - HEADER_BYTES;
        if payload_len as usize != present {
            return Err(FrameError::Length { stated: payload_len, present });
        }
        Ok(Self {
            codec,
            flags: u16_at(4),
            view: u16_at(6),
            frame_seq: u32_at(8),
            input_seq: u32_at(12),
            scene_rev: u32_at(16),
            rect: [u16_at(20), u16_at(22), u16_at(24), u16_at(26)],
            full_size: [u16_at(28), u16_at(30)],
            server_us: u32_at(32),
            render_10us: u16_at(36),
            encode_10us: u16_at(38),
            spp: u16_at(40),
            quality: b[42],
            payload_len,
        })
    }
}
