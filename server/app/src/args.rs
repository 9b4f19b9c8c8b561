//! Arguments that several commands take, and the parsers of their values.

use clap::builder::{PossibleValue, PossibleValuesParser};
use clap::{Args, ValueEnum};
use surfelcast_render_api::{Catalogue, RequestLimits, SettingKind};

/// Largest width or height of an image, pixels.
pub const MAX_SIDE: u32 = 16_384;
/// Most pixels of an image.
const MAX_PIXELS: u64 = 64_000_000;
/// Longest render, seconds.
const MAX_SECS: f64 = 86_400.0;

/// What a render on the command line may have.
pub const LIMITS: RequestLimits =
    RequestLimits { side: MAX_SIDE, pixels: MAX_PIXELS, samples: 1 << 20, secs: MAX_SECS };

/// Device choice, shared by the commands that render.
#[derive(Debug, Args)]
pub struct DeviceArgs {
    /// GPU adapter by index or part of its name (see `surfelcast doctor`); the best one by default.
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
    /// Device memory to use at most, MiB.
    #[arg(long, value_name = "MIB", value_parser = clap::value_parser!(u64).range(64..))]
    pub gpu_memory: Option<u64>,
}

impl DeviceArgs {
    /// The memory limit in bytes.
    pub fn memory_budget_bytes(&self) -> Option<u64> {
        self.gpu_memory.map(|mib| mib << 20)
    }
}

/// How surfaces scatter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Materials {
    /// glTF metallic-roughness.
    Pbr,
    /// Two-sided Lambertian of the base colour.
    Lambert,
}

impl Materials {
    /// Name in requests.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pbr => "pbr",
            Self::Lambert => "lambert",
        }
    }
}

/// Ids of the techniques.
pub fn technique_ids(catalogue: &Catalogue) -> PossibleValuesParser {
    catalogue.technique_ids().map(|(id, _, summary)| PossibleValue::new(id).help(summary)).collect::<Vec<_>>().into()
}

/// Presets of all techniques.
pub fn preset_names(catalogue: &Catalogue) -> PossibleValuesParser {
    let mut names: Vec<&'static str> = Vec::new();
    for preset in catalogue.techniques.iter().flat_map(|technique| technique.presets) {
        if !names.contains(&preset.id) {
            names.push(preset.id);
        }
    }
    names.into()
}

/// Values of the setting `reconstruction`; any where no technique has it.
pub fn reconstruction_names(catalogue: &Catalogue) -> PossibleValuesParser {
    let setting = catalogue.techniques.iter().find_map(|technique| technique.setting("reconstruction"));
    match setting.map(|setting| setting.kind) {
        Some(SettingKind::Choice { names, .. }) => names.to_vec().into(),
        _ => vec!["none"].into(),
    }
}

/// Outputs of all techniques, by their earlier names too.
pub fn output_names(catalogue: &Catalogue) -> PossibleValuesParser {
    let value = |output: &'static surfelcast_render_api::OutputDescription| {
        PossibleValue::new(output.id).aliases(output.aliases.iter().copied()).help(output.help)
    };
    catalogue.outputs().map(|(output, _)| value(output)).collect::<Vec<_>>().into()
}

/// An image size such as `1280x720`.
pub fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let (width, height) = text.split_once(['x', 'X']).ok_or("expected WIDTHxHEIGHT, such as 1280x720")?;
    let side = |text: &str| text.trim().parse::<u32>().ok().filter(|side| (1..=MAX_SIDE).contains(side));
    let (Some(width), Some(height)) = (side(width), side(height)) else {
        return Err(format!("width and height are whole numbers from 1 to {MAX_SIDE}"));
    };
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(format!("{width}x{height} has over {MAX_PIXELS} pixels"));
    }
    Ok([width, height])
}

/// A tone-mapped RMSE in (0, 1].
pub fn parse_error(text: &str) -> Result<f32, String> {
    text.parse().ok().filter(|e: &f32| *e > 0.0 && *e <= 1.0).ok_or_else(|| "expected a number in (0, 1]".to_owned())
}

/// A duration in (0, 86400] seconds.
pub fn parse_secs(text: &str) -> Result<f64, String> {
    let secs = text.parse().ok().filter(|s: &f64| *s > 0.0 && *s <= MAX_SECS);
    secs.ok_or_else(|| "expected seconds in (0, 86400]".to_owned())
}

/// An exposure in [1e-6, 1e6].
pub fn parse_exposure(text: &str) -> Result<f32, String> {
    let exposure = text.parse().ok().filter(|e: &f32| (1e-6..=1e6).contains(e));
    exposure.ok_or_else(|| "expected a number in [1e-6, 1e6]".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_checked() {
        assert_eq!(parse_size("320x180"), Ok([320, 180]));
        for bad in ["320", "0x1", "x", "99999x1", "16384x16384", "-1x5"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn numbers_outside_their_range_are_refused() {
        for bad in ["0", "-1", "nan", "inf", "1.5"] {
            assert!(parse_error(bad).is_err(), "{bad}");
        }
        for bad in ["0", "nan", "inf", "1e9"] {
            assert!(parse_secs(bad).is_err() && parse_exposure(bad).is_err(), "{bad}");
        }
    }
}
