//! From bytes to a [`Scene`]: container, JSON, buffers, images, node tree, geometry, lights, cameras.

mod accessor;
mod animation;
mod assemble;
pub(crate) mod check;
mod deform;
mod document;
mod emission;
mod hierarchy;
mod identity;
mod image;
mod light;
mod material;
mod primitive;
mod source;
mod tangent;

use std::path::Path;

use cap_std::ambient_authority;
use cap_std::fs::Dir;
use glam::{DVec3, Vec3};

use crate::{Bounds, Environment, Instant, Scene, SceneError, SceneLimits, SceneSummary, ViewFile};
use accessor::Reader;
use check::{clip, within};
use document::Document;
use source::{Container, Source};

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

/// Extensions and warnings listed at most; a hostile file could name millions.
const MAX_WARNINGS: usize = 64;

/// How to load a scene.
#[derive(Clone, Debug, Default)]
pub struct LoadOptions {
    /// Bounds on what the file may ask for.
    pub limits: SceneLimits,
    /// Cameras, environment, exposure and instant; where `None`, [`load_file`] looks for `<stem>.json` beside the scene.
    pub view: Option<ViewFile>,
    /// Instant of an animation; overrides the view file's.
    pub instant: Option<Instant>,
    /// Environment; overrides the view file's.
    pub environment: Option<Environment>,
}

/// Loads a `.glb` or `.gltf` file. Buffers and images beside it are read from its folder only.
pub fn load_file(path: &Path, options: &LoadOptions) -> Result<Scene, SceneError> {
    let started = std::time::Instant::now();
    let read_error = |source| SceneError::Read { path: path.display().to_string(), source };
    let length = std::fs::metadata(path).map_err(read_error)?.len();
    within("file bytes", length, options.limits.max_file_bytes)?;
    let bytes = std::fs::read(path).map_err(read_error)?;
    let view = match &options.view {
        Some(view) => Some(view.clone()),
        None => ViewFile::read_beside(&path.with_extension("json"))?,
    };
    let folder = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let directory = Dir::open_ambient_dir(folder, ambient_authority()).map_err(read_error)?;
    let name = path.file_stem().map_or_else(|| "scene".to_owned(), |stem| stem.to_string_lossy().into_owned());
    load(&bytes, &name, Some(directory), view.unwrap_or_default(), options, started)
}

/// Loads an uploaded GLB, or glTF JSON whose buffers and images are all `data:` URIs. `name` is for people only.
pub fn load_bytes(bytes: &[u8], name: &str, options: &LoadOptions) -> Result<Scene, SceneError> {
    let view = options.view.clone().unwrap_or_default();
    load(bytes, name, None, view, options, std::time::Instant::now())
}

fn load(
    bytes: &[u8],
    name: &str,
    directory: Option<Dir>,
    view: ViewFile,
    options: &LoadOptions,
    started: std::time::Instant,
) -> Result<Scene, SceneError> {
    let limits = &options.limits;
    let mut source = Source::new(bytes, directory, limits)?;
    let container = Container::split(bytes)?;
    within("JSON bytes", container.json.len() as u64, limits.max_json_bytes)?;
    let document = document::parse(container.json)?;
    let mut warnings = check_extensions(&document)?;
    let buffers = source::load_buffers(&document.buffers, &container, &mut source)?;
    let reader = Reader::new(&document, &buffers, limits);

    let mut wanted = image::TextureLoader::new();
    let materials = material::load_materials(&document, &mut wanted, limits)?;
    let textures = wanted.load(&reader, &mut source, limits)?;

    let instant = options.instant.as_ref().or(view.instant.as_ref());
    let posed = animation::sample(&reader, instant)?;
    let hierarchy = hierarchy::Hierarchy::walk(&document, &posed, limits)?;
    let inputs =
        assemble::Inputs { reader: &reader, hierarchy: &hierarchy, posed: &posed, materials: &materials, limits };
    let assembled = assemble::assemble(&inputs)?;
    warnings.extend(assembled.warnings);
    let origin = assembled.origin;
    let bounds = assembled.bounds.unwrap_or(Bounds { min: Vec3::splat(-0.5), max: Vec3::splat(0.5) });

    let emissive_triangles = emission::measure(&assembled.emitters, &assembled.geometry, &materials, &textures);
    let punctual_lights = light::punctual(&document, &hierarchy, origin, limits)?;
    let environment = options.environment.clone().or_else(|| view.environment.clone()).unwrap_or_default();
    let center: DVec3 = origin + bounds.center().as_dvec3();
    let mut cameras = view.cameras.clone();
    if cameras.is_empty() {
        cameras = light::cameras(&document, &hierarchy, center, &mut warnings)?;
    }
    if cameras.is_empty() {
        cameras.push(light::framing(&bounds, origin));
    }
    if warnings.len() > MAX_WARNINGS {
        let more = warnings.len() - MAX_WARNINGS;
        warnings.truncate(MAX_WARNINGS);
        warnings.push(format!("and {more} more"));
    }
    let mut scene = Scene {
        id: identity::scene_id(source.hasher, &view, instant, &environment),
        name: name.to_owned(),
        origin,
        bounds,
        geometry: assembled.geometry,
        materials,
        textures,
        emissive_triangles,
        punctual_lights,
        environment,
        view,
        cameras,
        node_names: assembled.node_names,
        summary: SceneSummary::default(),
        warnings,
        load_secs: (started.elapsed().as_secs_f64() - assembled.build_secs).max(0.0),
        build_secs: assembled.build_secs,
    };
    let has_animation = !document.animations.is_empty()
        || !document.skins.is_empty()
        || document.meshes.iter().flat_map(|mesh| &mesh.primitives).any(|primitive| !primitive.targets.is_empty());
    scene.summary = SceneSummary::of(&scene, has_animation);
    Ok(scene)
}

/// Refuses required extensions that are not known and lists optional ones.
fn check_extensions(document: &Document) -> Result<Vec<String>, SceneError> {
    let is_known = |name: &String| SUPPORTED.contains(&name.as_str());
    if let Some(name) = document.extensions_required.iter().find(|name| !is_known(name)) {
        return Err(SceneError::UnsupportedExtension { name: clip(name) });
    }
    let unknown = document.extensions_used.iter().filter(|name| !is_known(name)).take(MAX_WARNINGS);
    Ok(unknown.map(|name| format!("extension {} is not supported and ignored", clip(name))).collect())
}
