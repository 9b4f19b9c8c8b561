//! Runs a test kernel over many items.

use surfelcast_gpu::{Gpu, GpuOptions, Kernel, MemoryKind, PassBuilder};
use surfelcast_shaders::layout::bytemuck::{self, Pod};

pub(crate) const WORKGROUP: u32 = 64;

pub(crate) fn gpu() -> Gpu {
    Gpu::open(&GpuOptions::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// Dispatches a kernel whose output is one `T` for each of `count` invocations.
pub(crate) fn run<T: Pod>(
    gpu: &Gpu,
    kernel: &Kernel,
    output: &str,
    count: u32,
    bind: impl for<'g> FnOnce(PassBuilder<'g>) -> PassBuilder<'g>,
) -> Vec<T> {
    let bytes = u64::from(count) * size_of::<T>() as u64;
    let buffer = gpu.buffer(output, MemoryKind::View, bytes).expect("fits");
    let mut graph = gpu.graph("samplers");
    bind(graph.pass(kernel))
        .read_write(output, &buffer)
        .dispatch([count.div_ceil(WORKGROUP), 1, 1])
        .unwrap_or_else(|error| panic!("{error}"));
    let ticket = graph.read_back(&buffer, 0..bytes).expect("records");
    let mut report =
        graph.submit().and_then(surfelcast_gpu::Submission::wait).unwrap_or_else(|error| panic!("{error}"));
    bytemuck::pod_collect_to_vec(&report.take(ticket).expect("there"))
}
