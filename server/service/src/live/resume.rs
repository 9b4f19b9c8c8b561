//! Resume tokens: a client whose connection broke takes up its view where it stood.

use std::collections::HashMap;
use std::time::Duration;

use parking_lot::Mutex;
use tokio::sync::watch;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use crate::live::view_settings::ViewSettings;

/// The view that a token resumes.
#[derive(Clone, Debug)]
pub(crate) struct Resumable {
    /// Session it belongs to.
    pub(crate) session: String,
    /// Settings of the view, kept up to date by its connection.
    pub(crate) settings: watch::Receiver<ViewSettings>,
    /// Cancelled when a newer connection takes over.
    pub(crate) superseded: CancellationToken,
}

#[derive(Debug)]
struct Entry {
    what: Resumable,
    began_at: Instant,
    /// Since when its connection is gone; `None` while it is there.
    left_at: Option<Instant>,
}

/// All valid tokens. Each is used at most once.
#[derive(Debug)]
pub(crate) struct ResumeTokens {
    entries: Mutex<HashMap<String, Entry>>,
    capacity: usize,
    lifetime: Duration,
    least_interval: Duration,
}

/// The connection that the token belongs to began less than the least interval ago.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TooSoon;

impl ResumeTokens {
    /// Tokens live for `lifetime` after their connection; two connections of a client begin `least_interval` apart.
    pub(crate) fn new(capacity: usize, lifetime: Duration, least_interval: Duration) -> Self {
        Self { entries: Mutex::default(), capacity, lifetime, least_interval }
    }

    /// Stores the view of a connection under its token. While open connections hold the whole capacity, the token is
    /// not stored and resumes nothing later.
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
        entries.insert(token, Entry { what, began_at: Instant::now(), left_at: None });
    }

    /// The connection is gone: its token lives on for a while.
    pub(crate) fn left(&self, token: &str) {
        if let Some(entry) = self.entries.lock().get_mut(token) {
            entry.left_at = Some(Instant::now());
        }
    }

    /// Consumes a token, and ends the connection that it belongs to, if that is still open, as superseded. A token that
    /// comes too soon stays valid. The interval counts from the beginning of the earlier connection, not from its
    /// end: the server may notice the end of a broken one long after its client did.
    pub(crate) fn take(&self, token: &str, session: &str) -> Result<Option<Resumable>, TooSoon> {
        let mut entries = self.entries.lock();
        self.sweep(&mut entries);
        match entries.get(token) {
            Some(entry) if entry.what.session != session => return Ok(None),
            Some(entry) if entry.began_at.elapsed() < self.least_interval => return Err(TooSoon),
            _ => {}
        }
        let taken = entries.remove(token).map(|entry| entry.what);
        if let Some(taken) = &taken {
            taken.superseded.cancel();
        }
        Ok(taken)
    }

    fn sweep(&self, entries: &mut HashMap<String, Entry>) {
        entries.retain(|_, entry| entry.left_at.is_none_or(|at| at.elapsed() < self.lifetime));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(session: &str) -> Resumable {
        let settings = watch::Sender::new(ViewSettings::default()).subscribe();
        Resumable { session: session.into(), settings, superseded: CancellationToken::new() }
    }

    #[tokio::test(start_paused = true)]
    async fn tokens_work_once_within_their_time_and_session() {
        let tokens = ResumeTokens::new(8, Duration::from_mins(2), Duration::ZERO);
        tokens.insert("a".into(), view("s"));
        assert!(tokens.take("a", "other").is_ok_and(|taken| taken.is_none()));
        tokens.left("a");
        tokio::time::advance(Duration::from_secs(119)).await;
        assert!(tokens.take("a", "s").is_ok_and(|taken| taken.is_some()));
        assert!(tokens.take("a", "s").is_ok_and(|taken| taken.is_none()), "used up");
        tokens.insert("b".into(), view("s"));
        tokens.left("b");
        tokio::time::advance(Duration::from_secs(121)).await;
        assert!(tokens.take("b", "s").is_ok_and(|taken| taken.is_none()), "too late");
    }

    #[tokio::test(start_paused = true)]
    async fn clients_that_come_back_too_soon_keep_their_token() {
        let tokens = ResumeTokens::new(8, Duration::from_mins(2), Duration::from_millis(500));
        let open = view("s");
        tokens.insert("a".into(), open.clone());
        tokio::time::advance(Duration::from_millis(499)).await;
        assert_eq!(tokens.take("a", "s").err(), Some(TooSoon));
        assert!(!open.superseded.is_cancelled());
        tokio::time::advance(Duration::from_millis(1)).await;
        assert!(tokens.take("a", "s").is_ok_and(|taken| taken.is_some()));
    }

    #[tokio::test(start_paused = true)]
    async fn taking_over_supersedes_and_memory_is_bounded() {
        let tokens = ResumeTokens::new(2, Duration::from_mins(2), Duration::ZERO);
        let open = view("s");
        tokens.insert("open".into(), open.clone());
        for i in 0..100 {
            tokens.insert(format!("t{i}"), view("s"));
            tokens.left(&format!("t{i}"));
        }
        assert_eq!(tokens.entries.lock().len(), 2);
        assert!(tokens.take("open", "s").is_ok_and(|taken| taken.is_some()) && open.superseded.is_cancelled());
    }
}
