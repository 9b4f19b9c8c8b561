//! One primitive of a mesh, decoded: attributes by vertex and a plain triangle list.

use super::accessor::Reader;
use super::check::invalid;
use super::document::Primitive;
use crate::SceneError;

/// Decoded attributes; every list that is present has one entry a vertex.
#[derive(Clone, Debug, Default)]
pub(crate) struct PrimitiveData {
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) normals: Option<Vec<[f32; 3]>>,
    pub(crate) tangents: Option<Vec<[f32; 4]>>,
    pub(crate) uvs: [Option<Vec<[f32; 2]>>; 2],
    pub(crate) colors: Option<Vec<[f32; 4]>>,
    /// Corners, every one a valid vertex index.
    pub(crate) triangles: Vec<[u32; 3]>,
}

/// Joints and weights of a vertex, four at a time.
#[derive(Clone, Debug)]
pub(crate) struct Influences {
    pub(crate) joints: Vec<[u32; 4]>,
    pub(crate) weights: Vec<[f32; 4]>,
}

/// Modes that make triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Topology {
    Triangles,
    Strip,
    Fan,
}

impl Topology {
    /// Topology of a primitive; `None` for points and lines, which have no surface.
    pub(crate) fn of(primitive: &Primitive, field: &str) -> Result<Option<Self>, SceneError> {
        match primitive.mode {
            None | Some(4) => Ok(Some(Self::Triangles)),
            Some(5) => Ok(Some(Self::Strip)),
            Some(6) => Ok(Some(Self::Fan)),
            Some(0..=3) => Ok(None),
            Some(mode) => Err(invalid(format!("{field}.mode"), format!("{mode} is unknown"))),
        }
    }

    /// Triangles that `corners` corners make.
    pub(crate) fn triangle_count(self, corners: u64) -> u64 {
        match self {
            Self::Triangles => corners / 3,
            Self::Strip | Self::Fan => corners.saturating_sub(2),
        }
    }

    fn triangles(self, corners: &[u32]) -> Vec<[u32; 3]> {
        match self {
            Self::Triangles => corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
            // every other triangle of a strip runs the other way round
            Self::Strip => corners
                .windows(3)
                .enumerate()
                .map(|(k, c)| if k % 2 == 0 { [c[0], c[1], c[2]] } else { [c[2], c[1], c[0]] })
                .collect(),
            Self::Fan => match corners.split_first() {
                Some((&hub, rim)) => rim.windows(2).map(|c| [hub, c[0], c[1]]).collect(),
                None => Vec::new(),
            },
        }
    }
}

/// Vertices and triangles a primitive will have, from its accessors' counts.
pub(crate) fn sizes(
    reader: &Reader<'_>,
    primitive: &Primitive,
    topology: Topology,
    field: &str,
) -> Result<(u64, u64), SceneError> {
    let Some(position) = primitive.attributes.position else { return Ok((0, 0)) };
    let vertices = reader.count(position, field)?;
    let corners = match primitive.indices {
        Some(indices) => reader.count(indices, field)?,
        None => vertices,
    };
    Ok((vertices, topology.triangle_count(corners)))
}

/// Decodes a primitive. Its sizes have been admitted before.
pub(crate) fn decode(
    reader: &Reader<'_>,
    primitive: &Primitive,
    topology: Topology,
    field: &str,
) -> Result<PrimitiveData, SceneError> {
    let attributes = &primitive.attributes;
    let Some(position) = attributes.position else { return Ok(PrimitiveData::default()) };
    let count = reader.count(position, field)?;
    let matching = |index: Option<usize>, name: &str| -> Result<Option<usize>, SceneError> {
        let Some(index) = index else { return Ok(None) };
        same_count(reader, index, count, &format!("{field}.attributes.{name}"))?;
        Ok(Some(index))
    };
    let asked = |name: &str| format!("{field}.attributes.{name}");
    let optional = |index: Option<usize>, name: &'static str| -> Result<Option<(usize, String)>, SceneError> {
        Ok(matching(index, name)?.map(|index| (index, asked(name))))
    };
    let positions = reader.floats::<3>(position, &asked("POSITION"))?;
    let corners = match primitive.indices {
        Some(indices) => {
            let corners = reader.unsigned::<1>(indices, &format!("{field}.indices"))?;
            if let Some(at) = corners.iter().position(|corner| u64::from(corner[0]) >= count) {
                let problem = format!("element {at} is {}, but there are {count} vertices", corners[at][0]);
                return Err(invalid(format!("accessors[{indices}]"), problem));
            }
            corners.into_iter().map(|[corner]| corner).collect()
        }
        None => (0..positions.len() as u32).collect::<Vec<_>>(),
    };
    let mut data = PrimitiveData { positions, triangles: topology.triangles(&corners), ..PrimitiveData::default() };
    if let Some((index, asked)) = optional(attributes.normal, "NORMAL")? {
        data.normals = Some(reader.floats::<3>(index, &asked)?);
    }
    if let Some((index, asked)) = optional(attributes.tangent, "TANGENT")? {
        data.tangents = Some(reader.floats::<4>(index, &asked)?);
    }
    if let Some((index, asked)) = optional(attributes.texcoord_0, "TEXCOORD_0")? {
        data.uvs[0] = Some(reader.floats::<2>(index, &asked)?);
    }
    if let Some((index, asked)) = optional(attributes.texcoord_1, "TEXCOORD_1")? {
        data.uvs[1] = Some(reader.floats::<2>(index, &asked)?);
    }
    if let Some((index, asked)) = optional(attributes.color_0, "COLOR_0")? {
        data.colors = Some(reader.colors(index, &asked)?);
    }
    Ok(data)
}

/// Joints and weights of a primitive, one entry for each set of four; joints are below `joint_count`.
pub(crate) fn influences(
    reader: &Reader<'_>,
    primitive: &Primitive,
    joint_count: usize,
    field: &str,
) -> Result<Vec<Influences>, SceneError> {
    let attributes = &primitive.attributes;
    let Some(position) = attributes.position else { return Ok(Vec::new()) };
    let count = reader.count(position, field)?;
    let mut sets = Vec::new();
    for (joints, weights, name) in
        [(attributes.joints_0, attributes.weights_0, "0"), (attributes.joints_1, attributes.weights_1, "1")]
    {
        let (Some(joints), Some(weights)) = (joints, weights) else { continue };
        let asked = format!("{field}.attributes.JOINTS_{name}");
        same_count(reader, joints, count, &asked)?;
        same_count(reader, weights, count, &asked)?;
        let set = Influences {
            joints: reader.unsigned::<4>(joints, &asked)?,
            weights: reader.floats::<4>(weights, &format!("{field}.attributes.WEIGHTS_{name}"))?,
        };
        let outside = set.joints.iter().flatten().find(|&&joint| joint as usize >= joint_count);
        if let Some(joint) = outside {
            let problem = format!("names joint {joint}, but the skin has {joint_count}");
            return Err(invalid(format!("accessors[{joints}]"), problem));
        }
        sets.push(set);
    }
    Ok(sets)
}

/// Checks that an attribute has one element a vertex.
pub(crate) fn same_count(reader: &Reader<'_>, index: usize, count: u64, asked_by: &str) -> Result<(), SceneError> {
    let found = reader.count(index, asked_by)?;
    if found == count {
        return Ok(());
    }
    Err(invalid(asked_by, format!("has {found} elements, but POSITION has {count}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans_keep_one_orientation() {
        assert_eq!(Topology::Strip.triangles(&[0, 1, 2, 3, 4]), [[0, 1, 2], [3, 2, 1], [2, 3, 4]]);
        assert_eq!(Topology::Fan.triangles(&[9, 1, 2, 3]), [[9, 1, 2], [9, 2, 3]]);
        assert_eq!(Topology::Triangles.triangles(&[0, 1, 2, 3]), [[0, 1, 2]]);
        assert!(Topology::Fan.triangles(&[]).is_empty());
        assert_eq!(Topology::Strip.triangle_count(1), 0);
    }
}
