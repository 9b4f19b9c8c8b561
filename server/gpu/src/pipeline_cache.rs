//! Compiled pipelines on disk, so that a restart does not compile them again.
//!
//! File: a magic line with the format's version, the SHA-256 of the rest, the driver's data. One file per adapter and
//! driver version. A file that is damaged, foreign or too large is ignored and replaced.

use std::fs;
use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

const MAGIC: &[u8; 16] = b"surfelcast-pso1\n";
const HASH_BYTES: usize = 32;
/// Larger files were not written here.
const MAX_BYTES: u64 = 256 << 20;

/// Where the pipelines of an adapter and driver are kept.
pub(crate) fn file_path(directory: &Path, info: &wgpu::AdapterInfo) -> PathBuf {
    let key = format!("{}|{}|{}|{}", info.name, info.driver, info.driver_info, info.backend);
    let digest = Sha256::digest(key.as_bytes());
    let short = digest.iter().take(8).fold(0_u64, |hash, &byte| hash << 8 | u64::from(byte));
    directory.join(format!("pipelines-v1-{:04x}-{:04x}-{short:016x}.bin", info.vendor, info.device))
}

/// The driver's data, if the file is complete.
pub(crate) fn load(path: &Path) -> Option<Vec<u8>> {
    let file = fs::File::open(path).ok()?;
    let mut bytes = Vec::new();
    file.take(MAX_BYTES + 1).read_to_end(&mut bytes).ok()?;
    let data = check(&bytes);
    if data.is_none() {
        tracing::warn!(target: "surfelcast::gpu", path = %path.display(), "ignoring a damaged pipeline cache");
    }
    data.map(<[u8]>::to_vec)
}

fn check(bytes: &[u8]) -> Option<&[u8]> {
    if bytes.len() as u64 > MAX_BYTES {
        return None;
    }
    let rest = bytes.strip_prefix(MAGIC)?;
    let (hash, data) = rest.split_at_checked(HASH_BYTES)?;
    (Sha256::digest(data).as_slice() == hash).then_some(data)
}

/// Writes to a temporary file and renames it, so that a reader never sees an incomplete one. Failing is no error: the
/// cache only saves time.
pub(crate) fn store(path: &Path, data: &[u8]) {
    let result = (|| {
        let directory = path.parent().unwrap_or(Path::new("."));
        fs::create_dir_all(directory)?;
        let temporary = path.with_extension(format!("{}.tmp", std::process::id()));
        let mut file = fs::File::create(&temporary)?;
        file.write_all(MAGIC)?;
        file.write_all(&Sha256::digest(data))?;
        file.write_all(data)?;
        drop(file);
        fs::rename(&temporary, path).inspect_err(|_| drop(fs::remove_file(&temporary)))
    })();
    if let Err(error) = result {
        tracing::warn!(target: "surfelcast::gpu", path = %path.display(), %error, "the pipeline cache was not saved");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_damaged_file_is_ignored() {
        let directory = tempfile::tempdir().expect("a temporary folder");
        let path = directory.path().join("deep").join("cache.bin");
        assert_eq!(load(&path), None);
        store(&path, b"compiled");
        assert_eq!(load(&path).as_deref(), Some(b"compiled".as_slice()));
        let mut bytes = fs::read(&path).expect("read");
        let last = bytes.len() - 1;
        bytes[last] ^= 1;
        fs::write(&path, &bytes).expect("write");
        assert_eq!(load(&path), None);
        fs::write(&path, b"short").expect("write");
        assert_eq!(load(&path), None);
    }
}
