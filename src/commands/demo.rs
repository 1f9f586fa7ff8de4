//! `deepfield` alone: the demo dataset, which is part of the program.

use super::{CommandResult, cache, view};
use std::io::Write;
use std::path::PathBuf;

/// The demo snapshot; see `assets/demo/README.md` for what it is.
const SNAPSHOT: &[u8] = include_bytes!("../../assets/demo/lcdm64_z0.hdf5");

/// Opens the demo dataset as `deepfield view` would.
///
/// # Errors
/// When the cache folder cannot be written or drawing fails.
pub fn run() -> CommandResult {
    view::show(
        &snapshot()?,
        &view::WindowArguments {
            picture: Some("deepfield-demo.png".into()),
            preset: "desktop".into(),
            ..Default::default()
        },
    )
}

/// The demo snapshot as a file in the cache folder, written on first use.
///
/// # Errors
/// When the folder cannot be written.
pub fn snapshot() -> Result<PathBuf, std::io::Error> {
    let folder = cache::folder("demo")?;
    let path = folder.join("lcdm64_z0.hdf5");
    if std::fs::metadata(&path).is_ok_and(|about| about.len() == SNAPSHOT.len() as u64) {
        return Ok(path);
    }
    let mut file = crate::model::new_file::builder().tempfile_in(&folder)?;
    file.write_all(SNAPSHOT)?;
    file.persist(&path).map_err(|error| error.error)?;
    Ok(path)
}
