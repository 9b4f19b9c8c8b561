//! Why an image could not be encoded.

/// An image that was refused or an encoder that failed.
#[derive(Debug, thiserror::Error)]
pub enum StreamError {
    /// Pixel count and size disagree.
    #[error("pixels: {present} bytes or values do not make a picture of {width} x {height}, which needs {needed}")]
    Size {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
        /// Required by the size.
        needed: u64,
        /// Given.
        present: u64,
    },
    /// A side over the codec's limit.
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
        /// Its message.
        detail: String,
    },
}
