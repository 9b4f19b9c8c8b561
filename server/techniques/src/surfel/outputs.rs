//! Outputs of what the cache knows at each pixel.

use surfelcast_render_api::OutputDescription;

use crate::surfel::view::SurfelOutput;

/// Light over all lobes but the diffuse one, which the technique keeps apart.
pub(crate) const REFLECTION: &str = "reflection";

/// What is seen in the cache: id, earlier ids, label, meaning.
const fn seen(
    id: &'static str,
    aliases: &'static [&'static str],
    label: &'static str,
    help: &'static str,
) -> OutputDescription {
    OutputDescription { id, aliases, label, help, is_live: true, is_split: false }
}

/// All of them.
pub(crate) const OUTPUTS: &[OutputDescription] = &[
    OutputDescription {
        id: REFLECTION,
        aliases: &[],
        label: "Reflections",
        help: "light that arrives over mirrors, gloss and glass: everything but the diffuse lobe",
        is_live: false,
        is_split: true,
    },
    seen("surfel_id", &[], "Surfels: nearest", "the surfel with the largest weight, plus 1"),
    seen("surfel_radius", &[], "Surfels: radius", "mean radius, metres"),
    seen("surfel_coverage", &[], "Surfels: coverage", "sum of weights"),
    seen("surfel_weight", &[], "Surfels: largest weight", "share of the largest weight"),
    seen(
        "surfel_irradiance_over_pi",
        &["surfel_b"],
        "Surfels: irradiance over pi",
        "irradiance over pi of all light in the cache",
    ),
    seen("surfel_error", &[], "Surfels: error", "standard error of the luminance of irradiance over pi"),
    seen("surfel_rays", &[], "Surfels: rays", "rays behind the value"),
    seen("surfel_age", &[], "Surfels: age", "updates of the surfel with the largest weight"),
    seen("surfel_guide", &[], "Surfels: guiding direction", "direction in which its guiding table points, scene space"),
    seen("surfel_depth", &[], "Surfels: depth around", "mean distance around it, radii"),
    seen("surfel_cells", &[], "Surfels: grid entries read", "grid entries that a lookup reads"),
    seen("surfel_leaks", &[], "Surfels: leaks held back", "share of the weights that radial depth holds back"),
    seen("surfel_level", &[], "Surfels: grid level", "grid level of the point"),
];

/// The kernel's output behind an id.
pub(crate) fn seen_by_id(id: &str) -> Option<SurfelOutput> {
    Some(match id {
        "surfel_id" => SurfelOutput::Id,
        "surfel_radius" => SurfelOutput::Radius,
        "surfel_coverage" => SurfelOutput::Coverage,
        "surfel_weight" => SurfelOutput::Weight,
        "surfel_irradiance_over_pi" => SurfelOutput::Irradiance,
        "surfel_error" => SurfelOutput::Error,
        "surfel_rays" => SurfelOutput::Rays,
        "surfel_age" => SurfelOutput::Age,
        "surfel_guide" => SurfelOutput::Guide,
        "surfel_depth" => SurfelOutput::Depth,
        "surfel_cells" => SurfelOutput::Cells,
        "surfel_leaks" => SurfelOutput::Leaks,
        "surfel_level" => SurfelOutput::Level,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_description_has_a_way_to_make_it() {
        for output in OUTPUTS {
            assert_eq!(seen_by_id(output.id).is_some(), output.id != REFLECTION, "{}", output.id);
        }
    }
}
