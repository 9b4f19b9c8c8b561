//! Direct light filtered over neighbouring pixels, as far as it is noise (`filter/light.wesl`).

use surfelcast_gpu::{Buffer, Gpu, GpuError, Graph, Kernel, MemoryKind};
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::{FilterUniforms, FrameUniforms};

use surfelcast_passes::workgroups_of;

/// Samples of a pixel up to which its light is filtered as far as it is noise. The filter then fades until there are twice as
/// many, and pictures pay nothing more for it.
const FILTERED_SAMPLES: u32 = 64;

/// What the filter works on, as shading and reuse leave it.
pub(crate) struct Unfiltered<'a> {
    /// `VisiblePoint` by pixel.
    pub(crate) points: &'a Buffer,
    /// Mean B and reflectance by pixel.
    pub(crate) diffuse: &'a Buffer,
    /// `DirectHistory` by pixel, where light of the frame before is in the picture.
    pub(crate) history: Option<&'a Buffer>,
    /// The picture.
    pub(crate) picture: &'a Buffer,
}

/// What a picture keeps to filter its direct light.
#[derive(Debug)]
pub(crate) struct LightFilter {
    gather: Kernel,
    blend: Kernel,
    /// What pixels around say, and noise, 16 bytes a pixel.
    filtered: Buffer,
    /// Luminance of B at two earlier counts of samples.
    earlier: Buffer,
    /// The picture with filtered light.
    shown: Buffer,
    is_shown: bool,
    /// Those counts; 0 for none.
    counts: [u32; 2],
}

impl LightFilter {
    pub(crate) fn new(gpu: &Gpu, pixel_count: u32) -> Result<Self, GpuError> {
        let buffer = |label, bytes: u64| gpu.buffer(label, MemoryKind::View, u64::from(pixel_count) * bytes);
        Ok(Self {
            gather: gpu.kernel("filter_gather", Features::NONE)?,
            blend: gpu.kernel("filter_blend", Features::NONE)?,
            filtered: buffer("filtered", 16)?,
            earlier: buffer("earlier_light", 8)?,
            shown: buffer("filtered_picture", 16)?,
            is_shown: false,
            counts: [0; 2],
        })
    }

    /// Whether light is kept of a sample with so many before it.
    pub(crate) const fn keeps(samples: u32) -> bool {
        samples < 2 * FILTERED_SAMPLES
    }

    /// The picture starts anew.
    pub(crate) fn restart(&mut self) {
        self.is_shown = false;
        self.counts = [0; 2];
    }

    /// The picture with filtered light, while there is noise to filter.
    pub(crate) fn picture(&self) -> Option<&Buffer> {
        self.is_shown.then_some(&self.shown)
    }

    /// Notes that there are so many samples. Returns the number to compare with, 0 for none, and whether this one is kept to
    /// compare later ones with: there are always between two and four times as many samples as were compared with.
    fn count(&mut self, samples: u32) -> (u32, bool) {
        let [_, kept] = self.counts;
        let is_kept = samples >= 2 * kept;
        if is_kept {
            self.counts = [kept, samples];
        }
        (self.counts[0], is_kept)
    }

    /// Records the filter after a frame with the samples of `frame` and those before.
    pub(crate) fn record(
        &mut self,
        graph: &mut Graph,
        frame: &FrameUniforms,
        unfiltered: &Unfiltered<'_>,
    ) -> Result<(), GpuError> {
        self.is_shown = Self::keeps(frame.first_sample);
        if !self.is_shown {
            return Ok(());
        }
        let samples = frame.first_sample + 1;
        let (earlier_samples, is_kept) = self.count(samples);
        let uniforms = FilterUniforms {
            earlier_samples: earlier_samples as f32,
            is_kept: u32::from(is_kept),
            has_reused: u32::from(unfiltered.history.is_some()),
            strength: (2.0 - samples as f32 / FILTERED_SAMPLES as f32).clamp(0.0, 1.0),
        };
        let workgroups = workgroups_of(frame.width * frame.height);
        // Where there is no history it is not read, whatever is bound.
        let history = unfiltered.history.unwrap_or(unfiltered.points);
        graph
            .pass(&self.gather)
            .uniform("frame", bytemuck::bytes_of(frame))
            .uniform("filtering", bytemuck::bytes_of(&uniforms))
            .read("visible_points", unfiltered.points)
            .read("diffuse_light", unfiltered.diffuse)
            .read("history", history)
            .read("picture", unfiltered.picture)
            .read_write("earlier_light", &self.earlier)
            .read_write("filtered", &self.filtered)
            .dispatch(workgroups)?;
        graph
            .pass(&self.blend)
            .uniform("frame", bytemuck::bytes_of(frame))
            .uniform("filtering", bytemuck::bytes_of(&uniforms))
            .read("diffuse_light", unfiltered.diffuse)
            .read("history", history)
            .read("picture", unfiltered.picture)
            .read("filtered", &self.filtered)
            .read_write("shown", &self.shown)
            .dispatch(workgroups)
    }
}
