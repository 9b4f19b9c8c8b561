//! Every technique, the default of views first. Command line, HTTP, client and benchmarks enumerate this list.

use surfelcast_render_api::{Catalogue, Settings};

use crate::outputs::COMMON_OUTPUTS;
use crate::technique::TechniqueEntry;
use crate::{gradient, path, surfel};

/// All techniques.
pub const TECHNIQUES: &[TechniqueEntry] = &[surfel::ENTRY, path::ENTRY, gradient::ENTRY];

/// The technique of single renders that name none: it keeps any promise about its error.
pub const DEFAULT_OF_JOBS: &str = path::ENTRY.description.id;

/// The technique of an id or alias among those given, with what its name sets.
pub fn find(techniques: &'static [TechniqueEntry], id: &str) -> Option<(&'static TechniqueEntry, Settings)> {
    let catalogue = catalogue(techniques);
    let chosen = catalogue.choose(id)?;
    let entry = techniques.iter().find(|entry| entry.id() == chosen.technique.id)?;
    Some((entry, chosen.settings))
}

/// The technique of an id or alias among all.
pub fn by_id(id: &str) -> Option<&'static TechniqueEntry> {
    find(TECHNIQUES, id).map(|(entry, _)| entry)
}

/// What can be requested of some techniques.
pub fn catalogue(techniques: &'static [TechniqueEntry]) -> Catalogue {
    Catalogue {
        techniques: techniques.iter().map(|entry| entry.description).collect(),
        outputs: COMMON_OUTPUTS,
        default_technique: DEFAULT_OF_JOBS,
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use surfelcast_render_api::{SettingKind, SettingValue};

    use super::*;

    /// Values of presets and aliases are accepted by the settings that they name, and defaults lie in their ranges.
    #[test]
    fn descriptions_agree_with_themselves() {
        let catalogue = catalogue(TECHNIQUES);
        let ids: Vec<&str> = catalogue.technique_ids().map(|(id, ..)| id).collect();
        assert_eq!(ids, ["surfel", "path", "gradient", "gradient_l1"]);
        for technique in &catalogue.techniques {
            for setting in technique.settings {
                assert_eq!(setting.check(&setting.default_value()), Ok(setting.default_value()), "{}", setting.id);
                assert!(!setting.help.is_empty() && !setting.label.is_empty(), "{}", setting.id);
                if let SettingKind::Choice { names, .. } = setting.kind {
                    assert_eq!(names.iter().collect::<BTreeSet<_>>().len(), names.len(), "{}", setting.id);
                }
            }
            let sets = technique.presets.iter().map(|preset| preset.values);
            for (id, value) in sets.chain(technique.aliases.iter().map(|alias| alias.values)).flatten() {
                let setting = technique.setting(id).unwrap_or_else(|| panic!("{}: {id}", technique.id));
                assert_eq!(setting.check(value), Ok(value.clone()), "{id}");
            }
            assert!(technique.presets.is_empty() || technique.default_preset().is_some(), "{}", technique.id);
        }
        let (names, labels): (BTreeSet<&str>, BTreeSet<&str>) =
            catalogue.outputs().map(|(output, _)| (output.id, output.label)).unzip();
        assert_eq!((names.len(), labels.len()), (catalogue.outputs().count(), catalogue.outputs().count()));
    }

    #[test]
    fn an_alias_is_its_technique_with_a_setting() {
        let (entry, settings) = find(TECHNIQUES, "gradient_l1").expect("an alias");
        assert_eq!(entry.id(), "gradient");
        assert_eq!(settings.iter().collect::<Vec<_>>(), [("norm", &SettingValue::name("l1"))]);
        assert!(find(TECHNIQUES, "magic").is_none());
    }
}
