//! Top-down construction of a binary tree in O(n log n) whatever the input, with bounded depth.

use obvhs::aabb::Aabb;
use obvhs::bvh2::{Bvh2, node::Bvh2Node};

/// How a set of boxes is cut in two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Split {
    /// By the surface-area heuristic over bins of all axes.
    SurfaceArea,
    /// In equal halves along the widest axis.
    Median,
}

/// Levels of the binary tree at most, up to a few more for rounding up.
pub(super) const MAX_BINARY_DEPTH: u32 = 64;

const BINS: usize = 16;

/// Sets smaller than this are not worth another thread.
const PARALLEL_SIZE: usize = 4096;

/// Builds the tree; every leaf holds one box. `boxes` is not empty.
pub(super) fn build(boxes: &[Aabb], split: Split) -> Bvh2 {
    let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
    let mut nodes = vec![Bvh2Node::default(); 2 * boxes.len() - 1];
    let (root, rest) = nodes.split_at_mut(1);
    Task { boxes, split, depth: 1, first_slot: 0, first_node: 1 }.run(&mut order, &mut root[0], rest);
    Bvh2 { nodes, primitive_indices: order, ..Bvh2::default() }
}

/// One subtree: where its boxes stand in the order and its nodes in the tree.
#[derive(Clone, Copy)]
struct Task<'a> {
    boxes: &'a [Aabb],
    split: Split,
    depth: u32,
    first_slot: usize,
    first_node: usize,
}

impl Task<'_> {
    /// Fills `root` and its `2 n - 2` descendants: first both children, then the left one's descendants, then the
    /// right's.
    fn run(self, items: &mut [u32], root: &mut Bvh2Node, descendants: &mut [Bvh2Node]) {
        let around = items.iter().fold(Aabb::empty(), |a, &i| a.union(&self.boxes[i as usize]));
        if items.len() == 1 {
            *root = Bvh2Node::new(around, 1, self.first_slot as u32);
            return;
        }
        *root = Bvh2Node::new(around, 0, self.first_node as u32);
        let middle = self.cut(items);
        let (left_items, right_items) = items.split_at_mut(middle);
        let (children, rest) = descendants.split_at_mut(2);
        let (left_rest, right_rest) = rest.split_at_mut(2 * middle - 2);
        let (left_root, right_root) = children.split_at_mut(1);
        let below = Self { depth: self.depth + 1, first_node: self.first_node + 2, ..self };
        let left = below;
        let right = Self { first_slot: self.first_slot + middle, first_node: self.first_node + 2 * middle, ..below };
        if left_items.len() + right_items.len() >= PARALLEL_SIZE {
            rayon::join(
                || left.run(left_items, &mut left_root[0], left_rest),
                || right.run(right_items, &mut right_root[0], right_rest),
            );
        } else {
            left.run(left_items, &mut left_root[0], left_rest);
            right.run(right_items, &mut right_root[0], right_rest);
        }
    }

    /// Reorders the items and returns how many go left; both sides get at least one.
    fn cut(&self, items: &mut [u32]) -> usize {
        let center = |i: u32| self.boxes[i as usize].center();
        let mut centers = Aabb::empty();
        for &i in items.iter() {
            centers.extend(center(i));
        }
        // what is left of the depth must be enough to halve the rest
        let is_deep = self.depth + items.len().ilog2() + 2 > MAX_BINARY_DEPTH;
        if self.split == Split::SurfaceArea
            && !is_deep
            && let Some((axis, bin)) = self.cheapest(items, &centers)
        {
            let mut middle = 0;
            for k in 0..items.len() {
                if bin_of(center(items[k])[axis], &centers, axis) < bin {
                    items.swap(middle, k);
                    middle += 1;
                }
            }
            if middle > 0 && middle < items.len() {
                return middle;
            }
        }
        let axis = centers.largest_axis();
        let middle = items.len() / 2;
        items.select_nth_unstable_by(middle, |&a, &b| center(a)[axis].total_cmp(&center(b)[axis]).then(a.cmp(&b)));
        middle
    }

    /// Axis and first bin of the right side of the cheapest cut; `None` where all centres coincide.
    fn cheapest(&self, items: &[u32], centers: &Aabb) -> Option<(usize, usize)> {
        let mut best: Option<(f32, usize, usize)> = None;
        for axis in 0..3 {
            if centers.max[axis] <= centers.min[axis] {
                continue;
            }
            let mut bins = [(Aabb::empty(), 0u32); BINS];
            for &i in items {
                let aabb = &self.boxes[i as usize];
                let bin = &mut bins[bin_of(aabb.center()[axis], centers, axis)];
                *bin = (bin.0.union(aabb), bin.1 + 1);
            }
            let mut right_cost = [0.0f32; BINS];
            let (mut around, mut count) = (Aabb::empty(), 0);
            for k in (1..BINS).rev() {
                (around, count) = (around.union(&bins[k].0), count + bins[k].1);
                right_cost[k] = if count > 0 { around.half_area() * count as f32 } else { f32::INFINITY };
            }
            (around, count) = (Aabb::empty(), 0);
            for k in 1..BINS {
                (around, count) = (around.union(&bins[k - 1].0), count + bins[k - 1].1);
                if count == 0 {
                    continue;
                }
                let cost = around.half_area() * count as f32 + right_cost[k];
                if best.is_none_or(|(least, ..)| cost < least) && cost < f32::INFINITY {
                    best = Some((cost, axis, k));
                }
            }
        }
        best.map(|(_, axis, bin)| (axis, bin))
    }
}

fn bin_of(value: f32, centers: &Aabb, axis: usize) -> usize {
    let (low, high) = (centers.min[axis], centers.max[axis]);
    (((value - low) / (high - low) * BINS as f32) as usize).min(BINS - 1)
}
