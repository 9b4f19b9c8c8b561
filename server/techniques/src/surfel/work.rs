//! What every pass over a cache has at hand.

use surfelcast_gpu::{Gpu, PassBuilder};

use crate::surfel::cache::SurfelCache;
use surfelcast_passes::counters;
use surfelcast_passes::kernels::KernelSet;
use surfelcast_passes::lights::LightBuffers;
use surfelcast_passes::step::Step;
use surfelcast_passes::upload::SceneBuffers;

/// What a pass over the cache works with.
pub(crate) struct Work<'a> {
    pub(crate) gpu: &'a Gpu,
    pub(crate) kernels: &'a KernelSet,
    pub(crate) scene: &'a SceneBuffers,
    pub(crate) lights: &'a LightBuffers,
}

impl SurfelCache {
    /// Binds what gathers read, as far as the kernel does.
    pub(crate) fn bind<'g>(&self, pass: PassBuilder<'g>) -> PassBuilder<'g> {
        pass.read_if_bound("surfels", &self.records)
            .read_if_bound("surfel_outputs", &self.outputs)
            .read_if_bound("surfel_grid", &self.grid)
            .read_if_bound("surfel_tiles", &self.tiles)
    }
}

pub(crate) fn u32_of(bytes: &[u8]) -> u32 {
    bytes.first_chunk::<4>().map_or(0, |word| u32::from_le_bytes(*word))
}

/// Adds a dispatch's counters to a step.
pub(crate) fn count_rays(step: &mut Step, bytes: &[u8]) {
    let counts = counters::sum(bytes);
    for (sum, counted) in step.rays.iter_mut().zip(counts.rays) {
        *sum += counted;
    }
    step.non_finite += counts.non_finite;
}
