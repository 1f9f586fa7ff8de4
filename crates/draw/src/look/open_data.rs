//! What a user names, opened: page files, and runs of which one step at a time is shown.

use super::{Member, is_scene_file};
use crate::explore::Following;
use crate::heights::store::HeightFile;
use crate::hierarchy::spacetime::Interpolation;
use crate::import::{ImportError, file_in, file_of_step, grid_format};
use crate::model::url::{refused, shown};
use crate::model::{Bounds, FamilyName, Moment, ReadMethod, When, is_url};
use crate::store::run::RunTree;
use crate::store::{GridFile, Metadata, PageFile, RunFile, StoreError, Tree, first_bytes};
use crate::stream::first_frame;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What a file is, by its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataKind {
    /// A page file.
    Pages,
    /// A run of page files.
    Run,
    /// A file of an image or a volume.
    Grid,
    /// A file of heights.
    Heights,
    /// Anything else: a source, if an importer knows it.
    Source,
}

impl DataKind {
    /// What the file at `path` is; a folder is a source, if anything, and nothing behind a URL is.
    ///
    /// # Errors
    /// When the file cannot be read, or lies behind a URL and was not built; the message names it.
    pub fn of(path: &Path) -> Result<DataKind, std::io::Error> {
        if path.is_dir() {
            return Ok(DataKind::Source);
        }
        let shown = shown(path);
        let name = |error: std::io::Error| std::io::Error::new(error.kind(), format!("{}: {error}", shown.display()));
        let kind = if is_url(path) { DataKind::afar(&shown) } else { DataKind::read(file_of_step(path)) };
        kind.map_err(name)
    }

    /// What the first bytes of a file say.
    fn read(path: &Path) -> std::io::Result<DataKind> {
        let head = first_bytes(path, 16)?;
        Ok(match () {
            () if PageFile::recognises(&head) => DataKind::Pages,
            () if RunFile::recognises(&head) => DataKind::Run,
            () if GridFile::recognises(&head) => DataKind::Grid,
            () if HeightFile::recognises(&head) => DataKind::Heights,
            () => DataKind::Source,
        })
    }

    /// The same of a file behind a URL, by what is shown of it, which has to be built: importers read files of this machine, and so do scenes.
    fn afar(url: &Path) -> std::io::Result<DataKind> {
        if is_scene_file(url) {
            return Err(refused("a file"));
        }
        let unbuilt = "found a file that was not built, expected a built one: only those are read from afar; \
                       `deepfield build FILE -o FILE.df` builds it where it lies";
        match DataKind::read(url)? {
            DataKind::Source => Err(std::io::Error::new(std::io::ErrorKind::Unsupported, unbuilt)),
            kind => Ok(kind),
        }
    }

    /// What messages call it.
    pub fn described(self) -> &'static str {
        match self {
            DataKind::Pages => "a page file of particles",
            DataKind::Run => "a run of particles",
            DataKind::Grid => "a built image or volume",
            DataKind::Heights => "built heights",
            DataKind::Source => "a source",
        }
    }

    /// What the file at `path` is, where particles are shown: a page file, a run or a source.
    ///
    /// # Errors
    /// [`StoreError::NotParticles`]. What cannot be read is told where it is opened.
    pub fn of_particles(path: &Path) -> Result<DataKind, StoreError> {
        match DataKind::of(path) {
            Ok(kind @ (DataKind::Grid | DataKind::Heights)) => {
                Err(StoreError::NotParticles { path: path.to_path_buf(), found: kind.described() })
            }
            kind => Ok(kind.unwrap_or(DataKind::Pages)),
        }
    }
}

/// Whether a file is of an image or a volume, built or not.
pub fn is_field(path: &Path) -> bool {
    match DataKind::of(path) {
        Ok(DataKind::Grid) => true,
        Ok(DataKind::Source) => matches!(grid_format(path), Ok(Some(_))),
        _ => false,
    }
}

/// The source, page file, run or other file that a user means who names `path`: of a folder, the one of them in it; one of slices is a source
/// itself. A URL is named from then on by what is shown of it.
///
/// # Errors
/// [`ImportError`] with a list of what is there, where a folder holds none or several; of a URL, why no built file can be read from there.
/// Whether a path exists is not asked.
pub fn data_file(path: &Path) -> Result<PathBuf, ImportError> {
    if is_url(path) {
        let path = shown(path);
        DataKind::afar(&path).map_err(|error| ImportError::io(&path, "open", error))?;
        return Ok(path);
    }
    file_in(
        path,
        &[
            ("page file", PageFile::recognises),
            ("run", RunFile::recognises),
            ("file of a grid", GridFile::recognises),
            ("file of heights", HeightFile::recognises),
        ],
    )
}

/// Why a moment of data that has only one cannot be asked for; `time` is its own.
pub fn one_snapshot(path: &Path, time: Option<f64>) -> String {
    let at = time.map_or_else(|| "without a time".into(), |time| format!("at {time}"));
    format!("{}: --time: one snapshot, {at}", path.display())
}

/// A dataset of a scene, open.
#[derive(Clone, Debug)]
enum Data {
    Pages(PathBuf),
    Run(Arc<RunFile>),
}

/// The datasets of a scene, open. Of each run one step at a time is shown; the first run's clock is the scene's.
#[derive(Clone, Debug)]
pub struct OpenData {
    members: Vec<(Member, Data)>,
    read: ReadMethod,
    /// Selections of the run whose clock is the scene's, where it has tracks.
    following: Option<Arc<Following>>,
}

impl OpenData {
    /// Opens the datasets; `built` turns what a user names into a page file or a run. They are read in the way `read`.
    ///
    /// # Errors
    /// [`StoreError`] and the errors of `built`.
    pub fn open<E: From<StoreError>>(
        members: &[Member],
        read: ReadMethod,
        mut built: impl FnMut(&Path) -> Result<PathBuf, E>,
    ) -> Result<OpenData, E> {
        let open = |member: &Member| {
            let path = built(&member.path)?;
            let data = match DataKind::of_particles(&path)? {
                DataKind::Run => Data::Run(Arc::new(RunFile::open(&path, read)?)),
                _ => Data::Pages(path),
            };
            Ok((member.clone(), data))
        };
        let members = members.iter().map(open).collect::<Result<_, E>>()?;
        let opened = OpenData { members, read, following: None };
        // Those of a run among other datasets, or that lies elsewhere, have other places than their tracks.
        let is_alone = matches!(&opened.members[..], [(only, _)] if only.is_in_place());
        let run = opened.run().filter(|_| is_alone).cloned();
        Ok(OpenData { following: run.and_then(Following::new).map(Arc::new), ..opened })
    }

    /// What follows selections in the run; `None` for data that is none, that has no tracks, or that is one of several or moved.
    pub fn following(&self) -> Option<&Arc<Following>> {
        self.following.as_ref()
    }

    /// The run whose clock is the scene's; `None` where no dataset is one.
    pub fn run(&self) -> Option<&Arc<RunFile>> {
        self.members.iter().find_map(|(_, data)| match data {
            Data::Run(run) => Some(run),
            Data::Pages(_) => None,
        })
    }

    /// Where a moment lies in the run; the beginning where none is named. `None` where no dataset is a run.
    ///
    /// # Errors
    /// [`StoreError::Moment`] where it lies outside.
    pub fn moment(&self, when: Option<When>) -> Result<Option<Moment>, StoreError> {
        let moment = |run: &Arc<RunFile>| when.map_or(Ok(Moment::default()), |when| run.moment(when));
        self.run().map(moment).transpose()
    }

    /// The box that shows all of some families but far outliers, as they are at a moment; of all where none is named.
    ///
    /// # Errors
    /// [`StoreError`] where the data cannot be read.
    pub fn framed(
        &self,
        moment: Moment,
        interpolation: Interpolation,
        families: Option<&[FamilyName]>,
    ) -> Result<Bounds, StoreError> {
        let shown = |metadata: &Metadata| -> Vec<u32> {
            let is_shown = |name: &FamilyName| families.is_none_or(|families| families.contains(name));
            let all = (0..).zip(&metadata.families);
            all.filter(|(_, family)| is_shown(&family.name)).map(|(index, _)| index).collect()
        };
        let moves = moment.u > 0.0 && interpolation != Interpolation::Hold;
        if let Some(following) = self.following.as_ref().filter(|_| moves) {
            let tree = RunTree::new(Arc::clone(following.run()), interpolation)?;
            return Ok(first_frame(&tree, &shown(tree.metadata()), tree.time(moment)));
        }
        let file = self.at(moment)?.0;
        Ok(first_frame(&file, &shown(file.metadata()), 0.0))
    }

    /// The datasets as one scene in the units of the first, of each run the step at or before the moment. Also says what does not fit
    /// together, a sentence each.
    ///
    /// # Errors
    /// [`StoreError`] where a file cannot be read or cannot be shown with the others.
    pub fn at(&self, moment: Moment) -> Result<(PageFile, Vec<String>), StoreError> {
        let clock = self.run();
        let time = clock.map(|run| run.time(moment));
        let file = |data: &Data| match data {
            Data::Run(run) if !run.has_stills() && self.members.len() > 1 => {
                Err(StoreError::NoStills { path: run.path().to_path_buf() })
            }
            Data::Pages(path) => PageFile::open_with(path, self.read),
            Data::Run(run) if clock.is_some_and(|clock| Arc::ptr_eq(clock, run)) => run.placed_still(moment.step),
            Data::Run(run) => run.placed_still(step_at(run, time)),
        };
        let files = self.members.iter().map(|(_, data)| file(data)).collect::<Result<Vec<_>, _>>()?;
        let named = files.iter().zip(&self.members).map(|(file, (member, _))| (file.path().to_owned(), &*member.path));
        let named: Vec<(PathBuf, &Path)> = named.collect();
        let units = |file: &PageFile| (file.metadata().length_unit.clone(), file.metadata().mass_unit.clone());
        // A run's units are its first step's, whichever step is shown.
        let first_run = self.members.first().and_then(|(_, data)| match data {
            Data::Run(run) => Some((run.directory().length_unit.clone(), run.directory().mass_unit.clone())),
            Data::Pages(_) => None,
        });
        let scene = first_run.or(files.first().map(units)).unwrap_or_default();
        let placed = files.into_iter().zip(&self.members).map(|(file, (member, data))| {
            let (length, mass) = match data {
                Data::Run(run) => (run.directory().length_unit.clone(), run.directory().mass_unit.clone()),
                Data::Pages(_) => units(&file),
            };
            (file, member.placement((&length, &mass), (&scene.0, &scene.1)))
        });
        match PageFile::join(placed.collect()) {
            Ok((file, notes)) => Ok((file, notes.into_iter().map(|note| by_name(note, &named)).collect())),
            Err(StoreError::Unjoinable { path, reason }) => {
                let name = named.iter().find(|(built, _)| *built == path).map(|(_, name)| name.to_path_buf());
                Err(StoreError::Unjoinable { path: name.unwrap_or(path), reason })
            }
            Err(error) => Err(error),
        }
    }
}

/// What is said of a file, by the name that its user has given: what is built of a source lies in the cache.
fn by_name(note: String, named: &[(PathBuf, &Path)]) -> String {
    let renamed = named.iter().find_map(|(built, name)| {
        let rest = note.strip_prefix(&*built.to_string_lossy())?.strip_prefix(": ")?;
        Some(format!("{}: {rest}", name.display()))
    });
    renamed.unwrap_or(note)
}

/// The step of another run that is shown at a time of the scene's clock: its last one that is not later, else its first.
fn step_at(run: &RunFile, time: Option<f64>) -> usize {
    let Some(time) = time else { return 0 };
    run.times().times.partition_point(|step| *step <= time).saturating_sub(1)
}
