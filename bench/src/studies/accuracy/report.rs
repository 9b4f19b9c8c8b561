//! The table of errors.

use surfelcast_measure::Measurement;

use crate::report::{Origin, Table, describe, known};
use crate::studies::accuracy::Row;

/// All rows, for CSV.
pub(super) fn rows(rows: &[Row]) -> Table {
    let mut table = Table::new([
        "reference",
        "technique",
        "samples",
        "rmse",
        "own_noise",
        "audited_rmse",
        "bias",
        "bias_in_errors",
        "analytic_error",
        "non_finite",
        "render_secs",
        "rays",
        "commit",
        "device",
    ]);
    for Row { key, origin, point } in rows {
        let number = |value: f64| format!("{value:.6e}");
        table.push([
            key.reference.clone(),
            key.technique.clone(),
            key.samples.to_string(),
            number(point.rmse),
            number(point.own_noise),
            number(point.audited_rmse),
            number(point.bias),
            number(point.bias_in_errors),
            number(point.analytic_error),
            point.non_finite.to_string(),
            number(point.render_secs),
            number(point.rays),
            origin.commit.clone(),
            origin.device.clone(),
        ]);
    }
    table
}

/// One row a reference. The last point of each gives the columns that are not about slope.
pub(super) fn markdown(measurements: &[Measurement], origins: &[Origin]) -> String {
    let mut table = Table::new([
        "reference",
        "spp",
        "RMSE",
        "reference noise",
        "own noise",
        "ratio",
        "slope",
        "audit / RMSE",
        "bias",
        "bias in errors",
        "furnace",
        "s",
    ]);
    for measurement in measurements {
        let Some(point) = measurement.points.last() else { continue };
        let noise = measurement.reference_noise;
        let slope = match measurement.slope() {
            // Several sample counts, but the reference is too noisy to show a falling error.
            None if measurement.points.len() > 1 => "at floor".to_owned(),
            slope => known(slope, 2),
        };
        let truth = point.rmse_to_truth(noise);
        // An error far below the reference's noise cannot be read off the difference.
        let has_audit = point.audited_rmse > 0.0 && truth > 0.5 * noise;
        let furnace =
            if point.analytic_error > 0.0 { format!("{:.2} %", 100.0 * point.analytic_error) } else { "-".to_owned() };
        table.push([
            measurement.name.clone(),
            point.samples.to_string(),
            format!("{:.5}", point.rmse),
            format!("{noise:.5}"),
            format!("{:.5}", point.own_noise),
            format!("{:.3}", point.ratio(noise)),
            slope,
            known(has_audit.then(|| point.audited_rmse / truth), 2),
            format!("{:+.2} %", 100.0 * point.bias),
            format!("{:+.1}", point.bias_in_errors),
            furnace,
            format!("{:.1}", point.render_secs),
        ]);
    }
    describe(origins.iter(), &[]) + &table.markdown()
}
