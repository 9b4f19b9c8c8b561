//! The service against a fake renderer: real sockets where sockets matter, `oneshot` elsewhere.

mod fake;
mod hostile;
mod http;
mod lifecycle;
mod renders;
mod scenes;
mod sockets;
mod stream;
mod support;
#[path = "../../src/test_catalogue.rs"]
mod test_catalogue;
