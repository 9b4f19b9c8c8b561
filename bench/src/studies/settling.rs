//! An image that converges to the path-traced one, next to the cache alone and to path tracing, at equal cost.

use surfelcast::Failure;

use crate::report::{Page, Table, known};
use crate::studies::curves::{
    self, Curve, CurvesArgs, Point, Question, RequestedSize, Variant, VariantLists, by_case, conditions, or_default,
};

pub(super) const QUESTION: Question = Question {
    page: Page { name: "settling", template: include_str!("../../pages/settling.md.in") },
    samples: 1024,
    replicates: 2,
    scenes: &[],
    built_in: &[],
    size: None,
    is_indirect: false,
    variants,
};

/// The same in images of few pixels, for every reference.
pub(super) const SMALL: Question = Question {
    page: Page { name: "settling-small", template: include_str!("../../pages/settling-small.md.in") },
    samples: 512,
    replicates: 1,
    scenes: &[curves::EVERY_REFERENCE],
    size: Some(RequestedSize::Width(32)),
    ..QUESTION
};

/// The setting with which the cache is alone.
const ALONE: &str = "settling=off";

pub(super) fn run(args: &CurvesArgs) -> Result<(), Failure> {
    curves::run(&QUESTION, args, table)
}

pub(super) fn run_small(args: &CurvesArgs) -> Result<(), Failure> {
    curves::run(&SMALL, args, table)
}

fn variants(requested: &VariantLists) -> Result<Vec<Variant>, Failure> {
    let mut lists = requested.with_one_reconstruction();
    lists.techniques = or_default(&requested.techniques, &["surfel", "path"]);
    lists.settings = or_default(&requested.settings, &["settling=on,off"]);
    lists.all()
}

/// Error of the cache alone at a cost. It may have converged before and be done: then its error stays.
fn cache_error_at(cache: &Curve, cost: fn(&Point) -> f64, at: f64) -> Option<f64> {
    let last = cache.points.last().filter(|last| at > cost(last));
    last.map(|last| last.error).or_else(|| cache.error_at(cost, at))
}

/// The budget at which the error is largest relative to the lesser of the cache's and the path tracer's at the same
/// cost, and that ratio.
fn worst_ratio<'a>(
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

fn table(curves: &[Curve]) -> String {
    let mut table = Table::new([
        "image",
        "worst at equal rays",
        "samples",
        "worst at equal seconds",
        "samples",
        "last: samples",
        "s",
        "RMSE",
        "cache alone",
        "path",
        "slope",
    ]);
    for (case, of_case) in by_case(curves) {
        let has = |curve: &Curve, setting: &str| curve.key.variant.settings.iter().any(|own| own == setting);
        let find = |technique: &str, is_alone: bool| {
            let is_it = |curve: &&&Curve| curve.key.variant.technique == technique && has(curve, ALONE) == is_alone;
            of_case.iter().find(is_it).copied()
        };
        let (Some(settled), Some(cache), Some(path)) =
            (find("surfel", false), find("surfel", true), find("path", false))
        else {
            continue;
        };
        let Some(last) = settled.points.last() else { continue };
        let before = settled.points.iter().rev().nth(2).filter(|point| point.error > 0.0 && last.error > 0.0);
        let slope = before.map(|point| (last.error / point.error).ln() / (last.secs / point.secs).ln());
        let secs = |point: &Point| point.secs;
        let worst = |cost| match worst_ratio(settled, cache, path, cost) {
            Some((point, ratio)) => [format!("{ratio:.2}"), point.samples.to_string()],
            None => ["-".to_owned(), "-".to_owned()],
        };
        let end = [
            last.samples.to_string(),
            format!("{:.2}", last.secs),
            format!("{:.4}", last.error),
            known(cache_error_at(cache, secs, last.secs), 4),
            known(path.error_at(secs, last.secs), 4),
            known(slope, 2),
        ];
        table.push([case.to_owned()].into_iter().chain(worst(Point::rays)).chain(worst(secs)).chain(end));
    }
    conditions(curves) + &table.markdown()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::studies::curves::curve;

    fn surfel(setting: &str, factor: f64) -> Curve {
        let mut one = curve("a_main_lambert", "surfel", 0.5);
        one.key.variant.settings = vec![setting.to_owned()];
        for point in &mut one.points {
            point.error *= factor;
        }
        one
    }

    #[test]
    fn settling_is_judged_by_the_better_of_both() {
        let curves = [surfel("settling=on", 0.6), surfel("settling=off", 0.5), curve("a_main_lambert", "path", 0.5)];
        let text = table(&curves);
        let columns = text.lines().find(|line| line.contains("a_main_lambert")).unwrap().split('|').map(str::trim);
        assert_eq!(columns.skip(2).step_by(2).take(2).collect::<Vec<_>>(), ["1.20", "1.20"], "{text}");
        assert!(text.trim_end().ends_with("-0.50 |"), "{text}");
    }
}
