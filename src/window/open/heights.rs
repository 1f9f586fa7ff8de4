//! Opening measured heights: a page file as it is, a source by way of the one that is built for it, of which every so many samples are shown as
//! soon as these are read.

use super::sketch::{PATIENCE, sketched};
use super::{Opened, Seen};
use crate::heights::OpenHeights;
use crate::heights::build::{HeightBuildOptions, HeightOrigin, build_heights};
use crate::heights::import::{HeightOptions, HeightSource};
use crate::heights::model::{HeightField, HeightGrid, Heights, Window};
use crate::heights::store::HeightFile;
use crate::look::{HeightsSaid, Member};
use crate::model::progress::Progress;
use crate::model::{ReadMethod, SampleType, Scale};
use crate::modes::surface::radius_of;
use crate::picture::surface::OpenSurface;
use crate::stream::first_frame;
use crate::window::options::Opener;
use crate::window::sampled::Sampled;
use crate::window::scene::SceneField;
use std::path::Path;
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Samples of what is shown before all are there.
const FEW: u64 = 1 << 18;
/// Fields of fewer samples are there at once.
const AT_ONCE: u64 = 1 << 22;
/// Where reading a few samples takes longer than this, all of them are waited for.
const LONG: Duration = Duration::from_secs(4);

/// Opens heights. What stands in for them meanwhile goes to whoever listens at `early`.
///
/// # Errors
/// When they cannot be read, or built.
pub(super) fn open_heights(
    members: Vec<Member>,
    seen: &Seen,
    read: ReadMethod,
    opener: &Opener,
    progress: &dyn Progress,
    early: &Sender<Result<Opened, String>>,
) -> Result<Opened, String> {
    let members = members.iter().map(Member::resolved).collect::<Result<Vec<_>, _>>();
    let members = members.map_err(|error| error.to_string())?;
    let Some(Member { path, said, .. }) = members.first().cloned() else { return Err("no heights".into()) };
    let told = |error: &dyn std::fmt::Display| error.to_string();
    let (open, _) = OpenHeights::for_pictures(&path, &said.options(read)).map_err(|error| told(&error))?;
    check_map(&path, open.grid(), seen)?;
    let (file, keeps) = match open {
        OpenHeights::Pages(file) => {
            let surface = OpenSurface::new(&path, *file).map_err(|error| told(&error))?;
            return opened(&path, &members, seen, compared(surface, &said, read, opener, progress)?);
        }
        OpenHeights::Source(source) => {
            let (first, state) = (early.clone(), Arc::new(Mutex::new(State::Begun)));
            if source.grid().samples() > AT_ONCE {
                let (known, path, members, seen) = (Arc::clone(&state), path.clone(), members.clone(), seen.clone());
                let show = move || {
                    std::thread::sleep(PATIENCE);
                    let is_over = || *locked(&known) == State::Over;
                    if let Some(few) = few_of(&path, &source, is_over)
                        && let Ok(shown) = opened(&path, &members, &seen, few)
                    {
                        let mut state = locked(&known);
                        // Nobody listens any more where another file was opened meanwhile.
                        if *state == State::Begun && first.send(Ok(Opened { has_more: true, ..shown })).is_ok() {
                            *state = State::Shown;
                        }
                    }
                };
                // Without a thread all of them are waited for.
                drop(std::thread::Builder::new().name("deepfield heights".into()).spawn(show));
            }
            let built = opener(&path, &said, progress);
            let is_shown = std::mem::replace(&mut *locked(&state), State::Over) == State::Shown;
            (built_file(&built?, read)?, is_shown)
        }
    };
    let surface = OpenSurface::new(&path, file).map_err(|error| told(&error))?;
    let surface = compared(surface, &said, read, opener, progress)?;
    Ok(Opened { keeps, ..opened(&path, &members, seen, surface)? })
}

/// A file that was built, as pictures have it: one that was built before x and y of its source counted as degrees is in degrees, too.
fn built_file(path: &Path, read: ReadMethod) -> Result<HeightFile, String> {
    let options = HeightOptions { read, ..HeightOptions::default() };
    match OpenHeights::for_pictures(path, &options).map_err(|error| error.to_string())? {
        (OpenHeights::Pages(file), _) => Ok(*file),
        (OpenHeights::Source(_), _) => Err(format!("{}: expected a page file of heights", path.display())),
    }
}

/// Compares heights with the earlier ones that are named, if any.
fn compared(
    surface: OpenSurface,
    said: &HeightsSaid,
    read: ReadMethod,
    opener: &Opener,
    progress: &dyn Progress,
) -> Result<OpenSurface, String> {
    let Some(before) = &said.before else { return Ok(surface) };
    let own = said.of_before();
    let file = match OpenHeights::for_pictures(before, &own.options(read)).map_err(|error| error.to_string())? {
        (OpenHeights::Pages(file), _) => *file,
        (OpenHeights::Source(_), _) => built_file(&opener(before, &own, progress)?, read)?,
    };
    surface.since(before, file, None).map_err(|error| error.to_string())
}

/// Refuses a map that does not fit.
pub(super) fn check_map(path: &Path, grid: &HeightGrid, seen: &Seen) -> Result<(), String> {
    let fits = seen.map.as_deref().map(|map| radius_of(map, grid)).transpose();
    fits.map(drop).map_err(|why| format!("{}: {why}", path.display()))
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Begun,
    Shown,
    Over,
}

fn locked(state: &Mutex<State>) -> MutexGuard<'_, State> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Every so many samples of a source, built; `None` where it is not worth while, or nobody waits for it any more.
fn few_of(path: &Path, source: &HeightSource, is_over: impl Fn() -> bool) -> Option<OpenSurface> {
    let (whole, begun) = (source.grid(), Instant::now());
    let every = (whole.samples() as f64 / FEW as f64).sqrt().ceil().max(1.0) as u64;
    let [rows, columns] = [whole.rows, whole.columns].map(|count| count.div_ceil(every));
    if rows < 2 || columns < 2 {
        return None;
    }
    let mut stored = Vec::with_capacity((rows * columns) as usize);
    let mut line = vec![0.0; usize::try_from(whole.columns).ok()?];
    for row in 0..rows {
        if is_over() || begun.elapsed() > LONG {
            return None;
        }
        source.stored(Window::rows(whole, row * every, 1), &mut line).ok()?;
        stored.extend(line.iter().step_by(every as usize).map(|value| whole.scale.value(*value)));
    }
    let grid = HeightGrid {
        columns,
        rows,
        step: whole.step.map(|step| step * every as f64),
        sample_type: SampleType::F32,
        scale: Scale::NONE,
        planes: Vec::new(),
        ..whole.clone()
    };
    let few = HeightField { grid, stored, planes: Vec::new() };
    let folder = tempfile::Builder::new().prefix("deepfield-heights").tempdir().ok()?;
    let built = folder.path().join("few.df");
    build_heights(&few, &HeightOrigin::of(source), &HeightBuildOptions::default(), &built, &()).ok()?;
    let surface = OpenSurface::new(path, HeightFile::open(&built, ReadMethod::default()).ok()?).ok()?;
    Some(surface.within(folder))
}

/// An open field as the window takes it.
fn opened(path: &Path, members: &[Member], seen: &Seen, surface: OpenSurface) -> Result<Opened, String> {
    let sampled = Sampled::Heights(Arc::new(surface));
    let (file, folder) = sketched(&sampled)?;
    let families: Vec<u32> = (0..file.metadata().families.len() as u32).collect();
    let frame = first_frame(&file, &families, 0.0);
    Ok(Opened {
        path: path.into(),
        members: members.to_vec(),
        notes: Vec::new(),
        run: None,
        tracks: None,
        field: Some(SceneField { sketch: Some(Arc::new(folder)), ..SceneField::new(sampled) }),
        file: Arc::new(file),
        frame,
        scene: seen.scene.clone().map(Arc::new),
        map: seen.map.clone(),
        keeps: false,
        has_more: false,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Not measured in one place; no two neighbours have the same height, and single precision holds all of them.
    fn height(row: usize, column: usize) -> f32 {
        let is_open = (700..760).contains(&row) && (300..341).contains(&column);
        if is_open { f32::NAN } else { 8.0 * (row as f32).mul_add(0.5, column as f32) }
    }

    /// What stands in for a field that is read goes from its first sample to its last ones, and is its own samples.
    #[test]
    fn few_samples_are_the_whole_extent_and_every_so_many() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("large.npy");
        let [columns, rows] = [2200, 2000];
        let head = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({rows}, {columns}), }}");
        let mut bytes = [&b"\x93NUMPY\x01\x00\x76\x00"[..], format!("{head:<117}\n").as_bytes()].concat();
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
            bytes.extend(height(row, column).to_le_bytes());
        }
        std::fs::write(&path, bytes).unwrap();
        let options = HeightOptions { spacing: Some([0.5, 2.0]), ..HeightOptions::default() };
        let source = crate::heights::import::open_heights(&path, &options).unwrap();
        assert!(source.grid().samples() > AT_ONCE);

        let few = few_of(&path, &source, || false).unwrap();
        assert!(few.path() == path && few.is_temporary());
        let grid = few.file().grid();
        let (width, every) = (grid.columns as usize, 5);
        assert_eq!(([grid.columns, grid.rows], grid.origin, grid.step), ([440, 400], [0.0; 2], [2.5, 10.0]));
        let mut heights = vec![0.0; grid.samples() as usize];
        few.file().heights(Window::all(grid), &mut heights).unwrap();
        for (index, found) in heights.iter().enumerate() {
            let (row, column) = (every * (index / width), every * (index % width));
            let expected = f64::from(height(row, column));
            assert!(*found == expected || found.is_nan() && expected.is_nan(), "{found} at {row}, {column}");
        }
        // Nobody waits for it any more.
        assert!(few_of(&path, &source, || true).is_none());
    }
}
