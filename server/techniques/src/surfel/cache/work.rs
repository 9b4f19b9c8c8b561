//! What every pass over a cache works with.

use surfelcast_gpu::{Gpu, PassBuilder};
use surfelcast_passes::counters;
use surfelcast_passes::kernels::KernelSet;
use surfelcast_passes::lights::LightBuffers;
use surfelcast_passes::step::Step;
use surfelcast_passes::upload::SceneBuffers;

/// Device, kernels, scene and lights of a step.
#[derive(Clone, Copy)]
pub(crate) struct Work<'a> {
    pub(crate) gpu: &'a Gpu,
    pub(crate) kernels: &'a KernelSet,
    pub(crate) scene: &'a SceneBuffers,
    pub(crate) lights: &'a LightBuffers,
}

impl Work<'_> {
    /// Binds the scene and its lights to a pass that traces rays.
    pub(crate) fn bind_scene<'g>(&self, pass: PassBuilder<'g>) -> PassBuilder<'g> {
        self.lights.bind(self.scene.bind(pass))
    }
}

/// The word that a kernel returned.
pub(super) fn u32_of(bytes: &[u8]) -> u32 {
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
