//! Logs of bounded length.

use std::collections::VecDeque;

/// Appends to a log, oldest first, and drops the oldest items beyond `capacity`.
pub(crate) fn push_bounded<T>(log: &mut VecDeque<T>, item: T, capacity: usize) {
    while log.len() >= capacity.max(1) {
        log.pop_front();
    }
    log.push_back(item);
}
