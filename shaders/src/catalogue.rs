//! Every shader file, embedded into the binary, and the list of kernels among them.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::OnceLock;

use rust_embed::RustEmbed;

#[derive(RustEmbed)]
#[folder = "lib/"]
#[prefix = "lib/"]
struct LibraryFiles;

#[derive(RustEmbed)]
#[folder = "techniques/"]
#[prefix = "techniques/"]
struct TechniqueFiles;

/// One shader file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Module {
    /// Path under the shader root, such as `lib/core/rng.wesl`.
    pub file: String,
    /// Path as imports spell it after `package::`, such as `lib::core::rng`.
    pub path: String,
    /// Text.
    pub text: String,
}

/// One kernel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KernelInfo {
    /// File stem, entry point (or its beginning, for raster kernels), pass label and timer name in one. Unique.
    pub name: String,
    /// Path under the shader root.
    pub file: String,
    /// Path as imports spell it after `package::`.
    pub path: String,
}

struct Catalogue {
    /// By path.
    modules: BTreeMap<String, Module>,
    /// Sorted by name.
    kernels: Vec<KernelInfo>,
}

fn catalogue() -> &'static Catalogue {
    static CATALOGUE: OnceLock<Catalogue> = OnceLock::new();
    CATALOGUE.get_or_init(|| {
        if let Some(folder) = std::env::var_os("SURFELCAST_SHADERS").filter(|folder| !folder.is_empty()) {
            return build(files_in(Path::new(&folder)).into_iter());
        }
        let library = LibraryFiles::iter().map(|file| (LibraryFiles::get(&file), file));
        let techniques = TechniqueFiles::iter().map(|file| (TechniqueFiles::get(&file), file));
        let files = library.chain(techniques).filter_map(|(content, file)| {
            let text = String::from_utf8_lossy(&content?.data).into_owned();
            Some((file.into_owned(), text))
        });
        build(files)
    })
}

/// Shader files of a folder on disk, in place of the embedded ones, so that an edit of a kernel needs no compilation.
fn files_in(root: &Path) -> Vec<(String, String)> {
    let mut found = Vec::new();
    let mut folders = vec![root.join("lib"), root.join("techniques")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if let (Ok(relative), Ok(text)) = (path.strip_prefix(root), std::fs::read_to_string(&path)) {
                found.push((relative.to_string_lossy().replace('\\', "/"), text));
            }
        }
    }
    found
}

fn build(files: impl Iterator<Item = (String, String)>) -> Catalogue {
    let mut modules = BTreeMap::new();
    let mut kernels = Vec::new();
    for (file, text) in files {
        let Some(stem) = file.strip_suffix(".wesl") else { continue };
        let path = stem.replace('/', "::");
        if is_kernel(&file) {
            let name = stem.rsplit('/').next().unwrap_or(stem).to_owned();
            kernels.push(KernelInfo { name, file: file.clone(), path: path.clone() });
        }
        modules.insert(path.clone(), Module { file, path, text });
    }
    kernels.sort_by(|a, b| a.name.cmp(&b.name));
    Catalogue { modules, kernels }
}

/// Kernels are in the folder `kernels` of a technique; the other files are what they import.
fn is_kernel(file: &str) -> bool {
    file.strip_prefix("techniques/").and_then(|file| file.split('/').nth(1)) == Some("kernels")
}

/// All kernels, sorted by name.
pub fn kernels() -> &'static [KernelInfo] {
    &catalogue().kernels
}

/// All shader files, sorted by path.
pub fn modules() -> impl Iterator<Item = &'static Module> {
    catalogue().modules.values()
}

pub(crate) fn module(path: &str) -> Option<&'static Module> {
    catalogue().modules.get(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_in_a_folder_of_kernels_under_techniques_are_kernels() {
        let files = [
            ("lib/core/rng.wesl", "fn next() {}"),
            ("lib/kernels/trap.wesl", "@compute fn no() {}"),
            ("techniques/path/kernels/path_trace.wesl", "@compute @workgroup_size(64) fn path_trace() {}"),
            ("techniques/path/kernels/more/path_more.wesl", "@compute @workgroup_size(64) fn path_more() {}"),
            ("techniques/path/helper.wesl", "fn helper() {}"),
            ("techniques/path/kernels/README.md", "@compute"),
        ];
        let built = build(files.into_iter().map(|(file, text)| (file.to_owned(), text.to_owned())));
        let names: Vec<&str> = built.kernels.iter().map(|kernel| kernel.name.as_str()).collect();
        assert_eq!(names, ["path_more", "path_trace"]);
        assert_eq!(built.kernels[1].path, "techniques::path::kernels::path_trace");
        assert_eq!(built.modules.len(), 5);
    }
}
