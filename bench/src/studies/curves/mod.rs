//! Error against cost: what all studies of curves share.
//!
//! Each way to render makes each image several times with different seeds, and is observed after 1, 2, 4, 8, ...
//! samples per pixel. A [`Question`] says what is compared and how the tables look.

mod case;
mod charts;
mod curve;
mod measure;
mod report;
mod variant;

pub(crate) use case::RequestedSize;
pub(crate) use curve::{Curve, Point};
pub(crate) use report::{GOALS, audit_ratio, by_case, conditions, means_over_cases, reached, root, with_error};
pub(crate) use variant::{Start, Variant, VariantLists, or_default};

#[cfg(test)]
pub(crate) use curve::tests::curve;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use surfelcast::Failure;
use surfelcast::args::{MAX_SIDE, Materials, parse_secs, parse_size, preset_names, technique_ids};
use surfelcast_measure::{Reference, shared_folder};
use surfelcast_techniques::registry::{self, TECHNIQUES, catalogue};

use crate::report::{Origin, OutputArgs, Page, input, progress_bar};
use case::{Case, Requested};
use curve::Key;

/// References that other renderers were measured on as well.
const SCENES: [&str; 5] = ["cornell_box", "bars", "maze_small_near_lambert", "sponza", "classroom"];
/// Stands for all references.
pub(crate) const EVERY_REFERENCE: &str = "references";
/// Scenes where there are no references.
const BUILT_IN: [&str; 2] = ["demo:cornell_box", "demo:interior"];
/// Seconds of rendering of a whole study, if none are given for a replicate: long enough to see where curves end, and
/// less than 20 minutes with all that is not timed, also on a software GPU with two cores. And the least of one
/// replicate.
const STUDY_SECS: f64 = 900.0;
const LEAST_SECS: f64 = 2.0;

/// What a study compares, where the command line does not choose it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Question {
    pub(crate) page: Page,
    /// Most samples per pixel of a replicate, and replicates.
    pub(crate) samples: u32,
    pub(crate) replicates: u32,
    /// Scenes with references, and built-in ones; the common ones if empty.
    pub(crate) scenes: &'static [&'static str],
    pub(crate) built_in: &'static [&'static str],
    /// Size of images if it is not that of the references.
    pub(crate) size: Option<RequestedSize>,
    /// Indirect light alone is compared, demodulated.
    pub(crate) is_indirect: bool,
    /// The ways to render, in the order of the table.
    pub(crate) variants: fn(&VariantLists) -> Result<Vec<Variant>, Failure>,
}

/// What can be chosen in every study of curves.
#[derive(Debug, Args)]
pub(crate) struct CurvesArgs {
    /// Name of a reference or of a scene that has one, a scene file, or a built-in scene such as demo:cornell_box;
    /// may be given several times. `references` stands for every reference.
    #[arg(long = "scene", value_name = "SCENE")]
    scenes: Vec<String>,
    /// Camera by name; the first by default.
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Image that is taken for the truth, with its noise in a JSON of the same name; a path-traced one by default.
    #[arg(long, value_name = "FILE.exr")]
    reference: Option<PathBuf>,
    /// Samples per pixel of a path-traced truth.
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = clap::value_parser!(u32).range(2..=1_048_576))]
    truth_spp: u32,
    /// Technique; may be given several times. All by default.
    #[arg(long = "technique", value_name = "ID", value_parser = technique_ids(&catalogue(TECHNIQUES)))]
    techniques: Vec<String>,
    /// Reconstruction; may be given several times. All by default.
    #[arg(long = "reconstruction", value_name = "NAME")]
    reconstructions: Vec<String>,
    /// Preset; may be given several times.
    #[arg(long = "preset", value_name = "NAME", value_parser = preset_names(&catalogue(TECHNIQUES)))]
    presets: Vec<String>,
    /// Setting with one or more values, such as radius=2,3,6; may be given several times.
    #[arg(long = "set", value_name = "NAME=VALUE[,VALUE...]")]
    settings: Vec<String>,
    /// What the cache holds at first; may be given several times.
    #[arg(long = "start", value_enum, value_name = "STATE")]
    starts: Vec<Start>,
    /// Samples per pixel at most; budgets are the powers of two up to there.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65_536))]
    samples: Option<u32>,
    /// Seconds of rendering of one replicate at most; by default a study takes about a quarter of an hour.
    #[arg(long, value_name = "SECS", value_parser = parse_secs)]
    time_limit: Option<f64>,
    /// Replicates of each image. Two separate noise from bias, three give both an error bar.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64))]
    replicates: Option<u32>,
    /// Seed of the first replicate; the others follow.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(..1 << 31))]
    seed: u64,
    /// Image size; the reference's by default, 192x144 for reconstructions. A reference whose size is a multiple is
    /// averaged down, any other size needs a truth of its own.
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<[u32; 2]>,
    /// Image width; the height follows the reference's shape.
    #[arg(long, value_name = "PIXELS", conflicts_with = "size",
          value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_SIDE)))]
    width: Option<u32>,
    /// Materials.
    #[arg(long, value_enum, default_value_t = Materials::Lambert)]
    materials: Materials,
    #[command(flatten)]
    output: OutputArgs,
}

/// Measures what a question asks, and writes record, plots and page.
pub(crate) fn run(
    question: &Question,
    args: &CurvesArgs,
    tables: impl FnOnce(&[Curve]) -> String,
) -> Result<(), Failure> {
    let study = question.page.name;
    let variants = (question.variants)(&VariantLists {
        techniques: args.techniques.clone(),
        reconstructions: args.reconstructions.clone(),
        presets: args.presets.clone(),
        settings: args.settings.clone(),
        starts: args.starts.clone(),
    })?;
    let shared = shared_folder(Path::new(".."));
    let scenes = scenes(question, args, shared.as_deref())?;
    let folder = &args.output.out;
    let mut record = args.output.record::<Curve>(study)?;
    let gpu = args.output.gpu()?;
    let origin = Origin::of(&gpu);

    let samples = args.samples.unwrap_or(question.samples);
    let replicates = args.replicates.unwrap_or(question.replicates);
    let replicate_count = scenes.len() * variants.len() * replicates as usize;
    let time_limit_secs = args.time_limit.unwrap_or_else(|| (STUDY_SECS / replicate_count as f64).max(LEAST_SECS));
    let size = args.width.map(RequestedSize::Width).or_else(|| {
        let of_question = || question.size.filter(|_| args.reference.is_none());
        args.size.map(RequestedSize::Both).or_else(of_question)
    });
    let (mut curves, mut refusals) = (Vec::new(), String::new());
    let bar = progress_bar((scenes.len() * variants.len()) as u64);
    for scene in &scenes {
        bar.set_message(format!("{scene}: reading"));
        let requested = Requested {
            scene,
            camera: args.camera.as_deref(),
            size,
            materials: args.materials,
            is_indirect: question.is_indirect,
            reference: args.reference.as_deref(),
        };
        let case = Case::find(&requested, shared.as_deref())?;
        let stage = case.stage(&gpu)?;
        bar.set_message(format!("{}: truth", case.name));
        let truth = case.truth(&stage, args.truth_spp, &folder.join("truth"))?;
        for variant in &variants {
            bar.set_message(format!("{}: {}", case.name, variant.label()));
            let needs = registry::by_id(&variant.technique).map(|entry| (entry.needs)(&case.scene.summary));
            if let Some(Err(reason)) = needs {
                // Writing to a string cannot fail.
                let _ = writeln!(refusals, "\n{} does not render {}: {reason}.", variant.label(), case.name);
                bar.inc(1);
                continue;
            }
            let key = Key {
                case: case.name.clone(),
                scene_id: case.scene.key().to_string(),
                size: case.size,
                variant: variant.clone(),
                truth: truth.source.clone(),
                replicates,
                seed: args.seed,
                samples,
                time_limit_ms: (time_limit_secs * 1e3) as u64,
            };
            let found = record.find_or_measure(&key, &origin, || {
                measure::measure(&gpu, &case, &stage, &truth, key.clone(), origin.clone())
            });
            match found {
                Ok(curve) => curves.push(curve.clone()),
                // A cache may be larger than what this device binds at once: that is a result too.
                Err(Failure::Input(reason)) => {
                    let _ = writeln!(refusals, "\n{} on {}: {reason}.", variant.label(), case.name);
                }
                Err(failure) => return Err(failure),
            }
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    charts::write(&curves, folder, study)?;
    args.output.publish(&question.page, &[(study, tables(&curves) + &refusals)])
}

/// Scenes of the command line, else those of the question.
fn scenes(question: &Question, args: &CurvesArgs, shared: Option<&Path>) -> Result<Vec<String>, Failure> {
    if args.reference.is_some() && args.scenes.len() != 1 {
        return Err(Failure::input("--reference is the truth of one image: give one --scene with it"));
    }
    let or = |own: &'static [&'static str], common: &'static [&'static str]| if own.is_empty() { common } else { own };
    let words = |words: &[&str]| words.iter().map(|&word| word.to_owned()).collect();
    let scenes: Vec<String> = match shared {
        _ if !args.scenes.is_empty() => args.scenes.clone(),
        Some(_) => words(or(question.scenes, &SCENES)),
        None => words(or(question.built_in, &BUILT_IN)),
    };
    match shared {
        Some(shared) if scenes.iter().any(|scene| scene == EVERY_REFERENCE) => {
            let references = Reference::read_all(shared).map_err(input)?;
            Ok(references.into_iter().map(|reference| reference.name).collect())
        }
        _ => Ok(scenes),
    }
}
