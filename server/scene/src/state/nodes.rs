//! Transforms of the node tree, composed in `f64`.

use glam::{DMat4, DQuat, DVec3};

use crate::SceneError;
use crate::asset::check::invalid;
use crate::asset::document::Node;
use crate::asset::{NodeOverride, SceneAsset};

/// A node that is part of the scene.
#[derive(Clone, Debug)]
pub(crate) struct PlacedNode {
    /// Index into the file's nodes.
    pub(crate) node: usize,
    /// World from node space.
    pub(crate) world: DMat4,
}

/// The nodes of the scene in depth-first order, and world matrices of every node in it.
#[derive(Debug)]
pub(crate) struct Nodes {
    pub(crate) placed: Vec<PlacedNode>,
    /// By node index; `None` for nodes outside the scene.
    pub(crate) world: Vec<Option<DMat4>>,
    /// By node index; empty where nothing is overridden.
    overrides: Vec<NodeOverride>,
}

impl Nodes {
    /// Composes the transforms of the tree.
    pub(crate) fn place(asset: &SceneAsset<'_>, overrides: Vec<NodeOverride>) -> Result<Self, SceneError> {
        let nodes = &asset.document.nodes;
        let mut placed: Vec<PlacedNode> = Vec::with_capacity(asset.tree.nodes.len());
        let mut world_of = vec![None; nodes.len()];
        for item in &asset.tree.nodes {
            let index = item.node;
            let parent = item.parent.map_or(DMat4::IDENTITY, |parent| placed[parent].world);
            let world = parent * local_matrix(&nodes[index], overrides.get(index), index)?;
            if !world.to_cols_array().iter().all(|x| x.is_finite()) {
                return Err(invalid(format!("nodes[{index}]"), "has a world transform that is not finite"));
            }
            world_of[index] = Some(world);
            placed.push(PlacedNode { node: index, world });
        }
        Ok(Self { placed, world: world_of, overrides })
    }

    /// Morph weights of a node that uses `mesh`: those of the clip, its own, or the mesh's.
    pub(crate) fn weights<'a>(&'a self, asset: &'a SceneAsset<'_>, node: usize, mesh: usize) -> &'a [f64] {
        let document = &asset.document;
        let overridden = self.overrides.get(node).and_then(|node| node.weights.as_deref());
        overridden.or(document.nodes[node].weights.as_deref()).unwrap_or(&document.meshes[mesh].weights)
    }
}

fn local_matrix(node: &Node, overridden: Option<&NodeOverride>, index: usize) -> Result<DMat4, SceneError> {
    let is_moved = overridden.is_some_and(|o| o.translation.is_some() || o.rotation.is_some() || o.scale.is_some());
    if let (Some(matrix), false) = (&node.matrix, is_moved) {
        return Ok(DMat4::from_cols_array(matrix));
    }
    let translation = overridden.and_then(|o| o.translation).or(node.translation).unwrap_or([0.0; 3]);
    let rotation = overridden.and_then(|o| o.rotation).or(node.rotation).unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let scale = overridden.and_then(|o| o.scale).or(node.scale).unwrap_or([1.0; 3]);
    let quaternion = DQuat::from_array(rotation);
    let length = quaternion.length();
    if !(length > 0.0 && length.is_finite()) {
        return Err(invalid(format!("nodes[{index}].rotation"), "is not a rotation (length 0)"));
    }
    Ok(DMat4::from_scale_rotation_translation(
        DVec3::from_array(scale),
        DQuat::from_array(rotation.map(|x| x / length)),
        DVec3::from_array(translation),
    ))
}
