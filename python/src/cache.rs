//! Page files of sources that were opened directly: in the folder where the program has its own, under the names that it gives them, so
//! that each finds what the other has built. The folder has a budget, and what was opened longest ago goes first.

use crate::error::Failure;
use deepfield_draw::build::{BuildOptions, FEW_PARTICLES, build_source};
use deepfield_draw::hierarchy::Kinds;
use deepfield_draw::hierarchy::kind::{OCTREE, PCA};
use deepfield_draw::import::{LoadOptions, file_of_step};
use deepfield_draw::look::DataKind;
use deepfield_draw::model::Progress;
use deepfield_draw::store::PageFile;
use deepfield_draw::store::layout::VERSION;
use deepfield_draw::store::temporary::free_bytes;
use etcetera::BaseStrategy;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Particles from which on page files have clusters, too, as those of the program have.
const CLUSTERS_FROM: u64 = 1_000_000;

/// What the folder may hold: this, or a fifth of what it has and the disk has left, if that is less.
const MOST_BYTES: u64 = 50_000_000_000;

/// The page file of particles at `path`: itself if it is one or a run of them, else one in the cache, built first unless it is there already.
///
/// # Errors
/// When the source cannot be read or the page file not be written.
pub fn page_file(path: &Path, progress: &dyn Progress) -> Result<PathBuf, Failure> {
    if DataKind::of(path)? != DataKind::Source {
        return Ok(path.to_owned());
    }
    let folder = etcetera::choose_base_strategy()?.cache_dir().join("deepfield").join("pages");
    std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let cached = folder.join(name_of(path)?);
    if PageFile::open(&cached).is_ok() {
        mark_as_used(&cached);
        return Ok(cached);
    }
    let options = BuildOptions {
        hierarchies: Kinds::of([&OCTREE, &PCA]),
        clusters_from: CLUSTERS_FROM,
        exact_below: FEW_PARTICLES,
        ..BuildOptions::default()
    };
    build_source(path, &LoadOptions::default(), &options, &cached, progress)?;
    make_room(&folder, &cached);
    Ok(cached)
}

/// A file name that changes when the source's path, length or time of change does, or what is built of it.
fn name_of(path: &Path) -> Result<String, Failure> {
    let file = file_of_step(path);
    // What names a step in the file, if anything does.
    let step = path.as_os_str().as_encoded_bytes()[file.as_os_str().len()..].to_vec();
    let name = |error: std::io::Error| format!("{}: {error}", path.display());
    let path = std::fs::canonicalize(file).map_err(name)?;
    let about = std::fs::metadata(&path)?;
    let changed = about.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
    let mut hasher = DefaultHasher::new();
    (&path, step, about.len(), changed, VERSION, CLUSTERS_FROM).hash(&mut hasher);
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    Ok(format!("{stem}-{:016x}.df", hasher.finish()))
}

/// Notes that a page file was used. Nothing depends on whether that works but the order of removal.
fn mark_as_used(file: &Path) {
    if let Ok(file) = std::fs::File::options().append(true).open(file) {
        let _ = file.set_modified(SystemTime::now());
    }
}

/// Removes finished page files that were used longest ago until the folder keeps to its budget; never `made`. A folder that cannot be read
/// stays as it is: the next who builds sees to it.
fn make_room(folder: &Path, made: &Path) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let mut files: Vec<(SystemTime, PathBuf, u64)> = Vec::new();
    for entry in entries.flatten() {
        let path = entry.path();
        // Another program may be removing files too.
        if let Ok(about) = entry.metadata()
            && about.is_file()
            && path.extension().is_some_and(|extension| extension == "df")
        {
            files.push((about.modified().unwrap_or(UNIX_EPOCH), path, about.len()));
        }
    }
    files.sort();
    let mut held: u64 = files.iter().map(|(_, _, bytes)| bytes).sum();
    let stated = std::env::var("DEEPFIELD_CACHE").ok().and_then(|text| stated_bytes(&text));
    let usual = || free_bytes(folder).map_or(MOST_BYTES, |free| (free.saturating_add(held) / 5).min(MOST_BYTES));
    let budget = stated.unwrap_or_else(usual);
    for (_, path, bytes) in files.iter().filter(|(_, path, _)| path != made) {
        if held <= budget {
            break;
        }
        if std::fs::remove_file(path).is_ok() {
            held -= bytes;
        }
    }
}

/// An amount of memory such as `20GB` or `1.5TiB`, bytes.
fn stated_bytes(text: &str) -> Option<u64> {
    let digits = text.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(text.len());
    let (number, unit) = text.split_at(digits);
    let factor = match unit.trim() {
        "" | "B" => 1.0,
        "kB" | "KB" => 1e3,
        "MB" => 1e6,
        "GB" => 1e9,
        "TB" => 1e12,
        "KiB" => 1024.0,
        "MiB" | "M" => 1024f64.powi(2),
        "GiB" | "G" => 1024f64.powi(3),
        "TiB" | "T" => 1024f64.powi(4),
        _ => return None,
    };
    let bytes = number.trim().parse::<f64>().ok()? * factor;
    (1.0..2f64.powi(63)).contains(&bytes).then_some(bytes as u64)
}
