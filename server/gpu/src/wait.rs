//! Futures of wgpu that are ready at once.

use std::future::Future;
use std::pin::pin;
use std::task::{Context, Poll, Waker};

/// The value of a future that is ready at once, as all of wgpu's are on native platforms.
pub(crate) fn ready<T>(future: impl Future<Output = T>) -> Option<T> {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => Some(value),
        Poll::Pending => None,
    }
}

#[cfg(test)]
mod tests {
    use super::ready;

    #[test]
    fn a_pending_future_has_no_value() {
        assert_eq!(ready(std::future::ready(1)), Some(1));
        assert_eq!(ready(std::future::pending::<u8>()), None);
    }
}
