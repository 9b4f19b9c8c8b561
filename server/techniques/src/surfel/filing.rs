//! The passes that list the living surfels and file them in the grid.

use surfelcast_gpu::{Graph, Ticket};
use surfelcast_shaders::layout::bytemuck;

use crate::surfel::cache::{ENTRIES_PER_SURFEL, SurfelCache};
use crate::surfel::work::{Work, u32_of};
use crate::technique::TechniqueError;
use surfelcast_passes::kernels::KernelSet;
use surfelcast_passes::step::Step;
use surfelcast_passes::{merge_passes, workgroups_of};

/// Entries of the trapezoidal grid for each surfel that fits, and cells that a single one is filed in, at most.
const MOST_ENTRIES_PER_SURFEL: u64 = 32;
const MOST_CELLS: u32 = 4096;

impl SurfelCache {
    /// Brings the cache up to date with its cameras: takes out pins of those gone, files what is not in the grid yet, and files
    /// everything anew where the grid has to follow its camera.
    pub(crate) fn file(&mut self, work: &Work<'_>, step: &mut Step) -> Result<(), TechniqueError> {
        if self.has_stale_pins {
            let mut graph = work.gpu.graph("surfel_unpin");
            graph.clear(&self.slot_pinned)?;
            graph.submit()?.wait()?;
            self.has_stale_pins = false;
        }
        if self.is_unfiled || self.grid_shape != self.wanted_grid() {
            self.rebuild(work, self.live, step)?;
            self.is_unfiled = false;
        }
        Ok(())
    }

    /// Lists the living and files them in the grid. `live` is how many there are now.
    pub(crate) fn rebuild(&mut self, work: &Work<'_>, live: u32, step: &mut Step) -> Result<(), TechniqueError> {
        let Work { gpu, kernels, .. } = *work;
        self.live = live;
        let mut graph = gpu.graph("surfel_grid");
        self.record_lists(&mut graph, kernels, bytemuck::bytes_of(&self.uniforms(0)))?;
        self.shape_grid(gpu, self.wanted_grid(), u64::from(self.capacity) * ENTRIES_PER_SURFEL)?;
        // A surfel that the grid's camera is very close to would reach into more cells than there is room for.
        let is_bounded = self.grid_shape.cells == 0;
        let mut most_cells = if is_bounded { u32::MAX } else { MOST_CELLS };
        let levels = loop {
            let levels = self.record_grid_counts(&mut graph, kernels, most_cells)?;
            if is_bounded {
                break Some(levels);
            }
            let end = u64::from(self.grid_shape.slots) * 4;
            let total = graph.read_back(&self.grid, end..end + 4)?;
            let mut report = graph.submit()?.wait()?;
            merge_passes(&mut step.passes, std::mem::take(&mut report.passes));
            self.levels = u32_of(&report.take(levels)?);
            let total = u64::from(u32_of(&report.take(total)?));
            graph = gpu.graph("surfel_grid");
            if total <= self.grid_room() {
                break None;
            }
            if total <= u64::from(self.capacity) * MOST_ENTRIES_PER_SURFEL {
                self.shape_grid(gpu, self.grid_shape, total.next_power_of_two())?;
            } else {
                most_cells /= 2;
            }
        };
        let mut uniforms = self.uniforms(0);
        uniforms.item_count = most_cells;
        let bytes = bytemuck::bytes_of(&uniforms);
        graph
            .pass(kernels.get("surfel_grid_scatter")?)
            .uniform("cache", bytes)
            .read("surfels", &self.records)
            .read("surfel_lists", &self.lists)
            .read_write("grid", &self.grid)
            .read_write("slot_cursors", &self.slot_cursors)
            .dispatch(workgroups_of(live))?;
        graph
            .pass(kernels.get("surfel_grid_sort")?)
            .uniform("cache", bytes)
            .read_write("grid", &self.grid)
            .dispatch(workgroups_of(self.grid_shape.slots))?;
        let mut report = graph.submit()?.wait()?;
        if let Some(levels) = levels {
            self.levels = u32_of(&report.take(levels)?);
        }
        merge_passes(&mut step.passes, report.passes);
        Ok(())
    }

    /// Counts each slot's entries, leaving out surfels in more than so many cells, and sums them up.
    fn record_grid_counts(
        &self,
        graph: &mut Graph,
        kernels: &KernelSet,
        most_cells: u32,
    ) -> Result<Ticket, TechniqueError> {
        let mut uniforms = self.uniforms(0);
        uniforms.item_count = most_cells;
        let slot_bytes = u64::from(self.grid_shape.slots) * 4;
        graph.clear_first(&self.grid, slot_bytes + 4)?;
        graph.clear_first(&self.slot_cursors, slot_bytes)?;
        graph.clear(&self.answer)?;
        graph
            .pass(kernels.get("surfel_grid_count")?)
            .uniform("cache", bytemuck::bytes_of(&uniforms))
            .read("surfels", &self.records)
            .read("surfel_lists", &self.lists)
            .read_write("slot_counts", &self.grid)
            .read_write("level_bits", &self.answer)
            .dispatch(workgroups_of(self.live))?;
        let levels = graph.read_back(&self.answer, 0..4)?;
        self.scan.record(graph, &self.grid, self.grid_shape.slots + 1)?;
        Ok(levels)
    }

    /// Numbers the living in the order of their ids; how many there are comes after the last number.
    pub(crate) fn record_numbers(
        &self,
        graph: &mut Graph,
        kernels: &KernelSet,
        cache: &[u8],
    ) -> Result<(), TechniqueError> {
        graph
            .pass(kernels.get("surfel_mark")?)
            .uniform("cache", cache)
            .read("surfel_flags", &self.flags)
            .read_write("scan_values", &self.values)
            .dispatch(workgroups_of(self.used))?;
        Ok(self.scan.record(graph, &self.values, self.used + 1)?)
    }

    fn record_lists(&self, graph: &mut Graph, kernels: &KernelSet, cache: &[u8]) -> Result<(), TechniqueError> {
        self.record_numbers(graph, kernels, cache)?;
        graph
            .pass(kernels.get("surfel_compact")?)
            .uniform("cache", cache)
            .read("surfel_flags", &self.flags)
            .read("scan_values", &self.values)
            .read_write("surfel_lists", &self.lists)
            .dispatch(workgroups_of(self.used))?;
        Ok(())
    }
}
