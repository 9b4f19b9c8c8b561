//! Names of linked declarations: `module_path__name`, which is readable and can be undone. A double underscore is
//! therefore not allowed in a name of our own.

use wesl::{Mangler, ModulePath};

const SEPARATOR: &str = "__";

/// Prefixes the name of a declaration with the path of its module.
pub(crate) struct PathMangler;

impl Mangler for PathMangler {
    fn mangle(&self, path: &ModulePath, item: &str) -> String {
        format!("{}{SEPARATOR}{item}", path.components.join("_"))
    }
}

/// The module, if the name has one, and the name in it.
pub(crate) fn split(mangled: &str) -> (Option<&str>, &str) {
    match mangled.split_once(SEPARATOR) {
        Some((path, name)) => (Some(path), name),
        None => (None, mangled),
    }
}

/// The name without its module.
pub(crate) fn unmangle(mangled: &str) -> &str {
    split(mangled).1
}
