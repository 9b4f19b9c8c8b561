//! Capacity and density of surfels, as in table 6.1 of Noack 2022.

use std::fmt::Write as _;

use surfelcast::Failure;

use crate::report::{Page, Table};
use crate::studies::curves::{
    self, Curve, CurvesArgs, Question, Variant, VariantLists, by_case, conditions, or_default,
};

pub(super) const QUESTION: Question = Question {
    page: Page { name: "densities", template: include_str!("../../pages/densities.md.in") },
    samples: 32,
    replicates: 2,
    scenes: &["cornell_box"],
    built_in: &["demo:cornell_box"],
    size: None,
    is_indirect: false,
    variants,
};

pub(super) fn run(args: &CurvesArgs) -> Result<(), Failure> {
    curves::run(&QUESTION, args, tables)
}

fn variants(requested: &VariantLists) -> Result<Vec<Variant>, Failure> {
    let mut lists = requested.with_one_reconstruction();
    lists.techniques = or_default(&requested.techniques, &["surfel"]);
    lists.settings = or_default(&requested.settings, &["radius=2,3,6", "capacity=65536,131072,262144,524288,1048576"]);
    lists.all()
}

fn setting(curve: &Curve, name: &str) -> Option<f64> {
    let value = |setting: &String| setting.strip_prefix(name)?.strip_prefix('=')?.parse().ok();
    curve.key.variant.settings.iter().find_map(value)
}

/// Capacity across, density down: error, surfels in use and time of a frame.
fn tables(curves: &[Curve]) -> String {
    let mut text = conditions(curves);
    for (case, of_case) in by_case(curves) {
        let values = |name: &str| {
            let mut values: Vec<f64> = of_case.iter().filter_map(|curve| setting(curve, name)).collect();
            values.sort_by(f64::total_cmp);
            values.dedup();
            values
        };
        let (capacities, radii) = (values("capacity"), values("radius"));
        let Some(samples) = of_case.iter().filter_map(|curve| curve.points.last()).map(|p| p.samples).min() else {
            continue;
        };
        let heads = capacities.iter().map(|capacity| format!("2^{} surfels", capacity.log2()));
        let mut table = Table::new(["radius, pixels".to_owned()].into_iter().chain(heads));
        for &radius in &radii {
            let cells = capacities.iter().map(|&capacity| {
                let is_it = |curve: &&&Curve| {
                    setting(curve, "radius") == Some(radius) && setting(curve, "capacity") == Some(capacity)
                };
                let curve = of_case.iter().find(is_it);
                let point = curve.and_then(|curve| curve.points.iter().find(|point| point.samples == samples));
                point.map_or_else(
                    || "-".to_owned(),
                    |p| {
                        let surfels = p.surfels.unwrap_or(0.0);
                        format!("{:.4} ({surfels:.0}, {:.2})", p.error, p.secs / f64::from(p.samples))
                    },
                )
            });
            table.push([radius.to_string()].into_iter().chain(cells));
        }
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "{case} after {samples} frames: RMSE (surfels in use, seconds a frame)\n\n{}",
            table.markdown()
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::studies::curves::curve;

    #[test]
    fn densities_are_a_matrix() {
        let mut curves = Vec::new();
        for radius in [2, 3] {
            for capacity in [65536, 131_072] {
                let mut one = curve("a_main_lambert", "surfel", 0.5);
                one.key.variant.settings = vec![format!("radius={radius}"), format!("capacity={capacity}")];
                curves.push(one);
            }
        }
        let text = tables(&curves);
        assert!(text.contains("| radius, pixels | 2^16 surfels | 2^17 surfels |"), "{text}");
        assert!(text.contains("| 3 | 0.0125 (0, 0.50) | 0.0125 (0, 0.50) |"), "{text}");
    }
}
