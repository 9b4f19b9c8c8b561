//! Ray traversal on the CPU over exactly the hierarchies the GPU gets: the twin of the shader's tracer and the
//! yardstick of its speed.
//!
//! Boxes are tested with an error bound, and triangles by the watertight test of Woop, Benthin and Wald (JCGT 2013), so
//! a ray cannot slip between two triangles that share an edge. Alpha is not looked at: every triangle counts as solid,
//! and both sides count.

use glam::Vec3;

use crate::geometry::{BvhNode, BvhTriangle, Instance, SceneGeometry};

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance in units of the direction's length.
    pub t: f32,
    /// Weight of the second corner.
    pub u: f32,
    /// Weight of the third corner.
    pub v: f32,
    /// Index into [`SceneGeometry::bvh_triangles`].
    pub bvh_triangle: u32,
    /// Index into [`SceneGeometry::instances`].
    pub instance: u32,
}

/// Nearest hit with `t_min < t < t_max`. `direction` need not be normalised but must be finite and not zero.
pub fn closest_hit(scene: &SceneGeometry, origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> Option<Hit> {
    let mut nearest: Option<Hit> = None;
    let mut limit = t_max;
    visit(scene, origin, direction, t_min, &mut limit, |hit, limit| {
        *limit = hit.t;
        nearest = Some(hit);
        false
    });
    nearest
}

/// Whether anything lies in `t_min < t < t_max`.
pub fn any_hit(scene: &SceneGeometry, origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> bool {
    let mut limit = t_max;
    visit(scene, origin, direction, t_min, &mut limit, |_, _| true)
}

/// Calls `found` for hits below the limit until it returns true; returns whether it did.
#[inline]
fn visit(
    scene: &SceneGeometry,
    origin: Vec3,
    direction: Vec3,
    t_min: f32,
    limit: &mut f32,
    mut found: impl FnMut(Hit, &mut f32) -> bool,
) -> bool {
    let mut enter = |index: u32, limit: &mut f32| -> bool {
        let instance = &scene.instances[index as usize];
        let (origin, direction) = if scene.baked_instance == Some(index) {
            (origin, direction)
        } else {
            to_object(instance, origin, direction)
        };
        let ray = Ray::new(origin, direction);
        let shear = Shear::new(origin, direction);
        traverse(&scene.nodes, instance.root_node, &ray, t_min, limit, |k, limit| {
            match shear.intersect(&scene.bvh_triangles[k as usize], t_min, *limit) {
                Some((t, u, v)) => found(Hit { t, u, v, bvh_triangle: k, instance: index }, limit),
                None => false,
            }
        })
    };
    match scene.instances.len() {
        0 => false,
        1 => enter(0, limit),
        _ => traverse(&scene.top_nodes, 0, &Ray::new(origin, direction), t_min, limit, enter),
    }
}

fn to_object(instance: &Instance, origin: Vec3, direction: Vec3) -> (Vec3, Vec3) {
    let rows = &instance.object_from_scene;
    let turn = |v: Vec3| Vec3::from_array(rows.map(|row| row[0] * v.x + row[1] * v.y + row[2] * v.z));
    let shift = Vec3::from_array(rows.map(|row| row[3]));
    (turn(origin) + shift, turn(direction))
}

/// A ray prepared for box tests.
struct Ray {
    origin: Vec3,
    /// Reciprocal direction, finite: components of (nearly) zero are replaced by tiny ones.
    inverse: Vec3,
    /// Octant in obvhs' order, repeated in each byte.
    octant: u32,
    is_negative: [bool; 3],
}

/// Relative rounding of a slab distance: three operations of half an ulp each, doubled.
const SLAB_ROUNDING: f32 = 6.0 * f32::EPSILON * 0.5;

impl Ray {
    fn new(origin: Vec3, direction: Vec3) -> Self {
        let least = (direction.abs().max_element() * 2f32.powi(-60)).max(f32::MIN_POSITIVE);
        let inverse = direction.to_array().map(|d| 1.0 / if d.abs() < least { least.copysign(d) } else { d });
        let is_negative = inverse.map(|x| x < 0.0);
        let octant =
            is_negative.iter().zip([4, 2, 1]).map(|(&negative, bit)| if negative { 0 } else { bit }).sum::<u32>();
        Self { origin, inverse: Vec3::from_array(inverse), octant: octant * 0x0101_0101, is_negative }
    }

    /// Children whose boxes the ray meets, as bits: triangles of leaves in the low 24, inner nodes in the high 8.
    #[inline]
    fn intersect(&self, node: &BvhNode, t_min: f32, t_max: f32) -> u32 {
        let exponent = |axis: usize| f32::from_bits(u32::from(node.e[axis]) << 23);
        let planes = [
            (&node.child_min_x, &node.child_max_x),
            (&node.child_min_y, &node.child_max_y),
            (&node.child_min_z, &node.child_max_z),
        ];
        let (mut near, mut far) = ([t_min; 8], [t_max; 8]);
        for (axis, (low, high)) in planes.into_iter().enumerate() {
            let cell = exponent(axis);
            let inverse = self.inverse[axis];
            let to_node = node.p[axis] - self.origin[axis];
            let step = cell * inverse;
            let base = to_node * inverse;
            let error = (to_node.abs() + 256.0 * cell) * inverse.abs() * SLAB_ROUNDING;
            let (base_near, base_far) = (base - error, base + error);
            let (enter, leave) = if self.is_negative[axis] { (high, low) } else { (low, high) };
            for k in 0..8 {
                near[k] = near[k].max(f32::from(enter[k]) * step + base_near);
                far[k] = far[k].min(f32::from(leave[k]) * step + base_far);
            }
        }
        let (child_bits, bit_index) = node.get_child_and_index_bits(self.octant);
        let mut mask = 0;
        for k in 0..8 {
            if near[k] <= far[k] {
                mask |= ((child_bits >> (8 * k)) as u32 & 0xff) << ((bit_index >> (8 * k)) as u32 & 0xff);
            }
        }
        mask
    }
}

/// Walks one hierarchy front to back, calling `leaf` for each primitive until it returns true.
#[inline]
fn traverse(
    nodes: &[BvhNode],
    root: u32,
    ray: &Ray,
    t_min: f32,
    limit: &mut f32,
    mut leaf: impl FnMut(u32, &mut f32) -> bool,
) -> bool {
    let mut stack = [(0u32, 0u32); crate::bvh::MAX_BOTTOM_DEPTH as usize];
    let mut stacked = 0;
    // (first child, bits of children still to visit | inner mask); starts as if the root were the only child
    let mut group = (root, 0x8000_0000u32);
    loop {
        let slot = group.1.ilog2();
        let inner_mask = group.1 & 0xff;
        group.1 &= !(1 << slot);
        if group.1 & 0xff00_0000 != 0 {
            stack[stacked] = group;
            stacked += 1;
        }
        let child = (slot - 24) ^ (ray.octant & 0xff);
        let before = inner_mask & !(u32::MAX << child);
        let node = &nodes[(group.0 + before.count_ones()) as usize];
        let hits = ray.intersect(node, t_min, *limit);
        let mut primitives = hits & 0x00ff_ffff;
        while primitives != 0 {
            let k = primitives.ilog2();
            primitives &= !(1 << k);
            if leaf(node.primitive_base_idx + k, limit) {
                return true;
            }
        }
        group = (node.child_base_idx, (hits & 0xff00_0000) | u32::from(node.imask));
        if group.1 & 0xff00_0000 == 0 {
            if stacked == 0 {
                return false;
            }
            stacked -= 1;
            group = stack[stacked];
        }
    }
}

/// A ray prepared for triangle tests: the direction's largest axis becomes z, and a shear makes it (0, 0, 1).
struct Shear {
    origin: Vec3,
    kx: usize,
    ky: usize,
    kz: usize,
    sx: f32,
    sy: f32,
    sz: f32,
}

impl Shear {
    fn new(origin: Vec3, direction: Vec3) -> Self {
        let kz = direction.abs().max_position();
        let (mut kx, mut ky) = ((kz + 1) % 3, (kz + 2) % 3);
        if direction[kz] < 0.0 {
            (kx, ky) = (ky, kx);
        }
        let sz = 1.0 / direction[kz];
        Self { origin, kx, ky, kz, sx: direction[kx] * sz, sy: direction[ky] * sz, sz }
    }

    /// Distance and weights of the second and third corner.
    #[inline]
    fn intersect(&self, triangle: &BvhTriangle, t_min: f32, t_max: f32) -> Option<(f32, f32, f32)> {
        let corner = |v: [f32; 3]| {
            let v = Vec3::from_array(v) - self.origin;
            let z = v[self.kz];
            (v[self.kx] - self.sx * z, v[self.ky] - self.sy * z, self.sz * z)
        };
        let [(ax, ay, az), (bx, by, bz), (cx, cy, cz)] =
            [corner(triangle.v0), corner(triangle.v1), corner(triangle.v2)];
        let mut weights = [cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax];
        if weights.contains(&0.0) {
            // on an edge in f32: decide in f64, where products of two f32 are exact
            let cross = |x0: f32, y1: f32, y0: f32, x1: f32| {
                (f64::from(x0) * f64::from(y1) - f64::from(y0) * f64::from(x1)) as f32
            };
            weights = [cross(cx, by, cy, bx), cross(ax, cy, ay, cx), cross(bx, ay, by, ax)];
        }
        let [a, b, c] = weights;
        if (a < 0.0 || b < 0.0 || c < 0.0) && (a > 0.0 || b > 0.0 || c > 0.0) {
            return None;
        }
        let sum = a + b + c;
        if sum == 0.0 {
            return None;
        }
        let t = (a * az + b * bz + c * cz) / sum;
        (t > t_min && t < t_max).then(|| (t, b / sum, c / sum))
    }
}
