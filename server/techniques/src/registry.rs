//! Every technique, the default first. Command line, HTTP, client and benchmarks enumerate this list.

use crate::path;
use crate::surfel;
use crate::technique::TechniqueEntry;

/// All techniques.
pub const TECHNIQUES: &[TechniqueEntry] = &[path::ENTRY, surfel::ENTRY];

/// The technique of that id.
pub fn by_id(id: &str) -> Option<&'static TechniqueEntry> {
    TECHNIQUES.iter().find(|entry| entry.id == id)
}
