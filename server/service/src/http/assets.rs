//! The browser client, embedded at compile time. A path is a key of a table and never reaches a file system.
//!
//! The files are compressed once, at the first use, and not for each answer; so each coding has an entity tag of its
//! own.

use std::collections::HashMap;
use std::io::Write;
use std::sync::LazyLock;

use axum::extract::Path;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use flate2::Compression;
use flate2::write::GzEncoder;
use rust_embed::{Embed, EmbeddedFile};

use crate::http::negotiate::{accepts_gzip, is_none_match_hit};
use crate::http::problem::ApiError;

#[derive(Embed)]
#[folder = "../../web-client"]
#[exclude = "node_modules/*"]
#[exclude = "tests/*"]
#[exclude = "package.json"]
#[exclude = "package-lock.json"]
#[exclude = "tsconfig*.json"]
#[exclude = "*.md"]
#[exclude = "*.d.ts"]
struct WebClient;

/// The page.
#[utoipa::path(get, path = "/", tag = "client", responses((status = 200, description = "The browser client")))]
pub(crate) async fn index(headers: HeaderMap) -> Response {
    serve("index.html", &headers)
}

/// The readable page on this API.
#[utoipa::path(get, path = "/docs", tag = "client", responses((status = 200, description = "API documentation")))]
pub(crate) async fn docs(headers: HeaderMap) -> Response {
    serve("docs.html", &headers)
}

/// A file of the browser client.
#[utoipa::path(get, path = "/assets/{path}", tag = "client",
    params(("path" = String, Path, description = "Path inside the client")),
    responses((status = 200, description = "The file"), (status = 304, description = "If-None-Match holds"),
        (status = 404, description = "No such file")))]
pub(crate) async fn asset(Path(path): Path<String>, headers: HeaderMap) -> Response {
    serve(&path, &headers)
}

fn serve(path: &str, headers: &HeaderMap) -> Response {
    match WebClient::get(path) {
        Some(file) => answer(path, file, headers),
        None => ApiError::not_found("path: the browser client has no such file").into_response(),
    }
}

fn answer(path: &str, file: EmbeddedFile, headers: &HeaderMap) -> Response {
    let media_type = media_type_of(&file);
    let compressed = if accepts_gzip(headers) { compressed_files().get(path) } else { None };
    let digest = hex::encode(file.metadata.sha256_hash());
    // The compressed file is another representation, so it has another tag.
    let coding = if compressed.is_some() { "-gzip" } else { "" };
    let etag = format!("\"{}{coding}\"", digest.get(..32).unwrap_or_default());
    let mut response = if is_none_match_hit(headers, &etag) {
        StatusCode::NOT_MODIFIED.into_response()
    } else if let Some(compressed) = compressed {
        let fields = [(header::CONTENT_TYPE, media_type), (header::CONTENT_ENCODING, "gzip".into())];
        (fields, compressed.clone()).into_response()
    } else {
        ([(header::CONTENT_TYPE, media_type)], file.data).into_response()
    };
    let fields = response.headers_mut();
    // Browsers revalidate it at every use: an old client must not talk to an upgraded server.
    fields.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-cache"));
    if compressed_files().contains_key(path) {
        fields.append(header::VARY, HeaderValue::from_static("Accept-Encoding"));
    }
    if let Ok(etag) = HeaderValue::from_str(&etag) {
        fields.insert(header::ETAG, etag);
    }
    response
}

/// The files that gzip makes smaller.
fn compressed_files() -> &'static HashMap<String, Bytes> {
    static FILES: LazyLock<HashMap<String, Bytes>> = LazyLock::new(|| {
        let compress = |path: &str| {
            let file = WebClient::get(path).filter(|file| is_text(file.metadata.mimetype()))?;
            let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
            encoder.write_all(&file.data).ok()?;
            encoder.finish().ok().filter(|compressed| compressed.len() < file.data.len()).map(Bytes::from)
        };
        WebClient::iter().filter_map(|path| Some((path.to_string(), compress(&path)?))).collect()
    });
    &FILES
}

fn is_text(media_type: &str) -> bool {
    media_type.starts_with("text/")
        || ["application/json", "application/manifest+json", "image/svg+xml"].contains(&media_type)
}

/// The media type, with the encoding of text: all our files are UTF-8.
fn media_type_of(file: &EmbeddedFile) -> String {
    let media_type = file.metadata.mimetype();
    let charset = if media_type.starts_with("text/") { "; charset=utf-8" } else { "" };
    format!("{media_type}{charset}")
}
