//! A catalogue for tests: a plain technique, and one with settings, presets and an output of its own.

use surfelcast_render_api::{
    Catalogue, OutputDescription, Preset, Setting, SettingKind, SettingValue, TechniqueAlias, TechniqueDescription,
};

const fn output(id: &'static str, aliases: &'static [&'static str], is_live: bool) -> OutputDescription {
    OutputDescription { id, aliases, label: id, help: "", is_live, is_split: false }
}

const fn number(id: &'static str, default: f64, range: [f64; 2]) -> Setting {
    let kind = SettingKind::Number { default, range, is_integer: false };
    Setting { id, label: id, help: "how much of it", unit: "units", kind }
}

const PATH: TechniqueDescription = TechniqueDescription {
    id: "path",
    label: "Path tracing",
    summary: "Unbiased.",
    aliases: &[],
    settings: &[],
    presets: &[],
    outputs: &[],
    export: None,
};

const OTHER: TechniqueDescription = TechniqueDescription {
    id: "other",
    label: "Other",
    summary: "Another.",
    aliases: &[TechniqueAlias {
        id: "other_soft",
        label: "Other, soft",
        summary: "Another, with a large radius.",
        values: &[("radius", SettingValue::Number(16.0))],
    }],
    settings: &[
        number("radius", 5.0, [1.5, 32.0]),
        number("rays", 0.5, [0.01, 16.0]),
        Setting {
            id: "reconstruction",
            label: "Reconstruction",
            help: "by what",
            unit: "",
            kind: SettingKind::Choice { default: "poisson", names: &["none", "poisson"] },
        },
        Setting { id: "depth", label: "Depth", help: "or not", unit: "", kind: SettingKind::Switch { default: true } },
    ],
    presets: &[
        Preset { id: "preview", values: &[("radius", SettingValue::Number(8.0))] },
        Preset { id: "balanced", values: &[("radius", SettingValue::Number(5.0))] },
        Preset { id: "high", values: &[("radius", SettingValue::Number(3.0)), ("rays", SettingValue::Number(1.0))] },
    ],
    outputs: &[output("other_density", &["other_d"], true)],
    export: None,
};

/// The catalogue; `path` comes first.
pub(crate) fn catalogue() -> Catalogue {
    Catalogue {
        techniques: vec![PATH, OTHER],
        outputs: const { &[output("normal", &[], true), output("depth", &[], true), output("variance", &[], false)] },
        default_technique: "path",
    }
}
