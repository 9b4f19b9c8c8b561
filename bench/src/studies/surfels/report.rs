//! The tables of the surfel cache.

use surfelcast_measure::Point;

use crate::report::{Table, describe, known};
use crate::studies::surfels::measure::FRAMES;
use crate::studies::surfels::{Outcome, Part, Row};

/// Name of a table on the page.
pub(super) fn name(part: Part) -> &'static str {
    match part {
        Part::Gates => "gates",
        Part::Radii => "radii",
        Part::Indirect => "indirect",
    }
}

/// Errors of all rows, for CSV.
pub(super) fn rows(rows: &[Row]) -> Table {
    let mut table =
        Table::new(["part", "at", "error_early", "error_late", "path_error", "path_samples", "commit", "device"]);
    for Row { key, origin, result } in rows {
        let number = |value: Option<f64>| value.map(|value| format!("{value:.6e}")).unwrap_or_default();
        let (early, late, path, samples) = match result {
            Outcome::Gate { noise, early, late, path, .. } => (
                early.rmse_to_truth(*noise),
                Some(late.rmse_to_truth(*noise)),
                Some(path.rmse_to_truth(*noise)),
                Some(path.samples),
            ),
            Outcome::Radius { noise, early, late } => {
                (early.rmse_to_truth(*noise), Some(late.rmse_to_truth(*noise)), None, None)
            }
            Outcome::Indirect { ours, theirs, samples, .. } => (*ours, None, Some(*theirs), Some(*samples)),
        };
        table.push([
            name(key.part).to_owned(),
            key.at.clone(),
            number(Some(early)),
            number(late),
            number(path),
            samples.map(|samples| samples.to_string()).unwrap_or_default(),
            origin.commit.clone(),
            origin.device.clone(),
        ]);
    }
    table
}

pub(super) fn markdown(part: Part, rows: &[Row]) -> String {
    let columns: &[&str] = match part {
        Part::Gates => &[
            "reference",
            "gate",
            "32 frames",
            "path, equal rays",
            "ratio",
            "64 frames",
            "audit / RMSE",
            "bias",
            "surfels",
            "s a frame",
        ],
        Part::Radii => &["radius, pixels", "surfels", "32 frames", "64 frames", "s a frame"],
        Part::Indirect => &["reference", "light", "size", "32 frames", "path, equal rays", "ratio"],
    };
    let mut table = Table::new(columns.iter().copied());
    for row in rows {
        table.push(cells(row));
    }
    describe(rows.iter().map(|row| &row.origin), &[]) + &table.markdown()
}

fn cells(Row { key, result, .. }: &Row) -> Vec<String> {
    let error = |value: f64| format!("{value:.4}");
    let frame_secs = |late: &Point| format!("{:.2}", late.render_secs / 2.0 / f64::from(FRAMES[1]));
    match result {
        Outcome::Gate { gate, noise, early, late, path } => {
            let [ours, theirs, end] = [early, path, late].map(|point| point.rmse_to_truth(*noise));
            vec![
                key.at.clone(),
                gate.to_string(),
                error(ours),
                format!("{theirs:.4} ({} spp)", path.samples),
                format!("{:.2}", ours / theirs),
                error(end),
                known((late.audited_rmse > 0.0).then(|| late.audited_rmse / end), 2),
                format!("{:+.2} %", 100.0 * late.bias),
                late.surfels.to_string(),
                frame_secs(late),
            ]
        }
        Outcome::Radius { noise, early, late } => vec![
            key.at.clone(),
            late.surfels.to_string(),
            error(early.rmse_to_truth(*noise)),
            error(late.rmse_to_truth(*noise)),
            frame_secs(late),
        ],
        Outcome::Indirect { is_indirect, size, ours, theirs, samples } => vec![
            key.at.clone(),
            if *is_indirect { "indirect" } else { "all" }.to_owned(),
            format!("{}x{}", size[0], size[1]),
            error(*ours),
            format!("{theirs:.4} ({samples} spp)"),
            known((*theirs > 1e-4).then(|| ours / theirs), 2),
        ],
    }
}
