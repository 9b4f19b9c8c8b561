//! Writes placed meshes into the scene's arrays and builds the hierarchies over them.

use std::borrow::Cow;
use std::collections::BTreeMap;

use glam::{DMat3, DMat4, DVec3, Vec3};
use rayon::prelude::*;

use super::assemble::{Assembled, Emitter, Placed, Rigid};
use super::bvh;
use super::deform::normal_matrix;
use super::placement::{Placement, is_emissive};
use crate::asset::check::{invalid, within};
use crate::asset::primitive::PrimitiveData;
use crate::asset::{Part, SceneAsset};
use crate::geometry::{SceneGeometry, pack_color, pack_octahedral, pack_tangent};
use crate::{AlphaMode, Bounds, BvhTriangle, Geometry, Instance, PackedVertex, SceneError, TriangleRecord};

/// A hierarchy to be built: the triangles of the scene that belong to it.
struct Group {
    triangles: Vec<u32>,
    /// Scene from object (recentred) and the index of the node's name.
    placements: Vec<(DMat4, u32)>,
    center: DVec3,
}

/// Geometry under construction.
pub(super) struct Emit<'a> {
    asset: &'a SceneAsset<'a>,
    origin: DVec3,
    geometry: SceneGeometry,
    /// Position of every vertex in the space of its geometry.
    positions: Vec<Vec3>,
    node_names: Vec<String>,
    name_of_node: BTreeMap<usize, u32>,
    emitters: Vec<Emitter>,
    baked: Vec<u32>,
    instanced: BTreeMap<usize, Group>,
}

impl<'a> Emit<'a> {
    pub(super) fn new(asset: &'a SceneAsset<'a>, origin: DVec3) -> Self {
        Self {
            asset,
            origin,
            geometry: SceneGeometry::default(),
            positions: Vec::new(),
            node_names: Vec::new(),
            name_of_node: BTreeMap::new(),
            emitters: Vec::new(),
            baked: Vec::new(),
            instanced: BTreeMap::new(),
        }
    }

    fn node_name(&mut self, node: usize) -> u32 {
        *self.name_of_node.entry(node).or_insert_with(|| {
            let name = self.asset.document.nodes[node].name.clone();
            self.node_names.push(name.unwrap_or_else(|| format!("node {node}")));
            (self.node_names.len() - 1) as u32
        })
    }

    /// Writes one use of a mesh.
    pub(super) fn place(&mut self, item: &Placed<'_>, rigid: &Rigid<'_>) -> Result<(), SceneError> {
        let used = &item.used;
        let node = self.node_name(used.placed.node);
        let (world, origin) = (used.placed.world, self.origin);
        let parts = &self.asset.meshes[&used.mesh];
        match used.placement {
            Placement::Deformed => {
                for (part, deformed) in parts.iter().zip(&item.deformed) {
                    let range = match &deformed.world_positions {
                        Some(positions) => {
                            let turn = DMat4::IDENTITY;
                            self.append(part, &deformed.data, node, &turn, |v| positions[v] - origin)?
                        }
                        None => self.append_baked(part, &deformed.data, node, &world)?,
                    };
                    self.baked.extend(range);
                }
            }
            Placement::Baked => {
                for (part, data) in parts.iter().zip(&rigid[&used.mesh]) {
                    let range = self.append_baked(part, data, node, &world)?;
                    self.baked.extend(range);
                }
            }
            Placement::Instanced => {
                if !self.instanced.contains_key(&used.mesh) {
                    let list = &rigid[&used.mesh];
                    let center = object_center(list);
                    let mut triangles = Vec::new();
                    for (part, data) in parts.iter().zip(list) {
                        let range = self.append(part, data, node, &DMat4::IDENTITY, |v| {
                            DVec3::from_array(data.positions[v].map(f64::from)) - center
                        })?;
                        triangles.extend(range);
                    }
                    let group = Group { triangles, placements: Vec::new(), center };
                    self.instanced.insert(used.mesh, group);
                }
                if let Some(group) = self.instanced.get_mut(&used.mesh) {
                    let placed = DMat4::from_translation(-origin) * world * DMat4::from_translation(group.center);
                    group.placements.push((placed, node));
                }
            }
        }
        Ok(())
    }

    /// Appends one geometry in scene space.
    fn append_baked(
        &mut self,
        part: &Part,
        data: &PrimitiveData,
        node: u32,
        world: &DMat4,
    ) -> Result<std::ops::Range<u32>, SceneError> {
        let origin = self.origin;
        self.append(part, data, node, world, |v| {
            world.transform_point3(DVec3::from_array(data.positions[v].map(f64::from))) - origin
        })
    }

    /// Appends one geometry; `position` gives vertices in its own space, `turn` is the matrix for normals and tangents.
    fn append(
        &mut self,
        part: &Part,
        data: &PrimitiveData,
        node: u32,
        turn: &DMat4,
        position: impl Fn(usize) -> DVec3,
    ) -> Result<std::ops::Range<u32>, SceneError> {
        let limits = &self.asset.limits;
        let (vertex_base, triangle_base) = (self.positions.len(), self.geometry.triangles.len());
        let vertices = (vertex_base + data.positions.len()) as u64;
        within("vertices, copies included", vertices, u64::from(limits.max_vertices))?;
        let geometry = self.geometry.geometries.len() as u32;
        for vertex in 0..data.positions.len() {
            let p = position(vertex).as_vec3();
            // 1e15 squared twice still fits f32, so areas and distances stay finite
            if !p.is_finite() || p.abs().max_element() > 1e15 {
                return Err(invalid(part.field(), "has a vertex farther than 1e15 m from the scene's centre"));
            }
            self.positions.push(p);
        }
        let linear = DMat3::from_mat4(*turn);
        let is_mirrored = linear.determinant() < 0.0;
        let normals = normal_matrix(turn);
        self.geometry
            .vertices
            .extend((0..data.positions.len()).map(|v| pack_vertex(data, v, normals, linear, is_mirrored)));

        let material = &self.asset.materials[part.material as usize];
        let is_light = is_emissive(material);
        self.geometry.geometries.push(Geometry {
            first_triangle: triangle_base as u32,
            triangle_count: data.triangles.len() as u32,
            material: part.material,
            node,
            first_light: if is_light { self.emitters.len() as u32 } else { u32::MAX },
            has_normals: data.normals.is_some(),
            has_tangents: data.tangents.is_some(),
            has_colors: data.colors.is_some(),
        });
        for corners in &data.triangles {
            let mut vertices = corners.map(|c| vertex_base as u32 + c);
            if is_mirrored {
                vertices.swap(1, 2);
            }
            if is_light {
                self.emitters.push(Emitter {
                    corners: vertices.map(|v| self.positions[v as usize]),
                    triangle: self.geometry.triangles.len() as u32,
                    material: part.material,
                });
            }
            self.geometry.triangles.push(TriangleRecord { vertices, geometry });
        }
        Ok(triangle_base as u32..self.geometry.triangles.len() as u32)
    }

    fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.geometry.triangles[triangle as usize].vertices.map(|v| self.positions[v as usize])
    }

    /// Builds hierarchies of all groups side by side, then the top level.
    pub(super) fn finish(mut self, world: Option<(DVec3, DVec3)>) -> Result<Assembled, SceneError> {
        let started = std::time::Instant::now();
        let mut warnings = Vec::new();
        let mut groups = Vec::new();
        if !self.baked.is_empty() {
            groups.push(Group {
                triangles: std::mem::take(&mut self.baked),
                placements: vec![(DMat4::IDENTITY, 0)],
                center: DVec3::ZERO,
            });
        }
        let has_baked = !groups.is_empty();
        groups.extend(std::mem::take(&mut self.instanced).into_values());
        let mut dropped = 0;
        for group in &mut groups {
            let before = group.triangles.len();
            let kept = group.triangles.iter().copied().filter(|&t| !is_degenerate(&self.corners(t))).collect();
            group.triangles = kept;
            dropped += before - group.triangles.len();
        }
        if dropped > 0 {
            warnings.push(format!("{dropped} triangles without area are not traced"));
        }
        groups.retain(|group| !group.triangles.is_empty());
        let (records, positions) = (&self.geometry.triangles, &self.positions);
        let built: Vec<(bvh::Hierarchy, Bounds)> = groups
            .par_iter()
            .map(|group| {
                let corner_list = |t: u32| records[t as usize].vertices.map(|v| positions[v as usize]);
                let corners: Vec<[Vec3; 3]> = group.triangles.iter().map(|&t| corner_list(t)).collect();
                let bounds = corners.iter().flatten().fold(Bounds::EMPTY, |bounds, &p| bounds.grow(p));
                (bvh::build_triangles(&corners), bounds)
            })
            .collect();
        let mut placed: Vec<(Instance, Bounds, bool)> = Vec::new();
        let mut bottom_depth = 0;
        for (k, (group, (hierarchy, bounds))) in groups.iter().zip(&built).enumerate() {
            within("levels of a hierarchy", u64::from(hierarchy.depth), u64::from(bvh::MAX_BOTTOM_DEPTH))?;
            bottom_depth = bottom_depth.max(hierarchy.depth);
            let root_node = self.append_nodes(hierarchy, self.geometry.bvh_triangles.len());
            for &slot in &hierarchy.order {
                let triangle = group.triangles[slot as usize];
                let packed = self.bvh_triangle(triangle);
                self.geometry.bvh_triangles.push(packed);
            }
            let is_baked = has_baked && k == 0;
            for &(matrix, node) in &group.placements {
                placed.push((instance(&matrix, root_node, node)?, transformed(bounds, &matrix), is_baked));
            }
        }
        let top = bvh::build_bounds(&placed.iter().map(|(_, bounds, _)| *bounds).collect::<Vec<_>>());
        within("levels of the top hierarchy", u64::from(top.depth), u64::from(bvh::MAX_TOP_DEPTH))?;
        self.geometry.top_nodes = top.nodes;
        self.geometry.instances = top.order.iter().map(|&slot| placed[slot as usize].0).collect();
        self.geometry.baked_instance = top.order.iter().position(|&slot| placed[slot as usize].2).map(|k| k as u32);
        self.geometry.stack_depth = top.depth + bottom_depth;
        let bounds = world.map(|(low, high)| {
            let (low, high) = (low - self.origin, high - self.origin);
            Bounds { min: low.as_vec3(), max: high.as_vec3() }
        });
        Ok(Assembled {
            geometry: self.geometry,
            origin: self.origin,
            bounds,
            node_names: self.node_names,
            emitters: self.emitters,
            warnings,
            build_secs: started.elapsed().as_secs_f64(),
        })
    }

    /// Appends nodes with their indices moved to where they stand in the scene; returns the root.
    fn append_nodes(&mut self, hierarchy: &bvh::Hierarchy, primitive_base: usize) -> u32 {
        let base = self.geometry.nodes.len() as u32;
        self.geometry.nodes.extend(hierarchy.nodes.iter().map(|node| {
            let mut node = *node;
            node.child_base_idx += base;
            node.primitive_base_idx += primitive_base as u32;
            node
        }));
        base
    }

    fn bvh_triangle(&self, triangle: u32) -> BvhTriangle {
        let [v0, v1, v2] = self.corners(triangle).map(|v| v.to_array());
        let geometry = self.geometry.triangles[triangle as usize].geometry;
        let material = self.geometry.geometries[geometry as usize].material as usize;
        let flags = u32::from(self.asset.materials[material].alpha_mode != AlphaMode::Opaque);
        BvhTriangle { v0, triangle, v1, geometry, v2, flags }
    }
}

fn pack_vertex(data: &PrimitiveData, v: usize, normals: DMat3, linear: DMat3, is_mirrored: bool) -> PackedVertex {
    let normal = data.normals.as_ref().map_or(Vec3::Z, |list| {
        let normal = normals * DVec3::from_array(list[v].map(f64::from));
        normal.normalize_or(DVec3::Z).as_vec3()
    });
    let tangent = data.tangents.as_ref().map_or(0, |list| {
        let [x, y, z, w] = list[v].map(f64::from);
        let tangent = (linear * DVec3::new(x, y, z)).normalize_or(DVec3::X).as_vec3();
        pack_tangent(tangent, (w < 0.0) != is_mirrored)
    });
    let uv = |set: usize| data.uvs[set].as_ref().map_or([0.0; 2], |list| list[v]);
    let color = data.colors.as_ref().map_or([1.0; 4], |list| list[v]);
    PackedVertex { normal: pack_octahedral(normal), tangent, uv0: uv(0), uv1: uv(1), color: pack_color(color) }
}

/// Middle of a mesh in its own space, which instancing moves to the origin for precision.
fn object_center(list: &[Cow<'_, PrimitiveData>]) -> DVec3 {
    let positions = list.iter().flat_map(|data| &data.positions);
    let bounds = positions.fold(Bounds::EMPTY, |bounds, &p| bounds.grow(Vec3::from_array(p)));
    if bounds.min.x <= bounds.max.x { bounds.center().as_dvec3() } else { DVec3::ZERO }
}

/// Whether a triangle has no area, so that no ray can meet it.
fn is_degenerate(corners: &[Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    (b - a).cross(c - a) == DVec3::ZERO
}

fn rows(matrix: &DMat4) -> Option<[[f32; 4]; 3]> {
    let transposed = matrix.transpose();
    let rows = [transposed.x_axis, transposed.y_axis, transposed.z_axis].map(|row| row.as_vec4().to_array());
    rows.iter().flatten().all(|x| x.is_finite()).then_some(rows)
}

fn instance(matrix: &DMat4, root_node: u32, node: u32) -> Result<Instance, SceneError> {
    let placed = rows(matrix).zip(rows(&matrix.inverse()));
    let Some((scene_from_object, object_from_scene)) = placed else {
        return Err(invalid("nodes[].scale", "of an instanced mesh is too small or too large to invert"));
    };
    let is_mirrored = DMat3::from_mat4(*matrix).determinant() < 0.0;
    Ok(Instance { scene_from_object, object_from_scene, root_node, node, is_mirrored })
}

/// Bounds of a transformed box, a little widened against rounding.
fn transformed(bounds: &Bounds, matrix: &DMat4) -> Bounds {
    if *matrix == DMat4::IDENTITY {
        return *bounds;
    }
    let (low, high) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
    let corners = (0..8).map(|k| {
        let pick = |bit: u32, axis: usize| if k >> bit & 1 == 0 { low[axis] } else { high[axis] };
        matrix.transform_point3(DVec3::new(pick(0, 0), pick(1, 1), pick(2, 2))).as_vec3()
    });
    let around = corners.fold(Bounds::EMPTY, Bounds::grow);
    let margin = Vec3::splat(around.max.abs().max(around.min.abs()).max_element() * 2f32.powi(-20));
    Bounds { min: around.min - margin, max: around.max + margin }
}
