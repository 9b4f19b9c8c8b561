//! Every technique, the default of views first. Command line, HTTP, client and benchmarks enumerate this list.

use crate::gradient;
use crate::path;
use crate::surfel;
use crate::technique::TechniqueEntry;

/// All techniques.
pub const TECHNIQUES: &[TechniqueEntry] = &[surfel::ENTRY, path::ENTRY, gradient::ENTRY, gradient::ENTRY_L1];

/// The technique of pictures that are asked for one at a time: it keeps any promise about its error.
pub const DEFAULT_OF_JOBS: &str = path::ENTRY.id;

/// The technique of that id.
pub fn by_id(id: &str) -> Option<&'static TechniqueEntry> {
    TECHNIQUES.iter().find(|entry| entry.id == id)
}
