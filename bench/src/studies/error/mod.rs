//! `surfelcast-bench error`: error against cost.
//!
//! Each way to render draws each picture several times with different seeds. One draw is one long render that is looked at
//! after 1, 2, 4, 8, ... samples a pixel, so all budgets of a curve share their work; looking and auditing are not timed.
//! A throw-away draw before it keeps compilation out of the times.

mod case;
mod comparisons;
mod peers;
mod record;
mod tables;
mod variant;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use surfelcast::Failure;
use surfelcast_gpu::Gpu;
use surfelcast_measure::{Picture, Reference, flip, shared_folder, split_error};
use surfelcast_techniques::{SessionState, SurfelSettings, registry};

use crate::report::{OutputArgs, device_name, input, progress_bar};
use crate::stage::{Cost, Stage, camera_aside};
use crate::studies::error::case::{Case, Truth, Wanted, WantedSize};
use crate::studies::error::record::{Curve, Key, Point, Record};
use crate::studies::error::variant::{Start, Variant, VariantLists};
use surfelcast::args::{MAX_SIDE, Materials, parse_secs, parse_size, preset_names, technique_ids};

/// References that other renderers were measured on as well.
const SCENES: [&str; 5] = ["cornell_box", "bars", "maze_small_near_lambert", "sponza", "classroom"];
/// Stands for all references.
const EVERY_REFERENCE: &str = "references";
/// Those of them for the study of reconstruction in the image.
const IMAGE_SCENES: [&str; 3] = ["cornell_box", "bars", "classroom"];
/// Scenes where there are no references.
const BUILT_IN: [&str; 2] = ["demo:cornell_box", "demo:interior"];
/// Frames of the camera before, where the cache is warm: until it has settled in all but the noisiest places.
const WARM_FRAMES: u32 = 64;
/// Seconds of rendering of a whole study, where none are given for a draw: enough to see where curves end, and under 20
/// minutes with all that is not timed, on a software GPU with two cores too. No draw is held to less than the least.
const STUDY_SECS: f64 = 900.0;
const LEAST_SECS: f64 = 2.0;
/// How names of passes begin that reconstruct light on the graph of surfels.
const RECONSTRUCTION_PASSES: &str = "graph_";
/// Keeps the random numbers of the camera before apart.
const WARM_SEED: u64 = 1 << 32;

/// A question, which chooses what is compared where the command line does not, and the layout of the tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Study {
    /// Every technique and reconstruction.
    Error,
    /// The presets of the surfel cache.
    Presets,
    /// Capacity and density of surfels, as in table 6.1 of the thesis.
    Densities,
    /// Seconds to an error beside those of other renderers, from an empty cache and from a warm one.
    Peers,
    /// A picture that settles beside the cache alone and path tracing, at equal seconds.
    Settling,
    /// Indirect light by each reconstruction and by path tracing, at equal rays.
    Reconstructions,
    /// Indirect light reconstructed in the image, from the published scheme to ours, beside other reconstructions.
    Image,
}

#[derive(Debug, Args)]
pub(crate) struct ErrorArgs {
    /// What is asked; its name is that of the markers for --table.
    #[arg(long, value_enum, default_value_t = Study::Error)]
    study: Study,
    /// Name of a reference or of a scene that has one, a scene file, or a built-in scene such as demo:cornell_box; may be
    /// given several times. `references` stands for every reference there is.
    #[arg(long = "scene", value_name = "SCENE")]
    scenes: Vec<String>,
    /// Camera by name; the first by default.
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Picture that is taken for the truth, with its noise in a JSON beside it; a path-traced one by default.
    #[arg(long, value_name = "FILE.exr")]
    reference: Option<PathBuf>,
    /// Samples a pixel of a path-traced truth.
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = clap::value_parser!(u32).range(2..=1_048_576))]
    truth_spp: u32,
    /// Technique; may be given several times. All by default.
    #[arg(long = "technique", value_name = "ID", value_parser = technique_ids())]
    techniques: Vec<String>,
    /// Reconstruction of the surfel cache; may be given several times. All by default.
    #[arg(long = "reconstruction", value_name = "NAME")]
    reconstructions: Vec<String>,
    /// Preset of the surfel cache; may be given several times.
    #[arg(long = "preset", value_name = "NAME", value_parser = preset_names())]
    presets: Vec<String>,
    /// Knob of the surfel cache with one or more values, such as radius=2,3,6; may be given several times.
    #[arg(long = "surfel", value_name = "NAME=VALUE[,VALUE...]")]
    knobs: Vec<String>,
    /// What the cache knows at first; may be given several times.
    #[arg(long = "start", value_enum, value_name = "STATE")]
    starts: Vec<Start>,
    /// Samples a pixel at most; budgets are the powers of two up to there.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65_536))]
    samples: Option<u32>,
    /// Seconds of rendering of one draw at most; by default so many that a study takes about a quarter of an hour.
    #[arg(long, value_name = "SECS", value_parser = parse_secs)]
    time_limit: Option<f64>,
    /// Draws of each picture. Two tell noise from bias, three give both an error bar.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64))]
    replicates: Option<u32>,
    /// Seed of the first draw; those after it follow.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(..1 << 31))]
    seed: u64,
    /// Picture size; the reference's by default, 192x144 for reconstructions. A reference that is a whole number of times as
    /// large is averaged, another size needs a truth of its own.
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<[u32; 2]>,
    /// Picture width; the height follows the reference's shape.
    #[arg(long, value_name = "PIXELS", conflicts_with = "size", value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_SIDE)))]
    width: Option<u32>,
    /// Materials.
    #[arg(long, value_enum, default_value_t = Materials::Lambert)]
    materials: Materials,
    /// Seconds of other renderers (study peers): rows of their harness as CSV, or its tables as Markdown; may be given
    /// several times. The first that has a figure counts.
    #[arg(long = "peers", value_name = "FILE")]
    peers: Vec<PathBuf>,
    #[command(flatten)]
    output: OutputArgs,
}

impl ErrorArgs {
    fn picture_size(&self) -> Option<WantedSize> {
        let of_study = || self.study.size().filter(|_| self.reference.is_none());
        self.width.map(WantedSize::Width).or_else(|| self.size.or_else(of_study).map(WantedSize::Both))
    }
}

impl Study {
    /// Name of the markers and of the record.
    fn name(self) -> &'static str {
        match self {
            Self::Error => "error",
            Self::Presets => "presets",
            Self::Densities => "densities",
            Self::Peers => "peers",
            Self::Settling => "settling",
            Self::Reconstructions => "reconstructions",
            Self::Image => "image",
        }
    }

    /// Most samples of a draw, and draws.
    fn budget(self) -> (u32, u32) {
        match self {
            Self::Error => (256, 3),
            Self::Presets => (64, 2),
            Self::Densities | Self::Image => (32, 2),
            Self::Peers | Self::Reconstructions => (256, 2),
            Self::Settling => (1024, 2),
        }
    }

    /// Size of pictures that have no reference to be as large as: a truth of many samples is affordable, and a first frame
    /// has few rays a pixel, since surfels are a few pixels large.
    fn size(self) -> Option<[u32; 2]> {
        (self == Self::Reconstructions).then_some([192, 144])
    }

    /// What is compared, in the order of the table.
    fn variants(self, asked: &VariantLists) -> Result<Vec<Variant>, Failure> {
        if self != Self::Image {
            return self.lists(asked).all();
        }
        // Not every combination: the scheme means something in the image only. Surfels borrow from nobody in either.
        let rows = [("image", "image=4,3,2,1,0"), ("none", ""), ("poisson", "")];
        let mut variants = Vec::new();
        for (reconstruction, scheme) in rows {
            let mut lists = asked.clone();
            lists.techniques = vec!["surfel".to_owned()];
            lists.reconstructions = vec![reconstruction.to_owned()];
            lists
                .knobs
                .extend(["sharing=0", scheme].iter().filter(|knob| !knob.is_empty()).map(|&knob| knob.to_owned()));
            variants.extend(lists.all()?);
        }
        Ok(variants)
    }

    /// What is compared where nothing is asked for.
    fn lists(self, asked: &VariantLists) -> VariantLists {
        let words = |words: &[&str]| words.iter().map(|&word| word.to_owned()).collect::<Vec<_>>();
        let or = |asked: &Vec<String>, default: &[&str]| if asked.is_empty() { words(default) } else { asked.clone() };
        let mut lists = asked.clone();
        match self {
            Self::Error | Self::Image => {}
            Self::Presets => {
                lists.techniques = or(&asked.techniques, &["surfel"]);
                lists.presets = or(&asked.presets, &["preview", "balanced", "high"]);
            }
            Self::Densities => {
                lists.techniques = or(&asked.techniques, &["surfel"]);
                lists.knobs = or(&asked.knobs, &["radius=2,3,6", "capacity=65536,131072,262144,524288,1048576"]);
            }
            Self::Peers => {
                if asked.starts.is_empty() {
                    lists.starts = vec![Start::Empty, Start::Warm];
                }
            }
            Self::Settling => {
                lists.techniques = or(&asked.techniques, &["surfel", "path"]);
                lists.knobs = or(&asked.knobs, &["settling=1,0"]);
            }
            // Without settling, and without borrowing from neighbours in place of a reconstruction: what each says itself.
            Self::Reconstructions => {
                lists.techniques = or(&asked.techniques, &["surfel", "path"]);
                lists.knobs = or(&asked.knobs, &["settling=0", "sharing=0"]);
            }
        }
        // One reconstruction is enough for the questions that are about something else.
        if !matches!(self, Self::Error | Self::Reconstructions) && asked.reconstructions.is_empty() {
            lists.reconstructions = words(&[SurfelSettings::default().reconstruction.name()]);
        }
        lists
    }
}

pub(crate) fn run(args: &ErrorArgs) -> Result<(), Failure> {
    let study = args.study;
    let variants = study.variants(&VariantLists {
        techniques: args.techniques.clone(),
        reconstructions: args.reconstructions.clone(),
        presets: args.presets.clone(),
        knobs: args.knobs.clone(),
        starts: args.starts.clone(),
    })?;
    args.output.table.check(study.name())?;
    let peers = peers::read(&args.peers)?;
    let shared = shared_folder(Path::new(".."));
    let scenes = scenes(args, shared.as_deref())?;

    let gpu = args.output.gpu()?;
    let folder = &args.output.out;
    let mut record = Record::open(&folder.join(study.name()).with_extension("json"))?;
    let (samples, replicates) = study.budget();
    let samples = args.samples.unwrap_or(samples);
    let replicates = args.replicates.unwrap_or(replicates);
    let draw_count = scenes.len() * variants.len() * replicates as usize;
    let time_limit_secs = args.time_limit.unwrap_or_else(|| (STUDY_SECS / draw_count as f64).max(LEAST_SECS));
    let (mut curves, mut refusals) = (Vec::new(), String::new());
    let bar = progress_bar((scenes.len() * variants.len()) as u64);
    for scene in &scenes {
        bar.set_message(format!("{scene}: reading"));
        let wanted = Wanted {
            scene,
            camera: args.camera.as_deref(),
            size: args.picture_size(),
            materials: args.materials,
            is_indirect: matches!(study, Study::Image | Study::Reconstructions),
            reference: args.reference.as_deref(),
        };
        let case = Case::find(&wanted, shared.as_deref())?;
        let stage = case.stage(&gpu)?;
        bar.set_message(format!("{}: truth", case.name));
        let truth = case.truth(&stage, args.truth_spp, &folder.join("truth"))?;
        for variant in &variants {
            bar.set_message(format!("{}: {}", case.name, variant.label()));
            if let Some(Err(reason)) =
                registry::by_id(&variant.technique).map(|entry| (entry.needs)(&case.scene.summary))
            {
                // Writing to a string cannot fail.
                let _ = writeln!(refusals, "\n{} does not render {}: {reason}.", variant.label(), case.name);
                bar.inc(1);
                continue;
            }
            let key = Key {
                case: case.name.clone(),
                scene_id: case.scene.id.to_string(),
                size: case.size,
                variant: variant.clone(),
                truth: truth.source.clone(),
                replicates,
                seed: args.seed,
                samples,
                time_limit_ms: (time_limit_secs * 1e3) as u64,
                device: device_name(&gpu),
                version: env!("CARGO_PKG_VERSION").to_owned(),
            };
            if record.find(&key).is_none() {
                match measure(&gpu, &case, &stage, &truth, key.clone()) {
                    Ok(curve) => record.add(curve)?,
                    // A cache may be larger than what this device binds at once: that is a result too.
                    Err(Failure::Input(reason)) => {
                        let _ = writeln!(refusals, "\n{} on {}: {reason}.", variant.label(), case.name);
                    }
                    Err(failure) => return Err(failure),
                }
            }
            curves.extend(record.find(&key).cloned());
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    tables::charts(&curves, folder, study.name())?;
    let text = match study {
        Study::Error => tables::errors(&curves),
        Study::Presets => tables::presets(&curves),
        Study::Densities => tables::densities(&curves),
        Study::Peers => peers::table(&curves, &peers),
        Study::Settling => comparisons::settling(&curves),
        Study::Reconstructions => comparisons::reconstructions(&curves),
        Study::Image => tables::images(&curves),
    };
    args.output.table.publish(study.name(), &(text + &refusals))
}

/// Scenes asked for, else those with references, else the built-in ones.
fn scenes(args: &ErrorArgs, shared: Option<&Path>) -> Result<Vec<String>, Failure> {
    let has_references = shared.is_some();
    if args.reference.is_some() && args.scenes.len() != 1 {
        return Err(Failure::input("--reference is the truth of one picture: give one --scene with it"));
    }
    if let (Some(shared), true) = (shared, args.scenes.iter().any(|scene| scene == EVERY_REFERENCE)) {
        return Ok(Reference::read_all(shared).map_err(input)?.into_iter().map(|reference| reference.name).collect());
    }
    let default: &[&str] = match args.study {
        _ if !args.scenes.is_empty() => return Ok(args.scenes.clone()),
        Study::Densities if has_references => &SCENES[..1],
        Study::Densities => &BUILT_IN[..1],
        Study::Image if has_references => &IMAGE_SCENES,
        _ if has_references => &SCENES,
        _ => &BUILT_IN,
    };
    Ok(default.iter().map(|&scene| scene.to_owned()).collect())
}

/// What is kept of one draw at one budget.
struct Look {
    picture: Picture,
    cost: Cost,
    /// Tone-mapped mean square, which may be below 0, and its standard error.
    audited: Option<[f64; 2]>,
    surfels: Option<u32>,
}

/// Measures one curve.
fn measure(gpu: &Gpu, case: &Case, stage: &Stage<'_>, truth: &Truth, key: Key) -> Result<Curve, Failure> {
    let settings = key.variant.settings()?;
    let technique = &key.variant.technique;
    stage.shot(technique, settings, case.camera, 0, &SessionState::default())?.render(1, f64::INFINITY)?;

    let mut budgets: Vec<u32> = (0..32).map(|power| 1 << power).take_while(|&budget| budget <= key.samples).collect();
    let mut limit_secs = key.time_limit_ms as f64 * 1e-3;
    let mut draws: Vec<Vec<Look>> = Vec::new();
    let mut memory_bytes = [0; 3];
    for replicate in 0..key.replicates {
        let seed = key.seed + u64::from(replicate);
        let session = SessionState::default();
        if key.variant.start == Start::Warm {
            let aside = camera_aside(&case.scene, &case.camera);
            let mut before = stage.shot(technique, settings, aside, seed + WARM_SEED, &session)?;
            before.render(WARM_FRAMES, f64::INFINITY)?;
        }
        let mut shot = stage.shot(technique, settings, case.camera, seed, &session)?;
        let mut looks = Vec::new();
        for &budget in &budgets {
            // One look there is in any case.
            let limit = if looks.is_empty() { f64::INFINITY } else { limit_secs };
            if !shot.render(budget, limit)? {
                break;
            }
            let audited = shot.audit()?.map(|audit| [audit.mse, audit.mse_std_error]);
            looks.push(Look { picture: shot.picture()?, cost: shot.cost.clone(), audited, surfels: shot.surfels() });
        }
        let memory = gpu.memory();
        memory_bytes = [memory.scene_bytes, memory.session_bytes, memory.view_bytes];
        // The first draw says how far the others go, so that all have the same budgets.
        budgets.truncate(looks.len());
        limit_secs = f64::INFINITY;
        draws.push(looks);
    }
    let points = budgets
        .iter()
        .enumerate()
        .map(|(index, &samples)| {
            let looks: Vec<&Look> = draws.iter().filter_map(|looks| looks.get(index)).collect();
            point(samples, &looks, truth, f64::from(case.exposure))
        })
        .collect();
    Ok(Curve { key, truth_noise: truth.noise, memory_bytes, points })
}

/// Brings the draws of one budget together.
fn point(samples: u32, looks: &[&Look], truth: &Truth, exposure: f64) -> Point {
    let count = looks.len() as f64;
    let mean = |value: &dyn Fn(&Look) -> f64| looks.iter().map(|look| value(look)).sum::<f64>() / count;
    let known = |value: f64| value.is_finite().then_some(value);
    let pictures: Vec<_> = looks.iter().map(|look| truth.comparable(&look.picture)).collect();
    let compared = truth.compared();
    let split = split_error(&pictures, &compared, exposure, truth.noise);
    let shown = truth.whole().tone_mapped(exposure);
    let secs = mean(&|look| look.cost.secs);
    let spread = mean(&|look| (look.cost.secs - secs).powi(2));
    let audited = looks.iter().map(|look| look.audited).collect::<Option<Vec<_>>>().map(|all| {
        let square = (all.iter().map(|a| a[0]).sum::<f64>() / count).max(0.0);
        // Independent audits: the standard error of their mean falls with the root of their number.
        let std_error = all.iter().map(|a| a[1].powi(2)).sum::<f64>().sqrt() / count;
        [square.sqrt(), (square + std_error).sqrt() - square.sqrt()]
    });
    let over_pictures = |value: &dyn Fn(&Picture) -> f64| pictures.iter().map(value).sum::<f64>() / count;
    Point {
        samples,
        secs,
        secs_std_error: known((spread / (count - 1.0)).sqrt()),
        gpu_secs: mean(&|look| look.cost.gpu_secs),
        reconstruction_gpu_secs: mean(&|look| look.cost.gpu_secs_of(RECONSTRUCTION_PASSES)),
        rays_primary: mean(&|look| look.cost.rays[0] as f64),
        rays_secondary: mean(&|look| look.cost.rays[1] as f64),
        rays_shadow: mean(&|look| look.cost.rays[2] as f64),
        rmse: split.rmse.value,
        rmse_std_error: known(split.rmse.std_error),
        error: (split.rmse.value.powi(2) - truth.noise.powi(2)).max(0.0).sqrt(),
        relative_mse: over_pictures(&|picture| picture.relative_mse(&compared)),
        // Neighbourhoods matter to it, so it sees the masked parts too.
        flip: mean(&|look| flip(&look.picture.tone_mapped(exposure), &shown)),
        bias_squared: known(split.bias_squared.value),
        bias_squared_std_error: known(split.bias_squared.std_error),
        variance: known(split.variance.value),
        variance_std_error: known(split.variance.std_error),
        mean_bias: over_pictures(&Picture::mean) / compared.mean().max(1e-30) - 1.0,
        audited_rmse: audited.map(|[rmse, _]| rmse),
        audited_std_error: audited.map(|[_, std_error]| std_error),
        surfels: looks.iter().map(|look| look.surfels.map(f64::from)).sum::<Option<f64>>().map(|sum| sum / count),
        non_finite: looks.iter().map(|look| look.cost.non_finite).sum(),
    }
}
