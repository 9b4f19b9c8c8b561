//! The table of errors.

use std::fmt::Write as _;

use surfelcast_measure::Measurement;

/// Measurements as a Markdown table; the last point of each decides the columns that are not about slope.
pub(super) fn markdown(measurements: &[Measurement]) -> String {
    let mut text = String::from(
        "| reference | spp | RMSE | reference noise | own noise | ratio | slope | audit / RMSE | bias | bias in errors | furnace | s |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for measurement in measurements {
        let Some(point) = measurement.points.last() else { continue };
        let noise = measurement.reference_noise;
        let slope = match measurement.slope() {
            Some(slope) => format!("{slope:.2}"),
            // Several sample counts, but the reference is too noisy to see the error fall.
            None if measurement.points.len() > 1 => "at floor".to_owned(),
            None => "-".to_owned(),
        };
        let truth = point.rmse_to_truth(noise);
        // An error far below the reference's noise cannot be read off the difference.
        let audit = if point.audited_rmse > 0.0 && truth > 0.5 * noise {
            format!("{:.2}", point.audited_rmse / truth)
        } else {
            "-".to_owned()
        };
        let furnace =
            if point.analytic_error > 0.0 { format!("{:.2} %", 100.0 * point.analytic_error) } else { "-".to_owned() };
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "| {} | {} | {:.5} | {:.5} | {:.5} | {:.3} | {slope} | {audit} | {:+.2} % | {:+.1} | {furnace} | {:.1} |",
            measurement.name,
            point.samples,
            point.rmse,
            noise,
            point.own_noise,
            point.ratio(noise),
            100.0 * point.bias,
            point.bias_in_errors,
            point.render_secs,
        );
    }
    text
}
