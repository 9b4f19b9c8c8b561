//! The surfel cache of a session: its memory, its cameras, and what of it survives a change.

use glam::DVec3;
use surfelcast_gpu::{Buffer, Gpu, GpuError, MemoryKind};
use surfelcast_shaders::constants::{SURFEL_CLAIM_SLOTS, SURFEL_HIT_CANDIDATES, SURFEL_RAY_BINS, SURFEL_TILE_WORDS};
use surfelcast_shaders::records::{
    FirstHit, SurfelEdge, SurfelLight, SurfelOutput, SurfelRay, SurfelRecord, SurfelUniforms, surfel_switches,
};

use crate::surfel::graph::SurfelGraph;
use crate::surfel::grid::GridShape;
use crate::surfel::settings::{Estimator, Grid, SurfelSettings};
use surfelcast_passes::counters;
use surfelcast_passes::scan::Scan;
use surfelcast_passes::upload::SceneBuffers;

/// Smallest and largest capacity.
const CAPACITY_RANGE: [u32; 2] = [1 << 16, 1 << 22];
/// Share of the device's budget that a cache takes at most where its capacity is not given.
const MEMORY_SHARE: u64 = 16;
/// Grid entries for each surfel: cells of cascades are two radii wide, so none reaches into more.
pub(crate) const ENTRIES_PER_SURFEL: u64 = 8;
/// Cameras that decide on radii at most; more views are served all the same.
const MAX_CAMERAS: usize = 8;
/// Side of the smallest cells as a share of the scene's radius.
const CELL_SHARE: f32 = 1.0 / 262_144.0;
/// Bounds of radii as shares of the scene's radius.
const RADIUS_SHARES: [f32; 2] = [1.0 / 262_144.0, 0.05];
/// Updates after a change during which means may forget by themselves.
const DRIFT_UPDATES: u32 = 256;
/// Directions in which the first surfels are looked for, where they are not those of gaps.
const INITIAL_RANGE: [f32; 2] = [256.0, 1_048_576.0];
const SEED_SALT: u64 = 0x7375_7266_656c_0001;

/// A camera that uses the cache.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CacheCamera {
    /// Scene space.
    pub(crate) position: [f32; 3],
    /// Size of a pixel at distance 1.
    pub(crate) pixel_size: f32,
}

/// Where an update stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum UpdateStage {
    /// None is under way.
    Idle,
    /// Rays from here on are still to be traced.
    Tracing {
        /// Next ray.
        next: u32,
        /// Rays of the update.
        count: u32,
        /// Rays that there might have been.
        budget: u32,
    },
}

/// One surfel in so many must be new before edges are laid for them, unless some have waited for so many updates.
const EDGE_BIRTH_SHARE: u32 = 32;
const EDGE_UPDATES: u32 = 4;

/// Surfels of one session in device memory.
#[derive(Debug)]
pub struct SurfelCache {
    settings: SurfelSettings,
    seed: u64,
    scene_radius: f32,
    pub(crate) cell_size: f32,
    radii: [f32; 2],
    pub(crate) capacity: u32,
    /// Slots in which cameras and rays leave marks for cells of cascades, and those of the grid at most.
    mark_slots: u32,
    pub(crate) grid_shape: GridShape,
    pub(crate) scan: Scan,
    /// `SurfelRecord` by id.
    pub(crate) records: Buffer,
    /// `SurfelLight` by id: what surfels measured.
    pub(crate) lights: Buffer,
    /// `SurfelOutput` by id: what gathers read.
    pub(crate) outputs: Buffer,
    /// Guiding and depth tables by id.
    pub(crate) tiles: Buffer,
    /// Alive, from a hit; by id.
    pub(crate) flags: Buffer,
    /// Ids of the living; from `capacity` on those of the free that have been in use.
    pub(crate) lists: Buffer,
    /// First entry by slot, then entries.
    pub(crate) grid: Buffer,
    pub(crate) slot_cursors: Buffer,
    /// Last update in which a camera looked into a slot.
    pub(crate) slot_seen: Buffer,
    /// Last update in which a ray was served from a slot.
    pub(crate) slot_used: Buffer,
    /// Not 0 where a picture that pins looked into a slot.
    pub(crate) slot_pinned: Buffer,
    pub(crate) values: Buffer,
    pub(crate) claims: Buffer,
    pub(crate) rays: Buffer,
    /// Rays of each bin, then the bins' first places.
    pub(crate) bins: Buffer,
    pub(crate) candidates: Buffer,
    pub(crate) counters: Buffer,
    /// Edges between surfels, where light is reconstructed from them.
    pub(crate) graph: Option<SurfelGraph>,
    /// Stands in for the rays' first hits where nobody needs them.
    pub(crate) no_hits: Buffer,
    /// Living surfels.
    pub(crate) live: u32,
    /// Ids below this one have been in use; the free ones among them are the first to be used again.
    pub(crate) used: u32,
    /// Surfels that stood before gaps were filled.
    pub(crate) seeded: u32,
    pub(crate) next_serial: u32,
    /// Surfels born since rays were last dealt out.
    pub(crate) newborn: u32,
    /// Bit for each grid level that holds surfels.
    pub(crate) levels: u32,
    /// One word that a kernel answers the host with: level bits, rays dealt out.
    pub(crate) answer: Buffer,
    /// Updates so far.
    pub(crate) update: u32,
    /// Updates before this one that were not worth their passes.
    pub(crate) updates_waited: u32,
    /// Updates since the light last changed.
    pub(crate) calm_updates: u32,
    /// Rays of the update before were none, since every surfel had reached its goal.
    pub(crate) is_settled: bool,
    pub(crate) stage: UpdateStage,
    cameras: Vec<(u64, CacheCamera)>,
    next_camera: u64,
    /// Cameras that pin what they see.
    pinning: Vec<u64>,
    /// The last of them is gone: pins are to be taken out.
    pub(crate) has_stale_pins: bool,
    exposure: f32,
    /// Living surfels are not in the grid yet: the cache was just read from disk.
    pub(crate) is_unfiled: bool,
    /// When edges were last laid.
    pub(crate) edges_laid: EdgesLaid,
    /// The light changed: lights are cut down before the next update.
    pub(crate) is_relit: bool,
}

/// State of the cache when edges were last laid.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct EdgesLaid {
    update: u32,
    live: u32,
    next_serial: u32,
    /// Surfels have gone since the cache was made: ids are used again, and what lies in their slots is of others.
    has_reused_ids: bool,
}

/// Words of a grid: where slots begin, then entries, then their hints.
fn grid_words(slots: u32, entries: u64) -> u64 {
    u64::from(slots) + 1 + 2 * entries
}

fn buffer_of<T>(gpu: &Gpu, label: &str, count: u64) -> Result<Buffer, GpuError> {
    gpu.buffer(label, MemoryKind::Session, count * size_of::<T>() as u64)
}

impl SurfelCache {
    /// An empty cache.
    pub(crate) fn new(
        gpu: &Gpu,
        scene: &SceneBuffers,
        settings: SurfelSettings,
        pixel_count: u32,
        seed: u64,
    ) -> Result<Self, GpuError> {
        let capacity = capacity_for(gpu, settings.capacity, pixel_count);
        let mark_slots = capacity * 2;
        let surfels = u64::from(capacity);
        let candidate_count = SURFEL_HIT_CANDIDATES;
        let cache = Self {
            settings: settings.of_cache(),
            seed: seed ^ SEED_SALT,
            scene_radius: scene.radius,
            cell_size: (scene.radius * CELL_SHARE).max(f32::MIN_POSITIVE),
            radii: RADIUS_SHARES.map(|share| (scene.radius * share).max(f32::MIN_POSITIVE)),
            capacity,
            mark_slots,
            grid_shape: GridShape::cascades(0, mark_slots),
            scan: Scan::new(gpu, mark_slots + 1)?,
            records: buffer_of::<SurfelRecord>(gpu, "surfels", surfels)?,
            lights: buffer_of::<SurfelLight>(gpu, "surfel_lights", surfels)?,
            outputs: buffer_of::<SurfelOutput>(gpu, "surfel_outputs", surfels)?,
            tiles: buffer_of::<u32>(gpu, "surfel_tiles", surfels * u64::from(SURFEL_TILE_WORDS))?,
            flags: buffer_of::<u32>(gpu, "surfel_flags", surfels)?,
            lists: buffer_of::<u32>(gpu, "surfel_lists", surfels * 2)?,
            grid: buffer_of::<u32>(gpu, "surfel_grid", grid_words(mark_slots, surfels * ENTRIES_PER_SURFEL))?,
            slot_cursors: buffer_of::<u32>(gpu, "slot_cursors", u64::from(mark_slots))?,
            slot_seen: buffer_of::<u32>(gpu, "slot_seen", u64::from(mark_slots))?,
            slot_used: buffer_of::<u32>(gpu, "slot_used", u64::from(mark_slots))?,
            slot_pinned: buffer_of::<u32>(gpu, "slot_pinned", u64::from(mark_slots))?,
            values: buffer_of::<u32>(gpu, "scan_values", surfels + 1)?,
            claims: buffer_of::<u32>(gpu, "claims", u64::from(SURFEL_CLAIM_SLOTS))?,
            rays: buffer_of::<SurfelRay>(gpu, "rays", 1)?,
            bins: buffer_of::<u32>(gpu, "bins", u64::from(SURFEL_RAY_BINS))?,
            candidates: buffer_of::<SurfelRecord>(gpu, "candidates", u64::from(candidate_count))?,
            counters: counters::buffer(gpu)?,
            graph: if settings.reconstruction.uses_graph() {
                Some(SurfelGraph::new(gpu, surfels, settings.reconstruction)?)
            } else {
                None
            },
            no_hits: buffer_of::<FirstHit>(gpu, "first_hits", 1)?,
            live: 0,
            used: 0,
            seeded: 0,
            next_serial: 1,
            newborn: 0,
            levels: 0,
            answer: buffer_of::<u32>(gpu, "answer", 4)?,
            update: 1,
            updates_waited: 0,
            calm_updates: 0,
            is_settled: false,
            stage: UpdateStage::Idle,
            cameras: Vec::new(),
            next_camera: 0,
            pinning: Vec::new(),
            has_stale_pins: false,
            exposure: 1.0,
            is_unfiled: false,
            edges_laid: EdgesLaid::default(),
            is_relit: false,
        };
        let mut graph = gpu.graph("surfel_cache");
        for buffer in [
            &cache.records,
            &cache.lights,
            &cache.outputs,
            &cache.tiles,
            &cache.flags,
            &cache.grid,
            &cache.slot_seen,
            &cache.slot_used,
            &cache.slot_pinned,
            &cache.rays,
            &cache.candidates,
            &cache.lists,
            &cache.no_hits,
        ] {
            graph.clear(buffer)?;
        }
        graph.submit()?.wait()?;
        Ok(cache)
    }

    /// Settings it was made with.
    pub fn settings(&self) -> &SurfelSettings {
        &self.settings
    }

    /// Living surfels and surfels that fit.
    pub fn counts(&self) -> [u32; 2] {
        [self.live, self.capacity]
    }

    /// Rays that the update under way traces in all; 0 without one.
    pub(crate) fn rays_under_way(&self) -> u32 {
        match self.stage {
            UpdateStage::Tracing { count, .. } => count,
            UpdateStage::Idle => 0,
        }
    }

    /// Surfels that the first fill placed by [`crate::surfel::Initial`], with ids from 0 in the order of their directions.
    pub fn seeded(&self) -> u32 {
        self.seeded
    }

    /// Registers a camera, which pins what it sees or does not; the number names it from now on.
    pub(crate) fn add_camera(&mut self, pins: bool) -> u64 {
        self.next_camera += 1;
        if pins {
            self.pinning.push(self.next_camera);
        }
        self.next_camera
    }

    /// Says where a camera is.
    pub(crate) fn set_camera(&mut self, camera: u64, at: CacheCamera, exposure: f32) {
        self.exposure = exposure;
        match self.cameras.iter_mut().find(|(known, _)| *known == camera) {
            Some((_, known)) => *known = at,
            None => self.cameras.push((camera, at)),
        }
    }

    /// Forgets a camera.
    pub(crate) fn remove_camera(&mut self, camera: u64) {
        self.cameras.retain(|(known, _)| *known != camera);
        if self.pinning.contains(&camera) {
            self.pinning.retain(|known| *known != camera);
            self.has_stale_pins |= self.pinning.is_empty();
        }
    }

    /// The light changed: values stay as a first guess, and count for next to nothing.
    pub(crate) fn relight(&mut self) {
        self.is_relit = true;
        self.is_settled = false;
        self.calm_updates = 0;
    }

    /// Whether edges have to be laid anew, which takes note of it: at once where surfels went, for births when they are many or
    /// have waited for a few updates. A surfel without edges shows its own mean meanwhile.
    pub(crate) fn takes_new_edges(&mut self) -> bool {
        let laid = self.edges_laid;
        let births = self.next_serial.wrapping_sub(laid.next_serial);
        let has_deaths = self.live < laid.live.saturating_add(births);
        let is_first = laid.next_serial == 0;
        let has_reused_ids = !is_first && has_deaths || laid.has_reused_ids;
        let is_many = births.saturating_mul(EDGE_BIRTH_SHARE) >= self.live;
        let is_old = self.update.wrapping_sub(laid.update) >= EDGE_UPDATES;
        let is_due = is_first || has_deaths || births > 0 && (is_many || is_old || has_reused_ids);
        if is_due {
            let (update, live, next_serial) = (self.update, self.live, self.next_serial);
            self.edges_laid = EdgesLaid { update, live, next_serial, has_reused_ids };
        }
        is_due
    }

    /// Makes room for so many rays and candidates.
    pub(crate) fn reserve(&mut self, gpu: &Gpu, rays: u32, tiles: u32) -> Result<(), GpuError> {
        let ray_bytes = u64::from(rays) * size_of::<SurfelRay>() as u64;
        if self.stage == UpdateStage::Idle && self.rays.size_bytes() < ray_bytes {
            self.rays = buffer_of::<SurfelRay>(gpu, "rays", u64::from(rays))?;
            let mut graph = gpu.graph("surfel_rays");
            graph.clear(&self.rays)?;
            graph.submit()?.wait()?;
        }
        if let (UpdateStage::Idle, Some(graph)) = (self.stage, &mut self.graph) {
            graph.reserve(gpu, u64::from(rays))?;
        }
        let candidates = u64::from(SURFEL_HIT_CANDIDATES + tiles);
        if self.candidates.size_bytes() < candidates * size_of::<SurfelRecord>() as u64 {
            self.candidates = buffer_of::<SurfelRecord>(gpu, "candidates", candidates)?;
            let mut graph = gpu.graph("surfel_candidates");
            graph.clear(&self.candidates)?;
            graph.submit()?.wait()?;
        }
        if self.values.size_bytes() < (candidates + 1) * 4 {
            self.values = buffer_of::<u32>(gpu, "scan_values", candidates + 1)?;
        }
        let summed = SURFEL_HIT_CANDIDATES + tiles + 1;
        if !self.scan.holds(summed) {
            self.scan = Scan::new(gpu, summed)?;
        }
        Ok(())
    }

    /// Directions over the sphere for the first surfels: so many that discs of the size aimed at, with weights that average to
    /// a third, cover it three times as much as is wanted on the average, and as much where they are thinnest.
    pub(crate) fn initial_count(&self) -> u32 {
        let pixel_size = self.cameras.first().map_or(1.0, |(_, camera)| camera.pixel_size);
        let tangent = self.settings.radius_pixels * pixel_size;
        let count = 3.0 * 3.0 * self.settings.coverage * 4.0 / (tangent * tangent).max(f32::MIN_POSITIVE);
        (count.clamp(INITIAL_RANGE[0], INITIAL_RANGE[1]) as u32).min(self.capacity / 2)
    }

    /// The grid's shape as the settings and the first camera have it now.
    pub(crate) fn wanted_grid(&self) -> GridShape {
        match (self.settings.grid, self.cameras.first()) {
            (Grid::Cascades, _) => GridShape::cascades(self.live, self.mark_slots),
            (Grid::Trapezoidal, Some((_, camera))) => {
                GridShape::trapezoidal(*camera, self.scene_radius, self.settings.radius_pixels)
            }
            (Grid::Trapezoidal, None) => self.grid_shape,
        }
    }

    /// Gives the grid a shape, and room for so many entries at least. What was in it is lost.
    pub(crate) fn shape_grid(&mut self, gpu: &Gpu, shape: GridShape, entries: u64) -> Result<(), GpuError> {
        self.grid_shape = shape;
        let slots = u64::from(shape.slots);
        let words = grid_words(shape.slots, entries);
        if self.grid.size_bytes() < words * 4 {
            self.grid = buffer_of::<u32>(gpu, "surfel_grid", words)?;
        }
        if self.slot_cursors.size_bytes() < slots * 4 {
            self.slot_cursors = buffer_of::<u32>(gpu, "slot_cursors", slots)?;
        }
        if !self.scan.holds(shape.slots + 1) {
            self.scan = Scan::new(gpu, shape.slots + 1)?;
        }
        Ok(())
    }

    /// Entries that the grid has room for.
    pub(crate) fn grid_room(&self) -> u64 {
        (self.grid.size_bytes() / 4).saturating_sub(u64::from(self.grid_shape.slots) + 1) / 2
    }

    /// Uniforms of a pass over a picture, which is content with coarse surfels or not.
    pub(crate) fn uniforms_for_picture(&self, is_coarse: bool) -> SurfelUniforms {
        let mut uniforms = self.uniforms(0);
        if is_coarse {
            uniforms.switches |= surfel_switches::COARSE;
        }
        uniforms
    }

    /// Uniforms of a dispatch; callers fill in what it works on.
    pub(crate) fn uniforms(&self, ray_budget: u32) -> SurfelUniforms {
        let mut cameras = [[0.0; 4]; MAX_CAMERAS];
        // The newest views decide where there are too many.
        let skipped = self.cameras.len().saturating_sub(MAX_CAMERAS);
        let used = &self.cameras[skipped..];
        for (slot, (_, camera)) in cameras.iter_mut().zip(used) {
            let [x, y, z] = camera.position;
            *slot = [x, y, z, camera.pixel_size];
        }
        let settings = &self.settings;
        let switches = [
            (settings.respects_depth, surfel_switches::DEPTH),
            (settings.shares, surfel_switches::SHARING),
            (settings.estimator == Estimator::Multiscale, surfel_switches::MULTISCALE),
            (self.calm_updates < DRIFT_UPDATES, surfel_switches::DRIFT_TEST),
            (settings.feeds_back, surfel_switches::FEEDBACK),
            (self.measures_differences(), surfel_switches::SHIFTS),
            (settings.grid == Grid::Trapezoidal, surfel_switches::TRAPEZOIDAL),
            (settings.bins_rays, surfel_switches::BINNING),
        ];
        SurfelUniforms {
            cameras,
            camera_count: used.len() as u32,
            capacity: self.capacity,
            slot_mask: self.mark_slots - 1,
            update: self.update,
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
            grid_room: u32::try_from(self.grid_room()).unwrap_or(u32::MAX),
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

/// The power of two asked for, or one that fits the picture and the cache's share of the memory.
fn capacity_for(gpu: &Gpu, wanted: u32, pixel_count: u32) -> u32 {
    let [least, most] = CAPACITY_RANGE;
    if wanted > 0 {
        return wanted.clamp(least, most).next_power_of_two();
    }
    let records = size_of::<SurfelRecord>() + size_of::<SurfelLight>() + size_of::<SurfelOutput>();
    // Lists, flags, sums and marks take 48 bytes; then the graph, counted in whether it is used or not.
    let bytes_each = records + 4 * SURFEL_TILE_WORDS as usize + 8 * ENTRIES_PER_SURFEL as usize + 48;
    let bytes_each = bytes_each + 8 * (size_of::<SurfelEdge>() + 16) + 12 * 16;
    let affordable = gpu.memory().budget_bytes / MEMORY_SHARE / bytes_each as u64;
    // The largest power of two that is not above it.
    let affordable = 1 << u32::try_from(affordable).unwrap_or(most).clamp(least, most).ilog2();
    // Discs cover many pixels each; what lies out of sight takes about as many as what is seen.
    pixel_count.next_power_of_two().clamp(least, affordable)
}

/// Size of a pixel at distance 1, and the camera's place in scene space.
pub(crate) fn cache_camera(view: &crate::FrameView, origin: DVec3, full_size: [u32; 2]) -> CacheCamera {
    let pixel_size = 2.0 * (view.camera.vfov * 0.5).tan() / f64::from(full_size[1].max(1));
    CacheCamera { position: (view.camera.position - origin).as_vec3().to_array(), pixel_size: pixel_size as f32 }
}
