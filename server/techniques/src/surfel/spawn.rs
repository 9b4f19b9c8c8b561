//! The passes that lay surfels where a picture is uncovered and where rays hit bare ground.
//!
//! Ids are allocated by prefix sums, in the order of candidates, so that the same picture gets the same surfels.

use surfelcast_gpu::{Buffer, Graph};
use surfelcast_shaders::constants::{SPAWN_FINE_TILE, SPAWN_TILE, SURFEL_HIT_CANDIDATES};
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::{SurfelRecord, SurfelUniforms, surfel_switches};

use crate::surfel::cache::SurfelCache;
use crate::surfel::settings::Initial;
use crate::surfel::work::{Work, count_rays, u32_of};
use crate::technique::TechniqueError;
use surfelcast_passes::step::Step;
use surfelcast_passes::{counters, merge_passes, workgroups_of};

/// Radius in pixels up to which new surfels of fine tiles keep their distance: neighbouring ones compare theirs.
const FINE_RADIUS: f32 = 6.0;
/// Rounds of spawning in one frame at most: new ground is filled before it is lit.
const MOST_ROUNDS: u32 = 24;
/// Share of the tiles that has to gain a surfel for another round to be worth it.
const ROUND_GAIN: f32 = 0.05;

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
        let fine = tiles(SPAWN_FINE_TILE, true);
        let fits = radius_pixels <= FINE_RADIUS && fine.count() <= room;
        if fits { fine } else { tiles(SPAWN_TILE, false) }
    }

    const fn count(&self) -> u32 {
        self.columns * self.rows
    }
}

/// New surfels of a round.
struct Accepted {
    all: u32,
    /// Those that a picture asked for: where rays hit bare ground, looking again finds no more.
    of_picture: u32,
}

impl SurfelCache {
    /// Covers what a picture sees with surfels. Returns how many it got, as a share of its tiles: of all rounds, which are one where that is
    /// little.
    pub(crate) fn spawn(
        &mut self,
        work: &Work<'_>,
        asking: &Asking<'_>,
        step: &mut Step,
    ) -> Result<f32, TechniqueError> {
        let tiles = Tiles::of(asking.size, asking.radius_pixels, self.capacity - self.live);
        self.reserve(work.gpu, 0, tiles.count())?;
        if self.settings().initial != Initial::Gaps && self.next_serial == 1 {
            self.seed(work, asking.frame, step)?;
        }
        let mut gain = 0.0;
        for round in 0..MOST_ROUNDS {
            let accepted = self.spawn_round(work, asking, tiles, round, step)?;
            self.is_settled &= accepted.all == 0;
            let gained = accepted.of_picture as f32 / tiles.count() as f32;
            gain += gained;
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
            .dispatch([asking.size[0].div_ceil(SPAWN_TILE), asking.size[1].div_ceil(SPAWN_TILE), 1])?;
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
    pub(crate) fn withdraw_hits(&self, graph: &mut Graph) -> Result<(), TechniqueError> {
        let bytes = u64::from(SURFEL_HIT_CANDIDATES) * size_of::<SurfelRecord>() as u64;
        Ok(graph.clear_first(&self.candidates, bytes)?)
    }
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
}
