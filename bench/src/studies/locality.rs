//! Distance in memory between the surfels of neighbouring pixels, for each way to place a cache's first surfels: what
//! figure 5.4 of Noack 2022 shows as an image of ids.

use std::collections::BTreeSet;

use clap::Args;
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use surfelcast::{Failure, scene_file};
use surfelcast_gpu::Gpu;
use surfelcast_passes::step::StepBudget;
use surfelcast_scene::{Camera, Scene};
use surfelcast_techniques::surfel::{Initial, SurfelOutput, SurfelSettings, cache_of};
use surfelcast_techniques::technique::TechniqueOptions;
use surfelcast_techniques::{
    Change, FrameView, LightBuffers, LightState, MaterialMode, SceneBuffers, SessionState, registry,
};

use crate::report::{Measured, Origin, OutputArgs, Page, Table, describe};
use crate::stage::read_pixels;

pub(super) const PAGE: Page = Page { name: "locality", template: include_str!("../../pages/locality.md.in") };

const SIZE: [u32; 2] = [320, 240];
/// Side of a tile in pixels: that of a workgroup, which reads its surfels together.
const TILE: u32 = 8;
/// Surfels in 128 bytes, a line of a GPU's cache.
const LINE_IDS: u32 = 4;
/// Frames of a rotation in place after which locality is measured again, and its degrees per frame.
const WALK_FRAMES: u32 = 12;
const WALK_DEGREES: f64 = 30.0;
const WAYS: [(&str, Initial); 3] =
    [("gaps", Initial::Gaps), ("Fibonacci sphere", Initial::Fibonacci), ("Hilbert curve", Initial::Hilbert)];

#[derive(Debug, Args)]
pub(crate) struct LocalityArgs {
    #[command(flatten)]
    output: OutputArgs,
}

/// One scene with one way to place the first surfels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Row {
    key: Key,
    origin: Origin,
    /// Surfels placed that way, and all after the first frame.
    surfels: [u32; 2],
    /// Of those alone, of all after the first frame, and of all after a turn.
    localities: [Locality; 3],
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Key {
    scene: String,
    placement: String,
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
        let mut table = Table::new([
            "scene",
            "placement",
            "placed",
            "surfels",
            "placed_distance",
            "placed_lines",
            "all_distance",
            "all_lines",
            "turned_distance",
            "turned_lines",
            "commit",
            "device",
        ]);
        for Row { key, origin, surfels, localities } in rows {
            let numbers = localities.iter().flat_map(|one| [one.distance.to_string(), format!("{:.4}", one.lines)]);
            let head = [key.scene.clone(), key.placement.clone()].into_iter().chain(surfels.map(|n| n.to_string()));
            table.push(head.chain(numbers).chain([origin.commit.clone(), origin.device.clone()]));
        }
        table
    }
}

/// Locality of the surfels that an image shows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Locality {
    /// Pairs of neighbouring pixels that show different surfels.
    pairs: usize,
    /// Median difference of ids over these pairs.
    distance: u32,
    /// Cache lines per surfel that a tile shows: 1 if no two share a line, 0.25 at best.
    lines: f64,
}

/// `ids` are those of the surfels with the largest weight plus one, 0 where there is none. Those from `end` on are
/// left out.
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
        settings: SurfelSettings { initial, ..SurfelSettings::default() }.into(),
    };
    let entry = registry::by_id("surfel").ok_or_else(|| Failure::runtime("there is no technique surfel"))?;
    let mut picture = entry.start(gpu, &buffers, &lights, &session, options)?;
    let mut frame = |camera: Camera| -> Result<([u32; 2], Vec<u32>), Failure> {
        let view = FrameView { camera, size: SIZE, exposure: 1.0 };
        picture.invalidate(Change::Camera);
        while picture.samples() < 1 {
            let budget = StepBudget { max_paths: u64::MAX, until_samples: 1, max_batch: 1 };
            picture.step(gpu, &buffers, &lights, &view, budget)?;
        }
        let cache = cache_of(&session).ok_or_else(|| Failure::runtime("the technique has no cache"))?;
        let (look, _) =
            cache.lock().look(gpu, &buffers, &lights, &view, picture.features(), SurfelOutput::Id, false)?;
        let pixels = read_pixels(gpu, &look)?;
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
    let mut record = args.output.record::<Row>(PAGE.name)?;
    let gpu = args.output.gpu()?;
    let origin = Origin::of(&gpu);
    let mut rows = Vec::new();
    for scene in scene_file::load_demos()? {
        let camera = scene_file::camera_of(&scene, None)?.camera;
        for (placement, initial) in WAYS {
            let key = Key { scene: scene.name.clone(), placement: placement.to_owned() };
            let row = record.find_or_measure(&key, &origin, || {
                let (surfels, localities) = measure(&gpu, &scene, camera, initial)?;
                Ok(Row { key: key.clone(), origin: origin.clone(), surfels, localities })
            })?;
            rows.push(row.clone());
        }
    }
    args.output.publish(&PAGE, &[(PAGE.name, markdown(&rows))])
}

fn markdown(rows: &[Row]) -> String {
    let mut table = Table::new([
        "scene",
        "first surfels",
        "placed so, of all",
        "distance",
        "lines",
        "all: distance",
        "lines",
        "after a turn: distance",
        "lines",
    ]);
    for Row { key, surfels: [seeded, surfels], localities: [alone, all, turned], .. } in rows {
        // Few pairs have no meaningful median.
        let cells = |one: &Locality| [one.distance.to_string(), format!("{:.2}", one.lines)];
        let head = [key.scene.clone(), key.placement.clone(), format!("{seeded} of {surfels}")];
        let alone = if alone.pairs > 100 { cells(alone) } else { ["-", "-"].map(str::to_owned) };
        table.push(head.into_iter().chain(alone).chain(cells(all)).chain(cells(turned)));
    }
    describe(rows.iter().map(|row| &row.origin), &[]) + &table.markdown()
}
