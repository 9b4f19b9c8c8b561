//! Triangles, vertices, instances and hierarchies as the GPU reads them.
//!
//! A mesh that is used once, that emits light, is skinned or morphed, or is small enough to copy, is *baked*: its
//! vertices stand in scene space and it belongs to the one hierarchy of the baked instance (identity). Other meshes get
//! a hierarchy of their own, in object space recentred for precision, and one [`Instance`] for each use.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// One 8-wide compressed node (Ylitie et al. 2017), 80 bytes, in `obvhs`' own layout. `child_base_idx` indexes
/// the nodes of its own level; `primitive_base_idx` indexes [`SceneGeometry::bvh_triangles`] in bottom levels and
/// [`SceneGeometry::instances`] in the top level.
pub type BvhNode = obvhs::cwbvh::node::CwBvhNode;

/// A triangle in leaf order, 48 bytes: positions in scene space (baked) or object space (instanced).
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct BvhTriangle {
    /// First corner.
    pub v0: [f32; 3],
    /// Index into [`SceneGeometry::triangles`].
    pub triangle: u32,
    /// Second corner.
    pub v1: [f32; 3],
    /// Index into [`SceneGeometry::geometries`].
    pub geometry: u32,
    /// Third corner.
    pub v2: [f32; 3],
    /// Bit 0: may be cut or passed through by alpha (MASK or BLEND), so a hit must be confirmed.
    pub flags: u32,
}

/// A triangle in stable order (as in the file), 16 bytes. Corners are counter-clockwise seen from the front.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct TriangleRecord {
    /// Indices into [`SceneGeometry::vertices`].
    pub vertices: [u32; 3],
    /// Index into [`SceneGeometry::geometries`].
    pub geometry: u32,
}

/// Vertex attributes without the position, 32 bytes. In the space of its geometry (scene or object).
#[derive(Clone, Copy, Debug, Pod, Zeroable, PartialEq)]
#[repr(C)]
pub struct PackedVertex {
    /// Unit shading normal, octahedral, two 16-bit signed-normalised values (x low). See [`pack_octahedral`].
    pub normal: u32,
    /// Unit tangent, octahedral, with bit 0 replaced: 1 if the bitangent is `-cross(n, t)`. 0 where there is none.
    pub tangent: u32,
    /// First texture coordinate set.
    pub uv0: [f32; 2],
    /// Second texture coordinate set.
    pub uv1: [f32; 2],
    /// Linear RGBA vertex colour, four half floats (r low); ones where there is none.
    pub color: [u32; 2],
}

/// One drawable part: a primitive of a mesh (baked: of one node).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Geometry {
    /// First index into [`SceneGeometry::triangles`].
    pub first_triangle: u32,
    /// Number of triangles.
    pub triangle_count: u32,
    /// Index into [`crate::Scene::materials`].
    pub material: u32,
    /// Index into [`crate::Scene::node_names`]: the node (baked) or the first node that uses the mesh (instanced).
    pub node: u32,
    /// Index into [`crate::Scene::emissive_triangles`] of this geometry's first triangle; `u32::MAX` where the material
    /// does not emit. Triangle `first_triangle + k` is light `first_light + k`.
    pub first_light: u32,
    /// Whether the file gives shading normals; flat otherwise.
    pub has_normals: bool,
    /// Whether tangents are present (given, or generated because a normal map needs them).
    pub has_tangents: bool,
    /// Whether the file gives vertex colours.
    pub has_colors: bool,
}

/// A placed hierarchy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// Rows of the affine map from object to scene space.
    pub scene_from_object: [[f32; 4]; 3],
    /// Rows of its inverse.
    pub object_from_scene: [[f32; 4]; 3],
    /// Root in [`SceneGeometry::nodes`].
    pub root_node: u32,
    /// Index into [`crate::Scene::node_names`]; 0 for the baked instance.
    pub node: u32,
    /// Whether the map mirrors (negative determinant), so that the front side is the clockwise one.
    pub is_mirrored: bool,
}

/// All geometry of a scene.
#[derive(Debug, Default)]
pub struct SceneGeometry {
    /// Nodes of the bottom levels, which hold triangles.
    pub nodes: Vec<BvhNode>,
    /// Nodes of the top level, which holds instances; the first is the root. With a single instance the tracer starts
    /// at that instance's root instead.
    pub top_nodes: Vec<BvhNode>,
    /// Triangles in leaf order. With spatial splits one triangle may stand in several leaves.
    pub bvh_triangles: Vec<BvhTriangle>,
    /// Triangles in stable order.
    pub triangles: Vec<TriangleRecord>,
    /// Vertex attributes.
    pub vertices: Vec<PackedVertex>,
    /// Drawable parts.
    pub geometries: Vec<Geometry>,
    /// Placed hierarchies in the leaf order of the top level. Empty for an empty scene.
    pub instances: Vec<Instance>,
    /// Which of the instances is the baked one; `None` where nothing is baked.
    pub baked_instance: Option<u32>,
    /// Entries a traversal stack needs at most: levels of the top level plus those of the deepest bottom level (one
    /// entry a level, as in Ylitie et al.). At most [`crate::bvh::MAX_STACK_DEPTH`].
    pub stack_depth: u32,
}

/// Octahedral map of a unit vector to two signed-normalised 16-bit integers, x in the low half (Cigolle et al. 2014).
pub fn pack_octahedral(v: Vec3) -> u32 {
    let v = v / (v.x.abs() + v.y.abs() + v.z.abs()).max(f32::MIN_POSITIVE);
    let (mut x, mut y) = (v.x, v.y);
    if v.z < 0.0 {
        (x, y) = ((1.0 - v.y.abs()) * 1f32.copysign(v.x), (1.0 - v.x.abs()) * 1f32.copysign(v.y));
    }
    let quantise = |c: f32| ((c.clamp(-1.0, 1.0) * 32767.0).round() as i32 as u32) & 0xffff;
    quantise(x) | (quantise(y) << 16)
}

/// Inverse of [`pack_octahedral`].
pub fn unpack_octahedral(packed: u32) -> Vec3 {
    let component = |bits: u32| (f32::from(bits as u16 as i16) / 32767.0).max(-1.0);
    let (x, y) = (component(packed & 0xffff), component(packed >> 16));
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    Vec3::new(x - fold.copysign(x), y - fold.copysign(y), z).normalize_or(Vec3::Z)
}

/// A unit tangent with its bitangent sign in bit 0; see [`PackedVertex::tangent`]. Never 0, which means "none".
pub fn pack_tangent(tangent: Vec3, is_bitangent_flipped: bool) -> u32 {
    let packed = pack_octahedral(tangent) & !1 | u32::from(is_bitangent_flipped);
    // +Z packs to 0; the smallest step aside keeps it apart from "no tangent"
    if packed == 0 { 2 } else { packed }
}

/// Linear RGBA as four half floats, r low.
pub fn pack_color(color: [f32; 4]) -> [u32; 2] {
    let half = |x: f32| u32::from(half::f16::from_f32(x.clamp(-65504.0, 65504.0)).to_bits());
    [half(color[0]) | (half(color[1]) << 16), half(color[2]) | (half(color[3]) << 16)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn octahedral_round_trip_is_within_a_few_arc_seconds() {
        for k in 0..20_000u32 {
            let f = |n: u32| (k.wrapping_mul(2_654_435_761).rotate_left(n) % 20_001) as f32 / 10_000.0 - 1.0;
            let v = Vec3::new(f(3), f(11), f(19)).normalize_or(Vec3::X);
            assert!(v.angle_between(unpack_octahedral(pack_octahedral(v))) < 7e-4, "{v}");
        }
        for axis in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z] {
            assert!((unpack_octahedral(pack_octahedral(axis)) - axis).length() < 1e-4, "{axis}");
            assert_ne!(pack_tangent(axis, false), 0);
        }
    }
}
