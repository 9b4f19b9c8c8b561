//! Frames of the surfel cache in motion, as contact sheets: what a user sees, frame by frame.
//!
//! `strip-start.jpg` (from an empty cache), `strip-orbit.jpg` (the camera moves in every frame), `strip-switch.jpg`
//! (all lamps dim to a fifth and come back) and `strip-lamp.jpg` (a lamp moves in every frame) are each read row by
//! row.

use std::path::{Path, PathBuf};

use clap::Args;
use glam::{DVec3, Vec3};
use surfelcast::args::DeviceArgs;
use surfelcast::{Failure, scene_file};
use surfelcast_gpu::Gpu;
use surfelcast_render_api::Settings;
use surfelcast_renderer::Throughput;
use surfelcast_renderer::progressive::{MAX_JOB_BATCH, Progressive, SceneOnDevice, Until};
use surfelcast_scene::{Camera, PunctualKind, PunctualLight, Scene};
use surfelcast_stream::{Codec, Quality, encode, tone_map_to_rgba8};
use surfelcast_techniques::technique::TechniqueOptions;
use surfelcast_techniques::{
    Change, FrameView, LightBuffers, LightState, MaterialMode, SceneBuffers, SessionState, registry,
};

use crate::report::{open_gpu, write_file};
use crate::stage::read_pixels;

const SCENE: &str = "demo:interior";
const SIZE: [u32; 2] = [320, 200];
const COLUMNS: usize = 4;
const FRAMES: usize = 16;
const QUALITY: u8 = 85;

#[derive(Debug, Args)]
pub(crate) struct StripsArgs {
    /// Folder for the contact sheets.
    folder: PathBuf,
    #[command(flatten)]
    device: DeviceArgs,
}

struct Stage<'a> {
    gpu: &'a Gpu,
    scene: &'a Scene,
    buffers: SceneBuffers,
    lights: LightBuffers,
    session: SessionState,
    progressive: Progressive,
}

impl<'a> Stage<'a> {
    fn new(gpu: &'a Gpu, scene: &'a Scene, state: &LightState) -> Result<Self, Failure> {
        let buffers = SceneBuffers::new(gpu, scene)?;
        let lights = LightBuffers::new(gpu, scene, state)?;
        let session = SessionState::default();
        let options = TechniqueOptions {
            size: SIZE,
            full_size: SIZE,
            materials: MaterialMode::Pbr,
            is_split: false,
            seed: 0,
            waits_for_kernels: true,
            settings: Settings::default(),
        };
        let entry = registry::by_id("surfel").ok_or_else(|| Failure::runtime("there is no technique surfel"))?;
        let technique = entry.start(gpu, &buffers, &lights, &session, options)?;
        let progressive = Progressive::new(technique, Throughput::default());
        Ok(Self { gpu, scene, buffers, lights, session, progressive })
    }

    fn relight(&mut self, state: &LightState) -> Result<(), Failure> {
        self.lights = LightBuffers::new(self.gpu, self.scene, state)?;
        self.session.invalidate(Change::Lights);
        self.progressive.technique_mut().invalidate(Change::Lights);
        Ok(())
    }

    /// The image after `frames` more frames; `is_cut` restarts its accumulation.
    fn shoot(&mut self, camera: Camera, frames: u32, is_cut: bool) -> Result<Vec<[f32; 3]>, Failure> {
        if is_cut {
            self.progressive.technique_mut().invalidate(Change::Camera);
        }
        let view = FrameView { camera, size: SIZE, exposure: 1.0 };
        let on = SceneOnDevice { gpu: self.gpu, scene: &self.buffers, lights: &self.lights };
        let until = Until { samples: self.progressive.samples() + frames, max_batch: MAX_JOB_BATCH };
        while self.progressive.samples() < until.samples {
            self.progressive.advance(on, &view, until)?;
        }
        let pixels = read_pixels(self.gpu, self.progressive.technique().picture())?;
        Ok(pixels.into_iter().map(|[r, g, b, _]| [r, g, b]).collect())
    }
}

/// Images side by side, in rows.
#[allow(clippy::print_stdout, reason = "the files are the command's output")]
fn write_sheet(path: &Path, images: &[Vec<[f32; 3]>], exposure: f32) -> Result<(), Failure> {
    let [width, height] = SIZE.map(|side| side as usize);
    let rows = images.len().div_ceil(COLUMNS);
    let mut sheet = vec![[0.0f32; 3]; width * COLUMNS * height * rows];
    for (index, image) in images.iter().enumerate() {
        let (left, top) = (index % COLUMNS * width, index / COLUMNS * height);
        for (y, row) in image.chunks_exact(width).enumerate() {
            let start = (top + y) * width * COLUMNS + left;
            sheet[start..start + width].copy_from_slice(row);
        }
    }
    let size = [(width * COLUMNS) as u32, (height * rows) as u32];
    let bytes = encode(&tone_map_to_rgba8(&sheet, exposure), size, Codec::Jpeg, Quality::Lossy(QUALITY))
        .map_err(|error| Failure::runtime(error.to_string()))?;
    write_file(path, &bytes)?;
    println!("{}", path.display());
    Ok(())
}

pub(crate) fn run(args: &StripsArgs) -> Result<(), Failure> {
    let folder = &args.folder;
    let scene = scene_file::load(Path::new(SCENE), None, None)?;
    let named = scene_file::camera_of(&scene, None)?;
    let exposure = scene.exposure_for(&named.name);
    let home = named.camera;
    let own = LightState::of_scene(&scene);
    let gpu = open_gpu(&args.device)?;

    let mut stage = Stage::new(&gpu, &scene, &own)?;
    let start: Vec<_> = (0..FRAMES)
        .map(|index| stage.shoot(home, if index < 8 { 1 } else { 4 }, false))
        .collect::<Result<_, Failure>>()?;
    write_sheet(&folder.join("strip-start.jpg"), &start, exposure)?;

    let around = |index: usize| {
        let arm = home.position - home.target;
        let angle = index as f64 * 0.02;
        let turned =
            DVec3::new(arm.x * angle.cos() + arm.z * angle.sin(), arm.y, arm.z * angle.cos() - arm.x * angle.sin());
        Camera { position: home.target + turned, ..home }
    };
    let orbit: Vec<_> = (0..FRAMES).map(|index| stage.shoot(around(index), 1, true)).collect::<Result<_, Failure>>()?;
    write_sheet(&folder.join("strip-orbit.jpg"), &orbit, exposure)?;

    let dim = LightState {
        emissive_strength: 0.2,
        environment_strength: 0.2,
        punctual: own
            .punctual
            .iter()
            .map(|light| PunctualLight { intensity: light.intensity.map(|v| v * 0.2), ..light.clone() })
            .collect(),
    };
    let mut switched = Vec::new();
    for index in 0..FRAMES {
        match index {
            4 => stage.relight(&dim)?,
            10 => stage.relight(&own)?,
            _ => {}
        }
        switched.push(stage.shoot(home, 1, true)?);
    }
    write_sheet(&folder.join("strip-switch.jpg"), &switched, exposure)?;

    let mut moved = Vec::new();
    for index in 0..FRAMES {
        let mut state = own.clone();
        let ahead = (home.target - home.position).normalize_or(DVec3::NEG_Z) * 1.5;
        let at = home.position + ahead - scene.origin;
        state.punctual.push(PunctualLight {
            name: "moving".to_owned(),
            kind: PunctualKind::Point,
            position: at.as_vec3() + Vec3::new(index as f32 * 0.12 - 0.9, 0.1, 0.0),
            direction: Vec3::NEG_Y,
            intensity: [6.0, 3.0, 1.0],
            range: f32::INFINITY,
        });
        stage.relight(&state)?;
        moved.push(stage.shoot(home, 1, true)?);
    }
    write_sheet(&folder.join("strip-lamp.jpg"), &moved, exposure)?;
    Ok(())
}
