//! The node tree of the default scene, checked for cycles and depth.

use super::check::{invalid, within};
use super::document::{Document, item};
use crate::{SceneError, SceneLimits};

/// Nodes of the default scene in depth-first order.
#[derive(Debug)]
pub(crate) struct NodeTree {
    pub(crate) nodes: Vec<TreeNode>,
}

/// A node that is part of the scene.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TreeNode {
    /// Index into the file's nodes.
    pub(crate) node: usize,
    /// Position of the parent in [`NodeTree::nodes`], which comes before its children; `None` for roots.
    pub(crate) parent: Option<usize>,
}

impl NodeTree {
    /// Walks the default scene.
    pub(crate) fn walk(document: &Document, limits: &SceneLimits) -> Result<Self, SceneError> {
        let nodes = &document.nodes;
        within("nodes", nodes.len() as u64, u64::from(limits.max_nodes))?;
        let mut tree = Self { nodes: Vec::new() };
        let roots = match document.scene {
            Some(scene) => &item(&document.scenes, scene, "scenes", "scene")?.nodes,
            None => match document.scenes.first() {
                Some(scene) => &scene.nodes,
                None => return Ok(tree),
            },
        };
        let mut is_visited = vec![false; nodes.len()];
        let mut stack: Vec<(usize, Option<usize>, u32)> = roots.iter().rev().map(|&root| (root, None, 1)).collect();
        while let Some((index, parent, depth)) = stack.pop() {
            let node = item(nodes, index, "nodes", "scenes")?;
            if std::mem::replace(&mut is_visited[index], true) {
                // A tree visits a node once; a second visit means a cycle or two parents.
                return Err(invalid(format!("nodes[{index}]"), "has two parents or is its own ancestor"));
            }
            within("node depth", u64::from(depth), u64::from(limits.max_node_depth))?;
            let position = tree.nodes.len();
            tree.nodes.push(TreeNode { node: index, parent });
            within("nodes[].children", (stack.len() + node.children.len()) as u64, u64::from(limits.max_nodes))?;
            stack.extend(node.children.iter().rev().map(|&child| (child, Some(position), depth + 1)));
        }
        Ok(tree)
    }

    /// By node index: whether any animation of the file changes the node's transform or that of an ancestor.
    pub(crate) fn animated(&self, document: &Document) -> Vec<bool> {
        let mut is_animated = vec![false; document.nodes.len()];
        for channel in document.animations.iter().flat_map(|animation| &animation.channels) {
            let is_transform = matches!(channel.target.path.as_str(), "translation" | "rotation" | "scale");
            if let Some(flag) = channel.target.node.filter(|_| is_transform).and_then(|n| is_animated.get_mut(n)) {
                *flag = true;
            }
        }
        for item in &self.nodes {
            let parent = item.parent.map(|parent| self.nodes[parent].node);
            is_animated[item.node] |= parent.is_some_and(|parent| is_animated[parent]);
        }
        is_animated
    }
}
