//! Work that would block the async threads: encoders and scene loaders, a bounded number at a time.

use std::sync::Arc;

use tokio::sync::Semaphore;

/// The closure panicked, or the runtime is stopping.
#[derive(Debug, thiserror::Error)]
#[error("{what} failed unexpectedly")]
pub(crate) struct WorkFailed {
    what: &'static str,
}

/// A pool of a fixed width over tokio's blocking threads. A panic inside is an error of that piece of work alone.
#[derive(Clone, Debug)]
pub(crate) struct BlockingPool {
    what: &'static str,
    permits: Arc<Semaphore>,
}

impl BlockingPool {
    pub(crate) fn new(what: &'static str, width: usize) -> Self {
        Self { what, permits: Arc::new(Semaphore::new(width.max(1))) }
    }

    /// Runs `work` on a blocking thread once a permit is free. Dropping the future abandons the result, not the work,
    /// and the permit is released only when the work has ended.
    pub(crate) async fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, WorkFailed> {
        let failed = |_| WorkFailed { what: self.what };
        let permit = Arc::clone(&self.permits).acquire_owned().await.map_err(|_| WorkFailed { what: self.what })?;
        tokio::task::spawn_blocking(move || {
            let _permit = permit;
            work()
        })
        .await
        .map_err(failed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_panic_stays_inside_and_releases_its_permit() {
        let pool = BlockingPool::new("encoding", 1);
        assert!(pool.run(|| panic!("a codec's bug")).await.map(|(): ()| ()).is_err());
        assert_eq!(pool.run(|| 7).await.ok(), Some(7));
    }
}
