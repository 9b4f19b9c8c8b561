//! Material models.

/// How surfaces scatter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum MaterialMode {
    /// glTF metallic-roughness with its extensions.
    #[default]
    Pbr,
    /// Two-sided Lambertian of the base colour.
    Lambert,
}
