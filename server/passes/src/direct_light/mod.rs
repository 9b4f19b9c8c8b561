//! Direct light of an image with less noise than its samples have: light of the frame before is reused while the camera
//! moves (`reuse.rs`), and neighbouring pixels are averaged as far as they differ by noise (`filter.rs`).
//!
//! Shading keeps the diffuse part of its light samples by pixel (`shaders/techniques/common/direct_history.wesl`). The
//! mean that later samples are added to contains neither reused nor filtered light.

mod filter;
mod reuse;

use surfelcast_gpu::{Buffer, Gpu, GpuError, Graph, MemoryKind};
use surfelcast_shaders::constants::{KEEPS_DIFFUSE_LIGHT, REUSE_MOVES_MASK};
use surfelcast_shaders::records::FrameUniforms;

use self::filter::{LightFilter, Unfiltered};
pub use self::reuse::EarlierFrame;
use self::reuse::{Reuse, has_noise};
use crate::lights::LightBuffers;

/// What is done to the direct light of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DirectLightOptions {
    /// Size of the image, pixels.
    pub size: [u32; 2],
    /// Light of the frame before is reused after the camera moved.
    pub reuses: bool,
    /// Light is filtered over neighbouring pixels.
    pub filters: bool,
    /// The image belongs to a gesture that is under way.
    pub is_moving: bool,
}

/// Direct light of one image.
#[derive(Debug)]
pub struct DirectLight {
    options: DirectLightOptions,
    /// Irradiance over pi and reflectance by pixel, where they are reused or filtered; else a stand-in.
    diffuse: Buffer,
    /// `Some` where direct light is noisy.
    filter: Option<LightFilter>,
    /// `Some` from the camera's first move on, where direct light is noisy.
    reuse: Option<Reuse>,
    /// The camera has moved since the image was made.
    has_moved: bool,
    /// Moves of the camera since the light changed: light samples differ from move to move.
    moves: u32,
    /// Last frame of the image before this one, until it is reused.
    taken: Option<EarlierFrame>,
}

impl DirectLight {
    /// No light yet.
    pub fn new(gpu: &Gpu, options: DirectLightOptions) -> Result<Self, GpuError> {
        Ok(Self {
            options,
            diffuse: gpu.buffer("diffuse_direct", MemoryKind::View, 16)?,
            filter: None,
            reuse: None,
            has_moved: options.is_moving,
            moves: 0,
            taken: None,
        })
    }

    fn pixel_count(&self) -> u32 {
        self.options.size[0] * self.options.size[1]
    }

    /// Allocates what filter and reuse need, before the first frame that benefits: images that never move reuse
    /// nothing.
    pub fn prepare(&mut self, gpu: &Gpu, lights: &LightBuffers) {
        let is_noisy = has_noise(lights);
        if !(self.options.filters && is_noisy) {
            self.filter = None;
        }
        if !(self.options.reuses && is_noisy) {
            (self.reuse, self.taken) = (None, None);
        }
        if is_noisy && let Err(reason) = self.make(gpu) {
            // An image with more noise is better than none.
            tracing::warn!(%reason, "direct light is not filtered or not reused");
        }
    }

    fn make(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        let reuses = self.options.reuses && self.has_moved;
        let bytes = u64::from(self.pixel_count()) * 16;
        if (self.options.filters || reuses) && self.diffuse.size_bytes() < bytes {
            self.diffuse = gpu.buffer("diffuse_direct", MemoryKind::View, bytes)?;
        }
        if self.options.filters && self.filter.is_none() {
            self.filter = Some(LightFilter::new(gpu, self.pixel_count())?);
        }
        if reuses && self.reuse.is_none() {
            self.reuse = Some(Reuse::new(gpu, self.pixel_count(), self.taken.take())?);
        }
        Ok(())
    }

    /// The buffer that shading keeps diffuse light in.
    pub const fn diffuse(&self) -> &Buffer {
        &self.diffuse
    }

    /// Selector of the shading pass for the sample after `samples` samples.
    pub fn selector(&self, samples: u32) -> u32 {
        let moves = if self.reuse.is_some() { self.moves & REUSE_MOVES_MASK } else { 0 };
        let is_kept =
            self.reuse.is_some() && Reuse::keeps(samples) || self.filter.is_some() && LightFilter::keeps(samples);
        moves | if is_kept { KEEPS_DIFFUSE_LIGHT } else { 0 }
    }

    /// Records reuse and filter after the shading of a whole sample per pixel; `is_shown` for the last one of a frame,
    /// which alone is shown and so filtered.
    pub fn record(
        &mut self,
        graph: &mut Graph,
        frame: &FrameUniforms,
        points: &Buffer,
        accumulation: &Buffer,
        is_shown: bool,
    ) -> Result<(), GpuError> {
        if let Some(reuse) = &mut self.reuse {
            reuse.record(graph, frame, points, &self.diffuse, accumulation)?;
        }
        if let Some(filter) = self.filter.as_mut().filter(|_| is_shown) {
            let reuse = self.reuse.as_ref();
            let unfiltered = Unfiltered {
                points,
                diffuse: &self.diffuse,
                history: reuse.and_then(Reuse::history),
                image: reuse.and_then(Reuse::image).unwrap_or(accumulation),
            };
            filter.record(graph, frame, &unfiltered)?;
        }
        Ok(())
    }

    /// The image with reused or filtered direct light, where there is any.
    pub fn image(&self) -> Option<&Buffer> {
        let filtered = self.filter.as_ref().and_then(LightFilter::image);
        filtered.or_else(|| self.reuse.as_ref().and_then(Reuse::image))
    }

    /// The camera moved, after `frames` frames from where it was.
    pub fn move_camera(&mut self, frames: u32) {
        if frames > 0 {
            self.has_moved = true;
            self.moves = self.moves.wrapping_add(1);
        }
        self.restart();
    }

    /// The light changed: light of the past must not be shown.
    pub fn relight(&mut self) {
        self.moves = 0;
        self.taken = None;
        if let Some(reuse) = &mut self.reuse {
            reuse.forget();
        }
        self.restart();
    }

    fn restart(&mut self) {
        if let Some(filter) = &mut self.filter {
            filter.restart();
        }
    }

    /// The last frame, for another image of the same view.
    pub fn leave(&self) -> Option<EarlierFrame> {
        self.reuse.as_ref().and_then(|reuse| reuse.leave(self.moves))
    }

    /// Another image's last frame, to start from.
    pub fn take(&mut self, earlier: EarlierFrame) {
        self.has_moved = true;
        self.moves = earlier.moves.wrapping_add(1);
        self.taken = Some(earlier);
    }
}
