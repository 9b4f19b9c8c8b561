//! Renders in progress and finished ones, found by id and by the key of what they show.
//!
//! Equal requests have equal keys, so they share one render while it runs and its result while that is kept. Finished
//! renders are evicted, least recently used first, when their number or their bytes exceed the bounds.

use std::collections::HashMap;
use std::fmt;

use lru::LruCache;

use crate::error::StoreError;

/// Bounds of a [`RenderTable`].
#[derive(Clone, Copy, Debug)]
pub struct RenderBounds {
    /// Renders waiting or running.
    pub active: usize,
    /// Finished renders.
    pub finished: usize,
    /// Bytes of finished renders.
    pub finished_bytes: u64,
}

#[derive(Debug)]
struct Record<J> {
    key: String,
    render: J,
    bytes: u64,
}

/// All renders; `J` is a cheap handle of one.
pub struct RenderTable<J> {
    bounds: RenderBounds,
    active: HashMap<String, Record<J>>,
    /// Renders that have not finished, including removed ones: those occupy the renderer until they stop.
    unfinished: usize,
    finished: LruCache<String, Record<J>>,
    finished_bytes: u64,
    id_by_key: HashMap<String, String>,
}

impl<J: Clone> RenderTable<J> {
    /// An empty table.
    pub fn new(bounds: RenderBounds) -> Self {
        Self {
            bounds,
            active: HashMap::new(),
            unfinished: 0,
            finished: LruCache::unbounded(),
            finished_bytes: 0,
            id_by_key: HashMap::new(),
        }
    }

    /// Renders waiting or running.
    pub fn active_count(&self) -> usize {
        self.unfinished
    }

    /// A render by id; looking it up counts as use.
    pub fn get(&mut self, id: &str) -> Option<J> {
        let record = self.active.get(id).or_else(|| self.finished.get(id))?;
        Some(record.render.clone())
    }

    /// A render by key; looking it up counts as use.
    pub fn get_by_key(&mut self, key: &str) -> Option<J> {
        let id = self.id_by_key.get(key)?.clone();
        self.get(&id)
    }

    /// Refuses when as many renders are active as may be.
    pub fn check_limit(&self) -> Result<(), StoreError> {
        let limit = self.bounds.active;
        if self.unfinished < limit { Ok(()) } else { Err(StoreError::TooManyRenders { limit }) }
    }

    /// Adds a render that waits or runs.
    pub fn insert(&mut self, id: &str, key: &str, render: J) {
        self.unfinished += 1;
        self.id_by_key.insert(key.to_owned(), id.to_owned());
        self.active.insert(id.to_owned(), Record { key: key.to_owned(), render, bytes: 0 });
    }

    /// Records that a render has finished, with the bytes of its result. A failed one (`None`) can still be found by
    /// its id, but an equal request starts again.
    pub fn finish(&mut self, id: &str, bytes: Option<u64>) {
        self.unfinished = self.unfinished.saturating_sub(1);
        let Some(mut record) = self.active.remove(id) else { return };
        if bytes.is_none() {
            self.remove_key(&record.key, id);
        }
        record.bytes = bytes.unwrap_or(0);
        self.finished_bytes += record.bytes;
        self.finished.push(id.to_owned(), record);
        self.evict();
    }

    /// Records that a finished render now takes more bytes.
    pub fn grow(&mut self, id: &str, bytes: u64) {
        if let Some(record) = self.finished.peek_mut(id) {
            record.bytes += bytes;
            self.finished_bytes += bytes;
            self.evict();
        }
    }

    /// Removes a render. One that still runs counts as active until it has finished.
    pub fn remove(&mut self, id: &str) {
        let Some(record) = self.active.remove(id).or_else(|| self.finished.pop(id)) else { return };
        self.finished_bytes -= record.bytes;
        self.remove_key(&record.key, id);
    }

    fn remove_key(&mut self, key: &str, id: &str) {
        if self.id_by_key.get(key).is_some_and(|known| known == id) {
            self.id_by_key.remove(key);
        }
    }

    /// Keeps the most recently used render even when it alone exceeds the bound: a client is about to fetch it.
    fn evict(&mut self) {
        while self.finished.len() > 1
            && (self.finished_bytes > self.bounds.finished_bytes || self.finished.len() > self.bounds.finished)
        {
            let Some((id, record)) = self.finished.pop_lru() else { return };
            self.finished_bytes -= record.bytes;
            self.remove_key(&record.key, &id);
        }
    }
}

impl<J> fmt::Debug for RenderTable<J> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("RenderTable")
            .field("unfinished", &self.unfinished)
            .field("finished", &self.finished.len())
            .field("finished_bytes", &self.finished_bytes)
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> RenderTable<u32> {
        RenderTable::new(RenderBounds { active: 2, finished: 3, finished_bytes: 100 })
    }

    #[test]
    fn equal_requests_share_a_render_until_it_fails_or_goes() {
        let mut table = table();
        table.insert("a", "key", 1);
        assert_eq!(table.get_by_key("key"), Some(1), "while it runs");
        table.finish("a", Some(10));
        assert_eq!((table.get_by_key("key"), table.get("a")), (Some(1), Some(1)), "while its result is kept");
        table.remove("a");
        assert_eq!((table.get_by_key("key"), table.get("a")), (None, None));
        table.insert("b", "key", 2);
        table.finish("b", None);
        assert_eq!((table.get_by_key("key"), table.get("b")), (None, Some(2)), "a failed one is found by its id only");
        table.insert("c", "key", 3);
        table.remove("b");
        assert_eq!(table.get_by_key("key"), Some(3), "the key belongs to the newer render");
    }

    #[test]
    fn active_renders_are_bounded_and_removed_ones_count_until_they_stop() {
        let mut table = table();
        table.insert("a", "1", 1);
        table.insert("b", "2", 2);
        assert!(matches!(table.check_limit(), Err(StoreError::TooManyRenders { limit: 2 })));
        table.remove("a");
        assert_eq!((table.get("a"), table.active_count()), (None, 2));
        table.finish("a", Some(5));
        assert_eq!((table.get("a"), table.active_count()), (None, 1));
        assert!(table.check_limit().is_ok());
    }

    #[test]
    fn the_least_recently_used_goes_first() {
        let mut table = table();
        for (id, render) in [("a", 1), ("b", 2), ("c", 3)] {
            table.insert(id, id, render);
            table.finish(id, Some(10));
        }
        assert_eq!(table.get("a"), Some(1));
        table.insert("d", "d", 4);
        table.finish("d", Some(10));
        assert_eq!((table.get("b"), table.get_by_key("b")), (None, None), "by number");
        assert_eq!(table.get("a"), Some(1));
        table.grow("a", 80);
        assert_eq!(["a", "c", "d"].map(|id| table.get(id)), [Some(1), None, Some(4)], "by bytes");
        table.grow("d", 1000);
        assert_eq!((table.get("a"), table.get("d")), (None, Some(4)), "the most recently used stays");
    }
}
