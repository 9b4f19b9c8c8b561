//! Mean radiance of emissive triangles.

use glam::Vec3;
use rayon::prelude::*;

use super::assemble::Emitter;
use crate::sample::{sample_texture, srgb_to_linear};
use crate::{EmissiveTriangle, Material, SceneGeometry, Texture, TextureRef};

/// Texture samples over all emissive triangles at most.
const MAX_SAMPLES: usize = 1 << 26;

/// Areas and mean radiances of all emitters.
pub(super) fn measure(
    emitters: &[Emitter],
    geometry: &SceneGeometry,
    materials: &[Material],
    textures: &[Texture],
) -> Vec<EmissiveTriangle> {
    let most = (MAX_SAMPLES / emitters.len().max(1)).clamp(4, 1024);
    emitters
        .par_iter()
        .map(|emitter| {
            let [a, b, c] = emitter.corners.map(Vec3::as_dvec3);
            let area = ((b - a).cross(c - a).length() * 0.5) as f32;
            let material = &materials[emitter.material as usize];
            let mean = match &material.emissive_texture {
                Some(used) => {
                    let texture = &textures[used.texture as usize];
                    let mean = mean_texel(texture, corner_uvs(geometry, emitter.triangle, used), most);
                    std::array::from_fn(|k| material.emissive[k] * mean[k])
                }
                None => material.emissive,
            };
            EmissiveTriangle {
                corners: emitter.corners,
                triangle: emitter.triangle,
                material: emitter.material,
                mean_radiance: mean,
                area: if area.is_finite() { area } else { 0.0 },
            }
        })
        .collect()
}

fn corner_uvs(geometry: &SceneGeometry, triangle: u32, used: &TextureRef) -> [[f32; 2]; 3] {
    geometry.triangles[triangle as usize].vertices.map(|vertex| {
        let vertex = &geometry.vertices[vertex as usize];
        used.apply(if used.uv_set == 0 { vertex.uv0 } else { vertex.uv1 })
    })
}

/// Mean of a decoded sRGB texture over a triangle: about two samples a covered texel on a regular barycentric grid.
fn mean_texel(texture: &Texture, uvs: [[f32; 2]; 3], most: usize) -> [f32; 3] {
    let (w, h) = (f64::from(texture.width), f64::from(texture.height));
    let [a, b, c] = uvs.map(|uv| [f64::from(uv[0]) * w, f64::from(uv[1]) * h]);
    let texels = ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])).abs() * 0.5;
    let samples = if texels.is_finite() { (texels * 2.0).clamp(16.0, 1024.0) as usize } else { 1024 };
    // n subdivisions make n^2 congruent triangles; their centroids are the samples
    let n = (samples.min(most) as f64).sqrt().ceil() as usize;
    let mut sum = [0.0f64; 3];
    let mut add = |u: f64, v: f64| {
        let at: [f32; 2] = std::array::from_fn(|k| {
            let (a, b, c) = (f64::from(uvs[0][k]), f64::from(uvs[1][k]), f64::from(uvs[2][k]));
            (a * (1.0 - u - v) + b * u + c * v) as f32
        });
        let texel = sample_texture(texture, at, srgb_to_linear);
        sum.iter_mut().zip(texel).for_each(|(s, x)| *s += f64::from(x));
    };
    let step = 1.0 / n as f64;
    for i in 0..n {
        for j in 0..n - i {
            add((i as f64 + 1.0 / 3.0) * step, (j as f64 + 1.0 / 3.0) * step);
            if i + j + 1 < n {
                add((i as f64 + 2.0 / 3.0) * step, (j as f64 + 2.0 / 3.0) * step);
            }
        }
    }
    sum.map(|s| (s / (n * n) as f64) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Wrap;

    #[test]
    fn half_lit_textures_give_half_the_radiance() {
        let texels: Vec<u8> = (0..16 * 16).flat_map(|k| if k % 16 < 8 { [255; 4] } else { [0, 0, 0, 255] }).collect();
        let texture = Texture {
            width: 16,
            height: 16,
            texels: texels.into(),
            wrap_u: Wrap::ClampToEdge,
            wrap_v: Wrap::ClampToEdge,
            is_linear: true,
        };
        let upper = mean_texel(&texture, [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]], 1024);
        let lower = mean_texel(&texture, [[0.0, 0.0], [1.0, 1.0], [0.0, 1.0]], 1024);
        assert!((upper[0] - 0.25).abs() < 0.01, "{upper:?}");
        assert!((lower[0] - 0.75).abs() < 0.01, "{lower:?}");
    }
}
