//! `surfelcast render`: one picture of one scene file.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use surfelcast::args::Materials;
use surfelcast::device::{renderer_config, wait_until_ready};
use surfelcast::{Failure, scene_file};
use surfelcast_renderer::{Aov, MaterialMode, RenderJob, RenderOutput, RendererHandle, StopRules, SurfelSettings};
use surfelcast_scene::{NamedCamera, Scene};
use surfelcast_stream::{Codec, Quality, encode, encode_exr, tone_map_to_rgba8};
use surfelcast_techniques::{Reconstruction, registry};

use crate::cli::RenderArgs;
use crate::ply;
use crate::progress::Progress;
use crate::stats::{Stats, TimeStats};

/// Picture size where neither the command line nor the camera states one.
const DEFAULT_SIZE: [u32; 2] = [1280, 720];
/// Samples where no stop rule is given.
const DEFAULT_SAMPLES: u32 = 256;
/// Quality of lossy formats.
const QUALITY: u8 = 92;

/// Formats that can be written.
#[derive(Clone, Copy)]
enum Format {
    Display(Codec, Quality),
    Exr,
}

pub(crate) fn run(args: &RenderArgs) -> Result<(), Failure> {
    let format = format_of(&args.output)?;
    check_surfel_options(args)?;
    let progress = Progress::new();
    progress.say("reading");
    let scene = Arc::new(scene_file::load(&args.scene, args.view.as_ref(), args.environment.as_ref())?);
    warn_all(&scene);
    let camera = scene_file::camera_of(&scene, args.camera.as_deref())?.clone();
    let exposure = args.exposure.unwrap_or_else(|| scene.exposure_for(&camera.name));
    let job = job_of(args, &scene, &camera, exposure);

    progress.say("opening the device");
    let (renderer, thread) = surfelcast_renderer::start(renderer_config(&args.device))
        .map_err(|error| Failure::runtime(format!("the render thread could not be started: {error}")))?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| Failure::runtime(format!("the runtime could not be started: {error}")))?;
    let result = runtime.block_on(async {
        let status = wait_until_ready(&renderer).await?;
        let output = render(&renderer, job, &progress).await;
        renderer.stop().await;
        output.map(|output| (status, output))
    });
    progress.finish();
    let (status, output) = result?;
    if thread.join().is_err() {
        return Err(Failure::runtime("the render thread ended in a panic; please report this"));
    }

    let encode_started = Instant::now();
    let bytes = encode_output(&output, format, exposure, args.aov.is_some())?;
    write(&args.output, &bytes)?;
    if let Some(path) = &args.export_surfels {
        write(path, &ply::encode(&output.exported_surfels, scene.origin))?;
    }
    if let Some(path) = &args.stats {
        let time_secs = TimeStats {
            load: scene.load_secs,
            build: scene.build_secs,
            setup: output.setup_secs,
            render: output.render_secs,
            encode: encode_started.elapsed().as_secs_f64(),
        };
        let stats = Stats::new(&status.device, &scene, &args.technique, args.seed, &output, time_secs);
        let json = serde_json::to_vec_pretty(&stats).map_err(|error| Failure::runtime(error.to_string()))?;
        write(path, &json)?;
    }
    Ok(())
}

async fn render(renderer: &RendererHandle, job: RenderJob, progress: &Progress) -> Result<RenderOutput, Failure> {
    let ticket = renderer.render(job)?;
    let mut updates = ticket.progress;
    let mut result = ticket.result;
    let interrupt = tokio::signal::ctrl_c();
    tokio::pin!(interrupt);
    let mut is_interrupted = false;
    let mut has_updates = true;
    loop {
        tokio::select! {
            done = &mut result => {
                return Ok(done.map_err(|_| Failure::runtime("the render thread ended early"))??);
            }
            changed = updates.changed(), if has_updates => {
                has_updates = changed.is_ok();
                progress.show(&updates.borrow());
            }
            // The first interrupt keeps what there is; the shell's next one ends the program.
            _ = &mut interrupt, if !is_interrupted => {
                is_interrupted = true;
                let _ = ticket.cancel.send(true);
            }
        }
    }
}

/// What only techniques with surfels heed is refused for the others: a picture that ignores it would mislead.
fn check_surfel_options(args: &RenderArgs) -> Result<(), Failure> {
    if registry::by_id(&args.technique).is_some_and(|entry| entry.uses_surfels) {
        return Ok(());
    }
    let option = match (&args.reconstruction, &args.preset, args.knobs.first()) {
        (Some(name), ..) if name != "none" => format!("--reconstruction {name}"),
        (_, Some(name), _) => format!("--preset {name}"),
        (.., Some(knob)) => format!("--surfel {knob}"),
        _ if args.export_surfels.is_some() => "--export-surfels".to_owned(),
        _ => return Ok(()),
    };
    Err(Failure::input(format!(
        "{option}: technique {} has no surfels; ask for one with --technique surfel",
        args.technique
    )))
}

fn job_of(args: &RenderArgs, scene: &Arc<Scene>, camera: &NamedCamera, exposure: f32) -> RenderJob {
    let mut surfel = args.preset.as_deref().and_then(SurfelSettings::by_name).unwrap_or_default();
    if let Some(name) = &args.reconstruction {
        surfel.reconstruction = Reconstruction::by_name(name).unwrap_or_default();
    }
    for knob in &args.knobs {
        // Checked when the command line was read.
        let _ = surfel.turn(knob);
    }
    let has_rule = args.spp.is_some() || args.max_error.is_some() || args.time_limit.is_some();
    RenderJob {
        scene: Arc::clone(scene),
        lights: None,
        camera: camera.camera,
        size: args.size.or(camera.resolution).unwrap_or(DEFAULT_SIZE),
        technique: args.technique.clone(),
        materials: match args.materials {
            Materials::Pbr => MaterialMode::Pbr,
            Materials::Lambert => MaterialMode::Lambert,
        },
        surfel,
        seed: args.seed,
        stop: StopRules {
            samples: args.spp.or((!has_rule).then_some(DEFAULT_SAMPLES)),
            max_error: args.max_error,
            time_limit: args.time_limit.map(Duration::from_secs_f64),
        },
        exposure,
        aov: args.aov.as_deref().and_then(Aov::by_name),
        exports_surfels: args.export_surfels.is_some(),
    }
}

fn format_of(path: &Path) -> Result<Format, Failure> {
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or("").to_ascii_lowercase();
    match ending.as_str() {
        "png" => Ok(Format::Display(Codec::Png, Quality::Lossless)),
        "jpg" | "jpeg" => Ok(Format::Display(Codec::Jpeg, Quality::Lossy(QUALITY))),
        "webp" => Ok(Format::Display(Codec::Webp, Quality::Lossy(QUALITY))),
        "exr" => Ok(Format::Exr),
        _ => Err(Failure::input(format!("--output {}: the ending must be png, jpg, webp or exr", path.display()))),
    }
}

fn encode_output(output: &RenderOutput, format: Format, exposure: f32, is_aov: bool) -> Result<Vec<u8>, Failure> {
    let failed = |error: surfelcast_stream::StreamError| Failure::runtime(error.to_string());
    match format {
        Format::Exr => encode_exr(&output.pixels, output.size).map_err(failed),
        Format::Display(codec, quality) => {
            // Exposure belongs to radiance; other outputs are shown as they are.
            let factor = if is_aov { 1.0 } else { exposure };
            encode(&tone_map_to_rgba8(&output.pixels, factor), output.size, codec, quality).map_err(failed)
        }
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    std::fs::write(path, bytes)
        .map_err(|error| Failure::runtime(format!("{} could not be written: {error}", path.display())))
}

#[allow(clippy::print_stderr, reason = "warnings of the import are for the user")]
fn warn_all(scene: &Scene) {
    for warning in &scene.warnings {
        eprintln!("warning: {warning}");
    }
}
