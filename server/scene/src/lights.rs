//! Light sources of a scene.

use glam::Vec3;

/// A triangle whose material emits. Scene space, counter-clockwise seen from the side that emits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EmissiveTriangle {
    /// Corners, scene space.
    pub corners: [Vec3; 3],
    /// Index into [`crate::SceneGeometry::triangles`].
    pub triangle: u32,
    /// Index into [`crate::Scene::materials`].
    pub material: u32,
    /// Mean emitted radiance over the triangle (texture averaged), linear RGB. Chooses the light; the radiance of a
    /// point is evaluated exactly.
    pub mean_radiance: [f32; 3],
    /// Area, square metres; may be 0 for degenerate triangles, which are never chosen.
    pub area: f32,
}

/// Shape of a punctual light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PunctualKind {
    /// Intensity in W/sr, the same in all directions.
    Point,
    /// Intensity in W/sr on the axis, falling smoothly (glTF KHR_lights_punctual) between the cone angles.
    Spot {
        /// Half angle of full intensity, radians.
        inner_angle: f32,
        /// Half angle where intensity reaches 0, radians.
        outer_angle: f32,
    },
    /// Irradiance in W/m^2 on a surface that faces the light.
    Directional,
}

/// A light without extent (KHR_lights_punctual).
#[derive(Clone, Debug, PartialEq)]
pub struct PunctualLight {
    /// Name in the file or given by the user.
    pub name: String,
    /// Shape and unit of `intensity`.
    pub kind: PunctualKind,
    /// Position, scene space (unused for directional lights).
    pub position: Vec3,
    /// Unit vector in which the light shines, scene space (unused for point lights).
    pub direction: Vec3,
    /// Colour x intensity, linear RGB.
    pub intensity: [f32; 3],
    /// Distance beyond which a point or spot light is dark, metres; infinite where the file gives none.
    pub range: f32,
}
