//! Indirect light by each reconstruction and by path tracing, at equal rays.

use surfelcast::Failure;

use crate::report::{Page, Table, known};
use crate::studies::curves::{
    self, Curve, CurvesArgs, Point, Question, RequestedSize, Variant, VariantLists, by_case, conditions, or_default,
};

pub(super) const QUESTION: Question = Question {
    page: Page { name: "reconstructions", template: include_str!("../../pages/reconstructions.md.in") },
    samples: 256,
    replicates: 2,
    scenes: &[],
    built_in: &[],
    // Small enough for a path-traced truth of many samples; large enough that a first frame has few rays per pixel,
    // since surfels are a few pixels large.
    size: Some(RequestedSize::Both([192, 144])),
    is_indirect: true,
    variants,
};

/// Rays per pixel at which errors are compared.
const RAYS_PER_PIXEL: [f64; 9] = [2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0];

pub(super) fn run(args: &CurvesArgs) -> Result<(), Failure> {
    curves::run(&QUESTION, args, table)
}

/// Without settling, and without sharing samples with neighbours in place of a reconstruction: what each contributes
/// itself.
fn variants(requested: &VariantLists) -> Result<Vec<Variant>, Failure> {
    let mut lists = requested.clone();
    lists.techniques = or_default(&requested.techniques, &["surfel", "path"]);
    lists.settings = or_default(&requested.settings, &["settling=off", "sharing=off"]);
    lists.all()
}

/// Error of the solve over that of each other way, rays of differences included. Columns without any ratio are left
/// out: a first frame may have more rays, and the last fewer.
fn table(curves: &[Curve]) -> String {
    let mut rows: Vec<([String; 2], Vec<Option<f64>>)> = Vec::new();
    for (case, of_case) in by_case(curves) {
        let named = |name: &str| {
            let is_it = |curve: &&&Curve| curve.key.variant.reconstruction.as_deref() == Some(name);
            of_case.iter().find(is_it).copied()
        };
        let Some(poisson) = named("poisson") else { continue };
        let path = of_case.iter().find(|curve| curve.key.variant.technique == "path").copied();
        let pixels = f64::from(poisson.key.size[0]) * f64::from(poisson.key.size[1]);
        let others = ["none", "regression", "image"].map(|name| (name, named(name)));
        let others = others.into_iter().chain([("path", path)]);
        for (row, (name, other)) in others.filter_map(|(name, other)| Some((name, other?))).enumerate() {
            let ratio = |rays: &f64| {
                let [ours, theirs] = [poisson, other].map(|curve| curve.error_at(Point::rays, rays * pixels));
                Some(ours? / theirs?)
            };
            let image = if row == 0 { case } else { "" };
            rows.push(([image, name].map(str::to_owned), RAYS_PER_PIXEL.iter().map(ratio).collect()));
        }
    }
    let columns: Vec<usize> =
        (0..RAYS_PER_PIXEL.len()).filter(|&column| rows.iter().any(|(_, ratios)| ratios[column].is_some())).collect();
    let heads = columns.iter().map(|&column| format!("{} rays per pixel", RAYS_PER_PIXEL[column]));
    let mut table = Table::new(["image", "RMSE of poisson over"].map(str::to_owned).into_iter().chain(heads));
    for (names, ratios) in rows {
        table.push(names.into_iter().chain(columns.iter().map(|&column| known(ratios[column], 2))));
    }
    conditions(curves) + &table.markdown()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::studies::curves::curve;

    fn surfel(reconstruction: &str, factor: f64) -> Curve {
        let mut one = curve("a_main_lambert", "surfel", 0.5);
        one.key.variant.reconstruction = Some(reconstruction.to_owned());
        for point in &mut one.points {
            point.error *= factor;
        }
        one
    }

    #[test]
    fn reconstructions_are_compared_at_equal_rays() {
        let text = table(&[surfel("none", 1.0), surfel("poisson", 0.5), curve("a_main_lambert", "path", 0.5)]);
        assert!(text.contains("| a_main_lambert | none | ") && text.contains("0.50"), "{text}");
        // A column that says nothing is not there.
        let columns = |line: &str| line.matches('|').count();
        let lines: Vec<&str> = text.lines().filter(|line| line.starts_with('|')).collect();
        assert!(columns(lines[0]) < 3 + RAYS_PER_PIXEL.len() && lines.iter().all(|l| columns(l) == columns(lines[0])));
    }
}
