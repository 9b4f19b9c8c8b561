//! The grid build: listing the live surfels and inserting them into the grid.

use surfelcast_gpu::{Gpu, GpuError, Graph, Ticket};
use surfelcast_passes::kernels::KernelSet;
use surfelcast_passes::step::Step;
use surfelcast_passes::{merge_passes, workgroups_of};
use surfelcast_shaders::records::SurfelUniforms;

use super::SurfelCache;
use super::grid::GridShape;
use super::memory::ENTRIES_PER_SURFEL;
use super::work::{Work, u32_of};
use crate::surfel::settings::Grid;

/// Entries of the trapezoidal grid for each surfel that fits, at most.
const MOST_ENTRIES_PER_SURFEL: u64 = 32;
/// Cells of the trapezoidal grid that a single surfel is inserted into, at most.
const MOST_CELLS: u32 = 4096;

impl SurfelCache {
    /// Brings the grid up to date with the cameras: clears stale pins, inserts surfels that are not inserted yet, and
    /// builds the grid again where it follows a camera that moved.
    pub(crate) fn insert(&mut self, work: &Work<'_>, step: &mut Step) -> Result<(), GpuError> {
        if self.cameras.has_stale_pins {
            let mut graph = work.gpu.graph("surfel_unpin");
            graph.clear(&self.memory.slot_pinned)?;
            graph.submit()?.wait()?;
            self.cameras.has_stale_pins = false;
        }
        if self.awaits_insertion || self.grid_shape != self.wanted_grid() {
            self.rebuild(work, self.live, step)?;
            self.awaits_insertion = false;
        }
        Ok(())
    }

    /// Lists the live surfels, of which there are `live` now, and inserts them into the grid.
    pub(super) fn rebuild(&mut self, work: &Work<'_>, live: u32, step: &mut Step) -> Result<(), GpuError> {
        let Work { gpu, kernels, .. } = *work;
        self.live = live;
        let mut graph = gpu.graph("surfel_grid");
        self.record_lists(&mut graph, kernels)?;
        self.shape_grid(gpu, self.wanted_grid(), u64::from(self.capacity) * ENTRIES_PER_SURFEL)?;
        // A surfel very close to the trapezoidal grid's camera overlaps more cells than there is room for.
        let is_bounded = self.grid_shape.cells == 0;
        let mut most_cells = if is_bounded { u32::MAX } else { MOST_CELLS };
        let levels = loop {
            let levels = self.record_grid_counts(&mut graph, kernels, most_cells)?;
            if is_bounded {
                break Some(levels);
            }
            let end = u64::from(self.grid_shape.slots) * 4;
            let total = graph.read_back(&self.memory.grid, end..end + 4)?;
            let mut report = graph.submit()?.wait()?;
            merge_passes(&mut step.passes, std::mem::take(&mut report.passes));
            self.levels = u32_of(&report.take(levels)?);
            let total = u64::from(u32_of(&report.take(total)?));
            graph = gpu.graph("surfel_grid");
            if total <= self.memory.grid_room(self.grid_shape.slots) {
                break None;
            }
            if total <= u64::from(self.capacity) * MOST_ENTRIES_PER_SURFEL {
                self.shape_grid(gpu, self.grid_shape, total.next_power_of_two())?;
            } else {
                most_cells /= 2;
            }
        };
        let uniforms = SurfelUniforms { item_count: most_cells, ..self.uniforms(0) };
        self.pass(&mut graph, kernels, "surfel_grid_scatter", &uniforms)?.dispatch(workgroups_of(live))?;
        self.pass(&mut graph, kernels, "surfel_grid_sort", &uniforms)?
            .dispatch(workgroups_of(self.grid_shape.slots))?;
        let mut report = graph.submit()?.wait()?;
        if let Some(levels) = levels {
            self.levels = u32_of(&report.take(levels)?);
        }
        merge_passes(&mut step.passes, report.passes);
        Ok(())
    }

    /// Shape of the grid that the settings and the first camera require now.
    fn wanted_grid(&self) -> GridShape {
        match (self.settings.grid, self.cameras.first()) {
            (Grid::Cascades, _) => GridShape::cascades(self.live, self.mark_slots),
            (Grid::Trapezoidal, Some(camera)) => {
                GridShape::trapezoidal(camera, self.scene_radius, self.settings.radius_pixels)
            }
            (Grid::Trapezoidal, None) => self.grid_shape,
        }
    }

    /// Gives the grid a shape and room for at least `entries` entries. What was in it is lost.
    fn shape_grid(&mut self, gpu: &Gpu, shape: GridShape, entries: u64) -> Result<(), GpuError> {
        self.grid_shape = shape;
        self.memory.reserve_grid(gpu, shape.slots, entries)
    }

    /// Counts each slot's entries and sums them up, without surfels that overlap more than `most_cells` cells.
    fn record_grid_counts(&self, graph: &mut Graph, kernels: &KernelSet, most_cells: u32) -> Result<Ticket, GpuError> {
        let uniforms = SurfelUniforms { item_count: most_cells, ..self.uniforms(0) };
        let slot_bytes = u64::from(self.grid_shape.slots) * 4;
        graph.clear_first(&self.memory.grid, slot_bytes + 4)?;
        graph.clear_first(&self.memory.slot_cursors, slot_bytes)?;
        graph.clear(&self.memory.answer)?;
        self.pass(graph, kernels, "surfel_grid_count", &uniforms)?.dispatch(workgroups_of(self.live))?;
        let levels = graph.read_back(&self.memory.answer, 0..4)?;
        self.memory.scan.record(graph, &self.memory.grid, self.grid_shape.slots + 1)?;
        Ok(levels)
    }

    /// Numbers the live surfels in the order of their ids; their count comes after the last number.
    pub(super) fn record_numbers(&self, graph: &mut Graph, kernels: &KernelSet) -> Result<(), GpuError> {
        self.pass(graph, kernels, "surfel_mark", &self.uniforms(0))?.dispatch(workgroups_of(self.used))?;
        self.memory.scan.record(graph, &self.memory.values, self.used + 1)
    }

    fn record_lists(&self, graph: &mut Graph, kernels: &KernelSet) -> Result<(), GpuError> {
        self.record_numbers(graph, kernels)?;
        self.pass(graph, kernels, "surfel_compact", &self.uniforms(0))?.dispatch(workgroups_of(self.used))
    }
}
