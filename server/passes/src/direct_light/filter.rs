//! Direct light averaged over neighbouring pixels, as far as they differ by noise (`direct_filter.wesl`).

use surfelcast_gpu::{Buffer, Gpu, GpuError, Graph, Kernel, MemoryKind};
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::{FilterUniforms, FrameUniforms};

use crate::workgroups_of;

/// Samples per pixel up to which the filter has its full strength. It then fades out until there are twice as many, and
/// costs nothing from then on.
const FILTERED_SAMPLES: u32 = 64;

/// Input of the filter: what shading and reuse wrote.
pub(super) struct Unfiltered<'a> {
    /// `VisiblePoint` by pixel.
    pub(super) points: &'a Buffer,
    /// Mean irradiance over pi and reflectance by pixel.
    pub(super) diffuse: &'a Buffer,
    /// `DirectHistory` by pixel, where the image contains light of the frame before.
    pub(super) history: Option<&'a Buffer>,
    /// The image.
    pub(super) image: &'a Buffer,
}

/// Filter of one image's direct light.
#[derive(Debug)]
pub(super) struct LightFilter {
    gather: Kernel,
    blend: Kernel,
    /// Mean of the neighbouring pixels, and noise, 16 bytes a pixel.
    filtered: Buffer,
    /// Luminance of irradiance over pi at two earlier sample counts.
    earlier: Buffer,
    /// The image with filtered light.
    shown: Buffer,
    is_shown: bool,
    /// The two sample counts; 0 for none.
    counts: [u32; 2],
}

impl LightFilter {
    pub(super) fn new(gpu: &Gpu, pixel_count: u32) -> Result<Self, GpuError> {
        let buffer = |label, bytes: u64| gpu.buffer(label, MemoryKind::View, u64::from(pixel_count) * bytes);
        Ok(Self {
            gather: gpu.kernel("direct_filter_gather", Features::NONE)?,
            blend: gpu.kernel("direct_filter_blend", Features::NONE)?,
            filtered: buffer("filtered", 16)?,
            earlier: buffer("earlier_light", 8)?,
            shown: buffer("filtered_picture", 16)?,
            is_shown: false,
            counts: [0; 2],
        })
    }

    /// Whether the sample after `samples` samples is kept for the filter.
    pub(super) const fn keeps(samples: u32) -> bool {
        samples < 2 * FILTERED_SAMPLES
    }

    /// The image starts again.
    pub(super) fn restart(&mut self) {
        self.is_shown = false;
        self.counts = [0; 2];
    }

    /// The image with filtered light, while there is noise to filter.
    pub(super) fn image(&self) -> Option<&Buffer> {
        self.is_shown.then_some(&self.shown)
    }

    /// Records the present sample count. Returns the earlier count to compare with, 0 for none, and whether the present
    /// mean is kept for later comparison: the present count is always two to four times the one that it is compared
    /// with.
    fn count(&mut self, samples: u32) -> (u32, bool) {
        let [_, kept] = self.counts;
        let is_kept = samples >= 2 * kept;
        if is_kept {
            self.counts = [kept, samples];
        }
        (self.counts[0], is_kept)
    }

    /// Records the filter after the last sample of a frame.
    pub(super) fn record(
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
        // A kernel that has no history to read must still bind a buffer.
        let history = unfiltered.history.unwrap_or(unfiltered.points);
        graph
            .pass(&self.gather)
            .uniform("frame", bytemuck::bytes_of(frame))
            .uniform("filtering", bytemuck::bytes_of(&uniforms))
            .bind("visible_points", unfiltered.points)
            .bind("diffuse_light", unfiltered.diffuse)
            .bind("history", history)
            .bind("unfiltered", unfiltered.image)
            .bind("earlier_light", &self.earlier)
            .bind("filtered", &self.filtered)
            .dispatch(workgroups)?;
        graph
            .pass(&self.blend)
            .uniform("frame", bytemuck::bytes_of(frame))
            .uniform("filtering", bytemuck::bytes_of(&uniforms))
            .bind("diffuse_light", unfiltered.diffuse)
            .bind("history", history)
            .bind("unfiltered", unfiltered.image)
            .bind("filtered", &self.filtered)
            .bind("shown", &self.shown)
            .dispatch(workgroups)
    }
}
