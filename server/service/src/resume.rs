//! Resume tokens: a connection that broke takes up its view where it stood.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use crate::wishes::Wishes;

/// What a token stands for.
#[derive(Clone, Debug)]
pub(crate) struct Resumable {
    /// Session it belongs to.
    pub(crate) session: String,
    /// The view, kept up to date by its connection.
    pub(crate) wishes: Arc<Mutex<Wishes>>,
    /// Cancelled when a newer connection takes over.
    pub(crate) superseded: CancellationToken,
}

#[derive(Debug)]
struct Entry {
    what: Resumable,
    /// Since when its connection is gone; `None` while it is there.
    left_at: Option<Instant>,
}

/// All valid tokens. Each is used at most once.
#[derive(Debug)]
pub(crate) struct ResumeTokens {
    entries: Mutex<HashMap<String, Entry>>,
    capacity: usize,
    lifetime: Duration,
}

impl ResumeTokens {
    pub(crate) fn new(capacity: usize, lifetime: Duration) -> Self {
        Self { entries: Mutex::default(), capacity, lifetime }
    }

    /// Stores the view of a connection under its token. When all room is taken by open connections the token is simply
    /// not honoured later.
    pub(crate) fn insert(&self, token: String, what: Resumable) {
        let mut entries = self.entries.lock();
        self.sweep(&mut entries);
        if entries.len() >= self.capacity {
            let oldest = entries
                .iter()
                .filter_map(|(token, entry)| entry.left_at.map(|at| (at, token)))
                .min()
                .map(|(_, token)| token.clone());
            match oldest {
                Some(oldest) => drop(entries.remove(&oldest)),
                None => return,
            }
        }
        entries.insert(token, Entry { what, left_at: None });
    }

    /// The connection is gone: its token lives on for a while.
    pub(crate) fn left(&self, token: &str) {
        if let Some(entry) = self.entries.lock().get_mut(token) {
            entry.left_at = Some(Instant::now());
        }
    }

    /// Uses a token up, and tells the connection it came from, if that is still there, that it is superseded.
    pub(crate) fn take(&self, token: &str, session: &str) -> Option<Resumable> {
        let mut entries = self.entries.lock();
        self.sweep(&mut entries);
        if entries.get(token)?.what.session != session {
            return None;
        }
        let entry = entries.remove(token)?;
        entry.what.superseded.cancel();
        Some(entry.what)
    }

    fn sweep(&self, entries: &mut HashMap<String, Entry>) {
        entries.retain(|_, entry| entry.left_at.is_none_or(|at| at.elapsed() < self.lifetime));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(session: &str) -> Resumable {
        Resumable { session: session.into(), wishes: Arc::default(), superseded: CancellationToken::new() }
    }

    #[tokio::test(start_paused = true)]
    async fn tokens_work_once_within_their_time_and_session() {
        let tokens = ResumeTokens::new(8, Duration::from_mins(2));
        tokens.insert("a".into(), view("s"));
        assert!(tokens.take("a", "other").is_none());
        tokens.left("a");
        tokio::time::advance(Duration::from_secs(119)).await;
        assert!(tokens.take("a", "s").is_some());
        assert!(tokens.take("a", "s").is_none(), "used up");
        tokens.insert("b".into(), view("s"));
        tokens.left("b");
        tokio::time::advance(Duration::from_secs(121)).await;
        assert!(tokens.take("b", "s").is_none(), "too late");
    }

    #[tokio::test(start_paused = true)]
    async fn taking_over_supersedes_and_memory_is_bounded() {
        let tokens = ResumeTokens::new(2, Duration::from_mins(2));
        let open = view("s");
        tokens.insert("open".into(), open.clone());
        for i in 0..100 {
            tokens.insert(format!("t{i}"), view("s"));
            tokens.left(&format!("t{i}"));
        }
        assert_eq!(tokens.entries.lock().len(), 2);
        assert!(tokens.take("open", "s").is_some() && open.superseded.is_cancelled());
    }
}
