//! Files of the repository and of the reference data, and page files that many tests begin with.

use deepfield::look::HeightsSaid;
use deepfield::look::page_cache::{cached_name, page_file};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

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

/// The bytes of a page file, made by whichever test of this program first asks for it, since each is a process of its own. A program that was
/// compiled again makes its own.
pub fn kept_page_file(name: &str, make: impl FnOnce(&Path)) -> Vec<u8> {
    let program = std::env::current_exe().unwrap();
    let compiled = program.metadata().unwrap().modified().unwrap().duration_since(UNIX_EPOCH).unwrap();
    let program = format!("{}-", program.file_stem().unwrap().to_str().unwrap());
    let own = format!("{program}{}-", compiled.as_nanos());
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let path = folder.join(format!("{own}{name}.df"));
    if !path.exists() {
        for entry in std::fs::read_dir(folder).unwrap().map(Result::unwrap) {
            let other = entry.file_name().into_string().unwrap();
            if other.starts_with(&program) && !other.starts_with(&own) {
                // Another test may have been quicker.
                let _ = std::fs::remove_file(entry.path());
            }
        }
        let making = tempfile::tempdir_in(folder).unwrap();
        let made = making.path().join("made.df");
        make(&made);
        std::fs::rename(made, &path).unwrap();
    }
    std::fs::read(path).unwrap()
}

/// Puts the page file that the program makes of the demo snapshot where it looks for it when `folder` is the user's cache: it is built once, not
/// by each test that opens the snapshot. Where it lies then.
pub fn keep_demo_pages(folder: &Path) -> PathBuf {
    let pages = folder.join("deepfield").join("pages");
    let name = cached_name(&demo()).unwrap();
    let path = pages.join(&name);
    if path.exists() {
        return path;
    }
    let kept = kept_page_file(&name, |path| {
        let making = tempfile::tempdir().unwrap();
        let (made, _) = page_file(&demo(), &HeightsSaid::default(), None, || Ok(making.path().into()), &()).unwrap();
        std::fs::copy(made, path).unwrap();
    });
    std::fs::create_dir_all(&pages).unwrap();
    std::fs::write(&path, kept).unwrap();
    path
}

/// Bytes in gzip.
pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}
