//! Samples in batches: the same number for every pixel, in ranges of pixels small enough that no submission holds the
//! device for long. Batch sizes follow from the sample count and never from timing, so the same job draws the same
//! numbers and merges them in the same order.

use surfelcast_shaders::constants::WORKGROUP_SIZE;
use surfelcast_shaders::records::FrameUniforms;

use crate::step::StepBudget;

/// Pixels of one dispatch at most: workgroups of one dimension.
const MAX_PIXELS: u32 = 65_535 * WORKGROUP_SIZE;

/// Progress of an image: how many samples each pixel has.
#[derive(Clone, Copy, Debug)]
pub struct Batches {
    pixel_count: u32,
    /// Samples a pixel in whole batches.
    samples: u32,
    /// Size of the batch in hand; 0 between batches.
    batch: u32,
    /// Pixels of the batch in hand that are done.
    pixels_done: u32,
}

impl Batches {
    /// No samples yet, for an image of this size.
    pub const fn new([width, height]: [u32; 2]) -> Self {
        Self { pixel_count: width * height, samples: 0, batch: 0, pixels_done: 0 }
    }

    /// Samples a pixel in whole batches.
    pub const fn samples(&self) -> u32 {
        self.samples
    }

    /// Starts a batch if none is in hand: as many samples as there are already, so that a first picture comes soon and
    /// later ones cost little overhead. Returns whether there is one.
    pub fn begin(&mut self, budget: &StepBudget) -> bool {
        if self.batch == 0 {
            let left = budget.until_samples.saturating_sub(self.samples);
            self.batch = self.samples.max(1).min(budget.max_batch.max(1)).min(left);
        }
        self.batch > 0
    }

    /// The pixels and samples that so many paths are enough for, at least one workgroup of pixels.
    pub fn range(&self, mut frame: FrameUniforms, max_paths: u64) -> FrameUniforms {
        let affordable = max_paths / u64::from(self.batch.max(1)) / u64::from(WORKGROUP_SIZE);
        let groups = affordable.clamp(1, u64::from(MAX_PIXELS / WORKGROUP_SIZE)) as u32;
        frame.first_pixel = self.pixels_done;
        frame.pixel_count = (groups * WORKGROUP_SIZE).min(self.pixel_count - self.pixels_done);
        frame.first_sample = self.samples;
        frame.sample_count = self.batch;
        frame
    }

    /// Takes a range as traced. Returns how many paths that were.
    pub fn advance(&mut self, range: &FrameUniforms) -> u64 {
        self.pixels_done += range.pixel_count;
        u64::from(range.pixel_count) * u64::from(self.batch)
    }

    /// Whether every pixel of the batch in hand is traced.
    pub const fn is_traced(&self) -> bool {
        self.pixels_done == self.pixel_count
    }

    /// Counts the batch in hand.
    pub const fn finish(&mut self) {
        self.samples += self.batch;
        self.batch = 0;
        self.pixels_done = 0;
    }

    /// Begins again from nothing.
    pub const fn restart(&mut self) {
        self.samples = 0;
        self.batch = 0;
        self.pixels_done = 0;
    }
}
