//! Closed triangle meshes of simple shapes, with outward normals and texture coordinates in metres.

use std::f32::consts::{PI, TAU};

use glam::{Mat4, Vec2, Vec3};

/// Triangles with one normal and texture coordinate a vertex; counter-clockwise seen from outside.
#[derive(Clone, Debug, Default)]
pub(super) struct Mesh {
    pub(super) positions: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) uvs: Vec<Vec2>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Appends another mesh.
    pub(super) fn add(&mut self, other: Self) {
        let base = self.positions.len() as u32;
        self.positions.extend(other.positions);
        self.normals.extend(other.normals);
        self.uvs.extend(other.uvs);
        self.triangles.extend(other.triangles.into_iter().map(|t| t.map(|v| v + base)));
    }

    /// Moves the mesh.
    pub(super) fn at(self, x: f32, y: f32, z: f32) -> Self {
        self.transformed(Mat4::from_translation(Vec3::new(x, y, z)))
    }

    /// Turns the mesh about the vertical axis, degrees, counter-clockwise seen from above.
    pub(super) fn turned(self, degrees: f32) -> Self {
        self.transformed(Mat4::from_rotation_y(degrees.to_radians()))
    }

    /// Applies a map without mirroring.
    pub(super) fn transformed(mut self, matrix: Mat4) -> Self {
        let normals = matrix.inverse().transpose();
        self.positions.iter_mut().for_each(|p| *p = matrix.transform_point3(*p));
        self.normals.iter_mut().for_each(|n| *n = normals.transform_vector3(*n).normalize_or(Vec3::Y));
        self
    }

    /// A flat rectangle `origin + s u + t v`, facing `u x v`.
    pub(super) fn rectangle(origin: Vec3, u: Vec3, v: Vec3) -> Self {
        let (width, height) = (u.length(), v.length());
        Self {
            positions: vec![origin, origin + u, origin + u + v, origin + v],
            normals: vec![u.cross(v).normalize_or(Vec3::Y); 4],
            uvs: [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]].map(Vec2::from_array).to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        }
    }

    /// A box with sharp edges, centred on x and z and standing on y = 0.
    pub(super) fn block(width: f32, height: f32, depth: f32) -> Self {
        let (x, z) = (width / 2.0, depth / 2.0);
        let mut mesh = Self::default();
        let (sx, sy, sz) = (Vec3::X * width, Vec3::Y * height, Vec3::Z * depth);
        let corner = |cx: f32, cy: f32, cz: f32| Vec3::new(cx * x, cy * height, cz * z);
        mesh.add(Self::rectangle(corner(-1.0, 0.0, 1.0), sx, sy));
        mesh.add(Self::rectangle(corner(1.0, 0.0, -1.0), -sx, sy));
        mesh.add(Self::rectangle(corner(1.0, 0.0, 1.0), -sz, sy));
        mesh.add(Self::rectangle(corner(-1.0, 0.0, -1.0), sz, sy));
        mesh.add(Self::rectangle(corner(-1.0, 1.0, 1.0), sx, -sz));
        mesh.add(Self::rectangle(corner(-1.0, 0.0, -1.0), sx, sz));
        mesh
    }

    /// A box with rounded edges and smooth normals, standing on y = 0. `steps` subdivide each rounding.
    pub(super) fn pillow(width: f32, height: f32, depth: f32, radius: f32, steps: u32) -> Self {
        let half = Vec3::new(width, height, depth) / 2.0;
        let radius = radius.min(half.min_element() * 0.999);
        let inner = half - radius;
        let mut mesh = Self::default();
        for (axis, sign) in [(0, 1.0f32), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)] {
            let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
            let (a, b) = if sign > 0.0 { (a, b) } else { (b, a) };
            // lines across the face: the roundings at both ends, the flat part between
            let lines = |k: usize| -> Vec<f32> {
                let arc = |i: u32| (i as f32 / steps as f32 * PI / 4.0).tan() * radius;
                let low = (0..=steps).rev().map(|i| -inner[k] - arc(i));
                low.chain((0..=steps).map(|i| inner[k] + arc(i))).collect()
            };
            let (us, vs) = (lines(a), lines(b));
            let base = mesh.positions.len() as u32;
            for &v in &vs {
                for &u in &us {
                    let mut p = Vec3::ZERO;
                    (p[a], p[b], p[axis]) = (u, v, half[axis] * sign);
                    let core = p.clamp(-inner, inner);
                    let normal = (p - core).normalize_or(Vec3::Y);
                    mesh.positions.push(core + normal * radius + Vec3::Y * half.y);
                    mesh.normals.push(normal);
                    mesh.uvs.push(Vec2::new(u + half[a], v + half[b]));
                }
            }
            mesh.grid(base, us.len() as u32, vs.len() as u32);
        }
        mesh
    }

    /// Two triangles for each cell of a vertex grid whose normal is `u x v`.
    fn grid(&mut self, base: u32, columns: u32, rows: u32) {
        for row in 0..rows - 1 {
            for column in 0..columns - 1 {
                let a = base + row * columns + column;
                let (b, c, d) = (a + 1, a + 1 + columns, a + columns);
                self.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }

    /// A surface of revolution about the y axis. The profile (radius, height) runs so that its outside is on the right
    /// hand; edges sharper than 40 degrees keep a crease.
    pub(super) fn lathe(profile: &[[f32; 2]], segments: u32) -> Self {
        let points: Vec<Vec2> = profile.iter().map(|&p| Vec2::from_array(p)).collect();
        let normal = |k: usize| {
            let d = points[k + 1] - points[k];
            Vec2::new(d.y, -d.x).normalize_or(Vec2::X)
        };
        let count = points.len() - 1;
        let blend = |k: usize, other: Option<usize>| match other {
            Some(other) if normal(k).dot(normal(other)) > 0.766 => (normal(k) + normal(other)).normalize_or(Vec2::X),
            _ => normal(k),
        };
        let mut mesh = Self::default();
        let mut along = 0.0;
        for k in 0..count {
            let (low, high) = (points[k], points[k + 1]);
            let ends = [
                (low, blend(k, k.checked_sub(1)), along),
                (high, blend(k, (k + 1 < count).then_some(k + 1)), along + low.distance(high)),
            ];
            along += low.distance(high);
            let base = mesh.positions.len() as u32;
            let widest = low.x.max(high.x);
            for (point, normal, v) in ends {
                for s in 0..=segments {
                    let (sin, cos) = (s as f32 / segments as f32 * TAU).sin_cos();
                    mesh.positions.push(Vec3::new(point.x * cos, point.y, -point.x * sin));
                    mesh.normals.push(Vec3::new(normal.x * cos, normal.y, -normal.x * sin));
                    mesh.uvs.push(Vec2::new(s as f32 / segments as f32 * TAU * widest, v));
                }
            }
            let row = segments + 1;
            for s in 0..segments {
                let (a, b, c, d) = (base + s, base + s + 1, base + s + 1 + row, base + s + row);
                if low.x > 0.0 {
                    mesh.triangles.push([a, b, c]);
                }
                if high.x > 0.0 {
                    mesh.triangles.push([a, c, d]);
                }
            }
        }
        mesh
    }

    /// An upright cylinder standing on y = 0.
    pub(super) fn cylinder(radius: f32, height: f32, segments: u32) -> Self {
        Self::lathe(&[[0.0, 0.0], [radius, 0.0], [radius, height], [0.0, height]], segments)
    }

    /// A ball around the origin.
    pub(super) fn ball(radius: f32, rings: u32) -> Self {
        let profile: Vec<[f32; 2]> = (0..=rings)
            .map(|k| {
                let angle = k as f32 / rings as f32 * PI;
                let r = if k == 0 || k == rings { 0.0 } else { angle.sin() * radius };
                [r, -angle.cos() * radius]
            })
            .collect();
        Self::lathe(&profile, rings * 2)
    }

    /// A round bar along a path, with flat ends.
    pub(super) fn tube(path: &[Vec3], radius: f32, sides: u32) -> Self {
        let mut mesh = Self::default();
        let tangent = |k: usize| {
            let (a, b) = (path[k.saturating_sub(1)], path[(k + 1).min(path.len() - 1)]);
            (b - a).normalize_or(Vec3::Y)
        };
        let mut side = tangent(0).any_orthonormal_vector();
        let mut along = 0.0;
        let mut rings = Vec::new();
        for k in 0..path.len() {
            let t = tangent(k);
            // carried along without twist
            side = (side - t * side.dot(t)).normalize_or(t.any_orthonormal_vector());
            let up = t.cross(side);
            if k > 0 {
                along += path[k].distance(path[k - 1]);
            }
            let ring: Vec<Vec3> = (0..=sides)
                .map(|s| {
                    let (sin, cos) = (s as f32 / sides as f32 * TAU).sin_cos();
                    side * cos + up * sin
                })
                .collect();
            for (s, n) in ring.iter().enumerate() {
                mesh.positions.push(path[k] + *n * radius);
                mesh.normals.push(*n);
                mesh.uvs.push(Vec2::new(s as f32 / sides as f32 * TAU * radius, along));
            }
            rings.push(ring);
        }
        mesh.grid(0, sides + 1, path.len() as u32);
        for (k, sign) in [(0, -1.0f32), (path.len() - 1, 1.0)] {
            let base = mesh.positions.len() as u32;
            let normal = tangent(k) * sign;
            let around = rings[k].iter().map(|n| path[k] + *n * radius);
            mesh.positions.extend(std::iter::once(path[k]).chain(around));
            mesh.normals.extend(vec![normal; sides as usize + 2]);
            mesh.uvs.extend(vec![Vec2::ZERO; sides as usize + 2]);
            for s in 1..=sides {
                let (a, b) = (base + s, base + s + 1);
                mesh.triangles.push(if sign > 0.0 { [base, a, b] } else { [base, b, a] });
            }
        }
        mesh
    }

    /// A surface `point(u, v)` over the unit square with smooth normals `du x dv`; open, seen from both sides.
    pub(super) fn sheet(columns: u32, rows: u32, point: impl Fn(f32, f32) -> Vec3) -> Self {
        let mut mesh = Self::default();
        let step = 1e-3;
        for row in 0..=rows {
            for column in 0..=columns {
                let (u, v) = (column as f32 / columns as f32, row as f32 / rows as f32);
                let du = point(u + step, v) - point(u - step, v);
                let dv = point(u, v + step) - point(u, v - step);
                mesh.positions.push(point(u, v));
                mesh.normals.push(du.cross(dv).normalize_or(Vec3::Y));
                mesh.uvs.push(Vec2::new(u, v));
            }
        }
        mesh.grid(0, columns + 1, rows + 1);
        mesh
    }
}

/// An opening in a wall: from and to along the wall, from and to in height, metres.
pub(super) type Opening = [f32; 4];

/// A wall standing between two corners, `thickness` to the left of the way from `start` to `end`, with openings cut
/// through it. All faces are there, reveals included, so it is closed.
pub(super) fn wall(start: Vec2, end: Vec2, thickness: f32, heights: [f32; 2], openings: &[Opening]) -> Mesh {
    let along = (end - start).normalize_or(Vec2::X);
    let length = start.distance(end);
    let left = Vec2::new(along.y, -along.x) * thickness;
    let point = |u: f32, v: f32, w: f32| {
        let p = start + along * u + left * w;
        Vec3::new(p.x, v, p.y)
    };
    let cuts = |low: f32, high: f32, pick: fn(&Opening) -> [f32; 2]| {
        let mut cuts = vec![low, high];
        cuts.extend(openings.iter().flat_map(pick).filter(|c| *c > low && *c < high));
        cuts.sort_by(f32::total_cmp);
        cuts.dedup();
        cuts
    };
    let us = cuts(0.0, length, |o| [o[0], o[1]]);
    let vs = cuts(heights[0], heights[1], |o| [o[2], o[3]]);
    let is_solid = |i: i32, j: i32| {
        if i < 0 || j < 0 || i as usize + 1 >= us.len() || j as usize + 1 >= vs.len() {
            return false;
        }
        let u = f32::midpoint(us[i as usize], us[i as usize + 1]);
        let v = f32::midpoint(vs[j as usize], vs[j as usize + 1]);
        !openings.iter().any(|o| u > o[0] && u < o[1] && v > o[2] && v < o[3])
    };
    let mut mesh = Mesh::default();
    for i in 0..us.len() as i32 - 1 {
        for j in 0..vs.len() as i32 - 1 {
            if !is_solid(i, j) {
                continue;
            }
            let (u0, u1) = (us[i as usize], us[i as usize + 1]);
            let (v0, v1) = (vs[j as usize], vs[j as usize + 1]);
            let mut face = |a: [f32; 3], b: [f32; 3], c: [f32; 3]| {
                let [a, b, c] = [a, b, c].map(|p| point(p[0], p[1], p[2]));
                mesh.add(Mesh::rectangle(a, b - a, c - a));
            };
            face([u0, v0, 0.0], [u1, v0, 0.0], [u0, v1, 0.0]);
            face([u1, v0, 1.0], [u0, v0, 1.0], [u1, v1, 1.0]);
            if !is_solid(i - 1, j) {
                face([u0, v0, 1.0], [u0, v0, 0.0], [u0, v1, 1.0]);
            }
            if !is_solid(i + 1, j) {
                face([u1, v0, 0.0], [u1, v0, 1.0], [u1, v1, 0.0]);
            }
            if !is_solid(i, j - 1) {
                face([u0, v0, 1.0], [u1, v0, 1.0], [u0, v0, 0.0]);
            }
            if !is_solid(i, j + 1) {
                face([u0, v1, 0.0], [u1, v1, 0.0], [u0, v1, 1.0]);
            }
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twice the signed volume over 6: positive where a closed mesh is wound outward.
    fn volume(mesh: &Mesh) -> f32 {
        let corner = |v: u32| mesh.positions[v as usize];
        mesh.triangles.iter().map(|t| corner(t[0]).dot(corner(t[1]).cross(corner(t[2]))) / 6.0).sum()
    }

    fn assert_outward(name: &str, mesh: &Mesh, expected: f32) {
        let found = volume(mesh);
        assert!((found - expected).abs() < 0.03 * expected, "{name}: volume {found}, not {expected}");
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|v| mesh.positions[v as usize]);
            let face = (b - a).cross(c - a);
            assert!(face.length() > 0.0, "{name}: triangle without area");
            for &v in triangle {
                assert!(face.dot(mesh.normals[v as usize]) > 0.0, "{name}: a normal points inward");
            }
        }
    }

    #[test]
    fn shapes_are_closed_and_face_outward() {
        assert_outward("block", &Mesh::block(1.0, 2.0, 3.0), 6.0);
        assert_outward("ball", &Mesh::ball(1.0, 24), 4.0 / 3.0 * PI);
        assert_outward("cylinder", &Mesh::cylinder(0.5, 2.0, 48), 0.25 * PI * 2.0);
        assert_outward("tube", &Mesh::tube(&[Vec3::ZERO, Vec3::Y, Vec3::Y * 2.0], 0.5, 48), 0.25 * PI * 2.0);
        assert_outward("pillow", &Mesh::pillow(1.0, 1.0, 1.0, 0.01, 3), 1.0);
        let moved = Mesh::block(1.0, 1.0, 1.0).turned(30.0).at(5.0, 1.0, 2.0);
        assert_outward("moved", &moved, 1.0);
        let open = wall(Vec2::ZERO, Vec2::new(4.0, 0.0), 0.5, [0.0, 2.0], &[[1.0, 2.0, 0.5, 1.5]]);
        assert_outward("wall", &open, 4.0 * 2.0 * 0.5 - 0.5);
        let turned = wall(Vec2::new(1.0, 1.0), Vec2::new(1.0, -3.0), 0.5, [0.0, 2.0], &[[1.0, 2.0, 0.0, 1.5]]);
        assert_outward("door", &turned, 4.0 * 2.0 * 0.5 - 0.75);
    }
}
