//! Exclusive prefix sums of `u32`, in place: positions in a list without atomics, so that the order is always the same.

use surfelcast_gpu::{Buffer, Gpu, GpuError, Graph, Kernel, MemoryKind};
use surfelcast_shaders::Features;
use surfelcast_shaders::constants::SCAN_BLOCK;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::ScanUniforms;

/// Kernels, and a buffer for the sums of blocks of a given number of values.
#[derive(Debug)]
pub struct Scan {
    blocks: Kernel,
    totals: Kernel,
    add: Kernel,
    sums: Buffer,
}

impl Scan {
    /// For up to `largest_count` values.
    pub fn new(gpu: &Gpu, largest_count: u32) -> Result<Self, GpuError> {
        Ok(Self {
            blocks: gpu.kernel("scan_blocks", Features::NONE)?,
            totals: gpu.kernel("scan_totals", Features::NONE)?,
            add: gpu.kernel("scan_add", Features::NONE)?,
            sums: gpu.buffer("scan_sums", MemoryKind::Session, sums_bytes(largest_count))?,
        })
    }

    /// Whether it was made for `count` values.
    pub fn holds(&self, count: u32) -> bool {
        sums_bytes(count) <= self.sums.size_bytes()
    }

    /// Replaces each of the first `count` values by the sum of those before it.
    pub fn record(&self, graph: &mut Graph, values: &Buffer, count: u32) -> Result<(), GpuError> {
        let uniforms = ScanUniforms { count, padding0: 0, padding1: 0, padding2: 0 };
        let uniforms = bytemuck::bytes_of(&uniforms);
        let groups = [count.div_ceil(SCAN_BLOCK), 1, 1];
        graph
            .pass(&self.blocks)
            .uniform("scan", uniforms)
            .bind("scan_values", values)
            .bind("scan_sums", &self.sums)
            .dispatch(groups)?;
        graph.pass(&self.totals).uniform("scan", uniforms).bind("scan_sums", &self.sums).dispatch([1, 1, 1])?;
        graph
            .pass(&self.add)
            .uniform("scan", uniforms)
            .bind("scan_values", values)
            .bind("scan_sums", &self.sums)
            .dispatch(groups)
    }
}

fn sums_bytes(count: u32) -> u64 {
    (u64::from(count.div_ceil(SCAN_BLOCK)) + 1) * 4
}
