//! Rays per second on the GPU and by the plain CPU traversal, over the same hierarchy and the same rays.
//!
//! The ratio says how much of the machine the kernel uses where the GPU is a software one; on a real GPU it says what the
//! GPU is worth.

use std::fmt::Write as _;
use std::path::Path;
use std::time::{Duration, Instant};

use clap::Args;
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use surfelcast::args::DeviceArgs;
use surfelcast::{Failure, scene_file};
use surfelcast_gpu::{Buffer, Gpu, Kernel, MemoryKind};
use surfelcast_measure::shared_folder;
use surfelcast_scene::trace::{Hit, closest_hit};
use surfelcast_scene::{Scene, SceneGeometry};
use surfelcast_shaders::Features;
use surfelcast_techniques::SceneBuffers;

use crate::report::{TableArgs, device_name, open_gpu};

/// Pixels of the picture whose camera rays are traced: whole tiles of 8 by 8.
const SIZE: [u32; 2] = [1280, 720];
/// Time of each race before it is measured, time that is measured, and rounds at least.
const WARM_UP: Duration = Duration::from_secs(1);
const MEASURED: Duration = Duration::from_secs(4);
const LEAST_ROUNDS: usize = 10;
/// Scenes next to the references, where there are any.
const SHARED_SCENES: [&str; 2] = ["terrain", "sponza"];
/// Name of the markers.
const NAME: &str = "rays";
const KERNEL: &str = include_str!("trace_rays.wesl");
const NO_HIT: u32 = u32::MAX;

#[derive(Debug, Args)]
pub(crate) struct RaysArgs {
    #[command(flatten)]
    table: TableArgs,
    #[command(flatten)]
    device: DeviceArgs,
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
        let first_root = scene.geometry.instances.first().map_or(0, |instance| instance.root_node);
        let buffer = gpu.buffer("rays", MemoryKind::Scene, size_of_val(rays) as u64)?;
        gpu.upload(&buffer, 0, bytemuck::cast_slice(rays))?;
        Ok(Self {
            gpu: gpu.clone(),
            kernel: gpu.kernel_from_source("trace_rays", KERNEL, features)?,
            scene: SceneBuffers::new(gpu, scene)?,
            top_root: if has_instances { scene.geometry.top_root } else { first_root },
            rays: buffer,
            hits: gpu.buffer("hits", MemoryKind::Scene, 8 * rays.len() as u64)?,
            count: rays.len() as u32,
        })
    }

    /// Traces all rays once; returns the time of the pass and, if asked for, distance and triangle of each ray.
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

/// Corners of the triangle that was hit, in scene space.
fn corners(geometry: &SceneGeometry, hit: &Hit) -> [Vec3; 3] {
    let triangle = &geometry.bvh_triangles[hit.bvh_triangle as usize];
    let rows = geometry.instances[hit.instance as usize].scene_from_object.map(Vec4::from);
    [triangle.v0, triangle.v1, triangle.v2].map(|corner| {
        let corner = Vec3::from(corner);
        if geometry.baked_instance == Some(hit.instance) {
            corner
        } else {
            Vec3::from_array(rows.map(|row| row.dot(corner.extend(1.0))))
        }
    })
}

/// Rays through pixel centres, in tiles of 8 by 8 so that neighbours in the batch are neighbours in the picture.
fn camera_rays(scene: &Scene) -> Vec<Ray> {
    let camera = scene.cameras[0].camera;
    let (right, up, forward) = camera.frame();
    let origin = (camera.position - scene.origin).as_vec3();
    let half_height = (camera.vfov * 0.5).tan();
    let half_width = half_height * f64::from(SIZE[0]) / f64::from(SIZE[1]);
    let mut rays = Vec::with_capacity((SIZE[0] * SIZE[1]) as usize);
    for tile_y in 0..SIZE[1] / 8 {
        for tile_x in 0..SIZE[0] / 8 {
            for pixel in 0..64 {
                let x = (f64::from(tile_x * 8 + pixel % 8) + 0.5) / f64::from(SIZE[0]) * 2.0 - 1.0;
                let y = 1.0 - (f64::from(tile_y * 8 + pixel / 8) + 0.5) / f64::from(SIZE[1]) * 2.0;
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
        let [v0, v1, v2] = corners(&scene.geometry, hit);
        let (origin, direction) = (start.truncate(), direction.truncate());
        let normal = (v1 - v0).cross(v2 - v0).normalize_or(-direction);
        let normal = if normal.dot(direction) > 0.0 { -normal } else { normal };
        let (radius_squared, angle) = (random(), random() * std::f32::consts::TAU);
        let (tangent, bitangent) = normal.any_orthonormal_pair();
        let wi = tangent * (radius_squared.sqrt() * angle.cos())
            + bitangent * (radius_squared.sqrt() * angle.sin())
            + normal * (1.0 - radius_squared).sqrt();
        found.push([(origin + direction * hit.t + normal * (1e-5 * radius)).extend(f32::MAX), wi.extend(0.0)]);
    }
    found
}

/// Both sides must agree, or the race is not the same race. Ties at shared edges may fall either way, and so may a wall that
/// a ray starts on within rounding: in a corner, the side of the other wall on which the origin lies is chance.
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

/// Runs a race of `count` rays and returns million rays a second, from the median time over its rounds.
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

fn run_scene(gpu: &Gpu, name: &str, scene: &Scene) -> Result<String, Failure> {
    let camera = camera_rays(scene);
    let camera_hits = trace_on_cpu(&scene.geometry, &camera);
    let cosine = cosine_rays(scene, &camera, &camera_hits);
    if cosine.is_empty() {
        return Err(Failure::runtime(format!("the first camera of {name} sees nothing")));
    }
    let mut rows = String::new();
    for (kind, rays) in [("camera", camera), ("cosine", cosine)] {
        let tracer = Tracer::new(gpu, scene, &rays)?;
        check_agreement(&trace_on_cpu(&scene.geometry, &rays), &tracer.trace(true)?.1, scene.bounds.radius())?;
        let on_gpu = race(rays.len(), || Ok(tracer.trace(false)?.0))?;
        let on_cpu = race(rays.len(), || {
            let start = Instant::now();
            std::hint::black_box(trace_on_cpu(&scene.geometry, &rays));
            Ok(start.elapsed())
        })?;
        // Writing to a string cannot fail.
        let _ = writeln!(
            rows,
            "| {name} | {kind} | {} | {on_gpu:.2} | {on_cpu:.2} | {:.2} |",
            scene.geometry.bvh_triangles.len(),
            on_gpu / on_cpu
        );
    }
    Ok(rows)
}

pub(crate) fn run(args: &RaysArgs) -> Result<(), Failure> {
    args.table.check(NAME)?;
    let gpu = open_gpu(&args.device)?;
    let mut table = format!(
        "{}\n\n| scene | rays | triangles | GPU, Mrays/s | CPU, Mrays/s | ratio |\n|---|---|---|---|---|---|\n",
        device_name(&gpu)
    );
    for scene in scene_file::load_demos()? {
        table += &run_scene(&gpu, &scene.name, &scene)?;
    }
    if let Some(shared) = shared_folder(Path::new("..")) {
        for name in SHARED_SCENES {
            let scene = scene_file::load(&shared.join(format!("scenes/{name}.glb")), None, None)?;
            table += &run_scene(&gpu, name, &scene)?;
        }
    }
    args.table.publish(NAME, &table)
}
