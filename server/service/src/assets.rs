//! The browser client, embedded at compile time. Paths are keys of a table, never of a file system.

use axum::extract::Path;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use rust_embed::{Embed, EmbeddedFile};

use crate::negotiate::is_none_match_hit;
use crate::problem::ApiError;

#[derive(Embed)]
#[folder = "../../web-client"]
#[exclude = "node_modules/*"]
#[exclude = "tests/*"]
#[exclude = "package.json"]
#[exclude = "package-lock.json"]
#[exclude = "tsconfig*.json"]
#[exclude = "*.md"]
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
    let digest = hex::encode(file.metadata.sha256_hash());
    let etag = format!("\"{}\"", digest.get(..32).unwrap_or_default());
    let mut response = if is_none_match_hit(headers, &etag) {
        StatusCode::NOT_MODIFIED.into_response()
    } else {
        ([(header::CONTENT_TYPE, media_type_of(path))], file.data).into_response()
    };
    let fields = response.headers_mut();
    // Revalidated on every use: an upgraded server must not be met by an old client.
    fields.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-cache"));
    if let Ok(etag) = HeaderValue::from_str(&etag) {
        fields.insert(header::ETAG, etag);
    }
    response
}

fn media_type_of(path: &str) -> &'static str {
    match path.rsplit('.').next().unwrap_or_default() {
        "html" => "text/html; charset=utf-8",
        "js" | "mjs" => "text/javascript; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "json" => "application/json",
        "svg" => "image/svg+xml",
        "png" => "image/png",
        "webp" => "image/webp",
        "ico" => "image/x-icon",
        "woff2" => "font/woff2",
        "webmanifest" => "application/manifest+json",
        _ => "application/octet-stream",
    }
}
