//! The surfel cache of a session: indirect light on discs over the scene, shared by all views of the session.
//!
//! `memory.rs` has the buffers, `cameras.rs` whoever looks at them. The stages of a frame that work on the cache are
//! `insert.rs` (into the grid), `spawn.rs`, `update.rs` (rays and means) and `neighbours.rs` (reconstruction);
//! `frame.rs` says in which order they run. Everything is private to this folder except the methods.

mod cameras;
mod fill;
mod grid;
mod insert;
mod memory;
mod neighbours;
mod snapshot;
mod spawn;
mod uniforms;
mod update;
mod work;

use surfelcast_gpu::{Buffer, Gpu, GpuError, Graph, PassBuilder};
use surfelcast_passes::kernels::KernelSet;
use surfelcast_passes::upload::SceneBuffers;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::SurfelUniforms;

use self::cameras::Cameras;
use self::grid::GridShape;
use self::memory::{Memory, capacity_for};
use self::neighbours::Neighbours;
use self::update::Updates;
use crate::surfel::settings::SurfelSettings;

pub(crate) use self::cameras::CacheCamera;
pub use self::neighbours::MeasuredDifference;
pub(crate) use self::neighbours::{DIFFERENCE_KERNELS, KERNELS, SOLVE_KERNELS, VALUE_KERNELS};
pub use self::snapshot::{ExportedSurfel, SnapshotError};
pub(crate) use self::spawn::SpawnRequest;
pub(crate) use self::work::{Work, count_rays};

/// Side of the smallest cells as a share of the scene's radius.
const CELL_SHARE: f32 = 1.0 / 262_144.0;
/// Bounds of radii as shares of the scene's radius.
const RADIUS_SHARES: [f32; 2] = [1.0 / 262_144.0, 0.05];
/// Keeps the cache's random numbers apart from those of the views.
const SEED_SALT: u64 = 0x7375_7266_656c_0001;

/// Surfels of one session in device memory.
#[derive(Debug)]
pub struct SurfelCache {
    settings: SurfelSettings,
    seed: u64,
    scene_radius: f32,
    /// Side of the smallest cells, metres.
    cell_size: f32,
    /// Smallest and largest radius, metres.
    radii: [f32; 2],
    /// Surfels that fit.
    capacity: u32,
    /// Slots in which cameras and rays leave marks for cells of cascades, and the largest number of the grid's.
    mark_slots: u32,
    memory: Memory,
    /// Edges between surfels, where light is reconstructed from them.
    neighbours: Option<Neighbours>,
    grid_shape: GridShape,
    /// Bit for each grid level that holds surfels.
    levels: u32,
    /// Live surfels are not yet inserted into the grid: the cache was just read from disk.
    awaits_insertion: bool,
    cameras: Cameras,
    /// Exposure of the view that was last placed, for the error that ray counts aim at.
    exposure: f32,
    /// Live surfels.
    live: u32,
    /// Ids below this one have been in use; the free ones among them are used again first.
    used: u32,
    /// Surfels that were placed before gaps were filled.
    seeded: u32,
    next_serial: u32,
    /// Surfels spawned since rays were last allocated.
    new: u32,
    updates: Updates,
    /// The light changed: ray counts are cut down before the next update.
    is_relit: bool,
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
        let reconstruction = settings.reconstruction;
        Ok(Self {
            settings: settings.of_cache(),
            seed: seed ^ SEED_SALT,
            scene_radius: scene.radius,
            cell_size: (scene.radius * CELL_SHARE).max(f32::MIN_POSITIVE),
            radii: RADIUS_SHARES.map(|share| (scene.radius * share).max(f32::MIN_POSITIVE)),
            capacity,
            mark_slots,
            memory: Memory::new(gpu, capacity, mark_slots)?,
            neighbours: if reconstruction.uses_graph() {
                Some(Neighbours::new(gpu, u64::from(capacity), reconstruction)?)
            } else {
                None
            },
            grid_shape: GridShape::cascades(0, mark_slots),
            levels: 0,
            awaits_insertion: false,
            cameras: Cameras::default(),
            exposure: 1.0,
            live: 0,
            used: 0,
            seeded: 0,
            next_serial: 1,
            new: 0,
            updates: Updates::default(),
            is_relit: false,
        })
    }

    /// Settings it was made with.
    pub fn settings(&self) -> &SurfelSettings {
        &self.settings
    }

    /// Live surfels and surfels that fit.
    pub fn counts(&self) -> [u32; 2] {
        [self.live, self.capacity]
    }

    /// Surfels that were placed first by [`crate::surfel::Initial`], with ids from 0 in the order of their directions.
    pub fn seeded(&self) -> u32 {
        self.seeded
    }

    /// Surfels spawned since rays were last allocated.
    pub(crate) fn new_surfels(&self) -> u32 {
        self.new
    }

    /// Registers a camera, which pins what it sees or does not. Returns its number.
    pub(crate) fn add_camera(&mut self, pins: bool) -> u64 {
        self.cameras.add(pins)
    }

    /// Places a camera.
    pub(crate) fn set_camera(&mut self, number: u64, camera: CacheCamera, exposure: f32) {
        self.exposure = exposure;
        self.cameras.place(number, camera);
    }

    /// Removes a camera.
    pub(crate) fn remove_camera(&mut self, number: u64) {
        self.cameras.remove(number);
    }

    /// The light changed: values stay as a first guess with almost no weight.
    pub(crate) fn relight(&mut self) {
        self.is_relit = true;
        self.updates.relight();
    }

    /// Binds what lookups read, as far as the kernel names it.
    pub(crate) fn bind<'g>(&self, pass: PassBuilder<'g>) -> PassBuilder<'g> {
        self.memory.bind_lookup(pass)
    }

    /// Ids of live surfels, and what surfels measured, for passes that go through them.
    pub(crate) fn bind_surfels<'g>(&self, pass: PassBuilder<'g>) -> PassBuilder<'g> {
        pass.bind_if_bound("surfel_lists", &self.memory.lists).bind_if_bound("surfel_lights", &self.memory.lights)
    }

    /// Slope of irradiance at each surfel, by id, where surfels have neighbours.
    pub(crate) fn slopes(&self) -> Option<&Buffer> {
        self.neighbours.as_ref().map(Neighbours::slopes)
    }

    /// A pass over the cache, with every buffer of the cache that its kernel names.
    fn pass<'g>(
        &self,
        graph: &'g mut Graph,
        kernels: &KernelSet,
        name: &str,
        uniforms: &SurfelUniforms,
    ) -> Result<PassBuilder<'g>, GpuError> {
        let kernel = kernels.get(name)?;
        let mut pass = graph.pass(kernel);
        if kernel.binds("cache") {
            pass = pass.uniform("cache", bytemuck::bytes_of(uniforms));
        }
        Ok(self.memory.bind(pass, self.neighbours.as_ref().and_then(Neighbours::first_hits)))
    }
}
