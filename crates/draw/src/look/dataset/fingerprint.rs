//! What tells whether a scene's data is still what it was when the scene was saved.

use crate::import::files_of;
use crate::model::ReadMethod;
use crate::store::known_disk;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// What tells one file from another without reading all of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fingerprint {
    /// Its length.
    pub bytes: u64,
    /// CRC-32C of its first and last [`SPAN`] bytes.
    pub crc32c: u32,
}

/// Bytes at either end that a fingerprint is made of.
pub const SPAN: u64 = 1 << 16;

impl Fingerprint {
    /// The fingerprint of a file; of a folder that of the names and lengths of the files that are read of it, none where nothing in it can be
    /// opened, which is told where it is.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn of(path: &Path) -> std::io::Result<Fingerprint> {
        if path.is_dir() {
            return Fingerprint::of_folder(path);
        }
        let file = known_disk(path, ReadMethod::default(), "file").map_err(std::io::Error::other)?;
        let bytes = file.size()?;
        let span = bytes.min(SPAN);
        let mut ends = vec![0; 2 * span as usize];
        let (first, last) = ends.split_at_mut(span as usize);
        file.read_exact_at(first, 0)?;
        file.read_exact_at(last, bytes - span)?;
        Ok(Fingerprint { bytes, crc32c: crc32c::crc32c(&ends) })
    }

    fn of_folder(path: &Path) -> std::io::Result<Fingerprint> {
        let mut files = Vec::new();
        for file in files_of(path).unwrap_or_default() {
            let bytes = std::fs::metadata(&file)?.len();
            files.push((file.strip_prefix(path).unwrap_or(&file).as_os_str().to_owned(), bytes));
        }
        files.sort();
        let bytes = files.iter().map(|(_, bytes)| bytes).sum();
        let crc32c = files.iter().fold(0, |crc, (name, bytes)| {
            crc32c::crc32c_append(crc32c::crc32c_append(crc, name.as_encoded_bytes()), &bytes.to_le_bytes())
        });
        Ok(Fingerprint { bytes, crc32c })
    }
}
