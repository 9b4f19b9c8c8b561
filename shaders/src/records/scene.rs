//! Geometry, materials and lights.

crate::gpu_structs! {
    /// 8-wide compressed hierarchy node, 80 bytes; the `obvhs` crate's own layout.
    pub struct BvhNode {
        /// Smallest corner of the node.
        pub origin: [f32; 3],
        /// Exponents of the axes in the low bytes, mask of inner children in the high byte.
        pub exponents_and_mask: u32,
        /// First inner child.
        pub child_base: u32,
        /// First primitive.
        pub primitive_base: u32,
        /// One byte per child.
        pub child_meta: [u32; 2],
        /// Quantised x planes.
        pub planes_x: [u32; 4],
        /// Quantised y planes.
        pub planes_y: [u32; 4],
        /// Quantised z planes.
        pub planes_z: [u32; 4],
    }

    /// Triangle in leaf order, 48 bytes.
    pub struct BvhTriangle {
        /// First corner.
        pub v0: [f32; 3],
        /// Stable index.
        pub triangle: u32,
        /// Second corner.
        pub v1: [f32; 3],
        /// Geometry.
        pub geometry: u32,
        /// Third corner.
        pub v2: [f32; 3],
        /// Bit 0: alpha.
        pub flags: u32,
    }

    /// Triangle in stable order, 16 bytes.
    pub struct TriangleRecord {
        /// Vertex indices.
        pub vertices: [u32; 3],
        /// Geometry.
        pub geometry: u32,
    }

    /// Vertex attributes, 32 bytes.
    pub struct PackedVertex {
        /// Octahedral normal.
        pub normal: u32,
        /// Octahedral tangent, bit 0 the bitangent's sign.
        pub tangent: u32,
        /// First texture coordinates.
        pub uv0: [f32; 2],
        /// Second texture coordinates.
        pub uv1: [f32; 2],
        /// Four half floats.
        pub color: [u32; 2],
    }

    /// Drawable part, 16 bytes.
    pub struct GeometryRecord {
        /// First triangle in stable order.
        pub first_triangle: u32,
        /// Material.
        pub material: u32,
        /// First light, or `u32::MAX`.
        pub first_light: u32,
        /// Flags in bits 0 to 7, node above.
        pub flags_and_node: u32,
    }

    /// Instance of a hierarchy, 112 bytes.
    pub struct InstanceRecord {
        /// Rows of the map from object to scene space.
        pub scene_from_object: [[f32; 4]; 3],
        /// Rows of its inverse.
        pub object_from_scene: [[f32; 4]; 3],
        /// Root node.
        pub root_node: u32,
        /// Node of the file.
        pub node: u32,
        /// 1 if the map mirrors.
        pub is_mirrored: u32,
        /// Unused.
        pub padding: u32,
    }

    /// Material, 112 bytes.
    pub struct MaterialRecord {
        /// Linear base colour and alpha factor.
        pub base_color: [f32; 4],
        /// Radiance.
        pub emission: [f32; 3],
        /// Metalness factor.
        pub metallic: f32,
        /// Absorption, 1/m.
        pub absorption: [f32; 3],
        /// Roughness factor.
        pub roughness: f32,
        /// Index of refraction.
        pub ior: f32,
        /// Transmission factor.
        pub transmission: f32,
        /// Scale of the normal map.
        pub normal_scale: f32,
        /// MASK cutoff; negative for BLEND.
        pub alpha_cutoff: f32,
        /// Texture use, or `u32::MAX`.
        pub base_color_texture: u32,
        /// Texture use, or `u32::MAX`.
        pub metallic_roughness_texture: u32,
        /// Texture use, or `u32::MAX`.
        pub normal_texture: u32,
        /// Texture use, or `u32::MAX`.
        pub emission_texture: u32,
        /// Texture use, or `u32::MAX`.
        pub transmission_texture: u32,
        /// `material_flags` bits.
        pub flags: u32,
        /// Unused.
        pub padding0: u32,
        /// Unused.
        pub padding1: u32,
    }

    /// Use of a texture by a material, 48 bytes.
    pub struct TextureUse {
        /// First texel.
        pub offset: u32,
        /// Columns.
        pub width: u32,
        /// Rows.
        pub height: u32,
        /// Wrapping, filter, coordinate set.
        pub flags: u32,
        /// Row of the coordinate map.
        pub row_u: [f32; 4],
        /// Row of the coordinate map.
        pub row_v: [f32; 4],
    }

    /// Emissive triangle, 64 bytes.
    pub struct LightTriangle {
        /// First corner.
        pub v0: [f32; 3],
        /// Stable index.
        pub triangle: u32,
        /// Second corner.
        pub v1: [f32; 3],
        /// Material.
        pub material: u32,
        /// Third corner.
        pub v2: [f32; 3],
        /// Square metres.
        pub area: f32,
        /// Unused.
        pub padding: [f32; 4],
    }

    /// Punctual light, 64 bytes.
    pub struct PunctualRecord {
        /// Scene space.
        pub position: [f32; 3],
        /// 0 point, 1 spot, 2 directional.
        pub kind: u32,
        /// Unit vector in which it shines.
        pub direction: [f32; 3],
        /// Reach, metres.
        pub range: f32,
        /// W/sr or W/m^2.
        pub intensity: [f32; 3],
        /// Scale of the cosine of a spot.
        pub cone_scale: f32,
        /// Offset of the cosine of a spot.
        pub cone_offset: f32,
        /// Unused.
        pub padding0: u32,
        /// Unused.
        pub padding1: u32,
        /// Unused.
        pub padding2: u32,
    }

    /// Alias table entry, 16 bytes.
    pub struct AliasEntry {
        /// Share of this bucket that yields its own index.
        pub threshold: f32,
        /// Index that the rest of the bucket yields.
        pub alias_index: u32,
        /// Probability of this index.
        pub probability: f32,
        /// Unused.
        pub padding: u32,
    }
}

/// Bits of [`GeometryRecord::flags_and_node`].
pub mod geometry_flags {
    /// Shading normals are present.
    pub const HAS_NORMALS: u32 = 1;
    /// Tangents are present.
    pub const HAS_TANGENTS: u32 = 2;
    /// Vertex colours are present.
    pub const HAS_COLORS: u32 = 4;
}

/// Bits of [`MaterialRecord::flags`].
pub mod material_flags {
    /// Unlit: shows its base colour.
    pub const UNLIT: u32 = 1;
    /// Transmission enters a volume.
    pub const VOLUME: u32 = 2;
    /// MASK or BLEND.
    pub const ALPHA: u32 = 4;
    /// Emissive.
    pub const EMISSIVE: u32 = 8;
}

/// Bit 0 of [`BvhTriangle::flags`]: alpha decides each hit.
pub const TRIANGLE_ALPHA: u32 = 1;
