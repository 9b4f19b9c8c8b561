//! Morph targets and skins applied at the chosen instant.

use glam::{DMat3, DMat4, DVec3};

use crate::SceneError;
use crate::asset::Reader;
use crate::asset::check::invalid;
use crate::asset::document::{Primitive, item};
use crate::asset::primitive::{Influences, PrimitiveData, same_count};
use crate::state::Nodes;

/// Adds the weighted morph targets. Targets beyond the weights count as weight 0.
pub(super) fn morph(
    reader: &Reader<'_>,
    primitive: &Primitive,
    weights: &[f64],
    data: &mut PrimitiveData,
    field: &str,
) -> Result<(), SceneError> {
    let count = data.positions.len() as u64;
    for (t, (target, &weight)) in primitive.targets.iter().zip(weights).enumerate() {
        if weight == 0.0 {
            continue;
        }
        let field = format!("{field}.targets[{t}]");
        let read = |index: Option<usize>| -> Result<Option<Vec<[f32; 3]>>, SceneError> {
            let Some(index) = index else { return Ok(None) };
            same_count(reader, index, count, &field)?;
            reader.floats::<3>(index, &field).map(Some)
        };
        let add = |value: &mut f32, delta: f32| *value = (f64::from(*value) + weight * f64::from(delta)) as f32;
        if let Some(deltas) = read(target.position)? {
            for (position, delta) in data.positions.iter_mut().zip(deltas) {
                position.iter_mut().zip(delta).for_each(|(p, d)| add(p, d));
            }
        }
        if let (Some(normals), Some(deltas)) = (&mut data.normals, read(target.normal)?) {
            for (normal, delta) in normals.iter_mut().zip(deltas) {
                normal.iter_mut().zip(delta).for_each(|(n, d)| add(n, d));
            }
        }
        if let (Some(tangents), Some(deltas)) = (&mut data.tangents, read(target.tangent)?) {
            for (tangent, delta) in tangents.iter_mut().zip(deltas) {
                tangent.iter_mut().zip(delta).for_each(|(n, d)| add(n, d));
            }
        }
    }
    if data.positions.iter().flatten().any(|x| !x.is_finite()) {
        return Err(invalid(format!("{field}.targets"), "move a vertex to infinity"));
    }
    Ok(())
}

/// World matrices of a skin's joints times their inverse bind matrices.
pub(super) fn joint_matrices(
    reader: &Reader<'_>,
    skin: usize,
    nodes: &Nodes,
    asked_by: &str,
) -> Result<Vec<DMat4>, SceneError> {
    let field = format!("skins[{skin}]");
    let skin = item(&reader.document.skins, skin, "skins", asked_by)?;
    let inverse_bind = match skin.inverse_bind_matrices {
        Some(accessor) => {
            let matrices = reader.floats::<16>(accessor, &format!("{field}.inverseBindMatrices"))?;
            if matrices.len() < skin.joints.len() {
                let problem = format!("has {} matrices for {} joints", matrices.len(), skin.joints.len());
                return Err(invalid(format!("{field}.inverseBindMatrices"), problem));
            }
            Some(matrices)
        }
        None => None,
    };
    skin.joints
        .iter()
        .enumerate()
        .map(|(k, &joint)| {
            let world = nodes.world.get(joint).copied().flatten();
            let world = world.ok_or_else(|| invalid(format!("{field}.joints[{k}]"), "is not a node of the scene"))?;
            let bind = inverse_bind.as_ref().map(|m| DMat4::from_cols_array(&m[k].map(f64::from)));
            Ok(world * bind.unwrap_or(DMat4::IDENTITY))
        })
        .collect()
}

/// Blends the joints' matrices by the weights as given (they are not normalised) and moves every vertex to world space.
/// The node's own transform does not count for a skinned mesh. Returns world positions; normals and tangents are turned
/// in place.
pub(super) fn skin(sets: &[Influences], joints: &[DMat4], data: &mut PrimitiveData) -> Vec<DVec3> {
    let blend = |vertex: usize| -> DMat4 {
        let mut sum = DMat4::ZERO;
        for set in sets {
            for (&joint, &weight) in set.joints[vertex].iter().zip(&set.weights[vertex]) {
                if weight != 0.0 {
                    sum += joints[joint as usize] * f64::from(weight);
                }
            }
        }
        sum
    };
    let mut positions = Vec::with_capacity(data.positions.len());
    for vertex in 0..data.positions.len() {
        let matrix = blend(vertex);
        positions.push(matrix.transform_point3(DVec3::from_array(data.positions[vertex].map(f64::from))));
        if let Some(normals) = &mut data.normals {
            let normal = DVec3::from_array(normals[vertex].map(f64::from));
            normals[vertex] = (normal_matrix(&matrix) * normal).normalize_or_zero().as_vec3().to_array();
        }
        if let Some(tangents) = &mut data.tangents {
            let [x, y, z, w] = tangents[vertex].map(f64::from);
            let turned = matrix.transform_vector3(DVec3::new(x, y, z)).normalize_or_zero().as_vec3();
            tangents[vertex] = [turned.x, turned.y, turned.z, w as f32];
        }
    }
    positions
}

/// Turns normals: the cofactor matrix, which is the inverse transpose up to a positive factor and exists for singular
/// matrices too.
pub(super) fn normal_matrix(matrix: &DMat4) -> DMat3 {
    let m = DMat3::from_mat4(*matrix);
    // scaled first, so that the products of tiny or huge matrices do not leave the range
    let largest = m.to_cols_array().iter().fold(0.0f64, |a, x| a.max(x.abs()));
    let m = if largest > 0.0 { m * (1.0 / largest) } else { m };
    let cofactor = DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
    if m.determinant() < 0.0 { cofactor * -1.0 } else { cofactor }
}
