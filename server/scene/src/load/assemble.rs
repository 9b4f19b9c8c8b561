//! Places meshes in the scene: baked copies in scene space, instances in their own space; then builds the hierarchies.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};

use glam::{DMat3, DVec3, Vec3};

use super::accessor::Reader;
use super::animation::PosedNode;
use super::check::within;
use super::deform;
use super::document::item;
use super::hierarchy::{Hierarchy, PlacedNode};
use super::primitive::{self, PrimitiveData, Topology};
use super::tangent;
use crate::geometry::SceneGeometry;
use crate::{Bounds, Material, SceneError, SceneLimits};
use emit::Emit;

mod emit;

/// Copies of a mesh are baked up to this many triangles in total.
const MAX_COPIED_TRIANGLES: u64 = 65_536;

/// Geometry of a scene before textures are known.
pub(crate) struct Assembled {
    pub(crate) geometry: SceneGeometry,
    /// World position of the scene-space origin.
    pub(crate) origin: DVec3,
    /// Bounds in scene space; `None` for an empty scene.
    pub(crate) bounds: Option<Bounds>,
    pub(crate) node_names: Vec<String>,
    /// Corners of every emissive triangle in scene space, in light order, with (triangle, material).
    pub(crate) emitters: Vec<Emitter>,
    pub(crate) warnings: Vec<String>,
    pub(crate) build_secs: f64,
}

/// A triangle of an emissive material.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Emitter {
    pub(crate) corners: [Vec3; 3],
    pub(crate) triangle: u32,
    pub(crate) material: u32,
}

/// A primitive that makes triangles, with its place in the file for messages.
struct Part {
    mesh: usize,
    primitive: usize,
    topology: Topology,
    material: u32,
    vertex_count: u64,
    triangle_count: u64,
}

/// How a node's mesh enters the scene.
enum Placement {
    /// Copied into scene space; deformed data where the node is skinned or morphed.
    Baked {
        deformed: Option<Vec<Deformed>>,
    },
    Instanced,
}

/// Skinned (world positions) or morphed (node-space positions) data of one part.
struct Deformed {
    data: PrimitiveData,
    world_positions: Option<Vec<DVec3>>,
}

struct Use<'a> {
    placed: &'a PlacedNode,
    mesh: usize,
    placement: Placement,
}

/// What the assembler reads.
pub(crate) struct Inputs<'a> {
    pub(crate) reader: &'a Reader<'a>,
    pub(crate) hierarchy: &'a Hierarchy,
    pub(crate) posed: &'a [PosedNode],
    pub(crate) materials: &'a [Material],
    pub(crate) limits: &'a SceneLimits,
}

/// Builds all geometry.
pub(crate) fn assemble(inputs: &Inputs<'_>) -> Result<Assembled, SceneError> {
    let mut warnings = Vec::new();
    let parts = list_parts(inputs, &mut warnings)?;
    let mut uses = choose_placements(inputs, &parts)?;
    let mut statics: BTreeMap<usize, Vec<PrimitiveData>> = BTreeMap::new();
    for instance in &mut uses {
        match &mut instance.placement {
            Placement::Baked { deformed: Some(list) } => {
                *list = decode_deformed(inputs, instance.placed, &parts[&instance.mesh])?;
            }
            Placement::Baked { deformed: None } | Placement::Instanced => {
                if let Entry::Vacant(slot) = statics.entry(instance.mesh) {
                    slot.insert(decode_static(inputs, &parts[&instance.mesh])?);
                }
            }
        }
    }
    let world = world_bounds(&uses, &statics);
    let origin = world.map_or(DVec3::ZERO, |(low, high)| low * 0.5 + high * 0.5);
    let mut emitter = Emit::new(inputs, &parts, origin);
    for instance in &uses {
        emitter.place(instance, &statics)?;
    }
    emitter.finish(warnings, world)
}

type Parts = BTreeMap<usize, Vec<Part>>;

/// Sizes of all meshes in use, from the accessors' counts alone.
fn list_parts(inputs: &Inputs<'_>, warnings: &mut Vec<String>) -> Result<Parts, SceneError> {
    let document = inputs.reader.document;
    let default_material = (inputs.materials.len() - 1) as u32;
    let mut parts = Parts::new();
    for placed in &inputs.hierarchy.placed {
        let Some(mesh) = document.nodes[placed.node].mesh else { continue };
        if parts.contains_key(&mesh) {
            continue;
        }
        let described = item(&document.meshes, mesh, "meshes", &format!("nodes[{}].mesh", placed.node))?;
        let mut list = Vec::new();
        for (index, primitive) in described.primitives.iter().enumerate() {
            let field = format!("meshes[{mesh}].primitives[{index}]");
            let Some(topology) = Topology::of(primitive, &field)? else {
                warnings.push(format!("{field}: points and lines are left out"));
                continue;
            };
            if primitive.attributes.position.is_none() {
                warnings.push(format!("{field}: has no POSITION and is left out"));
                continue;
            }
            let material = match primitive.material {
                Some(material) => {
                    item(inputs.materials, material, "materials", &format!("{field}.material"))?;
                    material as u32
                }
                None => default_material,
            };
            let (vertex_count, triangle_count) = primitive::sizes(inputs.reader, primitive, topology, &field)?;
            list.push(Part { mesh, primitive: index, topology, material, vertex_count, triangle_count });
        }
        parts.insert(mesh, list);
    }
    Ok(parts)
}

/// Decides for every placed mesh whether it is copied or instanced, and admits the totals.
fn choose_placements<'a>(inputs: &Inputs<'a>, parts: &Parts) -> Result<Vec<Use<'a>>, SceneError> {
    let document = inputs.reader.document;
    let mut uses_of_mesh: BTreeMap<usize, u64> = BTreeMap::new();
    for mesh in inputs.hierarchy.placed.iter().filter_map(|placed| document.nodes[placed.node].mesh) {
        *uses_of_mesh.entry(mesh).or_default() += 1;
    }
    let (mut vertices, mut triangles, mut instances) = (0u64, 0u64, 1u64);
    let mut admitted: BTreeSet<usize> = BTreeSet::new();
    let mut uses = Vec::new();
    for placed in &inputs.hierarchy.placed {
        let Some(mesh) = document.nodes[placed.node].mesh else { continue };
        let list = &parts[&mesh];
        let mesh_triangles = list.iter().fold(0u64, |sum, part| sum.saturating_add(part.triangle_count));
        let mesh_vertices = list.iter().fold(0u64, |sum, part| sum.saturating_add(part.vertex_count));
        let is_emissive = list.iter().any(|part| is_emissive(&inputs.materials[part.material as usize]));
        let is_deformed = is_deformed(inputs, placed.node, mesh);
        let count = uses_of_mesh[&mesh];
        let is_small = mesh_triangles.saturating_mul(count) <= MAX_COPIED_TRIANGLES;
        let is_flat = DMat3::from_mat4(placed.world).determinant() == 0.0;
        let is_baked = count == 1 || is_emissive || is_deformed || is_small || is_flat;
        if is_baked || admitted.insert(mesh) {
            vertices = vertices.saturating_add(mesh_vertices);
            triangles = triangles.saturating_add(mesh_triangles);
        }
        instances += u64::from(!is_baked);
        within("vertices, copies included", vertices, u64::from(inputs.limits.max_vertices))?;
        within("triangles, copies included", triangles, u64::from(inputs.limits.max_triangles))?;
        within("instances", instances, u64::from(inputs.limits.max_instances))?;
        let placement = match (is_baked, is_deformed) {
            (true, true) => Placement::Baked { deformed: Some(Vec::new()) },
            (true, false) => Placement::Baked { deformed: None },
            (false, _) => Placement::Instanced,
        };
        uses.push(Use { placed, mesh, placement });
    }
    Ok(uses)
}

fn is_emissive(material: &Material) -> bool {
    !material.unlit && material.emissive.iter().any(|&x| x > 0.0)
}

/// Morph weights of a node: posed, its own, or the mesh's.
fn morph_weights<'a>(inputs: &Inputs<'a>, node: usize, mesh: usize) -> &'a [f64] {
    let document = inputs.reader.document;
    let posed = inputs.posed.get(node).and_then(|posed| posed.weights.as_deref());
    posed.or(document.nodes[node].weights.as_deref()).unwrap_or(&document.meshes[mesh].weights)
}

fn is_deformed(inputs: &Inputs<'_>, node: usize, mesh: usize) -> bool {
    let document = inputs.reader.document;
    let primitives = &document.meshes[mesh].primitives;
    let is_skinned = document.nodes[node].skin.is_some() && primitives.iter().any(|p| p.attributes.joints_0.is_some());
    let has_targets = primitives.iter().any(|p| !p.targets.is_empty());
    is_skinned || (has_targets && morph_weights(inputs, node, mesh).iter().any(|&weight| weight != 0.0))
}

fn field_of(part: &Part) -> String {
    format!("meshes[{}].primitives[{}]", part.mesh, part.primitive)
}

fn decode_part(inputs: &Inputs<'_>, part: &Part) -> Result<PrimitiveData, SceneError> {
    let primitive = &inputs.reader.document.meshes[part.mesh].primitives[part.primitive];
    primitive::decode(inputs.reader, primitive, part.topology, &field_of(part))
}

/// Makes tangents where a normal map needs them; returns the vertices that were doubled.
fn add_tangents(inputs: &Inputs<'_>, part: &Part, data: &mut PrimitiveData) -> Vec<usize> {
    match &inputs.materials[part.material as usize].normal_texture {
        Some(map) if data.tangents.is_none() => tangent::generate(data, map.uv_set as usize),
        _ => Vec::new(),
    }
}

fn decode_static(inputs: &Inputs<'_>, parts: &[Part]) -> Result<Vec<PrimitiveData>, SceneError> {
    let decode = |part| {
        let mut data = decode_part(inputs, part)?;
        add_tangents(inputs, part, &mut data);
        Ok(data)
    };
    parts.iter().map(decode).collect()
}

fn decode_deformed(inputs: &Inputs<'_>, placed: &PlacedNode, parts: &[Part]) -> Result<Vec<Deformed>, SceneError> {
    let document = inputs.reader.document;
    let node = &document.nodes[placed.node];
    let asked_by = format!("nodes[{}].skin", placed.node);
    let joints = match node.skin {
        Some(skin) => Some(deform::joint_matrices(inputs.reader, skin, inputs.hierarchy, &asked_by)?),
        None => None,
    };
    let decode = |part: &Part| {
        let field = field_of(part);
        let primitive = &document.meshes[part.mesh].primitives[part.primitive];
        let mut data = decode_part(inputs, part)?;
        deform::morph(inputs.reader, primitive, morph_weights(inputs, placed.node, part.mesh), &mut data, &field)?;
        let doubled = add_tangents(inputs, part, &mut data);
        let Some(joints) = joints.as_ref().filter(|_| primitive.attributes.joints_0.is_some()) else {
            return Ok(Deformed { data, world_positions: None });
        };
        let mut sets = primitive::influences(inputs.reader, primitive, joints.len(), &field)?;
        for set in &mut sets {
            set.joints.extend(doubled.iter().map(|&v| set.joints[v]).collect::<Vec<_>>());
            set.weights.extend(doubled.iter().map(|&v| set.weights[v]).collect::<Vec<_>>());
        }
        let world_positions = Some(deform::skin(&sets, joints, &mut data));
        Ok(Deformed { data, world_positions })
    };
    parts.iter().map(decode).collect()
}

/// Bounds of everything in world space; `None` where there is no vertex.
fn world_bounds(uses: &[Use<'_>], statics: &BTreeMap<usize, Vec<PrimitiveData>>) -> Option<(DVec3, DVec3)> {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let mut grow = |data: &PrimitiveData, position: &dyn Fn(usize) -> DVec3| {
        for &corner in data.triangles.iter().flatten() {
            let p = position(corner as usize);
            (low, high) = (low.min(p), high.max(p));
        }
    };
    for instance in uses {
        let placed = |data: &PrimitiveData, v: usize| {
            instance.placed.world.transform_point3(DVec3::from_array(data.positions[v].map(f64::from)))
        };
        match &instance.placement {
            Placement::Baked { deformed: Some(list) } => {
                for part in list {
                    match &part.world_positions {
                        Some(positions) => grow(&part.data, &|v| positions[v]),
                        None => grow(&part.data, &|v| placed(&part.data, v)),
                    }
                }
            }
            _ => statics[&instance.mesh].iter().for_each(|data| grow(data, &|v| placed(data, v))),
        }
    }
    (low.x <= high.x).then_some((low, high))
}
