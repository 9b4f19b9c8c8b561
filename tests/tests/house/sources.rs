//! The files of the project that people write.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};

/// Folders whose files are generated or downloaded.
const SKIPPED_FOLDERS: &[&str] = &[".git", "target", "node_modules", "data"];

pub(crate) const CODE: &[&str] = &["rs", "wesl", "wgsl", "js", "css", "html", "sh"];
const TEXT: &[&str] = &["md", "toml", "json", "yml", "yaml", "service"];

pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the tests folder lies in the workspace")
}

/// One file of the project.
pub(crate) struct Source {
    /// Path from the root, with forward slashes.
    pub(crate) path: String,
    pub(crate) text: String,
}

impl Source {
    pub(crate) fn is(&self, extensions: &[&str]) -> bool {
        self.path.rsplit_once('.').is_some_and(|(_, extension)| extensions.contains(&extension))
    }
}

/// All code and text, sorted by path.
pub(crate) fn sources() -> Result<Vec<Source>> {
    fn walk(folder: &Path, found: &mut Vec<PathBuf>) -> Result<()> {
        for entry in fs::read_dir(folder)? {
            let entry = entry?;
            let name = entry.file_name();
            let kind = entry.file_type()?;
            if kind.is_dir() && !SKIPPED_FOLDERS.iter().any(|skipped| name == *skipped) {
                walk(&entry.path(), found)?;
            } else if kind.is_file() {
                found.push(entry.path());
            }
        }
        Ok(())
    }
    let mut found = Vec::new();
    walk(root(), &mut found)?;
    found.sort();
    let mut sources = Vec::new();
    for file in found {
        let path = file.strip_prefix(root())?.to_string_lossy().replace('\\', "/");
        let extension = file.extension().unwrap_or_default().to_string_lossy().into_owned();
        let is_text = CODE.contains(&extension.as_str()) || TEXT.contains(&extension.as_str()) || path == "Makefile";
        if is_text && !path.ends_with("package-lock.json") {
            let text = fs::read_to_string(&file).with_context(|| format!("{path} is not UTF-8"))?;
            sources.push(Source { path, text });
        }
    }
    ensure!(sources.len() > 30, "only {} files seen: the test looks in the wrong place", sources.len());
    Ok(sources)
}
