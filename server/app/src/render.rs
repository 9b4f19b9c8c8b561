//! `surfelcast render`: one picture of one scene file.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use surfelcast::args::LIMITS;
use surfelcast::cli::RenderArgs;
use surfelcast::device::{renderer_config, wait_until_ready};
use surfelcast::{Failure, scene_file};
use surfelcast_render_api::{Catalogue, Fault, RenderRequest, RenderSpec, SceneDefaults};
use surfelcast_renderer::{RenderJob, RenderOutput, RendererHandle};
use surfelcast_scene::Scene;
use surfelcast_stream::{Codec, Quality, encode, encode_exr, tone_map_to_rgba8};

use crate::progress::Progress;
use crate::stats::{Stats, TimeStats};

/// Quality of lossy formats.
const QUALITY: u8 = 92;

/// Formats that can be written.
#[derive(Clone, Copy)]
enum Format {
    Display(Codec, Quality),
    Exr,
}

pub(crate) fn run(args: &RenderArgs, catalogue: &Catalogue) -> Result<(), Failure> {
    let format = format_of(&args.output)?;
    let refused = |fault: Fault| refusal(args, &fault);
    let request = request_of(args, catalogue).map_err(refused)?;
    request.check(catalogue, &LIMITS).map_err(refused)?;
    check_export(args, catalogue)?;
    let progress = Progress::new();
    progress.say("reading");
    let scene = Arc::new(scene_file::load(&args.scene, args.view.as_ref(), args.environment.as_ref())?);
    warn_all(&scene);
    let spec = request.resolve(catalogue, &SceneDefaults::of(&scene), &LIMITS).map_err(refused)?;
    let job = RenderJob { scene: Arc::clone(&scene), lights: None, spec: spec.clone(), exports: args.export.is_some() };

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
    let bytes = encode_output(&output, format, &spec)?;
    write(&args.output, &bytes)?;
    if let Some(path) = &args.export {
        let bytes = output.export.as_deref();
        write(path, bytes.ok_or_else(|| Failure::runtime("--export: the technique had nothing to export"))?)?;
    }
    if let Some(path) = &args.stats {
        let time_secs = TimeStats {
            load: scene.load_secs,
            build: scene.build_secs,
            setup: output.setup_secs,
            render: output.render_secs,
            encode: encode_started.elapsed().as_secs_f64(),
        };
        let stats = Stats::new(&status.device, &scene, &spec, &output, time_secs);
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

/// The command line as a request.
fn request_of(args: &RenderArgs, catalogue: &Catalogue) -> Result<RenderRequest, Fault> {
    let technique = args.technique.as_deref().and_then(|id| catalogue.choose(id)).map(|chosen| chosen.technique);
    let mut settings = BTreeMap::new();
    for assignment in &args.settings {
        let Some((id, text)) = assignment.split_once('=') else {
            return Err(Fault::malformed(assignment, "expected NAME=VALUE").inside("settings"));
        };
        // One that the technique lacks is refused by the request, which knows who has it.
        let value = match technique.and_then(|technique| technique.setting(id.trim())) {
            Some(setting) => setting.parse(text).map_err(|fault| fault.inside("settings"))?.into(),
            None => text.into(),
        };
        settings.insert(id.trim().to_owned(), value);
    }
    let [width, height] = args.size.map_or([None, None], |size| size.map(|side| Some(side.into())));
    Ok(RenderRequest {
        camera_name: args.camera.clone(),
        width,
        height,
        technique: args.technique.clone(),
        preset: args.preset.clone(),
        settings: Some(settings),
        reconstruction: args.reconstruction.clone(),
        samples_per_pixel: args.spp.map(Into::into),
        max_error: args.max_error.map(f64::from),
        time_limit_secs: args.time_limit,
        seed: Some(args.seed.into()),
        materials: Some(args.materials.name().to_owned()),
        exposure: args.exposure.map(f64::from),
        aov: args.aov.clone(),
        ..RenderRequest::default()
    })
}

/// A fault of the request in terms of the command line.
fn refusal(args: &RenderArgs, fault: &Fault) -> Failure {
    let option = |name: &str, value: &Option<String>| match value {
        Some(value) => format!("{name} {value}"),
        None => name.to_owned(),
    };
    let option = match fault.field.as_str() {
        "camera_name" => option("--camera", &args.camera),
        "technique" => option("--technique", &args.technique),
        "preset" => option("--preset", &args.preset),
        "reconstruction" => option("--reconstruction", &args.reconstruction),
        "aov" => option("--aov", &args.aov),
        "max_error" => "--max-error".to_owned(),
        "time_limit_secs" => "--time-limit".to_owned(),
        "samples_per_pixel" => "--spp".to_owned(),
        "width" | "height" | "width x height" => "--size".to_owned(),
        field => match field.strip_prefix("settings.") {
            Some(id) => {
                let is_it = |text: &&String| text.split('=').next().is_some_and(|name| name.trim() == id);
                option("--set", &args.settings.iter().find(is_it).cloned())
            }
            None => format!("--{field}"),
        },
    };
    Failure::input(format!("{option}: {}", fault.reason))
}

/// An export is refused where the technique has none.
fn check_export(args: &RenderArgs, catalogue: &Catalogue) -> Result<(), Failure> {
    let Some(chosen) = args.technique.as_deref().and_then(|id| catalogue.choose(id)) else { return Ok(()) };
    if args.export.is_none() || chosen.technique.export.is_some() {
        return Ok(());
    }
    let others = catalogue.ids_where(|technique| technique.export.is_some());
    Err(Failure::input(format!(
        "--export: technique {} exports nothing; leave it out, or take a technique that does: {others}",
        chosen.technique.id
    )))
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

fn encode_output(output: &RenderOutput, format: Format, spec: &RenderSpec) -> Result<Vec<u8>, Failure> {
    let failed = |error: surfelcast_stream::StreamError| Failure::runtime(error.to_string());
    match format {
        Format::Exr => encode_exr(&output.pixels, output.size).map_err(failed),
        Format::Display(codec, quality) => {
            // Exposure belongs to radiance; other outputs are shown as they are.
            let factor = if spec.aov.is_some() { 1.0 } else { spec.exposure };
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
