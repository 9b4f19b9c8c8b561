//! The first surface on the ray through each pixel's centre.

use surfelcast_gpu::{Buffer, Gpu, GpuError, MemoryKind, PassTime};
use surfelcast_shaders::layout::bytemuck;

use crate::features::features_for;
use crate::frame::FrameView;
use crate::lights::LightBuffers;
use crate::materials::MaterialMode;
use crate::upload::SceneBuffers;

/// Output of the pass; the numbers are those of the kernel.
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

/// One output as a buffer of colours that survive the tone map: normals and positions as colours, depth from near to
/// far.
pub fn first_surface_for_screen(
    gpu: &Gpu,
    scene: &SceneBuffers,
    lights: &LightBuffers,
    view: &FrameView,
    materials: MaterialMode,
    output: FirstSurfaceOutput,
) -> Result<(Buffer, Vec<PassTime>), GpuError> {
    let (pixels, passes) = first_surface(gpu, scene, lights, view, materials, output)?;
    let radius = f64::from(scene.radius.max(f32::MIN_POSITIVE));
    let shown = |[x, y, z]: [f32; 3]| match output {
        FirstSurfaceOutput::Albedo => [x, y, z],
        FirstSurfaceOutput::Normal if [x, y, z] == [0.0; 3] => [0.0; 3],
        FirstSurfaceOutput::Normal => [x, y, z].map(|v| v * 0.5 + 0.5),
        FirstSurfaceOutput::Depth => [(f64::from(x) / (f64::from(x) + radius)) as f32; 3],
        FirstSurfaceOutput::Position => {
            let world = [x, y, z].map(f64::from);
            let local = [world[0] - scene.origin.x, world[1] - scene.origin.y, world[2] - scene.origin.z];
            local.map(|v| (v / radius * 0.5 + 0.5) as f32)
        }
        // A hash, so that neighbouring numbers get different colours.
        FirstSurfaceOutput::Instance => {
            let hash = (x as u32).wrapping_mul(0x9e37_79b1);
            if x == 0.0 {
                [0.0; 3]
            } else {
                [hash >> 24, (hash >> 16) & 255, (hash >> 8) & 255].map(|v| v as f32 / 255.0)
            }
        }
    };
    let colors: Vec<[f32; 4]> = pixels
        .into_iter()
        .map(|pixel| {
            let color = shown(pixel).map(|v| v.clamp(0.0, 0.98));
            // Undoes the tone map that follows.
            let scale = 1.0 / (1.0 - color[0].max(color[1]).max(color[2]));
            [color[0] * scale, color[1] * scale, color[2] * scale, 1.0]
        })
        .collect();
    let buffer = gpu.buffer("first_surface_colors", MemoryKind::Staging, (colors.len() * 16) as u64)?;
    gpu.upload(&buffer, 0, bytemuck::cast_slice(&colors))?;
    Ok((buffer, passes))
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
        .bind("first_surface_output", &buffer)
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
