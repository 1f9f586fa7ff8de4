//! The cache of page files of sources that are opened directly: built once, found again as long as the source does not change. Its folder has a
//! budget, and what was opened longest ago goes first. The program and its libraries share it.

use super::{DataKind, HeightsSaid, data_file};
use crate::build::{BuildOptions, FEW_PARTICLES, build_source};
use crate::heights::build::HeightBuildOptions;
use crate::heights::store::HeightFile;
use crate::heights::{OpenHeights, is_heights};
use crate::hierarchy::Kinds;
use crate::hierarchy::kind::{OCTREE, PCA};
use crate::import::{LoadOptions, UnpackedOnce, file_of_step, files_of};
use crate::model::{DerivedQuantity, Progress, ReadMethod};
use crate::store::budget::{CachedFile, make_room};
use crate::store::temporary::free_bytes;
use crate::store::{PageFile, RunFile};
use std::fs::Metadata;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// The path of a page file for `path`: itself if it is one or a run of them, else one in the cache's folder, built first unless it is there
/// already; and what had to go for it. What is said of heights goes into theirs, what is derived for particles into theirs, and each way to say it
/// has a file of its own. `memory` is what a build may take, bytes; its usual share where nothing is said.
///
/// # Errors
/// When the source cannot be read or the page file not be written, or a page file lacks what is to be derived.
pub fn page_file(
    path: &Path,
    said: &HeightsSaid,
    memory: Option<u64>,
    folder: impl FnOnce() -> Result<PathBuf, std::io::Error>,
    progress: &dyn Progress,
) -> Result<(PathBuf, Option<Removed>), Failure> {
    let path = &data_file(path)?;
    let kind = DataKind::of(path)?;
    if kind != DataKind::Source {
        check_derived(path, kind, &said.derive)?;
        return Ok((path.to_owned(), None));
    }
    let folder = folder()?;
    // What it is, and of which files, is asked before it is opened.
    let _held = UnpackedOnce::of(path);
    let of_heights = said.is_heights().unwrap_or_else(|| is_heights(path));
    let cached = folder.join(match of_heights {
        true => cached_name_of_heights(path, said)?,
        false => cached_name_of_particles(path, &said.derive)?,
    });
    let is_there = || match of_heights {
        true => HeightFile::open(&cached, ReadMethod::default()).is_ok(),
        false => PageFile::open(&cached).is_ok(),
    };
    if is_there() {
        mark_as_used(&cached);
        return Ok((cached, None));
    }
    let stated = stated_budget()?;
    let built = cached.with_extension("new.df");
    if of_heights {
        let (heights, _) = OpenHeights::for_pictures(path, &said.options(ReadMethod::default()))?;
        heights.build(&HeightBuildOptions { memory, ..HeightBuildOptions::default() }, &built, progress)?;
    } else {
        let load_options = LoadOptions { derive: said.derive.clone(), ..LoadOptions::default() };
        build_source(path, &load_options, &build_options(memory), &built, progress)?;
    }
    put_in_place(&built, &cached, is_there)?;
    let removed = prune(&folder, stated.unwrap_or_else(|| default_budget(&folder)), &cached)?;
    Ok((cached, removed))
}

/// Gives a file that was built the name under which it is looked for. Where another program has built the same meanwhile, its file stays: it may be
/// read already, and elsewhere in a network nobody goes on reading what is replaced.
fn put_in_place(built: &Path, cached: &Path, is_there: impl Fn() -> bool) -> Result<(), std::io::Error> {
    if is_there() {
        // The other program may have taken this one.
        let _ = std::fs::remove_file(built);
        return Ok(());
    }
    match std::fs::rename(built, cached) {
        Err(error) if !is_there() => Err(std::io::Error::new(error.kind(), format!("{}: {error}", cached.display()))),
        _ => Ok(()),
    }
}

/// A file that is built has the attributes that are to be derived: they cannot be derived from it.
fn check_derived(path: &Path, kind: DataKind, derive: &[DerivedQuantity]) -> Result<(), Failure> {
    if derive.is_empty() {
        return Ok(());
    }
    let file = match kind {
        DataKind::Pages => PageFile::open(path)?,
        DataKind::Run => RunFile::open(path, ReadMethod::default())?.still(0)?,
        DataKind::Grid | DataKind::Heights | DataKind::Source => {
            let found = kind.described();
            return Err(
                format!("{}: --derive: found {found}, expected particles with velocities", path.display()).into()
            );
        }
    };
    let families = &file.metadata().families;
    let is_lacking = |name: &&str| families.iter().all(|family| family.attribute(name).is_none());
    let lacking: Vec<&str> = derive.iter().map(|quantity| quantity.name()).filter(is_lacking).collect();
    // Of all what could be had.
    if lacking.is_empty() || DerivedQuantity::are_all(derive) && lacking.len() < derive.len() {
        return Ok(());
    }
    let (path, found, lacking) = (path.display(), kind.described(), lacking.join(","));
    Err(format!(
        "{path}: --derive: found {found} without {lacking}, expected its source: build --derive {lacking} adds them"
    )
    .into())
}

/// How page files in the cache are built: all that a window shows of them.
fn build_options(memory: Option<u64>) -> BuildOptions {
    BuildOptions {
        memory,
        hierarchies: Kinds::of([&OCTREE, &PCA]),
        clusters_from: CLUSTERS_FROM,
        exact_below: FEW_PARTICLES,
        ..BuildOptions::default()
    }
}

/// The budget that the user has set.
///
/// # Errors
/// When it is no amount of memory.
pub fn stated_budget() -> Result<Option<u64>, String> {
    let stated = std::env::var(BUDGET_VARIABLE).ok();
    let stated = stated.map(|text| bytes(&text).map_err(|error| format!("{BUDGET_VARIABLE} is {text:?}: {error}")));
    stated.transpose()
}

/// The budget of the folder, bytes.
///
/// # Errors
/// As [`stated_budget`].
pub fn budget(folder: &Path) -> Result<u64, String> {
    Ok(stated_budget()?.unwrap_or_else(|| default_budget(folder)))
}

/// The environment variable that sets the cache's budget.
pub const BUDGET_VARIABLE: &str = "DEEPFIELD_CACHE";

/// Particles from which on a view in motion is better drawn from clusters: fewer are drawn as they are within a frame's time.
const CLUSTERS_FROM: u64 = 1_000_000;

/// The cache's budget unless set: this, or a fifth of what it has and the disk has left, if that is less.
const MOST_BYTES: u64 = 50_000_000_000;

/// A build's unfinished file that has not grown for so long belongs to a program that is gone.
const ABANDONED: Duration = Duration::from_secs(24 * 3600);

/// What [`prune`] has removed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Removed {
    /// How many files.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
    /// The budget.
    pub budget: u64,
    /// The folder.
    pub folder: PathBuf,
}

impl std::fmt::Display for Removed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let gb = |bytes: u64| bytes as f64 / 1e9;
        let (files, folder) = (self.files, self.folder.display());
        let plural = if files == 1 { "" } else { "s" };
        write!(f, "removed {files} page file{plural} of {:.2} GB, unused for longest, from {folder}", gb(self.bytes))?;
        write!(f, ", which may hold {:.2} GB ({BUDGET_VARIABLE})", gb(self.budget))
    }
}

/// Notes that a page file was used. Nothing depends on whether that works but the order of removal.
pub fn mark_as_used(file: &Path) {
    if let Ok(file) = std::fs::File::options().append(true).open(file) {
        let _ = file.set_modified(SystemTime::now());
    }
}

/// The page files in a folder, finished and unfinished.
fn page_files(folder: &Path) -> Result<Vec<CachedFile>, std::io::Error> {
    let name = |error: std::io::Error| std::io::Error::new(error.kind(), format!("{}: {error}", folder.display()));
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(name)? {
        let entry = entry.map_err(name)?;
        // Another program may be removing files too.
        let Ok(about) = entry.metadata() else { continue };
        let is_ours = entry.file_name().to_string_lossy().contains(".df");
        if about.is_file() && is_ours {
            files.push(CachedFile::new(entry.path(), &about));
        }
    }
    Ok(files)
}

/// The budget of a folder unless one is set.
pub fn default_budget(folder: &Path) -> u64 {
    free_bytes(folder).map_or(MOST_BYTES, |free| (free.saturating_add(held(folder)) / 5).min(MOST_BYTES))
}

/// How many bytes of pages that servers have sent the folder may hold beside: what built files leave of its budget, a tenth of it at least.
///
/// # Errors
/// As [`stated_budget`].
pub fn room_for_pages(folder: &Path) -> Result<u64, String> {
    let budget = budget(folder)?;
    Ok(budget.saturating_sub(held(folder)).max(budget / 10))
}

/// Bytes of the page files in a folder.
fn held(folder: &Path) -> u64 {
    page_files(folder).unwrap_or_default().iter().map(|file| file.bytes).sum()
}

/// Removes page files that were used longest ago until the folder holds at most `budget` bytes, never `keep`; and what
/// builds that were cut off have left. `None` if no page file had to go.
///
/// # Errors
/// When the folder cannot be read.
pub fn prune(folder: &Path, budget: u64, keep: &Path) -> Result<Option<Removed>, std::io::Error> {
    let is_finished = |file: &CachedFile| file.path.extension().is_some_and(|extension| extension == "df");
    let (finished, unfinished): (Vec<_>, Vec<_>) = page_files(folder)?.into_iter().partition(is_finished);
    for file in unfinished.iter().filter(|file| file.used.elapsed().is_ok_and(|age| age > ABANDONED)) {
        // Whoever else removed it did what was wanted.
        let _ = std::fs::remove_file(&file.path);
    }
    let (kept, others): (Vec<_>, Vec<_>) = finished.into_iter().partition(|file| file.path == keep);
    let left = kept.iter().fold(budget, |left, file| left.saturating_sub(file.bytes));
    let (files, bytes) = make_room(others, left);
    Ok((files > 0).then(|| Removed { files, bytes, budget, folder: folder.to_owned() }))
}

/// A file name that changes when the source's path, length or time of change does, those of any other file that it is read from, or what is
/// built of it.
///
/// # Errors
/// When the source cannot be looked at.
pub fn cached_name(path: &Path) -> Result<String, std::io::Error> {
    let name = |error: std::io::Error| std::io::Error::new(error.kind(), format!("{}: {error}", path.display()));
    let file = file_of_step(path);
    // What names a step in the file, if anything does.
    let step = path.as_os_str().as_encoded_bytes()[file.as_os_str().len()..].to_vec();
    let path = std::fs::canonicalize(file).map_err(name)?;
    let about = std::fs::metadata(&path).map_err(name)?;
    // What else is in a folder changes the folder as well; files that are written anew in place do not.
    let (length, changed) = if about.is_dir() { (0, None) } else { length_and_change(&about) };
    let mut hasher = DefaultHasher::new();
    (&path, step, length, changed, crate::store::layout::VERSION, CLUSTERS_FROM).hash(&mut hasher);
    let files = match files_of(&path) {
        Err(error) if about.is_dir() => return Err(std::io::Error::other(error)),
        // Heights and photos are no sources of particles.
        files => files.unwrap_or_default(),
    };
    for file in files.iter().filter(|file| **file != path) {
        // What is gone by now is told where it is opened.
        (file, std::fs::metadata(file).ok().map(|about| length_and_change(&about))).hash(&mut hasher);
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    Ok(format!("{stem}-{:016x}.df", hasher.finish()))
}

/// The same of particles: it changes with what is derived for them as well.
fn cached_name_of_particles(path: &Path, derive: &[DerivedQuantity]) -> Result<String, std::io::Error> {
    let name = cached_name(path)?;
    if derive.is_empty() {
        return Ok(name);
    }
    let mut hasher = DefaultHasher::new();
    derive.iter().for_each(|quantity| quantity.name().hash(&mut hasher));
    let stem = name.strip_suffix(".df").unwrap_or(&name);
    Ok(format!("{stem}-{:016x}.df", hasher.finish()))
}

/// The length of a file, and when it was changed.
fn length_and_change(about: &Metadata) -> (u64, Option<Duration>) {
    (about.len(), about.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok()))
}

/// The same of heights: it changes with what is said of them as well, and with the photo over them.
fn cached_name_of_heights(path: &Path, said: &HeightsSaid) -> Result<String, std::io::Error> {
    let name = cached_name(path)?;
    let said = said.of_built_heights();
    if said == HeightsSaid::default() {
        return Ok(name);
    }
    let mut hasher = DefaultHasher::new();
    let HeightsSaid { taken_for: _, nodata, spacing, xy_unit, height_unit, texture, before: _, derive: _ } = &said;
    let numbers = (nodata.map(f64::to_bits), spacing.map(|spacing| spacing.map(f64::to_bits)));
    let units = [xy_unit, height_unit].map(|unit| unit.as_ref().map(|unit| unit.0.as_str()));
    let photo = texture.as_ref().map(|photo| Ok::<_, std::io::Error>((cached_name(&photo.path)?, photo.rectangle)));
    let photo = photo.transpose()?.map(|(name, place)| (name, place.map(|place| place.map(f64::to_bits))));
    (said.is_heights(), numbers, units, photo).hash(&mut hasher);
    let stem = name.strip_suffix(".df").unwrap_or(&name);
    Ok(format!("{stem}-{:016x}.df", hasher.finish()))
}

/// An amount of memory in bytes: `2GiB`, `512MiB`, `1.5GB`, `1000000`.
///
/// # Errors
/// What was expected.
pub fn bytes(text: &str) -> Result<u64, String> {
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
        _ => f64::NAN,
    };
    let value = number.trim().parse::<f64>().unwrap_or(f64::NAN) * factor;
    if value >= 1.0 && value < 2f64.powi(63) {
        Ok(value as u64)
    } else {
        Err("expected an amount of memory such as 2GiB or 512MiB".into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::heights::import::PhotoChoice;
    use crate::look::TakenFor;
    use crate::model::Unit;
    use std::collections::BTreeSet;

    /// A file of so many bytes, which begins as a picture does, used so many seconds ago.
    fn file(folder: &Path, name: &str, bytes: usize, seconds: u64) -> PathBuf {
        let path = folder.join(name);
        let mut content = b"\x89PNG\r\n\x1a\n".to_vec();
        content.resize(bytes, 0);
        std::fs::write(&path, content).unwrap();
        let used = SystemTime::now() - Duration::from_secs(seconds);
        std::fs::File::options().append(true).open(&path).unwrap().set_modified(used).unwrap();
        path
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn what_was_used_longest_ago_goes_first_and_never_what_was_just_made() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let made = file(folder, "made.df", 100, 5000);
        file(folder, "older.df", 30, 3000);
        let used = file(folder, "old.df", 40, 4000);
        file(folder, "new.df", 50, 10);
        file(folder, "notes.txt", 1000, 9000);
        file(folder, "cut-off.df.tmp1", 1000, 100_000);
        file(folder, "growing.df.tmp2", 1000, 5);
        mark_as_used(&used);
        assert_eq!(prune(folder, 220, &made).unwrap(), None);
        assert_eq!(names(folder), ["growing.df.tmp2", "made.df", "new.df", "notes.txt", "old.df", "older.df"]);
        let removed = prune(folder, 150, &made).unwrap().unwrap();
        assert_eq!((removed.files, removed.bytes), (2, 80));
        assert_eq!(names(folder), ["growing.df.tmp2", "made.df", "notes.txt", "old.df"]);
        let text = removed.to_string();
        assert!(text.starts_with("removed 2 page files of") && !text.contains('\n') && text.contains(BUDGET_VARIABLE));
        // One file may be larger than the budget: it was just asked for.
        assert_eq!(prune(folder, 1, &made).unwrap().unwrap().files, 1);
        assert_eq!(names(folder), ["growing.df.tmp2", "made.df", "notes.txt"]);
        assert!(prune(&folder.join("absent"), 1, &made).unwrap_err().to_string().contains("absent"));
    }

    /// Another program, which has built a file once this one has begun to.
    struct Other {
        from: PathBuf,
        to: PathBuf,
        changed: SystemTime,
    }

    impl Progress for Other {
        fn begin(&self, _: &str, _: u64) {
            if !self.to.exists() {
                std::fs::copy(&self.from, &self.to).unwrap();
                std::fs::File::options().append(true).open(&self.to).unwrap().set_modified(self.changed).unwrap();
            }
        }

        fn advance(&self, _: u64) {}
    }

    #[test]
    fn what_another_program_has_built_meanwhile_stays() {
        let folder = tempfile::tempdir().unwrap();
        let source = folder.path().join("points.csv");
        let rows: Vec<String> = (0..50).map(|i| format!("{i},{},{}", i * i % 7, i % 5)).collect();
        std::fs::write(&source, format!("x,y,z\n{}\n", rows.join("\n"))).unwrap();
        let [own, shared] = ["own", "shared"].map(|name| folder.path().join(name));
        for cache in [&own, &shared] {
            std::fs::create_dir(cache).unwrap();
        }
        let built = |cache: &Path, progress: &dyn Progress| {
            page_file(&source, &HeightsSaid::default(), None, || Ok(cache.to_owned()), progress).unwrap().0
        };
        let from = built(&own, &());
        let to = shared.join(from.file_name().unwrap());
        let changed = UNIX_EPOCH + Duration::from_secs(1_000_000_000);
        let other = Other { from, to, changed };
        assert_eq!(built(&shared, &other), other.to);
        assert_eq!(std::fs::metadata(&other.to).unwrap().modified().unwrap(), changed);
        assert_eq!(names(&shared), names(&own));
        // What is damaged is replaced.
        std::fs::write(&other.to, "damaged").unwrap();
        built(&shared, &());
        assert_eq!(std::fs::read(&other.to).unwrap(), std::fs::read(&other.from).unwrap());
        assert_eq!(names(&shared), names(&own));
    }

    #[test]
    fn a_folder_has_another_file_where_one_of_those_that_are_read_changes() {
        let folder = tempfile::tempdir().unwrap();
        let (first, second) = ("Norder=0/Dir=0/Npix=4.parquet", "Norder=1/Dir=0/Npix=20/part0.parquet");
        for (stem, files) in [("slices", ["s0.png", "s1.png", "s2.png"]), ("sky", [first, second, "properties"])] {
            let source = folder.path().join(stem);
            for name in files {
                std::fs::create_dir_all(source.join(name).parent().unwrap()).unwrap();
                file(&source, name, 10, 50);
            }
            let mut names = BTreeSet::from([cached_name(&source).unwrap()]);
            for (number, name) in files.into_iter().enumerate() {
                file(&source, name, 10, 5);
                assert!(names.insert(cached_name(&source).unwrap()), "{name}");
                file(&source, "notes.txt", 3, number as u64);
                assert!(!names.insert(cached_name(&source).unwrap()), "{name}");
            }
            assert!(names.iter().all(|name| name.starts_with(stem)));
        }
        // The text of a catalogue stands for all of it.
        let sky = folder.path().join("sky");
        let text = sky.join("properties");
        std::fs::write(&text, "hats_nrows=5\n").unwrap();
        let before = cached_name(&text).unwrap();
        file(&sky, second, 11, 5);
        assert_ne!(before, cached_name(&text).unwrap());
    }

    #[test]
    fn a_snapshot_in_several_files_has_another_file_where_any_of_them_changes() {
        let (folder, data) =
            (tempfile::tempdir().unwrap(), Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data"));
        let paths = ["arepo.0.hdf5", "arepo.1.hdf5"].map(|name| {
            let path = folder.path().join(name);
            std::fs::copy(data.join(name), &path).unwrap();
            path
        });
        let names = || paths.each_ref().map(|path| cached_name(path).unwrap());
        for changed in &paths {
            let before = names();
            assert_eq!(before, names());
            let earlier = SystemTime::now() - Duration::from_secs(500);
            std::fs::File::options().append(true).open(changed).unwrap().set_modified(earlier).unwrap();
            assert!(before.iter().zip(names()).all(|(before, after)| *before != after), "{changed:?}");
        }
    }

    #[test]
    fn each_choice_of_what_is_derived_has_a_file_of_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let source = file(folder.path(), "box.hdf5", 10, 5);
        let of = |derive: &[DerivedQuantity]| cached_name_of_particles(&source, derive).unwrap();
        let all = DerivedQuantity::ALL;
        let names: BTreeSet<String> = (0..=all.len()).map(|count| of(&all[..count])).collect();
        assert!(names.len() == all.len() + 1 && names.contains(&cached_name(&source).unwrap()));
        assert_eq!(of(&all), of(&all));
    }

    #[test]
    fn each_way_to_say_what_heights_are_has_a_file_of_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let [source, photo] = ["dem.tif", "photo.png"].map(|name| file(folder.path(), name, 10, 5));
        let nothing = HeightsSaid::default();
        let laid = |rectangle| HeightsSaid {
            texture: Some(PhotoChoice { path: photo.clone(), rectangle }),
            ..nothing.clone()
        };
        let ways = [
            nothing.clone(),
            HeightsSaid { taken_for: Some(TakenFor::Heights), ..nothing.clone() },
            HeightsSaid { nodata: Some(0.0), ..nothing.clone() },
            HeightsSaid { nodata: Some(-9999.0), ..nothing.clone() },
            HeightsSaid { spacing: Some([1.0, 2.0]), ..nothing.clone() },
            HeightsSaid { xy_unit: Some(Unit::new("mm")), ..nothing.clone() },
            HeightsSaid { height_unit: Some(Unit::new("mm")), ..nothing.clone() },
            laid(None),
            laid(Some([0.0, 0.0, 1.0, 1.0])),
        ];
        let names =
            || -> BTreeSet<String> { ways.iter().map(|said| cached_name_of_heights(&source, said).unwrap()).collect() };
        let before = names();
        assert!(before.len() == ways.len() && before == names());
        assert!(before.contains(&cached_name(&source).unwrap()));
        assert!(before.iter().all(|name| name.starts_with("dem-") && name.ends_with(".df")));
        // Another photo under the same name is another file.
        std::fs::write(&photo, [1; 11]).unwrap();
        assert_eq!(before.intersection(&names()).count(), ways.len() - 2);
        std::fs::remove_file(&photo).unwrap();
        assert!(cached_name_of_heights(&source, &laid(None)).unwrap_err().to_string().contains("photo.png"));
        let derive = DerivedQuantity::ALL.to_vec();
        assert_eq!(
            cached_name_of_heights(&source, &HeightsSaid { derive, ..nothing }).unwrap(),
            cached_name(&source).unwrap()
        );
    }

    #[test]
    fn the_default_budget_leaves_most_of_the_disk_free() {
        let folder = tempfile::tempdir().unwrap();
        let budget = default_budget(folder.path());
        assert!(budget <= MOST_BYTES);
        assert!(free_bytes(folder.path()).is_none_or(|free| budget <= free / 4));
    }
}
