//! The surfel cache against references and against path tracing at equal rays, measured with the finished program.
//!
//! The cache is measured alone: images do not settle.

use std::fmt::Write as _;

use clap::{Args, ValueEnum};
use surfelcast::Failure;
use surfelcast_measure::{MeasureError, Mode, Picture, Point, Rectangle, Reference, Renderer, error_to_truth};

use crate::report::TableArgs;
use crate::studies::references;

/// References of the gates, each with the tone-mapped RMSE it may have once converged.
const GATES: [(&str, f64); 5] = [
    ("cornell_box_main_lambert", 0.02),
    ("bars_main_lambert", 0.03),
    ("classroom_main_lambert", 0.03),
    ("maze_small_near_lambert", 0.03),
    ("sponza_atrium_lambert", 0.03),
];
/// Frames of an early picture and of a later one.
const FRAMES: [u32; 2] = [32, 64];
/// Samples a pixel of each of the two path-traced pictures whose mean is the truth of indirect light.
const TRUTH_SAMPLES: u32 = 32;
/// Pictures of indirect light alone have a truth of their own, so they need not be as large as the references: an nth as wide.
const INDIRECT_SHRINK: u32 = 3;
/// Ratio of errors from which on it is asked for again in a picture of full size.
const FULL_SIZE_RATIO: f64 = 0.4;
/// Radii in pixels whose cost and error are compared, on one reference.
const RADII: [f32; 4] = [2.0, 3.0, 5.0, 8.0];
const RADII_REFERENCE: &str = "bars_main_lambert";

/// One table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Part {
    /// The references of the gates.
    Gates,
    /// Sizes of surfels.
    Radii,
    /// Indirect light at every reference.
    Indirect,
}

impl Part {
    /// Name of the markers.
    fn name(self) -> &'static str {
        match self {
            Self::Gates => "surfels-gates",
            Self::Radii => "surfels-radii",
            Self::Indirect => "surfels-indirect",
        }
    }
}

#[derive(Debug, Args)]
pub(crate) struct SurfelsArgs {
    /// Table to measure; all by default.
    #[arg(long = "part", value_enum)]
    parts: Vec<Part>,
    /// References whose names contain this.
    #[arg(long, value_name = "NAME-PART", default_value = "")]
    only: String,
    #[command(flatten)]
    table: TableArgs,
}

pub(crate) fn run(args: &SurfelsArgs) -> Result<(), Failure> {
    let parts = if args.parts.is_empty() { Part::value_variants() } else { &args.parts };
    for part in parts {
        args.table.check(part.name())?;
    }
    let references = references()?;
    for part in parts {
        let text = match part {
            Part::Gates => against_path(&args.only, &references),
            Part::Radii => over_radii(&args.only, &references),
            Part::Indirect => indirect_light(&args.only, &references),
        };
        let text = text.map_err(|error| Failure::runtime(error.to_string()))?;
        args.table.publish(part.name(), &text)?;
    }
    Ok(())
}

/// Says that a row is measured, while the study goes on.
#[allow(clippy::print_stderr, reason = "a study says how far it is")]
fn add_row(text: &mut String, row: &str) {
    eprintln!("{row}");
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{row}");
}

fn surfel(arguments: &[&str]) -> Result<Renderer, MeasureError> {
    let mut renderer = Renderer::find("surfel")?;
    renderer.arguments = ["--surfel", "settling=0"].iter().chain(arguments).map(|&word| word.to_owned()).collect();
    Ok(renderer)
}

fn find<'a>(references: &'a [Reference], name: &str) -> Result<&'a Reference, MeasureError> {
    let found = references.iter().find(|one| one.name == name);
    found.ok_or_else(|| MeasureError::Program(format!("there is no reference {name}")))
}

/// A reference for smaller pictures. Its image is of no use any more.
fn shrunk(reference: &Reference) -> Reference {
    let by = INDIRECT_SHRINK as usize;
    let masked = reference
        .masked
        .iter()
        .map(|part| Rectangle { start: part.start.map(|at| at / by), end: part.end.map(|at| at.div_ceil(by)) });
    Reference { size: reference.size.map(|side| side / INDIRECT_SHRINK), masked: masked.collect(), ..reference.clone() }
}

/// Indirect light at every reference with Lambertian materials, against path tracing's own; whole pictures at the others.
fn indirect_light(only: &str, references: &[Reference]) -> Result<String, MeasureError> {
    let mut text = String::from(
        "| reference | light | size | 32 frames | path, equal rays | ratio |\n|---|---|---|---|---|---|\n",
    );
    for reference in references.iter().filter(|one| one.mode != Mode::Indirect && one.name.contains(only)) {
        let is_lambert = reference.mode == Mode::Lambert;
        let mut found = against_path_indirect(&if is_lambert { shrunk(reference) } else { reference.clone() })?;
        // Small pictures give small things few surfels.
        if is_lambert && found.ours > FULL_SIZE_RATIO * found.theirs {
            found = against_path_indirect(reference)?;
        }
        let Compared { size, ours, theirs, samples } = found;
        let light = if is_lambert { "indirect" } else { "all" };
        let ratio = if theirs > 1e-4 { format!("{:.2}", ours / theirs) } else { "-".to_owned() };
        let row = format!(
            "| {} | {light} | {}x{} | {ours:.4} | {theirs:.4} ({samples} spp) | {ratio} |",
            reference.name, size[0], size[1]
        );
        add_row(&mut text, &row);
    }
    Ok(text)
}

/// Errors at equal rays.
struct Compared {
    size: [u32; 2],
    ours: f64,
    theirs: f64,
    samples: u32,
}

fn against_path_indirect(reference: &Reference) -> Result<Compared, MeasureError> {
    let is_lambert = reference.mode == Mode::Lambert;
    let words: &[&str] = if is_lambert { &["--aov", "indirect"] } else { &[] };
    let mut path = Renderer::find("path")?;
    path.arguments = words.iter().map(|&word| word.to_owned()).collect();
    let (truth, noise) = if is_lambert {
        let [a, b] = [11, 12].map(|seed| path.picture(reference, TRUTH_SAMPLES, seed));
        let (a, b) = (a?.0, b?.0);
        // The mean of both has half the noise of their difference.
        let noise = a.tone_mapped_mse(&b, reference.exposure) / 4.0;
        (a.mean_with(&b), noise)
    } else {
        (Picture::read_exr(&reference.image)?, reference.noise_rmse.powi(2))
    };
    let error = |picture: Picture| error_to_truth(reference, &picture, &truth, noise);
    let (ours, rays) = surfel(words)?.picture(reference, FRAMES[0], 1)?;
    let (_, rays_each) = path.picture(reference, 1, 1)?;
    let samples = (rays / rays_each).round().max(1.0) as u32;
    let theirs = error(path.picture(reference, samples, 1)?.0);
    Ok(Compared { size: reference.size, ours: error(ours), theirs, samples })
}

/// Path tracing with as many rays as `rays`: one sample a pixel tells how many a sample takes.
fn path_at_equal_rays(reference: &Reference, rays: f64) -> Result<Point, MeasureError> {
    let path = Renderer::find("path")?;
    let one = path.measure(reference, 1)?;
    // The audit of a single sample takes rays of its own, so the count is corrected once.
    let samples = (rays / one.rays).round().max(1.0) as u32;
    path.measure(reference, samples)
}

fn against_path(only: &str, references: &[Reference]) -> Result<String, MeasureError> {
    let mut text = String::from(
        "| reference | gate | 32 frames | path, equal rays | ratio | 64 frames | audit / RMSE | bias | surfels | s a frame |\n\
         |---|---|---|---|---|---|---|---|---|---|\n",
    );
    for (name, gate) in GATES.iter().filter(|(name, _)| name.contains(only)) {
        let reference = find(references, name)?;
        let renderer = surfel(&[])?;
        let early = renderer.measure(reference, FRAMES[0])?;
        let path = path_at_equal_rays(reference, early.rays)?;
        let late = renderer.measure(reference, FRAMES[1])?;
        let noise = reference.noise_rmse;
        let (ours, theirs, end) = (early.rmse_to_truth(noise), path.rmse_to_truth(noise), late.rmse_to_truth(noise));
        let audit = if late.audited_rmse > 0.0 { format!("{:.2}", late.audited_rmse / end) } else { "-".to_owned() };
        let row = format!(
            "| {name} | {gate} | {ours:.4} | {theirs:.4} ({} spp) | {:.2} | {end:.4} | {audit} | {:+.2} % | {} | {:.2} |",
            path.samples,
            ours / theirs,
            100.0 * late.bias,
            late.surfels,
            late.render_secs / 2.0 / f64::from(FRAMES[1]),
        );
        add_row(&mut text, &row);
    }
    Ok(text)
}

fn over_radii(only: &str, references: &[Reference]) -> Result<String, MeasureError> {
    if !RADII_REFERENCE.contains(only) {
        return Ok(String::new());
    }
    let mut text =
        String::from("| radius, pixels | surfels | 32 frames | 64 frames | s a frame |\n|---|---|---|---|---|\n");
    let reference = find(references, RADII_REFERENCE)?;
    for radius in RADII {
        let renderer = surfel(&["--surfel", &format!("radius={radius}")])?;
        let [early, late] = [renderer.measure(reference, FRAMES[0])?, renderer.measure(reference, FRAMES[1])?];
        let noise = reference.noise_rmse;
        let row = format!(
            "| {radius} | {} | {:.4} | {:.4} | {:.2} |",
            late.surfels,
            early.rmse_to_truth(noise),
            late.rmse_to_truth(noise),
            late.render_secs / 2.0 / f64::from(FRAMES[1]),
        );
        add_row(&mut text, &row);
    }
    Ok(text)
}
