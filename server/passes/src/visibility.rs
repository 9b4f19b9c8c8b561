//! Visibility: what the camera ray of each pixel's sample hits, and the surface point there
//! (`shaders/techniques/common/visible_point.wesl`). Shading, reuse and filter read it instead of tracing the ray
//! again.

use surfelcast_gpu::{Buffer, Gpu, GpuError, Graph, Kernel, MemoryKind, PassTime};
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::{FrameUniforms, VisiblePoint};

use crate::lights::LightBuffers;
use crate::upload::SceneBuffers;
use crate::{merge_passes, workgroups_of};

/// The kernel that traces camera rays.
pub const KERNEL: &str = "visibility";

/// Pixels whose camera rays are traced in one submission.
const PIXELS: u32 = 1 << 18;

/// Visibility of one image.
#[derive(Debug)]
pub struct Visibility {
    /// Packed hit by pixel, 16 bytes.
    pub hits: Buffer,
    /// `VisiblePoint` by pixel.
    pub points: Buffer,
    pixel_count: u32,
}

impl Visibility {
    /// Buffers for an image of this size.
    pub fn new(gpu: &Gpu, [width, height]: [u32; 2]) -> Result<Self, GpuError> {
        let buffer = |label, bytes: usize| {
            gpu.buffer(label, MemoryKind::View, u64::from(width) * u64::from(height) * bytes as u64)
        };
        Ok(Self {
            hits: buffer("visible", 16)?,
            points: buffer("visible_points", size_of::<VisiblePoint>())?,
            pixel_count: width * height,
        })
    }

    /// Traces the camera rays of the sample `frame.first_sample` of every pixel and waits for them. In pieces, so that
    /// no submission of a large image holds the device for long.
    pub fn trace(
        &self,
        gpu: &Gpu,
        kernel: &Kernel,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        frame: &FrameUniforms,
    ) -> Result<Vec<PassTime>, GpuError> {
        let mut passes = Vec::new();
        for first_pixel in (0..self.pixel_count).step_by(PIXELS as usize) {
            let pixel_count = PIXELS.min(self.pixel_count - first_pixel);
            let mut graph = gpu.graph(KERNEL);
            let piece = FrameUniforms { first_pixel, pixel_count, ..*frame };
            self.record(&mut graph, kernel, scene, lights, &piece)?;
            merge_passes(&mut passes, graph.submit()?.wait()?.passes);
        }
        Ok(passes)
    }

    /// Records the camera rays of a range of pixels.
    pub fn record(
        &self,
        graph: &mut Graph,
        kernel: &Kernel,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        frame: &FrameUniforms,
    ) -> Result<(), GpuError> {
        self.bind(lights.bind(scene.bind(graph.pass(kernel))))
            .uniform("frame", bytemuck::bytes_of(frame))
            .dispatch(workgroups_of(frame.pixel_count))
    }

    /// Binds hits and points, as far as the kernel names them.
    pub fn bind<'g>(&self, pass: surfelcast_gpu::PassBuilder<'g>) -> surfelcast_gpu::PassBuilder<'g> {
        pass.bind_if_bound("visible", &self.hits).bind_if_bound("visible_points", &self.points)
    }
}
