//! Tangents for normal maps where the file has none.

use glam::{Vec2, Vec3};

use crate::asset::primitive::PrimitiveData;

/// Gives every vertex a tangent along the u direction of texture set `uv_set`, averaged over its triangles by angle.
/// Vertices shared by mirrored and plain texture islands are split, so that each keeps its own bitangent sign; the
/// originals of the vertices appended for that are returned.
pub(super) fn generate(data: &mut PrimitiveData, uv_set: usize) -> Vec<usize> {
    let Some(uvs) = data.uvs[uv_set].clone() else { return Vec::new() };
    let is_mirrored: Vec<bool> = data.triangles.iter().map(|corners| uv_area(corners, &uvs) < 0.0).collect();
    let doubled = split_mirrored(data, &is_mirrored);
    let Some(uvs) = data.uvs[uv_set].as_ref() else { return doubled };

    let mut sums = vec![Vec3::ZERO; data.positions.len()];
    let mut signs = vec![1.0f32; data.positions.len()];
    for (corners, &mirrored) in data.triangles.iter().zip(&is_mirrored) {
        let p = corners.map(|c| Vec3::from_array(data.positions[c as usize]));
        let uv = corners.map(|c| Vec2::from_array(uvs[c as usize]));
        let (e1, e2) = (p[1] - p[0], p[2] - p[0]);
        let (d1, d2) = (uv[1] - uv[0], uv[2] - uv[0]);
        let direction = (e1 * d2.y - e2 * d1.y) * if mirrored { -1.0 } else { 1.0 };
        let direction = direction.normalize_or_zero();
        for k in 0..3 {
            let (a, b) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
            let angle = a.normalize_or_zero().dot(b.normalize_or_zero()).clamp(-1.0, 1.0).acos();
            sums[corners[k] as usize] += direction * angle;
            signs[corners[k] as usize] = if mirrored { -1.0 } else { 1.0 };
        }
    }
    let normals = data.normals.as_ref();
    let tangents = sums.iter().zip(&signs).enumerate().map(|(vertex, (&sum, &sign))| {
        let normal = normals.map_or(Vec3::ZERO, |normals| Vec3::from_array(normals[vertex]).normalize_or_zero());
        let flat = sum - normal * normal.dot(sum);
        let fallback = if normal == Vec3::ZERO { Vec3::X } else { normal.any_orthonormal_vector() };
        let tangent = flat.normalize_or(fallback);
        [tangent.x, tangent.y, tangent.z, sign]
    });
    data.tangents = Some(tangents.collect());
    doubled
}

/// Twice the signed area of a triangle in texture space.
fn uv_area(corners: &[u32; 3], uvs: &[[f32; 2]]) -> f32 {
    let [a, b, c] = corners.map(|corner| Vec2::from_array(uvs[corner as usize]));
    (b - a).perp_dot(c - a)
}

/// Duplicates vertices that plain and mirrored triangles share; the mirrored ones get the copy.
fn split_mirrored(data: &mut PrimitiveData, is_mirrored: &[bool]) -> Vec<usize> {
    let mut is_plain = vec![false; data.positions.len()];
    for (corners, _) in data.triangles.iter().zip(is_mirrored).filter(|(_, mirrored)| !**mirrored) {
        for &corner in corners {
            is_plain[corner as usize] = true;
        }
    }
    let mut copies: Vec<Option<u32>> = vec![None; data.positions.len()];
    let mut originals: Vec<usize> = Vec::new();
    let first_copy = data.positions.len() as u32;
    for (corners, _) in data.triangles.iter_mut().zip(is_mirrored).filter(|(_, mirrored)| **mirrored) {
        for corner in corners.iter_mut().filter(|corner| is_plain[**corner as usize]) {
            *corner = *copies[*corner as usize].get_or_insert_with(|| {
                originals.push(*corner as usize);
                first_copy + originals.len() as u32 - 1
            });
        }
    }
    data.positions.extend(originals.iter().map(|&o| data.positions[o]).collect::<Vec<_>>());
    if let Some(normals) = &mut data.normals {
        normals.extend(originals.iter().map(|&o| normals[o]).collect::<Vec<_>>());
    }
    for uvs in data.uvs.iter_mut().flatten() {
        uvs.extend(originals.iter().map(|&o| uvs[o]).collect::<Vec<_>>());
    }
    if let Some(colors) = &mut data.colors {
        colors.extend(originals.iter().map(|&o| colors[o]).collect::<Vec<_>>());
    }
    originals
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two unit quads side by side whose texture is mirrored about the shared edge x = 1.
    fn mirrored_quads() -> PrimitiveData {
        PrimitiveData {
            positions: [[0, 0], [1, 0], [1, 1], [0, 1], [2, 0], [2, 1]]
                .map(|[x, y]| [x as f32, y as f32, 0.0])
                .to_vec(),
            normals: Some(vec![[0.0, 0.0, 1.0]; 6]),
            uvs: [Some([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0], [0, 1]].map(|uv| uv.map(|x| x as f32)).to_vec()), None],
            triangles: vec![[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]],
            ..PrimitiveData::default()
        }
    }

    #[test]
    fn mirrored_islands_are_split_and_signed() {
        let mut data = mirrored_quads();
        generate(&mut data, 0);
        assert_eq!(data.positions.len(), 8, "the two shared vertices are doubled");
        let tangents = data.tangents.unwrap();
        for (k, triangle) in data.triangles.iter().enumerate() {
            for &corner in triangle {
                let [x, y, z, w] = tangents[corner as usize];
                let expected = if k < 2 { [1.0, 0.0, 0.0, 1.0] } else { [-1.0, 0.0, 0.0, -1.0] };
                for (a, b) in [x, y, z, w].iter().zip(expected) {
                    assert!((a - b).abs() < 1e-6, "triangle {k}: {:?}", tangents[corner as usize]);
                }
            }
        }
    }
}
