//! Checks of `Host` and `Origin` on every request, and the security headers of every answer.
//!
//! A browser sends no secret to this server, so these two headers are what keeps a hostile page from controlling a
//! server on the user's own machine: the check of `Host` defeats DNS names rebound to its address, that of `Origin`
//! cross-site requests, WebSocket upgrades included (browsers apply no same-origin policy to them).

use std::net::{IpAddr, SocketAddr};

use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::config::ServiceConfig;
use crate::http::cors;
use crate::http::problem::ApiError;
use crate::state::ServiceState;

/// Refuses foreign hosts and origins, and adds the security headers to every answer.
pub(crate) async fn guard(State(state): State<ServiceState>, request: Request, next: Next) -> Response {
    let checked = check(state.config(), state.local_addr(), request.method(), request.headers());
    let origin = cors::listed_origin(state.config(), request.headers());
    let is_preflight = origin.is_some() && cors::is_preflight(request.method(), request.headers());
    let mut response = match checked {
        Ok(()) if is_preflight => cors::preflight(),
        Ok(()) => next.run(request).await,
        Err(error) => error.into_response(),
    };
    let headers = response.headers_mut();
    cors::allow(origin, headers);
    let mut set = |name: HeaderName, value: HeaderValue| {
        headers.entry(name).or_insert(value);
    };
    set(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    set(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    set(HeaderName::from_static("cross-origin-resource-policy"), HeaderValue::from_static("same-origin"));
    set(header::CONTENT_SECURITY_POLICY, state.csp().clone());
    response
}

fn check(config: &ServiceConfig, local: SocketAddr, method: &Method, headers: &HeaderMap) -> Result<(), ApiError> {
    let forbidden = |code, detail: String| Err(ApiError::new(StatusCode::FORBIDDEN, code, detail));
    let Some(host) = single(headers, &header::HOST)? else {
        return Err(ApiError::bad_request("Host: the header is missing"));
    };
    let Some(name) = host_name(host) else {
        return Err(ApiError::bad_request("Host: not a host name with an optional port"));
    };
    if !is_host_allowed(config, local, name) {
        let detail = format!("Host: `{name}` is not among the hosts of this server; start it with this name allowed");
        return forbidden("host_not_allowed", detail);
    }
    let is_upgrade = headers.contains_key(header::UPGRADE) && *method == Method::GET;
    match single(headers, &header::ORIGIN)? {
        Some(origin) if is_origin_allowed(config, origin, host) => Ok(()),
        Some(_) => {
            let detail = "Origin: pages of this origin may not use this server; start it with the origin allowed";
            forbidden("origin_not_allowed", detail.into())
        }
        None if is_upgrade && !local.ip().is_loopback() && !config.allow_missing_origin => {
            let detail = "Origin: missing; this server is reachable from the network and accepts WebSocket upgrades \
                          without Origin only when started so";
            forbidden("origin_missing", detail.into())
        }
        None => Ok(()),
    }
}

/// The value of a header that a request may carry only once.
fn single<'a>(headers: &'a HeaderMap, name: &HeaderName) -> Result<Option<&'a str>, ApiError> {
    let mut values = headers.get_all(name).iter();
    let first = values.next();
    if values.next().is_some() {
        return Err(ApiError::bad_request(format!("{name}: the header stands more than once")));
    }
    first.map(HeaderValue::to_str).transpose().map_err(|_| ApiError::bad_request(format!("{name}: not ASCII")))
}

/// The name of `name:port` or `[v6]:port`, or `None` where it is neither.
fn host_name(host: &str) -> Option<&str> {
    let (name, port) = match host.strip_prefix('[') {
        Some(rest) => {
            let (address, rest) = rest.split_once(']')?;
            (address, if rest.is_empty() { None } else { Some(rest.strip_prefix(':')?) })
        }
        None => host.split_once(':').map_or((host, None), |(name, port)| (name, Some(port))),
    };
    let is_name_plain = !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b"-._:".contains(&b));
    let is_port_plain = port.is_none_or(|port| port.parse::<u16>().is_ok());
    (is_name_plain && is_port_plain).then_some(name)
}

fn is_host_allowed(config: &ServiceConfig, local: SocketAddr, name: &str) -> bool {
    if config.hosts.iter().any(|allowed| allowed == "*" || allowed.eq_ignore_ascii_case(name)) {
        return true;
    }
    // A page cannot rebind `localhost` or an IP address, only names it controls.
    match name.parse::<IpAddr>() {
        Ok(address) => address.is_loopback() || !local.ip().is_loopback(),
        Err(_) => name.eq_ignore_ascii_case("localhost"),
    }
}

fn is_origin_allowed(config: &ServiceConfig, origin: &str, host: &str) -> bool {
    // TLS may end at a proxy, so only host and port are compared, not the scheme.
    let own = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"));
    cors::is_listed(config, origin) || own.is_some_and(|own| own.eq_ignore_ascii_case(host))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(bind: &str, edit: impl Fn(&mut ServiceConfig), headers: &[(&str, &str)]) -> Result<(), u16> {
        let mut config = ServiceConfig::new("/nowhere", "test");
        edit(&mut config);
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            let name = HeaderName::from_bytes(name.as_bytes()).expect("a name");
            map.append(name, HeaderValue::from_str(value).expect("a value"));
        }
        let bind = bind.parse().expect("an address");
        check(&config, bind, &Method::GET, &map).map_err(|e| e.status().as_u16())
    }

    const LOOPBACK: &str = "127.0.0.1:8080";
    const PUBLIC: &str = "0.0.0.0:8080";

    #[test]
    fn hosts() {
        let none = |_: &mut ServiceConfig| {};
        for host in ["localhost:8080", "127.0.0.1:8080", "[::1]:8080", "LOCALHOST", "127.0.0.1"] {
            assert_eq!(verdict(LOOPBACK, none, &[("host", host)]), Ok(()), "{host}");
        }
        for host in ["evil.example", "localhost.evil.example", "127.0.0.1.evil.example:8080", "192.168.1.5:8080"] {
            assert_eq!(verdict(LOOPBACK, none, &[("host", host)]), Err(403), "{host}");
        }
        assert_eq!(verdict(PUBLIC, none, &[("host", "192.168.1.5:8080")]), Ok(()));
        assert_eq!(verdict(PUBLIC, none, &[("host", "render.example")]), Err(403));
        let named = |c: &mut ServiceConfig| c.hosts.push("render.example".into());
        assert_eq!(verdict(PUBLIC, named, &[("host", "Render.Example:443")]), Ok(()));
        for host in ["", "a b", "a:b", "[::1", "a:99999", "a/b", "a@b"] {
            assert_eq!(verdict(LOOPBACK, none, &[("host", host)]), Err(400), "{host}");
        }
        assert_eq!(verdict(LOOPBACK, none, &[]), Err(400));
        assert_eq!(verdict(LOOPBACK, none, &[("host", "localhost"), ("host", "localhost")]), Err(400));
    }

    #[test]
    fn origins() {
        let none = |_: &mut ServiceConfig| {};
        let host = ("host", "localhost:8080");
        let with = |origin| [host, ("origin", origin)];
        assert_eq!(verdict(LOOPBACK, none, &with("http://localhost:8080")), Ok(()));
        for origin in ["http://evil.example", "null", "http://localhost:9090", "http://localhost:8080.evil.example", ""]
        {
            assert_eq!(verdict(LOOPBACK, none, &with(origin)), Err(403), "{origin}");
        }
        let listed = |c: &mut ServiceConfig| c.origins.push("https://app.example/".into());
        assert_eq!(verdict(LOOPBACK, listed, &with("https://app.example")), Ok(()));
        assert_eq!(verdict(LOOPBACK, listed, &with("http://app.example")), Err(403));
    }

    #[test]
    fn upgrades_without_origin() {
        let none = |_: &mut ServiceConfig| {};
        let headers = [("host", "127.0.0.1:8080"), ("upgrade", "websocket")];
        assert_eq!(verdict(LOOPBACK, none, &headers), Ok(()));
        assert_eq!(verdict(PUBLIC, none, &headers), Err(403));
        assert_eq!(verdict(PUBLIC, |c| c.allow_missing_origin = true, &headers), Ok(()));
    }
}
