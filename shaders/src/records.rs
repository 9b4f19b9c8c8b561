//! What the scene and a frame look like in device memory. Field docs are with the WESL structures of the same names.

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
        /// One byte a child.
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

    /// Placed hierarchy, 112 bytes.
    pub struct InstanceRecord {
        /// Rows of the map from object to scene space.
        pub scene_from_object: [[f32; 4]; 3],
        /// Rows of its inverse.
        pub object_from_scene: [[f32; 4]; 3],
        /// Root node.
        pub root_node: u32,
        /// Node of the file.
        pub node: u32,
        /// 1 where the map mirrors.
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
        /// Spot falloff.
        pub cone_scale: f32,
        /// Spot falloff.
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
        /// Share of this bucket that is its own index.
        pub threshold: f32,
        /// Index of the rest.
        pub alias_index: u32,
        /// Probability of this index.
        pub probability: f32,
        /// Unused.
        pub padding: u32,
    }

    /// Uniforms of a path kernel's dispatch, 144 bytes.
    pub struct FrameUniforms {
        /// Eye, scene space.
        pub camera_origin: [f32; 3],
        /// Pixels in a row.
        pub width: u32,
        /// Half the image plane's width at distance 1.
        pub camera_right: [f32; 3],
        /// Rows.
        pub height: u32,
        /// Half its height.
        pub camera_up: [f32; 3],
        /// First pixel of the dispatch.
        pub first_pixel: u32,
        /// Unit vector.
        pub camera_forward: [f32; 3],
        /// Pixels of the dispatch.
        pub pixel_count: u32,
        /// Seed.
        pub seed: [u32; 2],
        /// First sample of the dispatch.
        pub first_sample: u32,
        /// Samples of the dispatch.
        pub sample_count: u32,
        /// Part of the light table.
        pub triangle_light_count: u32,
        /// Part of the light table.
        pub punctual_light_count: u32,
        /// Part of the light table.
        pub environment_light_count: u32,
        /// Factor on emission.
        pub emission_scale: f32,
        /// Texels.
        pub environment_size: [u32; 2],
        /// Factor on the environment.
        pub environment_scale: f32,
        /// Radius of the sphere around the scene.
        pub scene_radius: f32,
        /// Where traversal starts.
        pub top_root: u32,
        /// Bound on bounces.
        pub maximum_bounces: u32,
        /// Linear factor.
        pub exposure: f32,
        /// Output or lane count.
        pub selector: u32,
    }

    /// Uniforms of the audit's passes over the picture, 16 bytes.
    pub struct AuditUniforms {
        /// Pixels.
        pub pixel_count: u32,
        /// Samples a pixel.
        pub samples: f32,
        /// Linear factor.
        pub exposure: f32,
        /// Unused.
        pub padding: u32,
    }

    /// Uniforms of the passes that weigh a picture from the cache and a path-traced one, 32 bytes.
    pub struct SettleUniforms {
        /// Pixels in a row.
        pub width: u32,
        /// Rows.
        pub height: u32,
        /// Path-traced samples a pixel.
        pub path_samples: f32,
        /// Samples a pixel that the combined picture is said to have.
        pub shown_samples: f32,
        /// Factor on the paths' noise.
        pub caution: f32,
        /// Linear factor.
        pub exposure: f32,
        /// Unused.
        pub padding0: u32,
        /// Unused.
        pub padding1: u32,
    }

    /// Range of a prefix sum, 16 bytes.
    pub struct ScanUniforms {
        /// Values.
        pub count: u32,
        /// Unused.
        pub padding0: u32,
        /// Unused.
        pub padding1: u32,
        /// Unused.
        pub padding2: u32,
    }

    /// Grid of a screened Poisson problem, 16 bytes.
    pub struct PoissonUniforms {
        /// Pixels in a row.
        pub width: u32,
        /// Rows.
        pub height: u32,
        /// What the kernel is asked for.
        pub selector: u32,
        /// A number that goes with it.
        pub factor: f32,
    }

    /// Uniforms of `gradient`'s passes between tracing and the picture, 16 bytes.
    pub struct GradientUniforms {
        /// Pixels in a row.
        pub width: u32,
        /// Rows.
        pub height: u32,
        /// Factor of the values' variance.
        pub value_factor: f32,
        /// Factor of the differences' variance.
        pub edge_factor: f32,
    }

    /// Where a surfel lies, 48 bytes.
    pub struct SurfelRecord {
        /// Scene space.
        pub position: [f32; 3],
        /// Metres.
        pub radius: f32,
        /// Octahedral normal.
        pub normal: u32,
        /// Birth number.
        pub serial: u32,
        /// Triangle in leaf order.
        pub bvh_triangle: u32,
        /// Instance.
        pub instance: u32,
        /// Weights of the second and third corner.
        pub barycentrics: [f32; 2],
        /// Grid level.
        pub level: u32,
        /// Whether a candidate is one.
        pub is_set: u32,
    }

    /// What a surfel has measured, 64 bytes.
    pub struct SurfelLight {
        /// B of light that has bounced at least once.
        pub indirect: [f32; 3],
        /// Rays in the means.
        pub ray_count: f32,
        /// B of sky and emission found directly.
        pub direct: [f32; 3],
        /// Variance of one ray's luminance.
        pub variance: f32,
        /// Luminance over a short window.
        pub short_mean: f32,
        /// Drift or inconsistency.
        pub drift: f32,
        /// Updates.
        pub age: f32,
        /// Scale of the guiding table.
        pub guide_scale: f32,
        /// Variance over the short window.
        pub short_variance: f32,
        /// Factor on blending.
        pub blend_ratio: f32,
        /// Rays ever shot.
        pub shots: u32,
        /// Rays since the light last changed.
        pub fresh_rays: f32,
    }

    /// What a gather reads of a surfel, 48 bytes.
    pub struct SurfelOutput {
        /// B of light that has bounced at least once.
        pub indirect: [f32; 3],
        /// Rays behind the values.
        pub ray_count: f32,
        /// B of sky and emission found directly.
        pub direct: [f32; 3],
        /// Variance of the mean's luminance.
        pub variance: f32,
        /// Change of B over a radius along the tangents, halves.
        pub gradient: [u32; 3],
        /// Unused.
        pub padding: u32,
    }

    /// A surfel's ray and what it brought back, 48 bytes.
    pub struct SurfelRay {
        /// Light that has bounced at least once.
        pub indirect: [f32; 3],
        /// Metres to the first hit.
        pub distance: f32,
        /// Light met directly.
        pub direct: [f32; 3],
        /// Octahedral direction in the surfel's frame.
        pub direction: u32,
        /// Surfel.
        pub surfel: u32,
        /// Sample number.
        pub sample: u32,
        /// Bin by place and direction.
        pub bin: u32,
        /// Ray that is traced in this one's turn.
        pub order: u32,
    }

    /// Where a surfel's ray first hit, 32 bytes.
    pub struct FirstHit {
        /// Scene space; a direction where nothing was hit.
        pub position: [f32; 3],
        /// Triangle in leaf order, or `u32::MAX`.
        pub bvh_triangle: u32,
        /// Octahedral geometric normal.
        pub normal: u32,
        /// Whether light leaves in every direction alike.
        pub is_matte: u32,
        /// Unused.
        pub padding0: u32,
        /// Unused.
        pub padding1: u32,
    }

    /// One end's slot of an edge between surfels, 32 bytes.
    pub struct SurfelEdge {
        /// The other end.
        pub neighbour: u32,
        /// Its birth number; 0 for an empty slot.
        pub serial: u32,
        /// Shifted rays.
        pub count: f32,
        /// Mean squared luminance of their differences.
        pub square: f32,
        /// This end's part of the difference of B.
        pub difference: [f32; 3],
        /// Unused.
        pub padding: u32,
    }

    /// What surfels need to know of a visible point, 32 bytes.
    pub struct VisiblePoint {
        /// Scene space.
        pub position: [f32; 3],
        /// Octahedral normal.
        pub normal: u32,
        /// Radius a surfel should have there, or 0.
        pub radius: f32,
        /// Unused.
        pub padding0: u32,
        /// Unused.
        pub padding1: u32,
        /// Unused.
        pub padding2: u32,
    }

    /// Direct light of a pixel for the next frame, 32 bytes.
    pub struct DirectHistory {
        /// Scene space, of the first sample since the camera moved.
        pub position: [f32; 3],
        /// Octahedral normal.
        pub normal: u32,
        /// Half floats: B of direct light (rgb), frames behind it.
        pub light: [u32; 2],
        /// Half floats: what of it was taken over from the frame before the camera moved (rgb), frames behind that.
        pub reused: [u32; 2],
    }

    /// One surfel's part in a point's light, 64 bytes.
    pub struct SurfelContribution {
        /// Scene space.
        pub position: [f32; 3],
        /// Metres; of the point: coverage.
        pub radius: f32,
        /// B of sky and emission.
        pub direct: [f32; 3],
        /// Weight; of the point: trust.
        pub weight: f32,
        /// B of light that has bounced.
        pub indirect: [f32; 3],
        /// Chance to see the point.
        pub visibility: f32,
        /// Octahedral normal.
        pub normal: u32,
        /// Surfel; of the point: how many parts follow.
        pub id: u32,
        /// Rays.
        pub ray_count: f32,
        /// Variance of the mean.
        pub variance: f32,
    }

    /// State of the surfel cache in a frame, 256 bytes.
    pub struct SurfelUniforms {
        /// Positions and pixel sizes at distance 1.
        pub cameras: [[f32; 4]; 8],
        /// Cameras in use.
        pub camera_count: u32,
        /// Surfels that fit.
        pub capacity: u32,
        /// Slots that cells of cascades are hashed to, minus one.
        pub slot_mask: u32,
        /// Updates so far.
        pub update: u32,
        /// Seed.
        pub seed: [u32; 2],
        /// Side of the smallest cells, metres.
        pub cell_size: f32,
        /// Radius aimed at, pixels.
        pub radius_pixels: f32,
        /// Metres.
        pub smallest_radius: f32,
        /// Metres.
        pub largest_radius: f32,
        /// Goal of the sum of weights.
        pub coverage: f32,
        /// Factor of the error aimed at.
        pub exposure: f32,
        /// Living surfels.
        pub live_count: u32,
        /// Rays of this update.
        pub ray_budget: u32,
        /// Error goal.
        pub target_error: f32,
        /// Share of guided rays.
        pub guided_share: f32,
        /// `surfel_switches`.
        pub switches: u32,
        /// Unused.
        /// Entries that the grid has room for.
        pub grid_room: u32,
        /// Share of the capacity in use.
        pub fill: f32,
        /// Number of the next surfel born.
        pub next_serial: u32,
        /// Items of this dispatch.
        pub item_count: u32,
        /// First item.
        pub first_item: u32,
        /// Columns of tiles.
        pub columns: u32,
        /// Rows of tiles.
        pub rows: u32,
        /// Bit for each level that holds surfels.
        pub levels: u32,
        /// Slots of the grid.
        pub grid_slots: u32,
        /// Of the trapezoidal grid: cells along each side of its cube.
        pub grid_cells: u32,
        /// Slices of each region around that.
        pub grid_slices: u32,
        /// Its centre, scene space.
        pub grid_center: [f32; 3],
        /// Half the edge of its cube, metres.
        pub grid_half_edge: f32,
    }

    /// Uniforms of the tone map, 16 bytes.
    pub struct ToneMapUniforms {
        /// Pixels.
        pub pixel_count: u32,
        /// Linear factor.
        pub exposure: f32,
        /// Unused.
        pub padding0: u32,
        /// Unused.
        pub padding1: u32,
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
    /// Shows its base colour and is not lit.
    pub const UNLIT: u32 = 1;
    /// Transmission leads into a volume.
    pub const VOLUME: u32 = 2;
    /// MASK or BLEND.
    pub const ALPHA: u32 = 4;
    /// Emits.
    pub const EMISSIVE: u32 = 8;
}

/// Bit 0 of [`BvhTriangle::flags`]: alpha decides each hit.
pub const TRIANGLE_ALPHA: u32 = 1;

/// Bits of [`SurfelUniforms::switches`].
pub mod surfel_switches {
    /// Gathers respect radial depth.
    pub const DEPTH: u32 = 1;
    /// Outputs are shared with neighbours while they are noise.
    pub const SHARING: u32 = 2;
    /// The multiscale mean estimator replaces the running mean.
    pub const MULTISCALE: u32 = 4;
    /// Means forget when they drift.
    pub const DRIFT_TEST: u32 = 8;
    /// Ray hits are served from the cache.
    pub const FEEDBACK: u32 = 16;
    /// First hits are kept, to be reconnected to neighbours.
    pub const SHIFTS: u32 = 32;
    /// The grid is the trapezoidal one.
    pub const TRAPEZOIDAL: u32 = 64;
    /// Rays are traced in the order of their bins.
    pub const BINNING: u32 = 128;
    /// What the picture at work sees is pinned.
    pub const PINNING: u32 = 256;
}
