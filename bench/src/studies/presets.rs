//! The presets of the surfel cache: what each costs and gives.

use surfelcast::Failure;

use crate::report::{Page, Table};
use crate::studies::curves::{
    self, Curve, CurvesArgs, GOALS, Question, Variant, VariantLists, audit_ratio, by_case, conditions, or_default,
    reached, root, with_error,
};

pub(super) const QUESTION: Question = Question {
    page: Page { name: "presets", template: include_str!("../../pages/presets.md.in") },
    samples: 64,
    replicates: 2,
    scenes: &[],
    built_in: &[],
    size: None,
    is_indirect: false,
    variants,
};

pub(super) fn run(args: &CurvesArgs) -> Result<(), Failure> {
    curves::run(&QUESTION, args, table)
}

fn variants(requested: &VariantLists) -> Result<Vec<Variant>, Failure> {
    let mut lists = requested.with_one_reconstruction();
    lists.techniques = or_default(&requested.techniques, &["surfel"]);
    lists.presets = or_default(&requested.presets, &["preview", "balanced", "high"]);
    lists.all()
}

fn table(curves: &[Curve]) -> String {
    let mut table = Table::new([
        "image",
        "preset",
        "surfels",
        "MiB",
        "s a frame",
        "solve adds",
        "s to .03",
        ".02",
        ".01",
        "frames",
        "s",
        "RMSE",
        "FLIP",
        "bias",
        "noise",
        "audit / RMSE",
    ]);
    for (case, of_case) in by_case(curves) {
        for (row, curve) in of_case.iter().enumerate() {
            let Some(p) = curve.points.last() else { continue };
            let mut label = curve.key.variant.preset.clone().unwrap_or_else(|| curve.key.variant.label());
            if let Some(reconstruction) = &curve.key.variant.reconstruction {
                label = format!("{label}, {reconstruction}");
            }
            let rest_secs = (p.gpu_secs - p.reconstruction_gpu_secs).max(1e-9);
            let costs = [
                if row == 0 { case } else { "" }.to_owned(),
                label,
                format!("{:.0}", p.surfels.unwrap_or(0.0)),
                (curve.memory_bytes[1] >> 20).to_string(),
                format!("{:.3}", p.secs / f64::from(p.samples)),
                format!("{:.0} %", 100.0 * p.reconstruction_gpu_secs / rest_secs),
            ];
            let errors = [
                p.samples.to_string(),
                format!("{:.2}", p.secs),
                with_error(p.error, p.rmse_std_error),
                format!("{:.3}", p.flip),
                root(p.bias_squared, p.bias_squared_std_error),
                root(p.variance, p.variance_std_error),
                audit_ratio(p),
            ];
            let secs = GOALS.map(|goal| reached(curve.secs_to(goal), 1.0));
            table.push(costs.into_iter().chain(secs).chain(errors));
        }
    }
    conditions(curves) + &table.markdown()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::studies::curves::curve;

    #[test]
    fn every_preset_has_a_row() {
        let mut high = curve("a_main_lambert", "surfel", 0.5);
        high.key.variant.preset = Some("high".to_owned());
        let text = table(&[curve("a_main_lambert", "surfel", 0.5), high]);
        assert!(text.contains("| a_main_lambert | surfel | ") && text.contains("|  | high | "), "{text}");
    }
}
