//! Reconstruction on the graph of surfels: from what each measured to what is shown.
//!
//! Neighbours are joined by edges. Rays reconnected to a neighbour measure the difference along an edge; a local regression
//! says what the neighbours make one expect; the solve weighs values and differences against each other by their variances.
//! Formulas are with the kernels in `shaders/techniques/surfel/graph/`.

use surfelcast_gpu::{Buffer, Gpu, GpuError, Graph, MemoryKind, PassBuilder};
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::{FirstHit, SurfelEdge, SurfelUniforms};

use crate::passes::workgroups_of;
use crate::surfel::cache::SurfelCache;
use crate::surfel::kernels::KernelSet;
use crate::surfel::settings::Reconstruction;
use crate::surfel::update::Work;
use crate::technique::TechniqueError;

/// Slots of edges for each surfel.
pub(crate) const EDGE_SLOTS: u64 = 8;
/// Edges that statistics of a ray reach, and those of the variance that values are weighed by.
const NEAR_RINGS: u32 = 2;
const WIDE_RINGS: u32 = 10;
/// Steps of the solve in one update; it goes on from the last update's solution.
const ITERATIONS: u32 = 8;
/// Invocations of a workgroup that sums, workgroups at most, and regions of their sums.
const SUM_LANES: u32 = 256;
const SUM_GROUPS: u32 = 256;
const SUM_REGIONS: u64 = 4;

/// Device memory of the graph, by surfel unless it says otherwise.
#[derive(Debug)]
pub(crate) struct SurfelGraph {
    /// Eight slots each.
    pub(crate) edges: Buffer,
    /// By ray.
    pub(crate) first_hits: Buffer,
    /// By ray.
    shifts: Buffer,
    chosen: Buffer,
    links: Buffer,
    checkpoints: Buffer,
    statistics: Buffer,
    expected: Buffer,
    expected_direct: Buffer,
    gradients: Buffer,
    values: Buffer,
    solutions: Buffer,
    residuals: Buffer,
    directions: Buffer,
    products: Buffer,
    pools: [Buffer; 2],
    partial_sums: Buffer,
}

impl SurfelGraph {
    pub(crate) fn new(gpu: &Gpu, capacity: u64) -> Result<Self, GpuError> {
        let by_surfel = |label: &str| gpu.buffer(label, MemoryKind::Session, capacity * 16);
        let made = Self {
            edges: gpu.buffer(
                "surfel_edges",
                MemoryKind::Session,
                capacity * EDGE_SLOTS * size_of::<SurfelEdge>() as u64,
            )?,
            first_hits: gpu.buffer("first_hits", MemoryKind::Session, size_of::<FirstHit>() as u64)?,
            shifts: gpu.buffer("shifts", MemoryKind::Session, 16)?,
            chosen: by_surfel("chosen")?,
            links: gpu.buffer("node_links", MemoryKind::Session, capacity * EDGE_SLOTS * 16)?,
            checkpoints: by_surfel("node_checkpoints")?,
            statistics: by_surfel("node_statistics")?,
            expected: by_surfel("expected")?,
            expected_direct: by_surfel("expected_direct")?,
            gradients: by_surfel("node_gradients")?,
            values: by_surfel("node_values")?,
            solutions: by_surfel("node_solutions")?,
            residuals: by_surfel("node_residuals")?,
            directions: by_surfel("node_directions")?,
            products: by_surfel("node_products")?,
            pools: [by_surfel("pool_a")?, by_surfel("pool_b")?],
            partial_sums: gpu.buffer("partial_sums", MemoryKind::Session, u64::from(SUM_GROUPS) * SUM_REGIONS * 16)?,
        };
        let mut graph = gpu.graph("surfel_graph");
        let by_id = [
            &made.edges,
            &made.checkpoints,
            &made.links,
            &made.statistics,
            &made.solutions,
            &made.gradients,
            &made.values,
        ];
        let by_ray = [&made.first_hits, &made.shifts];
        for buffer in by_id.into_iter().chain(by_ray).chain(&made.pools).chain([&made.chosen, &made.partial_sums]) {
            graph.clear(buffer)?;
        }
        for buffer in [&made.expected, &made.expected_direct, &made.residuals, &made.directions, &made.products] {
            graph.clear(buffer)?;
        }
        graph.submit()?.wait()?;
        Ok(made)
    }

    /// Makes room for so many rays.
    pub(crate) fn reserve(&mut self, gpu: &Gpu, rays: u64) -> Result<(), GpuError> {
        if self.shifts.size_bytes() < rays * 16 {
            self.first_hits = gpu.buffer("first_hits", MemoryKind::Session, rays * size_of::<FirstHit>() as u64)?;
            self.shifts = gpu.buffer("shifts", MemoryKind::Session, rays * 16)?;
            let mut graph = gpu.graph("surfel_shifts");
            graph.clear(&self.first_hits)?;
            graph.clear(&self.shifts)?;
            graph.submit()?.wait()?;
        }
        Ok(())
    }
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
            ("first_hits", &nodes.first_hits),
            ("shifts", &nodes.shifts),
            ("chosen", &nodes.chosen),
            ("node_links", &nodes.links),
            ("node_checkpoints", &nodes.checkpoints),
            ("node_statistics", &nodes.statistics),
            ("expected", &nodes.expected),
            ("expected_direct", &nodes.expected_direct),
            ("node_gradients", &nodes.gradients),
            ("node_values", &nodes.values),
            ("node_solutions", &nodes.solutions),
            ("node_residuals", &nodes.residuals),
            ("node_directions", &nodes.directions),
            ("node_products", &nodes.products),
            ("pooled", &nodes.pools[pools.0]),
            ("to_pool", &nodes.pools[pools.1]),
            ("partial_sums", &nodes.partial_sums),
        ];
        let pass = graph.pass(kernels.get(name)?).uniform("cache", uniforms);
        Ok(named.into_iter().fold(pass, |pass, (name, buffer)| pass.bind_if_bound(name, buffer)))
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
        self.graph.is_some() && self.settings().reconstruction == Reconstruction::Poisson
    }

    /// From the surfels' means, and the edges' differences where they are measured, to what gathers read.
    pub(crate) fn record_reconstruction(
        &self,
        graph: &mut Graph,
        kernels: &KernelSet,
        uniforms: &SurfelUniforms,
    ) -> Result<(), TechniqueError> {
        let each = workgroups_of(self.live);
        let summing = sum_groups(self.live);
        let bytes = bytemuck::bytes_of(uniforms);
        if self.measures_differences() {
            self.graph_pass(graph, kernels, "graph_learn", bytes, (0, 1))?.dispatch(each)?;
        }
        self.graph_pass(graph, kernels, "graph_checkpoint", bytes, (0, 1))?.dispatch(each)?;
        self.graph_pass(graph, kernels, "graph_moments", bytes, (1, 0))?.dispatch(each)?;
        for ring in 0..WIDE_RINGS {
            let from = ring as usize % 2;
            self.graph_pass(graph, kernels, "graph_pool", bytes, (from, 1 - from))?.dispatch(each)?;
            if ring + 1 == NEAR_RINGS {
                self.graph_pass(graph, kernels, "graph_statistics", bytes, (1 - from, from))?.dispatch(each)?;
            }
        }
        // An even number of rings leaves the sums in the first pool.
        self.graph_pass(graph, kernels, "graph_regress", bytes, (0, 1))?.dispatch(each)?;
        self.graph_pass(graph, kernels, "graph_pool", bytes, (1, 0))?.dispatch(each)?;
        self.graph_pass(graph, kernels, "graph_pool", bytes, (0, 1))?.dispatch(each)?;
        self.graph_pass(graph, kernels, "graph_scales", bytes, (1, 0))?.dispatch(summing)?;
        self.graph_pass(graph, kernels, "graph_blend", bytes, (1, 0))?.dispatch(summing)?;
        if self.measures_differences() {
            self.graph_pass(graph, kernels, "graph_link", bytes, (1, 0))?.dispatch(each)?;
            self.graph_pass(graph, kernels, "graph_pool", bytes, (0, 1))?.dispatch(each)?;
            self.graph_pass(graph, kernels, "graph_shrink", bytes, (1, 0))?.dispatch(each)?;
            self.graph_pass(graph, kernels, "graph_residual", bytes, (0, 1))?.dispatch(summing)?;
            for iteration in 0..ITERATIONS {
                let mut uniforms = *uniforms;
                uniforms.first_item = iteration;
                let bytes = bytemuck::bytes_of(&uniforms);
                self.graph_pass(graph, kernels, "graph_product", bytes, (0, 1))?.dispatch(summing)?;
                self.graph_pass(graph, kernels, "graph_advance", bytes, (0, 1))?.dispatch(summing)?;
                if iteration + 1 < ITERATIONS {
                    self.graph_pass(graph, kernels, "graph_turn", bytes, (0, 1))?.dispatch(summing)?;
                }
            }
        }
        self.graph_pass(graph, kernels, "graph_output", bytes, (0, 1))?.dispatch(each)?;
        Ok(())
    }
}
