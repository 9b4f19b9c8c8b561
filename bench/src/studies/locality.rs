//! How far apart in memory the surfels of neighbouring pixels lie, for each way to place a cache's first surfels: what Noack's
//! thesis shows in figure 5.4 as a picture of ids.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use clap::Args;
use glam::{DQuat, DVec3};
use surfelcast::args::DeviceArgs;
use surfelcast::{Failure, scene_file};
use surfelcast_gpu::Gpu;
use surfelcast_passes::step::StepBudget;
use surfelcast_scene::{Camera, Scene};
use surfelcast_shaders::layout::bytemuck;
use surfelcast_techniques::surfel::Initial;
use surfelcast_techniques::technique::TechniqueOptions;
use surfelcast_techniques::{
    Change, FrameView, LightBuffers, LightState, MaterialMode, SceneBuffers, SessionState, SurfelOutput,
    SurfelSettings, registry,
};

use crate::report::{TableArgs, open_gpu};

/// Name of the markers.
const NAME: &str = "locality";
const SIZE: [u32; 2] = [320, 240];
/// Pixels of a tile's side: a workgroup's, which reads its surfels together.
const TILE: u32 = 8;
/// Ids whose `SurfelOutput` shares 128 bytes, a line of a GPU's cache.
const LINE_IDS: u32 = 4;
/// Frames of a turn on the spot after which locality is measured again, and degrees turned in each.
const WALK_FRAMES: u32 = 12;
const WALK_DEGREES: f64 = 30.0;
const WAYS: [(&str, Initial); 3] =
    [("gaps", Initial::Gaps), ("Fibonacci sphere", Initial::Fibonacci), ("Hilbert curve", Initial::Hilbert)];

#[derive(Debug, Args)]
pub(crate) struct LocalityArgs {
    #[command(flatten)]
    table: TableArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

/// What a picture's ids tell.
struct Locality {
    /// Pairs of such pixels.
    pairs: usize,
    /// Median difference of the ids of neighbouring pixels that show different surfels.
    distance: u32,
    /// Lines of memory for each surfel that a tile shows: 1 if no two lie together, 0.25 at best.
    lines: f64,
}

/// `ids` are those of the surfels with the largest weight plus one, 0 where there is none. Those from `end` on are left out.
fn locality(ids: &[u32], end: u32) -> Locality {
    let at = |x: u32, y: u32| match ids[(y * SIZE[0] + x) as usize] {
        id if id <= end => id,
        _ => 0,
    };
    let mut distances = Vec::new();
    let (mut surfels, mut lines) = (0, 0);
    for y in 0..SIZE[1] - 1 {
        for x in 0..SIZE[0] - 1 {
            for other in [at(x + 1, y), at(x, y + 1)] {
                if at(x, y) != 0 && other != 0 && other != at(x, y) {
                    distances.push(other.abs_diff(at(x, y)));
                }
            }
        }
    }
    for tile_y in 0..SIZE[1] / TILE {
        for tile_x in 0..SIZE[0] / TILE {
            let inside = (0..TILE * TILE).map(|i| at(tile_x * TILE + i % TILE, tile_y * TILE + i / TILE));
            let shown: BTreeSet<u32> = inside.filter(|&id| id != 0).map(|id| id - 1).collect();
            surfels += shown.len();
            lines += shown.iter().map(|id| id / LINE_IDS).collect::<BTreeSet<_>>().len();
        }
    }
    distances.sort_unstable();
    Locality {
        pairs: distances.len(),
        distance: distances.get(distances.len() / 2).copied().unwrap_or(0),
        lines: lines as f64 / surfels.max(1) as f64,
    }
}

/// Surfels placed by directions and all after the first frame; locality of the former, of all, and after a turn.
fn measure(gpu: &Gpu, scene: &Scene, camera: Camera, initial: Initial) -> Result<([u32; 2], [Locality; 3]), Failure> {
    let buffers = SceneBuffers::new(gpu, scene)?;
    let lights = LightBuffers::new(gpu, scene, &LightState::of_scene(scene))?;
    let session = SessionState::default();
    let options = TechniqueOptions {
        size: SIZE,
        full_size: SIZE,
        materials: MaterialMode::Pbr,
        is_split: false,
        seed: 0,
        waits_for_kernels: true,
        surfel: SurfelSettings { initial, ..SurfelSettings::default() },
    };
    let entry = registry::by_id("surfel").ok_or_else(|| Failure::runtime("there is no technique surfel"))?;
    let mut picture = (entry.create)(gpu, &buffers, &lights, &session, options)?;
    let mut frame = |camera: Camera| -> Result<([u32; 2], Vec<u32>), Failure> {
        let view = FrameView { camera, size: SIZE, exposure: 1.0 };
        picture.invalidate(Change::Camera);
        while picture.samples() < 1 {
            let budget = StepBudget { max_paths: u64::MAX, until_samples: 1, max_batch: 1 };
            picture.step(gpu, &buffers, &lights, &view, budget)?;
        }
        let cache = picture.surfel_cache().ok_or_else(|| Failure::runtime("the technique has no cache"))?;
        let (look, _) =
            cache.lock().look(gpu, &buffers, &lights, &view, picture.features(), SurfelOutput::Id, false)?;
        let mut graph = gpu.graph("surfel_locality");
        let ticket = graph.read_back(&look, 0..look.size_bytes())?;
        let pixels: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&graph.submit()?.wait()?.take(ticket)?);
        let ids: Vec<u32> = pixels.iter().map(|pixel| pixel[0] as u32).collect();
        let cache = cache.lock();
        Ok(([cache.seeded(), cache.counts()[0]], ids))
    };
    let (counts, first) = frame(camera)?;
    let mut last = Vec::new();
    for step in 1..=WALK_FRAMES {
        // All around and back to where it began.
        let turn = DQuat::from_axis_angle(DVec3::Y, (WALK_DEGREES * f64::from(step)).to_radians());
        last = frame(Camera { target: camera.position + turn * (camera.target - camera.position), ..camera })?.1;
    }
    Ok((counts, [locality(&first, counts[0]), locality(&first, u32::MAX), locality(&last, u32::MAX)]))
}

pub(crate) fn run(args: &LocalityArgs) -> Result<(), Failure> {
    args.table.check(NAME)?;
    let gpu = open_gpu(&args.device)?;
    let mut text = String::from(
        "| scene | first surfels | placed so, of all | distance | lines | all: distance | lines | after a turn: distance | lines |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    for scene in scene_file::load_demos()? {
        let camera = scene_file::camera_of(&scene, None)?.camera;
        for (name, initial) in WAYS {
            let ([seeded, surfels], [alone, all, turned]) = measure(&gpu, &scene, camera, initial)?;
            // Few pairs say nothing.
            let own =
                if alone.pairs > 100 { format!("{} | {:.2}", alone.distance, alone.lines) } else { "- | -".to_owned() };
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "| {} | {name} | {seeded} of {surfels} | {own} | {} | {:.2} | {} | {:.2} |",
                scene.name, all.distance, all.lines, turned.distance, turned.lines
            );
        }
    }
    args.table.publish(NAME, &text)
}
