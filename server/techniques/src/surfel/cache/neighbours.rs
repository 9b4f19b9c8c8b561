//! Neighbours of surfels, and the reconstruction over them: from what each surfel measured to what is shown.
//!
//! Neighbours are joined by edges. Rays reconnected to a neighbour measure the difference along an edge; a local
//! regression predicts a value from those of the neighbours; the solve weights values and differences by their inverse
//! variances. Formulas are with the kernels in `shaders/techniques/surfel/kernels/neighbours/`.

use surfelcast_gpu::{Buffer, Gpu, GpuError, Graph, MemoryKind, PassBuilder};
use surfelcast_passes::kernels::KernelSet;
use surfelcast_passes::workgroups_of;
use surfelcast_shaders::records::{FirstHit, SurfelEdge, SurfelUniforms};

use super::SurfelCache;
use super::snapshot::read;
use super::work::Work;
use crate::surfel::settings::Reconstruction;

/// Kernels of every reconstruction over neighbours.
pub(crate) const KERNELS: &[&str] = &[
    "neighbours_choose",
    "neighbours_join",
    "neighbours_checkpoint",
    "neighbours_moments",
    "neighbours_pool",
    "neighbours_statistics",
];
/// Kernels that measure differences.
pub(crate) const DIFFERENCE_KERNELS: &[&str] = &["neighbours_shift", "neighbours_learn", "neighbours_link"];
/// Kernels that give surfels new values.
pub(crate) const VALUE_KERNELS: &[&str] = &["neighbours_regress", "neighbours_blend", "neighbours_output"];
/// Kernels of the solve for those values.
pub(crate) const SOLVE_KERNELS: &[&str] = &[
    "neighbours_scales",
    "neighbours_shrink",
    "neighbours_residual",
    "neighbours_product",
    "neighbours_advance",
    "neighbours_direction",
];

/// Slots of edges for each surfel.
pub(super) const EDGE_SLOTS: u64 = 8;
/// Bytes of a shifted ray.
const SHIFT_BYTES: u64 = 16;
/// Number of edges over which statistics of a ray are pooled, and over which the variance that weights values is.
const NEAR_RINGS: u32 = 2;
const WIDE_RINGS: u32 = 6;
/// Regressions in sequence: the second regresses over the results of the first and so reaches about twenty neighbours.
const REGRESSIONS: usize = 2;
/// Steps of the solve in one update, which starts from the last update's solution.
const ITERATIONS: u32 = 4;
/// Invocations of a summing workgroup, largest number of workgroups, and regions of their sums.
const SUM_LANES: u32 = 256;
const SUM_GROUPS: u32 = 256;
const SUM_REGIONS: u64 = 4;
/// Rebuild edges when 1/32 of the live surfels are new, or after four updates.
const EDGE_NEW_SHARE: u32 = 32;
const EDGE_UPDATES: u32 = 4;

/// Device memory of the edges and of the reconstruction over them, by surfel unless it says otherwise.
#[derive(Debug)]
pub(super) struct Neighbours {
    built: EdgesBuilt,
    /// [`EDGE_SLOTS`] each.
    edges: Buffer,
    links: Buffer,
    chosen: Buffer,
    checkpoints: Buffer,
    statistics: Buffer,
    expected: Buffer,
    expected_direct: Buffer,
    gradients: Buffer,
    values: Buffer,
    solutions: Buffer,
    pools: [Buffer; 2],
    partial_sums: Buffer,
    /// `Some` where differences are measured.
    shifted: Option<Shifted>,
    /// `Some` where the solve weights values and differences.
    solve: Option<Solve>,
}

/// Memory for measuring differences, by ray.
#[derive(Debug)]
struct Shifted {
    first_hits: Buffer,
    shifts: Buffer,
}

/// Memory of the solve.
#[derive(Debug)]
struct Solve {
    residuals: Buffer,
    directions: Buffer,
    products: Buffer,
}

impl Neighbours {
    pub(super) fn new(gpu: &Gpu, capacity: u64, reconstruction: Reconstruction) -> Result<Self, GpuError> {
        let buffer = |label, bytes| cleared(gpu, label, bytes);
        let by_surfel = |label| buffer(label, capacity * 16);
        let shifted = if reconstruction.measures_differences() {
            Some(Shifted {
                first_hits: buffer("first_hits", size_of::<FirstHit>() as u64)?,
                shifts: buffer("shifts", SHIFT_BYTES)?,
            })
        } else {
            None
        };
        let solve = if reconstruction == Reconstruction::Poisson {
            Some(Solve {
                residuals: by_surfel("node_residuals")?,
                directions: by_surfel("node_directions")?,
                products: by_surfel("node_products")?,
            })
        } else {
            None
        };
        Ok(Self {
            built: EdgesBuilt::default(),
            edges: buffer("surfel_edges", capacity * EDGE_SLOTS * size_of::<SurfelEdge>() as u64)?,
            links: buffer("node_links", capacity * EDGE_SLOTS * 16)?,
            chosen: by_surfel("chosen")?,
            checkpoints: by_surfel("node_checkpoints")?,
            statistics: by_surfel("node_statistics")?,
            expected: by_surfel("expected")?,
            expected_direct: by_surfel("expected_direct")?,
            gradients: by_surfel("node_gradients")?,
            values: by_surfel("node_values")?,
            solutions: by_surfel("node_solutions")?,
            pools: [by_surfel("pool_a")?, by_surfel("pool_b")?],
            partial_sums: buffer("partial_sums", u64::from(SUM_GROUPS) * SUM_REGIONS * 16)?,
            shifted,
            solve,
        })
    }

    /// Makes room for `rays` rays, where they are shifted.
    pub(super) fn reserve(&mut self, gpu: &Gpu, rays: u64) -> Result<(), GpuError> {
        if let Some(shifted) = &mut self.shifted
            && shifted.shifts.size_bytes() < rays * SHIFT_BYTES
        {
            shifted.first_hits = cleared(gpu, "first_hits", rays * size_of::<FirstHit>() as u64)?;
            shifted.shifts = cleared(gpu, "shifts", rays * SHIFT_BYTES)?;
        }
        Ok(())
    }

    /// Floats that the next update starts from and that no other pass computes again, 16 bytes a surfel each.
    pub(super) fn kept_numbers(&self) -> [&Buffer; 2] {
        [&self.checkpoints, &self.solutions]
    }

    /// [`EDGE_SLOTS`] of `SurfelEdge` for each surfel.
    pub(super) fn edges(&self) -> &Buffer {
        &self.edges
    }

    /// Whether edges carry measured differences.
    pub(super) fn measures_differences(&self) -> bool {
        self.shifted.is_some()
    }

    /// First hits of the rays, where differences are measured.
    pub(super) fn first_hits(&self) -> Option<&Buffer> {
        self.shifted.as_ref().map(|shifted| &shifted.first_hits)
    }

    /// Slope of each surfel: by `neighbours_regress`, or by `image_slopes` where light is reconstructed in the image.
    pub(super) fn slopes(&self) -> &Buffer {
        &self.gradients
    }
}

fn cleared(gpu: &Gpu, label: &str, bytes: u64) -> Result<Buffer, GpuError> {
    let buffer = gpu.buffer(label, MemoryKind::Session, bytes)?;
    let mut graph = gpu.graph("surfel_graph");
    graph.clear(&buffer)?;
    graph.submit()?.wait()?;
    Ok(buffer)
}

/// State of the cache when edges were last rebuilt.
#[derive(Clone, Copy, Debug, Default)]
struct EdgesBuilt {
    update: u32,
    live: u32,
    next_serial: u32,
    /// Surfels were recycled since the cache was made: new surfels take their ids, in whose slots edges of others
    /// remain.
    has_reused_ids: bool,
}

impl EdgesBuilt {
    /// Whether edges must be rebuilt now, which is then recorded: at once after surfels were recycled, for new ones
    /// when they are many or have waited for a few updates. Until then a surfel without edges shows its own mean.
    fn begin_rebuild_if_due(&mut self, update: u32, live: u32, next_serial: u32) -> bool {
        let new = next_serial.wrapping_sub(self.next_serial);
        let has_recycled = live < self.live.saturating_add(new);
        let is_first = self.next_serial == 0;
        let has_reused_ids = !is_first && has_recycled || self.has_reused_ids;
        let is_many = new.saturating_mul(EDGE_NEW_SHARE) >= live;
        let is_old = update.wrapping_sub(self.update) >= EDGE_UPDATES;
        let is_due = is_first || has_recycled || new > 0 && (is_many || is_old || has_reused_ids);
        if is_due {
            *self = Self { update, live, next_serial, has_reused_ids };
        }
        is_due
    }
}

/// Workgroups that sum over `live` surfels.
fn sum_groups(live: u32) -> [u32; 3] {
    [live.div_ceil(SUM_LANES).clamp(1, SUM_GROUPS), 1, 1]
}

impl SurfelCache {
    /// A pass over surfels and their edges. Sums are pooled from `pools.0` into `pools.1`.
    fn neighbour_pass<'g>(
        &self,
        graph: &'g mut Graph,
        kernels: &KernelSet,
        name: &str,
        uniforms: &SurfelUniforms,
        pools: (usize, usize),
    ) -> Result<PassBuilder<'g>, GpuError> {
        let pass = self.pass(graph, kernels, name, uniforms)?;
        let Some(nodes) = &self.neighbours else { return Ok(pass) };
        let named = [
            ("surfel_edges", &nodes.edges),
            ("chosen", &nodes.chosen),
            ("node_links", &nodes.links),
            ("node_checkpoints", &nodes.checkpoints),
            ("node_statistics", &nodes.statistics),
            ("expected", &nodes.expected),
            ("expected_direct", &nodes.expected_direct),
            ("node_gradients", &nodes.gradients),
            ("node_values", &nodes.values),
            ("blended", &nodes.values),
            ("node_solutions", &nodes.solutions),
            ("pooled", &nodes.pools[pools.0]),
            ("to_pool", &nodes.pools[pools.1]),
            ("partial_sums", &nodes.partial_sums),
        ];
        let of_shifts = nodes.shifted.as_ref().map(|shifted| ("shifts", &shifted.shifts));
        let of_solve = nodes.solve.as_ref().map(|solve| {
            [
                ("node_residuals", &solve.residuals),
                ("node_directions", &solve.directions),
                ("node_products", &solve.products),
            ]
        });
        let all = named.into_iter().chain(of_shifts).chain(of_solve.into_iter().flatten());
        Ok(all.fold(pass, |pass, (name, buffer)| pass.bind_if_bound(name, buffer)))
    }

    /// Whether edges carry measured differences.
    pub(super) fn measures_differences(&self) -> bool {
        self.neighbours.as_ref().is_some_and(Neighbours::measures_differences)
    }

    /// Joins the live surfels to their neighbours again if that is due; edges that stay keep what they measured.
    pub(super) fn record_edges(&mut self, graph: &mut Graph, kernels: &KernelSet) -> Result<(), GpuError> {
        let (update, live, next_serial) = (self.updates.number, self.live, self.next_serial);
        let is_due = self
            .neighbours
            .as_mut()
            .is_some_and(|neighbours| neighbours.built.begin_rebuild_if_due(update, live, next_serial));
        if is_due {
            for name in ["neighbours_choose", "neighbours_join"] {
                self.neighbour_pass(graph, kernels, name, &self.uniforms(0), (0, 1))?.dispatch(workgroups_of(live))?;
            }
        }
        Ok(())
    }

    /// Reconnects a range of the update's rays to neighbours.
    pub(super) fn record_shifts(
        &self,
        graph: &mut Graph,
        work: &Work<'_>,
        frame: &[u8],
        uniforms: &SurfelUniforms,
    ) -> Result<(), GpuError> {
        let pass = self.neighbour_pass(graph, work.kernels, "neighbours_shift", uniforms, (0, 1))?;
        work.bind_scene(pass).uniform("frame", frame).dispatch([uniforms.item_count.div_ceil(64), 1, 1])
    }

    /// From the surfels' means, and the edges' differences where they are measured, to what lookups read; or to slopes
    /// alone, where light is reconstructed in the image.
    pub(super) fn record_neighbours(
        &self,
        graph: &mut Graph,
        kernels: &KernelSet,
        uniforms: &SurfelUniforms,
    ) -> Result<(), GpuError> {
        let each = workgroups_of(self.live);
        let summing = sum_groups(self.live);
        let measures = self.measures_differences();
        let solves = self.neighbours.as_ref().is_some_and(|neighbours| neighbours.solve.is_some());
        let passes = std::array::from_fn::<_, REGRESSIONS, _>(|pass| SurfelUniforms {
            first_item: pass as u32,
            item_count: REGRESSIONS as u32,
            ..*uniforms
        });
        let mut run_as = |pass: usize, name: &str, pools: (usize, usize), groups: [u32; 3]| -> Result<(), GpuError> {
            self.neighbour_pass(graph, kernels, name, &passes[pass], pools)?.dispatch(groups)
        };
        let mut run = |name: &str, pools: (usize, usize), groups: [u32; 3]| run_as(0, name, pools, groups);
        if measures {
            run("neighbours_learn", (0, 1), each)?;
        }
        run("neighbours_checkpoint", (0, 1), each)?;
        run("neighbours_moments", (1, 0), each)?;
        // Only the solve weights values, by a widely pooled variance. An even number of rings leaves the sums in the
        // first pool.
        for ring in 0..if solves { WIDE_RINGS } else { NEAR_RINGS } {
            let from = ring as usize % 2;
            run("neighbours_pool", (from, 1 - from), each)?;
            if ring + 1 == NEAR_RINGS {
                run("neighbours_statistics", (1 - from, from), each)?;
            }
        }
        if self.settings.reconstruction.shows_means() {
            run("neighbours_link", (1, 0), each)?;
            return run("image_slopes", (0, 1), each);
        }
        for pass in 0..REGRESSIONS {
            run_as(pass, "neighbours_regress", (0, 1), each)?;
            run_as(pass, "neighbours_pool", (1, 0), each)?;
            run_as(pass, "neighbours_pool", (0, 1), each)?;
            if solves && pass == 0 {
                run_as(pass, "neighbours_scales", (1, 0), summing)?;
            }
            run_as(pass, "neighbours_blend", (1, 0), summing)?;
        }
        let mut run = |name: &str, pools: (usize, usize), groups: [u32; 3]| run_as(0, name, pools, groups);
        if solves {
            run("neighbours_link", (1, 0), each)?;
            run("neighbours_pool", (0, 1), each)?;
            run("neighbours_shrink", (1, 0), each)?;
            run("neighbours_residual", (0, 1), summing)?;
            self.record_iterations(graph, kernels, uniforms)?;
        }
        self.neighbour_pass(graph, kernels, "neighbours_output", uniforms, (0, 1))?.dispatch(each)
    }

    /// Steps of the solve.
    fn record_iterations(
        &self,
        graph: &mut Graph,
        kernels: &KernelSet,
        uniforms: &SurfelUniforms,
    ) -> Result<(), GpuError> {
        for iteration in 0..ITERATIONS {
            let uniforms = SurfelUniforms { first_item: iteration, ..*uniforms };
            for name in ["neighbours_product", "neighbours_advance", "neighbours_direction"] {
                // After the last step no direction is needed.
                if name != "neighbours_direction" || iteration + 1 < ITERATIONS {
                    self.neighbour_pass(graph, kernels, name, &uniforms, (0, 1))?.dispatch(sum_groups(self.live))?;
                }
            }
        }
        Ok(())
    }
}

/// What reconnected rays measured between two surfels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredDifference {
    /// Indices into the list of [`SurfelCache::export`].
    pub ends: [u32; 2],
    /// Irradiance over pi at the second end minus that at the first.
    pub difference: [f32; 3],
    /// Variance of its luminance.
    pub variance: f32,
    /// Reconnected rays of each end.
    pub counts: [f32; 2],
}

impl SurfelCache {
    /// Every edge that both ends have measured, once. Empty where no differences are measured.
    pub fn measured_differences(&self, gpu: &Gpu) -> Result<Vec<MeasuredDifference>, GpuError> {
        let Some(neighbours) = self.neighbours.as_ref().filter(|it| it.measures_differences()) else {
            return Ok(Vec::new());
        };
        let ids: Vec<u32> = read(gpu, &self.memory.lists, u64::from(self.live))?;
        let edges: Vec<SurfelEdge> = read(gpu, &neighbours.edges, u64::from(self.used) * EDGE_SLOTS)?;
        let slots_of = |id: u32| edges.iter().skip(id as usize * EDGE_SLOTS as usize).take(EDGE_SLOTS as usize);
        let place_of = |id: u32| ids.binary_search(&id).ok().map(|place| place as u32);
        let mut found = Vec::new();
        for (place, &id) in ids.iter().enumerate() {
            for there in slots_of(id).filter(|edge| edge.serial != 0 && edge.neighbour > id) {
                let back = slots_of(there.neighbour).find(|edge| edge.serial != 0 && edge.neighbour == id);
                let (Some(back), Some(other)) = (back, place_of(there.neighbour)) else { continue };
                if there.count <= 0.0 || back.count <= 0.0 {
                    continue;
                }
                found.push(MeasuredDifference {
                    ends: [place as u32, other],
                    difference: std::array::from_fn(|i| there.difference[i] - back.difference[i]),
                    variance: there.square / there.count + back.square / back.count,
                    counts: [there.count, back.count],
                });
            }
        }
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_rebuilt_at_once_after_recycling_and_later_for_a_few_new_surfels() {
        let mut built = EdgesBuilt::default();
        assert!(built.begin_rebuild_if_due(1, 1000, 1001), "the first edges");
        assert!(!built.begin_rebuild_if_due(2, 1000, 1001), "nothing changed");
        assert!(!built.begin_rebuild_if_due(2, 1010, 1011), "ten new ones wait");
        assert!(built.begin_rebuild_if_due(5, 1010, 1011), "for four updates");
        assert!(built.begin_rebuild_if_due(6, 1110, 1111), "a hundred do not wait");
        assert!(built.begin_rebuild_if_due(6, 1100, 1111), "ten were recycled");
        assert!(built.begin_rebuild_if_due(6, 1101, 1112), "a new one may have an id of theirs");
    }
}
