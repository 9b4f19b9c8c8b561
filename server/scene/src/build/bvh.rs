//! Building of 8-wide compressed hierarchies with `obvhs`, made conservative and scale-free.
//!
//! What is added to the builder: coordinates are scaled by a power of two so that no absolute threshold inside it
//! matters (tiny.glb is 60 micrometres wide); child boxes are quantised again so that they contain their triangles with
//! a margin of about 2^-21 of the hierarchy's extent, which covers the rounding of a slab test in `f32`; and the depth
//! is bounded, so that a traversal stack has a known size.
//!
//! The binary tree is built top down by binned surface-area cost instead of `obvhs`' PLOC, which takes quadratic time
//! where many triangles stand in one place (69 s for 50,000 equal ones) and so would let a small upload stall the
//! server.

use glam::{DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::bvh2::{Bvh2, node::Bvh2Node};
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::splits::split_aabbs_preset;
use obvhs::triangle::Triangle;

use crate::geometry::BvhNode;
use split::Split;

mod split;

/// Levels of a bottom-level hierarchy at most.
pub const MAX_BOTTOM_DEPTH: u32 = 16;

/// Levels of the top-level hierarchy at most.
pub const MAX_TOP_DEPTH: u32 = 8;

/// Entries that a traversal stack shared by both levels needs at most: less than one a level.
pub const MAX_STACK_DEPTH: u32 = MAX_BOTTOM_DEPTH + MAX_TOP_DEPTH;

/// A hierarchy over primitives.
#[derive(Debug, Default)]
pub(crate) struct Hierarchy {
    /// Nodes; the first is the root. Empty where there are no primitives.
    pub(crate) nodes: Vec<BvhNode>,
    /// Index of the input primitive for each leaf slot.
    pub(crate) order: Vec<u32>,
    /// Levels of nodes.
    pub(crate) depth: u32,
}

/// Hierarchy over triangles. Large ones may be referred to by several leaves.
pub(crate) fn build_triangles(corners: &[[Vec3; 3]]) -> Hierarchy {
    let scale = unit_scale(corners.iter().flatten().copied());
    let triangles: Vec<Triangle> =
        corners.iter().map(|c| c.map(|v| Vec3A::from(v * scale))).map(|[v0, v1, v2]| Triangle { v0, v1, v2 }).collect();
    let mut boxes: Vec<Aabb> = triangles.iter().map(Triangle::aabb).collect();
    let mut owner: Vec<u32> = (0..triangles.len() as u32).collect();
    split_large(&mut boxes, &mut owner, &triangles);
    let mut hierarchy = build_boxes(&boxes, scale, MAX_BOTTOM_DEPTH);
    for slot in &mut hierarchy.order {
        *slot = owner[*slot as usize];
    }
    hierarchy
}

/// Hierarchy over boxes, for the top level.
pub(crate) fn build_bounds(bounds: &[crate::Bounds]) -> Hierarchy {
    let scale = unit_scale(bounds.iter().flat_map(|b| [b.min, b.max]));
    let boxes: Vec<Aabb> = bounds.iter().map(|b| Aabb::new((b.min * scale).into(), (b.max * scale).into())).collect();
    build_boxes(&boxes, scale, MAX_TOP_DEPTH)
}

/// The power of two that brings the largest coordinate to about 1.
fn unit_scale(points: impl Iterator<Item = Vec3>) -> f32 {
    let largest = points.fold(0.0f32, |a, p| a.max(p.abs().max_element()));
    if largest > 0.0 { (-largest.log2().floor().clamp(-100.0, 100.0)).exp2() } else { 1.0 }
}

/// Replaces the boxes of large slanted triangles by several tighter ones.
fn split_large(boxes: &mut Vec<Aabb>, owner: &mut Vec<u32>, triangles: &[Triangle]) {
    let (mut sum, mut largest) = (0.0f64, 0.0f32);
    for half_area in boxes.iter().map(Aabb::half_area) {
        sum += f64::from(half_area);
        largest = largest.max(half_area);
    }
    let average = (sum / boxes.len().max(1) as f64) as f32;
    if average > 0.0 {
        split_aabbs_preset(boxes, owner, triangles, average, largest);
    }
}

/// Builds over scaled boxes and returns nodes in unscaled coordinates. Trees that come out too deep are built again,
/// first without the optimiser, then by halves.
fn build_boxes(boxes: &[Aabb], scale: f32, max_depth: u32) -> Hierarchy {
    if boxes.is_empty() {
        return Hierarchy::default();
    }
    let build = |split, is_optimised: bool| {
        let mut bvh2 = split::build(boxes, split);
        if is_optimised {
            optimise(&mut bvh2);
        }
        bvh2_to_cwbvh(&bvh2, 3, true, true)
    };
    let mut wide = build(Split::SurfaceArea, true);
    for split in [Split::SurfaceArea, Split::Median] {
        if wide_depth(&wide.nodes) > max_depth {
            wide = build(split, false);
        }
    }
    let depth = wide_depth(&wide.nodes);
    let mut nodes = wide.nodes;
    let exact = wide.exact_node_aabbs.unwrap_or_default();
    requantise(&mut nodes, &exact, &wide.primitive_indices, boxes, scale);
    Hierarchy { nodes, order: wide.primitive_indices, depth }
}

/// Expected boxes met by a ray, above which reinsertion is left out.
const MAX_COST: f64 = 4000.0;

/// Moves subtrees to where they cost less (Meister and Bittner 2018). The search for a place visits about as many nodes
/// as a ray does, so it is left out where boxes overlap so much that it would not end in reasonable time.
fn optimise(bvh2: &mut Bvh2) {
    let half_area = |node: &Bvh2Node| f64::from(node.aabb().half_area());
    let root = bvh2.nodes.first().map_or(0.0, half_area);
    let cost = bvh2.nodes.iter().filter(|node| !node.is_leaf()).map(half_area).sum::<f64>() / root;
    if !(cost < MAX_COST) || binary_depth(bvh2) > split::MAX_BINARY_DEPTH {
        return;
    }
    let ratio = match bvh2.primitive_indices.len() {
        0..=300_000 => 1.0,
        300_001..=2_000_000 => 0.2,
        _ => 0.05,
    };
    ReinsertionOptimizer::default().run(bvh2, ratio, None);
}

/// Levels below and including the root, without recursion.
fn binary_depth(bvh2: &Bvh2) -> u32 {
    let mut stack = vec![(0u32, 1u32)];
    let mut deepest = 0;
    while let Some((index, depth)) = stack.pop() {
        deepest = deepest.max(depth);
        let node = &bvh2.nodes[index as usize];
        if !node.is_leaf() {
            stack.extend([(node.first_index, depth + 1), (node.first_index + 1, depth + 1)]);
        }
    }
    deepest
}

fn wide_depth(nodes: &[BvhNode]) -> u32 {
    let mut stack = vec![(0u32, 1u32)];
    let mut deepest = 0;
    while let Some((index, depth)) = stack.pop() {
        deepest = deepest.max(depth);
        let node = &nodes[index as usize];
        stack.extend((0..node.imask.count_ones()).map(|k| (node.child_base_idx + k, depth + 1)));
    }
    deepest
}

/// Writes origin, exponents and child boxes of every node again, outward by a margin, in unscaled coordinates.
fn requantise(nodes: &mut [BvhNode], exact: &[Aabb], order: &[u32], boxes: &[Aabb], scale: f32) {
    let down = |v: Vec3A| DVec3::new(f64::from(v.x), f64::from(v.y), f64::from(v.z)) / f64::from(scale);
    let root = exact[0];
    let largest = down(root.min).abs().max(down(root.max).abs()).max_element();
    let margin = DVec3::splat((largest * 2f64.powi(-21)).max(f64::from(f32::MIN_POSITIVE)));
    let bounds = |aabb: &Aabb| (down(aabb.min) - margin, down(aabb.max) + margin);
    for index in 0..nodes.len() {
        let mut node = nodes[index];
        let (low, high) = bounds(&exact[index]);
        let (mut origin, mut cell) = (Vec3::ZERO, DVec3::ZERO);
        for axis in 0..3 {
            origin[axis] = (low[axis] as f32).next_down();
            let extent = high[axis] - f64::from(origin[axis]);
            let exponent = ((extent / 255.0).log2().floor() as i32).clamp(-126, 126);
            let exponent = (exponent..=127).find(|e| 255.0 * 2f64.powi(*e) >= extent).unwrap_or(127);
            node.e[axis] = (exponent + 127) as u8;
            cell[axis] = 2f64.powi(exponent);
        }
        node.p = origin;
        for slot in 0..8 {
            if node.is_child_empty(slot) {
                continue;
            }
            let around = if node.is_leaf(slot) {
                let (first, count) = node.child_primitives(slot);
                order[first as usize..(first + count) as usize]
                    .iter()
                    .fold(Aabb::empty(), |a, &i| a.union(&boxes[i as usize]))
            } else {
                exact[node.child_node_index(slot) as usize]
            };
            let (low, high) = bounds(&around);
            let quantise = |value: f64, axis: usize| (value - f64::from(origin[axis])) / cell[axis];
            let floor = |axis| quantise(low[axis], axis).floor().clamp(0.0, 255.0) as u8;
            let ceil = |axis| quantise(high[axis], axis).ceil().clamp(0.0, 255.0) as u8;
            (node.child_min_x[slot], node.child_max_x[slot]) = (floor(0), ceil(0));
            (node.child_min_y[slot], node.child_max_y[slot]) = (floor(1), ceil(1));
            (node.child_min_z[slot], node.child_max_z[slot]) = (floor(2), ceil(2));
        }
        nodes[index] = node;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every triangle of every leaf lies inside the boxes on the way to it.
    fn assert_conservative(hierarchy: &Hierarchy, corners: &[[Vec3; 3]]) -> usize {
        let mut reached = vec![false; corners.len()];
        for node in &hierarchy.nodes {
            for slot in (0..8).filter(|&slot| !node.is_child_empty(slot) && node.is_leaf(slot)) {
                let (first, count) = node.child_primitives(slot);
                assert!((1..=3).contains(&count));
                hierarchy.order[first as usize..(first + count) as usize]
                    .iter()
                    .for_each(|&triangle| reached[triangle as usize] = true);
            }
        }
        assert!(reached.iter().all(|&r| r));
        hierarchy.order.len()
    }

    #[test]
    fn equal_triangles_do_not_make_a_list() {
        let one = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let corners = vec![one; 50_000];
        let hierarchy = build_triangles(&corners);
        assert!(hierarchy.depth <= MAX_BOTTOM_DEPTH, "depth {}", hierarchy.depth);
        assert_eq!(assert_conservative(&hierarchy, &corners), corners.len());
    }

    #[test]
    fn geometric_series_of_triangles_stay_shallow() {
        let corners: Vec<[Vec3; 3]> = (0..200)
            .map(|k| {
                let s = 0.6f32.powi(k);
                [Vec3::splat(s), Vec3::new(s * 1.1, s, s), Vec3::new(s, s * 1.1, s)]
            })
            .collect();
        let hierarchy = build_triangles(&corners);
        assert!(hierarchy.depth <= MAX_BOTTOM_DEPTH, "depth {}", hierarchy.depth);
        assert_conservative(&hierarchy, &corners);
    }

    #[test]
    fn scale_changes_nothing_but_the_numbers() {
        let corners = |scale: f32| -> Vec<[Vec3; 3]> {
            (0..500)
                .map(|k| {
                    let f = |n: u32| ((k * 7919 + n * 104_729) % 1000) as f32 / 1000.0 - 0.5;
                    let v = Vec3::new(f(1), f(2), f(3));
                    [v, v + Vec3::new(0.02, 0.0, 0.01), v + Vec3::new(0.0, 0.02, 0.0)].map(|p| p * scale)
                })
                .collect()
        };
        let unit = build_triangles(&corners(1.0));
        let tiny = build_triangles(&corners(2f32.powi(-20)));
        assert_eq!(unit.order, tiny.order);
        assert_eq!(unit.depth, tiny.depth);
        assert_eq!(unit.nodes[0].child_min_x, tiny.nodes[0].child_min_x);
        assert_eq!(unit.nodes[0].e.map(|e| e - 20), tiny.nodes[0].e);
    }
}
