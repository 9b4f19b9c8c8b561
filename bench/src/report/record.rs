//! What a study has measured, as JSON that a later run continues, and as CSV next to it.

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;
use surfelcast::Failure;

use crate::report::{Origin, Table, write_file};

/// One measurement of a study.
pub(crate) trait Measured: Serialize + DeserializeOwned {
    /// What was measured, apart from where: equal keys at one origin are measured once.
    type Key: PartialEq;

    fn key(&self) -> &Self::Key;

    fn origin(&self) -> &Origin;

    /// All measurements as one table.
    fn table(all: &[Self]) -> Table;
}

/// The measurements of an output folder.
#[derive(Debug)]
pub(crate) struct Record<T> {
    path: PathBuf,
    all: Vec<T>,
    /// Measurements of other commits and devices count as well.
    takes_any_origin: bool,
}

impl<T: Measured> Record<T> {
    /// Reads what an earlier run left; an empty record where there is none.
    pub(crate) fn open(path: &Path, takes_any_origin: bool) -> Result<Self, Failure> {
        let all = match std::fs::read(path) {
            Ok(bytes) => serde_json::from_slice(&bytes).map_err(|error| {
                Failure::input(format!(
                    "{}: not a record of this program ({error}); choose another --out, or remove it",
                    path.display()
                ))
            })?,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Vec::new(),
            Err(error) => return Err(Failure::input(format!("{}: {error}", path.display()))),
        };
        Ok(Self { path: path.to_owned(), all, takes_any_origin })
    }

    /// The newest measurement of that key.
    pub(crate) fn find(&self, key: &T::Key, origin: &Origin) -> Option<&T> {
        let counts = |one: &&T| one.key() == key && (self.takes_any_origin || one.origin() == origin);
        self.all.iter().rev().find(counts)
    }

    /// Adds a measurement and writes everything down.
    pub(crate) fn add(&mut self, one: T) -> Result<(), Failure> {
        self.all.push(one);
        let json = serde_json::to_vec_pretty(&self.all).map_err(|error| Failure::runtime(error.to_string()))?;
        write_file(&self.path, &json)?;
        write_file(&self.path.with_extension("csv"), &T::table(&self.all).csv()?)
    }

    /// The measurement of that key, made now unless it is recorded.
    pub(crate) fn find_or_measure(
        &mut self,
        key: &T::Key,
        origin: &Origin,
        measure: impl FnOnce() -> Result<T, Failure>,
    ) -> Result<&T, Failure> {
        if self.find(key, origin).is_none() {
            self.add(measure()?)?;
        }
        self.find(key, origin).ok_or_else(|| Failure::runtime("a measurement has another key than was requested"))
    }
}
