//! One step of work: what it may cost and what it did.

use surfelcast_gpu::PassTime;

use crate::merge_passes;

/// Bounds of one step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepBudget {
    /// Number of paths to aim at: samples times pixels. The caller derives it from the measured rate of paths, so that
    /// a step ends within the time that other views may have to wait.
    pub max_paths: u64,
    /// Samples a pixel at which the caller reads the image next; the step does not go beyond them.
    pub until_samples: u32,
    /// Largest number of samples in a batch over all pixels. A fixed bound keeps images reproducible.
    pub max_batch: u32,
}

/// What one step did.
#[derive(Clone, Debug, Default)]
pub struct Step {
    /// Whether all pixels now have the same number of samples.
    pub is_whole: bool,
    /// Paths traced.
    pub paths: u64,
    /// Rays: primary, secondary, shadow.
    pub rays: [u64; 3],
    /// Samples that were not finite.
    pub non_finite: u64,
    /// Passes with their times.
    pub passes: Vec<PassTime>,
}

impl Step {
    /// Adds paths, rays and times of a part of this step; whether the step is whole does not follow from it.
    pub fn add(&mut self, part: Self) {
        self.paths += part.paths;
        for (sum, count) in self.rays.iter_mut().zip(part.rays) {
            *sum += count;
        }
        self.non_finite += part.non_finite;
        merge_passes(&mut self.passes, part.passes);
    }
}
