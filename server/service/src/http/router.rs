//! The table of all routes.

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::http::{Method, StatusCode, header};
use axum::middleware::from_fn_with_state;
use axum::response::{IntoResponse, Response};
use axum::routing::{MethodRouter, get, post};

use crate::http::problem::ApiError;
use crate::http::{assets, guard, health, openapi, renders, scenes};
use crate::live::socket;
use crate::state::ServiceState;

/// A path, the methods it answers, and its handlers. The path is in OpenAPI's notation.
pub(crate) struct Route {
    pub(crate) path: &'static str,
    pub(crate) methods: &'static [Method],
    handlers: MethodRouter<ServiceState>,
}

/// Every route of the service. A test holds this table and the API description together.
pub(crate) fn routes() -> Vec<Route> {
    let route = |path, methods, handlers| Route { path, methods, handlers };
    vec![
        route("/", &[Method::GET], get(assets::index)),
        route("/assets/{path}", &[Method::GET], get(assets::asset)),
        route("/docs", &[Method::GET], get(assets::docs)),
        route("/healthz", &[Method::GET], get(health::healthz)),
        route("/readyz", &[Method::GET], get(health::readyz)),
        route("/metrics", &[Method::GET], get(health::metrics_text)),
        route("/version", &[Method::GET], get(health::version)),
        route("/v1/openapi.json", &[Method::GET], get(openapi::document)),
        route("/v1/scenes", &[Method::GET, Method::POST], get(scenes::list).post(scenes::upload)),
        route("/v1/scenes/{id}", &[Method::GET, Method::DELETE], get(scenes::get).delete(scenes::delete)),
        route("/v1/renders", &[Method::POST], post(renders::create)),
        route("/v1/renders/{id}", &[Method::GET, Method::DELETE], get(renders::get).delete(renders::delete)),
        route("/v1/renders/{id}/image", &[Method::GET], get(renders::image)),
        route("/v1/renders/{id}/cancel", &[Method::POST], post(renders::cancel)),
        route("/v1/sessions/{id}/stream", &[Method::GET], get(socket::stream)),
    ]
}

/// The service without a socket, for [`crate::run`] and for tests by `oneshot`.
pub fn router(state: ServiceState) -> Router {
    let mut app = Router::new();
    for route in routes() {
        // A file's path may have several segments.
        let path = route.path.replace("/assets/{path}", "/assets/{*path}");
        app = app.route(&path, route.handlers.fallback(move || std::future::ready(wrong_method(route.methods))));
    }
    app.fallback(not_found)
        // Handlers read bodies themselves, each with its own cap and rate floor.
        .layer(DefaultBodyLimit::disable())
        .layer(from_fn_with_state(state.clone(), guard::guard))
        .with_state(state)
}

async fn not_found() -> Response {
    ApiError::not_found("path: nothing is served here; /docs lists what is").into_response()
}

fn wrong_method(methods: &'static [Method]) -> Response {
    let allowed = methods.iter().map(Method::as_str).collect::<Vec<_>>().join(", ");
    let detail = format!("method: this path answers {allowed}");
    let error = ApiError::new(StatusCode::METHOD_NOT_ALLOWED, "method_not_allowed", detail);
    ([(header::ALLOW, allowed)], error).into_response()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use utoipa::OpenApi;

    use super::*;

    #[test]
    fn the_api_description_and_the_routes_agree() {
        let served: BTreeSet<(String, String)> = routes()
            .iter()
            .flat_map(|route| route.methods.iter().map(|method| (method.to_string(), route.path.to_owned())))
            .collect();
        let document = serde_json::to_value(openapi::ApiDoc::openapi()).expect("JSON");
        assert!(document["openapi"].as_str().is_some_and(|version| version.starts_with("3.1")));
        let paths = document["paths"].as_object().expect("paths");
        let described: BTreeSet<(String, String)> = paths
            .iter()
            .flat_map(|(path, item)| {
                let methods = item.as_object().expect("an item").keys();
                methods.map(|method| (method.to_uppercase(), path.clone())).collect::<Vec<_>>()
            })
            .collect();
        assert_eq!(served, described);
    }
}
