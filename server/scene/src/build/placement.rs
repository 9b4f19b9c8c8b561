//! Decides for every placed mesh whether it is copied into scene space or instanced.
//!
//! A mesh is copied where it may not move and copies are few or small. Lights are always copied, since the light table
//! holds them in scene space, as are skinned and morphed meshes, whose vertices are new in every state.

use std::collections::{BTreeMap, BTreeSet};

use glam::DMat3;

use crate::Material;
use crate::SceneError;
use crate::asset::SceneAsset;
use crate::asset::check::within;
use crate::state::{Nodes, PlacedNode};

/// Copies of a mesh are baked up to this many triangles in total.
const MAX_COPIED_TRIANGLES: u64 = 65_536;

/// How a node's mesh enters the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Placement {
    /// Copied into scene space.
    Baked,
    /// Copied into scene space after morph targets and skin.
    Deformed,
    /// Kept in its own space and referred to by an instance.
    Instanced,
}

/// A mesh at a node.
#[derive(Clone, Copy, Debug)]
pub(super) struct Use<'a> {
    pub(super) placed: &'a PlacedNode,
    /// Index into the file's meshes.
    pub(super) mesh: usize,
    pub(super) placement: Placement,
}

/// Chooses a placement for every use of a mesh and admits the totals.
pub(super) fn choose<'a>(asset: &SceneAsset<'_>, nodes: &'a Nodes) -> Result<Vec<Use<'a>>, SceneError> {
    let (document, limits) = (&asset.document, &asset.limits);
    let mut uses_of_mesh: BTreeMap<usize, u64> = BTreeMap::new();
    for mesh in nodes.placed.iter().filter_map(|placed| document.nodes[placed.node].mesh) {
        *uses_of_mesh.entry(mesh).or_default() += 1;
    }
    let (mut vertices, mut triangles, mut instances) = (0u64, 0u64, 1u64);
    let mut admitted: BTreeSet<usize> = BTreeSet::new();
    let mut uses = Vec::new();
    for placed in &nodes.placed {
        let Some(mesh) = document.nodes[placed.node].mesh else { continue };
        let parts = &asset.meshes[&mesh];
        let mesh_triangles: u64 = parts.iter().map(|part| part.data.triangles.len() as u64).sum();
        let mesh_vertices: u64 = parts.iter().map(|part| part.data.positions.len() as u64).sum();
        let is_emissive = parts.iter().any(|part| is_emissive(&asset.materials[part.material as usize]));
        let is_small = mesh_triangles.saturating_mul(uses_of_mesh[&mesh]) <= MAX_COPIED_TRIANGLES;
        let is_flat = DMat3::from_mat4(placed.world).determinant() == 0.0;
        // few copies cost less than instances, unless they have to follow their node
        let is_cheap = (uses_of_mesh[&mesh] == 1 || is_small) && !asset.may_move[placed.node];
        let placement = if is_deformed(asset, nodes, placed.node, mesh) {
            Placement::Deformed
        } else if is_cheap || is_emissive || is_flat {
            Placement::Baked
        } else {
            Placement::Instanced
        };
        let is_instanced = placement == Placement::Instanced;
        if !is_instanced || admitted.insert(mesh) {
            vertices = vertices.saturating_add(mesh_vertices);
            triangles = triangles.saturating_add(mesh_triangles);
        }
        instances += u64::from(is_instanced);
        within("vertices, copies included", vertices, u64::from(limits.max_vertices))?;
        within("triangles, copies included", triangles, u64::from(limits.max_triangles))?;
        within("instances", instances, u64::from(limits.max_instances))?;
        uses.push(Use { placed, mesh, placement });
    }
    Ok(uses)
}

/// Whether triangles of the material are lights.
pub(super) fn is_emissive(material: &Material) -> bool {
    !material.unlit && material.emissive.iter().any(|&x| x > 0.0)
}

/// Whether a skin or a morph target moves vertices of the mesh at this node.
fn is_deformed(asset: &SceneAsset<'_>, nodes: &Nodes, node: usize, mesh: usize) -> bool {
    let primitives = &asset.document.meshes[mesh].primitives;
    let has_joints = primitives.iter().any(|p| p.attributes.joints_0.is_some());
    let is_skinned = asset.document.nodes[node].skin.is_some() && has_joints;
    let has_targets = primitives.iter().any(|p| !p.targets.is_empty());
    is_skinned || (has_targets && nodes.weights(asset, node, mesh).iter().any(|&weight| weight != 0.0))
}
