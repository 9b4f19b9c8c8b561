//! Reconstruction on the graph of surfels: from what each measured to what is shown.
//!
//! Neighbours are joined by edges. Rays reconnected to a neighbour measure the difference along an edge; a local regression
//! says what the neighbours make one expect; the solve weighs values and differences against each other by their variances.
//! Formulas are with the kernels in `shaders/techniques/surfel/graph/`.

use surfelcast_gpu::{Buffer, Gpu, GpuError, Graph, MemoryKind, PassBuilder};
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::{FirstHit, SurfelEdge, SurfelUniforms};

use crate::surfel::cache::SurfelCache;
use crate::surfel::settings::Reconstruction;
use crate::surfel::snapshot::read;
use crate::surfel::work::Work;
use crate::technique::TechniqueError;
use surfelcast_passes::kernels::KernelSet;
use surfelcast_passes::workgroups_of;

/// What every reconstruction runs.
pub(crate) const KERNELS: &[&str] =
    &["graph_choose", "graph_join", "graph_checkpoint", "graph_moments", "graph_pool", "graph_statistics"];
/// What measured differences take.
pub(crate) const DIFFERENCE_KERNELS: &[&str] = &["graph_shift", "graph_learn", "graph_link"];
/// What new values of surfels take.
pub(crate) const VALUE_KERNELS: &[&str] = &["graph_regress", "graph_blend", "graph_output"];
/// What a solve for those takes.
pub(crate) const SOLVE_KERNELS: &[&str] =
    &["graph_scales", "graph_shrink", "graph_residual", "graph_product", "graph_advance", "graph_turn"];

/// Slots of edges for each surfel.
pub(crate) const EDGE_SLOTS: u64 = 8;
/// Bytes of a shifted ray.
const SHIFT_BYTES: u64 = 16;
/// Edges that statistics of a ray reach, and those of the variance that values are weighed by.
const NEAR_RINGS: u32 = 2;
const WIDE_RINGS: u32 = 6;
/// Regressions one after the other: the second makes its values of the first one's, and so reaches about twenty neighbours.
const REGRESSIONS: usize = 2;
/// Steps of the solve in one update; it goes on from the last update's solution.
const ITERATIONS: u32 = 4;
/// Invocations of a workgroup that sums, workgroups at most, and regions of their sums.
const SUM_LANES: u32 = 256;
const SUM_GROUPS: u32 = 256;
const SUM_REGIONS: u64 = 4;

/// Device memory of the graph, by surfel unless it says otherwise.
#[derive(Debug)]
pub(crate) struct SurfelGraph {
    /// Eight slots each.
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
    /// Where differences are measured.
    shifted: Option<Shifted>,
    /// Where they are solved for.
    solve: Option<Solve>,
}

/// What measuring differences takes beside that, by ray.
#[derive(Debug)]
struct Shifted {
    first_hits: Buffer,
    shifts: Buffer,
}

/// What solving for them takes.
#[derive(Debug)]
struct Solve {
    residuals: Buffer,
    directions: Buffer,
    products: Buffer,
}

impl SurfelGraph {
    pub(crate) fn new(gpu: &Gpu, capacity: u64, reconstruction: Reconstruction) -> Result<Self, GpuError> {
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

    /// Makes room for so many rays, where they are shifted.
    pub(crate) fn reserve(&mut self, gpu: &Gpu, rays: u64) -> Result<(), GpuError> {
        if let Some(shifted) = &mut self.shifted
            && shifted.shifts.size_bytes() < rays * SHIFT_BYTES
        {
            shifted.first_hits = cleared(gpu, "first_hits", rays * size_of::<FirstHit>() as u64)?;
            shifted.shifts = cleared(gpu, "shifts", rays * SHIFT_BYTES)?;
        }
        Ok(())
    }

    /// What the next update goes on from and no other pass makes anew: 16 bytes a surfel each, of floats.
    pub(crate) fn kept_numbers(&self) -> [&Buffer; 2] {
        [&self.checkpoints, &self.solutions]
    }

    /// [`EDGE_SLOTS`] of `SurfelEdge` a surfel.
    pub(crate) fn edges(&self) -> &Buffer {
        &self.edges
    }

    /// Where rays first hit something, where anybody asks.
    pub(crate) fn first_hits(&self) -> Option<&Buffer> {
        self.shifted.as_ref().map(|shifted| &shifted.first_hits)
    }

    /// Slope of each surfel: by `graph_regress`, or by `image_slopes` where light is reconstructed in the image.
    pub(crate) fn slopes(&self) -> &Buffer {
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

/// Workgroups that sum over so many surfels.
fn sum_groups(live: u32) -> [u32; 3] {
    [live.div_ceil(SUM_LANES).clamp(1, SUM_GROUPS), 1, 1]
}

impl SurfelCache {
    /// A pass over the graph with whatever its kernel asks for. Sums are pooled from `pools.0` into `pools.1`.
    fn graph_pass<'g>(
        &self,
        graph: &'g mut Graph,
        kernels: &KernelSet,
        name: &str,
        uniforms: &[u8],
        pools: (usize, usize),
    ) -> Result<PassBuilder<'g>, TechniqueError> {
        let nodes = self.graph.as_ref().ok_or_else(|| GpuError::Validation {
            context: "surfel graph".to_owned(),
            message: format!("`{name}` runs without one"),
        })?;
        let named = [
            ("surfel_lists", &self.lists),
            ("surfel_lights", &self.lights),
            ("surfels", &self.records),
            ("surfel_grid", &self.grid),
            ("surfel_tiles", &self.tiles),
            ("surfel_outputs", &self.outputs),
            ("outputs", &self.outputs),
            ("scan_values", &self.values),
            ("rays", &self.rays),
            ("counters", &self.counters),
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
        let of_shifts =
            nodes.shifted.as_ref().map(|shifted| [("first_hits", &shifted.first_hits), ("shifts", &shifted.shifts)]);
        let of_solve = nodes.solve.as_ref().map(|solve| {
            [
                ("node_residuals", &solve.residuals),
                ("node_directions", &solve.directions),
                ("node_products", &solve.products),
            ]
        });
        let pass = graph.pass(kernels.get(name)?).uniform("cache", uniforms);
        let all = named.into_iter().chain(of_shifts.into_iter().flatten()).chain(of_solve.into_iter().flatten());
        Ok(all.fold(pass, |pass, (name, buffer)| pass.bind_if_bound(name, buffer)))
    }

    /// Joins the living surfels to their neighbours anew; edges that stay keep what they have learnt.
    pub(crate) fn record_edges(&self, graph: &mut Graph, kernels: &KernelSet) -> Result<(), TechniqueError> {
        if self.graph.is_none() || self.live == 0 {
            return Ok(());
        }
        let uniforms = self.uniforms(0);
        for name in ["graph_choose", "graph_join"] {
            self.graph_pass(graph, kernels, name, bytemuck::bytes_of(&uniforms), (0, 1))?
                .dispatch(workgroups_of(self.live))?;
        }
        Ok(())
    }

    /// Reconnects a range of the update's rays to neighbours.
    pub(crate) fn record_shifts(
        &self,
        graph: &mut Graph,
        work: &Work<'_>,
        frame: &[u8],
        uniforms: &SurfelUniforms,
    ) -> Result<(), TechniqueError> {
        if !self.measures_differences() {
            return Ok(());
        }
        let pass = self.graph_pass(graph, work.kernels, "graph_shift", bytemuck::bytes_of(uniforms), (0, 1))?;
        let groups = [uniforms.item_count.div_ceil(64), 1, 1];
        work.lights.bind(work.scene.bind(pass)).uniform("frame", frame).dispatch(groups)?;
        Ok(())
    }

    /// Whether edges carry measured differences.
    pub(crate) fn measures_differences(&self) -> bool {
        self.graph.as_ref().is_some_and(|graph| graph.shifted.is_some())
    }

    /// From the surfels' means, and the edges' differences where they are measured, to what gathers read; or to slopes alone,
    /// where light is reconstructed in the image.
    pub(crate) fn record_reconstruction(
        &self,
        graph: &mut Graph,
        kernels: &KernelSet,
        uniforms: &SurfelUniforms,
    ) -> Result<(), TechniqueError> {
        let each = workgroups_of(self.live);
        let summing = sum_groups(self.live);
        let measures = self.measures_differences();
        let solves = self.graph.as_ref().is_some_and(|graph| graph.solve.is_some());
        let passes = std::array::from_fn::<_, REGRESSIONS, _>(|pass| SurfelUniforms {
            first_item: pass as u32,
            item_count: REGRESSIONS as u32,
            ..*uniforms
        });
        let mut run_as =
            |pass: usize, name: &str, pools: (usize, usize), groups: [u32; 3]| -> Result<(), TechniqueError> {
                Ok(self.graph_pass(graph, kernels, name, bytemuck::bytes_of(&passes[pass]), pools)?.dispatch(groups)?)
            };
        let mut run = |name: &str, pools: (usize, usize), groups: [u32; 3]| run_as(0, name, pools, groups);
        if measures {
            run("graph_learn", (0, 1), each)?;
        }
        run("graph_checkpoint", (0, 1), each)?;
        run("graph_moments", (1, 0), each)?;
        // Only the solve weighs values, by a variance from far around. An even number of rings leaves the sums in the first pool.
        for ring in 0..if solves { WIDE_RINGS } else { NEAR_RINGS } {
            let from = ring as usize % 2;
            run("graph_pool", (from, 1 - from), each)?;
            if ring + 1 == NEAR_RINGS {
                run("graph_statistics", (1 - from, from), each)?;
            }
        }
        if self.settings().reconstruction.shows_means() {
            run("graph_link", (1, 0), each)?;
            return run("image_slopes", (0, 1), each);
        }
        for pass in 0..REGRESSIONS {
            run_as(pass, "graph_regress", (0, 1), each)?;
            run_as(pass, "graph_pool", (1, 0), each)?;
            run_as(pass, "graph_pool", (0, 1), each)?;
            if solves && pass == 0 {
                run_as(pass, "graph_scales", (1, 0), summing)?;
            }
            run_as(pass, "graph_blend", (1, 0), summing)?;
        }
        let mut run = |name: &str, pools: (usize, usize), groups: [u32; 3]| run_as(0, name, pools, groups);
        if solves {
            run("graph_link", (1, 0), each)?;
            run("graph_pool", (0, 1), each)?;
            run("graph_shrink", (1, 0), each)?;
            run("graph_residual", (0, 1), summing)?;
            self.record_iterations(graph, kernels, uniforms)?;
        }
        self.graph_pass(graph, kernels, "graph_output", bytemuck::bytes_of(uniforms), (0, 1))?.dispatch(each)?;
        Ok(())
    }
    /// Steps of the solve.
    fn record_iterations(
        &self,
        graph: &mut Graph,
        kernels: &KernelSet,
        uniforms: &SurfelUniforms,
    ) -> Result<(), TechniqueError> {
        for iteration in 0..ITERATIONS {
            let uniforms = SurfelUniforms { first_item: iteration, ..*uniforms };
            for name in ["graph_product", "graph_advance", "graph_turn"] {
                // After the last step no direction is needed.
                if name != "graph_turn" || iteration + 1 < ITERATIONS {
                    self.graph_pass(graph, kernels, name, bytemuck::bytes_of(&uniforms), (0, 1))?
                        .dispatch(sum_groups(self.live))?;
                }
            }
        }
        Ok(())
    }
}

/// What reconnected rays measured between two surfels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredDifference {
    /// Places in the list of [`SurfelCache::export`].
    pub ends: [u32; 2],
    /// B at the second end minus B at the first.
    pub difference: [f32; 3],
    /// Variance of its luminance.
    pub variance: f32,
    /// Reconnected rays of each end.
    pub counts: [f32; 2],
}

impl SurfelCache {
    /// Every edge of the graph that both ends have measured, once. Empty without reconstruction by differences.
    pub fn measured_differences(&self, gpu: &Gpu) -> Result<Vec<MeasuredDifference>, GpuError> {
        let Some(graph) = self.graph.as_ref().filter(|graph| graph.shifted.is_some()) else { return Ok(Vec::new()) };
        let ids: Vec<u32> = read(gpu, &self.lists, u64::from(self.live))?;
        let edges: Vec<SurfelEdge> = read(gpu, &graph.edges, u64::from(self.used) * EDGE_SLOTS)?;
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
