//! Batches of samples: the same number for every pixel, in ranges of pixels small enough that no submission holds the
//! device for long. Batch sizes follow from the sample count and never from timing, so the same job draws the same
//! random numbers and accumulates in the same order.

use surfelcast_shaders::constants::WORKGROUP_SIZE;
use surfelcast_shaders::records::FrameUniforms;

use crate::step::StepBudget;

/// Pixels of one dispatch at most: workgroups of one dimension.
const MAX_PIXELS: u32 = 65_535 * WORKGROUP_SIZE;

/// Progress of an image: how many samples each pixel has.
#[derive(Clone, Copy, Debug)]
pub struct Batches {
    pixel_count: u32,
    /// Samples per pixel in whole batches.
    samples: u32,
    /// Size of the current batch; 0 between batches.
    batch: u32,
    /// Pixels of the current batch that are traced.
    pixels_done: u32,
}

impl Batches {
    /// No samples yet, for an image of this size.
    pub const fn new([width, height]: [u32; 2]) -> Self {
        Self { pixel_count: width * height, samples: 0, batch: 0, pixels_done: 0 }
    }

    /// Samples per pixel in whole batches.
    pub const fn samples(&self) -> u32 {
        self.samples
    }

    /// Starts a batch if there is none: as many samples as there are already, so that the first image is fast and later
    /// ones have little overhead. Returns whether there is one.
    pub fn begin(&mut self, budget: &StepBudget) -> bool {
        if self.batch == 0 {
            let left = budget.until_samples.saturating_sub(self.samples);
            self.batch = self.samples.max(1).min(budget.max_batch.max(1)).min(left);
        }
        self.batch > 0
    }

    /// The range of pixels that `max_paths` paths suffice for, at least one workgroup.
    pub fn range(&self, mut frame: FrameUniforms, max_paths: u64) -> FrameUniforms {
        let affordable = max_paths / u64::from(self.batch.max(1)) / u64::from(WORKGROUP_SIZE);
        let groups = affordable.clamp(1, u64::from(MAX_PIXELS / WORKGROUP_SIZE)) as u32;
        frame.first_pixel = self.pixels_done;
        frame.pixel_count = (groups * WORKGROUP_SIZE).min(self.pixel_count - self.pixels_done);
        frame.first_sample = self.samples;
        frame.sample_count = self.batch;
        frame
    }

    /// Records a range as traced. Returns its number of paths.
    pub fn advance(&mut self, range: &FrameUniforms) -> u64 {
        self.pixels_done += range.pixel_count;
        u64::from(range.pixel_count) * u64::from(self.batch)
    }

    /// Whether every pixel of the current batch is traced.
    pub const fn is_traced(&self) -> bool {
        self.pixels_done == self.pixel_count
    }

    /// Ends the current batch.
    pub const fn finish(&mut self) {
        self.samples += self.batch;
        self.batch = 0;
        self.pixels_done = 0;
    }

    /// Discards all samples.
    pub const fn restart(&mut self) {
        self.samples = 0;
        self.batch = 0;
        self.pixels_done = 0;
    }
}
