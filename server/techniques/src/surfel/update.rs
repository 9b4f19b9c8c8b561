//! The passes that keep a cache: spawning where a picture is uncovered, filing surfels in the grid, rays, means.
//!
//! Everything is allocated by prefix sums in the order of ids and every sum runs in a fixed order, so a cache is a function
//! of its settings, its seed and what was asked of it.

use surfelcast_gpu::{Buffer, Gpu, Graph, PassBuilder, Ticket};
use surfelcast_shaders::constants::{SURFEL_HIT_CANDIDATES, SURFEL_RAY_BINS};
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::{SurfelRecord, SurfelUniforms, surfel_switches};

use crate::passes::counters;
use crate::passes::kernels::KernelSet;
use crate::passes::lights::LightBuffers;
use crate::passes::merge_passes;
use crate::passes::upload::SceneBuffers;
use crate::passes::workgroups_of;
use crate::surfel::cache::{ENTRIES_PER_SURFEL, SurfelCache, UpdateStage};
use crate::surfel::graph::SurfelGraph;
use crate::surfel::settings::Initial;
use crate::technique::{Step, TechniqueError};

/// Pixels of a tile's side, and of a fine one (`surfel_coverage.wesl`).
const TILE_SIDE: u32 = 8;
const FINE_TILE_SIDE: u32 = 4;
/// Radius in pixels up to which new surfels of fine tiles keep their distance: neighbouring ones compare theirs.
const FINE_RADIUS: f32 = 6.0;
/// Rounds of spawning in one frame at most: new ground is filled before it is lit.
const MOST_ROUNDS: u32 = 24;
/// Share of the tiles that has to gain a surfel for another round to be worth it.
const ROUND_GAIN: f32 = 0.05;
/// An update waits where it has less than a ray for so many living surfels, and so many wait one after the other at most.
const SURFELS_PER_RAY: u32 = 16;
const MOST_WAITED: u32 = 3;
/// Entries of the trapezoidal grid for each surfel that fits, and cells that a single one is filed in, at most.
const MOST_ENTRIES_PER_SURFEL: u64 = 32;
const MOST_CELLS: u32 = 4096;

/// What a pass over the cache works with.
pub(crate) struct Work<'a> {
    pub(crate) gpu: &'a Gpu,
    pub(crate) kernels: &'a KernelSet,
    pub(crate) scene: &'a SceneBuffers,
    pub(crate) lights: &'a LightBuffers,
}

/// A picture that asks for surfels.
pub(crate) struct Asking<'a> {
    /// Uniforms of the frame.
    pub(crate) frame: &'a [u8],
    /// Visibility buffer.
    pub(crate) visible: &'a Buffer,
    /// Points in it that need surfels.
    pub(crate) points: &'a Buffer,
    pub(crate) size: [u32; 2],
    /// What it sees is kept.
    pub(crate) pins: bool,
    /// It is content with coarse surfels.
    pub(crate) is_small: bool,
    /// Radius of those it asks for, in its own pixels.
    pub(crate) radius_pixels: f32,
}

/// Tiles of a picture, one new surfel each at most in a round.
#[derive(Clone, Copy, Debug)]
struct Tiles {
    columns: u32,
    rows: u32,
    are_fine: bool,
}

impl Tiles {
    /// Of a picture that asks for surfels of such a radius, pixels, where so many more fit: fine tiles could fill what is left from
    /// the top of the picture on.
    fn of(size: [u32; 2], radius_pixels: f32, room: u32) -> Self {
        let tiles = |side: u32, are_fine| {
            let [columns, rows] = size.map(|pixels| pixels.div_ceil(side));
            Self { columns, rows, are_fine }
        };
        let fine = tiles(FINE_TILE_SIDE, true);
        let fits = radius_pixels <= FINE_RADIUS && fine.count() <= room;
        if fits { fine } else { tiles(TILE_SIDE, false) }
    }

    const fn count(&self) -> u32 {
        self.columns * self.rows
    }
}

/// Surfels that a picture got, as shares of its tiles.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Gain {
    pub(crate) first_round: f32,
    pub(crate) all_rounds: f32,
}

/// New surfels of a round.
struct Accepted {
    all: u32,
    /// Those that a picture asked for: where rays hit bare ground, looking again finds no more.
    of_picture: u32,
}

impl SurfelCache {
    /// Binds what gathers read, as far as the kernel does.
    pub(crate) fn bind<'g>(&self, pass: PassBuilder<'g>) -> PassBuilder<'g> {
        pass.read_if_bound("surfels", &self.records)
            .read_if_bound("surfel_outputs", &self.outputs)
            .read_if_bound("surfel_grid", &self.grid)
            .read_if_bound("surfel_tiles", &self.tiles)
    }

    /// Covers what a picture sees with surfels.
    pub(crate) fn spawn(
        &mut self,
        work: &Work<'_>,
        asking: &Asking<'_>,
        step: &mut Step,
    ) -> Result<Gain, TechniqueError> {
        let tiles = Tiles::of(asking.size, asking.radius_pixels, self.capacity - self.live);
        self.reserve(work.gpu, 0, tiles.count())?;
        if self.settings().initial != Initial::Gaps && self.next_serial == 1 {
            self.seed(work, asking.frame, step)?;
        }
        let mut gain = Gain::default();
        for round in 0..MOST_ROUNDS {
            let accepted = self.spawn_round(work, asking, tiles, round, step)?;
            self.is_settled &= accepted.all == 0;
            let gained = accepted.of_picture as f32 / tiles.count() as f32;
            gain.all_rounds += gained;
            if round == 0 {
                gain.first_round = gained;
            }
            if gained < ROUND_GAIN || self.live >= self.capacity {
                break;
            }
        }
        Ok(gain)
    }

    /// The first surfels: as many directions over the whole sphere as discs of their size cover it to what is wanted.
    fn seed(&mut self, work: &Work<'_>, frame: &[u8], step: &mut Step) -> Result<(), TechniqueError> {
        let Work { gpu, kernels, scene, lights } = *work;
        let directions = self.initial_count();
        self.reserve(gpu, 0, directions)?;
        let mut uniforms = self.uniforms(0);
        // In one row, so that only neighbours in order are asked whether they crowd each other.
        (uniforms.columns, uniforms.rows) = (directions, 1);
        uniforms.item_count = SURFEL_HIT_CANDIDATES + directions;
        uniforms.first_item = self.settings().initial as u32;
        let mut graph = gpu.graph("surfel_seed");
        self.bind(lights.bind(scene.bind(graph.pass(kernels.get("surfel_seed")?))))
            .uniform("cache", bytemuck::bytes_of(&uniforms))
            .uniform("frame", frame)
            .read_write("candidates", &self.candidates)
            .dispatch(workgroups_of(directions))?;
        step.rays[1] += u64::from(directions);
        self.accept(work, frame, graph, &uniforms, step)?;
        self.seeded = self.live;
        Ok(())
    }

    /// One new surfel for each tile at most, and in a frame's first round those that rays asked for.
    fn spawn_round(
        &mut self,
        work: &Work<'_>,
        asking: &Asking<'_>,
        tiles: Tiles,
        round: u32,
        step: &mut Step,
    ) -> Result<Accepted, TechniqueError> {
        let Work { gpu, kernels, scene, lights } = *work;
        let mut uniforms = self.uniforms_for_picture(asking.is_small);
        (uniforms.columns, uniforms.rows) = (tiles.columns, tiles.rows);
        uniforms.item_count = SURFEL_HIT_CANDIDATES + tiles.count();
        uniforms.first_item = round;
        if asking.pins {
            uniforms.switches |= surfel_switches::PINNING;
        }
        if tiles.are_fine {
            uniforms.switches |= surfel_switches::FINE_TILES;
        }
        let mut graph = gpu.graph("surfel_spawn");
        self.bind(lights.bind(scene.bind(graph.pass(kernels.get("surfel_coverage")?))))
            .uniform("cache", bytemuck::bytes_of(&uniforms))
            .uniform("frame", asking.frame)
            .read("visible", asking.visible)
            .read("visible_points", asking.points)
            .read_write("candidates", &self.candidates)
            .read_write("slot_seen", &self.slot_seen)
            .read_write("slot_pinned", &self.slot_pinned)
            .dispatch([asking.size[0].div_ceil(TILE_SIDE), asking.size[1].div_ceil(TILE_SIDE), 1])?;
        self.accept(work, asking.frame, graph, &uniforms, step)
    }

    /// Makes surfels of the candidates that neither compete nor crowd.
    fn accept(
        &mut self,
        work: &Work<'_>,
        frame: &[u8],
        mut graph: Graph,
        uniforms: &SurfelUniforms,
        step: &mut Step,
    ) -> Result<Accepted, TechniqueError> {
        let Work { kernels, scene, lights, .. } = *work;
        let count = uniforms.item_count;
        let bytes = bytemuck::bytes_of(uniforms);
        graph.clear(&self.claims)?;
        graph
            .pass(kernels.get("surfel_claim")?)
            .uniform("cache", bytes)
            .read("candidates", &self.candidates)
            .read_write("claims", &self.claims)
            .dispatch(workgroups_of(SURFEL_HIT_CANDIDATES))?;
        graph
            .pass(kernels.get("surfel_reject")?)
            .uniform("cache", bytes)
            .read("candidates", &self.candidates)
            .read("claims", &self.claims)
            .read_write("scan_values", &self.values)
            .dispatch(workgroups_of(count))?;
        self.scan.record(&mut graph, &self.values, count + 1)?;
        let mut accepted_before =
            |candidate: u32| graph.read_back(&self.values, u64::from(candidate) * 4..u64::from(candidate) * 4 + 4);
        let (of_hits, all) = (accepted_before(SURFEL_HIT_CANDIDATES)?, accepted_before(count)?);
        graph
            .pass(kernels.get("surfel_spawn")?)
            .uniform("cache", bytes)
            .read("candidates", &self.candidates)
            .read("scan_values", &self.values)
            .read("surfel_lists", &self.lists)
            .read_write("surfel_records", &self.records)
            .read_write("surfel_lights", &self.lights)
            .read_write("outputs", &self.outputs)
            .read_write("tiles", &self.tiles)
            .read_write("surfel_flags", &self.flags)
            .dispatch(workgroups_of(count))?;
        graph.clear(&self.counters)?;
        lights
            .bind(scene.bind(graph.pass(kernels.get("surfel_probe")?)))
            .uniform("cache", bytes)
            .uniform("frame", frame)
            .read("candidates", &self.candidates)
            .read("scan_values", &self.values)
            .read("surfel_lists", &self.lists)
            .read_write("tiles", &self.tiles)
            .read_write("counters", &self.counters)
            .dispatch(workgroups_of(count))?;
        let probes = graph.read_back(&self.counters, 0..counters::BYTES)?;
        // Ray hits put candidates up once. Those of tiles tell the next round where to look.
        self.withdraw_hits(&mut graph)?;
        let mut report = graph.submit()?.wait()?;
        merge_passes(&mut step.passes, std::mem::take(&mut report.passes));
        count_rays(step, &report.take(probes)?);
        let (of_hits, all) = (u32_of(&report.take(of_hits)?), u32_of(&report.take(all)?));
        if all > 0 {
            self.next_serial = self.next_serial.wrapping_add(all);
            let spawned = all.min(self.capacity - self.live);
            self.newborn = self.newborn.saturating_add(spawned);
            self.used = self.used.max(self.live + spawned);
            self.rebuild(work, self.live + spawned, step)?;
        }
        Ok(Accepted { all, of_picture: all.saturating_sub(of_hits) })
    }

    /// Withdraws candidates that ray hits put up.
    fn withdraw_hits(&self, graph: &mut Graph) -> Result<(), TechniqueError> {
        let bytes = u64::from(SURFEL_HIT_CANDIDATES) * size_of::<SurfelRecord>() as u64;
        Ok(graph.clear_first(&self.candidates, bytes)?)
    }

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

    fn record_lists(&self, graph: &mut Graph, kernels: &KernelSet, cache: &[u8]) -> Result<(), TechniqueError> {
        graph
            .pass(kernels.get("surfel_mark")?)
            .uniform("cache", cache)
            .read("surfel_flags", &self.flags)
            .read_write("scan_values", &self.values)
            .dispatch(workgroups_of(self.used))?;
        self.scan.record(graph, &self.values, self.used + 1)?;
        graph
            .pass(kernels.get("surfel_compact")?)
            .uniform("cache", cache)
            .read("surfel_flags", &self.flags)
            .read("scan_values", &self.values)
            .read_write("surfel_lists", &self.lists)
            .dispatch(workgroups_of(self.used))?;
        Ok(())
    }

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
        graph
            .pass(kernels.get("surfel_mark")?)
            .uniform("cache", bytes)
            .read("surfel_flags", &self.flags)
            .read_write("scan_values", &self.values)
            .dispatch(workgroups_of(self.used))?;
        self.scan.record(graph, &self.values, self.used + 1)?;
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

fn u32_of(bytes: &[u8]) -> u32 {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_are_fine_where_surfels_are_small_and_fit() {
        let fine = Tiles::of([100, 50], 5.0, 1000);
        assert_eq!((fine.columns, fine.rows, fine.are_fine), (25, 13, true));
        assert!(Tiles::of([100, 50], 5.0, fine.count()).are_fine);
        assert!(!Tiles::of([100, 50], 5.0, fine.count() - 1).are_fine, "one round could fill the cache");
        let coarse = Tiles::of([100, 50], 8.0, 1000);
        assert_eq!((coarse.columns, coarse.rows, coarse.are_fine), (13, 7, false));
    }

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
