//! The API description, OpenAPI 3.1.

use axum::Json;
use axum::extract::State;
use utoipa::OpenApi;

use crate::http::schema::describe_catalogue;
use crate::state::ServiceState;

#[derive(OpenApi)]
#[openapi(
    info(
        title = "surfelcast",
        description = "Path-traced glTF scenes, rendered on the server. Errors are application/problem+json."
    ),
    paths(
        crate::http::assets::index,
        crate::http::assets::asset,
        crate::http::assets::docs,
        crate::http::health::healthz,
        crate::http::health::readyz,
        crate::http::health::metrics_text,
        crate::http::health::version,
        crate::http::openapi::document,
        crate::http::scenes::list,
        crate::http::scenes::get,
        crate::http::scenes::upload,
        crate::http::scenes::delete,
        crate::http::renders::create,
        crate::http::renders::get,
        crate::http::renders::image,
        crate::http::renders::cancel,
        crate::http::renders::delete,
        crate::live::socket::stream,
    )
)]
pub(crate) struct ApiDoc;

/// This document.
#[utoipa::path(get, path = "/v1/openapi.json", tag = "operation", responses((status = 200, description = "OpenAPI 3.1")))]
pub(crate) async fn document(State(state): State<ServiceState>) -> Json<utoipa::openapi::OpenApi> {
    let mut api = ApiDoc::openapi();
    describe_catalogue(&mut api, &state.renderer_status().catalogue);
    Json(api)
}
