//! Time of bringing surfels to pixels, by gathering and by drawing boxes and quads, for the surfel counts of Noack
//! 2022, Table 6.2.
//!
//! Surfels lie where rays from the camera over the whole sphere hit the scene, and are sized by the thesis' equation
//! 5.4.

use std::path::Path;

use clap::Args;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use surfelcast::{Failure, scene_file};
use surfelcast_gpu::{Gpu, GpuError, PassTime};
use surfelcast_passes::features::features_for;
use surfelcast_scene::trace::closest_hit;
use surfelcast_scene::{Scene, pack_octahedral};
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck::Zeroable;
use surfelcast_shaders::records::{SurfelLight, SurfelRecord};
use surfelcast_techniques::surfel::{Apply, ExportedSurfel, FULL_TRUST, Reconstruction, SurfelCache, SurfelSettings};
use surfelcast_techniques::{FrameView, LightBuffers, LightState, MaterialMode, SceneBuffers, TechniqueError};

use crate::hit::facing_normal;
use crate::report::{Measured, Origin, OutputArgs, Page, Table, describe};

pub(super) const PAGE: Page = Page { name: "apply", template: include_str!("../../pages/apply.md.in") };
const SCENE: &str = "demo:interior";
/// Image size of the thesis' measurement.
const SIZE: [u32; 2] = [600, 600];
/// Surfel counts, and the frames per second that the thesis states for instanced and procedural drawing.
const COUNTS: [(u32, &str, &str); 5] = [
    (262_144, "53.0", "120"),
    (524_288, "27.0", "120"),
    (1_048_576, "13.5", "120"),
    (2_097_152, "6.3", "76"),
    (4_194_304, "3.1", "39"),
];
/// The thesis' "surfel density": the smallest that it tests.
const DENSITY: f32 = 2.0;
/// Repetitions, of which the fastest counts.
const ROUNDS: usize = 7;

#[derive(Debug, Args)]
pub(crate) struct ApplyArgs {
    /// Surfels at most.
    #[arg(long, value_name = "N", default_value_t = u32::MAX)]
    most: u32,
    #[command(flatten)]
    output: OutputArgs,
}

/// Times for one number of surfels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Row {
    key: Key,
    origin: Origin,
    /// Surfels that a ray placed, and the caches that hold them.
    placed: usize,
    caches: u32,
    /// Milliseconds of gathering, of boxes and of quads.
    ms: [f64; 3],
    /// Bits of the floats in which drawing sums.
    float_bits: u32,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Key {
    surfels: u32,
}

impl Measured for Row {
    type Key = Key;

    fn key(&self) -> &Key {
        &self.key
    }

    fn origin(&self) -> &Origin {
        &self.origin
    }

    fn table(rows: &[Self]) -> Table {
        let columns = ["rays", "placed", "caches", "gather_ms", "boxes_ms", "quads_ms", "commit", "device"];
        let mut table = Table::new(columns);
        for row in rows {
            let counts = [row.key.surfels.to_string(), row.placed.to_string(), row.caches.to_string()];
            let origin = [row.origin.commit.clone(), row.origin.device.clone()];
            table.push(counts.into_iter().chain(row.ms.map(|ms| format!("{ms:.3}"))).chain(origin));
        }
        table
    }
}

/// Surfels where the rays of a Fibonacci sphere about the camera hit: every `parts`-th of `count`, starting with
/// `part`.
fn surfels(scene: &Scene, count: u32, part: u32, parts: u32) -> Vec<ExportedSurfel> {
    let origin = (scene.cameras[0].camera.position - scene.origin).as_vec3();
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let placed = (0..count / parts).into_par_iter().with_min_len(1024).filter_map(|index| {
        let index = index * parts + part;
        let height = 1.0 - (2.0 * f64::from(index) + 1.0) / f64::from(count);
        let (sin, cos) = (golden * f64::from(index)).sin_cos();
        let around = (1.0 - height * height).max(0.0).sqrt();
        let direction = glam::DVec3::new(cos * around, height, sin * around).as_vec3();
        let hit = closest_hit(&scene.geometry, origin, direction, 0.0, f32::MAX)?;
        let normal = facing_normal(&scene.geometry, &hit, direction);
        // Equation 5.4.
        let radius = DENSITY * hit.t * 4.0 / ((count as f32).sqrt() * (normal.dot(direction).abs() + 1.0) / 2.0);
        let record = SurfelRecord {
            position: (origin + direction * hit.t).to_array(),
            radius,
            normal: pack_octahedral(normal),
            bvh_triangle: hit.bvh_triangle,
            instance: hit.instance,
            barycentrics: [hit.u, hit.v],
            ..SurfelRecord::zeroed()
        };
        let light = SurfelLight { indirect: [0.5; 3], ray_count: FULL_TRUST, ..SurfelLight::zeroed() };
        Some(ExportedSurfel { record, light })
    });
    placed.collect()
}

/// Milliseconds of the passes that bring surfels to pixels.
fn apply_ms(passes: &[PassTime]) -> f64 {
    passes.iter().filter(|pass| pass.name != "visibility").map(|pass| pass.gpu_ms).sum()
}

struct Setup<'a> {
    gpu: &'a Gpu,
    scene: &'a Scene,
    buffers: SceneBuffers,
    lights: LightBuffers,
    features: Features,
}

impl Setup<'_> {
    /// Surfels placed, the number of caches that hold them, and the fastest times of gather, boxes and quads. If one
    /// cache of that size does not fit the device, several draw one after the other; they cannot be gathered as one.
    fn measure(&self, count: u32) -> Result<(usize, u32, [f64; 3]), Failure> {
        let mut parts = 1;
        loop {
            match self.measure_in(count, parts) {
                Ok((placed, times)) => return Ok((placed, parts, times)),
                Err(TechniqueError::Gpu(GpuError::TooLarge { .. } | GpuError::OutOfMemory { .. })) if parts < 64 => {
                    parts *= 2;
                }
                Err(error) => return Err(error.into()),
            }
        }
    }

    fn measure_in(&self, count: u32, parts: u32) -> Result<(usize, [f64; 3]), TechniqueError> {
        let settings = SurfelSettings {
            radius_pixels: self.radius_pixels(count),
            reconstruction: Reconstruction::None,
            ..SurfelSettings::BALANCED
        };
        let view = FrameView { camera: self.scene.cameras[0].camera, size: SIZE, exposure: 1.0 };
        let (mut all_placed, mut sums) = (0, [0.0; 3]);
        for part in 0..parts {
            let placed = surfels(self.scene, count, part, parts);
            let mut cache = SurfelCache::filled(self.gpu, &self.buffers, &self.lights, settings, &placed)?;
            all_placed += placed.len();
            let mut fastest = [f64::INFINITY; 3];
            // Alternating, so that other load of the machine affects all three alike.
            for _ in 0..ROUNDS {
                for (time, apply) in fastest.iter_mut().zip([Apply::Gather, Apply::Boxes, Apply::Quads]) {
                    let (_, passes) =
                        cache.apply(self.gpu, &self.buffers, &self.lights, &view, self.features, 0, apply)?;
                    *time = time.min(apply_ms(&passes));
                }
            }
            for (sum, time) in sums.iter_mut().zip(fastest) {
                *sum += time;
            }
        }
        Ok((all_placed, sums))
    }

    /// The radius of the thesis' sizes in pixels of the image, so that gathers search for surfels of that size.
    fn radius_pixels(&self, count: u32) -> f32 {
        let pixel = 2.0 * (self.scene.cameras[0].camera.vfov * 0.5).tan() as f32 / SIZE[1] as f32;
        (DENSITY * 4.0 / (count as f32).sqrt() / pixel).clamp(1.5, 32.0)
    }
}

#[allow(clippy::print_stderr, reason = "a study says how far it is")]
pub(crate) fn run(args: &ApplyArgs) -> Result<(), Failure> {
    let mut record = args.output.record::<Row>(PAGE.name)?;
    let scene = scene_file::load(Path::new(SCENE), None, None)?;
    let gpu = args.output.gpu()?;
    let origin = Origin::of(&gpu);
    gpu.can_draw()?;
    let lights = LightBuffers::new(&gpu, &scene, &LightState::of_scene(&scene))?;
    let setup = Setup {
        gpu: &gpu,
        scene: &scene,
        buffers: SceneBuffers::new(&gpu, &scene)?,
        features: features_for(&scene.summary, MaterialMode::Lambert, lights.punctual_count > 0, false),
        lights,
    };
    let mut rows = Vec::new();
    for (count, ..) in COUNTS.iter().filter(|(count, ..)| *count <= args.most) {
        let key = Key { surfels: *count };
        let row = record.find_or_measure(&key, &origin, || {
            let (placed, caches, ms) = setup.measure(*count)?;
            let float_bits = if gpu.draws_full_floats() { 32 } else { 16 };
            Ok(Row { key: key.clone(), origin: origin.clone(), placed, caches, ms, float_bits })
        })?;
        eprintln!("{count} surfels: gather, boxes, quads in {:.1?} ms", row.ms);
        rows.push(row.clone());
    }
    args.output.publish(&PAGE, &[(PAGE.name, markdown(&rows))])
}

fn markdown(rows: &[Row]) -> String {
    let mut table = Table::new([
        "rays, surfels placed",
        "gather, ms",
        "boxes, ms",
        "quads, ms",
        "thesis: instanced, FPS",
        "thesis: procedural, FPS",
    ]);
    for row in rows {
        let [gather, boxes, quads] = row.ms.map(|ms| format!("{ms:.1}"));
        let theirs = COUNTS.iter().find(|(count, ..)| *count == row.key.surfels);
        let (instanced, procedural) = theirs.map_or(("-", "-"), |(_, instanced, procedural)| (instanced, procedural));
        table.push([
            format!("{}, {}", row.key.surfels, row.placed),
            if row.caches == 1 { gather } else { format!("- ({} caches)", row.caches) },
            boxes,
            quads,
            instanced.to_owned(),
            procedural.to_owned(),
        ]);
    }
    let bits = rows.first().map(|row| format!("sums in {}-bit floats", row.float_bits));
    describe(rows.iter().map(|row| &row.origin), &bits.into_iter().collect::<Vec<_>>()) + &table.markdown()
}
