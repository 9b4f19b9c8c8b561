//! Uploaded scenes, kept by content in a folder.
//!
//! `<64 hex digits>.scene` holds the file as uploaded, `.json` next to it its record. The digits are those of the
//! scene's id, so no name from outside ever becomes a path. Files appear by rename, whole or not at all.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use parking_lot::Mutex;
use serde::{Deserialize, Serialize};
use tempfile::NamedTempFile;

use crate::error::StoreError;

/// Bytes of a stored record that are read at most.
const MAX_RECORD_BYTES: u64 = 1 << 20;

/// What is known of a scene without loading it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SceneRecord {
    /// `sha256:` and 64 hex digits over the content.
    pub id: String,
    /// Name for people.
    pub name: String,
    /// Triangles, instances not multiplied.
    pub triangle_count: u32,
    /// Camera names.
    pub cameras: Vec<String>,
    /// What was ignored or repaired at import.
    pub warnings: Vec<String>,
    /// Bytes of the file; 0 where none is stored.
    pub bytes: u64,
    /// When it was stored, seconds since 1970.
    pub stored_at_unix_secs: u64,
    /// View JSON that came with the file; part of what the id stands for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub view: Option<String>,
}

/// Bounds of a [`SceneFiles`].
#[derive(Clone, Copy, Debug)]
pub struct SceneBounds {
    /// Stored scenes.
    pub scenes: usize,
    /// Bytes of all stored scenes.
    pub bytes: u64,
}

/// The folder of stored scenes.
#[derive(Debug)]
pub struct SceneFiles {
    folder: PathBuf,
    bounds: SceneBounds,
    /// Bytes of each stored scene by id.
    stored: Mutex<BTreeMap<String, u64>>,
}

impl SceneFiles {
    /// Opens the folder, creating it when missing, and returns the records in it. Unreadable ones are skipped with a
    /// warning in the log.
    pub fn open(folder: impl Into<PathBuf>, bounds: SceneBounds) -> Result<(Self, Vec<SceneRecord>), StoreError> {
        let folder = folder.into();
        fs::create_dir_all(&folder)?;
        let mut records = Vec::new();
        for item in fs::read_dir(&folder)? {
            let path = item?.path();
            if path.extension().is_none_or(|extension| extension != "json") {
                continue;
            }
            match read_record(&path) {
                Ok(record) => records.push(record),
                Err(error) => tracing::warn!(path = %path.display(), %error, "stored scene skipped"),
            }
        }
        let stored = records.iter().map(|record| (record.id.clone(), record.bytes)).collect();
        Ok((Self { folder, bounds, stored: Mutex::new(stored) }, records))
    }

    /// An empty file for an upload, on the same file system as the store, so that a rename is enough to store it. It is
    /// deleted when dropped.
    pub fn new_upload(&self) -> Result<NamedTempFile, StoreError> {
        Ok(NamedTempFile::new_in(&self.folder)?)
    }

    /// Stores an uploaded file under the id of its record. Refuses when the store is full.
    pub fn insert(&self, file: NamedTempFile, record: &SceneRecord) -> Result<(), StoreError> {
        let path = self.path_of(&record.id, "scene")?;
        let record_path = self.path_of(&record.id, "json")?;
        let mut stored = self.stored.lock();
        let SceneBounds { scenes, bytes } = self.bounds;
        if stored.len() >= scenes || stored.values().sum::<u64>() + record.bytes > bytes {
            return Err(StoreError::Full { scenes, bytes });
        }
        // The record comes last: a scene without one is not listed, so a crash between the two lists nothing half
        // stored.
        file.persist(path).map_err(|error| error.error)?;
        write_record(&self.folder, &record_path, record)?;
        stored.insert(record.id.clone(), record.bytes);
        Ok(())
    }

    /// The bytes of a stored scene.
    pub fn read(&self, id: &str) -> Result<Vec<u8>, StoreError> {
        Ok(fs::read(self.path_of(id, "scene")?)?)
    }

    /// Deletes a stored scene.
    pub fn remove(&self, id: &str) -> Result<(), StoreError> {
        let (path, record_path) = (self.path_of(id, "scene")?, self.path_of(id, "json")?);
        let mut stored = self.stored.lock();
        if !stored.contains_key(id) {
            return Err(StoreError::Missing);
        }
        fs::remove_file(record_path)?;
        if let Err(error) = fs::remove_file(path) {
            tracing::warn!(%error, "a deleted scene's file remains");
        }
        stored.remove(id);
        Ok(())
    }

    fn path_of(&self, id: &str, extension: &str) -> Result<PathBuf, StoreError> {
        let hex = hex_digits(id).ok_or(StoreError::Missing)?;
        Ok(self.folder.join(format!("{hex}.{extension}")))
    }
}

/// The 64 lower-case hex digits of `sha256:...`.
fn hex_digits(id: &str) -> Option<&str> {
    let hex = id.strip_prefix("sha256:")?;
    let is_digit = |b: u8| b.is_ascii_digit() || (b'a'..=b'f').contains(&b);
    (hex.len() == 64 && hex.bytes().all(is_digit)).then_some(hex)
}

fn read_record(path: &Path) -> io::Result<SceneRecord> {
    if fs::metadata(path)?.len() > MAX_RECORD_BYTES {
        return Err(io::Error::other("description is too long"));
    }
    let record: SceneRecord = serde_json::from_slice(&fs::read(path)?)?;
    let stem = path.file_stem().and_then(|stem| stem.to_str());
    if hex_digits(&record.id).is_none() || hex_digits(&record.id) != stem {
        return Err(io::Error::other("description and file name disagree"));
    }
    if !path.with_extension("scene").is_file() {
        return Err(io::Error::other("the scene's file is missing"));
    }
    Ok(record)
}

fn write_record(folder: &Path, path: &Path, record: &SceneRecord) -> io::Result<()> {
    let mut file = NamedTempFile::new_in(folder)?;
    serde_json::to_writer_pretty(&mut file, record)?;
    file.as_file().sync_all()?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    const BOUNDS: SceneBounds = SceneBounds { scenes: 2, bytes: 100 };

    fn record(digit: &str, bytes: u64) -> SceneRecord {
        SceneRecord {
            id: format!("sha256:{}", digit.repeat(64)),
            name: "scene".into(),
            triangle_count: 1,
            cameras: vec!["front".into()],
            warnings: Vec::new(),
            bytes,
            stored_at_unix_secs: 7,
            view: None,
        }
    }

    fn insert(files: &SceneFiles, record: &SceneRecord, content: &[u8]) -> Result<(), StoreError> {
        let mut upload = files.new_upload().expect("a file");
        upload.write_all(content).expect("writes");
        files.insert(upload, record)
    }

    #[test]
    fn only_digests_become_paths() {
        assert!(hex_digits(&format!("sha256:{}", "a1".repeat(32))).is_some());
        for id in ["", "sha256:", "sha256:../../etc/passwd", &format!("sha256:{}", "A1".repeat(32)), &"a1".repeat(32)] {
            assert_eq!(hex_digits(id), None, "{id}");
        }
    }

    #[test]
    fn scenes_outlive_the_process_and_can_be_deleted() {
        let folder = tempfile::tempdir().expect("a folder");
        let (files, records) = SceneFiles::open(folder.path().join("scenes"), BOUNDS).expect("opens");
        assert_eq!(records, []);
        let (a, b) = (record("a", 3), record("b", 4));
        insert(&files, &a, b"abc").expect("stores");
        insert(&files, &b, b"defg").expect("stores");
        let scenes = folder.path().join("scenes");
        fs::write(scenes.join(format!("{}.json", "c".repeat(64))), "{").expect("writes");
        fs::write(scenes.join(format!("{}.json", "d".repeat(64))), serde_json::to_vec(&a).expect("JSON"))
            .expect("writes");
        let (files, mut records) = SceneFiles::open(&scenes, BOUNDS).expect("opens");
        records.sort_by(|x, y| x.id.cmp(&y.id));
        assert_eq!(records, [a.clone(), b], "damaged and misnamed records are skipped");
        assert_eq!(files.read(&a.id).expect("reads"), b"abc");
        files.remove(&a.id).expect("removes");
        assert!(matches!(files.remove(&a.id), Err(StoreError::Missing)));
        assert_eq!(SceneFiles::open(&scenes, BOUNDS).expect("opens").1.len(), 1);
    }

    #[test]
    fn a_full_store_refuses_and_keeps_nothing() {
        let folder = tempfile::tempdir().expect("a folder");
        let (files, _) = SceneFiles::open(folder.path(), BOUNDS).expect("opens");
        assert!(matches!(insert(&files, &record("a", 101), b"x"), Err(StoreError::Full { scenes: 2, bytes: 100 })));
        assert_eq!(fs::read_dir(folder.path()).expect("reads").count(), 0);
        insert(&files, &record("a", 50), b"x").expect("stores");
        insert(&files, &record("b", 50), b"y").expect("stores");
        assert!(matches!(insert(&files, &record("c", 0), b"z"), Err(StoreError::Full { .. })));
        files.remove(&record("a", 0).id).expect("removes");
        insert(&files, &record("c", 1), b"z").expect("stores");
    }
}
