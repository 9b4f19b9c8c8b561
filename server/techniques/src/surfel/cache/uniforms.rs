//! Uniforms of passes over a cache.

use surfelcast_shaders::records::{SurfelUniforms, surfel_switches};

use super::SurfelCache;
use crate::surfel::settings::{Estimator, Grid};

/// Updates after a lighting change in which the drift test may shorten means.
const DRIFT_UPDATES: u32 = 256;

impl SurfelCache {
    /// Uniforms of a pass over a view; `is_coarse` where coarse surfels suffice for it.
    pub(crate) fn uniforms_for_view(&self, is_coarse: bool) -> SurfelUniforms {
        let mut uniforms = self.uniforms(0);
        if is_coarse {
            uniforms.switches |= surfel_switches::COARSE;
        }
        uniforms
    }

    /// Uniforms of a dispatch; the caller fills in which items it works on.
    pub(crate) fn uniforms(&self, ray_budget: u32) -> SurfelUniforms {
        let (cameras, camera_count) = self.cameras.slots();
        let settings = &self.settings;
        let switches = [
            (settings.respects_depth, surfel_switches::DEPTH),
            (settings.shares, surfel_switches::SHARING),
            (settings.estimator == Estimator::Multiscale, surfel_switches::MULTISCALE),
            (self.updates.since_relight < DRIFT_UPDATES, surfel_switches::DRIFT_TEST),
            (settings.feeds_back, surfel_switches::FEEDBACK),
            (self.measures_differences(), surfel_switches::SHIFTS),
            (settings.grid == Grid::Trapezoidal, surfel_switches::TRAPEZOIDAL),
            (settings.bins_rays, surfel_switches::BINNING),
        ];
        SurfelUniforms {
            cameras,
            camera_count,
            capacity: self.capacity,
            slot_mask: self.mark_slots - 1,
            update: self.updates.number,
            seed: [self.seed as u32, (self.seed >> 32) as u32],
            cell_size: self.cell_size,
            radius_pixels: settings.radius_pixels,
            smallest_radius: self.radii[0],
            largest_radius: self.radii[1],
            coverage: settings.coverage,
            exposure: self.exposure,
            live_count: self.live,
            ray_budget,
            target_error: settings.target_error,
            guided_share: settings.guided_share,
            switches: switches.iter().filter(|(is_on, _)| *is_on).map(|(_, bit)| bit).sum(),
            grid_room: u32::try_from(self.memory.grid_room(self.grid_shape.slots)).unwrap_or(u32::MAX),
            used_count: self.used,
            next_serial: self.next_serial,
            item_count: 0,
            first_item: 0,
            columns: 0,
            rows: 0,
            levels: self.levels,
            grid_slots: self.grid_shape.slots,
            grid_cells: self.grid_shape.cells,
            grid_slices: self.grid_shape.slices,
            grid_center: self.grid_shape.center,
            grid_half_edge: self.grid_shape.half_edge,
        }
    }
}
