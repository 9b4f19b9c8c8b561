//! Bounds on what a file may ask of the server, checked before anything is allocated.

/// Limits of one scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SceneLimits {
    /// Bytes of the main file plus buffers and images.
    pub max_file_bytes: u64,
    /// Bytes of the JSON, whose parsed form is many times larger.
    pub max_json_bytes: u64,
    /// Vertices over all meshes, baked copies included.
    pub max_vertices: u32,
    /// Triangles over all meshes, baked copies included.
    pub max_triangles: u32,
    /// Nodes.
    pub max_nodes: u32,
    /// Depth of the node tree.
    pub max_node_depth: u32,
    /// Instances.
    pub max_instances: u32,
    /// Materials.
    pub max_materials: u32,
    /// Width or height of an image.
    pub max_image_side: u32,
    /// Decoded bytes over all images (4 a texel).
    pub max_texel_bytes: u64,
    /// Punctual lights.
    pub max_punctual_lights: u32,
    /// Pixels of an environment map.
    pub max_environment_pixels: u32,
}

impl Default for SceneLimits {
    fn default() -> Self {
        Self {
            max_file_bytes: 2 << 30,
            max_json_bytes: 64 << 20,
            max_vertices: 64 << 20,
            max_triangles: 64 << 20,
            max_nodes: 1 << 20,
            max_node_depth: 256,
            max_instances: 1 << 20,
            max_materials: 1 << 16,
            max_image_side: 16_384,
            max_texel_bytes: 2 << 30,
            max_punctual_lights: 1 << 16,
            max_environment_pixels: 64 << 20,
        }
    }
}
