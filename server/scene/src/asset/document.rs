//! The JSON of a glTF 2.0 file, as far as it is used.
//!
//! Own types instead of the `gltf` crate's: those keep node transforms in `f32`, which snaps scenes far from the
//! origin, and demand members that the specification makes optional (`scenes[].nodes`, `channels[].target.node`).
//! Nothing here is trusted: indices and enumerants are checked where they are used, by [`item`] and the readers.

use serde::Deserialize;

use super::check::{clip, invalid};
use crate::SceneError;

/// Extensions that are honoured.
const SUPPORTED: [&str; 9] = [
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];

/// Warnings kept at most; a hostile file could name millions of extensions.
pub(crate) const MAX_WARNINGS: usize = 64;

/// The root object.
#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(crate) struct Document {
    pub(crate) asset: Asset,
    pub(crate) extensions_used: Vec<String>,
    pub(crate) extensions_required: Vec<String>,
    pub(crate) extensions: RootExtensions,
    pub(crate) scene: Option<usize>,
    pub(crate) scenes: Vec<SceneItem>,
    pub(crate) nodes: Vec<Node>,
    pub(crate) meshes: Vec<Mesh>,
    pub(crate) skins: Vec<Skin>,
    pub(crate) animations: Vec<Animation>,
    pub(crate) cameras: Vec<CameraItem>,
    pub(crate) materials: Vec<MaterialItem>,
    pub(crate) textures: Vec<TextureItem>,
    pub(crate) samplers: Vec<Sampler>,
    pub(crate) images: Vec<Image>,
    pub(crate) accessors: Vec<Accessor>,
    pub(crate) buffer_views: Vec<BufferView>,
    pub(crate) buffers: Vec<Buffer>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(crate) struct Asset {
    pub(crate) version: String,
    pub(crate) min_version: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct RootExtensions {
    #[serde(rename = "KHR_lights_punctual")]
    pub(crate) lights_punctual: LightsPunctual,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct LightsPunctual {
    pub(crate) lights: Vec<LightItem>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct LightItem {
    #[serde(rename = "type")]
    pub(crate) kind: String,
    pub(crate) name: Option<String>,
    pub(crate) color: Option<[f64; 3]>,
    pub(crate) intensity: Option<f64>,
    pub(crate) range: Option<f64>,
    pub(crate) spot: Option<Spot>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(crate) struct Spot {
    pub(crate) inner_cone_angle: Option<f64>,
    pub(crate) outer_cone_angle: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct SceneItem {
    pub(crate) nodes: Vec<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Node {
    pub(crate) name: Option<String>,
    pub(crate) children: Vec<usize>,
    pub(crate) matrix: Option<[f64; 16]>,
    pub(crate) translation: Option<[f64; 3]>,
    pub(crate) rotation: Option<[f64; 4]>,
    pub(crate) scale: Option<[f64; 3]>,
    pub(crate) mesh: Option<usize>,
    pub(crate) skin: Option<usize>,
    pub(crate) weights: Option<Vec<f64>>,
    pub(crate) camera: Option<usize>,
    pub(crate) extensions: NodeExtensions,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct NodeExtensions {
    #[serde(rename = "KHR_lights_punctual")]
    pub(crate) lights_punctual: Option<NodeLight>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct NodeLight {
    pub(crate) light: usize,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Mesh {
    pub(crate) primitives: Vec<Primitive>,
    pub(crate) weights: Vec<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Primitive {
    pub(crate) attributes: Attributes,
    pub(crate) indices: Option<usize>,
    pub(crate) material: Option<usize>,
    pub(crate) mode: Option<u32>,
    pub(crate) targets: Vec<MorphTarget>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Attributes {
    #[serde(rename = "POSITION")]
    pub(crate) position: Option<usize>,
    #[serde(rename = "NORMAL")]
    pub(crate) normal: Option<usize>,
    #[serde(rename = "TANGENT")]
    pub(crate) tangent: Option<usize>,
    #[serde(rename = "TEXCOORD_0")]
    pub(crate) texcoord_0: Option<usize>,
    #[serde(rename = "TEXCOORD_1")]
    pub(crate) texcoord_1: Option<usize>,
    #[serde(rename = "COLOR_0")]
    pub(crate) color_0: Option<usize>,
    #[serde(rename = "JOINTS_0")]
    pub(crate) joints_0: Option<usize>,
    #[serde(rename = "JOINTS_1")]
    pub(crate) joints_1: Option<usize>,
    #[serde(rename = "WEIGHTS_0")]
    pub(crate) weights_0: Option<usize>,
    #[serde(rename = "WEIGHTS_1")]
    pub(crate) weights_1: Option<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct MorphTarget {
    #[serde(rename = "POSITION")]
    pub(crate) position: Option<usize>,
    #[serde(rename = "NORMAL")]
    pub(crate) normal: Option<usize>,
    #[serde(rename = "TANGENT")]
    pub(crate) tangent: Option<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(crate) struct Skin {
    pub(crate) inverse_bind_matrices: Option<usize>,
    pub(crate) joints: Vec<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Animation {
    pub(crate) name: Option<String>,
    pub(crate) channels: Vec<Channel>,
    pub(crate) samplers: Vec<AnimationSampler>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct Channel {
    pub(crate) sampler: usize,
    pub(crate) target: ChannelTarget,
}

#[derive(Debug, Deserialize)]
pub(crate) struct ChannelTarget {
    pub(crate) node: Option<usize>,
    pub(crate) path: String,
}

#[derive(Debug, Deserialize)]
pub(crate) struct AnimationSampler {
    pub(crate) input: usize,
    pub(crate) output: usize,
    pub(crate) interpolation: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct CameraItem {
    pub(crate) name: Option<String>,
    pub(crate) perspective: Option<Perspective>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct Perspective {
    pub(crate) yfov: f64,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(crate) struct MaterialItem {
    pub(crate) name: Option<String>,
    pub(crate) pbr_metallic_roughness: Pbr,
    pub(crate) normal_texture: Option<TextureInfo>,
    pub(crate) occlusion_texture: Option<TextureInfo>,
    pub(crate) emissive_texture: Option<TextureInfo>,
    pub(crate) emissive_factor: Option<[f64; 3]>,
    pub(crate) alpha_mode: Option<String>,
    pub(crate) alpha_cutoff: Option<f64>,
    pub(crate) double_sided: bool,
    pub(crate) extensions: MaterialExtensions,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(crate) struct Pbr {
    pub(crate) base_color_factor: Option<[f64; 4]>,
    pub(crate) base_color_texture: Option<TextureInfo>,
    pub(crate) metallic_factor: Option<f64>,
    pub(crate) roughness_factor: Option<f64>,
    pub(crate) metallic_roughness_texture: Option<TextureInfo>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct MaterialExtensions {
    #[serde(rename = "KHR_materials_emissive_strength")]
    pub(crate) emissive_strength: Option<EmissiveStrength>,
    #[serde(rename = "KHR_materials_ior")]
    pub(crate) ior: Option<Ior>,
    #[serde(rename = "KHR_materials_transmission")]
    pub(crate) transmission: Option<Transmission>,
    #[serde(rename = "KHR_materials_volume")]
    pub(crate) volume: Option<Volume>,
    #[serde(rename = "KHR_materials_unlit")]
    pub(crate) unlit: Option<Unlit>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(crate) struct EmissiveStrength {
    pub(crate) emissive_strength: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Ior {
    pub(crate) ior: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(crate) struct Transmission {
    pub(crate) transmission_factor: Option<f64>,
    pub(crate) transmission_texture: Option<TextureInfo>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(crate) struct Volume {
    pub(crate) thickness_factor: Option<f64>,
    pub(crate) attenuation_distance: Option<f64>,
    pub(crate) attenuation_color: Option<[f64; 3]>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct Unlit {}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct TextureInfo {
    pub(crate) index: usize,
    #[serde(default)]
    pub(crate) tex_coord: u32,
    /// Normal textures only.
    pub(crate) scale: Option<f64>,
    /// Occlusion textures only.
    pub(crate) strength: Option<f64>,
    #[serde(default)]
    pub(crate) extensions: TextureInfoExtensions,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct TextureInfoExtensions {
    #[serde(rename = "KHR_texture_transform")]
    pub(crate) transform: Option<TextureTransform>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(crate) struct TextureTransform {
    pub(crate) offset: Option<[f64; 2]>,
    pub(crate) rotation: Option<f64>,
    pub(crate) scale: Option<[f64; 2]>,
    pub(crate) tex_coord: Option<u32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct TextureItem {
    pub(crate) sampler: Option<usize>,
    pub(crate) source: Option<usize>,
    pub(crate) extensions: TextureExtensions,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct TextureExtensions {
    #[serde(rename = "EXT_texture_webp")]
    pub(crate) webp: Option<TextureSource>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct TextureSource {
    pub(crate) source: usize,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(crate) struct Sampler {
    pub(crate) mag_filter: Option<u32>,
    pub(crate) wrap_s: Option<u32>,
    pub(crate) wrap_t: Option<u32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(crate) struct Image {
    pub(crate) uri: Option<String>,
    pub(crate) buffer_view: Option<usize>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Accessor {
    pub(crate) buffer_view: Option<usize>,
    #[serde(default)]
    pub(crate) byte_offset: u64,
    pub(crate) component_type: u32,
    #[serde(default)]
    pub(crate) normalized: bool,
    pub(crate) count: u64,
    #[serde(rename = "type")]
    pub(crate) shape: String,
    pub(crate) sparse: Option<Sparse>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct Sparse {
    pub(crate) count: u64,
    pub(crate) indices: SparseIndices,
    pub(crate) values: SparseValues,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct SparseIndices {
    pub(crate) buffer_view: usize,
    #[serde(default)]
    pub(crate) byte_offset: u64,
    pub(crate) component_type: u32,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct SparseValues {
    pub(crate) buffer_view: usize,
    #[serde(default)]
    pub(crate) byte_offset: u64,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct BufferView {
    pub(crate) buffer: usize,
    #[serde(default)]
    pub(crate) byte_offset: u64,
    pub(crate) byte_length: u64,
    pub(crate) byte_stride: Option<u64>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Buffer {
    pub(crate) uri: Option<String>,
    pub(crate) byte_length: u64,
}

/// Parses the JSON; errors name the member.
pub(crate) fn parse(json: &[u8]) -> Result<Document, SceneError> {
    let mut deserializer = serde_json::Deserializer::from_slice(json);
    let document: Document = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| {
        let field = error.path().to_string();
        invalid(if field == "." { "JSON".to_owned() } else { clip(&field) }, clip(&error.inner().to_string()))
    })?;
    deserializer.end().map_err(|error| invalid("JSON", clip(&error.to_string())))?;
    if !document.asset.version.starts_with("2.") && document.asset.version != "2" {
        return Err(invalid(
            "asset.version",
            format!("is {:?}; only glTF 2.0 is supported", clip(&document.asset.version)),
        ));
    }
    if let Some(minimum) = document.asset.min_version.as_deref().filter(|version| *version != "2.0") {
        return Err(invalid("asset.minVersion", format!("is {:?}; only glTF 2.0 is supported", clip(minimum))));
    }
    Ok(document)
}

/// `items[index]`, or an error that names the member with the index.
pub(crate) fn item<'a, T>(items: &'a [T], index: usize, what: &str, asked_by: &str) -> Result<&'a T, SceneError> {
    items
        .get(index)
        .ok_or_else(|| invalid(asked_by, format!("refers to {what}[{index}], but there are {}", items.len())))
}

/// Refuses required extensions that are not known and lists optional ones.
pub(crate) fn check_extensions(document: &Document) -> Result<Vec<String>, SceneError> {
    let is_known = |name: &String| SUPPORTED.contains(&name.as_str());
    if let Some(name) = document.extensions_required.iter().find(|name| !is_known(name)) {
        return Err(SceneError::UnsupportedExtension { name: clip(name) });
    }
    let unknown = document.extensions_used.iter().filter(|name| !is_known(name)).take(MAX_WARNINGS);
    Ok(unknown.map(|name| format!("extension {} is not supported and ignored", clip(name))).collect())
}
