//! Spawning: surfels where a view is not covered and where rays hit surfaces without any.
//!
//! Ids are allocated by prefix sums in the order of candidates, so the same view always gets the same surfels.

use surfelcast_gpu::{GpuError, Graph};
use surfelcast_passes::step::Step;
use surfelcast_passes::visibility::Visibility;
use surfelcast_passes::{counters, merge_passes, workgroups_of};
use surfelcast_shaders::constants::{SPAWN_FINE_TILE, SPAWN_TILE, SURFEL_HIT_CANDIDATES};
use surfelcast_shaders::records::{SurfelUniforms, surfel_switches};

use super::SurfelCache;
use super::work::{Work, count_rays, u32_of};
use crate::surfel::settings::Initial;

/// Radius in pixels up to which new surfels of fine tiles keep their distance: candidates of adjacent tiles are
/// compared.
const FINE_RADIUS: f32 = 6.0;
/// Rounds of spawning in one frame, at most: a newly visible surface is covered before it is lit.
const MOST_ROUNDS: u32 = 24;
/// Share of the tiles that must gain a surfel for another round.
const ROUND_GAIN: f32 = 0.05;
/// Range of the number of directions in which the first surfels are looked for, unless those fill gaps.
const INITIAL_RANGE: [f32; 2] = [256.0, 1_048_576.0];

/// A view that requests surfels.
pub(crate) struct SpawnRequest<'a> {
    /// Uniforms of the frame.
    pub(crate) frame: &'a [u8],
    /// What its camera rays hit.
    pub(crate) visibility: &'a Visibility,
    /// Size of the image, pixels.
    pub(crate) size: [u32; 2],
    /// What the view sees is pinned.
    pub(crate) pins: bool,
    /// Coarse surfels suffice.
    pub(crate) is_coarse: bool,
    /// Radius of the requested surfels, in pixels of the view.
    pub(crate) radius_pixels: f32,
}

/// Tiles of a view. Each gains at most one surfel in a round.
#[derive(Clone, Copy, Debug)]
struct Tiles {
    columns: u32,
    rows: u32,
    are_fine: bool,
}

impl Tiles {
    /// 4x4 spawn tiles if the requested radius is small and the cache has room for one surfel per tile; else 8x8. With
    /// too little room, fine tiles would spend it on the image's top rows.
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
    /// Those of the view's tiles: at ray hits a further round finds no more.
    of_view: u32,
}

impl SurfelCache {
    /// Covers what a view sees with surfels, in rounds. Returns the number of surfels that it gained over the number of
    /// its tiles.
    pub(crate) fn spawn(
        &mut self,
        work: &Work<'_>,
        request: &SpawnRequest<'_>,
        step: &mut Step,
    ) -> Result<f32, GpuError> {
        let tiles = Tiles::of(request.size, request.radius_pixels, self.capacity - self.live);
        self.memory.reserve_candidates(work.gpu, tiles.count())?;
        if self.settings.initial != Initial::Gaps && self.next_serial == 1 {
            self.seed(work, request.frame, step)?;
        }
        let mut gain = 0.0;
        for round in 0..MOST_ROUNDS {
            let accepted = self.spawn_round(work, request, tiles, round, step)?;
            self.updates.is_converged &= accepted.all == 0;
            let gained = accepted.of_view as f32 / tiles.count() as f32;
            gain += gained;
            if gained < ROUND_GAIN || self.live >= self.capacity {
                break;
            }
        }
        Ok(gain)
    }

    /// Spawns the first surfels in directions over the whole sphere around the camera.
    fn seed(&mut self, work: &Work<'_>, frame: &[u8], step: &mut Step) -> Result<(), GpuError> {
        let directions = self.initial_count();
        self.memory.reserve_candidates(work.gpu, directions)?;
        let uniforms = SurfelUniforms {
            // In one row, so that each candidate is compared only with its neighbours in the sequence.
            columns: directions,
            rows: 1,
            item_count: SURFEL_HIT_CANDIDATES + directions,
            first_item: self.settings.initial as u32,
            ..self.uniforms(0)
        };
        let mut graph = work.gpu.graph("surfel_seed");
        work.bind_scene(self.pass(&mut graph, work.kernels, "surfel_seed", &uniforms)?)
            .uniform("frame", frame)
            .dispatch(workgroups_of(directions))?;
        step.rays[1] += u64::from(directions);
        self.accept(work, frame, graph, &uniforms, step)?;
        self.seeded = self.live;
        Ok(())
    }

    /// Seed directions: with a mean kernel weight of 1/3, enough discs of the target radius for three times the target
    /// coverage on average, which is once at the sparsest point.
    fn initial_count(&self) -> u32 {
        let pixel_size = self.cameras.first().map_or(1.0, |camera| camera.pixel_size);
        let tangent = self.settings.radius_pixels * pixel_size;
        let count = 3.0 * 3.0 * self.settings.coverage * 4.0 / (tangent * tangent).max(f32::MIN_POSITIVE);
        (count.clamp(INITIAL_RANGE[0], INITIAL_RANGE[1]) as u32).min(self.capacity / 2)
    }

    /// At most one new surfel for each tile, and in a frame's first round those at ray hits.
    fn spawn_round(
        &mut self,
        work: &Work<'_>,
        request: &SpawnRequest<'_>,
        tiles: Tiles,
        round: u32,
        step: &mut Step,
    ) -> Result<Accepted, GpuError> {
        let mut uniforms = SurfelUniforms {
            columns: tiles.columns,
            rows: tiles.rows,
            item_count: SURFEL_HIT_CANDIDATES + tiles.count(),
            first_item: round,
            ..self.uniforms_for_view(request.is_coarse)
        };
        if request.pins {
            uniforms.switches |= surfel_switches::PINNING;
        }
        if tiles.are_fine {
            uniforms.switches |= surfel_switches::FINE_TILES;
        }
        let mut graph = work.gpu.graph("surfel_spawn");
        request
            .visibility
            .bind(work.bind_scene(self.pass(&mut graph, work.kernels, "surfel_coverage", &uniforms)?))
            .uniform("frame", request.frame)
            .dispatch([request.size[0].div_ceil(SPAWN_TILE), request.size[1].div_ceil(SPAWN_TILE), 1])?;
        self.accept(work, request.frame, graph, &uniforms, step)
    }

    /// Makes surfels of the candidates, except those too close to another one.
    fn accept(
        &mut self,
        work: &Work<'_>,
        frame: &[u8],
        mut graph: Graph,
        uniforms: &SurfelUniforms,
        step: &mut Step,
    ) -> Result<Accepted, GpuError> {
        let kernels = work.kernels;
        let count = uniforms.item_count;
        graph.clear(&self.memory.claims)?;
        self.pass(&mut graph, kernels, "surfel_claim", uniforms)?.dispatch(workgroups_of(SURFEL_HIT_CANDIDATES))?;
        self.pass(&mut graph, kernels, "surfel_reject", uniforms)?.dispatch(workgroups_of(count))?;
        self.memory.scan.record(&mut graph, &self.memory.values, count + 1)?;
        let mut accepted_before = |candidate: u32| {
            graph.read_back(&self.memory.values, u64::from(candidate) * 4..u64::from(candidate) * 4 + 4)
        };
        let (of_hits, all) = (accepted_before(SURFEL_HIT_CANDIDATES)?, accepted_before(count)?);
        self.pass(&mut graph, kernels, "surfel_spawn", uniforms)?.dispatch(workgroups_of(count))?;
        graph.clear(&self.memory.counters)?;
        work.bind_scene(self.pass(&mut graph, kernels, "surfel_probe", uniforms)?)
            .uniform("frame", frame)
            .dispatch(workgroups_of(count))?;
        let probes = graph.read_back(&self.memory.counters, 0..counters::BYTES)?;
        // Candidates at ray hits count once. Those of tiles tell the next round where to look.
        self.memory.withdraw_hit_candidates(&mut graph)?;
        let mut report = graph.submit()?.wait()?;
        merge_passes(&mut step.passes, std::mem::take(&mut report.passes));
        count_rays(step, &report.take(probes)?);
        let (of_hits, all) = (u32_of(&report.take(of_hits)?), u32_of(&report.take(all)?));
        if all > 0 {
            self.next_serial = self.next_serial.wrapping_add(all);
            let spawned = all.min(self.capacity - self.live);
            self.new = self.new.saturating_add(spawned);
            self.used = self.used.max(self.live + spawned);
            self.rebuild(work, self.live + spawned, step)?;
        }
        Ok(Accepted { all, of_view: all.saturating_sub(of_hits) })
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
