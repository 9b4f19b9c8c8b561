//! What a view can show instead of radiance.

use surfelcast_protocol::server::OutputInfo;
use surfelcast_render_api::{Catalogue, OutputDescription};
use surfelcast_review::ReviewError;

/// Outputs that a view can show, in the renderer's order.
fn live(catalogue: &Catalogue) -> impl Iterator<Item = &'static OutputDescription> {
    catalogue.outputs().map(|(output, _)| output).filter(|output| output.is_live)
}

/// The list in `welcome`.
pub(crate) fn offered(catalogue: &Catalogue) -> Vec<OutputInfo> {
    let offered = catalogue.outputs().filter(|(output, _)| output.is_live);
    offered
        .map(|(output, technique)| OutputInfo {
            id: output.id.into(),
            label: output.label.into(),
            help: output.help.into(),
            technique: technique.map(|technique| technique.id.into()),
        })
        .collect()
}

/// Id of the live output of that name; the refusal lists those there are.
pub(crate) fn live_by_name(catalogue: &Catalogue, field: &str, name: &str) -> Result<&'static str, ReviewError> {
    let found = catalogue.output(name).map(|(output, _)| output);
    found.filter(|output| output.is_live).map(|output| output.id).ok_or_else(|| {
        let names: Vec<&str> = live(catalogue).map(|output| output.id).collect();
        let why = if found.is_some() { "only a batch render has that output; " } else { "" };
        ReviewError::invalid(field, format!("{why}a view shows null (radiance) or one of {}", names.join(", ")))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_catalogue::catalogue;

    #[test]
    fn live_outputs_are_offered_with_their_technique() {
        let offered = offered(&catalogue());
        let of: Vec<(&str, Option<&str>)> =
            offered.iter().map(|output| (output.id.as_str(), output.technique.as_deref())).collect();
        assert_eq!(of, [("normal", None), ("depth", None), ("other_density", Some("other"))]);
    }

    #[test]
    fn refusals_tell_batch_outputs_from_none() {
        let by_name = |name| live_by_name(&catalogue(), "aov", name);
        assert_eq!(by_name("normal"), Ok("normal"));
        assert_eq!(by_name("other_d"), Ok("other_density"), "an earlier name");
        let batch = by_name("variance").expect_err("batch only").to_string();
        assert!(batch.starts_with("aov: only a batch render") && batch.contains("other_density"), "{batch}");
        let none = by_name("soul").expect_err("no such output").to_string();
        assert!(none.starts_with("aov: a view shows null") && !none.contains("variance"), "{none}");
    }
}
