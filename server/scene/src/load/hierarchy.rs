//! The node tree: checked for cycles and depth, posed, and composed in `f64`.

use glam::{DMat4, DQuat, DVec3};

use super::animation::PosedNode;
use super::check::{invalid, within};
use super::document::{Document, Node, item};
use crate::{SceneError, SceneLimits};

/// A node that is part of the scene.
#[derive(Clone, Debug)]
pub(crate) struct PlacedNode {
    /// Index into the file's nodes.
    pub(crate) node: usize,
    /// World from node space.
    pub(crate) world: DMat4,
}

/// The nodes of the chosen scene in depth-first order, and world matrices of every node in it.
pub(crate) struct Hierarchy {
    pub(crate) placed: Vec<PlacedNode>,
    /// By node index; `None` for nodes outside the scene.
    pub(crate) world: Vec<Option<DMat4>>,
}

impl Hierarchy {
    /// Walks the tree of the default scene.
    pub(crate) fn walk(document: &Document, posed: &[PosedNode], limits: &SceneLimits) -> Result<Self, SceneError> {
        let nodes = &document.nodes;
        within("nodes", nodes.len() as u64, u64::from(limits.max_nodes))?;
        let mut hierarchy = Self { placed: Vec::new(), world: vec![None; nodes.len()] };
        let roots = match document.scene {
            Some(scene) => &item(&document.scenes, scene, "scenes", "scene")?.nodes,
            None => match document.scenes.first() {
                Some(scene) => &scene.nodes,
                None => return Ok(hierarchy),
            },
        };
        let mut stack: Vec<(usize, DMat4, u32)> = roots.iter().rev().map(|&root| (root, DMat4::IDENTITY, 1)).collect();
        while let Some((index, parent, depth)) = stack.pop() {
            let node = item(nodes, index, "nodes", "scenes")?;
            if hierarchy.world[index].is_some() {
                // A tree visits a node once; a second visit means a cycle or two parents.
                return Err(invalid(format!("nodes[{index}]"), "has two parents or is its own ancestor"));
            }
            within("node depth", u64::from(depth), u64::from(limits.max_node_depth))?;
            let world = parent * local_matrix(node, posed.get(index), index)?;
            if !world.to_cols_array().iter().all(|x| x.is_finite()) {
                return Err(invalid(format!("nodes[{index}]"), "has a world transform that is not finite"));
            }
            hierarchy.world[index] = Some(world);
            hierarchy.placed.push(PlacedNode { node: index, world });
            within("nodes[].children", (stack.len() + node.children.len()) as u64, u64::from(limits.max_nodes))?;
            stack.extend(node.children.iter().rev().map(|&child| (child, world, depth + 1)));
        }
        Ok(hierarchy)
    }
}

fn local_matrix(node: &Node, posed: Option<&PosedNode>, index: usize) -> Result<DMat4, SceneError> {
    let is_posed = posed.is_some_and(|p| p.translation.is_some() || p.rotation.is_some() || p.scale.is_some());
    if let (Some(matrix), false) = (&node.matrix, is_posed) {
        return Ok(DMat4::from_cols_array(matrix));
    }
    let posed = posed.cloned().unwrap_or_default();
    let translation = posed.translation.or(node.translation).unwrap_or([0.0; 3]);
    let rotation = posed.rotation.or(node.rotation).unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let scale = posed.scale.or(node.scale).unwrap_or([1.0; 3]);
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
