//! What a client accepts, prefers and has already: `Accept`, `Accept-Encoding`, `Prefer`, `If-None-Match`.
//!
//! `headers` has no types for the first three, so their values are read here.

use axum::http::{HeaderMap, StatusCode, header};
use headers::{ETag, HeaderMapExt as _, IfNoneMatch};

use crate::http::problem::ApiError;
use crate::image_format::ImageFormat;

/// What a request for a render can be answered with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Representation {
    /// The image.
    Image(ImageFormat),
    /// The job resource.
    Json,
}

impl Representation {
    fn mime(self) -> &'static str {
        match self {
            Self::Image(format) => format.mime(),
            Self::Json => "application/json",
        }
    }
}

/// The available representation that the client prefers; among equals the first of `available`. 406 where none is
/// acceptable.
pub(crate) fn choose(headers: &HeaderMap, available: &[Representation]) -> Result<Representation, ApiError> {
    let ranges: Vec<&str> = headers
        .get_all(header::ACCEPT)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .map(str::trim)
        .filter(|range| !range.is_empty())
        .collect();
    let mut best: Option<(Representation, u32)> = None;
    for candidate in available {
        let quality = if ranges.is_empty() { 1000 } else { quality_of(&ranges, candidate.mime()) };
        if quality > best.map_or(0, |(_, q)| q) {
            best = Some((*candidate, quality));
        }
    }
    best.map(|(chosen, _)| chosen).ok_or_else(|| {
        let list: Vec<&str> = available.iter().map(|candidate| candidate.mime()).collect();
        let detail = format!("Accept: none of the accepted types is available here; ask for {}", list.join(", "));
        ApiError::new(StatusCode::NOT_ACCEPTABLE, "not_acceptable", detail)
    })
}

/// Quality (thousandths) of a type: that of the most specific range that covers it (RFC 9110, 12.5.1).
fn quality_of(ranges: &[&str], mime: &str) -> u32 {
    let group = mime.split('/').next().unwrap_or_default();
    let mut best = (0, 0);
    for range in ranges {
        let mut parts = range.split(';').map(str::trim);
        let name = parts.next().unwrap_or_default();
        let specificity = if name.eq_ignore_ascii_case(mime) {
            3
        } else if name.strip_suffix("/*").is_some_and(|prefix| prefix.eq_ignore_ascii_case(group)) {
            2
        } else if name == "*/*" {
            1
        } else {
            continue;
        };
        let quality = parts
            .find_map(|part| part.strip_prefix("q=").or_else(|| part.strip_prefix("Q=")))
            .map_or(Some(1.0), |q| q.parse::<f32>().ok())
            .filter(|q| (0.0..=1.0).contains(q))
            .map_or(0, |q| (q * 1000.0).round() as u32);
        if specificity > best.0 {
            best = (specificity, quality);
        }
    }
    best.1
}

/// Seconds of `Prefer: wait=N` (RFC 7240), if stated.
pub(crate) fn prefer_wait(headers: &HeaderMap) -> Option<u64> {
    headers
        .get_all("prefer")
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split([',', ';']))
        .filter_map(|part| part.trim().split_once('='))
        .find(|(name, _)| name.trim().eq_ignore_ascii_case("wait"))
        .and_then(|(_, secs)| secs.trim().trim_matches('"').parse().ok())
}

/// Whether `If-None-Match` names this entity tag, by weak comparison (RFC 9110, 13.1.2).
pub(crate) fn is_none_match_hit(headers: &HeaderMap, etag: &str) -> bool {
    let known = headers.typed_get::<IfNoneMatch>();
    known.zip(etag.parse::<ETag>().ok()).is_some_and(|(known, etag)| !known.precondition_passes(&etag))
}

/// Whether `Accept-Encoding` permits gzip.
pub(crate) fn accepts_gzip(headers: &HeaderMap) -> bool {
    let codings: Vec<&str> = headers
        .get_all(header::ACCEPT_ENCODING)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .collect();
    // A coding's own entry counts before `*`.
    let find = |name: &str| {
        codings.iter().find_map(|coding| {
            let (coding, parameters) = coding.split_once(';').unwrap_or((coding, "q=1"));
            let quality = parameters.trim().strip_prefix("q=").or_else(|| parameters.trim().strip_prefix("Q="))?;
            coding.trim().eq_ignore_ascii_case(name).then(|| quality.trim().parse::<f32>().is_ok_and(|q| q > 0.0))
        })
    };
    find("gzip").or_else(|| find("*")).unwrap_or(false)
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    fn accept(value: &str) -> Result<ImageFormat, u16> {
        let mut headers = HeaderMap::new();
        if !value.is_empty() {
            headers.insert(header::ACCEPT, HeaderValue::from_str(value).expect("a value"));
        }
        match choose(&headers, &ImageFormat::ALL.map(Representation::Image)) {
            Ok(Representation::Image(format)) => Ok(format),
            Ok(Representation::Json) => panic!("not available"),
            Err(error) => Err(error.status().as_u16()),
        }
    }

    #[test]
    fn gzip() {
        let accepts = |value: &'static str| {
            accepts_gzip(&HeaderMap::from_iter([(header::ACCEPT_ENCODING, HeaderValue::from_static(value))]))
        };
        for yes in ["gzip", "br, GZip;q=0.5", "*", "deflate, gzip;q=1.0, *;q=0"] {
            assert!(accepts(yes), "{yes}");
        }
        for no in ["", "br", "gzip;q=0", "gzip;q=0, *", "*;q=0", "identity", "gzipped", "gzip;q=x"] {
            assert!(!accepts(no), "{no}");
        }
        assert!(!accepts_gzip(&HeaderMap::new()));
    }

    #[test]
    fn formats() {
        assert_eq!(accept(""), Ok(ImageFormat::Png));
        assert_eq!(accept("*/*"), Ok(ImageFormat::Png));
        assert_eq!(accept("image/*"), Ok(ImageFormat::Png));
        assert_eq!(accept("image/webp"), Ok(ImageFormat::Webp));
        assert_eq!(accept("image/avif, image/jpeg;q=0.5, image/webp;q=0.8"), Ok(ImageFormat::Webp));
        assert_eq!(accept("image/png;q=0, image/*;q=0.1"), Ok(ImageFormat::Jpeg));
        assert_eq!(accept("IMAGE/X-EXR"), Ok(ImageFormat::Exr));
        assert_eq!(accept("image/avif"), Err(406));
        assert_eq!(accept("text/html, image/png;q=0"), Err(406));
        assert_eq!(accept("image/png;q=abc"), Err(406));
    }

    #[test]
    fn preferences() {
        let wait = |value: &'static str| {
            let mut headers = HeaderMap::new();
            headers.insert("prefer", HeaderValue::from_static(value));
            prefer_wait(&headers)
        };
        assert_eq!(wait("wait=20"), Some(20));
        assert_eq!(wait("respond-async, wait = \"5\""), Some(5));
        assert_eq!(wait("wait=soon"), None);
        assert_eq!(wait("respond-async"), None);
    }

    #[test]
    fn entity_tags() {
        let hit = |value: &'static str| {
            let mut headers = HeaderMap::new();
            headers.insert(header::IF_NONE_MATCH, HeaderValue::from_static(value));
            is_none_match_hit(&headers, "\"abc\"")
        };
        assert!(hit("\"abc\"") && hit("W/\"abc\"") && hit("\"x\", \"abc\"") && hit("*"));
        assert!(!hit("\"abcd\"") && !hit("abc"));
    }
}
