//! Direct light of a picture: what shading keeps of it, reuse while the camera moves, and the filter.

use surfelcast_gpu::{Buffer, Gpu, GpuError, Graph, MemoryKind};
use surfelcast_shaders::constants::{KEEPS_DIFFUSE_LIGHT, REUSE_TURN_MASK};
use surfelcast_shaders::records::FrameUniforms;

use crate::surfel::filter::{LightFilter, Unfiltered};
use crate::surfel::reuse::{EarlierFrame, Reuse, has_noise};
use crate::technique::{Change, TechniqueOptions};
use surfelcast_passes::lights::LightBuffers;

/// What a picture keeps to show direct light with less noise than its samples have.
#[derive(Debug)]
pub(crate) struct DirectLight {
    filters: bool,
    reuses: bool,
    pixel_count: u32,
    /// B and reflectance by pixel, where they are reused or filtered; else a stand-in.
    diffuse: Buffer,
    /// Where direct light is noisy.
    filter: Option<LightFilter>,
    /// From the camera's first move on, where direct light is noisy.
    reuse: Option<Reuse>,
    /// The camera has moved since the picture was made.
    has_moved: bool,
    /// Moves of the camera since the light changed.
    turn: u32,
    /// Of the picture before this one, until it is reused.
    taken: Option<EarlierFrame>,
}

impl DirectLight {
    pub(crate) fn new(gpu: &Gpu, options: &TechniqueOptions) -> Result<Self, GpuError> {
        Ok(Self {
            // What is split apart is shown as it was sampled.
            filters: options.surfel.filters_direct && !options.is_split,
            reuses: options.surfel.reuses_direct && !options.is_split,
            pixel_count: options.size[0] * options.size[1],
            diffuse: gpu.buffer("diffuse_direct", MemoryKind::View, 16)?,
            filter: None,
            reuse: None,
            // Smaller than it will be shown: a gesture is on.
            has_moved: options.size != options.full_size,
            turn: 0,
            taken: None,
        })
    }

    /// Makes what filtering and reusing take before a first frame, once they are of use: pictures that never move reuse nothing.
    pub(crate) fn prepare(&mut self, gpu: &Gpu, lights: &LightBuffers) {
        let is_noisy = has_noise(lights);
        if !(self.filters && is_noisy) {
            self.filter = None;
        }
        if !(self.reuses && is_noisy) {
            (self.reuse, self.taken) = (None, None);
        }
        if is_noisy && let Err(reason) = self.make(gpu) {
            // A picture with more noise is better than none.
            tracing::warn!(%reason, "direct light is not filtered or not reused");
        }
    }

    fn make(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        let reuses = self.reuses && self.has_moved;
        let bytes = u64::from(self.pixel_count) * 16;
        if (self.filters || reuses) && self.diffuse.size_bytes() < bytes {
            self.diffuse = gpu.buffer("diffuse_direct", MemoryKind::View, bytes)?;
        }
        if self.filters && self.filter.is_none() {
            self.filter = Some(LightFilter::new(gpu, self.pixel_count)?);
        }
        if reuses && self.reuse.is_none() {
            self.reuse = Some(Reuse::new(gpu, self.pixel_count, self.taken.take())?);
        }
        Ok(())
    }

    /// What shading writes diffuse light to.
    pub(crate) const fn diffuse(&self) -> &Buffer {
        &self.diffuse
    }

    /// Selector of the shading pass for a sample with so many before it.
    pub(crate) fn selector(&self, samples: u32) -> u32 {
        let turn = if self.reuse.is_some() { self.turn & REUSE_TURN_MASK } else { 0 };
        let is_kept =
            self.reuse.is_some() && Reuse::keeps(samples) || self.filter.is_some() && LightFilter::keeps(samples);
        turn | if is_kept { KEEPS_DIFFUSE_LIGHT } else { 0 }
    }

    /// Records what follows the shading of a whole sample, which may be the last of its frame: only then is it looked at.
    pub(crate) fn record(
        &mut self,
        graph: &mut Graph,
        frame: &FrameUniforms,
        points: &Buffer,
        accumulation: &Buffer,
        is_last: bool,
    ) -> Result<(), GpuError> {
        if let Some(reuse) = &mut self.reuse {
            reuse.record(graph, frame, points, &self.diffuse, accumulation)?;
        }
        if let Some(filter) = self.filter.as_mut().filter(|_| is_last) {
            let reuse = self.reuse.as_ref();
            let unfiltered = Unfiltered {
                points,
                diffuse: &self.diffuse,
                history: reuse.and_then(Reuse::history),
                picture: reuse.and_then(Reuse::picture).unwrap_or(accumulation),
            };
            filter.record(graph, frame, &unfiltered)?;
        }
        Ok(())
    }

    /// The picture with direct light as it is shown, where that is not as it was sampled.
    pub(crate) fn picture(&self) -> Option<&Buffer> {
        let filtered = self.filter.as_ref().and_then(LightFilter::picture);
        filtered.or_else(|| self.reuse.as_ref().and_then(Reuse::picture))
    }

    /// The picture starts anew, after so many samples of the one before.
    pub(crate) fn restart(&mut self, change: Change, samples: u32) {
        match change {
            Change::Camera if samples > 0 => {
                self.has_moved = true;
                self.turn = self.turn.wrapping_add(1);
            }
            Change::Camera => {}
            // The cache belongs to the session, which tells it of such a change once.
            Change::Lights | Change::Transforms => {
                self.turn = 0;
                self.taken = None;
                if let Some(reuse) = &mut self.reuse {
                    reuse.forget();
                }
            }
        }
        if let Some(filter) = &mut self.filter {
            filter.restart();
        }
    }

    /// The last frame, for another picture.
    pub(crate) fn leave(&self) -> Option<EarlierFrame> {
        self.reuse.as_ref().and_then(|reuse| reuse.leave(self.turn))
    }

    /// Another picture's last frame, to start from.
    pub(crate) fn take(&mut self, earlier: EarlierFrame) {
        self.has_moved = true;
        self.turn = earlier.turn.wrapping_add(1);
        self.taken = Some(earlier);
    }
}
