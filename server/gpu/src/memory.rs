//! Device memory: buffers, and the ledger that admits them.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use parking_lot::Mutex;

use crate::error::GpuError;

/// What a buffer is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum MemoryKind {
    /// Geometry, materials, textures, lights: kept as long as a session.
    Scene,
    /// Shared by all views of a session: kept as long as the session.
    Session,
    /// Accumulators and images: kept as long as a view.
    View,
    /// For transfers to and from the host.
    Staging,
}

/// Bytes in use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MemoryUse {
    /// Of scenes.
    pub scene_bytes: u64,
    /// Of sessions.
    pub session_bytes: u64,
    /// Of views.
    pub view_bytes: u64,
    /// Of staging.
    pub staging_bytes: u64,
    /// Most that may be used.
    pub budget_bytes: u64,
}

impl MemoryUse {
    /// All kinds together.
    pub fn total_bytes(&self) -> u64 {
        self.scene_bytes + self.session_bytes + self.view_bytes + self.staging_bytes
    }

    /// Rest of the budget.
    pub fn free_bytes(&self) -> u64 {
        self.budget_bytes.saturating_sub(self.total_bytes())
    }

    fn of(&mut self, kind: MemoryKind) -> &mut u64 {
        match kind {
            MemoryKind::Scene => &mut self.scene_bytes,
            MemoryKind::Session => &mut self.session_bytes,
            MemoryKind::View => &mut self.view_bytes,
            MemoryKind::Staging => &mut self.staging_bytes,
        }
    }
}

/// Counts bytes by kind and refuses those beyond the budget.
#[derive(Debug)]
pub(crate) struct MemoryLedger {
    state: Mutex<MemoryUse>,
}

impl MemoryLedger {
    pub(crate) fn new(budget_bytes: u64) -> Self {
        MemoryLedger { state: Mutex::new(MemoryUse { budget_bytes, ..MemoryUse::default() }) }
    }

    pub(crate) fn current(&self) -> MemoryUse {
        *self.state.lock()
    }

    /// Takes `bytes` from the budget until the admission is dropped.
    pub(crate) fn admit(self: &Arc<Self>, label: &str, kind: MemoryKind, bytes: u64) -> Result<Admission, GpuError> {
        let mut state = self.state.lock();
        let free = state.free_bytes();
        if bytes > free {
            return Err(GpuError::OutOfMemory { field: label.to_owned(), needed: bytes, free });
        }
        *state.of(kind) += bytes;
        Ok(Admission { ledger: Arc::clone(self), kind, bytes })
    }
}

/// A part of the budget, returned on drop.
#[derive(Debug)]
pub(crate) struct Admission {
    ledger: Arc<MemoryLedger>,
    kind: MemoryKind,
    bytes: u64,
}

impl Drop for Admission {
    fn drop(&mut self) {
        *self.ledger.state.lock().of(self.kind) -= self.bytes;
    }
}

/// A buffer on the device. Clones share it; dropping the last one frees it.
#[derive(Clone)]
pub struct Buffer {
    pub(crate) inner: Arc<BufferInner>,
}

pub(crate) struct BufferInner {
    pub(crate) raw: wgpu::Buffer,
    pub(crate) label: String,
    pub(crate) kind: MemoryKind,
    pub(crate) size_bytes: u64,
    pub(crate) indirect: bool,
    /// Distinguishes buffers in a graph.
    pub(crate) id: u64,
    /// Identifies its device.
    pub(crate) device_id: u64,
    /// Whether it was uploaded to, cleared or written by a pass at least once.
    pub(crate) written: AtomicBool,
    /// Freed after `raw`, fields drop in order.
    pub(crate) _admission: Admission,
}

impl Buffer {
    /// Label given at creation.
    pub fn label(&self) -> &str {
        &self.inner.label
    }

    /// Size in bytes: as requested, rounded up to 16.
    pub fn size_bytes(&self) -> u64 {
        self.inner.size_bytes
    }

    /// Kind given at creation.
    pub fn kind(&self) -> MemoryKind {
        self.inner.kind
    }

    pub(crate) fn is_written(&self) -> bool {
        self.inner.written.load(Ordering::Acquire)
    }

    pub(crate) fn mark_written(&self) {
        self.inner.written.store(true, Ordering::Release);
    }

    /// Whether both are the same memory.
    pub fn same_as(&self, other: &Buffer) -> bool {
        self.inner.id == other.inner.id
    }
}

impl fmt::Debug for Buffer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Buffer(`{}`, {} bytes)", self.inner.label, self.inner.size_bytes)
    }
}

/// Numbers that never repeat in a process: of buffers and devices.
pub(crate) fn next_id() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(1);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ledger_admits_up_to_the_budget_and_frees_on_drop() {
        let ledger = Arc::new(MemoryLedger::new(100));
        let scene = ledger.admit("nodes", MemoryKind::Scene, 60).expect("fits");
        let view = ledger.admit("image", MemoryKind::View, 40).expect("fits");
        let refused = ledger.admit("more", MemoryKind::View, 1).expect_err("admitted");
        assert_eq!(refused, GpuError::OutOfMemory { field: "more".to_owned(), needed: 1, free: 0 });
        drop(scene);
        assert_eq!(ledger.current().view_bytes, 40);
        assert_eq!(ledger.current().free_bytes(), 60);
        drop(view);
        assert_eq!(ledger.current().total_bytes(), 0);
    }

    #[test]
    fn the_largest_size_does_not_overflow() {
        let ledger = Arc::new(MemoryLedger::new(100));
        let _some = ledger.admit("a", MemoryKind::Scene, 10).expect("fits");
        assert!(ledger.admit("b", MemoryKind::Scene, u64::MAX).is_err());
    }
}
