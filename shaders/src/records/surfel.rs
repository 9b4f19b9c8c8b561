//! The surfel cache.

crate::gpu_structs! {
    /// Geometry of a surfel, 48 bytes.
    pub struct SurfelRecord {
        /// Scene space.
        pub position: [f32; 3],
        /// Metres.
        pub radius: f32,
        /// Octahedral normal.
        pub normal: u32,
        /// Serial number.
        pub serial: u32,
        /// Triangle in leaf order.
        pub bvh_triangle: u32,
        /// Instance.
        pub instance: u32,
        /// Weights of the second and third corner.
        pub barycentrics: [f32; 2],
        /// Grid level.
        pub level: u32,
        /// Whether a spawn candidate is set.
        pub is_set: u32,
    }

    /// Measured irradiance of a surfel, 64 bytes.
    pub struct SurfelLight {
        /// Irradiance over pi of light that has bounced at least once.
        pub indirect: [f32; 3],
        /// Rays in the means.
        pub ray_count: f32,
        /// Irradiance over pi of sky and emission.
        pub direct: [f32; 3],
        /// Variance of the luminance of one ray.
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
        /// Rays traced in all.
        pub shots: u32,
        /// Rays since the last lighting change.
        pub fresh_rays: f32,
    }

    /// Irradiance of a surfel as lookups read it, 48 bytes.
    pub struct SurfelOutput {
        /// Irradiance over pi of light that has bounced at least once.
        pub indirect: [f32; 3],
        /// Rays that the values are means of.
        pub ray_count: f32,
        /// Irradiance over pi of sky and emission.
        pub direct: [f32; 3],
        /// Variance of the luminance of the mean.
        pub variance: f32,
        /// Change of the irradiance over pi per radius along the tangents, half floats.
        pub gradient: [u32; 3],
        /// Unused.
        pub padding: u32,
    }

    /// A ray of a surfel and its result, 48 bytes.
    pub struct SurfelRay {
        /// Light that has bounced at least once.
        pub indirect: [f32; 3],
        /// Metres to the first hit.
        pub distance: f32,
        /// Sky and emission at the first hit.
        pub direct: [f32; 3],
        /// Octahedral direction in the surfel's frame.
        pub direction: u32,
        /// Surfel.
        pub surfel: u32,
        /// Sample number.
        pub sample: u32,
        /// Bin by position and direction.
        pub bin: u32,
        /// Ray that is traced at this index.
        pub order: u32,
    }

    /// First hit of a surfel's ray, 32 bytes.
    pub struct FirstHit {
        /// Scene space; a direction if nothing was hit.
        pub position: [f32; 3],
        /// Triangle in leaf order, or `u32::MAX`.
        pub bvh_triangle: u32,
        /// Octahedral geometric normal.
        pub normal: u32,
        /// Whether the BSDF is treated as Lambertian.
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
        /// Its serial number; 0 for an empty slot.
        pub serial: u32,
        /// Shifted rays.
        pub count: f32,
        /// Mean squared luminance of their differences.
        pub square: f32,
        /// This end's part of the difference of irradiance over pi.
        pub difference: [f32; 3],
        /// Unused.
        pub padding: u32,
    }

    /// Contribution of one surfel to a point, 64 bytes.
    pub struct SurfelContribution {
        /// Scene space.
        pub position: [f32; 3],
        /// Metres; in the record of the point: coverage.
        pub radius: f32,
        /// Irradiance over pi of sky and emission.
        pub direct: [f32; 3],
        /// Weight; in the record of the point: sum of trusted weights.
        pub weight: f32,
        /// Irradiance over pi of light that has bounced.
        pub indirect: [f32; 3],
        /// Probability that it sees the point.
        pub visibility: f32,
        /// Octahedral normal.
        pub normal: u32,
        /// Surfel; in the record of the point: number of contributions.
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
        /// Most surfels.
        pub capacity: u32,
        /// Slots for marks that cells of cascades are hashed to, minus one.
        pub slot_mask: u32,
        /// Updates so far.
        pub update: u32,
        /// Seed.
        pub seed: [u32; 2],
        /// Side of the smallest cells, metres.
        pub cell_size: f32,
        /// Target radius, pixels.
        pub radius_pixels: f32,
        /// Metres.
        pub smallest_radius: f32,
        /// Metres.
        pub largest_radius: f32,
        /// Target of coverage.
        pub coverage: f32,
        /// Factor of the error that the allocation of rays aims at.
        pub exposure: f32,
        /// Live surfels.
        pub live_count: u32,
        /// Rays of this update.
        pub ray_budget: u32,
        /// Error goal.
        pub target_error: f32,
        /// Share of guided rays.
        pub guided_share: f32,
        /// `surfel_switches`.
        pub switches: u32,
        /// Capacity of the grid, entries.
        pub grid_room: u32,
        /// Ids from this one on have never been used.
        pub used_count: u32,
        /// Serial number of the next surfel.
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
        /// Trapezoidal grid: cells along each side of its cube.
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
    /// Outputs are averaged with neighbours while they are noisy.
    pub const SHARING: u32 = 2;
    /// The multiscale mean estimator replaces the running mean.
    pub const MULTISCALE: u32 = 4;
    /// Means are shortened when they drift.
    pub const DRIFT_TEST: u32 = 8;
    /// Ray hits read the cache.
    pub const FEEDBACK: u32 = 16;
    /// First hits are kept, for reconnection to neighbours.
    pub const SHIFTS: u32 = 32;
    /// The grid is the trapezoidal one.
    pub const TRAPEZOIDAL: u32 = 64;
    /// Rays are traced in the order of their bins.
    pub const BINNING: u32 = 128;
    /// Surfels that the present view sees are pinned.
    pub const PINNING: u32 = 256;
    /// The present view is so small that coarse surfels suffice.
    pub const COARSE: u32 = 512;
    /// Surfels without a ray are updated first.
    pub const NEW_FIRST: u32 = 1024;
    /// The target radius of the present view is small in pixels.
    pub const FINE_TILES: u32 = 2048;
}
