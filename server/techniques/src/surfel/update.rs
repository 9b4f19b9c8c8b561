//! The passes of an update: which surfel gets how many rays, tracing them, means, and who is let go.
//!
//! Every sum runs in a fixed order, so a cache is a function of its settings, its seed and what was asked of it.

use surfelcast_gpu::{Gpu, Graph, Ticket};
use surfelcast_shaders::constants::SURFEL_RAY_BINS;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::{SurfelUniforms, surfel_switches};

use crate::surfel::cache::{SurfelCache, UpdateStage};
use crate::surfel::graph::SurfelGraph;
use crate::surfel::work::{Work, count_rays, u32_of};
use crate::technique::TechniqueError;
use surfelcast_passes::kernels::KernelSet;
use surfelcast_passes::step::Step;
use surfelcast_passes::{counters, merge_passes, workgroups_of};

/// An update waits where it has less than a ray for so many living surfels, and so many wait one after the other at most.
const SURFELS_PER_RAY: u32 = 16;
const MOST_WAITED: u32 = 3;

impl SurfelCache {
    /// Starts an update: deals the rays out, most of them to surfels that have none yet if those come first. With nothing to
    /// trace the cache is settled.
    pub(crate) fn begin_update(
        &mut self,
        work: &Work<'_>,
        frame: &[u8],
        ray_budget: u32,
        newborn_first: bool,
        step: &mut Step,
    ) -> Result<(), TechniqueError> {
        let Work { gpu, kernels, .. } = *work;
        self.reserve(gpu, ray_budget, 0)?;
        if self.live == 0 {
            self.is_settled = true;
            return Ok(());
        }
        let mut uniforms = self.uniforms(ray_budget);
        if newborn_first {
            uniforms.switches |= surfel_switches::NEWBORN_FIRST;
        }
        let bytes = bytemuck::bytes_of(&uniforms);
        let mut graph = gpu.graph("surfel_requests");
        if self.takes_new_edges() {
            self.record_edges(&mut graph, kernels)?;
        }
        if self.is_relit {
            graph
                .pass(kernels.get("surfel_relight")?)
                .uniform("cache", bytes)
                .read("surfel_lists", &self.lists)
                .read_write("surfel_lights", &self.lights)
                .read_write("outputs", &self.outputs)
                .dispatch(workgroups_of(self.live))?;
        }
        graph
            .pass(kernels.get("surfel_request")?)
            .uniform("cache", bytes)
            .read("surfels", &self.records)
            .read("surfel_lists", &self.lists)
            .read("surfel_lights", &self.lights)
            .read("slot_seen", &self.slot_seen)
            .read_write("scan_values", &self.values)
            .dispatch(workgroups_of(self.live))?;
        self.scan.record(&mut graph, &self.values, self.live + 1)?;
        let total = graph.read_back(&self.values, u64::from(self.live) * 4..u64::from(self.live) * 4 + 4)?;
        graph
            .pass(kernels.get("surfel_rays")?)
            .uniform("cache", bytes)
            .read("surfel_lists", &self.lists)
            .read("scan_values", &self.values)
            .read("surfel_lights", &self.lights)
            .read_write("rays", &self.rays)
            .read_write("ray_total", &self.answer)
            .dispatch(workgroups_of(self.live))?;
        let ray_total = graph.read_back(&self.answer, 0..4)?;
        if self.settings().bins_rays {
            graph.clear(&self.bins)?;
            self.bind(graph.pass(kernels.get("surfel_bin_count")?))
                .uniform("cache", bytes)
                .uniform("frame", frame)
                .read_write("rays", &self.rays)
                .read("ray_total", &self.answer)
                .read_write("bin_counts", &self.bins)
                .dispatch(workgroups_of(ray_budget))?;
            self.scan.record(&mut graph, &self.bins, SURFEL_RAY_BINS)?;
            graph
                .pass(kernels.get("surfel_bin_scatter")?)
                .read_write("rays", &self.rays)
                .read("ray_total", &self.answer)
                .read_write("bin_places", &self.bins)
                .dispatch(workgroups_of(ray_budget))?;
        }
        let mut report = graph.submit()?.wait()?;
        merge_passes(&mut step.passes, std::mem::take(&mut report.passes));
        self.is_relit = false;
        let asked = u32_of(&report.take(total)?);
        let count = u32_of(&report.take(ray_total)?);
        self.is_settled = asked == 0;
        if is_worth_its_passes(count, self.live, self.updates_waited) {
            self.stage = UpdateStage::Tracing { next: 0, count, budget: ray_budget };
            self.updates_waited = 0;
            self.newborn = 0;
        } else {
            // The next update asks again, and so does one for which chance gave no ray.
            self.update += 1;
            self.updates_waited += 1;
        }
        Ok(())
    }

    /// Traces up to `limit` rays of the update under way; with the last ones the means are updated. Returns rays traced.
    pub(crate) fn advance(
        &mut self,
        work: &Work<'_>,
        frame: &[u8],
        limit: u32,
        step: &mut Step,
    ) -> Result<u32, TechniqueError> {
        let Work { gpu, kernels, scene, lights } = *work;
        let UpdateStage::Tracing { next, count, budget } = self.stage else { return Ok(0) };
        let range = (count - next).min(limit.max(64)).min(65_535 * 64);
        let mut uniforms = self.uniforms(budget);
        (uniforms.first_item, uniforms.item_count) = (next, range);
        let mut graph = gpu.graph("surfel_trace");
        graph.clear(&self.counters)?;
        self.bind(lights.bind(scene.bind(graph.pass(kernels.get("surfel_trace")?))))
            .uniform("cache", bytemuck::bytes_of(&uniforms))
            .uniform("frame", frame)
            .read_write("rays", &self.rays)
            .read_write("candidates", &self.candidates)
            .read_write("slot_used", &self.slot_used)
            .read_write("counters", &self.counters)
            .read_write("first_hits", self.graph.as_ref().and_then(SurfelGraph::first_hits).unwrap_or(&self.no_hits))
            .dispatch([range.div_ceil(64 * rays_per_thread(gpu)), 1, 1])?;
        self.record_shifts(&mut graph, work, frame, &uniforms)?;
        let ticket = graph.read_back(&self.counters, 0..counters::BYTES)?;
        let is_last = next + range == count;
        let mut live = None;
        if is_last {
            if has_few_rays(count, self.live) {
                // What the last rays of a cache that has all but settled come upon would ask for rays of its own, and so on.
                self.withdraw_hits(&mut graph)?;
            }
            live = Some(self.record_integration(&mut graph, kernels, &uniforms)?);
        }
        let mut report = graph.submit()?.wait()?;
        merge_passes(&mut step.passes, std::mem::take(&mut report.passes));
        count_rays(step, &report.take(ticket)?);
        self.stage = UpdateStage::Tracing { next: next + range, count, budget };
        if let Some(live) = live {
            let bytes = report.take(live)?;
            let freed = self.live - u32_of(&bytes).min(self.live);
            self.stage = UpdateStage::Idle;
            self.update += 1;
            self.calm_updates = self.calm_updates.saturating_add(1);
            if freed > 0 {
                self.rebuild(work, self.live - freed, step)?;
            }
        }
        Ok(range)
    }

    fn record_integration(
        &self,
        graph: &mut Graph,
        kernels: &KernelSet,
        uniforms: &SurfelUniforms,
    ) -> Result<Ticket, TechniqueError> {
        let bytes = bytemuck::bytes_of(uniforms);
        let groups = workgroups_of(self.live);
        graph
            .pass(kernels.get("surfel_integrate")?)
            .uniform("cache", bytes)
            .read("surfels", &self.records)
            .read("surfel_lists", &self.lists)
            .read("scan_values", &self.values)
            .read("rays", &self.rays)
            .read_write("surfel_lights", &self.lights)
            .read_write("tiles", &self.tiles)
            .dispatch(groups)?;
        if self.graph.is_some() {
            self.record_reconstruction(graph, kernels, uniforms)?;
        }
        if self.settings().reconstruction.shows_means() {
            self.bind(graph.pass(kernels.get("surfel_share")?))
                .uniform("cache", bytes)
                .read("surfel_lists", &self.lists)
                .read("surfel_lights", &self.lights)
                .read_write("outputs", &self.outputs)
                .dispatch(groups)?;
        }
        graph
            .pass(kernels.get("surfel_recycle")?)
            .uniform("cache", bytes)
            .read("surfels", &self.records)
            .read("surfel_lists", &self.lists)
            .read("slot_seen", &self.slot_seen)
            .read("slot_used", &self.slot_used)
            .read("slot_pinned", &self.slot_pinned)
            .read_write("surfel_flags", &self.flags)
            .dispatch(groups)?;
        // How many are left; the lists follow only if that changed.
        self.record_numbers(graph, kernels, bytes)?;
        let end = u64::from(self.used) * 4;
        Ok(graph.read_back(&self.values, end..end + 4)?)
    }
}

/// Whether an update of so many rays is made now, after so many that waited: it goes through all surfels, however few have rays.
fn is_worth_its_passes(rays: u32, live: u32, waited: u32) -> bool {
    rays > 0 && (!has_few_rays(rays, live) || waited >= MOST_WAITED)
}

fn has_few_rays(rays: u32, live: u32) -> bool {
    rays < live / SURFELS_PER_RAY
}

/// A thread that takes the next ray when one has ended keeps its neighbours company; a GPU has to have enough threads first.
fn rays_per_thread(gpu: &Gpu) -> u32 {
    if gpu.is_cpu() { 16 } else { 1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn updates_of_few_rays_wait_but_not_for_ever() {
        let live = 100 * SURFELS_PER_RAY;
        assert!(is_worth_its_passes(100, live, 0));
        assert!(!is_worth_its_passes(99, live, MOST_WAITED - 1));
        assert!(is_worth_its_passes(1, live, MOST_WAITED));
        assert!(!is_worth_its_passes(0, live, MOST_WAITED), "there is nothing to trace");
        assert!(is_worth_its_passes(1, 3, 0), "a few surfels wait for nothing");
    }
}
