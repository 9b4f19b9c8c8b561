//! `multipart/form-data` (RFC 7578), read as it arrives: memory holds one piece of the network's size, a delimiter, and
//! the bounded head of a part, never more.
//!
//! That bound is why this is not `multer`: it polls its source until nothing is ready, so a fast client makes it buffer
//! the whole upload, and it bounds neither a part's head nor what stands before the first part.

use axum::http::{HeaderMap, header};
use bytes::{Bytes, BytesMut};

use crate::http::body::{BodyReader, too_large};
use crate::http::problem::ApiError;

/// Longest boundary (RFC 2046).
const MAX_BOUNDARY: usize = 70;
/// Bytes of a part's header fields, and of what may stand before the first part.
const MAX_HEAD: usize = 4 << 10;

/// Position of the reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    BeforeFirst,
    Inside,
    BehindDelimiter,
    Ended,
}

/// Reads the parts of a body in their order.
pub(crate) struct Multipart {
    body: BodyReader,
    buffer: BytesMut,
    /// Line break, two hyphens, boundary.
    delimiter: Vec<u8>,
    place: Place,
}

impl Multipart {
    /// Fails where `Content-Type` states no usable boundary.
    pub(crate) fn new(headers: &HeaderMap, body: BodyReader) -> Result<Self, ApiError> {
        let boundary = headers
            .get(header::CONTENT_TYPE)
            .and_then(|value| value.to_str().ok())
            .and_then(|value| parameter(value, "boundary"))
            .filter(|boundary| (1..=MAX_BOUNDARY).contains(&boundary.len()));
        let Some(boundary) = boundary else {
            let detail = format!("Content-Type: multipart needs a boundary of 1 to {MAX_BOUNDARY} characters");
            return Err(ApiError::bad_request(detail));
        };
        let delimiter = format!("\r\n--{boundary}").into_bytes();
        // The first delimiter may stand at the very beginning, without a line break of its own.
        Ok(Self { body, buffer: BytesMut::from(&b"\r\n"[..]), delimiter, place: Place::BeforeFirst })
    }

    /// Skips what is left of the part before and reads the next one's head. Returns the name of its field; `None` after
    /// the last part.
    pub(crate) async fn next_part(&mut self) -> Result<Option<String>, ApiError> {
        match self.place {
            Place::Ended => return Ok(None),
            Place::BeforeFirst => {
                let delimiter = self.delimiter.clone();
                drop(self.take_through(&delimiter, "the first boundary").await?);
            }
            Place::Inside => while self.next_piece().await?.is_some() {},
            Place::BehindDelimiter => {}
        }
        self.place = Place::BehindDelimiter;
        while self.buffer.len() < 2 {
            self.fill().await?;
        }
        if self.buffer.starts_with(b"--") {
            self.place = Place::Ended;
            return Ok(None);
        }
        let line = self.take_through(b"\r\n", "the end of a boundary's line").await?;
        if !line.iter().all(u8::is_ascii_whitespace) {
            return Err(malformed("a boundary is followed by other text"));
        }
        let head = self.take_through(b"\r\n\r\n", "the end of a part's header fields").await?;
        self.place = Place::Inside;
        let nameless = || malformed("a part has no name; write Content-Disposition: form-data; name=\"...\"");
        name_of(&head).map(Some).ok_or_else(nameless)
    }

    /// The next bytes of this part; `None` at its end.
    pub(crate) async fn next_piece(&mut self) -> Result<Option<Bytes>, ApiError> {
        while self.place == Place::Inside {
            match find(&self.buffer, &self.delimiter) {
                Some(0) => {
                    drop(self.buffer.split_to(self.delimiter.len()));
                    self.place = Place::BehindDelimiter;
                }
                Some(at) => return Ok(Some(self.buffer.split_to(at).freeze())),
                None => {
                    // The end may be the beginning of a delimiter.
                    let safe = (self.buffer.len() + 1).saturating_sub(self.delimiter.len());
                    if safe > 0 {
                        return Ok(Some(self.buffer.split_to(safe).freeze()));
                    }
                    self.fill().await?;
                }
            }
        }
        Ok(None)
    }

    /// The rest of this part in memory; for small limits.
    pub(crate) async fn all(&mut self, field: &'static str, limit: usize) -> Result<Vec<u8>, ApiError> {
        let mut whole = Vec::new();
        while let Some(piece) = self.next_piece().await? {
            if whole.len() + piece.len() > limit {
                return Err(too_large(field, limit as u64));
            }
            whole.extend_from_slice(&piece);
        }
        Ok(whole)
    }

    /// Takes the buffer's beginning up to the end of `needle`, which must come within [`MAX_HEAD`] bytes.
    async fn take_through(&mut self, needle: &[u8], what: &str) -> Result<BytesMut, ApiError> {
        loop {
            match find(&self.buffer, needle) {
                Some(at) if at <= MAX_HEAD => return Ok(self.buffer.split_to(at + needle.len())),
                None if self.buffer.len() <= MAX_HEAD => self.fill().await?,
                _ => return Err(malformed(&format!("{what} does not come within {MAX_HEAD} bytes"))),
            }
        }
    }

    async fn fill(&mut self) -> Result<(), ApiError> {
        let piece = self.body.next().await?.ok_or_else(|| malformed("it ends before its last boundary"))?;
        self.buffer.extend_from_slice(&piece);
        Ok(())
    }
}

fn malformed(what: &str) -> ApiError {
    ApiError::bad_request(format!("body: not well-formed multipart/form-data: {what}"))
}

fn find(bytes: &[u8], needle: &[u8]) -> Option<usize> {
    let first = *needle.first()?;
    let mut from = 0;
    loop {
        let at = from + bytes[from..].iter().position(|byte| *byte == first)?;
        if bytes[at..].starts_with(needle) {
            return Some(at);
        }
        from = at + 1;
    }
}

/// `name` of a part's `Content-Disposition`.
fn name_of(head: &[u8]) -> Option<String> {
    let head = std::str::from_utf8(head).ok()?;
    let fields = head.split("\r\n").filter_map(|line| line.split_once(':'));
    let mut dispositions = fields.filter(|(name, _)| name.trim().eq_ignore_ascii_case("content-disposition"));
    parameter(dispositions.next()?.1, "name").map(str::to_owned)
}

/// A parameter of `value; a=b; c="d"`.
fn parameter<'a>(value: &'a str, wanted: &str) -> Option<&'a str> {
    let parameters = value.split(';').skip(1).filter_map(|pair| pair.split_once('='));
    let mut found = parameters.filter(|(name, _)| name.trim().eq_ignore_ascii_case(wanted));
    Some(found.next()?.1.trim().trim_matches('"'))
}

#[cfg(test)]
mod tests {
    use axum::body::Body;
    use axum::http::HeaderValue;

    use super::*;
    use crate::config::Timeouts;

    const TYPE: &str = "multipart/form-data; boundary=\"xYz\"";

    /// Reads a body that arrives in pieces of this size.
    async fn read(content_type: &'static str, text: &str, size: usize) -> Result<Vec<(String, Vec<u8>)>, ApiError> {
        let pieces: Vec<_> =
            text.as_bytes().chunks(size).map(|piece| Ok::<_, std::io::Error>(piece.to_vec())).collect();
        let body = Body::from_stream(futures_util::stream::iter(pieces));
        let headers = HeaderMap::from_iter([(header::CONTENT_TYPE, HeaderValue::from_static(content_type))]);
        let reader = BodyReader::new(body, &headers, "body", 1 << 20, Timeouts::default())?;
        let mut multipart = Multipart::new(&headers, reader)?;
        let mut parts = Vec::new();
        while let Some(name) = multipart.next_part().await? {
            parts.push((name, multipart.all("part", 1000).await?));
        }
        Ok(parts)
    }

    fn part(name: &str, content: &str) -> String {
        format!(
            "--xYz\r\nContent-Disposition: form-data; name=\"{name}\"; filename=\"a.glb\"\r\nX: y\r\n\r\n{content}\r\n"
        )
    }

    #[tokio::test]
    async fn parts_are_found_however_they_arrive() {
        let odd = "\r\n--xY\r\n-\r\r\n--x\r\n";
        let text = format!("{}{}{}--xYz--\r\nepilogue", part("scene", odd), part("view", "{}"), part("empty", ""));
        let expected =
            [("scene", odd), ("view", "{}"), ("empty", "")].map(|(n, c)| (n.to_owned(), c.as_bytes().to_vec()));
        for size in [1, 2, 3, 7, 64, 4096] {
            assert_eq!(read(TYPE, &text, size).await.expect("well formed"), expected, "pieces of {size}");
        }
        assert_eq!(read(TYPE, "--xYz--", 3).await.expect("no part"), []);
    }

    #[tokio::test]
    async fn what_is_malformed_or_too_long_is_refused() {
        let long = "a".repeat(MAX_HEAD + 100);
        for (text, word) in [
            (String::new(), "ends before"),
            (part("scene", "x"), "ends before"),
            (long.clone(), "first boundary"),
            ("--xYzz\r\n\r\n\r\n".into(), "other text"),
            ("--xYz\r\nX: y\r\n\r\nz\r\n--xYz--".into(), "no name"),
            (format!("--xYz\r\nX: {long}\r\n\r\nz\r\n--xYz--"), "header fields"),
            (part("scene", &long) + "--xYz--", "1000 bytes"),
        ] {
            for size in [5, 1 << 16] {
                let error = read(TYPE, &text, size).await.expect_err("refused");
                assert!(error.detail().contains(word), "{}", error.detail());
            }
        }
        for content_type in
            ["multipart/form-data", "multipart/form-data; boundary=", "multipart/form-data; boundary=\"\""]
        {
            assert!(read(content_type, "", 5).await.expect_err("refused").detail().contains("boundary"));
        }
    }
}
