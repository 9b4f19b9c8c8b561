//! Meshes that the scene uses: admitted by the accessors' counts, then decoded.

use std::collections::BTreeMap;

use super::accessor::Reader;
use super::check::within;
use super::document::{Primitive, item};
use super::primitive::{self, PrimitiveData, Topology};
use super::tree::NodeTree;
use crate::{Material, SceneError, SceneLimits};

/// Parts of each mesh in use, by its index in the file.
pub(crate) type Meshes = BTreeMap<usize, Vec<Part>>;

/// A primitive that makes triangles, decoded.
#[derive(Debug)]
pub(crate) struct Part {
    /// Index into the file's meshes.
    pub(crate) mesh: usize,
    /// Index into the mesh's primitives.
    pub(crate) primitive: usize,
    pub(crate) material: u32,
    /// Attributes as the file has them: neither morphed nor skinned.
    pub(crate) data: PrimitiveData,
}

impl Part {
    /// Its place in the file, for messages.
    pub(crate) fn field(&self) -> String {
        field(self.mesh, self.primitive)
    }
}

fn field(mesh: usize, primitive: usize) -> String {
    format!("meshes[{mesh}].primitives[{primitive}]")
}

/// A primitive whose sizes are known and whose data are not yet read.
struct Listed<'a> {
    mesh: usize,
    index: usize,
    primitive: &'a Primitive,
    topology: Topology,
    material: u32,
}

/// Decodes every mesh that a node of the scene uses.
pub(crate) fn decode(
    reader: &Reader<'_>,
    tree: &NodeTree,
    materials: &[Material],
    limits: &SceneLimits,
    warnings: &mut Vec<String>,
) -> Result<Meshes, SceneError> {
    let mut meshes = Meshes::new();
    for part in list(reader, tree, materials, limits, warnings, &mut meshes)? {
        let data = primitive::decode(reader, part.primitive, part.topology, &field(part.mesh, part.index))?;
        let decoded = Part { mesh: part.mesh, primitive: part.index, material: part.material, data };
        meshes.entry(part.mesh).or_default().push(decoded);
    }
    Ok(meshes)
}

/// Lists the primitives of all meshes in use and checks their totals, from the accessors' counts alone. Every mesh in
/// use gets an entry, also those without a triangle.
fn list<'a>(
    reader: &Reader<'a>,
    tree: &NodeTree,
    materials: &[Material],
    limits: &SceneLimits,
    warnings: &mut Vec<String>,
    meshes: &mut Meshes,
) -> Result<Vec<Listed<'a>>, SceneError> {
    let document = reader.document;
    let default_material = (materials.len() - 1) as u32;
    let (mut vertices, mut triangles) = (0u64, 0u64);
    let mut listed = Vec::new();
    for placed in &tree.nodes {
        let Some(mesh) = document.nodes[placed.node].mesh else { continue };
        if meshes.contains_key(&mesh) {
            continue;
        }
        meshes.insert(mesh, Vec::new());
        let described = item(&document.meshes, mesh, "meshes", &format!("nodes[{}].mesh", placed.node))?;
        for (index, primitive) in described.primitives.iter().enumerate() {
            let field = field(mesh, index);
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
                    item(materials, material, "materials", &format!("{field}.material"))?;
                    material as u32
                }
                None => default_material,
            };
            let (vertex_count, triangle_count) = primitive::sizes(reader, primitive, topology, &field)?;
            vertices = vertices.saturating_add(vertex_count);
            triangles = triangles.saturating_add(triangle_count);
            within("vertices", vertices, u64::from(limits.max_vertices))?;
            within("triangles", triangles, u64::from(limits.max_triangles))?;
            listed.push(Listed { mesh, index, primitive, topology, material });
        }
    }
    Ok(listed)
}
