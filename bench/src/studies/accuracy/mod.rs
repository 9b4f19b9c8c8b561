//! Error of every reference camera at rising sample counts, measured with the finished program.

mod report;

use clap::Args;
use serde::{Deserialize, Serialize};
use surfelcast::Failure;
use surfelcast::args::technique_ids;
use surfelcast_measure::{Measurement, Point, Reference, Renderer};
use surfelcast_techniques::registry::{TECHNIQUES, catalogue};

use crate::report::{Measured, Origin, OutputArgs, Page, Table, input};
use crate::studies::references;

pub(super) const PAGE: Page = Page { name: "accuracy", template: include_str!("../../../pages/accuracy.md.in") };

#[derive(Debug, Args)]
pub(crate) struct AccuracyArgs {
    /// Samples per pixel.
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_values_t = [16, 64, 256],
          value_parser = clap::value_parser!(u32).range(1..=1_048_576))]
    spp: Vec<u32>,
    /// References whose names contain this.
    #[arg(long, value_name = "NAME-PART")]
    only: Option<String>,
    /// Technique.
    #[arg(long, value_name = "ID", default_value = "path", value_parser = technique_ids(&catalogue(TECHNIQUES)))]
    technique: String,
    #[command(flatten)]
    output: OutputArgs,
}

/// One reference at one number of samples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Row {
    key: Key,
    origin: Origin,
    point: Point,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Key {
    reference: String,
    technique: String,
    samples: u32,
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
        report::rows(rows)
    }
}

#[allow(clippy::print_stderr, reason = "a study says how far it is")]
pub(crate) fn run(args: &AccuracyArgs) -> Result<(), Failure> {
    if args.only.is_some() {
        args.output.refuse_page_of_part("--only")?;
    }
    let mut record = args.output.record::<Row>(PAGE.name)?;
    let origin = Origin::of(&args.output.gpu()?);
    let mut renderer = Renderer::find(&args.technique).map_err(input)?;
    renderer.arguments = args.output.device_words();
    let (mut measurements, mut origins) = (Vec::new(), Vec::new());
    let is_requested = |reference: &&Reference| args.only.as_ref().is_none_or(|part| reference.name.contains(part));
    for reference in references()?.iter().filter(is_requested) {
        let mut points = Vec::new();
        for &samples in &args.spp {
            let key = Key { reference: reference.name.clone(), technique: args.technique.clone(), samples };
            let row = record.find_or_measure(&key, &origin, || {
                let point = renderer.measure(reference, samples).map_err(input)?;
                Ok(Row { key: key.clone(), origin: origin.clone(), point })
            })?;
            let point = &row.point;
            eprintln!(
                "{} {samples} spp: RMSE {:.5}, ratio {:.3}, bias {:+.2} % ({:+.1} errors), {:.1} s",
                reference.name,
                point.rmse,
                point.ratio(reference.noise_rmse),
                100.0 * point.bias,
                point.bias_in_errors,
                point.render_secs
            );
            points.push(*point);
            origins.push(row.origin.clone());
        }
        measurements.push(Measurement { name: reference.name.clone(), reference_noise: reference.noise_rmse, points });
    }
    if measurements.is_empty() {
        let part = args.only.as_deref().unwrap_or_default();
        return Err(Failure::input(format!("--only {part}: no reference has such a name")));
    }
    args.output.publish(&PAGE, &[(PAGE.name, report::markdown(&measurements, &origins))])
}
