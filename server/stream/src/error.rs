//! Why a picture could not be encoded.

/// A picture that was refused or an encoder that failed.
#[derive(Debug, thiserror::Error)]
pub enum StreamError {
    /// Pixel count and size disagree.
    #[error("pixels: {present} bytes or values do not make a picture of {width} x {height}, which needs {needed}")]
    Size {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
        /// What the size asks for.
        needed: u64,
        /// What is there.
        present: u64,
    },
    /// A side over what the codec can hold.
    #[error("size: {side} pixels a side is over the {codec} limit of {limit}; render a smaller picture or take PNG")]
    TooLarge {
        /// Name of the codec.
        codec: &'static str,
        /// The larger side.
        side: u32,
        /// Its limit.
        limit: u32,
    },
    /// The encoder failed.
    #[error("{codec} encoder: {detail}")]
    Encoder {
        /// Name of the codec.
        codec: &'static str,
        /// What it said.
        detail: String,
    },
}
