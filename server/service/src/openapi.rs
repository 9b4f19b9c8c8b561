//! The API description, OpenAPI 3.1.

use axum::Json;
use utoipa::OpenApi;

#[derive(OpenApi)]
#[openapi(
    info(
        title = "surfelcast",
        description = "Path-traced glTF scenes, rendered on the server. Errors are application/problem+json."
    ),
    paths(
        crate::assets::index,
        crate::assets::asset,
        crate::assets::docs,
        crate::health::healthz,
        crate::health::readyz,
        crate::health::metrics_text,
        crate::health::version,
        crate::openapi::document,
        crate::scenes::list,
        crate::scenes::get,
        crate::scenes::upload,
        crate::scenes::delete,
        crate::renders::create,
        crate::renders::get,
        crate::renders::image,
        crate::renders::cancel,
        crate::renders::delete,
        crate::socket::stream,
    )
)]
pub(crate) struct ApiDoc;

/// This document.
#[utoipa::path(get, path = "/v1/openapi.json", tag = "operation", responses((status = 200, description = "OpenAPI 3.1")))]
pub(crate) async fn document() -> Json<utoipa::openapi::OpenApi> {
    Json(ApiDoc::openapi())
}
