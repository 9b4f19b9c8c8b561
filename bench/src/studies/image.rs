//! Indirect light reconstructed in the image, from the published scheme (Noack 2022) to ours, next to other
//! reconstructions.

use surfelcast::Failure;

use crate::report::{Page, Table};
use crate::studies::curves::{self, Curve, CurvesArgs, Question, Variant, VariantLists, by_case, conditions};

pub(super) const QUESTION: Question = Question {
    page: Page { name: "image", template: include_str!("../../pages/image.md.in") },
    samples: 32,
    replicates: 2,
    scenes: &["cornell_box", "bars", "classroom"],
    built_in: &[],
    size: None,
    is_indirect: true,
    variants,
};

/// Frames after which errors are stated.
const FRAMES: [u32; 3] = [2, 8, 32];

pub(super) fn run(args: &CurvesArgs) -> Result<(), Failure> {
    curves::run(&QUESTION, args, table)
}

/// Not every combination: the scheme means something in the image only. Surfels share no samples with neighbours in
/// either.
fn variants(requested: &VariantLists) -> Result<Vec<Variant>, Failure> {
    let rows = [("image", "image=unscreened,summed,unmasked,masked,weighed"), ("none", ""), ("poisson", "")];
    let mut variants = Vec::new();
    for (reconstruction, scheme) in rows {
        let mut lists = requested.clone();
        lists.techniques = vec!["surfel".to_owned()];
        lists.reconstructions = vec![reconstruction.to_owned()];
        let settings = ["sharing=off", scheme].into_iter().filter(|setting| !setting.is_empty());
        lists.settings.extend(settings.map(str::to_owned));
        variants.extend(lists.all()?);
    }
    Ok(variants)
}

/// What a variant solves.
fn scheme(variant: &Variant) -> &'static str {
    let has = |setting: &str| variant.settings.iter().any(|known| known == setting);
    match variant.reconstruction.as_deref() {
        Some("image") if has("image=unscreened") => {
            "slopes of all overlapping surfels summed, values nearly ignored (`image=unscreened`)"
        }
        Some("image") if has("image=summed") => "slopes of all overlapping surfels summed (`image=summed`)",
        Some("image") if has("image=unmasked") => "normalised weights (`image=unmasked`)",
        Some("image") if has("image=masked") => "normalised weights, masked (`image=masked`)",
        Some("image") => "normalised weights, masked, weighted by noise (`image=weighed`, the default)",
        Some("poisson") => "over the neighbours of surfels (`poisson`)",
        _ => "nothing (`none`)",
    }
}

/// Schemes down, images and frames across: error of indirect light.
fn table(curves: &[Curve]) -> String {
    let cases = by_case(curves);
    let heads = cases
        .iter()
        .flat_map(|(case, _)| FRAMES.map(|frames| format!("{case}: {frames} frames").replace("_main_indirect", "")));
    let mut table = Table::new(["what is solved".to_owned()].into_iter().chain(heads));
    let first = cases.first().map(|(_, of_case)| of_case.as_slice()).unwrap_or_default();
    for Curve { key, .. } in first {
        let cells = cases.iter().flat_map(|(_, of_case)| {
            FRAMES.map(|frames| {
                let curve = of_case.iter().find(|curve| curve.key.variant == key.variant);
                let point = curve.and_then(|curve| curve.points.iter().find(|point| point.samples == frames));
                crate::report::known(point.map(|point| point.error), 4)
            })
        });
        table.push([scheme(&key.variant).to_owned()].into_iter().chain(cells));
    }
    conditions(curves) + &table.markdown()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::studies::curves::curve;

    #[test]
    fn schemes_are_rows_and_images_with_frames_are_columns() {
        let mut curves = Vec::new();
        for case in ["a_main_indirect", "b_main_indirect"] {
            for (reconstruction, setting) in [("image", "image=summed"), ("none", "sharing=off")] {
                let mut one = curve(case, "surfel", 0.5);
                one.key.variant.reconstruction = Some(reconstruction.to_owned());
                one.key.variant.settings = vec![setting.to_owned()];
                curves.push(one);
            }
        }
        let text = table(&curves);
        assert!(text.contains("| what is solved | a: 2 frames | a: 8 frames |"), "{text}");
        assert!(text.contains("(`image=summed`) |") && text.contains("| nothing (`none`) |"), "{text}");
        let table = text.split("\n\n").last().unwrap_or_default();
        assert!(table.lines().all(|line| line.matches('|').count() == 8), "{text}");
    }
}
