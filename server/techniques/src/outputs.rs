//! Outputs that every technique has: what camera rays meet first, and what any image of samples says.

use surfelcast_passes::first_surface::FirstSurfaceOutput;
use surfelcast_render_api::OutputDescription;

/// How an output of every technique is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommonOutput {
    /// By one ray through each pixel's centre.
    Surface(FirstSurfaceOutput),
    /// Emission and direct light.
    Direct,
    /// Light that bounced at least once.
    Indirect,
    /// Indirect irradiance over pi, albedo left out.
    Irradiance,
    /// Samples a pixel.
    SampleCount,
    /// Variance of the pixel's mean radiance (luminance).
    Variance,
}

impl CommonOutput {
    /// The one of that id.
    pub fn by_id(id: &str) -> Option<Self> {
        Some(match id {
            "albedo" => Self::Surface(FirstSurfaceOutput::Albedo),
            "normal" => Self::Surface(FirstSurfaceOutput::Normal),
            "depth" => Self::Surface(FirstSurfaceOutput::Depth),
            "position" => Self::Surface(FirstSurfaceOutput::Position),
            "instance_id" => Self::Surface(FirstSurfaceOutput::Instance),
            "direct" => Self::Direct,
            "indirect" => Self::Indirect,
            "irradiance" => Self::Irradiance,
            "sample_count" => Self::SampleCount,
            "variance" => Self::Variance,
            _ => return None,
        })
    }
}

/// An output of the first surface, which a view can show too.
const fn surface(id: &'static str, label: &'static str, help: &'static str) -> OutputDescription {
    OutputDescription { id, aliases: &[], label, help, is_live: true, is_split: false }
}

/// An output of a batch render's samples.
const fn batch(id: &'static str, label: &'static str, help: &'static str, is_split: bool) -> OutputDescription {
    OutputDescription { id, aliases: &[], label, help, is_live: false, is_split }
}

/// All of them.
pub const COMMON_OUTPUTS: &[OutputDescription] = &[
    surface("albedo", "Base colour", "base colour of the first surface, linear"),
    surface("normal", "Normal", "shading normal towards the viewer, world space"),
    surface("depth", "Depth", "distance along the optical axis, metres; 0 where nothing is hit"),
    surface("position", "Position", "position of the first surface, world space, metres"),
    surface("instance_id", "Objects", "index of the first surface's node plus 1; 0 where nothing is hit"),
    batch("direct", "Direct light", "emission and direct light, radiance", true),
    batch("indirect", "Indirect light", "light that bounced at least once, radiance", true),
    batch("irradiance", "Indirect irradiance", "indirect irradiance over pi, albedo left out", true),
    batch("sample_count", "Samples", "samples a pixel", false),
    batch("variance", "Variance", "variance of the pixel's mean luminance", false),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_description_has_a_way_to_make_it() {
        for output in COMMON_OUTPUTS {
            let made = CommonOutput::by_id(output.id).unwrap_or_else(|| panic!("{}", output.id));
            assert_eq!(matches!(made, CommonOutput::Surface(_)), output.is_live, "{}", output.id);
        }
        assert_eq!(CommonOutput::by_id("soul"), None);
    }
}
