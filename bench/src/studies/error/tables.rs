//! Curves as Markdown tables and plots.

use std::fmt::Write as _;
use std::path::Path;

use crate::report::chart::{Chart, ChartPoint, Series};
use surfelcast_measure::fit::Reached;

use crate::studies::error::record::{Curve, Point};
use crate::studies::error::variant::Variant;
use surfelcast::Failure;

/// Tone-mapped RMSE whose costs are told.
pub(super) const GOALS: [f64; 3] = [0.03, 0.02, 0.01];

/// Cases in the order in which they were measured, with their curves.
pub(super) fn by_case(curves: &[Curve]) -> Vec<(&str, Vec<&Curve>)> {
    let mut cases: Vec<(&str, Vec<&Curve>)> = Vec::new();
    for curve in curves {
        match cases.iter_mut().find(|(case, _)| *case == curve.key.case) {
            Some((_, of_case)) => of_case.push(curve),
            None => cases.push((&curve.key.case, vec![curve])),
        }
    }
    cases
}

/// Device, truth and draws, for the line above a table.
pub(super) fn conditions(curves: &[Curve]) -> String {
    let Some(first) = curves.first() else { return String::new() };
    let rendered: Vec<_> = curves.iter().map(|curve| curve.key.truth.as_str()).filter(|t| t.contains(',')).collect();
    let truth = match rendered.first() {
        Some(truth) if rendered.len() == curves.len() => format!("truth: {truth}"),
        Some(truth) => format!("truth: references, else {truth}"),
        None => "truth: references".to_owned(),
    };
    format!("{}; {} draws; {truth}.\n\n", first.key.device, first.key.replicates)
}

pub(super) fn reached(value: Option<Reached>, unit: f64) -> String {
    match value {
        Some(Reached::Below(cost)) => Reached::Below(cost / unit).to_string(),
        Some(Reached::At(cost)) => Reached::At(cost / unit).to_string(),
        Some(Reached::Not(cost)) => Reached::Not(cost / unit).to_string(),
        None => "-".to_owned(),
    }
}

/// A value with its standard error, if that is known.
fn with_error(value: f64, std_error: Option<f64>) -> String {
    match std_error {
        Some(std_error) => format!("{value:.4} ± {std_error:.4}"),
        None => format!("{value:.4}"),
    }
}

/// Root of an estimated square, which may come out below zero: then the sign says so. Its error is that of the square over
/// twice the root, or, where that is not small, the root of it.
fn root(square: Option<f64>, std_error: Option<f64>) -> String {
    let Some(square) = square else { return "-".to_owned() };
    let root = square.abs().sqrt();
    let std_error = std_error.map(|error| if error < square.abs() { error / (2.0 * root) } else { error.sqrt() });
    let sign = if square < 0.0 { "-" } else { "" };
    format!("{sign}{}", with_error(root, std_error))
}

fn audit_ratio(point: &Point) -> String {
    match point.audited_rmse {
        Some(audited) if point.error > 0.0 => format!("{:.2}", audited / point.error),
        _ => "-".to_owned(),
    }
}

/// Costs to errors, then everything known at the last budget.
pub(super) fn errors(curves: &[Curve]) -> String {
    let mut text = conditions(curves);
    text += "Seconds and millions of rays to an RMSE:\n\n\
             | picture | technique | s to .03 | .02 | .01 | Mrays to .03 | .02 | .01 |\n|---|---|---|---|---|---|---|---|\n";
    for (case, of_case) in by_case(curves) {
        for (row, curve) in of_case.iter().enumerate() {
            let secs = GOALS.map(|goal| reached(curve.secs_to(goal), 1.0)).join(" | ");
            let rays = GOALS.map(|goal| reached(curve.rays_to(goal), 1e6)).join(" | ");
            let name = if row == 0 { case } else { "" };
            // Writing to a string cannot fail.
            let _ = writeln!(text, "| {name} | {} | {secs} | {rays} |", curve.key.variant.label());
        }
    }
    text += "\nAt the last budget:\n\n\
             | picture | technique | samples | s | of that GPU | Mrays camera, further, shadow | RMSE | rel. MSE | FLIP | bias | \
             noise | mean | audit / RMSE |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n";
    for (case, of_case) in by_case(curves) {
        for (row, curve) in of_case.iter().enumerate() {
            let Some(p) = curve.points.last() else { continue };
            let name = if row == 0 { case } else { "" };
            let rays = [p.rays_primary, p.rays_secondary, p.rays_shadow].map(|rays| format!("{:.2}", rays / 1e6));
            let _ = writeln!(
                text,
                "| {name} | {} | {} | {:.2} | {:.2} | {} | {} | {:.4} | {:.3} | {} | {} | {:+.2} % | {} |",
                curve.key.variant.label(),
                p.samples,
                p.secs,
                p.gpu_secs,
                rays.join(", "),
                with_error(p.error, p.rmse_std_error),
                p.relative_mse,
                p.flip,
                root(p.bias_squared, p.bias_squared_std_error),
                root(p.variance, p.variance_std_error),
                100.0 * p.mean_bias,
                audit_ratio(p),
            );
        }
    }
    text + "\n" + &on_front(curves)
}

/// What nothing else beats: at each budget of the mean over pictures, who has the least error for the seconds.
fn on_front(curves: &[Curve]) -> String {
    let means = means_over_cases(curves);
    let all: Vec<(&str, [f64; 2])> =
        means.iter().flat_map(|(label, points)| points.iter().map(|point| (label.as_str(), *point))).collect();
    let is_beaten = |[x, y]: [f64; 2]| all.iter().any(|(_, [a, b])| *a <= x && *b <= y && (*a < x || *b < y));
    let mut best: Vec<_> = all.iter().filter(|(_, point)| !is_beaten(*point)).collect();
    best.sort_by(|a, b| a.1[0].total_cmp(&b.1[0]));
    let list: Vec<_> = best.iter().map(|(label, [secs, error])| format!("{label} ({secs:.2} s, {error:.4})")).collect();
    format!("Best of all in geometric means over pictures: {}.\n", list.join(", "))
}

/// Presets: what each costs and gives.
pub(super) fn presets(curves: &[Curve]) -> String {
    let mut text = conditions(curves)
        + "| picture | preset | surfels | MiB | s a frame | solve adds | s to .03 | .02 | .01 | frames | s | RMSE | FLIP | bias | \
           noise | audit / RMSE |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n";
    for (case, of_case) in by_case(curves) {
        for (row, curve) in of_case.iter().enumerate() {
            let Some(p) = curve.points.last() else { continue };
            let secs = GOALS.map(|goal| reached(curve.secs_to(goal), 1.0)).join(" | ");
            let mut label = curve.key.variant.preset.clone().unwrap_or_else(|| curve.key.variant.label());
            if let Some(reconstruction) = &curve.key.variant.reconstruction {
                label = format!("{label}, {reconstruction}");
            }
            let _ = writeln!(
                text,
                "| {} | {label} | {:.0} | {} | {:.3} | {:.0} % | {secs} | {} | {:.2} | {} | {:.3} | {} | {} | {} |",
                if row == 0 { case } else { "" },
                p.surfels.unwrap_or(0.0),
                curve.memory_bytes[1] >> 20,
                p.secs / f64::from(p.samples),
                100.0 * p.reconstruction_gpu_secs / (p.gpu_secs - p.reconstruction_gpu_secs).max(1e-9),
                p.samples,
                p.secs,
                with_error(p.error, p.rmse_std_error),
                p.flip,
                root(p.bias_squared, p.bias_squared_std_error),
                root(p.variance, p.variance_std_error),
                audit_ratio(p),
            );
        }
    }
    text
}

/// Capacity across, density down: error, surfels in use and time of a frame.
pub(super) fn densities(curves: &[Curve]) -> String {
    let knob = |curve: &Curve, name: &str| -> Option<f64> {
        curve.key.variant.knobs.iter().find_map(|knob| knob.strip_prefix(name)?.strip_prefix('=')?.parse().ok())
    };
    let mut text = conditions(curves);
    for (case, of_case) in by_case(curves) {
        let mut capacities: Vec<f64> = of_case.iter().filter_map(|curve| knob(curve, "capacity")).collect();
        let mut radii: Vec<f64> = of_case.iter().filter_map(|curve| knob(curve, "radius")).collect();
        for values in [&mut capacities, &mut radii] {
            values.sort_by(f64::total_cmp);
            values.dedup();
        }
        let Some(samples) = of_case.iter().filter_map(|curve| curve.points.last()).map(|p| p.samples).min() else {
            continue;
        };
        let _ = writeln!(text, "{case} after {samples} frames: RMSE (surfels in use, seconds a frame)\n");
        let heads: Vec<_> = capacities.iter().map(|capacity| format!("2^{} surfels", capacity.log2())).collect();
        let dashes = "---|".repeat(capacities.len());
        let _ = writeln!(text, "| radius, pixels | {} |\n|---|{dashes}", heads.join(" | "));
        for &radius in &radii {
            let cells: Vec<_> = capacities
                .iter()
                .map(|&capacity| {
                    let is_it = |curve: &&&Curve| {
                        knob(curve, "radius") == Some(radius) && knob(curve, "capacity") == Some(capacity)
                    };
                    let point = of_case
                        .iter()
                        .find(is_it)
                        .and_then(|curve| curve.points.iter().find(|point| point.samples == samples));
                    match point {
                        Some(p) => format!(
                            "{:.4} ({:.0}, {:.2})",
                            p.error,
                            p.surfels.unwrap_or(0.0),
                            p.secs / f64::from(p.samples)
                        ),
                        None => "-".to_owned(),
                    }
                })
                .collect();
            let _ = writeln!(text, "| {radius} | {} |", cells.join(" | "));
        }
    }
    text
}

/// Frames after which reconstruction in the image is looked at.
const IMAGE_FRAMES: [u32; 3] = [2, 8, 32];

/// What a variant of that study solves.
fn image_row(variant: &Variant) -> &'static str {
    let has = |knob: &str| variant.knobs.iter().any(|known| known == knob);
    match variant.reconstruction.as_deref() {
        Some("image") if has("image=4") => {
            "slopes of all overlapping surfels added up, values all but left out (`image=4`)"
        }
        Some("image") if has("image=3") => "slopes of all overlapping surfels added up (`image=3`)",
        Some("image") if has("image=2") => "normalised weights (`image=2`)",
        Some("image") if has("image=1") => "normalised weights, masked (`image=1`)",
        Some("image") => "normalised weights, masked, weighed by noise (`image=0`, the default)",
        Some("poisson") => "on the graph of surfels (`poisson`)",
        _ => "nothing (`none`)",
    }
}

/// Schemes down, pictures and frames across: error of indirect light.
pub(super) fn images(curves: &[Curve]) -> String {
    let cases = by_case(curves);
    let mut text = conditions(curves);
    let heads: Vec<_> = cases
        .iter()
        .flat_map(|(case, _)| {
            IMAGE_FRAMES.map(|frames| format!("{case}: {frames} frames").replace("_main_indirect", ""))
        })
        .collect();
    let _ = writeln!(text, "| what is solved | {} |\n|---|{}", heads.join(" | "), "---|".repeat(heads.len()));
    let rows = cases.iter().map(|(_, of_case)| of_case.len()).max().unwrap_or(0);
    for row in 0..rows {
        let Some(first) = cases.first().and_then(|(_, of_case)| of_case.get(row)) else { continue };
        let cells: Vec<_> = cases
            .iter()
            .flat_map(|(_, of_case)| {
                IMAGE_FRAMES.map(|frames| {
                    let curve = of_case.iter().find(|curve| curve.key.variant == first.key.variant);
                    let point = curve.and_then(|curve| curve.points.iter().find(|point| point.samples == frames));
                    point.map_or_else(|| "-".to_owned(), |point| format!("{:.4}", point.error))
                })
            })
            .collect();
        let _ = writeln!(text, "| {} | {} |", image_row(&first.key.variant), cells.join(" | "));
    }
    text
}

/// Geometric means of seconds and error over cases, by variant and budget, where every case has that budget.
fn means_over_cases(curves: &[Curve]) -> Vec<(String, Vec<[f64; 2]>)> {
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

/// The renderer's own estimate over the measured error; on the line where both agree.
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

/// Error over seconds and over rays, one plot each for each case, and one over all.
pub(super) fn charts(curves: &[Curve], folder: &Path, study: &str) -> Result<(), Failure> {
    let rmse = "RMSE, tone-mapped, noise of the truth taken out";
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
            y_label: rmse.to_owned(),
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
        title: format!("Geometric means over {count} {}", if count == 1 { "picture" } else { "pictures" }),
        x_label: "seconds of rendering".to_owned(),
        y_label: rmse.to_owned(),
        series,
        level: None,
        shows_front: true,
        shows_agreement: false,
    }
    .write(&folder.join(format!("{study}-pareto.svg")))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::studies::error::record::tests::curve;

    #[test]
    fn the_tables_have_one_width() {
        let curves = [curve("a_main_lambert", "path", 0.5), curve("b_main_lambert", "path", 0.5)];
        for text in [errors(&curves), presets(&curves)] {
            for table in text.split("\n\n").filter(|part| part.starts_with('|')) {
                let widths: Vec<_> = table.lines().map(|line| line.matches('|').count()).collect();
                assert!(widths.windows(2).all(|pair| pair[0] == pair[1]), "{table}");
            }
        }
        assert!(errors(&curves).contains("| a_main_lambert | path | "), "{}", errors(&curves));
    }

    #[test]
    fn densities_are_a_matrix() {
        let mut curves = Vec::new();
        for radius in [2, 3] {
            for capacity in [65536, 131_072] {
                let mut one = curve("a_main_lambert", "surfel", 0.5);
                one.key.variant.knobs = vec![format!("radius={radius}"), format!("capacity={capacity}")];
                curves.push(one);
            }
        }
        let text = densities(&curves);
        assert!(text.contains("| radius, pixels | 2^16 surfels | 2^17 surfels |"), "{text}");
        assert!(text.contains("| 3 | 0.0125 (0, 0.50) | 0.0125 (0, 0.50) |"), "{text}");
    }

    #[test]
    fn schemes_are_rows_and_pictures_with_frames_are_columns() {
        let mut curves = Vec::new();
        for case in ["a_main_indirect", "b_main_indirect"] {
            for (reconstruction, knob) in [("image", "image=3"), ("none", "sharing=0")] {
                let mut one = curve(case, "surfel", 0.5);
                one.key.variant.reconstruction = Some(reconstruction.to_owned());
                one.key.variant.knobs = vec![knob.to_owned()];
                curves.push(one);
            }
        }
        let text = images(&curves);
        assert!(text.contains("| what is solved | a: 2 frames | a: 8 frames |"), "{text}");
        assert!(text.contains("(`image=3`) |") && text.contains("| nothing (`none`) |"), "{text}");
        let table = text.split("\n\n").last().unwrap_or_default();
        assert!(table.lines().all(|line| line.matches('|').count() == 8), "{text}");
    }

    #[test]
    fn the_front_is_what_nothing_beats() {
        // The slower one is beaten everywhere but by nobody's error at the end.
        let curves = [curve("a_main_lambert", "path", 1.0), curve("a_main_lambert", "surfel", 0.5)];
        let text = on_front(&curves);
        assert!(text.contains("surfel (0.50 s, 0.1000)") && !text.contains("path ("), "{text}");
    }
}
