//! Constants of host and shaders, which import them from `package::constants`.

/// A value as WGSL text.
trait WgslLiteral {
    const TYPE: &'static str;
    fn literal(&self) -> String;
}

impl WgslLiteral for u32 {
    const TYPE: &'static str = "u32";
    fn literal(&self) -> String {
        format!("{self}u")
    }
}

impl WgslLiteral for i32 {
    const TYPE: &'static str = "i32";
    fn literal(&self) -> String {
        format!("{self}i")
    }
}

impl WgslLiteral for f32 {
    const TYPE: &'static str = "f32";
    fn literal(&self) -> String {
        format!("{self:?}f")
    }
}

macro_rules! shader_constants {
    ($($(#[$doc:meta])* $name:ident: $type:ty = $value:expr;)+) => {
        $($(#[$doc])* pub const $name: $type = $value;)+

        /// The text of the module `package::constants`.
        pub(crate) fn module_text() -> String {
            let mut text = String::new();
            $(text.push_str(&format!(
                "const {}: {} = {};\n", stringify!($name), <$type as WgslLiteral>::TYPE, WgslLiteral::literal(&$name)
            ));)+
            text
        }
    };
}

shader_constants! {
    /// Invocations of a workgroup of a one-dimensional kernel.
    WORKGROUP_SIZE: u32 = 64;
    /// Slots of counters, over which workgroups are spread.
    COUNTER_SLOTS: u32 = 256;
    /// Counters of a slot: primary, secondary and shadow rays, and samples that were not finite.
    COUNTERS_PER_SLOT: u32 = 4;
    /// Invocations of a workgroup of a prefix sum.
    SCAN_LANES: u32 = 256;
    /// Values that one such workgroup sums.
    SCAN_BLOCK: u32 = 4096;
    /// Rays from which on a surfel has full weight in a lookup.
    SURFEL_FULL_TRUST: f32 = 16.0;
    /// Side, in pixels, of the tiles that spawn one surfel each per round.
    SPAWN_TILE: u32 = 8;
    /// The same if surfels are small in pixels.
    SPAWN_FINE_TILE: u32 = 4;
    /// Radius of coarse surfels, in target radii.
    SURFEL_COARSENESS: f32 = 3.0;
    /// Words of a surfel's directional tables: 8x8 guiding bytes, then 4x4 depth moments.
    SURFEL_TILE_WORDS: u32 = 32;
    /// Most spawn candidates from ray hits in one update of the surfel cache.
    SURFEL_HIT_CANDIDATES: u32 = 4096;
    /// Slots in which they compete.
    SURFEL_CLAIM_SLOTS: u32 = 16384;
    /// Side, in pixels, of the tiles over which the settling pass compares the image from the cache with the
    /// path-traced one.
    SETTLE_TILE: u32 = 8;
    /// Bins of rays: 12 bits of place, 4 of direction.
    SURFEL_RAY_BINS: u32 = 65536;
    /// Octaves of distance, from half the edge of its cube on, that the trapezoidal grid's slices span.
    SURFEL_GRID_OCTAVES: f32 = 5.0;
    /// Weight of a pixel's value against a difference on a smooth surface in `gradient`'s reconstruction: wavelengths
    /// beyond 2 pi / 0.2 = 31 pixels follow the values (Kettunen et al. 2015, section 6).
    GRADIENT_SCREEN: f32 = 0.04;
    /// Weight of the irradiance against a difference to a neighbouring pixel in image-space reconstruction: as in
    /// `gradient`.
    IMAGE_SCREEN: f32 = 0.04;
    /// Schemes of image-space reconstruction, each a step closer to Noack 2022: differences by normalised weights, none
    /// across folds and steps, each weighted by its reliability;
    IMAGE_WEIGHED: u32 = 0;
    /// with equal weights;
    IMAGE_MASKED: u32 = 1;
    /// across folds and steps too;
    IMAGE_UNMASKED: u32 = 2;
    /// the slopes of all overlapping surfels added up instead;
    IMAGE_SUMMED: u32 = 3;
    /// and almost no weight on values.
    IMAGE_UNSCREENED: u32 = 4;
    /// Most frames of direct light that a moving view reuses.
    REUSED_FRAMES: u32 = 16;
    /// In the selector of a shading pass: diffuse direct light is kept for later frames. The bits of `REUSE_MOVES_MASK`
    /// count the camera moves since the last lighting change.
    KEEPS_DIFFUSE_LIGHT: u32 = 0x8000_0000;
    /// See `KEEPS_DIFFUSE_LIGHT`.
    REUSE_MOVES_MASK: u32 = 0xffff;
    /// In the selector of a reuse pass: there is an earlier frame.
    HAS_EARLIER_FRAME: u32 = 1;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_become_text() {
        assert!(module_text().contains("const WORKGROUP_SIZE: u32 = 64u;\n"));
        assert_eq!((-1e-10_f32).literal(), "-1e-10f");
        assert_eq!(3.0_f32.literal(), "3.0f");
        assert_eq!((-7_i32).literal(), "-7i");
    }
}
