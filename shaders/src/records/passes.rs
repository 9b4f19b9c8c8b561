//! Uniforms of a frame and of passes over images.

crate::gpu_structs! {
    /// Uniforms of a path kernel's dispatch, 144 bytes.
    pub struct FrameUniforms {
        /// Scene space.
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

    /// Uniforms of the audit's passes over the image, 16 bytes.
    pub struct AuditUniforms {
        /// Pixels.
        pub pixel_count: u32,
        /// Samples per pixel.
        pub samples: f32,
        /// Linear factor.
        pub exposure: f32,
        /// Unused.
        pub padding: u32,
    }

    /// The surface point behind a pixel, 32 bytes.
    pub struct VisiblePoint {
        /// Scene space.
        pub position: [f32; 3],
        /// Octahedral normal.
        pub normal: u32,
        /// 1 where the surface reflects diffusely.
        pub is_diffuse: u32,
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
        /// Half floats: irradiance over pi of direct light (rgb), number of frames.
        pub light: [u32; 2],
        /// Half floats: the part of it that is reused from before the camera moved (rgb), its number of frames.
        pub reused: [u32; 2],
    }

    /// Uniforms of the settling passes, which blend the image from the cache with the path-traced one, 32 bytes.
    pub struct SettleUniforms {
        /// Pixels in a row.
        pub width: u32,
        /// Rows.
        pub height: u32,
        /// Path-traced samples per pixel.
        pub path_samples: f32,
        /// Samples per pixel that the blended image is reported with.
        pub shown_samples: f32,
        /// Factor on the noise of the path-traced image.
        pub caution: f32,
        /// Linear factor.
        pub exposure: f32,
        /// Unused.
        pub padding0: u32,
        /// Unused.
        pub padding1: u32,
    }

    /// Uniforms of the passes that filter direct light over neighbouring pixels, 16 bytes.
    pub struct FilterUniforms {
        /// Samples of the earlier mean that noise is estimated from; 0 for none.
        pub earlier_samples: f32,
        /// Whether the present mean is kept for later comparison.
        pub is_kept: u32,
        /// Whether reused light is part of the shown image.
        pub has_reused: u32,
        /// Weight of the filtered result.
        pub strength: f32,
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
        /// Operation of the kernel.
        pub selector: u32,
        /// Parameter of the operation.
        pub factor: f32,
    }

    /// Uniforms of `gradient`'s passes between tracing and the image, 16 bytes.
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
