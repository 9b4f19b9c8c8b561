//! Mean radiance to display values.

use surfelcast_gpu::{Buffer, Gpu, GpuError, MemoryKind, PassTime};
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::ToneMapUniforms;

/// Display pixels of an image, RGBA8 with red first, and the time of the pass.
pub fn tone_map(
    gpu: &Gpu,
    image: &Buffer,
    pixel_count: u32,
    exposure: f32,
) -> Result<(Vec<u8>, Vec<PassTime>), GpuError> {
    let kernel = gpu.kernel("tone_map", Features::NONE)?;
    let pixels = gpu.buffer("display_pixels", MemoryKind::Staging, u64::from(pixel_count) * 4)?;
    let uniforms = ToneMapUniforms { pixel_count, exposure, padding0: 0, padding1: 0 };
    let mut graph = gpu.graph("tone_map");
    graph
        .pass(&kernel)
        .uniform("display", bytemuck::bytes_of(&uniforms))
        .bind("accumulation", image)
        .bind("display_pixels", &pixels)
        .dispatch(super::workgroups_of(pixel_count))?;
    let ticket = graph.read_back(&pixels, 0..u64::from(pixel_count) * 4)?;
    let mut report = graph.submit()?.wait()?;
    Ok((report.take(ticket)?, report.passes))
}
