//! `surfelcast doctor`: what the machine offers and what is missing.

use surfelcast::Failure;
use surfelcast_gpu::{AdapterReport, adapters};

#[allow(clippy::print_stdout, reason = "the report is the command's output")]
pub(crate) fn run() -> Result<(), Failure> {
    let found = adapters();
    for adapter in &found {
        println!("{}", describe(adapter));
    }
    if found.iter().any(|adapter| adapter.unusable.is_none()) {
        if found.iter().all(|adapter| adapter.unusable.is_some() || adapter.kind == surfelcast_gpu::AdapterKind::Cpu) {
            println!(
                "Only software rendering was found: images are correct, but slow. A GPU with a Vulkan 1.2 driver is \
                 faster by orders of magnitude."
            );
        }
        println!("Ready: `surfelcast serve` and `surfelcast render` will work here.");
        return Ok(());
    }
    Err(Failure::runtime(
        "no usable Vulkan adapter. Install your GPU's Vulkan driver, or software rendering with `apt-get install \
         mesa-vulkan-drivers`; the loader is `libvulkan1`",
    ))
}

fn describe(adapter: &AdapterReport) -> String {
    let limits = &adapter.limits;
    let state = adapter.unusable.as_ref().map_or_else(|| "usable".to_owned(), |reason| format!("not usable: {reason}"));
    format!(
        "[{}] {} ({}, {}, {})\n    tier {}, largest buffer binding {} MiB, {} storage buffers a kernel\n    {state}",
        adapter.index,
        adapter.name,
        adapter.kind,
        adapter.backend,
        adapter.driver,
        adapter.tier,
        limits.storage_binding_bytes >> 20,
        limits.storage_buffers_per_kernel,
    )
}
