//! Codec and quality of an image.

use crate::{Codec, Quality};

/// Quality of images at rest that are still refining: the lowest with full colour resolution.
const STILL_QUALITY: u8 = 90;
/// Quality of the final image where the link is too slow for a lossless one or the client does not decode any.
const LAST_LOSSY_QUALITY: u8 = 95;
/// Bytes per pixel of a lossless image of a rendered scene at most (measured: 0.8 without noise, 2.4 with).
const LOSSLESS_BYTES_PER_PIXEL: f64 = 2.4;
/// Longest transfer of a lossless image.
const LOSSLESS_SECS: f64 = 2.0;

/// Stage of refinement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// During a gesture.
    Moving,
    /// At rest, refining.
    Still,
    /// Converged: no frame follows.
    Final,
}

/// Chooses codec and quality. `offered` are the codecs that the client decodes (best first), `preferred` the one it
/// requested for images at rest, `moving_quality` the limit of the quality loop, `bytes_per_sec` the measured
/// throughput, if any. `None` if nothing is offered.
pub fn choose_encoding(
    stage: Stage,
    offered: &[Codec],
    preferred: Option<Codec>,
    moving_quality: u8,
    pixel_count: u64,
    bytes_per_sec: Option<f64>,
) -> Option<(Codec, Quality)> {
    let first = |order: [Codec; 3]| order.into_iter().find(|codec| offered.contains(codec));
    let preferred = preferred.filter(|codec| offered.contains(codec));
    let lossy = |codec: Codec, quality: u8| match codec {
        Codec::Png => (codec, Quality::Lossless),
        _ => (codec, Quality::Lossy(quality)),
    };
    match stage {
        Stage::Moving => first([Codec::Jpeg, Codec::Webp, Codec::Png]).map(|codec| lossy(codec, moving_quality)),
        Stage::Still => {
            preferred.or_else(|| first([Codec::Jpeg, Codec::Webp, Codec::Png])).map(|codec| lossy(codec, STILL_QUALITY))
        }
        Stage::Final => {
            let affordable =
                bytes_per_sec.is_none_or(|rate| pixel_count as f64 * LOSSLESS_BYTES_PER_PIXEL <= rate * LOSSLESS_SECS);
            let codec = match preferred {
                Some(codec) => codec,
                None if affordable => first([Codec::Webp, Codec::Png, Codec::Jpeg])?,
                None => first([Codec::Jpeg, Codec::Webp, Codec::Png])?,
            };
            let is_lossless = codec != Codec::Jpeg && affordable;
            Some(if is_lossless { (codec, Quality::Lossless) } else { lossy(codec, LAST_LOSSY_QUALITY) })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Codec; 3] = [Codec::Webp, Codec::Jpeg, Codec::Png];

    #[test]
    fn fast_while_moving_sharp_at_rest_exact_at_the_end() {
        let choose = |stage| choose_encoding(stage, &ALL, None, 60, 1 << 20, None);
        assert_eq!(choose(Stage::Moving), Some((Codec::Jpeg, Quality::Lossy(60))));
        assert_eq!(choose(Stage::Still), Some((Codec::Jpeg, Quality::Lossy(90))));
        assert_eq!(choose(Stage::Final), Some((Codec::Webp, Quality::Lossless)));
    }

    #[test]
    fn a_slow_link_ends_lossy() {
        let choose = |rate| choose_encoding(Stage::Final, &ALL, None, 60, 1 << 20, Some(rate));
        assert_eq!(choose(100e3), Some((Codec::Jpeg, Quality::Lossy(95))));
        assert_eq!(choose(100e6), Some((Codec::Webp, Quality::Lossless)));
    }

    #[test]
    fn only_what_is_offered() {
        let choose = |offered: &[Codec], preferred| choose_encoding(Stage::Final, offered, preferred, 60, 1, None);
        assert_eq!(choose(&[Codec::Jpeg], None), Some((Codec::Jpeg, Quality::Lossy(95))));
        assert_eq!(choose(&[Codec::Jpeg], Some(Codec::Webp)), Some((Codec::Jpeg, Quality::Lossy(95))));
        assert_eq!(choose(&[Codec::Png, Codec::Jpeg], None), Some((Codec::Png, Quality::Lossless)));
        assert_eq!(choose(&[], None), None);
        let preferred = choose_encoding(Stage::Still, &ALL, Some(Codec::Webp), 60, 1, None);
        assert_eq!(preferred, Some((Codec::Webp, Quality::Lossy(90))));
    }
}
