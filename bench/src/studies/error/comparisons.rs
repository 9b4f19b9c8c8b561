//! Tables of one way to render beside others at the same cost.

use std::fmt::Write as _;

use crate::studies::error::record::{Curve, Point};
use crate::studies::error::tables::{by_case, conditions};

/// Rays a pixel at which reconstructions are compared.
const RAYS_PER_PIXEL: [f64; 9] = [2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0];

fn surfels<'a>(of_case: &[&'a Curve], is_it: impl Fn(&Curve) -> bool) -> Option<&'a Curve> {
    of_case.iter().find(|curve| curve.key.variant.technique == "surfel" && is_it(curve)).copied()
}

fn paths<'a>(of_case: &[&'a Curve]) -> Option<&'a Curve> {
    of_case.iter().find(|curve| curve.key.variant.technique == "path").copied()
}

fn has_knob(curve: &Curve, knob: &str) -> bool {
    curve.key.variant.knobs.iter().any(|own| own == knob)
}

/// Error of the cache alone at a cost. It may have nothing left to gain before that, and be done: its error stays.
fn cache_error_at(cache: &Curve, cost: fn(&Point) -> f64, at: f64) -> Option<f64> {
    let last = cache.points.last().filter(|last| at > cost(last));
    last.map(|last| last.error).or_else(|| cache.error_at(cost, at))
}

/// Budget at which a settling picture is worst beside the better of the cache alone and path tracing at the same cost, and how
/// much worse.
fn worst_beside<'a>(
    settled: &'a Curve,
    cache: &Curve,
    path: &Curve,
    cost: fn(&Point) -> f64,
) -> Option<(&'a Point, f64)> {
    let over_better = |point: &Point| {
        let at = cost(point);
        let better =
            [cache_error_at(cache, cost, at), path.error_at(cost, at)].into_iter().flatten().min_by(f64::total_cmp)?;
        (better > 0.0).then_some(point.error / better)
    };
    let ratios = settled.points.iter().filter_map(|point| Some((point, over_better(point)?)));
    ratios.max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Each picture while it settles: its error at every budget over the lesser of the cache's and the path tracer's after the
/// same rays and after the same seconds.
pub(super) fn settling(curves: &[Curve]) -> String {
    let mut text = conditions(curves)
        + "| picture | worst at equal rays | samples | worst at equal seconds | samples | last: samples | s | RMSE | cache alone | \
           path | slope |\n|---|---|---|---|---|---|---|---|---|---|---|\n";
    for (case, of_case) in by_case(curves) {
        let settled = surfels(&of_case, |curve| !has_knob(curve, "settling=0"));
        let cache = surfels(&of_case, |curve| has_knob(curve, "settling=0"));
        let (Some(settled), Some(cache), Some(path)) = (settled, cache, paths(&of_case)) else { continue };
        let Some(last) = settled.points.last() else { continue };
        let slope = settled.points.iter().rev().nth(2).filter(|point| point.error > 0.0 && last.error > 0.0);
        let slope = slope.map(|point| (last.error / point.error).ln() / (last.secs / point.secs).ln());
        let secs = |point: &Point| point.secs;
        let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.4}"));
        let worst = |cost| {
            let found = worst_beside(settled, cache, path, cost);
            found.map_or_else(|| "- | -".to_owned(), |(point, ratio)| format!("{ratio:.2} | {}", point.samples))
        };
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "| {case} | {} | {} | {} | {:.2} | {:.4} | {} | {} | {} |",
            worst(Point::rays),
            worst(secs),
            last.samples,
            last.secs,
            last.error,
            number(cache_error_at(cache, secs, last.secs)),
            number(path.error_at(secs, last.secs)),
            slope.map_or_else(|| "-".to_owned(), |slope| format!("{slope:.2}")),
        );
    }
    text
}

/// The solve over each of the others at equal rays, differences' rays counted. Numbers of rays that no picture says anything
/// about are left out: a first frame may have more, and the last fewer.
pub(super) fn reconstructions(curves: &[Curve]) -> String {
    let mut rows: Vec<(String, Vec<Option<f64>>)> = Vec::new();
    for (case, of_case) in by_case(curves) {
        let named = |name: &str| surfels(&of_case, |curve| curve.key.variant.reconstruction.as_deref() == Some(name));
        let Some(poisson) = named("poisson") else { continue };
        let pixels = f64::from(poisson.key.size[0]) * f64::from(poisson.key.size[1]);
        let others = ["none", "regression", "image"].map(|name| (name, named(name)));
        let others = others.into_iter().chain([("path", paths(&of_case))]);
        for (row, (name, other)) in others.filter_map(|(name, other)| Some((name, other?))).enumerate() {
            let ratio = |rays: &f64| {
                let [ours, theirs] = [poisson, other].map(|curve| curve.error_at(Point::rays, rays * pixels));
                Some(ours? / theirs?)
            };
            let picture = if row == 0 { case } else { "" };
            rows.push((format!("| {picture} | {name}"), RAYS_PER_PIXEL.iter().map(ratio).collect()));
        }
    }
    let columns: Vec<usize> =
        (0..RAYS_PER_PIXEL.len()).filter(|&column| rows.iter().any(|(_, ratios)| ratios[column].is_some())).collect();
    let heads: Vec<_> = columns.iter().map(|&column| format!("{} rays a pixel", RAYS_PER_PIXEL[column])).collect();
    let mut text = conditions(curves);
    let _ = writeln!(
        text,
        "| picture | RMSE of poisson over | {} |\n|---|---|{}",
        heads.join(" | "),
        "---|".repeat(heads.len())
    );
    for (head, ratios) in &rows {
        let cell = |&column: &usize| ratios[column].map_or_else(|| "-".to_owned(), |ratio| format!("{ratio:.2}"));
        let cells: Vec<_> = columns.iter().map(cell).collect();
        let _ = writeln!(text, "{head} | {} |", cells.join(" | "));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::studies::error::record::tests::curve;

    fn surfel(knob: &str, reconstruction: &str, factor: f64) -> Curve {
        let mut one = curve("a_main_lambert", "surfel", 0.5);
        one.key.variant.knobs = vec![knob.to_owned()];
        one.key.variant.reconstruction = Some(reconstruction.to_owned());
        for point in &mut one.points {
            point.error *= factor;
        }
        one
    }

    #[test]
    fn settling_is_judged_by_the_better_of_both() {
        let curves = [
            surfel("settling=1", "poisson", 0.6),
            surfel("settling=0", "poisson", 0.5),
            curve("a_main_lambert", "path", 0.5),
        ];
        let text = settling(&curves);
        let columns = text.lines().find(|line| line.contains("a_main_lambert")).unwrap().split('|').map(str::trim);
        assert_eq!(columns.skip(2).step_by(2).take(2).collect::<Vec<_>>(), ["1.20", "1.20"], "{text}");
        assert!(text.trim_end().ends_with("-0.50 |"), "{text}");
    }

    #[test]
    fn reconstructions_are_compared_at_equal_rays() {
        let curves = [
            surfel("settling=0", "none", 1.0),
            surfel("settling=0", "poisson", 0.5),
            curve("a_main_lambert", "path", 0.5),
        ];
        let text = reconstructions(&curves);
        assert!(text.contains("| a_main_lambert | none | "), "{text}");
        assert!(text.contains("0.50"), "{text}");
        // A column that says nothing is not there.
        let columns = |line: &str| line.matches('|').count();
        let lines: Vec<&str> = text.lines().filter(|line| line.starts_with('|')).collect();
        assert!(columns(lines[0]) < 3 + RAYS_PER_PIXEL.len() && lines.iter().all(|l| columns(l) == columns(lines[0])));
    }
}
