//! Inspection of a cache: outputs by pixel, and one point in detail. No frame runs any of it.

use surfelcast_gpu::{Buffer, Gpu, GpuError, MemoryKind, PassTime};
use surfelcast_passes::frame::FrameView;
use surfelcast_passes::lights::LightBuffers;
use surfelcast_passes::upload::SceneBuffers;
use surfelcast_passes::workgroups_of;
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::SurfelContribution;

use crate::surfel::cache::SurfelCache;

/// Output of an inspection; the numbers are those of the kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum SurfelOutput {
    /// The surfel with the largest weight, plus one.
    Id = 0,
    /// Mean radius, metres.
    Radius = 1,
    /// Sum of weights.
    Coverage = 2,
    /// Share of the largest weight.
    Weight = 3,
    /// Irradiance over pi, of all light in the cache.
    Irradiance = 4,
    /// Standard error of the luminance of irradiance over pi.
    Error = 5,
    /// Rays behind the value.
    Rays = 6,
    /// Updates of the surfel with the largest weight.
    Age = 7,
    /// Mean direction of its guiding table, scene space.
    Guide = 8,
    /// Mean distance to the surfaces around it, in radii.
    Depth = 9,
    /// Grid entries that a lookup reads.
    Cells = 10,
    /// Share of the weights that radial depth removes.
    Leaks = 11,
    /// Grid level of the point.
    Level = 12,
}

/// Added to an output's number for colours that survive the tone map.
const FOR_SCREEN: u32 = 1 << 31;
/// Surfels listed for one point, at most.
const MAX_CONTRIBUTIONS: u64 = 64;
const NOBODY: u32 = u32::MAX;

impl SurfelCache {
    /// An output at every pixel, `vec4f`: numbers, or with `is_shown` colours that survive the tone map.
    #[allow(clippy::too_many_arguments, reason = "scene, lights and view are separate owners")]
    pub fn look(
        &self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        view: &FrameView,
        features: Features,
        output: SurfelOutput,
        is_shown: bool,
    ) -> Result<(Buffer, Vec<PassTime>), GpuError> {
        let kernel = gpu.kernel("surfel_debug", features)?;
        let pixel_count = view.size[0] * view.size[1];
        let buffer = gpu.buffer("debug_output", MemoryKind::View, u64::from(pixel_count) * 16)?;
        let mut frame = view.uniforms(scene, lights, features, 0);
        frame.selector = output as u32 | if is_shown { FOR_SCREEN } else { 0 };
        let mut graph = gpu.graph("surfel_debug");
        self.bind_surfels(self.bind(lights.bind(scene.bind(graph.pass(&kernel)))))
            .uniform("cache", bytemuck::bytes_of(&self.uniforms(0)))
            .uniform("frame", bytemuck::bytes_of(&frame))
            .bind("debug_output", &buffer)
            .dispatch(workgroups_of(pixel_count))?;
        let report = graph.submit()?.wait()?;
        Ok((buffer, report.passes))
    }

    /// The point behind a pixel and the surfels that light it; `None` where no surface is hit.
    pub fn inspect(
        &self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        view: &FrameView,
        features: Features,
        pixel: u32,
    ) -> Result<Option<(SurfelContribution, Vec<SurfelContribution>)>, GpuError> {
        let kernel = gpu.kernel("surfel_inspect", features)?;
        let bytes = (MAX_CONTRIBUTIONS + 1) * size_of::<SurfelContribution>() as u64;
        let buffer = gpu.buffer("contributions", MemoryKind::Staging, bytes)?;
        let mut frame = view.uniforms(scene, lights, features, 0);
        frame.first_pixel = pixel;
        let mut graph = gpu.graph("surfel_inspect");
        graph.clear(&buffer)?;
        self.bind(lights.bind(scene.bind(graph.pass(&kernel))))
            .uniform("cache", bytemuck::bytes_of(&self.uniforms(0)))
            .uniform("frame", bytemuck::bytes_of(&frame))
            .bind("contributions", &buffer)
            .dispatch([1, 1, 1])?;
        let ticket = graph.read_back(&buffer, 0..bytes)?;
        let parts: Vec<SurfelContribution> = bytemuck::pod_collect_to_vec(&graph.submit()?.wait()?.take(ticket)?);
        let Some((point, parts)) = parts.split_first() else { return Ok(None) };
        if point.id == NOBODY {
            return Ok(None);
        }
        let count = (point.id as usize).min(parts.len());
        Ok(Some((*point, parts[..count].to_vec())))
    }
}
