//! The closed set of structural switches: what of a kernel is compiled at all.
//!
//! A switch removes bindings, members and code. Values that only change numbers are uniforms, not features.

use std::fmt;

bitflags::bitflags! {
    /// A set of structural switches. Each is the WESL condition of its name in lower case: `@if(textures)`.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
    pub struct Features: u32 {
        /// More than one instance, or an instance with a transform: two-level traversal.
        const INSTANCES = 1 << 0;
        /// Any texture.
        const TEXTURES = 1 << 1;
        /// Any normal map. Needs textures.
        const NORMAL_MAPS = 1 << 2;
        /// Any vertex colour.
        const VERTEX_COLORS = 1 << 3;
        /// Any material whose alpha is masked or blended.
        const ALPHA = 1 << 4;
        /// Any transmissive material.
        const TRANSMISSION = 1 << 5;
        /// Light from the environment.
        const ENVIRONMENT = 1 << 6;
        /// Light from emissive triangles.
        const EMISSIVE_TRIANGLES = 1 << 7;
        /// Point, spot and directional lights.
        const PUNCTUAL_LIGHTS = 1 << 8;
        /// Any material that is more than a Lambertian.
        const PBR = 1 << 9;
        /// Any unlit material.
        const UNLIT = 1 << 10;
        /// Separate outputs of direct and indirect light.
        const SPLIT = 1 << 11;
        /// The second form of a technique's own kernels, where they have two; the technique says what it is.
        const ALTERNATE = 1 << 12;
    }
}

impl Features {
    /// No switch on.
    pub const NONE: Features = Features::empty();
    /// Every switch on.
    pub const ALL: Features = Features::all();

    /// The set with `switches` on or off.
    #[must_use]
    pub const fn with(self, switches: Features, on: bool) -> Features {
        if on { self.union(switches) } else { self.difference(switches) }
    }

    /// The names of the WESL conditions of this set, in the order of declaration.
    pub fn conditions(self) -> impl Iterator<Item = String> {
        self.iter_names().map(|(name, _)| name.to_ascii_lowercase())
    }

    /// The sets every kernel is checked with: none, all, each alone, each missing.
    pub fn checked_variants() -> impl Iterator<Item = Features> {
        let missing = Features::ALL.iter().map(|switch| Features::ALL.difference(switch));
        [Features::NONE, Features::ALL].into_iter().chain(Features::ALL.iter()).chain(missing)
    }
}

impl fmt::Display for Features {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Features::NONE => f.write_str("none"),
            Features::ALL => f.write_str("all"),
            _ => f.write_str(&self.conditions().collect::<Vec<_>>().join("+")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_is_shown_by_its_conditions() {
        let set = Features::TEXTURES | Features::NORMAL_MAPS | Features::SPLIT;
        assert_eq!(set.to_string(), "textures+normal_maps+split");
        assert_eq!(
            set.with(Features::SPLIT, false).with(Features::UNLIT, true).to_string(),
            "textures+normal_maps+unlit"
        );
        assert_eq!((Features::NONE.to_string(), Features::ALL.to_string()), ("none".to_owned(), "all".to_owned()));
    }

    #[test]
    fn the_checked_variants_are_distinct() {
        let variants: std::collections::BTreeSet<_> = Features::checked_variants().collect();
        assert_eq!(variants.len(), 2 + 2 * Features::ALL.iter().count());
    }
}
