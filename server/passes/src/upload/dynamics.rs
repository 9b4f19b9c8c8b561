//! Buffers that say where things are: instances, the top level over them, and light triangles, which are in scene
//! space.

use surfelcast_gpu::{Buffer, Gpu, GpuError, PassBuilder};
use surfelcast_scene::geometry::BvhNode;
use surfelcast_scene::{EmissiveTriangle, Scene, SceneGeometry};
use surfelcast_shaders::records::{AliasEntry, InstanceRecord, LightTriangle};

use super::{NO_INDEX, upload};

/// What a session or job has of its own, since moving an object changes it.
#[derive(Debug)]
pub(super) struct DynamicBuffers {
    instances: Buffer,
    top_nodes: Buffer,
    light_triangles: Buffer,
}

impl DynamicBuffers {
    /// Device bytes that a session takes besides the static buffers, its light table included.
    pub(super) fn estimate_bytes(scene: &Scene) -> u64 {
        let geometry = &scene.geometry;
        (geometry.instances.len() * size_of::<InstanceRecord>()
            + geometry.top_nodes.len() * size_of::<BvhNode>()
            + scene.emissive_triangles.len() * (size_of::<LightTriangle>() + size_of::<AliasEntry>())) as u64
    }

    /// Uploads a scene's share.
    pub(super) fn new(gpu: &Gpu, scene: &Scene) -> Result<Self, GpuError> {
        let light_triangles: Vec<LightTriangle> = scene.emissive_triangles.iter().map(light_triangle).collect();
        Ok(Self {
            instances: upload(gpu, "instances", &instance_records(&scene.geometry))?,
            top_nodes: upload(gpu, "top_nodes", &scene.geometry.top_nodes)?,
            light_triangles: upload(gpu, "light_triangles", &light_triangles)?,
        })
    }

    pub(super) fn instance_count(&self) -> u32 {
        (self.instances.size_bytes() / size_of::<InstanceRecord>() as u64) as u32
    }

    pub(super) fn bind<'g>(&self, mut pass: PassBuilder<'g>) -> PassBuilder<'g> {
        for (name, buffer) in
            [("instances", &self.instances), ("top_nodes", &self.top_nodes), ("light_triangles", &self.light_triangles)]
        {
            pass = pass.bind_if_bound(name, buffer);
        }
        pass
    }
}

fn instance_records(geometry: &SceneGeometry) -> Vec<InstanceRecord> {
    geometry
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
        .collect()
}

fn light_triangle(light: &EmissiveTriangle) -> LightTriangle {
    LightTriangle {
        v0: light.corners[0].to_array(),
        triangle: light.triangle,
        v1: light.corners[1].to_array(),
        material: light.material,
        v2: light.corners[2].to_array(),
        area: light.area,
        padding: [0.0; 4],
    }
}
