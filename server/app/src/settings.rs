//! `surfelcast settings`: what can be set and what can be written, by technique.

use std::fmt::Write as _;

use surfelcast_render_api::{Catalogue, OutputDescription, Setting, TechniqueDescription};

use crate::cli::SettingsArgs;
use crate::failure::Failure;

/// Columns before the texts.
const INDENT: usize = 28;
/// Columns of a line.
const WIDTH: usize = 110;

/// Lists them.
#[allow(clippy::print_stdout, reason = "the list is the command's output")]
pub fn run(args: &SettingsArgs, catalogue: &Catalogue) -> Result<(), Failure> {
    print!("{}", listing(catalogue, args.technique.as_deref()));
    Ok(())
}

/// The list as text, of one technique or of all.
pub fn listing(catalogue: &Catalogue, technique: Option<&str>) -> String {
    let mut text = String::new();
    let chosen = technique.and_then(|id| catalogue.choose(id)).map(|chosen| chosen.technique.id);
    for technique in catalogue.techniques.iter().filter(|one| chosen.is_none_or(|id| one.id == id)) {
        describe(&mut text, technique);
    }
    text.push_str("Outputs of every technique (--aov NAME)\n");
    outputs(&mut text, catalogue.outputs);
    text
}

fn describe(text: &mut String, technique: &TechniqueDescription) {
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{}: {}. {}", technique.id, technique.label, technique.summary);
    for alias in technique.aliases {
        let values: Vec<String> = alias.values.iter().map(|(id, value)| format!("{id}={value}")).collect();
        item(text, &format!("  {}", alias.id), &format!("stands for {}", values.join(" ")));
    }
    heading(text, "Settings (--set NAME=VALUE)", technique.settings.is_empty());
    for setting in technique.settings {
        item(text, &format!("    {}", setting.id), &what_it_takes(setting));
        item(text, "", setting.help);
    }
    heading(text, "Presets (--preset NAME)", technique.presets.is_empty());
    for preset in technique.presets {
        let values: Vec<String> = preset.values.iter().map(|(id, value)| format!("{id}={value}")).collect();
        item(text, &format!("    {}", preset.id), &values.join(" "));
    }
    heading(text, "Outputs of its own (--aov NAME)", technique.outputs.is_empty());
    outputs(text, technique.outputs);
    if let Some(export) = technique.export {
        heading(text, "Export (--export FILE)", false);
        item(text, "", export);
    }
    text.push('\n');
}

/// Range or names, default and unit.
fn what_it_takes(setting: &Setting) -> String {
    let unit = if setting.unit.is_empty() { String::new() } else { format!(" {}", setting.unit) };
    format!("{}{unit}; default {}", setting.accepted(), setting.default_value())
}

fn outputs(text: &mut String, outputs: &[OutputDescription]) {
    for output in outputs {
        item(text, &format!("    {}", output.id), output.help);
    }
}

fn heading(text: &mut String, words: &str, is_empty: bool) {
    if !is_empty {
        let _ = writeln!(text, "  {words}");
    }
}

/// A name and its text, broken into lines.
fn item(text: &mut String, name: &str, words: &str) {
    let mut line = format!("{name:<INDENT$}");
    if name.len() >= INDENT {
        let _ = writeln!(text, "{name}");
        line = " ".repeat(INDENT);
    }
    let mut is_first = true;
    for word in words.split_whitespace() {
        if !is_first && line.len() + 1 + word.len() > WIDTH {
            let _ = writeln!(text, "{line}");
            line = " ".repeat(INDENT);
            is_first = true;
        }
        if !is_first {
            line.push(' ');
        }
        line.push_str(word);
        is_first = false;
    }
    let _ = writeln!(text, "{}", line.trim_end());
}

#[cfg(test)]
mod tests {
    use surfelcast_techniques::{TECHNIQUES, registry};

    use super::*;

    #[test]
    fn everything_is_listed_within_the_lines() {
        let catalogue = registry::catalogue(TECHNIQUES);
        let all = listing(&catalogue, None);
        for technique in &catalogue.techniques {
            let settings = technique.settings.iter().map(|setting| setting.id);
            let presets = technique.presets.iter().map(|preset| preset.id);
            let aliases = technique.aliases.iter().map(|alias| alias.id);
            for name in settings.chain(presets).chain(aliases).chain([technique.id]) {
                assert!(all.lines().any(|line| line.trim_start().starts_with(name)), "{name}\n{all}");
            }
        }
        for (output, _) in catalogue.outputs() {
            assert!(all.contains(&format!("    {}", output.id)), "{}", output.id);
        }
        assert!(all.lines().all(|line| line.len() <= WIDTH + 20), "{all}");
        assert!(all.contains("within 1.5 to 32 pixels; default 5"), "{all}");
        let of_an_alias = listing(&catalogue, Some("gradient_l1"));
        assert!(of_an_alias.starts_with("gradient:") && !of_an_alias.contains("radius"), "{of_an_alias}");
    }
}
