//! Counter-based random numbers.

/// Key of one path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PathKey {
    /// Row-major index.
    pub pixel: u32,
    /// Number of the sample.
    pub sample: u32,
    /// Of the request.
    pub seed: [u32; 2],
}

/// Hash of four words to four words.
pub fn pcg4d(key: [u32; 4]) -> [u32; 4] {
    let mix = |v: &mut [u32; 4]| {
        v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[3]));
        v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
        v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
        v[3] = v[3].wrapping_add(v[1].wrapping_mul(v[2]));
    };
    let mut v = key.map(|word| word.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    mix(&mut v);
    v = v.map(|word| word ^ (word >> 16));
    mix(&mut v);
    v
}

/// Four numbers in [0, 1).
pub fn random4(key: PathKey, dimension: u32) -> [f32; 4] {
    let sample = key.sample ^ key.seed[1].wrapping_mul(0x9e37_79b9);
    pcg4d([key.pixel, sample, dimension, key.seed[0]]).map(to_unit)
}

/// One number in [0, 1) for a triangle hit along a ray.
pub fn random_for_triangle(key: PathKey, dimension: u32, triangle: u32) -> f32 {
    let pixel = key.pixel ^ triangle.wrapping_mul(0x85eb_ca6b);
    let sample = key.sample ^ key.seed[1].wrapping_mul(0x9e37_79b9);
    to_unit(pcg4d([pixel, sample, dimension, key.seed[0]])[3])
}

fn to_unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * 5.960_464_5e-8
}
