//! What a file says: document, images, materials, meshes, clips. Nothing in here depends on an instant.

mod accessor;
pub(crate) mod check;
mod clip;
pub(crate) mod document;
mod identity;
mod image;
mod material;
mod mesh;
pub(crate) mod primitive;
mod source;
mod tree;
pub(crate) mod view;

use std::borrow::Cow;
use std::path::Path;

use cap_std::ambient_authority;
use cap_std::fs::Dir;

use crate::{Environment, Material, SceneError, SceneLimits, Texture, ViewFile};
use check::within;
use source::{Container, Source};

pub(crate) use accessor::Reader;
pub use clip::{AnimationRef, Instant};
pub(crate) use clip::{Clip, NodeOverride};
use document::Document;
pub use identity::SceneId;
pub(crate) use mesh::Part;
pub(crate) use tree::NodeTree;

/// How to read a scene.
#[derive(Clone, Debug, Default)]
pub struct LoadOptions {
    /// Limits on the contents of the file.
    pub limits: SceneLimits,
    /// Cameras, environment, exposure and instant. Where `None`, a file's `<stem>.json` is read.
    pub view: Option<ViewFile>,
    /// Instant of an animation; overrides the view file's.
    pub instant: Option<Instant>,
    /// Environment; overrides the view file's.
    pub environment: Option<Environment>,
    /// Which nodes stay movable.
    pub mobility: Mobility,
}

/// Which nodes stay movable after a scene is built: a rigid mesh at such a node becomes an instance, whose transform
/// alone says where it is, instead of being copied into scene space.
///
/// An instance costs every ray that comes near it a transform and a hierarchy of its own, so nodes stay movable only
/// where somebody moves them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mobility {
    /// None: a scene shown at one instant.
    #[default]
    Fixed,
    /// Nodes that an animation of the file moves, themselves or by an ancestor.
    Animated,
}

/// A validated file: decoded once, then shown in any number of states ([`crate::SceneState`], [`crate::Scene::build`]).
///
/// Images, materials and the meshes in use are decoded. Key frames, morph targets and skin weights are read from the
/// file's buffers when a state needs them, since most files hold more of them than are shown. The GLB's binary chunk is
/// borrowed from the bytes of the file.
#[derive(Debug)]
pub struct SceneAsset<'f> {
    /// Content hash.
    pub id: SceneId,
    /// File stem or the name given by the uploader; for people only.
    pub name: String,
    /// Cameras and exposure.
    pub view: ViewFile,
    /// What a ray that leaves the scene sees.
    pub environment: Environment,
    /// Instant at which the scene is shown unless another is chosen; `None` for the nodes' own transforms.
    pub instant: Option<Instant>,
    pub(crate) limits: SceneLimits,
    pub(crate) document: Document,
    buffers: Vec<Cow<'f, [u8]>>,
    pub(crate) tree: NodeTree,
    /// By node index: whether the node may move.
    pub(crate) may_move: Vec<bool>,
    pub(crate) materials: Vec<Material>,
    pub(crate) textures: Vec<Texture>,
    /// Meshes of nodes in the scene.
    pub(crate) meshes: mesh::Meshes,
    pub(crate) warnings: Vec<String>,
    pub(crate) load_secs: f64,
}

impl<'f> SceneAsset<'f> {
    /// Decodes an uploaded GLB, or glTF JSON whose buffers and images are all `data:` URIs. `name` is for people only.
    pub fn decode(bytes: &'f [u8], name: &str, options: &LoadOptions) -> Result<Self, SceneError> {
        Self::decode_beside(bytes, name, None, options.view.clone().unwrap_or_default(), options)
    }

    /// Decodes the bytes of the file at `path`. Buffers and images beside it are read from its folder only.
    pub(crate) fn decode_file(path: &Path, bytes: &'f [u8], options: &LoadOptions) -> Result<Self, SceneError> {
        let view = match &options.view {
            Some(view) => Some(view.clone()),
            None => ViewFile::read_beside(&path.with_extension("json"))?,
        };
        let folder = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let directory = Dir::open_ambient_dir(folder, ambient_authority())
            .map_err(|source| SceneError::Read { path: path.display().to_string(), source })?;
        let name = path.file_stem().map_or_else(|| "scene".to_owned(), |stem| stem.to_string_lossy().into_owned());
        Self::decode_beside(bytes, &name, Some(directory), view.unwrap_or_default(), options)
    }

    fn decode_beside(
        bytes: &'f [u8],
        name: &str,
        directory: Option<Dir>,
        view: ViewFile,
        options: &LoadOptions,
    ) -> Result<Self, SceneError> {
        let started = std::time::Instant::now();
        let limits = &options.limits;
        let mut source = Source::new(bytes, directory, limits)?;
        let container = Container::split(bytes)?;
        within("JSON bytes", container.json.len() as u64, limits.max_json_bytes)?;
        let document = document::parse(container.json)?;
        let mut warnings = document::check_extensions(&document)?;
        let buffers = source::load_buffers(&document.buffers, &container, &mut source)?;
        let reader = Reader::new(&document, &buffers, limits);

        let mut wanted = image::TextureLoader::new();
        let materials = material::load_materials(&document, &mut wanted, limits)?;
        let textures = wanted.load(&reader, &mut source, limits)?;
        let tree = NodeTree::walk(&document, limits)?;
        let may_move = match options.mobility {
            Mobility::Fixed => vec![false; document.nodes.len()],
            Mobility::Animated => tree.animated(&document),
        };
        let meshes = mesh::decode(&reader, &tree, &materials, limits, &mut warnings)?;

        let environment = options.environment.clone().or_else(|| view.environment.clone()).unwrap_or_default();
        let instant = options.instant.clone().or_else(|| view.instant.clone());
        Ok(Self {
            id: SceneId::of(source.hasher, &view, &environment),
            name: name.to_owned(),
            view,
            environment,
            instant,
            limits: *limits,
            document,
            buffers,
            tree,
            may_move,
            materials,
            textures,
            meshes,
            warnings,
            load_secs: started.elapsed().as_secs_f64(),
        })
    }

    /// Copies what is borrowed from the bytes of the file, so that the asset can outlive them.
    pub fn into_owned(self) -> SceneAsset<'static> {
        SceneAsset {
            buffers: self.buffers.into_iter().map(|buffer| Cow::Owned(buffer.into_owned())).collect(),
            id: self.id,
            name: self.name,
            view: self.view,
            environment: self.environment,
            instant: self.instant,
            limits: self.limits,
            document: self.document,
            tree: self.tree,
            may_move: self.may_move,
            materials: self.materials,
            textures: self.textures,
            meshes: self.meshes,
            warnings: self.warnings,
            load_secs: self.load_secs,
        }
    }

    /// A reader of the file's accessors with a full budget.
    pub(crate) fn reader(&self) -> Reader<'_> {
        Reader::new(&self.document, &self.buffers, &self.limits)
    }

    /// Whether the file has anything that moves: animations, skins or morph targets.
    pub(crate) fn has_animation(&self) -> bool {
        let mut primitives = self.document.meshes.iter().flat_map(|mesh| &mesh.primitives);
        !self.document.animations.is_empty()
            || !self.document.skins.is_empty()
            || primitives.any(|primitive| !primitive.targets.is_empty())
    }
}
