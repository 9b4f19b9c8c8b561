//! What the tables of curves share.

use surfelcast_measure::fit::Reached;

use crate::report::describe;
use crate::studies::curves::curve::{Curve, Point};

/// Tone-mapped RMSE whose costs are stated.
pub(crate) const GOALS: [f64; 3] = [0.03, 0.02, 0.01];

/// Cases in the order in which they were measured, with their curves.
pub(crate) fn by_case(curves: &[Curve]) -> Vec<(&str, Vec<&Curve>)> {
    let mut cases: Vec<(&str, Vec<&Curve>)> = Vec::new();
    for curve in curves {
        match cases.iter_mut().find(|(case, _)| *case == curve.key.case) {
            Some((_, of_case)) => of_case.push(curve),
            None => cases.push((&curve.key.case, vec![curve])),
        }
    }
    cases
}

/// Origin, replicates and truth, for the line above a table.
pub(crate) fn conditions(curves: &[Curve]) -> String {
    let Some(first) = curves.first() else { return String::new() };
    let rendered: Vec<_> = curves.iter().map(|curve| curve.key.truth.as_str()).filter(|t| t.contains(',')).collect();
    let truth = match rendered.first() {
        Some(truth) if rendered.len() == curves.len() => format!("truth: {truth}"),
        Some(truth) => format!("truth: references, else {truth}"),
        None => "truth: references".to_owned(),
    };
    let replicates = match first.key.replicates {
        1 => "1 replicate".to_owned(),
        count => format!("{count} replicates"),
    };
    describe(curves.iter().map(|curve| &curve.origin), &[replicates, truth])
}

/// A cost to a goal in units of `unit`, with `<` and `>` before bounds.
pub(crate) fn reached(value: Option<Reached>, unit: f64) -> String {
    match value {
        Some(Reached::Below(cost)) => Reached::Below(cost / unit).to_string(),
        Some(Reached::At(cost)) => Reached::At(cost / unit).to_string(),
        Some(Reached::Not(cost)) => Reached::Not(cost / unit).to_string(),
        None => "-".to_owned(),
    }
}

/// A value with its standard error, if known.
pub(crate) fn with_error(value: f64, std_error: Option<f64>) -> String {
    match std_error {
        Some(std_error) => format!("{value:.4} ± {std_error:.4}"),
        None => format!("{value:.4}"),
    }
}

/// Root of an estimated square, with a minus sign if the estimate is below zero. Its error is that of the square over
/// twice the root or, if that is not small, the root of the error.
pub(crate) fn root(square: Option<f64>, std_error: Option<f64>) -> String {
    let Some(square) = square else { return "-".to_owned() };
    let root = square.abs().sqrt();
    let std_error = std_error.map(|error| if error < square.abs() { error / (2.0 * root) } else { error.sqrt() });
    let sign = if square < 0.0 { "-" } else { "" };
    format!("{sign}{}", with_error(root, std_error))
}

/// The audited over the measured error.
pub(crate) fn audit_ratio(point: &Point) -> String {
    match point.audited_rmse {
        Some(audited) if point.error > 0.0 => format!("{:.2}", audited / point.error),
        _ => "-".to_owned(),
    }
}

/// Geometric means of seconds and error over cases, by variant and budget, for budgets that every case has.
pub(crate) fn means_over_cases(curves: &[Curve]) -> Vec<(String, Vec<[f64; 2]>)> {
    let case_count = by_case(curves).len();
    let mut labels: Vec<String> = Vec::new();
    for curve in curves {
        let label = curve.key.variant.label();
        if !labels.contains(&label) {
            labels.push(label);
        }
    }
    let points_of = |label: &String| {
        let of_label: Vec<_> = curves.iter().filter(|curve| curve.key.variant.label() == *label).collect();
        let budgets: Vec<u32> =
            of_label.first().iter().flat_map(|curve| &curve.points).map(|point| point.samples).collect();
        budgets
            .into_iter()
            .filter_map(|samples| {
                let points: Vec<&Point> = of_label
                    .iter()
                    .filter_map(|curve| curve.points.iter().find(|point| point.samples == samples))
                    .filter(|point| point.secs > 0.0 && point.error > 0.0)
                    .collect();
                let mean = |value: &dyn Fn(&Point) -> f64| {
                    (points.iter().map(|point| value(point).ln()).sum::<f64>() / points.len() as f64).exp()
                };
                (points.len() == case_count).then(|| [mean(&|point| point.secs), mean(&|point| point.error)])
            })
            .collect()
    };
    labels
        .into_iter()
        .map(|label| {
            let points = points_of(&label);
            (label, points)
        })
        .collect()
}
