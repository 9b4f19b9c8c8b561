//! The scene in device memory. Made once for each scene and shared by all sessions and jobs that show it.

use glam::DVec3;
use surfelcast_gpu::{Buffer, Gpu, GpuError, MemoryKind};
use surfelcast_scene::{AlphaMode, Environment, Material, Scene, SceneSummary, Texture, TextureRef, Wrap};
use surfelcast_shaders::Features;
use surfelcast_shaders::layout::bytemuck::{self, Pod};
use surfelcast_shaders::records::{
    AliasEntry, BvhTriangle, GeometryRecord, InstanceRecord, LightTriangle, MaterialRecord, TextureUse, geometry_flags,
    material_flags,
};

/// No texture, no light.
const NO_INDEX: u32 = u32::MAX;

/// Buffers of a scene, named as in `lib/scene/bindings.wesl`.
#[derive(Debug)]
pub struct SceneBuffers {
    /// World position of scene space's origin.
    pub origin: DVec3,
    /// Radius of the sphere around the scene, metres.
    pub radius: f32,
    /// Root of the top level.
    top_root: u32,
    /// Root of the first hierarchy: the only one where there are no instances.
    first_root: u32,
    /// Size of the environment image; 1x1 for a constant.
    pub environment_size: [u32; 2],
    /// What is in the scene.
    pub summary: SceneSummary,
    /// Bytes in all buffers.
    pub bytes: u64,
    pub(crate) nodes: Buffer,
    pub(crate) bvh_triangles: Buffer,
    pub(crate) triangles: Buffer,
    pub(crate) vertices: Buffer,
    pub(crate) geometries: Buffer,
    pub(crate) instances: Buffer,
    pub(crate) materials: Buffer,
    pub(crate) texture_uses: Buffer,
    pub(crate) texels: Buffer,
    pub(crate) light_triangles: Buffer,
    pub(crate) environment_texels: Buffer,
    pub(crate) environment_table: Buffer,
}

/// Uploads slices and keeps count.
struct Uploader<'a> {
    gpu: &'a Gpu,
    bytes: u64,
}

impl Uploader<'_> {
    /// A buffer of a slice. Empty slices become one zeroed element, since a binding may not be empty.
    fn upload<T: Pod>(&mut self, label: &str, items: &[T]) -> Result<Buffer, GpuError> {
        let size = size_of_val(items).max(size_of::<T>()) as u64;
        let buffer = self.gpu.buffer(label, MemoryKind::Scene, size.next_multiple_of(16))?;
        if items.is_empty() {
            self.gpu.upload(&buffer, 0, bytemuck::bytes_of(&T::zeroed()))?;
        } else {
            self.gpu.upload(&buffer, 0, bytemuck::cast_slice(items))?;
        }
        self.bytes += size;
        Ok(buffer)
    }
}

impl SceneBuffers {
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
            + geometry.instances.len() * size_of::<InstanceRecord>()
            + scene.materials.len() * size_of::<MaterialRecord>()
            + scene.emissive_triangles.len() * (size_of::<LightTriangle>() + size_of::<AliasEntry>())) as u64
            + texels
            + environment * 32
    }

    /// Uploads a scene.
    pub fn new(gpu: &Gpu, scene: &Scene) -> Result<Self, GpuError> {
        let geometry = &scene.geometry;
        let (materials, texture_uses, texels) = material_records(scene);
        let (environment_size, environment_texels, environment_table) = environment_records(&scene.environment);
        let geometries: Vec<GeometryRecord> = geometry
            .geometries
            .iter()
            .map(|part| GeometryRecord {
                first_triangle: part.first_triangle,
                material: part.material,
                first_light: part.first_light,
                flags_and_node: (u32::from(part.has_normals) * geometry_flags::HAS_NORMALS)
                    | (u32::from(part.has_tangents) * geometry_flags::HAS_TANGENTS)
                    | (u32::from(part.has_colors) * geometry_flags::HAS_COLORS)
                    | part.node << 8,
            })
            .collect();
        let instances: Vec<InstanceRecord> = geometry
            .instances
            .iter()
            .zip(0u32..)
            .map(|(instance, index)| InstanceRecord {
                scene_from_object: instance.scene_from_object,
                object_from_scene: instance.object_from_scene,
                root_node: instance.root_node,
                node: if geometry.baked_instance == Some(index) { NO_INDEX } else { instance.node },
                is_mirrored: u32::from(instance.is_mirrored),
                padding: 0,
            })
            .collect();
        let light_triangles: Vec<LightTriangle> = scene
            .emissive_triangles
            .iter()
            .map(|light| LightTriangle {
                v0: light.corners[0].to_array(),
                triangle: light.triangle,
                v1: light.corners[1].to_array(),
                material: light.material,
                v2: light.corners[2].to_array(),
                area: light.area,
                padding: [0.0; 4],
            })
            .collect();
        let mut uploader = Uploader { gpu, bytes: 0 };
        Ok(Self {
            origin: scene.origin,
            radius: scene.bounds.radius(),
            top_root: geometry.top_root,
            first_root: geometry.instances.first().map_or(0, |instance| instance.root_node),
            environment_size,
            summary: scene.summary,
            nodes: uploader.upload("nodes", &geometry.nodes)?,
            bvh_triangles: uploader.upload("bvh_triangles", &geometry.bvh_triangles)?,
            triangles: uploader.upload("triangles", &geometry.triangles)?,
            vertices: uploader.upload("vertices", &geometry.vertices)?,
            geometries: uploader.upload("geometries", &geometries)?,
            instances: uploader.upload("instances", &instances)?,
            materials: uploader.upload("materials", &materials)?,
            texture_uses: uploader.upload("texture_uses", &texture_uses)?,
            texels: uploader.upload("texels", &texels)?,
            light_triangles: uploader.upload("light_triangles", &light_triangles)?,
            environment_texels: uploader.upload("environment_texels", &environment_texels)?,
            environment_table: uploader.upload("environment_table", &environment_table)?,
            bytes: uploader.bytes,
        })
    }

    /// Numbers of triangles and of instances, for the validation of attachments to them.
    pub fn attachment_counts(&self) -> [u32; 2] {
        let count = |buffer: &Buffer, bytes_each: usize| (buffer.size_bytes() / bytes_each as u64) as u32;
        [count(&self.bvh_triangles, size_of::<BvhTriangle>()), count(&self.instances, size_of::<InstanceRecord>())]
    }

    /// Root at which a kernel's variant starts to traverse.
    pub(crate) fn traversal_root(&self, features: Features) -> u32 {
        if features.contains(Features::INSTANCES) { self.top_root } else { self.first_root }
    }

    /// Binds to a pass every scene buffer its kernel uses.
    pub fn bind<'g>(&self, mut pass: surfelcast_gpu::PassBuilder<'g>) -> surfelcast_gpu::PassBuilder<'g> {
        for (name, buffer) in [
            ("nodes", &self.nodes),
            ("bvh_triangles", &self.bvh_triangles),
            ("triangles", &self.triangles),
            ("vertices", &self.vertices),
            ("geometries", &self.geometries),
            ("instances", &self.instances),
            ("materials", &self.materials),
            ("texture_uses", &self.texture_uses),
            ("texels", &self.texels),
            ("light_triangles", &self.light_triangles),
            ("environment_texels", &self.environment_texels),
            ("environment_table", &self.environment_table),
        ] {
            pass = pass.bind_if_bound(name, buffer);
        }
        pass
    }
}

/// Textures with distinct images, in order of first use.
fn unique_images(textures: &[Texture]) -> Vec<&Texture> {
    let mut unique: Vec<&Texture> = Vec::new();
    for texture in textures {
        if !unique.iter().any(|other| std::sync::Arc::ptr_eq(&other.texels, &texture.texels)) {
            unique.push(texture);
        }
    }
    unique
}

fn material_records(scene: &Scene) -> (Vec<MaterialRecord>, Vec<TextureUse>, Vec<u32>) {
    let mut texels: Vec<u32> = Vec::new();
    let mut offsets: Vec<u32> = Vec::with_capacity(scene.textures.len());
    let mut placed: Vec<(*const u8, u32)> = Vec::new();
    for texture in &scene.textures {
        let pointer = texture.texels.as_ptr();
        let known = placed.iter().find(|(other, _)| *other == pointer).map(|(_, offset)| *offset);
        let offset = known.unwrap_or_else(|| {
            let offset = texels.len() as u32;
            texels.extend(texture.texels.chunks_exact(4).map(|p| u32::from_le_bytes([p[0], p[1], p[2], p[3]])));
            placed.push((pointer, offset));
            offset
        });
        offsets.push(offset);
    }
    let mut uses = Vec::new();
    let mut add_use = |reference: &Option<TextureRef>| {
        let Some(reference) = reference else { return NO_INDEX };
        let texture = &scene.textures[reference.texture as usize];
        let wrap = |mode| match mode {
            Wrap::Repeat => 0u32,
            Wrap::MirroredRepeat => 1,
            Wrap::ClampToEdge => 2,
        };
        let row = |[x, y, t]: [f32; 3]| [x, y, t, 0.0];
        uses.push(TextureUse {
            offset: offsets[reference.texture as usize],
            width: texture.width,
            height: texture.height,
            flags: wrap(texture.wrap_u)
                | wrap(texture.wrap_v) << 2
                | u32::from(texture.is_linear) << 4
                | (reference.uv_set & 1) << 5,
            row_u: row(reference.transform[0]),
            row_v: row(reference.transform[1]),
        });
        uses.len() as u32 - 1
    };
    let records = scene
        .materials
        .iter()
        .map(|material| MaterialRecord {
            base_color: material.base_color,
            emission: material.emissive,
            metallic: material.metallic,
            absorption: absorption(material),
            roughness: material.roughness,
            ior: material.ior,
            transmission: material.transmission,
            normal_scale: material.normal_scale,
            alpha_cutoff: match material.alpha_mode {
                AlphaMode::Mask { cutoff } => cutoff.max(0.0),
                AlphaMode::Opaque | AlphaMode::Blend => -1.0,
            },
            base_color_texture: add_use(&material.base_color_texture),
            metallic_roughness_texture: add_use(&material.metallic_roughness_texture),
            normal_texture: add_use(&material.normal_texture),
            emission_texture: add_use(&material.emissive_texture),
            transmission_texture: add_use(&material.transmission_texture),
            flags: (u32::from(material.unlit) * material_flags::UNLIT)
                | (u32::from(material.is_volume) * material_flags::VOLUME)
                | (u32::from(material.alpha_mode != AlphaMode::Opaque) * material_flags::ALPHA)
                | (u32::from(material.emissive.iter().any(|&c| c > 0.0)) * material_flags::EMISSIVE),
            padding0: 0,
            padding1: 0,
        })
        .collect();
    (records, uses, texels)
}

/// Absorption coefficient of a volume from the colour white light takes on over the attenuation distance
/// (Beer-Lambert).
fn absorption(material: &Material) -> [f32; 3] {
    if !material.is_volume || !material.attenuation_distance.is_finite() || material.attenuation_distance <= 0.0 {
        return [0.0; 3];
    }
    // Black would absorb infinitely; 1e-6 is black to eight bits and keeps the exponential finite.
    material.attenuation_color.map(|c| -c.clamp(1e-6, 1.0).ln() / material.attenuation_distance)
}

fn environment_records(environment: &Environment) -> ([u32; 2], Vec<[f32; 4]>, Vec<AliasEntry>) {
    match environment {
        Environment::None => ([1, 1], vec![[0.0; 4]], Vec::new()),
        Environment::Constant([r, g, b]) => ([1, 1], vec![[*r, *g, *b, 0.0]], Vec::new()),
        Environment::Map(map) => {
            let texels = map.radiance.iter().map(|[r, g, b]| [*r, *g, *b, 0.0]).collect();
            let table = super::lights::alias_entries(&super::lights::environment_weights(map));
            ([map.width, map.height], texels, table)
        }
    }
}
