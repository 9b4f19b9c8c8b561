//! Direct light of the frame before, for pictures whose camera moves (`surfel_reuse.wesl`).

use surfelcast_gpu::{Buffer, Gpu, GpuError, Graph, Kernel, MemoryKind};
use surfelcast_shaders::Features;
use surfelcast_shaders::constants::{HAS_EARLIER_FRAME, REUSED_FRAMES};
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::{DirectHistory, FrameUniforms};

use surfelcast_passes::lights::LightBuffers;
use surfelcast_passes::workgroups_of;

/// Point lights up to this number are all asked in every frame, which leaves no noise.
const EXACT_LIGHTS: u32 = 4;

/// Whether direct light has noise that reusing or filtering it takes away.
pub(crate) const fn has_noise(lights: &LightBuffers) -> bool {
    lights.triangle_count + lights.environment_count > 0 || lights.punctual_count > EXACT_LIGHTS
}

/// The last frame of a picture, as far as the next one can use it. Opaque to whoever hands it on.
#[derive(Debug)]
pub struct EarlierFrame {
    /// `DirectHistory` by pixel.
    history: Buffer,
    frame: FrameUniforms,
    /// The picture's count of camera moves.
    pub(crate) turn: u32,
}

/// What a picture keeps to reuse its direct light.
#[derive(Debug)]
pub(crate) struct Reuse {
    kernel: Kernel,
    /// `DirectHistory` by pixel, of this frame and of the one before in turn.
    history: [Buffer; 2],
    /// Which of them holds the last frame, and the frame; none since the light changed.
    last: Option<(usize, FrameUniforms)>,
    /// The frame before the first, of another picture.
    taken: Option<EarlierFrame>,
    /// The picture with what is reused.
    shown: Buffer,
    /// Whether that differs from the picture itself.
    is_shown: bool,
}

impl Reuse {
    /// `taken` is another picture's last frame to start from.
    pub(crate) fn new(gpu: &Gpu, pixel_count: u32, taken: Option<EarlierFrame>) -> Result<Self, GpuError> {
        let pixels = u64::from(pixel_count);
        let buffer = |label, bytes: usize| gpu.buffer(label, MemoryKind::View, pixels * bytes as u64);
        let history = || buffer("direct_history", size_of::<DirectHistory>());
        let reuse = Self {
            kernel: gpu.kernel("surfel_reuse", Features::NONE)?,
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

    /// Whether a sample with so many before it is kept for later frames. After that nothing reused is left in the picture, and
    /// nothing is to be done.
    pub(crate) const fn keeps(samples: u32) -> bool {
        samples < 2 * REUSED_FRAMES
    }

    /// The light changed: nothing of the past may show.
    pub(crate) fn forget(&mut self) {
        self.last = None;
        self.taken = None;
        self.is_shown = false;
    }

    /// The last frame, for another picture.
    pub(crate) fn leave(&self, turn: u32) -> Option<EarlierFrame> {
        self.last.map(|(place, frame)| EarlierFrame { history: self.history[place].clone(), frame, turn })
    }

    /// `DirectHistory` of what is shown, while that has something reused in it.
    pub(crate) fn history(&self) -> Option<&Buffer> {
        let (place, _) = self.last.filter(|_| self.is_shown)?;
        Some(&self.history[place])
    }

    /// The picture with what is reused, while there is any.
    pub(crate) fn picture(&self) -> Option<&Buffer> {
        self.is_shown.then_some(&self.shown)
    }

    /// Records what follows the shading of a whole sample.
    pub(crate) fn record(
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
            .read("visible_points", points)
            .read("accumulation", accumulation)
            .read("diffuse_light", diffuse)
            .read("earlier_history", &earlier_history)
            .read_write("history", &self.history[current])
            .read_write("shown", &self.shown)
            .dispatch(workgroups_of(frame.width * frame.height))?;
        if is_first {
            self.is_shown = !is_new;
            self.last = Some((current, frame));
        }
        Ok(())
    }
}
