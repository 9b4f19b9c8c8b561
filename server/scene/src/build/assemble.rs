//! Places meshes in the scene: baked copies in scene space, instances in their own space.

use std::borrow::Cow;
use std::collections::BTreeMap;

use glam::{DVec3, Vec3};

use super::deform;
use super::emit::Emit;
use super::placement::{self, Placement, Use};
use super::tangent;
use crate::asset::primitive::{self, PrimitiveData};
use crate::asset::{Part, Reader, SceneAsset};
use crate::geometry::SceneGeometry;
use crate::state::{Nodes, PlacedNode};
use crate::{Bounds, SceneError};

/// Geometry of a scene before textures are known.
pub(super) struct Assembled {
    pub(super) geometry: SceneGeometry,
    /// World position of the scene-space origin.
    pub(super) origin: DVec3,
    /// Bounds in scene space; `None` for an empty scene.
    pub(super) bounds: Option<Bounds>,
    pub(super) node_names: Vec<String>,
    /// Every emissive triangle, in light order.
    pub(super) emitters: Vec<Emitter>,
    pub(super) warnings: Vec<String>,
    pub(super) build_secs: f64,
}

/// A triangle of an emissive material.
#[derive(Clone, Copy, Debug)]
pub(super) struct Emitter {
    /// Corners in scene space.
    pub(super) corners: [Vec3; 3],
    pub(super) triangle: u32,
    pub(super) material: u32,
}

/// Data of one part that are placed as they are.
pub(super) type Rigid<'a> = BTreeMap<usize, Vec<Cow<'a, PrimitiveData>>>;

/// Data of one part after morph targets (node space) and skin (world space).
pub(super) struct Deformed {
    pub(super) data: PrimitiveData,
    /// Where the part is skinned.
    pub(super) world_positions: Option<Vec<DVec3>>,
}

/// A use of a mesh with what its vertices are read from.
pub(super) struct Placed<'a> {
    pub(super) used: Use<'a>,
    /// One entry for each part of a deformed mesh, else empty.
    pub(super) deformed: Vec<Deformed>,
}

/// Builds all geometry.
pub(super) fn assemble(asset: &SceneAsset<'_>, nodes: &Nodes) -> Result<Assembled, SceneError> {
    let reader = asset.reader();
    let mut rigid = Rigid::new();
    let mut placed = Vec::new();
    for used in placement::choose(asset, nodes)? {
        let parts = &asset.meshes[&used.mesh];
        let deformed = if used.placement == Placement::Deformed {
            deform_parts(asset, &reader, nodes, used.placed, parts)?
        } else {
            rigid.entry(used.mesh).or_insert_with(|| parts.iter().map(|part| with_tangents(asset, part)).collect());
            Vec::new()
        };
        placed.push(Placed { used, deformed });
    }
    let world = world_bounds(&placed, &rigid);
    let origin = world.map_or(DVec3::ZERO, |(low, high)| low * 0.5 + high * 0.5);
    let mut emit = Emit::new(asset, origin);
    for item in &placed {
        emit.place(item, &rigid)?;
    }
    emit.finish(world)
}

/// Makes tangents where a normal map needs them; returns the vertices that were doubled.
fn add_tangents(asset: &SceneAsset<'_>, part: &Part, data: &mut PrimitiveData) -> Vec<usize> {
    match &asset.materials[part.material as usize].normal_texture {
        Some(map) if data.tangents.is_none() => tangent::generate(data, map.uv_set as usize),
        _ => Vec::new(),
    }
}

/// The part's own data, copied where tangents have to be made.
fn with_tangents<'a>(asset: &SceneAsset<'_>, part: &'a Part) -> Cow<'a, PrimitiveData> {
    if part.data.tangents.is_some() || asset.materials[part.material as usize].normal_texture.is_none() {
        return Cow::Borrowed(&part.data);
    }
    let mut data = part.data.clone();
    add_tangents(asset, part, &mut data);
    Cow::Owned(data)
}

fn deform_parts(
    asset: &SceneAsset<'_>,
    reader: &Reader<'_>,
    nodes: &Nodes,
    placed: &PlacedNode,
    parts: &[Part],
) -> Result<Vec<Deformed>, SceneError> {
    let document = &asset.document;
    let asked_by = format!("nodes[{}].skin", placed.node);
    let joints = match document.nodes[placed.node].skin {
        Some(skin) => Some(deform::joint_matrices(reader, skin, nodes, &asked_by)?),
        None => None,
    };
    let deform_part = |part: &Part| {
        let field = part.field();
        let primitive = &document.meshes[part.mesh].primitives[part.primitive];
        let mut data = part.data.clone();
        let weights = nodes.weights(asset, placed.node, part.mesh);
        deform::morph(reader, primitive, weights, &mut data, &field)?;
        let doubled = add_tangents(asset, part, &mut data);
        let Some(joints) = joints.as_ref().filter(|_| primitive.attributes.joints_0.is_some()) else {
            return Ok(Deformed { data, world_positions: None });
        };
        let mut sets = primitive::influences(reader, primitive, joints.len(), &field)?;
        for set in &mut sets {
            set.joints.extend(doubled.iter().map(|&v| set.joints[v]).collect::<Vec<_>>());
            set.weights.extend(doubled.iter().map(|&v| set.weights[v]).collect::<Vec<_>>());
        }
        let world_positions = Some(deform::skin(&sets, joints, &mut data));
        Ok(Deformed { data, world_positions })
    };
    parts.iter().map(deform_part).collect()
}

/// Bounds of everything in world space; `None` where there is no vertex.
fn world_bounds(placed: &[Placed<'_>], rigid: &Rigid<'_>) -> Option<(DVec3, DVec3)> {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let mut grow = |data: &PrimitiveData, position: &dyn Fn(usize) -> DVec3| {
        for &corner in data.triangles.iter().flatten() {
            let p = position(corner as usize);
            (low, high) = (low.min(p), high.max(p));
        }
    };
    for Placed { used, deformed } in placed {
        let in_world = |data: &PrimitiveData, v: usize| {
            used.placed.world.transform_point3(DVec3::from_array(data.positions[v].map(f64::from)))
        };
        if used.placement == Placement::Deformed {
            for part in deformed {
                match &part.world_positions {
                    Some(positions) => grow(&part.data, &|v| positions[v]),
                    None => grow(&part.data, &|v| in_world(&part.data, v)),
                }
            }
        } else {
            rigid[&used.mesh].iter().for_each(|data| grow(data, &|v| in_world(data, v)));
        }
    }
    (low.x <= high.x).then_some((low, high))
}
