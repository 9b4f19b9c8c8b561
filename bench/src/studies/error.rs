//! Error against seconds and rays, of every technique and reconstruction.

use surfelcast::Failure;

use crate::report::{Page, Table};
use crate::studies::curves::{
    self, Curve, CurvesArgs, GOALS, Question, VariantLists, audit_ratio, by_case, conditions, means_over_cases,
    reached, root, with_error,
};

pub(super) const QUESTION: Question = Question {
    page: Page { name: "error", template: include_str!("../../pages/error.md.in") },
    samples: 256,
    replicates: 3,
    scenes: &[],
    built_in: &[],
    size: None,
    is_indirect: false,
    variants: VariantLists::all,
};

pub(super) fn run(args: &CurvesArgs) -> Result<(), Failure> {
    curves::run(&QUESTION, args, tables)
}

/// Costs to errors, everything known at the last budget, and the Pareto front.
fn tables(curves: &[Curve]) -> String {
    format!(
        "{}Seconds and millions of rays to an RMSE:\n\n{}\nAt the last budget:\n\n{}\n{}",
        conditions(curves),
        costs(curves).markdown(),
        last_budgets(curves).markdown(),
        front(curves)
    )
}

fn costs(curves: &[Curve]) -> Table {
    let mut table = Table::new(["image", "technique", "s to .03", ".02", ".01", "Mrays to .03", ".02", ".01"]);
    for (case, of_case) in by_case(curves) {
        for (row, curve) in of_case.iter().enumerate() {
            let name = if row == 0 { case } else { "" };
            let secs = GOALS.map(|goal| reached(curve.secs_to(goal), 1.0));
            let rays = GOALS.map(|goal| reached(curve.rays_to(goal), 1e6));
            table.push([name.to_owned(), curve.key.variant.label()].into_iter().chain(secs).chain(rays));
        }
    }
    table
}

fn last_budgets(curves: &[Curve]) -> Table {
    let mut table = Table::new([
        "image",
        "technique",
        "samples",
        "s",
        "of that GPU",
        "Mrays camera, further, shadow",
        "RMSE",
        "rel. MSE",
        "FLIP",
        "bias",
        "noise",
        "mean",
        "audit / RMSE",
    ]);
    for (case, of_case) in by_case(curves) {
        for (row, curve) in of_case.iter().enumerate() {
            let Some(p) = curve.points.last() else { continue };
            let rays = [p.rays_primary, p.rays_secondary, p.rays_shadow].map(|rays| format!("{:.2}", rays / 1e6));
            table.push([
                if row == 0 { case } else { "" }.to_owned(),
                curve.key.variant.label(),
                p.samples.to_string(),
                format!("{:.2}", p.secs),
                format!("{:.2}", p.gpu_secs),
                rays.join(", "),
                with_error(p.error, p.rmse_std_error),
                format!("{:.4}", p.relative_mse),
                format!("{:.3}", p.flip),
                root(p.bias_squared, p.bias_squared_std_error),
                root(p.variance, p.variance_std_error),
                format!("{:+.2} %", 100.0 * p.mean_bias),
                audit_ratio(p),
            ]);
        }
    }
    table
}

/// The Pareto front of the means over images: points with neither less error nor fewer seconds anywhere else.
fn front(curves: &[Curve]) -> String {
    let means = means_over_cases(curves);
    let all: Vec<(&str, [f64; 2])> =
        means.iter().flat_map(|(label, points)| points.iter().map(|point| (label.as_str(), *point))).collect();
    let is_beaten = |[x, y]: [f64; 2]| all.iter().any(|(_, [a, b])| *a <= x && *b <= y && (*a < x || *b < y));
    let mut best: Vec<_> = all.iter().filter(|(_, point)| !is_beaten(*point)).collect();
    best.sort_by(|a, b| a.1[0].total_cmp(&b.1[0]));
    let list: Vec<_> = best.iter().map(|(label, [secs, error])| format!("{label} ({secs:.2} s, {error:.4})")).collect();
    format!("Best of all in geometric means over the images: {}.\n", list.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::studies::curves::curve;

    #[test]
    fn the_tables_have_one_width() {
        let curves = [curve("a_main_lambert", "path", 0.5), curve("b_main_lambert", "path", 0.5)];
        let text = tables(&curves);
        for table in text.split("\n\n").filter(|part| part.starts_with('|')) {
            let widths: Vec<_> = table.lines().map(|line| line.matches('|').count()).collect();
            assert!(widths.windows(2).all(|pair| pair[0] == pair[1]), "{table}");
        }
        assert!(text.contains("| a_main_lambert | path | "), "{text}");
    }

    #[test]
    fn the_front_is_what_nothing_beats() {
        // The slower one has the same errors.
        let curves = [curve("a_main_lambert", "path", 1.0), curve("a_main_lambert", "surfel", 0.5)];
        let text = front(&curves);
        assert!(text.contains("surfel (0.50 s, 0.1000)") && !text.contains("path ("), "{text}");
    }
}
