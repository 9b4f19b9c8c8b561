//! Direct light of the frame before, reused after the camera moved (`direct_reuse.wesl`).

use surfelcast_gpu::{Buffer, Gpu, GpuError, Graph, Kernel, MemoryKind};
use surfelcast_shaders::Features;
use surfelcast_shaders::constants::{HAS_EARLIER_FRAME, REUSED_FRAMES};
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::{DirectHistory, FrameUniforms};

use crate::lights::LightBuffers;
use crate::workgroups_of;

/// Up to this number of point lights, all of them are sampled in every frame, which leaves no noise.
const EXACT_LIGHTS: u32 = 4;

/// Whether direct light has noise that reuse or filter can reduce.
pub(super) const fn has_noise(lights: &LightBuffers) -> bool {
    lights.triangle_count + lights.environment_count > 0 || lights.punctual_count > EXACT_LIGHTS
}

/// The last frame of an image, for reuse by the image that replaces it. Opaque in between.
#[derive(Debug)]
pub struct EarlierFrame {
    /// `DirectHistory` by pixel.
    history: Buffer,
    frame: FrameUniforms,
    /// Camera moves of the image since the light changed.
    pub(super) moves: u32,
}

/// Reuse of one image's direct light.
#[derive(Debug)]
pub(super) struct Reuse {
    kernel: Kernel,
    /// `DirectHistory` by pixel, alternately of this frame and of the one before.
    history: [Buffer; 2],
    /// Index of the buffer with the last frame, and that frame; `None` since the light changed.
    last: Option<(usize, FrameUniforms)>,
    /// The frame before the first, of another image.
    taken: Option<EarlierFrame>,
    /// The image with reused light.
    shown: Buffer,
    /// Whether it contains any.
    is_shown: bool,
}

impl Reuse {
    /// `taken` is another image's last frame to start from.
    pub(super) fn new(gpu: &Gpu, pixel_count: u32, taken: Option<EarlierFrame>) -> Result<Self, GpuError> {
        let pixels = u64::from(pixel_count);
        let buffer = |label, bytes: usize| gpu.buffer(label, MemoryKind::View, pixels * bytes as u64);
        let history = || buffer("direct_history", size_of::<DirectHistory>());
        let reuse = Self {
            kernel: gpu.kernel("direct_reuse", Features::NONE)?,
            history: [history()?, history()?],
            last: None,
            taken,
            shown: buffer("shown", 16)?,
            is_shown: false,
        };
        let mut graph = gpu.graph("direct_history");
        for buffer in &reuse.history {
            graph.clear(buffer)?;
        }
        graph.submit()?.wait()?;
        Ok(reuse)
    }

    /// Whether the sample after `samples` samples is kept for later frames. From then on no reused light is left in the
    /// image.
    pub(super) const fn keeps(samples: u32) -> bool {
        samples < 2 * REUSED_FRAMES
    }

    /// The light changed: light of the past must not be shown.
    pub(super) fn forget(&mut self) {
        self.last = None;
        self.taken = None;
        self.is_shown = false;
    }

    /// The last frame, for another image.
    pub(super) fn leave(&self, moves: u32) -> Option<EarlierFrame> {
        self.last.map(|(place, frame)| EarlierFrame { history: self.history[place].clone(), frame, moves })
    }

    /// `DirectHistory` of the shown image, while it contains reused light.
    pub(super) fn history(&self) -> Option<&Buffer> {
        let (place, _) = self.last.filter(|_| self.is_shown)?;
        Some(&self.history[place])
    }

    /// The image with reused light, while there is any.
    pub(super) fn image(&self) -> Option<&Buffer> {
        self.is_shown.then_some(&self.shown)
    }

    /// Records the reuse after the shading of a whole sample per pixel.
    pub(super) fn record(
        &mut self,
        graph: &mut Graph,
        frame: &FrameUniforms,
        points: &Buffer,
        diffuse: &Buffer,
        accumulation: &Buffer,
    ) -> Result<(), GpuError> {
        if !Self::keeps(frame.first_sample) {
            self.is_shown = false;
            return Ok(());
        }
        let is_first = frame.first_sample == 0;
        let place = self.last.map_or(0, |(place, _)| place);
        let current = if is_first { 1 - place } else { place };
        let mut earlier = self.last.map(|(place, frame)| (self.history[place].clone(), frame));
        if let Some(taken) = self.taken.take().filter(|_| is_first && earlier.is_none()) {
            earlier = Some((taken.history, taken.frame));
        }
        let earlier = earlier.filter(|_| is_first);
        let is_new = earlier.is_none();
        let (earlier_history, earlier) = earlier.unwrap_or_else(|| (self.history[1 - current].clone(), *frame));
        let mut frame = *frame;
        frame.selector = if is_new { 0 } else { HAS_EARLIER_FRAME };
        graph
            .pass(&self.kernel)
            .uniform("frame", bytemuck::bytes_of(&frame))
            .uniform("earlier", bytemuck::bytes_of(&earlier))
            .bind("visible_points", points)
            .bind("accumulation", accumulation)
            .bind("diffuse_light", diffuse)
            .bind("earlier_history", &earlier_history)
            .bind("history", &self.history[current])
            .bind("shown", &self.shown)
            .dispatch(workgroups_of(frame.width * frame.height))?;
        if is_first {
            self.is_shown = !is_new;
            self.last = Some((current, frame));
        }
        Ok(())
    }
}
