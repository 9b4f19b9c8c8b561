//! What a view can show instead of radiance, with names for people.

use surfelcast_protocol::server::OutputInfo;
use surfelcast_renderer::{Aov, SurfelOutput};
use surfelcast_review::ReviewError;

/// Everything a view can show live, in the renderer's order.
pub(crate) fn live() -> impl Iterator<Item = (&'static str, Aov)> {
    Aov::ALL.into_iter().filter(|(_, aov)| aov.is_live())
}

/// The list in `welcome`.
pub(crate) fn offered() -> Vec<OutputInfo> {
    live().map(|(id, aov)| OutputInfo { id: id.into(), label: label(aov).into() }).collect()
}

/// The live output of that name; the refusal lists those there are.
pub(crate) fn live_by_name(field: &str, name: &str) -> Result<Aov, ReviewError> {
    live().find(|(known, _)| *known == name).map(|(_, aov)| aov).ok_or_else(|| {
        let names: Vec<&str> = live().map(|(name, _)| name).collect();
        let why = if Aov::by_name(name).is_some() { "only a batch render has that output; " } else { "" };
        ReviewError::invalid(field, format!("{why}a view shows null (radiance) or one of {}", names.join(", ")))
    })
}

/// Name for people. Every output has one, so that a new one cannot be forgotten here.
fn label(aov: Aov) -> &'static str {
    match aov {
        Aov::Albedo => "Base colour",
        Aov::Normal => "Normal",
        Aov::Depth => "Depth",
        Aov::Position => "Position",
        Aov::InstanceId => "Objects",
        Aov::Direct => "Direct light",
        Aov::Indirect => "Indirect light",
        Aov::Irradiance => "Indirect irradiance",
        Aov::SampleCount => "Samples",
        Aov::Variance => "Variance",
        Aov::Reflection => "Reflections",
        Aov::Surfel(output) => match output {
            SurfelOutput::Id => "Surfels: nearest",
            SurfelOutput::Radius => "Surfels: radius",
            SurfelOutput::Coverage => "Surfels: coverage",
            SurfelOutput::Weight => "Surfels: largest weight",
            SurfelOutput::Irradiance => "Surfels: light held (B)",
            SurfelOutput::Error => "Surfels: error",
            SurfelOutput::Rays => "Surfels: rays",
            SurfelOutput::Age => "Surfels: age",
            SurfelOutput::Guide => "Surfels: guiding direction",
            SurfelOutput::Depth => "Surfels: depth around",
            SurfelOutput::Cells => "Surfels: grid entries read",
            SurfelOutput::Leaks => "Surfels: leaks held back",
            SurfelOutput::Level => "Surfels: grid level",
        },
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn labels_tell_outputs_apart() {
        let offered = offered();
        let labels: BTreeSet<&str> = offered.iter().map(|output| output.label.as_str()).collect();
        assert_eq!((labels.len(), offered.len()), (live().count(), live().count()));
    }

    #[test]
    fn refusals_tell_batch_outputs_from_none() {
        assert_eq!(live_by_name("aov", "normal"), Ok(Aov::Normal));
        let batch = live_by_name("aov", "variance").expect_err("batch only").to_string();
        assert!(batch.starts_with("aov: only a batch render") && batch.contains("surfel_coverage"), "{batch}");
        let none = live_by_name("aov", "soul").expect_err("no such output").to_string();
        assert!(none.starts_with("aov: a view shows null") && !none.contains("variance,"), "{none}");
    }
}
