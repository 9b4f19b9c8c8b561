//! What may be requested: techniques, their settings, presets and outputs, as data that every front end enumerates.

use serde::Serialize;

use crate::fault::Fault;
use crate::setting::{Setting, SettingValue};
use crate::settings::Settings;

/// Values of several settings under one name.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Preset {
    /// Name in requests and on the command line.
    pub id: &'static str,
    /// What it sets; the rest stays at its default.
    #[serde(serialize_with = "as_map")]
    pub values: &'static [(&'static str, SettingValue)],
}

/// Another id of a technique, which stands for values of its settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TechniqueAlias {
    /// Id in requests and on the command line.
    pub id: &'static str,
    /// Name for people.
    pub label: &'static str,
    /// One sentence.
    pub summary: &'static str,
    /// What it sets.
    #[serde(serialize_with = "as_map")]
    pub values: &'static [(&'static str, SettingValue)],
}

/// What an image may hold instead of radiance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct OutputDescription {
    /// Name in requests and on the command line.
    pub id: &'static str,
    /// Earlier names that are still accepted.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    pub aliases: &'static [&'static str],
    /// Name for people.
    pub label: &'static str,
    /// What its numbers mean, with their unit.
    pub help: &'static str,
    /// Whether a view can show it, not only a batch render.
    pub is_live: bool,
    /// Whether light has to be kept apart by its kind from the first sample on.
    #[serde(skip)]
    pub is_split: bool,
}

/// A technique on offer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TechniqueDescription {
    /// Id in requests and on the command line.
    pub id: &'static str,
    /// Name for people.
    pub label: &'static str,
    /// One sentence.
    pub summary: &'static str,
    /// Other ids.
    pub aliases: &'static [TechniqueAlias],
    /// What can be set.
    pub settings: &'static [Setting],
    /// Named values of them.
    pub presets: &'static [Preset],
    /// Outputs that it alone has.
    pub outputs: &'static [OutputDescription],
    /// What it can write to a file beside the image, where it can.
    pub export: Option<&'static str>,
}

impl TechniqueDescription {
    /// Every setting at its default.
    pub fn defaults(&self) -> Settings {
        Settings::defaults(self.settings)
    }

    /// A setting by id.
    pub fn setting(&self, id: &str) -> Option<&'static Setting> {
        self.settings.iter().find(|setting| setting.id == id)
    }

    /// The preset that changes nothing.
    pub fn default_preset(&self) -> Option<&'static Preset> {
        let is_default = |(id, value): &(&str, SettingValue)| {
            self.setting(id).is_some_and(|setting| setting.default_value() == *value)
        };
        self.presets.iter().find(|preset| preset.values.iter().all(is_default))
    }

    /// The settings of a preset. The refusal lists those there are.
    pub fn preset(&self, id: &str) -> Result<Settings, Fault> {
        let preset = self.presets.iter().find(|preset| preset.id == id).ok_or_else(|| {
            let ids: Vec<&str> = self.presets.iter().map(|preset| preset.id).collect();
            Fault::value("preset", format!("must be one of {}", ids.join(", ")))
        })?;
        Ok(self.defaults().with(&preset.values.iter().cloned().collect()))
    }
}

/// Everything on offer.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Catalogue {
    /// Techniques, the default of views first.
    pub techniques: Vec<TechniqueDescription>,
    /// Outputs of every technique.
    pub outputs: &'static [OutputDescription],
    /// Technique of requests that name none.
    pub default_technique: &'static str,
}

/// A technique as it was named, with what its name stands for.
#[derive(Clone, Debug, PartialEq)]
pub struct Chosen<'a> {
    /// The technique.
    pub technique: &'a TechniqueDescription,
    /// Every setting: the defaults, or what the alias stands for.
    pub settings: Settings,
}

impl Catalogue {
    /// Every id of every technique with its label and summary, aliases after their own.
    pub fn technique_ids(&self) -> impl Iterator<Item = (&'static str, &'static str, &'static str)> {
        self.techniques.iter().flat_map(|technique| {
            let aliases = technique.aliases.iter().map(|alias| (alias.id, alias.label, alias.summary));
            [(technique.id, technique.label, technique.summary)].into_iter().chain(aliases)
        })
    }

    /// The technique of that id or alias.
    pub fn choose(&self, id: &str) -> Option<Chosen<'_>> {
        self.techniques.iter().find_map(|technique| {
            let alias = technique.aliases.iter().find(|alias| alias.id == id);
            let values = alias.map_or(&[][..], |alias| alias.values);
            let settings = technique.defaults().with(&values.iter().cloned().collect());
            (technique.id == id || alias.is_some()).then_some(Chosen { technique, settings })
        })
    }

    /// Every output with the technique that alone has it, those of every technique first.
    pub fn outputs(&self) -> impl Iterator<Item = (&'static OutputDescription, Option<&TechniqueDescription>)> {
        let own =
            self.techniques.iter().flat_map(|technique| technique.outputs.iter().map(move |o| (o, Some(technique))));
        self.outputs.iter().map(|output| (output, None)).chain(own)
    }

    /// The output of that name, by its id or an earlier one.
    pub fn output(&self, name: &str) -> Option<(&'static OutputDescription, Option<&TechniqueDescription>)> {
        self.outputs().find(|(output, _)| output.id == name || output.aliases.contains(&name))
    }

    /// Ids of the techniques for which something holds, for remedies.
    pub fn ids_where(&self, holds: impl Fn(&TechniqueDescription) -> bool) -> String {
        let ids = self.techniques.iter().filter(|technique| holds(technique)).map(|technique| technique.id);
        ids.collect::<Vec<_>>().join(", ")
    }
}

fn as_map<S: serde::Serializer>(values: &&[(&str, SettingValue)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(values.iter().map(|(id, value)| (id, value)))
}
