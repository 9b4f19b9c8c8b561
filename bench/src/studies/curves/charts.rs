//! Plots of error over seconds and over rays, and of audited over measured error.

use std::path::Path;

use surfelcast::Failure;

use crate::report::chart::{Chart, ChartPoint, Series};
use crate::studies::curves::curve::{Curve, Point};
use crate::studies::curves::report::{by_case, means_over_cases};

/// Label of the axis of errors.
const RMSE: &str = "RMSE, tone-mapped, without the noise of the truth";

/// Error over seconds and over rays for each case, and one plot of geometric means over all.
pub(super) fn write(curves: &[Curve], folder: &Path, study: &str) -> Result<(), Failure> {
    for (case, of_case) in by_case(curves) {
        let series = |cost: fn(&Point) -> f64| {
            of_case
                .iter()
                .map(|curve| Series {
                    label: curve.key.variant.label(),
                    points: curve
                        .points
                        .iter()
                        .map(|point| ChartPoint {
                            x: cost(point),
                            y: point.error,
                            std_error: point.rmse_std_error.unwrap_or(0.0),
                        })
                        .collect(),
                })
                .collect()
        };
        let noise = of_case.first().map_or(0.0, |curve| curve.truth_noise);
        let chart = |x_label: &str, series: Vec<Series>| Chart {
            title: case.to_owned(),
            x_label: x_label.to_owned(),
            y_label: RMSE.to_owned(),
            series,
            level: Some((noise, "noise of the truth".to_owned())),
            shows_front: false,
            shows_agreement: false,
        };
        chart("seconds of rendering", series(|point| point.secs))
            .write(&folder.join(format!("{study}-{case}-seconds.svg")))?;
        chart("rays of all kinds", series(Point::rays)).write(&folder.join(format!("{study}-{case}-rays.svg")))?;
        audit_chart(case, &of_case).write(&folder.join(format!("{study}-{case}-audit.svg")))?;
    }
    let series = means_over_cases(curves)
        .into_iter()
        .map(|(label, points)| Series {
            label,
            points: points.into_iter().map(|[x, y]| ChartPoint { x, y, std_error: 0.0 }).collect(),
        })
        .collect();
    let count = by_case(curves).len();
    Chart {
        title: format!("Geometric means over {count} {}", if count == 1 { "image" } else { "images" }),
        x_label: "seconds of rendering".to_owned(),
        y_label: RMSE.to_owned(),
        series,
        level: None,
        shows_front: true,
        shows_agreement: false,
    }
    .write(&folder.join(format!("{study}-pareto.svg")))?;
    Ok(())
}

/// The renderer's own estimate over the measured error; points on the dashed line agree.
fn audit_chart(case: &str, of_case: &[&Curve]) -> Chart {
    let audited = |point: &Point| {
        let std_error = point.audited_std_error.unwrap_or(0.0);
        Some(ChartPoint { x: point.error, y: point.audited_rmse?, std_error })
    };
    let series = of_case
        .iter()
        .map(|curve| Series {
            label: curve.key.variant.label(),
            points: curve.points.iter().filter_map(audited).collect(),
        })
        .collect();
    Chart {
        title: format!("{case}: error audit"),
        x_label: "RMSE, measured".to_owned(),
        y_label: "RMSE, audited".to_owned(),
        series,
        level: None,
        shows_front: false,
        shows_agreement: true,
    }
}
