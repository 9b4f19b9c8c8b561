//! Ray counters of a dispatch.

use surfelcast_gpu::{Buffer, Gpu, GpuError, MemoryKind};
use surfelcast_shaders::constants::{COUNTER_SLOTS, COUNTERS_PER_SLOT};
use surfelcast_shaders::layout::bytemuck;

/// Bytes of the counters: `u32`, [`COUNTERS_PER_SLOT`] for each of [`COUNTER_SLOTS`] slots. Written by path kernels,
/// read back after every dispatch, so that 32 bits suffice.
pub const BYTES: u64 = COUNTER_SLOTS as u64 * COUNTERS_PER_SLOT as u64 * 4;

/// What a dispatch counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Rays: primary, secondary, shadow.
    pub rays: [u64; 3],
    /// Samples that were not finite.
    pub non_finite: u64,
}

/// A buffer of counters.
pub fn buffer(gpu: &Gpu) -> Result<Buffer, GpuError> {
    gpu.buffer("counters", MemoryKind::View, BYTES)
}

/// Adds up the slots.
pub fn sum(bytes: &[u8]) -> Counts {
    let values: Vec<u32> = bytemuck::pod_collect_to_vec(bytes);
    let mut counts = Counts::default();
    for slot in values.chunks_exact(COUNTERS_PER_SLOT as usize) {
        for (sum, &value) in counts.rays.iter_mut().zip(slot) {
            *sum += u64::from(value);
        }
        counts.non_finite += u64::from(slot[3]);
    }
    counts
}
