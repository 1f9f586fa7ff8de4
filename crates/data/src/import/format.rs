//! The formats that can be imported, each recognised by its content.

use super::packed::Packing;
use super::{Description, ImportError, Source, UnpackedOnce};
use crate::model::ReadMethod;
use std::io::{BufReader, Read, Seek};
use std::path::{Path, PathBuf};
use std::sync::{OnceLock, PoisonError, RwLock};

/// A file format. Adding one takes a file in this room and a line in [`BUILT_IN`], or [`register`] from another crate.
pub trait Format: Sync {
    /// The format's name in messages.
    fn name(&self) -> &'static str;

    /// How its files usually end, without the dot. Formats whose files end in nothing of their own leave this as it is.
    fn extensions(&self) -> &'static [&'static str] {
        &[]
    }

    /// Whether a file that begins with `head` (up to [`HEAD`] bytes, the whole file if it is shorter) and is `length`
    /// bytes long claims to be of this format. Damaged files may be recognised; [`Format::open`] finds the damage.
    fn recognise(&self, head: &[u8], length: u64) -> bool;

    /// Opens the source that `path` belongs to. Files that are read by byte range are read in the way `method`.
    ///
    /// # Errors
    /// [`ImportError`] when the file is damaged, incomplete or holds nothing to draw.
    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError>;

    /// The files that are read of the source that `path` belongs to, those that say how others are to be read too. Formats of one file leave
    /// this as it is.
    ///
    /// # Errors
    /// [`ImportError`] when a folder or file cannot be read, or is none of this format, or one of the files is not there.
    fn files(&self, path: &Path) -> Result<Vec<PathBuf>, ImportError> {
        Ok(vec![path.to_owned()])
    }

    /// How many steps the file holds, each of which is a snapshot; those that turn out to be damaged are counted, too. Formats of one
    /// snapshot leave this as it is. [`Format::open`] of several opens the first.
    ///
    /// # Errors
    /// [`ImportError`] when the file cannot be read, or has none.
    fn steps(&self, _path: &Path) -> Result<u64, ImportError> {
        Ok(1)
    }

    /// Opens step `step`, from 0, of a file. The source's path is [`super::step_name`] of the two.
    ///
    /// # Errors
    /// As [`Format::open`], and where there is no such step.
    fn open_step(&self, path: &Path, step: u64, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        match step {
            0 => self.open(path, method),
            _ => Err(ImportError::malformed(path, "step", step, "0, as the file holds one snapshot")),
        }
    }
}

/// How many bytes of a file [`Format::recognise`] sees.
pub const HEAD: usize = 4096;

/// The formats that come with deepfield, asked in this order.
static BUILT_IN: &[&dyn Format] = &[
    &super::hdf5::Hdf5,
    &super::gadget::Gadget,
    &super::ply::Ply,
    &super::las::Las,
    &super::phantom::Phantom,
    &super::vtk_points::VtkPoints,
    &super::ramses::Ramses,
    &super::nchilada::Nchilada,
    &super::generic_io::GenericIo,
    &super::trajectory::Gsd,
    &super::tipsy::Tipsy,
    &super::trajectory::LammpsDump,
    &super::trajectory::Xyz,
    &super::table::FitsTable,
    &super::table::Parquet,
    &super::table::Hats,
    &super::table::VoTable,
    &super::table::Ecsv,
    &super::table::GeoJson,
    &super::table::KStars,
    &super::table::Ascii,
    &super::table::Csv,
];

/// The formats of other crates.
static REGISTERED: RwLock<Vec<&'static dyn Format>> = RwLock::new(Vec::new());

/// Adds a format. It is asked before those that come with deepfield, which take almost any text for a table.
///
/// # Errors
/// What is wrong with it: a name that another format has.
pub fn register(format: &'static dyn Format) -> Result<(), String> {
    if formats().iter().any(|known| known.name() == format.name()) {
        return Err(format!("format {}: expected a name that no other format has", format.name()));
    }
    REGISTERED.write().unwrap_or_else(PoisonError::into_inner).push(format);
    Ok(())
}

/// Every format, in the order in which they are asked.
pub fn formats() -> Vec<&'static dyn Format> {
    let registered = REGISTERED.read().unwrap_or_else(PoisonError::into_inner);
    registered.iter().chain(BUILT_IN).copied().collect()
}

/// The names of all formats, for messages.
pub fn names() -> String {
    formats().iter().map(|format| format.name()).collect::<Vec<_>>().join(", ")
}

/// How files of particles and tables usually end, those that are compressed too, each once and without dots.
pub fn extensions() -> Vec<&'static str> {
    let mut found: Vec<&str> = Vec::new();
    for extension in formats().iter().flat_map(|format| format.extensions()).chain(&Packing::EXTENSIONS) {
        if !found.contains(extension) {
            found.push(extension);
        }
    }
    found
}

/// What names the formats of data that other crates read.
static BEYOND: OnceLock<fn() -> String> = OnceLock::new();

/// Says what names the formats of data that other crates read, for messages about files of no format; once.
pub fn name_beyond(names: fn() -> String) {
    BEYOND.get_or_init(|| names);
}

/// The names of the formats of everything that can be read.
fn names_of_all() -> String {
    let beyond = BEYOND.get().map(|names| format!(", {}", names())).unwrap_or_default();
    format!("{} (particles), {} (images and volumes){beyond}", names(), super::grid::grid_names())
}

/// What formats are recognised by.
pub(super) struct Head {
    /// The first bytes, at most [`HEAD`]; of what is compressed those that are in it.
    pub bytes: Vec<u8>,
    /// Length of the file, bytes.
    pub length: u64,
    /// How a file is compressed that can only be read as it is, and the format of what is in it.
    pub to_unpack: Option<(Packing, &'static str)>,
}

impl Head {
    /// Reads the beginning of a file.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub(super) fn read(path: &Path) -> Result<Head, ImportError> {
        let io = |source| ImportError::io(path, "file", source);
        let mut file = std::fs::File::open(path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        let (mut bytes, mut to_unpack) = (Vec::with_capacity(HEAD), None);
        (&mut file).take(HEAD as u64).read_to_end(&mut bytes).map_err(io)?;
        if let Some(packing) = Packing::of(&bytes) {
            file.rewind().map_err(io)?;
            let mut unpacked = Vec::with_capacity(HEAD);
            // What is damaged shows what came before the damage.
            let _ = packing.unpacked(BufReader::new(file)).take(HEAD as u64).read_to_end(&mut unpacked);
            // Formats of several files that lie together read what is on the disk.
            let as_they_are: [&dyn Format; 2] = [&super::nchilada::Nchilada, &super::ramses::Ramses];
            match as_they_are.into_iter().find(|format| format.recognise(&unpacked, length)) {
                Some(format) => to_unpack = Some((packing, format.name())),
                None => bytes = unpacked,
            }
        }
        Ok(Head { bytes, length, to_unpack })
    }
}

/// The format that a file claims to be of.
pub(super) fn format_of(head: &Head) -> Option<&'static dyn Format> {
    formats().into_iter().find(|format| format.recognise(&head.bytes, head.length))
}

/// Opens a source in whatever format its content shows; of a folder, the one source in it, or the volume that it holds the slices of (see
/// [`super::file_in`]).
///
/// # Errors
/// [`ImportError`] when the file cannot be read, is of no known format, or is damaged.
pub fn open(path: &Path) -> Result<Box<dyn Source>, ImportError> {
    open_with(path, ReadMethod::default())
}

/// The same, read in the way `method`.
///
/// # Errors
/// As [`open`].
pub fn open_with(path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
    open_file(&super::file_in(path, &[])?, method)
}

/// [`open_with`] of a file, or of a step in a file.
pub(super) fn open_file(path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
    let (file, step) = super::step_name::parts(path);
    let _held = UnpackedOnce::of(file);
    let format = format_at(file)?;
    match step {
        Some(step) => format.open_step(file, step, method),
        None => format.open(file, method),
    }
}

/// The files that the source at `path` is read from ([`Format::files`]); of a folder those of the one source in it.
///
/// # Errors
/// [`ImportError`] when the file or folder cannot be read, or is of no known format.
pub fn files_of(path: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let path = super::file_in(path, &[])?;
    let (file, _) = super::step_name::parts(&path);
    let _held = UnpackedOnce::of(file);
    format_at(file)?.files(file)
}

/// The files that an opened source is read from.
///
/// # Errors
/// As [`files_of`], of a source in several files.
pub(super) fn files_of_opened(about: &Description) -> Result<Vec<PathBuf>, ImportError> {
    if about.files > 1 { files_of(&about.path) } else { Ok(vec![about.path.clone()]) }
}

/// How many steps the source at `path` holds; a step in a file is one.
///
/// # Errors
/// [`ImportError`] when the file cannot be read, or is of no known format.
pub fn steps_in(path: &Path) -> Result<u64, ImportError> {
    match super::step_name::parts(path) {
        (_, Some(_)) => Ok(1),
        (file, None) => {
            let _held = UnpackedOnce::of(file);
            format_at(file)?.steps(file)
        }
    }
}

/// The format of a file.
fn format_at(path: &Path) -> Result<&'static dyn Format, ImportError> {
    if path.is_dir() && super::table::is_partitioned(path) {
        return Ok(&super::table::Hats);
    }
    // Formats of text take almost anything for a table, so that grids are told first.
    let is_grid = match path.is_dir() {
        true => super::folder::is_of_slices(path)?,
        false => super::grid::grid_content(path)?.is_some(),
    };
    if is_grid {
        return Ok(&super::grid::Voxels);
    }
    if super::folder::is_one_table(path)? {
        return Ok(&super::table::Parts);
    }
    let head = Head::read(path)?;
    let unknown = || match head.to_unpack {
        None if head.length == 0 && head.bytes.is_empty() => ImportError::malformed(path, "length", "0 bytes", "data"),
        None => ImportError::Unrecognised { path: path.into(), expected: names_of_all() },
        Some((packing, format)) => {
            let (name, command) = packing.described();
            let expected = format!("it unpacked first: {command} {}", path.display());
            ImportError::malformed(path, "compression", format!("{format} in {name}"), expected)
        }
    };
    format_of(&head).ok_or_else(unknown)
}
