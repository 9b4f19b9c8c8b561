//! Rays per second on the GPU and by the plain CPU traversal, over the same hierarchy and the same rays.
//!
//! With a software GPU the ratio is the share of the machine that the kernel uses; with a real GPU it is the speedup.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::Args;
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use surfelcast::args::parse_size;
use surfelcast::{Failure, scene_file};
use surfelcast_gpu::{Buffer, Gpu, Kernel, MemoryKind};
use surfelcast_measure::shared_folder;
use surfelcast_scene::trace::{Hit, closest_hit};
use surfelcast_scene::{Scene, SceneGeometry};
use surfelcast_shaders::Features;
use surfelcast_techniques::SceneBuffers;

use crate::hit::facing_normal;
use crate::report::{Measured, Origin, OutputArgs, Page, Table, describe};

/// Side of the tiles in which rays are traced, pixels.
const TILE: u32 = 8;
/// Time of each race before it is measured, time that is measured, and rounds at least.
const WARM_UP: Duration = Duration::from_secs(1);
const MEASURED: Duration = Duration::from_secs(4);
const LEAST_ROUNDS: usize = 10;
/// Scenes next to the references, where there are any.
const SHARED_SCENES: [&str; 2] = ["terrain", "sponza"];
pub(super) const PAGE: Page = Page { name: "rays", template: include_str!("../../../pages/rays.md.in") };

const KERNEL: &str = include_str!("trace_rays.wesl");
const NO_HIT: u32 = u32::MAX;

#[derive(Debug, Args)]
pub(crate) struct RaysArgs {
    /// Image size; both sides are rounded up to a multiple of 8.
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = parse_size)]
    size: [u32; 2],
    #[command(flatten)]
    output: OutputArgs,
}

/// Millions of rays a second in one scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Row {
    key: Key,
    origin: Origin,
    triangles: usize,
    on_gpu: f64,
    on_cpu: f64,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Key {
    scene: String,
    /// Camera rays, or cosine-distributed ones from their hits.
    kind: String,
    size: [u32; 2],
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
        let columns = [
            "scene",
            "rays",
            "width",
            "height",
            "triangles",
            "gpu_mrays_per_sec",
            "cpu_mrays_per_sec",
            "commit",
            "device",
        ];
        let mut table = Table::new(columns);
        for Row { key, origin, triangles, on_gpu, on_cpu } in rows {
            table.push([
                key.scene.clone(),
                key.kind.clone(),
                key.size[0].to_string(),
                key.size[1].to_string(),
                triangles.to_string(),
                format!("{on_gpu:.3}"),
                format!("{on_cpu:.3}"),
                origin.commit.clone(),
                origin.device.clone(),
            ]);
        }
        table
    }
}

/// Origin and largest distance, direction.
type Ray = [Vec4; 2];

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct TraceRaysUniforms {
    ray_count: u32,
    top_root: u32,
    padding0: u32,
    padding1: u32,
}

/// Everything to trace batches on the GPU.
struct Tracer {
    gpu: Gpu,
    kernel: Kernel,
    scene: SceneBuffers,
    top_root: u32,
    rays: Buffer,
    hits: Buffer,
    count: u32,
}

impl Tracer {
    fn new(gpu: &Gpu, scene: &Scene, rays: &[Ray]) -> Result<Self, Failure> {
        let has_instances = scene.summary.has_instances;
        let features = if has_instances { Features::INSTANCES } else { Features::NONE };
        let buffer = gpu.buffer("rays", MemoryKind::Scene, size_of_val(rays) as u64)?;
        gpu.upload(&buffer, 0, bytemuck::cast_slice(rays))?;
        let buffers = SceneBuffers::new(gpu, scene)?;
        Ok(Self {
            gpu: gpu.clone(),
            kernel: gpu.kernel_from_source("trace_rays", KERNEL, features)?,
            top_root: buffers.traversal_root(features),
            scene: buffers,
            rays: buffer,
            hits: gpu.buffer("hits", MemoryKind::Scene, 8 * rays.len() as u64)?,
            count: rays.len() as u32,
        })
    }

    /// Traces all rays once; returns the time of the pass and, if requested, distance and triangle of each ray.
    fn trace(&self, reads_hits: bool) -> Result<(Duration, Vec<[u32; 2]>), Failure> {
        let uniforms = TraceRaysUniforms { ray_count: self.count, top_root: self.top_root, padding0: 0, padding1: 0 };
        let mut graph = self.gpu.graph("rays");
        self.scene
            .bind(graph.pass(&self.kernel))
            .uniform("batch", bytemuck::bytes_of(&uniforms))
            .read("rays", &self.rays)
            .read_write("hits", &self.hits)
            .dispatch([self.count.div_ceil(64), 1, 1])?;
        let ticket = reads_hits.then(|| graph.read_back(&self.hits, 0..8 * u64::from(self.count))).transpose()?;
        let mut report = graph.submit()?.wait()?;
        let time = Duration::from_secs_f64(report.gpu_ms() / 1000.0);
        let hits = ticket.map(|ticket| report.take(ticket)).transpose()?;
        Ok((time, hits.map(|bytes| bytemuck::pod_collect_to_vec(&bytes)).unwrap_or_default()))
    }
}

/// Traces all rays once on every core.
fn trace_on_cpu(geometry: &SceneGeometry, rays: &[Ray]) -> Vec<Option<Hit>> {
    rays.par_iter()
        .with_min_len(256)
        .map(|[start, direction]| closest_hit(geometry, start.truncate(), direction.truncate(), 0.0, start.w))
        .collect()
}

/// Rays through pixel centres, in tiles of 8 by 8 so that neighbours in the batch are neighbours in the image.
fn camera_rays(scene: &Scene, [width, height]: [u32; 2]) -> Vec<Ray> {
    let camera = scene.cameras[0].camera;
    let (right, up, forward) = camera.frame();
    let origin = (camera.position - scene.origin).as_vec3();
    let half_height = (camera.vfov * 0.5).tan();
    let half_width = half_height * f64::from(width) / f64::from(height);
    let mut rays = Vec::with_capacity((width * height) as usize);
    for tile_y in 0..height / TILE {
        for tile_x in 0..width / TILE {
            for pixel in 0..TILE * TILE {
                let x = (f64::from(tile_x * TILE + pixel % TILE) + 0.5) / f64::from(width) * 2.0 - 1.0;
                let y = 1.0 - (f64::from(tile_y * TILE + pixel / TILE) + 0.5) / f64::from(height) * 2.0;
                let direction = (forward + right * (x * half_width) + up * (y * half_height)).as_vec3();
                rays.push([origin.extend(f32::MAX), direction.normalize_or(Vec3::Z).extend(0.0)]);
            }
        }
    }
    rays
}

/// One cosine-distributed ray from each hit of the camera rays.
fn cosine_rays(scene: &Scene, rays: &[Ray], hits: &[Option<Hit>]) -> Vec<Ray> {
    let radius = scene.bounds.radius();
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = move || {
        // SplitMix64 (Steele, Lea and Flood 2014).
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1 << 24) as f32
    };
    let mut found = Vec::new();
    for ([start, direction], hit) in rays.iter().zip(hits) {
        let Some(hit) = hit else { continue };
        let (origin, direction) = (start.truncate(), direction.truncate());
        let normal = facing_normal(&scene.geometry, hit, direction);
        let (radius_squared, angle) = (random(), random() * std::f32::consts::TAU);
        let (tangent, bitangent) = normal.any_orthonormal_pair();
        let wi = tangent * (radius_squared.sqrt() * angle.cos())
            + bitangent * (radius_squared.sqrt() * angle.sin())
            + normal * (1.0 - radius_squared).sqrt();
        found.push([(origin + direction * hit.t + normal * (1e-5 * radius)).extend(f32::MAX), wi.extend(0.0)]);
    }
    found
}

/// Both sides must find the same hits. Ties at shared edges may differ, and so may hits within rounding of the
/// origin: in a corner, rounding decides on which side of the other wall a ray starts.
fn check_agreement(cpu: &[Option<Hit>], gpu: &[[u32; 2]], radius: f32) -> Result<(), Failure> {
    let rounding = 4e-6 * radius;
    let differs = |(cpu, gpu): (&Option<Hit>, &[u32; 2])| {
        let cpu = cpu.as_ref().map_or(f32::INFINITY, |hit| hit.t);
        let gpu = if gpu[1] == NO_HIT { f32::INFINITY } else { f32::from_bits(gpu[0]) };
        let is_same = cpu == gpu || (cpu - gpu).abs() <= 1e-3 * cpu.abs();
        !is_same && cpu.min(gpu) > rounding
    };
    let count = cpu.iter().zip(gpu).filter(|pair| differs(*pair)).count();
    if count * 10_000 > cpu.len() {
        let total = cpu.len();
        return Err(Failure::runtime(format!("{count} of {total} rays hit something else on the GPU")));
    }
    Ok(())
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Traces `count` rays repeatedly and returns million rays a second, from the median time of a round.
fn race(count: usize, mut once: impl FnMut() -> Result<Duration, Failure>) -> Result<f64, Failure> {
    let warm_up = Instant::now();
    while warm_up.elapsed() < WARM_UP {
        once()?;
    }
    let started = Instant::now();
    let mut seconds = Vec::new();
    while seconds.len() < LEAST_ROUNDS || started.elapsed() < MEASURED {
        seconds.push(once()?.as_secs_f64());
    }
    Ok(count as f64 / median(seconds) / 1e6)
}

/// Both kinds of rays in a scene.
fn measure_scene(gpu: &Gpu, origin: &Origin, scene: &Scene, size: [u32; 2]) -> Result<Vec<Row>, Failure> {
    let name = &scene.name;
    let camera = camera_rays(scene, size);
    let camera_hits = trace_on_cpu(&scene.geometry, &camera);
    let cosine = cosine_rays(scene, &camera, &camera_hits);
    if cosine.is_empty() {
        return Err(Failure::runtime(format!("the first camera of {name} sees nothing")));
    }
    let mut rows = Vec::new();
    for (kind, rays) in [("camera", camera), ("cosine", cosine)] {
        let tracer = Tracer::new(gpu, scene, &rays)?;
        check_agreement(&trace_on_cpu(&scene.geometry, &rays), &tracer.trace(true)?.1, scene.bounds.radius())?;
        let on_gpu = race(rays.len(), || Ok(tracer.trace(false)?.0))?;
        let on_cpu = race(rays.len(), || {
            let start = Instant::now();
            std::hint::black_box(trace_on_cpu(&scene.geometry, &rays));
            Ok(start.elapsed())
        })?;
        let key = Key { scene: name.clone(), kind: kind.to_owned(), size };
        let triangles = scene.geometry.bvh_triangles.len();
        rows.push(Row { key, origin: origin.clone(), triangles, on_gpu, on_cpu });
    }
    Ok(rows)
}

pub(crate) fn run(args: &RaysArgs) -> Result<(), Failure> {
    let size = args.size.map(|side| side.next_multiple_of(TILE));
    let mut record = args.output.record::<Row>(PAGE.name)?;
    let gpu = args.output.gpu()?;
    let origin = Origin::of(&gpu);
    let mut scenes = scene_file::load_demos()?;
    if let Some(shared) = shared_folder(Path::new("..")) {
        for name in SHARED_SCENES {
            scenes.push(Arc::new(scene_file::load(&shared.join(format!("scenes/{name}.glb")), None, None)?));
        }
    }
    let mut rows = Vec::new();
    for scene in scenes {
        let keys = ["camera", "cosine"].map(|kind| Key { scene: scene.name.clone(), kind: kind.to_owned(), size });
        if keys.iter().any(|key| record.find(key, &origin).is_none()) {
            for row in measure_scene(&gpu, &origin, &scene, size)? {
                record.add(row)?;
            }
        }
        rows.extend(keys.iter().filter_map(|key| record.find(key, &origin)).cloned());
    }
    args.output.publish(&PAGE, &[(PAGE.name, markdown(&rows))])
}

fn markdown(rows: &[Row]) -> String {
    let mut table = Table::new(["scene", "rays", "triangles", "GPU, Mrays/s", "CPU, Mrays/s", "ratio"]);
    for Row { key, triangles, on_gpu, on_cpu, .. } in rows {
        table.push([
            key.scene.clone(),
            key.kind.clone(),
            triangles.to_string(),
            format!("{on_gpu:.2}"),
            format!("{on_cpu:.2}"),
            format!("{:.2}", on_gpu / on_cpu),
        ]);
    }
    let size = rows.first().map(|row| format!("{} x {} rays from the camera", row.key.size[0], row.key.size[1]));
    describe(rows.iter().map(|row| &row.origin), &size.into_iter().collect::<Vec<_>>()) + &table.markdown()
}
