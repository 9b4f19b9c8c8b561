//! The surfel cache.

crate::gpu_structs! {
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
        /// Slots for marks that cells of cascades are hashed to, minus one.
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
        /// Entries that the grid has room for.
        pub grid_room: u32,
        /// Ids below this one have been in use.
        pub used_count: u32,
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
}

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
    /// The picture at work is so small that coarse surfels do.
    pub const COARSE: u32 = 512;
    /// Surfels without a ray come first.
    pub const NEWBORN_FIRST: u32 = 1024;
    /// New surfels are small among the picture's pixels.
    pub const FINE_TILES: u32 = 2048;
}
