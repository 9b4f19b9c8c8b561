//! Time of bringing surfels to pixels, by gathering and by drawing boxes and quads, for the surfel counts of Noack 2022,
//! Table 6.2.
//!
//! Surfels lie where rays from the camera over the whole sphere hit the scene, and are sized by the thesis' equation 5.4.

use std::fmt::Write as _;
use std::path::Path;

use clap::Args;
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use surfelcast::args::DeviceArgs;
use surfelcast::{Failure, scene_file};
use surfelcast_gpu::{Gpu, GpuError, PassTime};
use surfelcast_passes::features::features_for;
use surfelcast_scene::trace::closest_hit;
use surfelcast_scene::{Scene, pack_octahedral};
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck::Zeroable;
use surfelcast_shaders::records::{SurfelLight, SurfelRecord};
use surfelcast_techniques::{
    Apply, ExportedSurfel, FULL_TRUST, FrameView, LightBuffers, LightState, MaterialMode, Reconstruction, SceneBuffers,
    SurfelCache, SurfelSettings, TechniqueError,
};

use crate::report::{TableArgs, device_name, open_gpu};

/// Name of the markers.
const NAME: &str = "apply";
const SCENE: &str = "demo:interior";
/// Picture of the thesis' measurement.
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
    table: TableArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Surfels where the rays of a Fibonacci sphere hit, seen from the camera: every `parts`-th of `count`, from `part` on.
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
        let triangle = &scene.geometry.bvh_triangles[hit.bvh_triangle as usize];
        let rows = scene.geometry.instances[hit.instance as usize].scene_from_object.map(Vec4::from);
        let [v0, v1, v2] = [triangle.v0, triangle.v1, triangle.v2].map(|corner| {
            let corner = Vec3::from(corner);
            if scene.geometry.baked_instance == Some(hit.instance) {
                corner
            } else {
                Vec3::from_array(rows.map(|row| row.dot(corner.extend(1.0))))
            }
        });
        let normal = (v1 - v0).cross(v2 - v0).normalize_or(-direction);
        let facing = normal.dot(direction);
        let normal = if facing > 0.0 { -normal } else { normal };
        // Equation 5.4.
        let radius = DENSITY * hit.t * 4.0 / ((count as f32).sqrt() * (facing.abs() + 1.0) / 2.0);
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
    passes.iter().filter(|pass| pass.name != "surfel_visibility").map(|pass| pass.gpu_ms).sum()
}

struct Setup<'a> {
    gpu: &'a Gpu,
    scene: &'a Scene,
    buffers: SceneBuffers,
    lights: LightBuffers,
    features: Features,
}

impl Setup<'_> {
    /// Surfels placed, the number of caches that hold them, and the fastest times of gather, boxes and quads. Where one cache of
    /// so many does not fit the device, several draw in turn; they cannot be gathered as one.
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
            // In turn, so that whatever else the machine does meets all alike.
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

    /// The radius that the thesis' sizes come to on the picture, so that gathers look for surfels of that size.
    fn radius_pixels(&self, count: u32) -> f32 {
        let pixel = 2.0 * (self.scene.cameras[0].camera.vfov * 0.5).tan() as f32 / SIZE[1] as f32;
        (DENSITY * 4.0 / (count as f32).sqrt() / pixel).clamp(1.5, 32.0)
    }
}

#[allow(clippy::print_stderr, reason = "a study says how far it is")]
pub(crate) fn run(args: &ApplyArgs) -> Result<(), Failure> {
    args.table.check(NAME)?;
    let scene = scene_file::load(Path::new(SCENE), None, None)?;
    let gpu = open_gpu(&args.device)?;
    gpu.can_draw()?;
    let lights = LightBuffers::new(&gpu, &scene, &LightState::of_scene(&scene))?;
    let setup = Setup {
        gpu: &gpu,
        scene: &scene,
        buffers: SceneBuffers::new(&gpu, &scene)?,
        features: features_for(&scene.summary, MaterialMode::Lambert, lights.punctual_count > 0, false),
        lights,
    };
    let mut text = format!(
        "{}, sums in {}-bit floats\n\n\
         | rays, surfels placed | gather, ms | boxes, ms | quads, ms | thesis: instanced, FPS | thesis: procedural, FPS |\n\
         |---|---|---|---|---|---|\n",
        device_name(&gpu),
        if gpu.draws_full_floats() { 32 } else { 16 },
    );
    for (count, instanced, procedural) in COUNTS.iter().filter(|(count, ..)| *count <= args.most) {
        let (placed, parts, [gather, boxes, quads]) = setup.measure(*count)?;
        let gather = if parts == 1 { format!("{gather:.1}") } else { format!("- ({parts} caches)") };
        let row = format!("| {count}, {placed} | {gather} | {boxes:.1} | {quads:.1} | {instanced} | {procedural} |");
        eprintln!("{row}");
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{row}");
    }
    args.table.publish(NAME, &text)
}
