//! Updates: how many rays each surfel gets, tracing them, the means, and which surfels are recycled.
//!
//! Every sum runs in a fixed order, so a cache is a function of its settings, its seed and the views' requests.

use surfelcast_gpu::{Gpu, GpuError, Graph, GraphReport, Ticket};
use surfelcast_passes::kernels::KernelSet;
use surfelcast_passes::step::Step;
use surfelcast_passes::{counters, merge_passes, workgroups_of};
use surfelcast_shaders::constants::SURFEL_RAY_BINS;
use surfelcast_shaders::records::{SurfelUniforms, surfel_switches};

use super::SurfelCache;
use super::neighbours::Neighbours;
use super::work::{Work, count_rays, u32_of};

/// Skip an update with fewer than live/16 rays, at most three times in a row.
const SURFELS_PER_RAY: u32 = 16;
const MOST_SKIPPED: u32 = 3;

/// Progress of a cache's updates.
#[derive(Debug)]
pub(super) struct Updates {
    /// Number of the next update, or of the one under way.
    pub(super) number: u32,
    /// Updates skipped in a row because they had too few rays.
    skipped: u32,
    /// Updates since the light last changed.
    pub(super) since_relight: u32,
    /// Every surfel had reached its error goal when rays were last allocated, and none was spawned since.
    pub(super) is_converged: bool,
    running: Option<Running>,
}

/// Rays of the update under way.
#[derive(Clone, Copy, Debug)]
struct Running {
    /// First ray that is not traced yet.
    next: u32,
    /// Rays of the update.
    count: u32,
    /// Most rays that could have been allocated.
    budget: u32,
}

impl Default for Updates {
    fn default() -> Self {
        Self { number: 1, skipped: 0, since_relight: 0, is_converged: false, running: None }
    }
}

impl Updates {
    /// The light changed.
    pub(super) fn relight(&mut self) {
        self.is_converged = false;
        self.since_relight = 0;
    }

    /// Starts an update of `count` rays, or skips it.
    fn begin(&mut self, count: u32, budget: u32, live: u32) -> bool {
        let is_begun = is_worth_its_passes(count, live, self.skipped);
        if is_begun {
            self.running = Some(Running { next: 0, count, budget });
            self.skipped = 0;
        } else {
            // The next update requests rays again, also where stochastic rounding gave none.
            self.number += 1;
            self.skipped += 1;
        }
        is_begun
    }

    fn end(&mut self) {
        self.running = None;
        self.number += 1;
        self.since_relight = self.since_relight.saturating_add(1);
    }
}

/// A range of an update's rays, for one submission.
pub(crate) struct RayRange {
    running: Running,
    uniforms: SurfelUniforms,
}

impl RayRange {
    /// Rays in it.
    pub(crate) fn count(&self) -> u32 {
        self.uniforms.item_count
    }

    /// Whether it has the update's last rays.
    pub(crate) fn is_last(&self) -> bool {
        self.running.next + self.count() == self.running.count
    }
}

impl SurfelCache {
    /// Number of the next update, or of the one under way.
    pub(crate) fn update_number(&self) -> u32 {
        self.updates.number
    }

    /// Whether every surfel had reached its error goal when rays were last allocated, and none was spawned since.
    pub(crate) fn is_converged(&self) -> bool {
        self.updates.is_converged
    }

    /// Whether an update is under way: until it ends, nothing else may change the cache.
    pub(crate) fn is_updating(&self) -> bool {
        self.updates.running.is_some()
    }

    /// Rays of the update under way; 0 without one.
    pub(crate) fn rays_of_update(&self) -> u32 {
        self.updates.running.map_or(0, |running| running.count)
    }

    /// Allocates the rays of an update among the surfels; `new_first` gives most of them to surfels that have none yet.
    /// The update is then under way, unless it is skipped.
    pub(crate) fn allocate_rays(
        &mut self,
        work: &Work<'_>,
        frame: &[u8],
        budget: u32,
        new_first: bool,
        step: &mut Step,
    ) -> Result<(), GpuError> {
        let Work { gpu, kernels, .. } = *work;
        if !self.is_updating() {
            self.memory.reserve_rays(gpu, budget)?;
            if let Some(neighbours) = &mut self.neighbours {
                neighbours.reserve(gpu, u64::from(budget))?;
            }
        }
        if self.live == 0 {
            self.updates.is_converged = true;
            return Ok(());
        }
        let mut uniforms = self.uniforms(budget);
        if new_first {
            uniforms.switches |= surfel_switches::NEW_FIRST;
        }
        let surfels = workgroups_of(self.live);
        let mut graph = gpu.graph("surfel_requests");
        self.record_edges(&mut graph, kernels)?;
        if self.is_relit {
            self.pass(&mut graph, kernels, "surfel_relight", &uniforms)?.dispatch(surfels)?;
        }
        self.pass(&mut graph, kernels, "surfel_request", &uniforms)?.dispatch(surfels)?;
        self.memory.scan.record(&mut graph, &self.memory.values, self.live + 1)?;
        let end = u64::from(self.live) * 4;
        let requested = graph.read_back(&self.memory.values, end..end + 4)?;
        self.pass(&mut graph, kernels, "surfel_rays", &uniforms)?.dispatch(surfels)?;
        let allocated = graph.read_back(&self.memory.answer, 0..4)?;
        if self.settings.bins_rays {
            self.record_binning(&mut graph, kernels, frame, &uniforms)?;
        }
        let mut report = graph.submit()?.wait()?;
        merge_passes(&mut step.passes, std::mem::take(&mut report.passes));
        self.is_relit = false;
        self.updates.is_converged = u32_of(&report.take(requested)?) == 0;
        if self.updates.begin(u32_of(&report.take(allocated)?), budget, self.live) {
            self.new = 0;
        }
        Ok(())
    }

    /// Sorts the rays by place and direction.
    fn record_binning(
        &self,
        graph: &mut Graph,
        kernels: &KernelSet,
        frame: &[u8],
        uniforms: &SurfelUniforms,
    ) -> Result<(), GpuError> {
        let rays = workgroups_of(uniforms.ray_budget);
        graph.clear(&self.memory.bins)?;
        self.pass(graph, kernels, "surfel_bin_count", uniforms)?.uniform("frame", frame).dispatch(rays)?;
        self.memory.scan.record(graph, &self.memory.bins, SURFEL_RAY_BINS)?;
        self.pass(graph, kernels, "surfel_bin_scatter", uniforms)?.dispatch(rays)
    }

    /// The next rays of the update under way, about `limit`; `None` without an update.
    pub(crate) fn next_rays(&self, limit: u32) -> Option<RayRange> {
        let running = self.updates.running?;
        let item_count = (running.count - running.next).min(limit.max(64)).min(65_535 * 64);
        let uniforms = SurfelUniforms { first_item: running.next, item_count, ..self.uniforms(running.budget) };
        Some(RayRange { running, uniforms })
    }

    /// Traces a range of rays. The ticket is for the ray counters.
    pub(crate) fn record_trace(
        &self,
        graph: &mut Graph,
        work: &Work<'_>,
        frame: &[u8],
        range: &RayRange,
    ) -> Result<Ticket, GpuError> {
        graph.clear(&self.memory.counters)?;
        work.bind_scene(self.pass(graph, work.kernels, "surfel_trace", &range.uniforms)?)
            .uniform("frame", frame)
            .dispatch([range.count().div_ceil(64 * rays_per_thread(work.gpu)), 1, 1])?;
        if self.neighbours.as_ref().is_some_and(Neighbours::measures_differences) {
            self.record_shifts(graph, work, frame, &range.uniforms)?;
        }
        graph.read_back(&self.memory.counters, 0..counters::BYTES)
    }

    /// Adds the rays of the whole update to the surfels' means.
    pub(crate) fn record_integration(
        &self,
        graph: &mut Graph,
        work: &Work<'_>,
        range: &RayRange,
    ) -> Result<(), GpuError> {
        if has_few_rays(range.running.count, self.live) {
            // A nearly converged cache spawns no surfels at ray hits: they would request rays, whose hits would spawn
            // more, and it would never converge.
            self.memory.withdraw_hit_candidates(graph)?;
        }
        self.pass(graph, work.kernels, "surfel_integrate", &range.uniforms)?.dispatch(workgroups_of(self.live))
    }

    /// Reconstructs what lookups read from what surfels measured.
    pub(crate) fn record_reconstruction(
        &self,
        graph: &mut Graph,
        work: &Work<'_>,
        range: &RayRange,
    ) -> Result<(), GpuError> {
        if self.neighbours.is_some() {
            self.record_neighbours(graph, work.kernels, &range.uniforms)?;
        }
        if self.settings.reconstruction.shows_means() {
            self.pass(graph, work.kernels, "surfel_share", &range.uniforms)?.dispatch(workgroups_of(self.live))?;
        }
        Ok(())
    }

    /// Frees surfels that nothing uses. The ticket is for the number of those left; the lists follow only if that
    /// changed.
    pub(crate) fn record_recycling(
        &self,
        graph: &mut Graph,
        work: &Work<'_>,
        range: &RayRange,
    ) -> Result<Ticket, GpuError> {
        self.pass(graph, work.kernels, "surfel_recycle", &range.uniforms)?.dispatch(workgroups_of(self.live))?;
        self.record_numbers(graph, work.kernels)?;
        let end = u64::from(self.used) * 4;
        graph.read_back(&self.memory.values, end..end + 4)
    }

    /// Takes the report of a range: `rays` of [`Self::record_trace`], and `left` of [`Self::record_recycling`] with the
    /// last one, which ends the update.
    pub(crate) fn end_rays(
        &mut self,
        work: &Work<'_>,
        range: &RayRange,
        mut report: GraphReport,
        rays: Ticket,
        left: Option<Ticket>,
        step: &mut Step,
    ) -> Result<(), GpuError> {
        merge_passes(&mut step.passes, std::mem::take(&mut report.passes));
        count_rays(step, &report.take(rays)?);
        self.updates.running = Some(Running { next: range.running.next + range.count(), ..range.running });
        if let Some(left) = left {
            let left = u32_of(&report.take(left)?).min(self.live);
            self.updates.end();
            if left < self.live {
                self.rebuild(work, left, step)?;
            }
        }
        Ok(())
    }
}

/// Whether an update is made now, after `skipped` that were not: it visits all surfels, however few have rays.
fn is_worth_its_passes(rays: u32, live: u32, skipped: u32) -> bool {
    rays > 0 && (!has_few_rays(rays, live) || skipped >= MOST_SKIPPED)
}

fn has_few_rays(rays: u32, live: u32) -> bool {
    rays < live / SURFELS_PER_RAY
}

/// Persistent threads: 16 rays per invocation keep SIMD lanes busy on CPU drivers; on a GPU occupancy matters more, so
/// one.
fn rays_per_thread(gpu: &Gpu) -> u32 {
    if gpu.is_cpu() { 16 } else { 1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn updates_of_few_rays_are_skipped_but_not_for_ever() {
        let live = 100 * SURFELS_PER_RAY;
        assert!(is_worth_its_passes(100, live, 0));
        assert!(!is_worth_its_passes(99, live, MOST_SKIPPED - 1));
        assert!(is_worth_its_passes(1, live, MOST_SKIPPED));
        assert!(!is_worth_its_passes(0, live, MOST_SKIPPED), "there is nothing to trace");
        assert!(is_worth_its_passes(1, 3, 0), "with a few surfels no update is skipped");
    }

    #[test]
    fn a_skipped_update_counts_and_a_running_one_ends() {
        let live = 100 * SURFELS_PER_RAY;
        let mut updates = Updates::default();
        for number in 2..=4 {
            assert!(!updates.begin(1, 1000, live));
            assert_eq!((updates.number, updates.running.is_none()), (number, true));
        }
        assert!(updates.begin(1, 1000, live));
        updates.end();
        assert_eq!((updates.number, updates.since_relight, updates.running.is_none()), (5, 1, true));
    }
}
