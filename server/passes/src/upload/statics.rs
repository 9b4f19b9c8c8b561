//! Buffers that nothing changes once they are made: hierarchies of meshes, vertices, materials, images.

use surfelcast_gpu::{Buffer, Gpu, GpuError, PassBuilder};
use surfelcast_scene::{Environment, Geometry, Scene};
use surfelcast_shaders::records::{AliasEntry, BvhTriangle, GeometryRecord, MaterialRecord, geometry_flags};

use super::materials::{material_records, unique_images};
use super::upload;

/// What all sessions and jobs share that show a scene in one state.
#[derive(Debug)]
pub struct StaticBuffers {
    /// Size of the environment image; 1x1 for a constant.
    pub(super) environment_size: [u32; 2],
    nodes: Buffer,
    bvh_triangles: Buffer,
    triangles: Buffer,
    vertices: Buffer,
    geometries: Buffer,
    materials: Buffer,
    texture_uses: Buffer,
    texels: Buffer,
    environment_texels: Buffer,
    environment_table: Buffer,
}

impl StaticBuffers {
    /// Device bytes that a scene will take, for admission before anything is allocated.
    pub fn estimate_bytes(scene: &Scene) -> u64 {
        let geometry = &scene.geometry;
        let environment = match &scene.environment {
            Environment::Map(map) => u64::from(map.width) * u64::from(map.height),
            _ => 1,
        };
        let texels: u64 = unique_images(&scene.textures).iter().map(|texture| texture.texels.len() as u64).sum();
        (size_of_val(geometry.nodes.as_slice())
            + size_of_val(geometry.bvh_triangles.as_slice())
            + size_of_val(geometry.triangles.as_slice())
            + size_of_val(geometry.vertices.as_slice())
            + geometry.geometries.len() * size_of::<GeometryRecord>()
            + scene.materials.len() * size_of::<MaterialRecord>()) as u64
            + texels
            + environment * 32
    }

    /// Uploads a scene's share.
    pub fn new(gpu: &Gpu, scene: &Scene) -> Result<Self, GpuError> {
        let geometry = &scene.geometry;
        let (materials, texture_uses, texels) = material_records(scene);
        let (environment_size, environment_texels, environment_table) = environment_records(&scene.environment);
        let geometries: Vec<GeometryRecord> = geometry.geometries.iter().map(geometry_record).collect();
        Ok(Self {
            environment_size,
            nodes: upload(gpu, "nodes", &geometry.nodes)?,
            bvh_triangles: upload(gpu, "bvh_triangles", &geometry.bvh_triangles)?,
            triangles: upload(gpu, "triangles", &geometry.triangles)?,
            vertices: upload(gpu, "vertices", &geometry.vertices)?,
            geometries: upload(gpu, "geometries", &geometries)?,
            materials: upload(gpu, "materials", &materials)?,
            texture_uses: upload(gpu, "texture_uses", &texture_uses)?,
            texels: upload(gpu, "texels", &texels)?,
            environment_texels: upload(gpu, "environment_texels", &environment_texels)?,
            environment_table: upload(gpu, "environment_table", &environment_table)?,
        })
    }

    /// Triangles of all hierarchies.
    pub(super) fn triangle_count(&self) -> u32 {
        (self.bvh_triangles.size_bytes() / size_of::<BvhTriangle>() as u64) as u32
    }

    pub(super) fn bind<'g>(&self, mut pass: PassBuilder<'g>) -> PassBuilder<'g> {
        for (name, buffer) in [
            ("nodes", &self.nodes),
            ("bvh_triangles", &self.bvh_triangles),
            ("triangles", &self.triangles),
            ("vertices", &self.vertices),
            ("geometries", &self.geometries),
            ("materials", &self.materials),
            ("texture_uses", &self.texture_uses),
            ("texels", &self.texels),
            ("environment_texels", &self.environment_texels),
            ("environment_table", &self.environment_table),
        ] {
            pass = pass.bind_if_bound(name, buffer);
        }
        pass
    }
}

fn geometry_record(part: &Geometry) -> GeometryRecord {
    GeometryRecord {
        first_triangle: part.first_triangle,
        material: part.material,
        first_light: part.first_light,
        flags_and_node: (u32::from(part.has_normals) * geometry_flags::HAS_NORMALS)
            | (u32::from(part.has_tangents) * geometry_flags::HAS_TANGENTS)
            | (u32::from(part.has_colors) * geometry_flags::HAS_COLORS)
            | part.node << 8,
    }
}

fn environment_records(environment: &Environment) -> ([u32; 2], Vec<[f32; 4]>, Vec<AliasEntry>) {
    match environment {
        Environment::None => ([1, 1], vec![[0.0; 4]], Vec::new()),
        Environment::Constant([r, g, b]) => ([1, 1], vec![[*r, *g, *b, 0.0]], Vec::new()),
        Environment::Map(map) => {
            let texels = map.radiance.iter().map(|[r, g, b]| [*r, *g, *b, 0.0]).collect();
            let table = crate::lights::alias_entries(&crate::lights::environment_weights(map));
            ([map.width, map.height], texels, table)
        }
    }
}
