//! From a kernel and a set of features to plain WGSL, by the WESL crate.

use std::borrow::Cow;

use sha2::{Digest, Sha256};
use wesl::syntax::PathOrigin;
use wesl::{CompileOptions, Feature as Condition, Features as Conditions, ModulePath, ResolveError, Resolver, Wesl};

use crate::catalogue::{self, KernelInfo};
use crate::mangle::{self, PathMangler};
use crate::reflect::{self, Reflection};
use crate::{Features, constants};

/// Why a kernel could not be linked.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LinkError {
    /// No file of that name.
    #[error("no kernel is called `{kernel}`; there are: {known}")]
    UnknownKernel {
        /// Requested name.
        kernel: String,
        /// All names.
        known: String,
    },
    /// The modules do not go together: syntax, an unknown import, an unknown condition.
    #[error("kernel `{kernel}` [{features}] does not link:\n{message}")]
    Link {
        /// Kernel.
        kernel: String,
        /// Variant.
        features: Features,
        /// With file and line.
        message: String,
    },
    /// The linked text is not valid WGSL.
    #[error("kernel `{kernel}` [{features}] is invalid in {origin}:\n{message}")]
    Invalid {
        /// Kernel.
        kernel: String,
        /// Variant.
        features: Features,
        /// File and function the error came from.
        origin: String,
        /// With the line of the linked text.
        message: String,
    },
}

/// A kernel as plain WGSL.
#[derive(Debug, Clone)]
pub struct LinkedKernel {
    /// Name of kernel, file and entry point.
    pub name: String,
    /// Text.
    pub wgsl: String,
    /// What it binds.
    pub reflection: Reflection,
    /// SHA-256 of the text: variants that link to the same text are the same kernel.
    pub hash: [u8; 32],
}

/// Links `kernel` with `features`. Reports unknown names, syntax and type errors with their file; full validation is
/// left to [`validate`], and to the driver when the pipeline is created.
pub fn link(kernel: &str, features: Features) -> Result<LinkedKernel, LinkError> {
    let kernels = catalogue::kernels();
    let Some(info) = kernels.iter().find(|info| info.name == kernel) else {
        let known: Vec<&str> = kernels.iter().map(|info| info.name.as_str()).collect();
        return Err(LinkError::UnknownKernel { kernel: kernel.to_owned(), known: known.join(", ") });
    };
    link_root(info, None, features)
}

/// Links WESL text that is not in the catalogue: tests and tools. It may import from `package::lib`.
pub fn link_source(kernel: &str, text: &str, features: Features) -> Result<LinkedKernel, LinkError> {
    let file = format!("{kernel}.wesl");
    let info = KernelInfo { name: kernel.to_owned(), file, path: kernel.to_owned() };
    link_root(&info, Some(text), features)
}

fn link_root(info: &KernelInfo, text: Option<&str>, features: Features) -> Result<LinkedKernel, LinkError> {
    let kernel = info.name.clone();
    let resolver = Sources { root: text.map(|text| (info, text)), constants: constants::module_text() };
    let mut compiler = Wesl::new_barebones().set_custom_resolver(resolver);
    let on = features.conditions().map(|condition| (condition, Condition::Enable));
    let off = features.complement().conditions().map(|condition| (condition, Condition::Disable));
    // An unknown condition is a typing error, not a switch that is off.
    let features_of_wesl = Conditions { default: Condition::Error, flags: on.chain(off).collect() };
    compiler.set_options(CompileOptions { features: features_of_wesl, ..CompileOptions::default() });
    compiler.use_sourcemap(true);
    compiler.set_custom_mangler(PathMangler);

    let compiled = compiler.compile(&module_path(&info.path)).map_err(|error| LinkError::Link {
        kernel: kernel.clone(),
        features,
        message: error.to_string(),
    })?;
    let wgsl = compiled.to_string();
    let invalid =
        |origin: String, message: String| LinkError::Invalid { kernel: kernel.clone(), features, origin, message };
    let module = naga::front::wgsl::parse_str(&wgsl).map_err(|error| {
        let offset = error.location(&wgsl).map(|location| location.offset as usize);
        invalid(origin_of(&wgsl, offset, info, text), error.emit_to_string_with_path(&wgsl, "linked text"))
    })?;
    let reflection = reflect::reflect(&module, &kernel).map_err(|problem| invalid(info.file.clone(), problem))?;
    let hash = Sha256::digest(wgsl.as_bytes()).into();
    Ok(LinkedKernel { name: kernel, wgsl, reflection, hash })
}

/// Runs naga's full validator over a linked kernel with `capabilities`.
pub fn validate(
    linked: &LinkedKernel,
    features: Features,
    capabilities: naga::valid::Capabilities,
) -> Result<(), LinkError> {
    let info = catalogue::kernels().iter().find(|info| info.name == linked.name);
    let fallback =
        KernelInfo { name: linked.name.clone(), file: format!("{}.wesl", linked.name), path: linked.name.clone() };
    let info = info.unwrap_or(&fallback);
    let invalid = |offset: Option<usize>, message: String| LinkError::Invalid {
        kernel: linked.name.clone(),
        features,
        origin: origin_of(&linked.wgsl, offset, info, None),
        message,
    };
    let module = naga::front::wgsl::parse_str(&linked.wgsl)
        .map_err(|error| invalid(None, error.emit_to_string_with_path(&linked.wgsl, "linked text")))?;
    let mut validator = naga::valid::Validator::new(naga::valid::ValidationFlags::all(), capabilities);
    validator.subgroup_stages(naga::valid::ShaderStages::COMPUTE);
    validator.subgroup_operations(naga::valid::SubgroupOperationSet::all());
    match validator.validate(&module) {
        Ok(_) => Ok(()),
        Err(error) => {
            // The last span is the innermost one.
            let offset = error.spans().last().and_then(|(span, _)| span.to_range()).map(|range| range.start);
            Err(invalid(offset, error.emit_to_string_with_path(&linked.wgsl, "linked text")))
        }
    }
}

/// The file and line of the declaration around `offset` of the linked text.
fn origin_of(wgsl: &str, offset: Option<usize>, root: &KernelInfo, root_text: Option<&str>) -> String {
    let before = offset.and_then(|offset| wgsl.get(..offset)).unwrap_or("");
    let line = wgsl.get(before.rfind('\n').map_or(0, |at| at + 1)..).and_then(|rest| rest.lines().next());
    let declared = line.into_iter().chain(before.lines().rev()).find_map(declared_name);
    let Some(mangled) = declared else { return root.file.clone() };
    let (path, name) = mangle::split(mangled);
    let (file, text) = match path {
        None => (root.file.as_str(), root_text.or_else(|| catalogue::module(&root.path).map(|m| m.text.as_str()))),
        Some(path) => {
            let Some(module) = catalogue::modules().find(|module| module.path.replace("::", "_") == path) else {
                return format!("`{name}`");
            };
            (module.file.as_str(), Some(module.text.as_str()))
        }
    };
    let position = text.and_then(|text| text.lines().position(|line| declared_name(line) == Some(name)));
    match position {
        Some(index) => format!("{file}:{}, `{name}`", index + 1),
        None => format!("{file}, `{name}`"),
    }
}

/// The name a line declares, if it opens a declaration at module level.
fn declared_name(line: &str) -> Option<&str> {
    if line.starts_with(char::is_whitespace) {
        return None;
    }
    let words = line.split(|c: char| !(c.is_alphanumeric() || c == '_')).filter(|word| !word.is_empty());
    let mut words = words.skip_while(|word| !matches!(*word, "fn" | "struct" | "const" | "var" | "override" | "alias"));
    match words.next()? {
        "var" => {
            words.find(|word| !matches!(*word, "storage" | "uniform" | "private" | "workgroup" | "read" | "read_write"))
        }
        _ => words.next(),
    }
}

fn module_path(path: &str) -> ModulePath {
    ModulePath::new(PathOrigin::Absolute, path.split("::").map(str::to_owned).collect())
}

/// Sources of modules: the embedded files, the constants, and an optional root given as text.
struct Sources<'a> {
    root: Option<(&'a KernelInfo, &'a str)>,
    constants: String,
}

impl Resolver for Sources<'_> {
    fn resolve_source<'b>(&'b self, path: &ModulePath) -> Result<Cow<'b, str>, ResolveError> {
        let key = path.components.join("::");
        if path.origin == PathOrigin::Absolute {
            if key == "constants" {
                return Ok(Cow::Borrowed(&self.constants));
            }
            if let Some((_, text)) = self.root.filter(|(info, _)| info.path == key) {
                return Ok(Cow::Borrowed(text));
            }
            if let Some(module) = catalogue::module(&key) {
                return Ok(Cow::Borrowed(&module.text));
            }
        }
        let message = "no such shader file; imports start with package::lib::, package::techniques:: or \
                       package::constants"
            .to_owned();
        Err(ResolveError::ModuleNotFound(path.clone(), message))
    }

    fn display_name(&self, path: &ModulePath) -> Option<String> {
        let key = path.components.join("::");
        match self.root.filter(|(info, _)| info.path == key) {
            Some((info, _)) => Some(info.file.clone()),
            None => catalogue::module(&key).map(|module| module.file.clone()),
        }
    }
}
