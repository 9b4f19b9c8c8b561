//! The closed set of structural switches: what of a kernel is compiled at all.
//!
//! A switch removes bindings, members and code. Values that only change numbers are uniforms, not features.

use std::fmt;

macro_rules! features {
    ($($(#[$doc:meta])* $name:ident = $condition:literal,)+) => {
        /// One structural switch.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[repr(u8)]
        pub enum Feature {
            $($(#[$doc])* $name,)+
        }

        impl Feature {
            /// Every switch, in the order of declaration.
            pub const ALL: &'static [Feature] = &[$(Feature::$name,)+];

            /// The name of the WESL condition: `@if(textures)`.
            pub const fn condition(self) -> &'static str {
                match self {
                    $(Feature::$name => $condition,)+
                }
            }
        }
    };
}

features! {
    /// More than one instance, or an instance with a transform: two-level traversal.
    Instances = "instances",
    /// Any texture.
    Textures = "textures",
    /// Any normal map. Needs textures.
    NormalMaps = "normal_maps",
    /// Any vertex colour.
    VertexColors = "vertex_colors",
    /// Any material whose alpha is masked or blended.
    Alpha = "alpha",
    /// Any transmissive material.
    Transmission = "transmission",
    /// Light from the environment.
    Environment = "environment",
    /// Light from emissive triangles.
    EmissiveTriangles = "emissive_triangles",
    /// Point, spot and directional lights.
    PunctualLights = "punctual_lights",
    /// Any material that is more than a Lambertian.
    Pbr = "pbr",
    /// Any unlit material.
    Unlit = "unlit",
    /// Outputs of direct and indirect light apart.
    Split = "split",
    /// Surfels are drawn onto the picture instead of being gathered by its pixels.
    Splat = "splat",
}

/// A set of [`Feature`]s.
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Features(u32);

impl Features {
    /// No switch on.
    pub const NONE: Features = Features(0);
    /// Every switch on: the variant that can serve any scene.
    pub const ALL: Features = Features((1 << Feature::ALL.len()) - 1);

    /// The set with `feature` too.
    #[must_use]
    pub const fn with(self, feature: Feature) -> Features {
        Features(self.0 | 1 << feature as u32)
    }

    /// The set without `feature`.
    #[must_use]
    pub const fn without(self, feature: Feature) -> Features {
        Features(self.0 & !(1 << feature as u32))
    }

    /// The set with `feature` on or off.
    #[must_use]
    pub const fn set(self, feature: Feature, on: bool) -> Features {
        if on { self.with(feature) } else { self.without(feature) }
    }

    /// Whether `feature` is on.
    pub const fn contains(self, feature: Feature) -> bool {
        self.0 & 1 << feature as u32 != 0
    }

    /// Whether every switch of `other` is on here.
    pub const fn contains_all(self, other: Features) -> bool {
        self.0 & other.0 == other.0
    }

    /// The switches that are on, in the order of declaration.
    pub fn iter(self) -> impl Iterator<Item = Feature> {
        Feature::ALL.iter().copied().filter(move |&feature| self.contains(feature))
    }

    /// The sets every kernel is checked with: none, all, each alone, each missing.
    pub fn checked_variants() -> impl Iterator<Item = Features> {
        let alone = Feature::ALL.iter().map(|&feature| Features::NONE.with(feature));
        let missing = Feature::ALL.iter().map(|&feature| Features::ALL.without(feature));
        [Features::NONE, Features::ALL].into_iter().chain(alone).chain(missing)
    }
}

impl FromIterator<Feature> for Features {
    fn from_iter<I: IntoIterator<Item = Feature>>(features: I) -> Self {
        features.into_iter().fold(Features::NONE, Features::with)
    }
}

impl fmt::Display for Features {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == Features::NONE {
            return f.write_str("none");
        }
        if *self == Features::ALL {
            return f.write_str("all");
        }
        for (index, feature) in self.iter().enumerate() {
            if index > 0 {
                f.write_str("+")?;
            }
            f.write_str(feature.condition())?;
        }
        Ok(())
    }
}

impl fmt::Debug for Features {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Features({self})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_add_and_remove() {
        let set: Features = [Feature::Textures, Feature::Split].into_iter().collect();
        assert!(set.contains(Feature::Textures) && set.contains(Feature::Split) && !set.contains(Feature::Alpha));
        assert_eq!(set.without(Feature::Split).iter().collect::<Vec<_>>(), [Feature::Textures]);
        assert!(Features::ALL.contains_all(set) && !set.contains_all(Features::ALL));
        assert_eq!(set.to_string(), "textures+split");
        assert_eq!(Features::ALL.iter().count(), Feature::ALL.len());
    }

    #[test]
    fn the_checked_variants_are_distinct() {
        let variants: std::collections::BTreeSet<_> = Features::checked_variants().collect();
        assert_eq!(variants.len(), 2 + 2 * Feature::ALL.len());
    }
}
