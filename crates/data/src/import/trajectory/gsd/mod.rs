//! GSD, the binary trajectories of HOOMD-blue (glotzerlab/gsd, `doc/schema-hoomd.rst`, schema `hoomd`): chunks of numbers by frame and name.
//!
//! What a frame does not have is that of the first frame, where the two have as many particles, else the schema's default. A cell is
//! centred at 0.

mod file;
#[cfg(test)]
mod tests;
mod unwrapped;

use self::file::{Directory, Entry, GsdFile, is_gsd};
use self::unwrapped::Unwrapped;
use super::cell::{Cell, Cells};
use super::first_of;
use super::index::TimeOf;
use super::known::Key;
use crate::import::typed_columns::{
    Column, Component, FieldList, Meaning, Run, TypedColumns, TypedFamily, all_positive, each_number,
};
use crate::import::{Description, FamilyInfo, FieldKind, Format, ImportError, Source, step_name};
use crate::model::{FamilyName, ReadMethod};
use std::collections::{BTreeMap, HashSet};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// The format.
pub(in crate::import) struct Gsd;

/// The most types of particles, those of them that a frame has, and letters of all of their names.
const MOST_TYPES: u64 = 4096;
const MOST_FAMILIES: usize = 256;
const MOST_LETTERS: u64 = 1 << 20;

/// The most numbers of a chunk for each particle.
const MOST_COMPONENTS: u64 = 64;

const STEP: &str = "configuration/step";
const BOX: &str = "configuration/box";
const DIMENSIONS: &str = "configuration/dimensions";
const COUNT: &str = "particles/N";
const TYPE: &str = "particles/typeid";
const TYPES: &str = "particles/types";
const POSITION: &str = "particles/position";
const DIAMETER: &str = "particles/diameter";
const IMAGE: &str = "particles/image";

/// Chunks of particles, their names here, what they are, and the schema's defaults.
const PARTICLES: [(&str, &str, FieldKind, &[f64]); 7] = [
    ("particles/velocity", "velocity", FieldKind::Velocity, &[0.0; 3]),
    ("particles/mass", "mass", FieldKind::Mass, &[1.0]),
    ("particles/charge", "charge", FieldKind::Other, &[0.0]),
    ("particles/body", "body", FieldKind::Other, &[-1.0]),
    ("particles/moment_inertia", "moment-of-inertia", FieldKind::Other, &[0.0; 3]),
    ("particles/orientation", "orientation", FieldKind::Other, &[1.0, 0.0, 0.0, 0.0]),
    ("particles/angmom", "angular-momentum", FieldKind::Other, &[0.0; 4]),
];

/// Chunks that are read in other ways, or not at all.
const OTHERS: [&str; 7] = [COUNT, TYPE, TYPES, "particles/type_shapes", POSITION, DIAMETER, IMAGE];

impl Format for Gsd {
    fn name(&self) -> &'static str {
        "GSD"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["gsd"]
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        is_gsd(head)
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        open(path, None, method)
    }

    fn steps(&self, path: &Path) -> Result<u64, ImportError> {
        Ok(trajectory(path)?.directory.frames)
    }

    fn open_step(&self, path: &Path, step: u64, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        open(path, Some(step), method)
    }
}

/// What all frames of a file have in common.
#[derive(Debug)]
struct Trajectory {
    directory: Directory,
    /// The chunks of the first frame.
    first: Vec<Entry>,
    /// What the cells are together.
    cells: Cells,
    /// Whether all frames have as many particles as the first.
    keeps_count: bool,
}

/// The file that was looked through last: a run opens its frames one by one.
static KNOWN: Mutex<Option<(Key, Arc<Trajectory>)>> = Mutex::new(None);

/// What frames have in common: as before where the file has not changed.
fn trajectory(path: &Path) -> Result<Arc<Trajectory>, ImportError> {
    let key = Key::of(path, "gsd")?;
    let known = || KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, found)) = known().as_ref().filter(|(own, _)| *own == key) {
        return Ok(Arc::clone(found));
    }
    let found = Arc::new(Trajectory::read(&GsdFile::open(path, ReadMethod::Positioned)?)?);
    *known() = Some((key, Arc::clone(&found)));
    Ok(found)
}

impl Trajectory {
    fn read(file: &GsdFile) -> Result<Trajectory, ImportError> {
        let directory = Directory::read(file)?;
        let first = directory.frame(file, 0)?;
        let mut all = Trajectory { directory, first, cells: Cells::Open, keeps_count: true };
        let frame = all.frame(file, 0)?;
        let [cell, count] = [BOX, COUNT].map(|name| all.directory.name(name));
        // Where a frame is damaged, that is said when it is opened.
        let mut cells = Cells::Open.with(true, frame.cell().ok().flatten().as_ref());
        let mut keeps_count = true;
        all.directory.later(file, |entry| {
            if Some(entry.name) == cell
                && !matches!(cells, Cells::Other(_))
                && let Ok(own) = frame.cell_of(&entry)
            {
                cells = cells.with(false, Some(&own));
            }
            if Some(entry.name) == count {
                keeps_count &= entry.values(file, COUNT, 1).is_ok_and(|own| own == [frame.first_count as f64]);
            }
        })?;
        (all.cells, all.keeps_count) = (cells, keeps_count);
        Ok(all)
    }

    /// A frame, which is one of the file's.
    fn frame<'a>(&'a self, file: &'a GsdFile, number: u64) -> Result<Frame<'a>, ImportError> {
        let own = match number {
            0 => Vec::new(),
            _ => self.directory.frame(file, number)?,
        };
        let mut frame = Frame { file, all: self, number, own, count: 0, first_count: 0 };
        let count = |entry: Option<&Entry>| {
            let stored = entry.map(|entry| entry.values(file, COUNT, 1)).transpose()?;
            Ok::<_, ImportError>(stored.map_or(0, |values| values.iter().map(|count| *count as u64).sum::<u64>()))
        };
        frame.first_count = count(frame.first(COUNT))?;
        frame.count = count(frame.of_frame(COUNT))?;
        Ok(frame)
    }

    /// What the times of frames are.
    fn time_of(&self) -> TimeOf {
        if self.directory.name(STEP).is_some() {
            TimeOf::Step
        } else if self.directory.frames > 1 {
            TimeOf::Frame
        } else {
            TimeOf::Nothing
        }
    }
}

/// A frame.
struct Frame<'a> {
    file: &'a GsdFile,
    all: &'a Trajectory,
    number: u64,
    /// Its own chunks; those of the first frame are known.
    own: Vec<Entry>,
    /// How many particles it has, and the first frame.
    count: u64,
    first_count: u64,
}

impl Frame<'_> {
    fn find<'b>(&self, entries: &'b [Entry], name: &str) -> Option<&'b Entry> {
        let name = self.all.directory.name(name)?;
        entries.iter().find(|entry| entry.name == name)
    }

    /// The first frame's chunk of a name.
    fn first(&self, name: &str) -> Option<&Entry> {
        self.find(&self.all.first, name)
    }

    /// The chunk of a name that holds for the frame.
    fn of_frame(&self, name: &str) -> Option<&Entry> {
        self.find(&self.own, name).or_else(|| self.first(name))
    }

    /// The same of what is stored for each particle.
    fn of_particles(&self, name: &str) -> Option<&Entry> {
        let own = self.find(&self.own, name);
        own.or_else(|| self.first(name).filter(|_| self.count == self.first_count))
    }

    /// What a chunk of this name is in messages.
    fn field(&self, name: &str) -> String {
        format!("frame {}: {name}", self.number)
    }

    fn wrong(&self, name: &str, found: impl ToString, expected: impl Into<String>) -> ImportError {
        ImportError::malformed(&self.file.path, self.field(name), found, expected)
    }

    /// The time step.
    fn step(&self) -> Result<f64, ImportError> {
        let stored = self.of_frame(STEP).map(|entry| entry.values(self.file, STEP, 1)).transpose()?;
        Ok(stored.map_or(0.0, |values| values.iter().sum::<f64>()))
    }

    /// The cell.
    fn cell(&self) -> Result<Option<Cell>, ImportError> {
        self.of_frame(BOX).map(|entry| self.cell_of(entry)).transpose()
    }

    /// The cell that a chunk of its lengths and tilts says.
    fn cell_of(&self, entry: &Entry) -> Result<Cell, ImportError> {
        let values = entry.values(self.file, BOX, 6)?;
        let dimensions = self.first(DIMENSIONS).map(|entry| entry.values(self.file, DIMENSIONS, 1)).transpose()?;
        let [x, y, z, xy, xz, yz] = std::array::from_fn(|at| values.get(at).copied().unwrap_or_default());
        let edges = [[x, 0.0, 0.0], [xy * y, y, 0.0], [xz * z, yz * z, z]];
        let corner = std::array::from_fn(|axis| -0.5 * edges.iter().map(|edge| edge[axis]).sum::<f64>());
        let is_flat = dimensions.is_some_and(|dimensions| dimensions == [2.0]);
        let cell = Cell { corner, edges, periodic: [true, true, !is_flat] };
        match cell.is_finite() {
            true => Ok(cell),
            false => Err(self.wrong(BOX, format!("{values:?}"), "finite numbers")),
        }
    }

    /// What a chunk has of each particle.
    fn components(&self, entry: &Entry, name: &str, width: u64) -> Result<Vec<Component>, ImportError> {
        if (entry.rows, entry.columns) != (self.count, width) {
            return Err(self.wrong(name, entry.shape(), format!("{} x {width} numbers", self.count)));
        }
        let first = entry.column(self.file, name)?;
        let offset = |column: u64| first.offset + column * first.number.size() as u64;
        Ok((0..width).map(|column| Component::plain(Column { offset: offset(column), ..first })).collect())
    }

    /// The same, or the default where the frame has none and the file knows the name.
    fn with_default(&self, name: &str, default: &[f64]) -> Result<Option<Vec<Component>>, ImportError> {
        match self.of_particles(name) {
            Some(entry) => self.components(entry, name, default.len() as u64).map(Some),
            None if self.all.directory.name(name).is_some() => {
                Ok(Some(default.iter().map(|value| Component::Constant(*value)).collect()))
            }
            None => Ok(None),
        }
    }

    /// The fields of particles, whose places are taken from a corner.
    fn fields(&self, corner: [f64; 3], notes: &mut Vec<String>) -> Result<FieldList, ImportError> {
        let mut fields = FieldList::default();
        let position = self.of_particles(POSITION);
        let missing = || ImportError::missing(&self.file.path, self.field(POSITION), "a chunk of places");
        let mut position = self.components(position.ok_or_else(missing)?, POSITION, 3)?;
        for (component, corner) in position.iter_mut().zip(corner) {
            if let Component::Stored(_, meaning) = component
                && corner != 0.0
            {
                *meaning = Meaning::Linear { factor: 1.0, first: -corner };
            }
        }
        fields.push("position", POSITION, FieldKind::Position, position);
        if self.all.keeps_count {
            // Particles stand in the order of their tags.
            fields.push("id", "row", FieldKind::Id, vec![Component::Row]);
        }
        for (stored_as, name, kind, default) in PARTICLES {
            if let Some(components) = self.with_default(stored_as, default)? {
                fields.push(name, stored_as, kind, components);
            }
        }
        if let Some(diameter) = self.with_default(DIAMETER, &[1.0])? {
            self.push_diameter(diameter, &mut fields, notes)?;
        }
        let of_first = self.all.first.iter().filter(|_| self.count == self.first_count);
        let mut seen = HashSet::new();
        for entry in self.own.iter().chain(of_first) {
            let name = self.all.directory.names.get(entry.name).map_or("", String::as_str);
            let is_known = OTHERS.contains(&name) || PARTICLES.iter().any(|(stored_as, ..)| *stored_as == name);
            let is_logged = name.starts_with("log/particles/") && entry.rows == self.count;
            if is_known || !(is_logged || name.starts_with("particles/")) || !seen.insert(name) {
                continue;
            }
            if entry.is_text() || !(1..=MOST_COMPONENTS).contains(&entry.columns) {
                let what = if entry.is_text() { "text".into() } else { entry.shape() };
                notes.push(format!("{name}: {what}, left out"));
                continue;
            }
            let components = self.components(entry, name, entry.columns)?;
            let last = name.rsplit('/').next().unwrap_or(name);
            fields.push(&last.replace('_', "-"), name, FieldKind::Other, components);
        }
        Ok(fields)
    }

    /// Adds half of a diameter as the smoothing length, so that a particle is as large as it says, or the diameter itself where not all have one.
    fn push_diameter(
        &self,
        diameter: Vec<Component>,
        fields: &mut FieldList,
        notes: &mut Vec<String>,
    ) -> Result<(), ImportError> {
        let half = match diameter[..] {
            [Component::Stored(column, _)] => {
                let storages = std::slice::from_ref(&self.file.storage);
                let are_all = all_positive(&self.file.path, storages, column, self.count)?;
                are_all.then_some(Component::Stored(column, Meaning::Linear { factor: 0.5, first: 0.0 }))
            }
            _ => Some(Component::Constant(0.5)),
        };
        match half {
            Some(half) => {
                fields.push("smoothing-length", DIAMETER, FieldKind::SmoothingLength, vec![half]);
                notes.push("smoothing lengths are half the diameters".into());
            }
            None => fields.push("diameter", DIAMETER, FieldKind::Other, diameter),
        }
        Ok(())
    }

    /// The names of types.
    fn types(&self) -> Result<Vec<String>, ImportError> {
        let Some(entry) = self.of_frame(TYPES) else { return Ok(vec!["A".into()]) };
        let letters = entry.rows.checked_mul(entry.columns).filter(|letters| *letters <= MOST_LETTERS);
        let Some(letters) = letters.filter(|_| entry.rows <= MOST_TYPES) else {
            let expected = format!("at most {MOST_TYPES} types with {MOST_LETTERS} letters");
            return Err(self.wrong(TYPES, entry.shape(), expected));
        };
        // Letters are stored as numbers with a sign or without.
        let bytes: Vec<u8> =
            entry.values(self.file, TYPES, letters)?.into_iter().map(|letter| letter as i64 as u8).collect();
        let name = |row: &[u8]| {
            let letters = row.split(|byte| *byte == 0).next().unwrap_or_default();
            String::from_utf8_lossy(letters).to_lowercase().replace('_', "-")
        };
        Ok(bytes.chunks(entry.columns.max(1) as usize).map(name).collect())
    }

    /// The rows of particles by type.
    fn rows(&self, types: u64) -> Result<BTreeMap<u64, (u64, Vec<Run>)>, ImportError> {
        let mut found: BTreeMap<u64, (u64, Vec<Run>)> = BTreeMap::new();
        let column = match self.of_particles(TYPE) {
            Some(entry) => match self.components(entry, TYPE, 1)?[..] {
                [Component::Stored(column, _)] => Some(column),
                _ => None,
            },
            None => None,
        };
        let Some(column) = column else {
            found.insert(0, (self.count, vec![Run::WHOLE]));
            return Ok(found);
        };
        let (mut last, mut wrong) = (None, None);
        let storages = std::slice::from_ref(&self.file.storage);
        each_number(&self.file.path, storages, column, self.count, |row, number| {
            let kind = number as u64;
            let is_room = found.len() < MOST_FAMILIES || found.contains_key(&kind);
            if kind as f64 != number || kind >= types || !is_room {
                wrong = wrong.or(Some(number));
                return;
            }
            let (particles, runs) = found.entry(kind).or_default();
            if last != Some(kind) {
                runs.push(Run { particle: *particles, row, ..Run::WHOLE });
            }
            *particles += 1;
            last = Some(kind);
        })?;
        match wrong {
            None => Ok(found),
            Some(number) => {
                let expected = format!("one of {types} types, of which {MOST_FAMILIES} may have particles");
                Err(self.wrong(TYPE, number, expected))
            }
        }
    }

    /// A family for each type that has particles.
    fn families(&self, fields: &FieldList) -> Result<Vec<(FamilyInfo, TypedFamily)>, ImportError> {
        let types = self.types()?;
        let mut families: Vec<(FamilyInfo, TypedFamily)> = Vec::new();
        for (number, (count, runs)) in self.rows(types.len() as u64)? {
            let number = number as usize;
            let (before, own) = (types.get(..number).unwrap_or_default(), types.get(number));
            let is_free = |name: &FamilyName| families.iter().all(|(info, _)| info.name != *name);
            // The same type has the same name in every frame, whichever others it has.
            let plain = own.filter(|own| !before.contains(own)).and_then(|own| FamilyName::parse(own));
            let other = || FamilyName::parse(&format!("type-{number}"));
            let Some(name) = plain.filter(is_free).or_else(other).filter(is_free) else {
                let expected = format!("other names than that of type {number}");
                return Err(self.wrong(TYPES, format!("type-{number}"), expected));
            };
            families.push(fields.clone().family(name, count, runs));
        }
        families.sort_by_key(|(info, _)| info.name);
        Ok(families)
    }

    /// Bytes of the chunks that it has itself.
    fn bytes(&self) -> u64 {
        let own = if self.number == 0 { &self.all.first } else { &self.own };
        own.iter().filter_map(Entry::bytes).fold(0, u64::saturating_add)
    }
}

/// Opens a frame: the first one, unless told which.
fn open(path: &Path, step: Option<u64>, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
    let all = trajectory(path)?;
    let steps = all.directory.frames;
    let number = step.unwrap_or(0);
    if number >= steps {
        return Err(ImportError::malformed(path, "frame", number, format!("a frame from 0 to {}", steps - 1)));
    }
    let file = GsdFile::open(path, method)?;
    let frame = all.frame(&file, number)?;
    if frame.count == 0 {
        return Err(ImportError::NoParticles { path: path.into(), field: frame.field(COUNT) });
    }
    let is_one_of_many = steps > 1;
    let named = if is_one_of_many || step.is_some() { step_name(path, number) } else { path.to_owned() };
    let bytes = if is_one_of_many { frame.bytes().min(file.length) } else { file.length };
    let mut about = Description { steps, ..Description::unitless(&named, "gsd", bytes) };
    let time_of = all.time_of();
    about.time = match time_of {
        TimeOf::Step => Some(frame.step()?),
        TimeOf::Frame => Some(number as f64),
        TimeOf::Stated | TimeOf::Nothing => None,
    };
    about.notes.extend(first_of(steps, step.is_some()));
    about.notes.extend(time_of.note().map(str::to_owned));
    let cell = frame.cell()?;
    let corner = match all.cells {
        Cells::Cube(edge, corner) => {
            about.box_size = Some(edge);
            corner
        }
        _ => [0.0; 3],
    };
    let mut fields = frame.fields(corner, &mut about.notes)?;
    let images = match (all.cells, frame.of_particles(IMAGE)) {
        (Cells::Other(_), Some(entry)) => Some(frame.components(entry, IMAGE, 3)?),
        _ => None,
    };
    let images = images.zip(cell);
    about.notes.extend(all.cells.note(images.is_some()));
    let followed = images.map(|(images, cell)| {
        // The last of all fields, as others of its kind come before it.
        fields.push("image", IMAGE, FieldKind::Other, images);
        cell
    });
    let families = frame.families(&fields)?;
    let source = TypedColumns::new(about, vec![file.storage], families);
    Ok(match followed {
        Some(cell) => Box::new(Unwrapped::new(source, cell)),
        None => Box::new(source),
    })
}
