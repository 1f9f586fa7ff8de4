//! Files of the repository and of the reference data.

use std::path::{Path, PathBuf};

/// A file of the repository.
pub fn in_repository(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

/// A file of the reference data.
pub fn in_reference_data(name: &str) -> PathBuf {
    let folder = std::env::var_os("DEEPFIELD_DATA").map_or_else(|| in_repository("../shared/data"), PathBuf::from);
    folder.join(name)
}

/// The demo snapshot.
pub fn demo() -> PathBuf {
    in_repository("assets/demo/lcdm64_z0.hdf5")
}
