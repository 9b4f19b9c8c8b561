//! `surfelcast-bench poisson`: convergence of image-space solvers of the screened Poisson problem.
//!
//! Three studies. *Solvers*: iterations, time and attainable residual of each against image size and screen weight.
//! *Blur*: a blurred image and its true differences, with the preparation steps of the first guess (Noack 2022,
//! figures 5.16 and 5.17). *Paths*: gradient-domain path tracing reconstructed by a fixed number of iterations with
//! and without preparation (figures 6.2 to 6.4).

mod measure;
mod problem;
mod report;

use clap::Args;
use serde::{Deserialize, Serialize};
use surfelcast::Failure;
use surfelcast::args::parse_size;

use crate::report::{Measured, Origin, OutputArgs, Page, Table, progress_bar, write_file};

pub(super) const PAGE: Page = Page { name: "poisson", template: include_str!("../../../pages/poisson.md.in") };

#[derive(Debug, Args)]
pub(crate) struct PoissonArgs {
    /// Picture sizes of the solver study.
    #[arg(long, value_name = "WxH,...", value_delimiter = ',', default_value = "160x120,320x240,640x480,1280x720",
          value_parser = parse_size)]
    sizes: Vec<[u32; 2]>,
    /// Weights of the values against the edges, whose weights are around 1.
    #[arg(long, value_name = "A,...", value_delimiter = ',', default_values_t = [0.04, 0.004, 0.0004],
          value_parser = parse_screen)]
    screens: Vec<f32>,
    /// Picture size of the blur study.
    #[arg(long, value_name = "WxH", default_value = "320x240", value_parser = parse_size)]
    blur_size: [u32; 2],
    /// Picture size of the path study.
    #[arg(long, value_name = "WxH", default_value = "160x120", value_parser = parse_size)]
    path_size: [u32; 2],
    /// Samples a pixel of the path study at most, in powers of two.
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=4096))]
    samples: u32,
    /// Samples a pixel of its truth.
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = clap::value_parser!(u32).range(16..=65536))]
    truth_samples: u32,
    #[command(flatten)]
    output: OutputArgs,
}

fn parse_screen(text: &str) -> Result<f32, String> {
    let screen = text.parse().ok().filter(|a: &f32| (1e-6..=1e3).contains(a));
    screen.ok_or_else(|| "expected a number in [1e-6, 1e3]".to_owned())
}

/// One solver on one problem.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Solved {
    solver: String,
    size: [u32; 2],
    screen: f32,
    /// Iterations to the goal, milliseconds on the device until then, and the share of the start's error that is left.
    iterations: Option<u32>,
    ms: Option<f64>,
    error_left: Option<f64>,
    ms_an_iteration: f64,
    /// Least residual found: the limit of `f32`, unless the iterations ran out.
    attainable: f64,
    /// Residual by iteration.
    residuals: Vec<f64>,
}

/// RMSE of an image of a study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Observed {
    study: String,
    method: String,
    /// Iterations, or samples a pixel.
    at: u32,
    rmse: f64,
}

/// All three studies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Studies {
    key: Key,
    origin: Origin,
    solvers: Vec<Solved>,
    images: Vec<Observed>,
}

/// What was requested.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Key {
    sizes: Vec<[u32; 2]>,
    screens: Vec<f32>,
    blur_size: [u32; 2],
    path_size: [u32; 2],
    samples: u32,
    truth_samples: u32,
}

impl Measured for Studies {
    type Key = Key;

    fn key(&self) -> &Key {
        &self.key
    }

    fn origin(&self) -> &Origin {
        &self.origin
    }

    fn table(all: &[Self]) -> Table {
        report::solver_table(all)
    }
}

pub(crate) fn run(args: &PoissonArgs) -> Result<(), Failure> {
    let out = &args.output;
    let mut record = out.record::<Studies>(PAGE.name)?;
    let gpu = out.gpu()?;
    let origin = Origin::of(&gpu);
    let key = Key {
        sizes: args.sizes.clone(),
        screens: args.screens.clone(),
        blur_size: args.blur_size,
        path_size: args.path_size,
        samples: args.samples,
        truth_samples: args.truth_samples,
    };
    let studies = record.find_or_measure(&key, &origin, || {
        let bar = progress_bar(measure::step_count(&key));
        let (solvers, images) = measure::measure(&gpu, &key, &bar)?;
        bar.finish_and_clear();
        Ok(Studies { key: key.clone(), origin: origin.clone(), solvers, images })
    })?;
    write_file(&out.out.join("poisson_images.csv"), &report::image_table(&studies.images).csv()?)?;
    report::charts(studies, &out.out)?;
    out.publish(&PAGE, &[(PAGE.name, report::markdown(studies))])
}
