//! What the ray through each pixel's centre meets first.

use surfelcast_gpu::{Gpu, GpuError, MemoryKind, PassTime};
use surfelcast_shaders::layout::bytemuck;

use crate::passes::features::features_for;
use crate::passes::frame::FrameView;
use crate::passes::lights::LightBuffers;
use crate::passes::upload::SceneBuffers;
use crate::technique::MaterialMode;

/// Output of the pass; numbers are those of the kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum FirstSurfaceOutput {
    /// Base colour.
    Albedo = 0,
    /// Shading normal towards the viewer.
    Normal = 1,
    /// Distance along the optical axis, metres.
    Depth = 2,
    /// World position.
    Position = 3,
    /// Node index + 1.
    Instance = 4,
}

/// Renders one output; 0 where nothing is hit.
pub fn first_surface(
    gpu: &Gpu,
    scene: &SceneBuffers,
    lights: &LightBuffers,
    view: &FrameView,
    materials: MaterialMode,
    output: FirstSurfaceOutput,
) -> Result<(Vec<[f32; 3]>, Vec<PassTime>), GpuError> {
    let pixel_count = view.size[0] * view.size[1];
    let features = features_for(&scene.summary, materials, lights.punctual_count > 0, false);
    let kernel = gpu.kernel("first_surface", features)?;
    let buffer = gpu.buffer("first_surface_output", MemoryKind::Staging, u64::from(pixel_count) * 16)?;
    let mut uniforms = view.uniforms(scene, lights, features, 0);
    uniforms.selector = output as u32;
    let mut graph = gpu.graph("first_surface");
    lights
        .bind(scene.bind(graph.pass(&kernel)))
        .uniform("frame", bytemuck::bytes_of(&uniforms))
        .read_write("first_surface_output", &buffer)
        .dispatch(super::workgroups_of(pixel_count))?;
    let ticket = graph.read_back(&buffer, 0..u64::from(pixel_count) * 16)?;
    let mut report = graph.submit()?.wait()?;
    let values: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&report.take(ticket)?);
    let origin = scene.origin;
    let pixels = values
        .into_iter()
        .map(|[x, y, z, is_hit]| {
            if output == FirstSurfaceOutput::Position && is_hit > 0.0 {
                [(f64::from(x) + origin.x) as f32, (f64::from(y) + origin.y) as f32, (f64::from(z) + origin.z) as f32]
            } else {
                [x, y, z]
            }
        })
        .collect();
    Ok((pixels, report.passes))
}
