//! Buffers through which bytes are read back to the host, reused from frame to frame.
//!
//! Only the bytes that a submission copied are read, so no data of an earlier user is visible.

use std::sync::Arc;

use parking_lot::Mutex;

use crate::error::GpuError;
use crate::memory::{Admission, MemoryKind, MemoryLedger};

/// Bytes kept for reuse; buffers beyond this are freed when they are returned.
const KEPT_BYTES: u64 = 64 << 20;
const SMALLEST_BYTES: u64 = 4 << 10;

/// A mappable buffer and its part of the budget.
pub(crate) struct StagingBuffer {
    pub(crate) raw: wgpu::Buffer,
    size_bytes: u64,
    _admission: Admission,
}

/// The buffers not in use.
#[derive(Default)]
pub(crate) struct StagingRing {
    free: Mutex<Vec<StagingBuffer>>,
}

impl StagingRing {
    /// A buffer of at least `bytes`, unmapped.
    pub(crate) fn take(
        &self,
        device: &wgpu::Device,
        ledger: &Arc<MemoryLedger>,
        bytes: u64,
    ) -> Result<StagingBuffer, GpuError> {
        // Powers of two, so that buffers serve sizes that vary slightly.
        let size_bytes = bytes.max(SMALLEST_BYTES).checked_next_power_of_two().unwrap_or(bytes);
        {
            let mut free = self.free.lock();
            if let Some(index) = free.iter().position(|buffer| buffer.size_bytes == size_bytes) {
                return Ok(free.swap_remove(index));
            }
        }
        let admit = || ledger.admit("read back", MemoryKind::Staging, size_bytes);
        // Buffers kept for reuse make room for one that is needed.
        let admission = admit().or_else(|_| {
            self.free.lock().clear();
            admit()
        })?;
        let raw = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read back"),
            size: size_bytes,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Ok(StagingBuffer { raw, size_bytes, _admission: admission })
    }

    /// Returns an unmapped buffer for reuse.
    pub(crate) fn give_back(&self, buffer: StagingBuffer) {
        let mut free = self.free.lock();
        let kept: u64 = free.iter().map(|other| other.size_bytes).sum();
        if kept + buffer.size_bytes <= KEPT_BYTES {
            free.push(buffer);
        }
    }
}
