//! Where the bytes of a scene come from: the container, `data:` URIs and siblings of the main file.

use std::borrow::Cow;
use std::io::Read;

use base64::Engine as _;
use cap_std::fs::Dir;
use sha2::{Digest, Sha256};

use super::check::{clip, invalid, within};
use crate::{SceneError, SceneLimits};

/// Main file split into its chunks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Container<'a> {
    /// The JSON chunk, or the whole file where it is not a GLB.
    pub(crate) json: &'a [u8],
    /// The binary chunk of a GLB.
    pub(crate) binary: Option<&'a [u8]>,
}

impl<'a> Container<'a> {
    /// Splits a GLB; anything that does not start with its magic is taken for JSON.
    pub(crate) fn split(bytes: &'a [u8]) -> Result<Self, SceneError> {
        if !bytes.starts_with(b"glTF") {
            let first = bytes.iter().find(|byte| !byte.is_ascii_whitespace());
            if first != Some(&b'{') {
                return Err(invalid("file", "is neither a GLB (magic glTF) nor a glTF JSON object"));
            }
            return Ok(Self { json: bytes, binary: None });
        }
        let word = |offset: usize| -> Option<u32> {
            let four = bytes.get(offset..offset.checked_add(4)?)?;
            Some(u32::from_le_bytes(four.try_into().ok()?))
        };
        let (Some(version), Some(length)) = (word(4), word(8)) else {
            return Err(invalid("GLB header", "is cut off"));
        };
        if version != 2 {
            return Err(invalid("GLB header.version", format!("is {version}; only 2 is supported")));
        }
        if length as usize > bytes.len() {
            return Err(invalid("GLB header.length", format!("is {length}, but the file has {} bytes", bytes.len())));
        }
        let mut container = Self { json: &[], binary: None };
        let (mut offset, mut chunk) = (12usize, 0);
        while offset < length as usize {
            let (Some(chunk_length), Some(kind)) = (word(offset), word(offset + 4)) else {
                return Err(invalid(format!("GLB chunk {chunk}"), "header is cut off"));
            };
            let start = offset + 8;
            let end = start.checked_add(chunk_length as usize).filter(|end| *end <= length as usize);
            let Some(end) = end else {
                return Err(invalid(format!("GLB chunk {chunk}.length"), format!("{chunk_length} runs past the file")));
            };
            match (chunk, kind) {
                (0, 0x4E4F_534A) => container.json = &bytes[start..end],
                (0, _) => return Err(invalid("GLB chunk 0", "is not the JSON chunk")),
                (1, 0x004E_4942) => container.binary = Some(&bytes[start..end]),
                _ => {} // the specification tells readers to skip chunks they do not know
            }
            offset = end.div_ceil(4) * 4;
            chunk += 1;
        }
        Ok(container)
    }
}

/// Opens what the JSON refers to, within a byte budget, and hashes all of it.
pub(crate) struct Source {
    directory: Option<Dir>,
    bytes_left: u64,
    limit: u64,
    /// Hash of everything read so far.
    pub(crate) hasher: Sha256,
}

impl Source {
    /// A source whose siblings are looked for in `directory`; without one only `data:` URIs are served.
    pub(crate) fn new(main: &[u8], directory: Option<Dir>, limits: &SceneLimits) -> Result<Self, SceneError> {
        within("file bytes", main.len() as u64, limits.max_file_bytes)?;
        let mut hasher = Sha256::new();
        hasher.update((main.len() as u64).to_le_bytes());
        hasher.update(main);
        let bytes_left = limits.max_file_bytes - main.len() as u64;
        Ok(Self { directory, bytes_left, limit: limits.max_file_bytes, hasher })
    }

    /// Bytes behind a URI. `field` is for messages.
    pub(crate) fn resolve(&mut self, uri: &str, field: &str) -> Result<Vec<u8>, SceneError> {
        let bytes = if uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:")) {
            self.charge(uri.len() as u64 / 4 * 3, field)?;
            decode_data_uri(uri, field)?
        } else {
            self.read_sibling(uri, field)?
        };
        self.hasher.update((bytes.len() as u64).to_le_bytes());
        self.hasher.update(&bytes);
        Ok(bytes)
    }

    fn charge(&mut self, bytes: u64, field: &str) -> Result<(), SceneError> {
        match self.bytes_left.checked_sub(bytes) {
            Some(left) => {
                self.bytes_left = left;
                Ok(())
            }
            None => Err(SceneError::TooLarge {
                field: format!("bytes of the file and its siblings (at {field})"),
                value: self.limit.saturating_sub(self.bytes_left).saturating_add(bytes),
                limit: self.limit,
            }),
        }
    }

    fn read_sibling(&mut self, uri: &str, field: &str) -> Result<Vec<u8>, SceneError> {
        let name = sibling_path(uri).map_err(|problem| invalid(field, format!("{:?} {problem}", clip(uri))))?;
        let Some(directory) = &self.directory else {
            return Err(invalid(field, format!("{:?} is outside the upload; embed it or use GLB", clip(uri))));
        };
        let read_error = |source| SceneError::Read { path: clip(&name), source };
        // cap-std resolves every component inside the directory, so a symbolic link cannot lead out of it.
        let file = directory.open(&name).map_err(read_error)?;
        let metadata = file.metadata().map_err(read_error)?;
        if !metadata.is_file() {
            return Err(invalid(field, format!("{:?} is not a regular file", clip(uri))));
        }
        let length = metadata.len();
        self.charge(length, field)?;
        let mut bytes = Vec::new();
        file.take(length).read_to_end(&mut bytes).map_err(read_error)?;
        Ok(bytes)
    }
}

/// Checks that a URI names a file in the scene's folder or below it, and decodes it.
fn sibling_path(uri: &str) -> Result<String, &'static str> {
    let name = percent_decode(uri).ok_or("has a broken percent escape")?;
    if name.is_empty() {
        return Err("is empty");
    }
    if name.contains(['\0', '\\', ':', '?', '#']) || name.chars().any(char::is_control) {
        return Err("is not a plain relative path; schemes, drives, queries and backslashes are refused");
    }
    if name.starts_with('/') {
        return Err("is absolute; only files beside the scene are read");
    }
    if name.split('/').any(|part| part == "..") {
        return Err("leaves the scene's folder");
    }
    Ok(name)
}

/// Decodes `%xx`; `None` where an escape is broken, is not UTF-8, or hides a separator.
fn percent_decode(text: &str) -> Option<String> {
    let (mut bytes, mut out) = (text.bytes(), Vec::with_capacity(text.len()));
    while let Some(byte) = bytes.next() {
        if byte != b'%' {
            out.push(byte);
            continue;
        }
        let high = char::from(bytes.next()?).to_digit(16)?;
        let low = char::from(bytes.next()?).to_digit(16)?;
        let decoded = (high * 16 + low) as u8;
        // An escaped separator, dot or percent sign is only ever written to get past a check.
        if matches!(decoded, b'/' | b'\\' | b'.' | b'%' | b'\0' | b':') {
            return None;
        }
        out.push(decoded);
    }
    String::from_utf8(out).ok()
}

fn decode_data_uri(uri: &str, field: &str) -> Result<Vec<u8>, SceneError> {
    let Some((header, payload)) = uri.split_once(',') else {
        return Err(invalid(field, "is a data: URI without a comma"));
    };
    if !header.to_ascii_lowercase().ends_with(";base64") {
        return Err(invalid(field, "is a data: URI that is not base64"));
    }
    let engine = base64::engine::GeneralPurpose::new(
        &base64::alphabet::STANDARD,
        base64::engine::GeneralPurposeConfig::new()
            .with_decode_padding_mode(base64::engine::DecodePaddingMode::Indifferent),
    );
    engine.decode(payload).map_err(|error| invalid(field, format!("is not base64: {error}")))
}

/// The byte range `[offset, offset + length)` of a slice, with checked arithmetic.
pub(crate) fn range(bytes: &[u8], offset: u64, length: u64) -> Option<&[u8]> {
    let start = usize::try_from(offset).ok()?;
    let end = start.checked_add(usize::try_from(length).ok()?)?;
    bytes.get(start..end)
}

/// Loads every buffer. The first one without a URI is the GLB's binary chunk.
pub(crate) fn load_buffers<'a>(
    buffers: &[super::document::Buffer],
    container: &Container<'a>,
    source: &mut Source,
) -> Result<Vec<Cow<'a, [u8]>>, SceneError> {
    let mut loaded = Vec::new();
    for (index, buffer) in buffers.iter().enumerate() {
        let field = format!("buffers[{index}]");
        let bytes: Cow<'a, [u8]> = match &buffer.uri {
            Some(uri) => Cow::Owned(source.resolve(uri, &format!("{field}.uri"))?),
            None if index == 0 && container.binary.is_some() => Cow::Borrowed(container.binary.unwrap_or_default()),
            None => return Err(invalid(field, "has neither a uri nor a GLB binary chunk")),
        };
        if buffer.byte_length > bytes.len() as u64 {
            return Err(invalid(
                format!("{field}.byteLength"),
                format!("is {}, but there are {} bytes", buffer.byte_length, bytes.len()),
            ));
        }
        loaded.push(bytes);
    }
    Ok(loaded)
}
