//! Triangles, vertices, instances and hierarchies as the GPU reads them.
//!
//! A mesh that is used once, that emits light, is skinned or morphed, or is small enough to copy, is *baked*: its vertices
//! stand in scene space and it belongs to the one hierarchy of instance 0 (identity). Other meshes get a hierarchy of
//! their own, in object space recentred for precision, and one [`Instance`] for each use.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// One 8-wide compressed node (Ylitie et al. 2017), 80 bytes, in `obvhs`' own layout. `child_base_idx` indexes
/// [`SceneGeometry::nodes`]; `primitive_base_idx` indexes [`SceneGeometry::bvh_triangles`] in bottom levels and
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
    /// All nodes: bottom levels first, the top level last.
    pub nodes: Vec<BvhNode>,
    /// Root of the top level in `nodes`. With a single instance the tracer may start at that instance's root instead.
    pub top_root: u32,
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
