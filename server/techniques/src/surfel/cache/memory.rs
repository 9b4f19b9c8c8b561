//! Device memory of a cache. Passes bind it by the names that kernels give it ([`Memory::bind`]).

use surfelcast_gpu::{Buffer, Gpu, GpuError, Graph, MemoryKind, PassBuilder};
use surfelcast_passes::counters;
use surfelcast_passes::scan::Scan;
use surfelcast_shaders::constants::{SURFEL_CLAIM_SLOTS, SURFEL_HIT_CANDIDATES, SURFEL_RAY_BINS, SURFEL_TILE_WORDS};
use surfelcast_shaders::records::{FirstHit, SurfelEdge, SurfelLight, SurfelOutput, SurfelRay, SurfelRecord};

/// Smallest and largest capacity.
const CAPACITY_RANGE: [u32; 2] = [1 << 16, 1 << 22];
/// A cache whose capacity is not given takes at most this part of the device's budget: one in sixteen.
const BUDGET_DIVISOR: u64 = 16;
/// Grid entries for each surfel: cells of cascades are two radii wide, so no surfel overlaps more than eight.
pub(super) const ENTRIES_PER_SURFEL: u64 = 8;

/// Buffers of a cache. Those by id have one element for each surfel that fits.
#[derive(Debug)]
pub(super) struct Memory {
    /// `SurfelRecord` by id: where surfels lie.
    pub(super) records: Buffer,
    /// `SurfelLight` by id: what surfels measured.
    pub(super) lights: Buffer,
    /// `SurfelOutput` by id: what lookups read.
    pub(super) outputs: Buffer,
    /// Guiding and depth tables by id.
    pub(super) tiles: Buffer,
    /// Bits by id: live, spawned at a ray hit.
    pub(super) flags: Buffer,
    /// Ids of live surfels; from `capacity` on, ids that were in use and are free again.
    pub(super) lists: Buffer,
    /// First entry by slot, then the entries, then their hints.
    pub(super) grid: Buffer,
    /// Entries of each slot that are inserted so far.
    pub(super) slot_cursors: Buffer,
    /// Last update in which a camera looked into a slot.
    slot_seen: Buffer,
    /// Last update in which a ray was served from a slot.
    slot_used: Buffer,
    /// Not 0 where a pinning view looked into a slot.
    pub(super) slot_pinned: Buffer,
    /// Values that are summed up, and their prefix sums.
    pub(super) values: Buffer,
    pub(super) claims: Buffer,
    rays: Buffer,
    /// Rays of each bin, then the bins' first places.
    pub(super) bins: Buffer,
    /// `SurfelRecord` of surfels that may be spawned: those at ray hits, then one for each tile of a view.
    candidates: Buffer,
    pub(super) counters: Buffer,
    /// One word that a kernel returns to the host: level bits, rays allocated.
    pub(super) answer: Buffer,
    /// Bound in place of the rays' first hits where nothing reads them.
    no_first_hits: Buffer,
    pub(super) scan: Scan,
}

impl Memory {
    /// Memory for `capacity` surfels and a grid of at most `slots` slots, cleared.
    pub(super) fn new(gpu: &Gpu, capacity: u32, slots: u32) -> Result<Self, GpuError> {
        let surfels = u64::from(capacity);
        let slot_words = |label| buffer_of::<u32>(gpu, label, u64::from(slots));
        let memory = Self {
            records: buffer_of::<SurfelRecord>(gpu, "surfels", surfels)?,
            lights: buffer_of::<SurfelLight>(gpu, "surfel_lights", surfels)?,
            outputs: buffer_of::<SurfelOutput>(gpu, "surfel_outputs", surfels)?,
            tiles: buffer_of::<u32>(gpu, "surfel_tiles", surfels * u64::from(SURFEL_TILE_WORDS))?,
            flags: buffer_of::<u32>(gpu, "surfel_flags", surfels)?,
            lists: buffer_of::<u32>(gpu, "surfel_lists", surfels * 2)?,
            grid: buffer_of::<u32>(gpu, "surfel_grid", grid_words(slots, surfels * ENTRIES_PER_SURFEL))?,
            slot_cursors: slot_words("slot_cursors")?,
            slot_seen: slot_words("slot_seen")?,
            slot_used: slot_words("slot_used")?,
            slot_pinned: slot_words("slot_pinned")?,
            values: buffer_of::<u32>(gpu, "scan_values", surfels + 1)?,
            claims: buffer_of::<u32>(gpu, "claims", u64::from(SURFEL_CLAIM_SLOTS))?,
            rays: buffer_of::<SurfelRay>(gpu, "rays", 1)?,
            bins: buffer_of::<u32>(gpu, "bins", u64::from(SURFEL_RAY_BINS))?,
            candidates: buffer_of::<SurfelRecord>(gpu, "candidates", u64::from(SURFEL_HIT_CANDIDATES))?,
            counters: counters::buffer(gpu)?,
            answer: buffer_of::<u32>(gpu, "answer", 4)?,
            no_first_hits: buffer_of::<FirstHit>(gpu, "first_hits", 1)?,
            scan: Scan::new(gpu, slots + 1)?,
        };
        let mut graph = gpu.graph("surfel_cache");
        for buffer in [
            &memory.records,
            &memory.lights,
            &memory.outputs,
            &memory.tiles,
            &memory.flags,
            &memory.grid,
            &memory.slot_seen,
            &memory.slot_used,
            &memory.slot_pinned,
            &memory.rays,
            &memory.candidates,
            &memory.lists,
            &memory.no_first_hits,
        ] {
            graph.clear(buffer)?;
        }
        graph.submit()?.wait()?;
        Ok(memory)
    }

    /// Binds whatever the kernel names. `first_hits` are the rays' first hits, where something reads them.
    pub(super) fn bind<'g>(&self, pass: PassBuilder<'g>, first_hits: Option<&Buffer>) -> PassBuilder<'g> {
        [
            ("surfel_records", &self.records),
            ("outputs", &self.outputs),
            ("tiles", &self.tiles),
            ("surfel_lights", &self.lights),
            ("surfel_flags", &self.flags),
            ("surfel_lists", &self.lists),
            ("grid", &self.grid),
            ("slot_counts", &self.grid),
            ("slot_cursors", &self.slot_cursors),
            ("slot_seen", &self.slot_seen),
            ("slot_used", &self.slot_used),
            ("slot_pinned", &self.slot_pinned),
            ("scan_values", &self.values),
            ("claims", &self.claims),
            ("rays", &self.rays),
            ("bin_counts", &self.bins),
            ("bin_places", &self.bins),
            ("candidates", &self.candidates),
            ("counters", &self.counters),
            ("level_bits", &self.answer),
            ("ray_total", &self.answer),
            ("first_hits", first_hits.unwrap_or(&self.no_first_hits)),
        ]
        .into_iter()
        .fold(self.bind_lookup(pass), |pass, (name, buffer)| pass.bind_if_bound(name, buffer))
    }

    /// Binds what lookups read, as far as the kernel names it.
    pub(super) fn bind_lookup<'g>(&self, pass: PassBuilder<'g>) -> PassBuilder<'g> {
        pass.bind_if_bound("surfels", &self.records)
            .bind_if_bound("surfel_outputs", &self.outputs)
            .bind_if_bound("surfel_grid", &self.grid)
            .bind_if_bound("surfel_tiles", &self.tiles)
    }

    /// Makes room for the rays of an update.
    pub(super) fn reserve_rays(&mut self, gpu: &Gpu, count: u32) -> Result<(), GpuError> {
        if self.rays.size_bytes() < u64::from(count) * size_of::<SurfelRay>() as u64 {
            self.rays = buffer_of::<SurfelRay>(gpu, "rays", u64::from(count))?;
            clear(gpu, &self.rays)?;
        }
        Ok(())
    }

    /// Makes room for candidates at ray hits and for one of each tile.
    pub(super) fn reserve_candidates(&mut self, gpu: &Gpu, tiles: u32) -> Result<(), GpuError> {
        let candidates = u64::from(SURFEL_HIT_CANDIDATES + tiles);
        if self.candidates.size_bytes() < candidates * size_of::<SurfelRecord>() as u64 {
            self.candidates = buffer_of::<SurfelRecord>(gpu, "candidates", candidates)?;
            clear(gpu, &self.candidates)?;
        }
        if self.values.size_bytes() < (candidates + 1) * 4 {
            self.values = buffer_of::<u32>(gpu, "scan_values", candidates + 1)?;
        }
        self.reserve_scan(gpu, SURFEL_HIT_CANDIDATES + tiles + 1)
    }

    /// Makes room for a grid of `slots` slots and `entries` entries. Where it grows, what was in it is lost.
    pub(super) fn reserve_grid(&mut self, gpu: &Gpu, slots: u32, entries: u64) -> Result<(), GpuError> {
        let words = grid_words(slots, entries);
        if self.grid.size_bytes() < words * 4 {
            self.grid = buffer_of::<u32>(gpu, "surfel_grid", words)?;
        }
        if self.slot_cursors.size_bytes() < u64::from(slots) * 4 {
            self.slot_cursors = buffer_of::<u32>(gpu, "slot_cursors", u64::from(slots))?;
        }
        self.reserve_scan(gpu, slots + 1)
    }

    /// Entries for which the grid has room, with `slots` slots.
    pub(super) fn grid_room(&self, slots: u32) -> u64 {
        (self.grid.size_bytes() / 4).saturating_sub(u64::from(slots) + 1) / 2
    }

    /// Withdraws the candidates at ray hits.
    pub(super) fn withdraw_hit_candidates(&self, graph: &mut Graph) -> Result<(), GpuError> {
        graph.clear_first(&self.candidates, u64::from(SURFEL_HIT_CANDIDATES) * size_of::<SurfelRecord>() as u64)
    }

    fn reserve_scan(&mut self, gpu: &Gpu, count: u32) -> Result<(), GpuError> {
        if !self.scan.holds(count) {
            self.scan = Scan::new(gpu, count)?;
        }
        Ok(())
    }
}

/// Words of a grid: where slots begin, then entries, then their hints.
fn grid_words(slots: u32, entries: u64) -> u64 {
    u64::from(slots) + 1 + 2 * entries
}

fn buffer_of<T>(gpu: &Gpu, label: &str, count: u64) -> Result<Buffer, GpuError> {
    gpu.buffer(label, MemoryKind::Session, count * size_of::<T>() as u64)
}

fn clear(gpu: &Gpu, buffer: &Buffer) -> Result<(), GpuError> {
    let mut graph = gpu.graph(buffer.label());
    graph.clear(buffer)?;
    graph.submit()?.wait()?;
    Ok(())
}

/// The requested capacity as a power of two; without a request one that fits the image and the cache's part of the
/// memory.
pub(super) fn capacity_for(gpu: &Gpu, requested: u32, pixel_count: u32) -> u32 {
    let [least, most] = CAPACITY_RANGE;
    if requested > 0 {
        return requested.clamp(least, most).next_power_of_two();
    }
    let records = size_of::<SurfelRecord>() + size_of::<SurfelLight>() + size_of::<SurfelOutput>();
    // Lists, flags, sums and marks take 48 bytes; then the neighbours, counted in whether they are used or not.
    let bytes_each = records + 4 * SURFEL_TILE_WORDS as usize + 8 * ENTRIES_PER_SURFEL as usize + 48;
    let bytes_each = bytes_each + 8 * (size_of::<SurfelEdge>() + 16) + 12 * 16;
    let affordable = gpu.memory().budget_bytes / BUDGET_DIVISOR / bytes_each as u64;
    // The largest power of two that is not above it.
    let affordable = 1 << u32::try_from(affordable).unwrap_or(most).clamp(least, most).ilog2();
    // Discs cover many pixels each; what lies out of sight takes about as many as what is visible.
    pixel_count.next_power_of_two().clamp(least, affordable)
}
