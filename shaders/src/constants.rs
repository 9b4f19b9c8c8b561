//! Numbers that Rust and shaders must agree on. Written here once; shaders import them from `package::constants`.

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
    /// Slots that workgroups spread their counting over.
    COUNTER_SLOTS: u32 = 256;
    /// Counters of a slot: primary, secondary and shadow rays, and samples that were not finite.
    COUNTERS_PER_SLOT: u32 = 4;
    /// Invocations of a workgroup of a prefix sum.
    SCAN_LANES: u32 = 256;
    /// Values that one such workgroup sums.
    SCAN_BLOCK: u32 = 4096;
    /// Rays after which a surfel counts fully in a gather.
    SURFEL_FULL_TRUST: f32 = 16.0;
    /// Side, in pixels, of the tiles that get a surfel each in a round of spawning.
    SPAWN_TILE: u32 = 8;
    /// The same where surfels are small among the pixels.
    SPAWN_FINE_TILE: u32 = 4;
    /// Radius of coarse surfels, in ideal ones.
    SURFEL_COARSENESS: f32 = 3.0;
    /// Words of a surfel's directional tables: 8x8 guiding bytes, then 4x4 depth moments.
    SURFEL_TILE_WORDS: u32 = 32;
    /// Candidates that ray hits may put up in one update of the surfel cache.
    SURFEL_HIT_CANDIDATES: u32 = 4096;
    /// Slots in which those compete.
    SURFEL_CLAIM_SLOTS: u32 = 16384;
    /// Side, in pixels, of the tiles over which a settling picture is compared with a path-traced one.
    SETTLE_TILE: u32 = 8;
    /// Bins of rays: 12 bits of place, 4 of direction.
    SURFEL_RAY_BINS: u32 = 65536;
    /// Octaves of distance, from half the edge of its cube on, that the trapezoidal grid's slices span.
    SURFEL_GRID_OCTAVES: f32 = 5.0;
    /// Weight of a pixel's value against a difference on a smooth surface in `gradient`'s reconstruction: wavelengths beyond
    /// 2 pi / 0.2 = 31 pixels are left to the values (Kettunen et al. 2015, section 6).
    GRADIENT_SCREEN: f32 = 0.04;
    /// Weight of B against a difference of its neighbour's in reconstruction in the image: as in `gradient`.
    IMAGE_SCREEN: f32 = 0.04;
    /// Schemes of reconstruction in the image, each a step nearer to Noack 2022: differences by normalised weights, none
    /// across folds and steps, each weighed by how far it is to be believed;
    IMAGE_WEIGHED: u32 = 0;
    /// all alike;
    IMAGE_MASKED: u32 = 1;
    /// across folds and steps too;
    IMAGE_UNMASKED: u32 = 2;
    /// the slopes of all overlapping surfels added up instead;
    IMAGE_SUMMED: u32 = 3;
    /// and next to no weight on values.
    IMAGE_UNSCREENED: u32 = 4;
    /// Frames of direct light that a moving picture takes over from the one before, at most.
    REUSED_FRAMES: u32 = 16;
    /// In the selector of a shading pass: diffuse direct light is kept for later frames. The bits below `REUSE_TURN_MASK`
    /// count the camera moves since the light changed.
    KEEPS_DIFFUSE_LIGHT: u32 = 0x8000_0000;
    /// See `KEEPS_DIFFUSE_LIGHT`.
    REUSE_TURN_MASK: u32 = 0xffff;
    /// In the selector of a reusing pass: there is a frame before this one.
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
