//! Error of every reference camera at rising sample counts, measured with the finished program.

mod table;

use clap::Args;
use surfelcast::Failure;
use surfelcast::args::technique_ids;
use surfelcast_measure::{MeasureError, Measurement, Point, Reference, Renderer};

use crate::report::{TableArgs, input};
use crate::studies::references;

/// Name of the markers.
const NAME: &str = "accuracy";

#[derive(Debug, Args)]
pub(crate) struct AccuracyArgs {
    /// Samples a pixel.
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_values_t = [16, 64, 256],
          value_parser = clap::value_parser!(u32).range(1..=1_048_576))]
    spp: Vec<u32>,
    /// References whose names contain this.
    #[arg(long, value_name = "NAME-PART", default_value = "")]
    only: String,
    /// Technique.
    #[arg(long, value_name = "ID", default_value = "path", value_parser = technique_ids())]
    technique: String,
    #[command(flatten)]
    table: TableArgs,
}

#[allow(clippy::print_stderr, reason = "a study says how far it is")]
pub(crate) fn run(args: &AccuracyArgs) -> Result<(), Failure> {
    args.table.check(NAME)?;
    let renderer = Renderer::find(&args.technique).map_err(input)?;
    let mut measurements = Vec::new();
    for reference in references()?.iter().filter(|one| one.name.contains(&args.only)) {
        let mut points = Vec::new();
        for &samples in &args.spp {
            let point = measure(&renderer, reference, samples)?;
            eprintln!(
                "{} {samples} spp: RMSE {:.5}, ratio {:.3}, bias {:+.2} % ({:+.1} errors), {:.1} s",
                reference.name,
                point.rmse,
                point.ratio(reference.noise_rmse),
                100.0 * point.bias,
                point.bias_in_errors,
                point.render_secs
            );
            points.push(point);
        }
        measurements.push(Measurement { name: reference.name.clone(), reference_noise: reference.noise_rmse, points });
    }
    if measurements.is_empty() {
        return Err(Failure::input(format!("--only {}: no reference has such a name", args.only)));
    }
    args.table.publish(NAME, &table::markdown(&measurements))
}

fn measure(renderer: &Renderer, reference: &Reference, samples: u32) -> Result<Point, Failure> {
    let failed = |error: MeasureError| Failure::runtime(format!("{}: {error}", reference.name));
    renderer.measure(reference, samples).map_err(failed)
}
