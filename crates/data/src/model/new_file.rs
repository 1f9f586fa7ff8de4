//! Files that are written under another name first: as readable as any other new file, not private as temporary files are.

use std::io::Write;
use std::path::Path;

/// How the names of files begin that are being written, or were when their program was killed.
pub const UNFINISHED: &str = ".deepfield-";

/// A builder of such files: the process's mask decides who may read them.
pub fn builder() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(UNFINISHED);
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder
}

/// What the system says of a file in the making, without the name that it would have had meanwhile: nobody has named that.
pub fn without_name(error: &std::io::Error) -> std::io::Error {
    let text = error.to_string();
    let said = text.split_once(" at path ").map_or(&*text, |(said, _)| said);
    std::io::Error::new(error.kind(), said)
}

/// Writes a file anew: whole under its name, or not at all.
///
/// # Errors
/// When the folder cannot be written.
pub fn write(path: &Path, text: &str) -> std::io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file = builder().tempfile_in(folder).map_err(|error| without_name(&error))?;
    file.write_all(text.as_bytes())?;
    file.as_file().sync_all()?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn new_files_are_as_readable_as_others() {
        let folder = tempfile::tempdir().unwrap();
        let plain = std::fs::File::create(folder.path().join("plain")).unwrap();
        let file = super::builder().tempfile_in(&folder).unwrap();
        let mode = |file: &std::fs::File| file.metadata().unwrap().permissions().mode();
        assert_eq!(mode(file.as_file()), mode(&plain));
        // Recordings know those of a killed program by their names.
        assert!(file.path().file_name().unwrap().to_string_lossy().starts_with(super::UNFINISHED));
    }
}
