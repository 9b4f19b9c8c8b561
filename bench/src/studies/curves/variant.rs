//! Ways to render that are compared: technique, reconstruction, preset, settings, and what the cache holds beforehand.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};
use surfelcast::Failure;
use surfelcast_render_api::{SettingKind, Settings, TechniqueDescription};
use surfelcast_techniques::registry::{TECHNIQUES, catalogue};

/// Preset that is used where none is named.
pub(crate) const DEFAULT_PRESET: &str = "balanced";
/// Reconstruction of that preset.
const DEFAULT_RECONSTRUCTION: &str = "poisson";

/// What the surfel cache holds when the clock starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Start {
    /// Nothing.
    Empty,
    /// What another camera of the session left behind, which saw the same surfaces from a neighbouring place.
    Warm,
}

/// One way to render.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(crate) struct Variant {
    pub(crate) technique: String,
    /// The preset's own if none is named.
    pub(crate) reconstruction: Option<String>,
    /// Of techniques that use the surfel cache.
    pub(crate) preset: Option<String>,
    /// As NAME=VALUE.
    pub(crate) settings: Vec<String>,
    pub(crate) start: Start,
}

/// What variants are made of; every combination is one. An empty list stands for all choices, or for the default.
#[derive(Clone, Debug, Default)]
pub(crate) struct VariantLists {
    pub(crate) techniques: Vec<String>,
    pub(crate) reconstructions: Vec<String>,
    pub(crate) presets: Vec<String>,
    /// As NAME=VALUE,VALUE,...: each name once, every combination of values.
    pub(crate) settings: Vec<String>,
    pub(crate) starts: Vec<Start>,
}

/// What was requested, or the default if nothing was.
pub(crate) fn or_default(requested: &[String], default: &[&str]) -> Vec<String> {
    match requested {
        [] => default.iter().map(|&word| word.to_owned()).collect(),
        named => named.to_vec(),
    }
}

impl VariantLists {
    /// The same with the default reconstruction alone, unless others were requested: for questions about something
    /// else.
    pub(crate) fn with_one_reconstruction(&self) -> Self {
        Self { reconstructions: or_default(&self.reconstructions, &[DEFAULT_RECONSTRUCTION]), ..self.clone() }
    }

    /// Every combination that makes sense, in the order of the lists.
    pub(crate) fn all(&self) -> Result<Vec<Variant>, Failure> {
        let is_requested = |id: &&str| self.techniques.is_empty() || self.techniques.iter().any(|named| named == id);
        let catalogue = catalogue(TECHNIQUES);
        let presets = or_default(&self.presets, &[DEFAULT_PRESET]);
        let starts = if self.starts.is_empty() { vec![Start::Empty] } else { self.starts.clone() };
        let mut variants = vec![];
        for id in catalogue.technique_ids().map(|(id, ..)| id).filter(is_requested) {
            let mut made = vec![Variant {
                technique: id.to_owned(),
                reconstruction: None,
                preset: None,
                settings: Vec::new(),
                start: Start::Empty,
            }];
            let reconstructions = catalogue.choose(id).map_or(&[][..], |chosen| reconstructions_of(chosen.technique));
            if !reconstructions.is_empty() {
                let reconstructions = or_default(&self.reconstructions, reconstructions);
                made = each(&made, &reconstructions, |of, name| of.reconstruction = Some(name.clone()));
                made = each(&made, &presets, |of, name| of.preset = Some(name.clone()));
                made = each(&made, &setting_combinations(&self.settings)?, |of, settings| {
                    of.settings.clone_from(settings);
                });
                made = each(&made, &starts, |of, start| of.start = *start);
            }
            for variant in &made {
                variant.resolve()?;
            }
            variants.extend(made);
        }
        Ok(variants)
    }
}

/// The reconstructions that a technique has a choice of.
fn reconstructions_of(technique: &TechniqueDescription) -> &'static [&'static str] {
    match technique.setting("reconstruction").map(|setting| setting.kind) {
        Some(SettingKind::Choice { names, .. }) => names,
        _ => &[],
    }
}

/// Every variant with every choice made.
fn each<T>(variants: &[Variant], choices: &[T], choose: impl Fn(&mut Variant, &T)) -> Vec<Variant> {
    let chosen = |variant: &Variant, choice: &T| {
        let mut variant = variant.clone();
        choose(&mut variant, choice);
        variant
    };
    variants
        .iter()
        .flat_map(|variant| choices.iter().map(move |choice| (variant, choice)))
        .map(|(v, c)| chosen(v, c))
        .collect()
}

fn setting_combinations(lists: &[String]) -> Result<Vec<Vec<String>>, Failure> {
    let mut combinations = vec![Vec::new()];
    for list in lists {
        let (name, values) = list
            .split_once('=')
            .ok_or_else(|| Failure::input(format!("--set {list}: expected NAME=VALUE[,VALUE...]")))?;
        combinations = combinations
            .iter()
            .flat_map(|settings| {
                values.split(',').map(move |value| [settings.clone(), vec![format!("{name}={value}")]].concat())
            })
            .collect();
    }
    Ok(combinations)
}

impl Variant {
    /// Every setting of the technique. Fails on an unknown name or value.
    pub(crate) fn resolve(&self) -> Result<Settings, Failure> {
        let catalogue = catalogue(TECHNIQUES);
        let chosen = catalogue
            .choose(&self.technique)
            .ok_or_else(|| Failure::input(format!("--technique {}: there is no such technique", self.technique)))?;
        let technique = chosen.technique;
        let mut settings = chosen.settings;
        if !technique.presets.is_empty() {
            let preset = self.preset.as_deref().unwrap_or(DEFAULT_PRESET);
            let of_preset = technique.preset(preset);
            let of_preset =
                of_preset.map_err(|fault| Failure::input(format!("--preset {preset}: {}", fault.reason)))?;
            settings = settings.with(&of_preset);
        }
        if let Some(name) = &self.reconstruction {
            let set = settings.set_text(technique.settings, &format!("reconstruction={name}"));
            set.map_err(|fault| Failure::input(format!("--reconstruction {name}: {}", fault.reason)))?;
        }
        for setting in &self.settings {
            let set = settings.set_text(technique.settings, setting);
            set.map_err(|fault| Failure::input(format!("--set {setting}: {}", fault.reason)))?;
        }
        Ok(settings)
    }

    /// Short name, without defaults.
    pub(crate) fn label(&self) -> String {
        let mut words = vec![self.technique.clone()];
        words.extend(self.reconstruction.clone());
        words.extend(self.preset.clone().filter(|preset| preset != DEFAULT_PRESET));
        words.extend(self.settings.iter().cloned());
        if self.start == Start::Warm {
            words.push("(warm)".to_owned());
        }
        words.join(" ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_combination_is_one_variant() {
        let lists = VariantLists {
            techniques: vec!["surfel".to_owned(), "path".to_owned()],
            presets: vec!["preview".to_owned(), "high".to_owned()],
            settings: vec!["radius=2,3".to_owned(), "capacity=65536".to_owned()],
            starts: vec![Start::Empty, Start::Warm],
            ..VariantLists::default()
        };
        let labels: Vec<_> = lists.all().unwrap().iter().map(Variant::label).collect();
        let surfels = 2 * 2 * 2 * 4;
        assert_eq!(labels.len(), surfels + 1, "{labels:?}");
        assert!(labels.contains(&"path".to_owned()), "{labels:?}");
        assert!(labels.iter().any(|label| label.ends_with("high radius=3 capacity=65536 (warm)")), "{labels:?}");
    }

    #[test]
    fn unknown_names_and_values_are_refused() {
        let with = |setting: &str, reconstruction: &str| VariantLists {
            techniques: vec!["surfel".to_owned()],
            reconstructions: if reconstruction.is_empty() { Vec::new() } else { vec![reconstruction.to_owned()] },
            settings: vec![setting.to_owned()],
            ..VariantLists::default()
        };
        assert!(with("radius=3", "").all().is_ok());
        for (setting, reconstruction) in [("radius", ""), ("radius=1000", ""), ("size=3", ""), ("radius=3", "magic")] {
            let refused = with(setting, reconstruction).all();
            assert!(matches!(refused, Err(Failure::Input(_))), "{setting} {reconstruction}: {refused:?}");
        }
    }
}
