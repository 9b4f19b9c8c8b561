//! A cache filled from outside: tools and measurements place surfels themselves.

use surfelcast_gpu::{Gpu, GpuError};
use surfelcast_passes::kernels::KernelSet;
use surfelcast_passes::lights::LightBuffers;
use surfelcast_passes::step::Step;
use surfelcast_passes::upload::SceneBuffers;
use surfelcast_shaders::Features;
use surfelcast_shaders::constants::SURFEL_TILE_WORDS;
use surfelcast_shaders::layout::bytemuck::{self, Zeroable as _};
use surfelcast_shaders::records::{SurfelLight, SurfelOutput, SurfelRecord};

use super::SurfelCache;
use super::snapshot::ExportedSurfel;
use super::work::Work;
use crate::surfel::settings::SurfelSettings;
use crate::technique::TechniqueError;

/// Kernels of the grid build.
const INSERTION: &[&str] =
    &["surfel_mark", "surfel_compact", "surfel_grid_count", "surfel_grid_scatter", "surfel_grid_sort"];
/// Bits of a live surfel that was spawned for a view.
const LIVE: u32 = 1;
/// Even guiding, and moments of open space (distance 2 radii, its square 4), as a new surfel has them.
const EVEN_GUIDING: u32 = 0x8080_8080;
const OPEN_SPACE: u32 = 0x4400_4000;

impl SurfelCache {
    /// A cache that holds exactly these surfels, with their light, inserted into the grid and ready to be applied.
    /// Their levels are computed here from their radii.
    pub fn filled(
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        settings: SurfelSettings,
        surfels: &[ExportedSurfel],
    ) -> Result<Self, TechniqueError> {
        let count = surfels.len() as u32;
        let settings = SurfelSettings { capacity: settings.capacity.max(count.max(1)), ..settings };
        let mut cache = Self::new(gpu, scene, settings, 0, 0)?;
        if count > cache.capacity {
            let message = format!("{count} surfels are given, a cache holds at most {}", cache.capacity);
            return Err(GpuError::Validation { context: "filling a surfel cache".to_owned(), message }.into());
        }
        let records: Vec<SurfelRecord> = surfels
            .iter()
            .enumerate()
            .map(|(index, surfel)| SurfelRecord {
                serial: index as u32 + 1,
                level: cache.level_of(surfel.record.radius),
                is_set: 0,
                ..surfel.record
            })
            .collect();
        let measured: Vec<SurfelLight> = surfels.iter().map(|surfel| surfel.light).collect();
        let outputs: Vec<SurfelOutput> = measured
            .iter()
            .map(|light| SurfelOutput {
                indirect: light.indirect,
                ray_count: light.ray_count,
                direct: light.direct,
                variance: light.variance / light.ray_count.max(1.0),
                ..SurfelOutput::zeroed()
            })
            .collect();
        let half = SURFEL_TILE_WORDS as usize / 2;
        let tile = [vec![EVEN_GUIDING; half], vec![OPEN_SPACE; half]].concat();
        gpu.upload(&cache.memory.records, 0, bytemuck::cast_slice(&records))?;
        gpu.upload(&cache.memory.lights, 0, bytemuck::cast_slice(&measured))?;
        gpu.upload(&cache.memory.outputs, 0, bytemuck::cast_slice(&outputs))?;
        gpu.upload(&cache.memory.tiles, 0, bytemuck::cast_slice(&tile.repeat(surfels.len())))?;
        gpu.upload(&cache.memory.flags, 0, bytemuck::cast_slice(&vec![LIVE; surfels.len()]))?;
        cache.next_serial = count + 1;
        cache.used = count;
        let kernels = KernelSet::new(gpu, INSERTION.to_vec(), Features::NONE, Features::NONE, true)?;
        cache.rebuild(&Work { gpu, kernels: &kernels, scene, lights }, count, &mut Step::default())?;
        Ok(cache)
    }

    /// Grid level for a radius, as the kernels choose it.
    fn level_of(&self, radius: f32) -> u32 {
        (2.0 * radius / self.cell_size).log2().ceil().clamp(0.0, 31.0) as u32
    }
}
