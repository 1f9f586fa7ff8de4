//! Names for files that the window writes without asking: beside the data, and never over another file.

use std::path::{Path, PathBuf};

/// Most characters of a name before its number and extension.
const LONGEST: usize = 80;

/// A file in the folder of `data`, or in the working folder where nothing can be written there, called like `stem` and under a name
/// that no file has: `stem.extension`, `stem-2.extension`, and so on. What does not belong in a name becomes a hyphen.
pub fn free_name(data: &Path, stem: &str, extension: &str) -> PathBuf {
    let folder = data.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let folder = if tempfile::tempfile_in(folder).is_ok() { folder.to_owned() } else { PathBuf::new() };
    let safe = |c: char| if c.is_alphanumeric() || "-_. ".contains(c) { c } else { '-' };
    let stem: String = stem.trim().trim_start_matches('.').chars().map(safe).take(LONGEST).collect();
    let numbered = |i: u32| match i {
        1 => folder.join(format!("{stem}.{extension}")),
        i => folder.join(format!("{stem}-{i}.{extension}")),
    };
    (1..u32::MAX).map(numbered).find(|path| !path.exists()).unwrap_or_else(|| numbered(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_free_and_safe() {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("snap.hdf5");
        let first = free_name(&data, "Core/hot", "csv");
        assert_eq!(first, folder.path().join("Core-hot.csv"));
        std::fs::write(&first, "").unwrap();
        assert_eq!(free_name(&data, "Core/hot", "csv"), folder.path().join("Core-hot-2.csv"));
        assert_eq!(free_name(&data, "../up", "parquet"), folder.path().join("-up.parquet"));
        assert_eq!(free_name(&data, "snap.099", "scene.ron"), folder.path().join("snap.099.scene.ron"));
    }
}
