//! HTTP: `/v1/scenes`.

use std::sync::Arc;

use axum::Json;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use tokio::io::AsyncWriteExt;
use utoipa::ToSchema;

use crate::http::body::{BodyReader, media_type};
use crate::http::multipart::Multipart;
use crate::http::problem::ApiError;
use crate::scene_library::SceneEntry;
use crate::state::ServiceState;

/// Media types of uploads.
const ACCEPTED: [&str; 2] = ["model/gltf-binary", "model/gltf+json"];

/// Media type of uploads with a view JSON.
const FORM: &str = "multipart/form-data";

/// A scene of this server.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct SceneInfo {
    /// `sha256:` and 64 hex digits over the content.
    id: String,
    /// For people.
    name: String,
    /// Triangles, instances not multiplied.
    triangle_count: u32,
    /// Session id for `/v1/sessions/{id}/stream`.
    session: String,
    /// Camera names for `camera_name`.
    cameras: Vec<String>,
    /// What was ignored or repaired at import.
    warnings: Vec<String>,
    /// Whether it came with the server's start and cannot be deleted.
    builtin: bool,
}

/// All scenes.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct SceneList {
    /// Built-in ones first; the first is the page's default.
    scenes: Vec<SceneInfo>,
}

impl SceneInfo {
    fn of(entry: &Arc<SceneEntry>) -> Self {
        let record = &entry.record;
        Self {
            id: record.id.clone(),
            name: record.name.clone(),
            triangle_count: record.triangle_count,
            session: entry.session.to_string(),
            cameras: record.cameras.clone(),
            warnings: record.warnings.clone(),
            builtin: entry.is_builtin(),
        }
    }
}

/// Lists all scenes.
#[utoipa::path(get, path = "/v1/scenes", tag = "scenes", responses((status = 200, body = SceneList)))]
pub(crate) async fn list(State(state): State<ServiceState>) -> Json<SceneList> {
    Json(SceneList { scenes: state.scenes().list().iter().map(SceneInfo::of).collect() })
}

/// Describes one scene.
#[utoipa::path(get, path = "/v1/scenes/{id}", tag = "scenes", params(("id" = String, Path, description = "Scene id")),
    responses((status = 200, body = SceneInfo), (status = 404, description = "No such scene")))]
pub(crate) async fn get(
    State(state): State<ServiceState>,
    Path(id): Path<String>,
) -> Result<Json<SceneInfo>, ApiError> {
    let entry = state.scenes().get(&id)?;
    Ok(Json(SceneInfo::of(&entry)))
}

/// An upload with a view JSON.
#[derive(ToSchema)]
#[expect(dead_code, reason = "describes the form; its parts are read as they arrive")]
pub(crate) struct SceneForm {
    /// GLB, or glTF JSON whose buffers and images are `data:` URIs.
    #[schema(value_type = String, format = Binary)]
    scene: Vec<u8>,
    /// View JSON: cameras, environment, exposure, pose.
    view: Option<String>,
}

/// Uploads a scene, alone or in a form together with its view JSON. The same content always gets the same id.
#[utoipa::path(post, path = "/v1/scenes", tag = "scenes",
    params(("name" = Option<String>, Query, description = "Name for people")),
    request_body(content(
        (Vec<u8> = "model/gltf-binary"), (Vec<u8> = "model/gltf+json"), (SceneForm = "multipart/form-data"))),
    responses(
        (status = 201, body = SceneInfo, description = "Stored"),
        (status = 200, body = SceneInfo, description = "Was stored already"),
        (status = 400, description = "Malformed, or a part of the form is missing, unknown or there twice"),
        (status = 413, description = "Larger than the limit"),
        (status = 415, description = "Neither glTF nor a form"),
        (status = 422, description = "Not a valid or supported scene; the detail names the field"),
        (status = 507, description = "The store is full")))]
pub(crate) async fn upload(
    State(state): State<ServiceState>,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, ApiError> {
    let mime = media_type(&headers).unwrap_or_default();
    let is_form = mime == FORM;
    if !is_form && !ACCEPTED.contains(&mime.as_str()) {
        let detail = format!("Content-Type: must be {}, {FORM}", ACCEPTED.join(", "));
        return Err(ApiError::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "unsupported_media_type", detail));
    }
    if headers.get(header::CONTENT_ENCODING).is_some_and(|value| value != "identity") {
        let detail = "Content-Encoding: compressed uploads are not accepted; send the file as it is";
        return Err(ApiError::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "unsupported_media_type", detail));
    }
    if state.draining().is_cancelled() {
        return Err(ApiError::draining());
    }
    let Ok(_permit) = state.uploads().try_acquire() else {
        let limit = state.config().bounds.uploads;
        let detail = format!("{limit} uploads are in progress already; try again later");
        return Err(ApiError::new(StatusCode::TOO_MANY_REQUESTS, "uploads_busy", detail).retry_after(5));
    };
    let config = state.config();
    let mut reader = BodyReader::new(body, &headers, "body", config.bounds.upload_bytes, config.timeouts)?;
    // Deleted on every path out of here unless the library takes it.
    let file = state.scenes().new_upload()?;
    let handle = file.as_file().try_clone().map_err(|e| ApiError::internal(&e))?;
    let mut writer = tokio::fs::File::from_std(handle);
    let view = if is_form {
        read_form(Multipart::new(&headers, reader)?, &mut writer, config.bounds.json_bytes).await?
    } else {
        while let Some(piece) = reader.next().await? {
            writer.write_all(&piece).await.map_err(|e| ApiError::internal(&e))?;
        }
        None
    };
    writer.sync_all().await.map_err(|e| ApiError::internal(&e))?;
    drop(writer);
    let name = query_value(&uri, "name").unwrap_or_default();
    let (entry, is_new) = state.scenes().import(file, view, &name).await?;
    let status = if is_new { StatusCode::CREATED } else { StatusCode::OK };
    let location = format!("/v1/scenes/{}", entry.record.id);
    Ok((status, [(header::LOCATION, location)], Json(SceneInfo::of(&entry))).into_response())
}

/// Writes the part `scene` to the file and returns the part `view`; each may occur once, in any order.
async fn read_form(
    mut form: Multipart,
    writer: &mut tokio::fs::File,
    view_bytes: usize,
) -> Result<Option<String>, ApiError> {
    let (mut has_scene, mut view) = (false, None);
    while let Some(name) = form.next_part().await? {
        match name.as_str() {
            "scene" if !has_scene => {
                has_scene = true;
                while let Some(piece) = form.next_piece().await? {
                    writer.write_all(&piece).await.map_err(|e| ApiError::internal(&e))?;
                }
            }
            "view" if view.is_none() => {
                let json = form.all("view", view_bytes).await?;
                view = Some(String::from_utf8(json).map_err(|_| ApiError::bad_request("view: not UTF-8"))?);
            }
            _ => return Err(ApiError::bad_request("body: the form may have one part `scene` and one part `view`")),
        }
    }
    if !has_scene {
        return Err(ApiError::bad_request("scene: this part of the form is missing"));
    }
    Ok(view)
}

/// Deletes an uploaded scene that nobody is looking at.
#[utoipa::path(delete, path = "/v1/scenes/{id}", tag = "scenes",
    params(("id" = String, Path, description = "Scene id")),
    responses((status = 204, description = "Deleted"), (status = 404, description = "No such scene"),
        (status = 409, description = "In use, or built in")))]
pub(crate) async fn delete(State(state): State<ServiceState>, Path(id): Path<String>) -> Result<StatusCode, ApiError> {
    let entry = state.scenes().get(&id)?;
    if state.sessions().has_members(&entry.session) {
        let detail = "scene: someone is looking at it; close those views first";
        return Err(ApiError::new(StatusCode::CONFLICT, "scene_in_use", detail));
    }
    state.scenes().delete(&id)?;
    state.sessions().end(&entry.session).await;
    Ok(StatusCode::NO_CONTENT)
}

/// A value of the query string, percent-decoded.
fn query_value(uri: &Uri, name: &str) -> Option<String> {
    let pair = uri.query()?.split('&').find_map(|pair| pair.split_once('=').filter(|(key, _)| *key == name))?;
    let mut bytes = Vec::with_capacity(pair.1.len());
    let mut rest = pair.1.bytes();
    while let Some(byte) = rest.next() {
        match byte {
            b'+' => bytes.push(b' '),
            b'%' => {
                let digit = |b: Option<u8>| char::from(b?).to_digit(16);
                bytes.push((digit(rest.next())? * 16 + digit(rest.next())?) as u8);
            }
            _ => bytes.push(byte),
        }
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_percent_decoded() {
        let name = |uri: &'static str| query_value(&Uri::from_static(uri), "name");
        assert_eq!(name("/v1/scenes?name=a%20b+c").as_deref(), Some("a b c"));
        assert_eq!(name("/v1/scenes?x=1&name=%C3%A4").as_deref(), Some("\u{e4}"));
        for bad in ["/v1/scenes", "/v1/scenes?name=%", "/v1/scenes?name=%zz", "/v1/scenes?name=%ff"] {
            assert_eq!(query_value(&bad.parse().expect("a URI"), "name"), None, "{bad}");
        }
    }
}
