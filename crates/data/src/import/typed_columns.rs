//! Sources whose fields are numbers of any type at fixed distances: records of a file, or arrays one behind the other. They are read where
//! they are, by range.

use super::bytes::Order;
use super::check::chunks;
use super::grid::scratch::Storage;
use super::table::STANDARD;
use super::{Description, FamilyInfo, Field, FieldKind, ImportError, Source};
use crate::model::{FamilyName, SampleType, Unit};
use std::cell::RefCell;
use std::ops::Range;
use std::path::Path;

/// The most that is read at once, bytes.
const PIECE: u64 = 1 << 20;

/// Numbers at fixed distances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Column {
    /// Which of the source's storages they are in.
    pub storage: usize,
    /// Byte of the first.
    pub offset: u64,
    /// Bytes from one to the next; at least the size of a number.
    pub stride: u64,
    /// How each is stored.
    pub number: SampleType,
    /// The order of its bytes.
    pub order: Order,
}

/// What becomes of a stored number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Meaning {
    /// It is the value.
    AsStored,
    /// `factor` times the number, and `first` added.
    Linear {
        /// Value by stored number.
        factor: f64,
        /// Value of 0.
        first: f64,
    },
    /// As above, but where the number is `none`, which stands for no value.
    LinearUnless {
        /// As above.
        factor: f64,
        /// As above.
        first: f64,
        /// As it is stored.
        none: f64,
    },
    /// These bits of a whole number from 0 to 255.
    Bits(u8),
    /// A density: the mass of the run by the cube of the number by `factor`.
    MassOverCube {
        /// As above.
        factor: f64,
    },
}

/// One component of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Component {
    /// A column.
    Stored(Column, Meaning),
    /// The mass of the run.
    MassOfRun,
    /// The same for all.
    Constant(f64),
    /// The number of the particle's row in the columns, from 0.
    Row,
}

impl Component {
    /// A column whose numbers are the values.
    pub(super) fn plain(column: Column) -> Component {
        Component::Stored(column, Meaning::AsStored)
    }

    /// Whether its values are whole numbers as they are stored.
    fn is_whole(&self) -> bool {
        match self {
            Component::Stored(column, Meaning::AsStored) => !column.number.is_float(),
            Component::Row => true,
            _ => false,
        }
    }
}

/// Particles of a family that follow each other in the columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Run {
    /// Number of the first in the family.
    pub particle: u64,
    /// Its row in the columns.
    pub row: u64,
    /// Which of the family's parts the columns are of.
    pub part: usize,
    /// Mass of each of them, where the source says so.
    pub mass: f64,
}

impl Run {
    /// All rows.
    pub(super) const WHOLE: Run = Run { particle: 0, row: 0, part: 0, mass: f64::NAN };
}

/// The fields of a family on their way to a source.
#[derive(Clone, Default)]
pub(super) struct FieldList {
    fields: Vec<(Field, Vec<Component>)>,
}

impl FieldList {
    /// Adds a field of a kind. Of several of one name or one kind the first counts; others keep the source's name, numbered where that is
    /// taken, too.
    pub(super) fn push(&mut self, name: &str, stored_as: &str, kind: FieldKind, components: Vec<Component>) {
        let is_free = |name: &str| !self.fields.iter().any(|(field, _)| field.name == name);
        let is_first = kind == FieldKind::Other || !self.fields.iter().any(|(field, _)| field.kind == kind);
        // Names are counted, so that many of one name are not all tried for each.
        let same = self.fields.iter().filter(|(field, _)| field.stored_as == stored_as).count().max(1);
        let numbered = || (same + 1..).map(|number| format!("{stored_as}-{number}")).find(|name| is_free(name));
        let (name, kind) = match (is_first && is_free(name), is_free(stored_as)) {
            (true, _) => (name.to_owned(), kind),
            (false, true) => (stored_as.to_owned(), FieldKind::Other),
            (false, false) => (numbered().unwrap_or_default(), FieldKind::Other),
        };
        let (stored_as, unit) = (stored_as.to_owned(), Unit::default());
        self.fields.push((Field { name, stored_as, unit, components: components.len(), kind }, components));
    }

    /// Adds a scalar: what a table's column of that name is, else an attribute. Ids are whole numbers.
    pub(super) fn push_scalar(&mut self, stored_as: &str, component: Component) {
        let key = stored_as.to_lowercase().replace([' ', '-'], "_");
        let standard = STANDARD.iter().find(|(names, ..)| names.contains(&key.as_str()));
        let standard = standard.filter(|(_, _, kind, _)| *kind != FieldKind::Id || component.is_whole());
        let (name, kind) = standard.map_or((stored_as, FieldKind::Other), |(_, name, kind, _)| (*name, *kind));
        self.push(name, stored_as, kind, vec![component]);
    }

    /// Adds scalars of which some are the axes of vectors: name, names of the axes and kind of each vector.
    pub(super) fn push_named(&mut self, mut scalars: Vec<(String, Component)>, vectors: &[Vector]) {
        for (name, axes, kind) in vectors {
            let places = axes.map(|axis| scalars.iter().position(|(scalar, _)| scalar.eq_ignore_ascii_case(axis)));
            let [Some(x), Some(y), Some(z)] = places else { continue };
            let components = [x, y, z].map(|place| scalars[place].1);
            let stored_as = [x, y, z].map(|place| scalars[place].0.clone()).join(",");
            self.push(name, &stored_as, *kind, components.to_vec());
            let mut number = 0;
            scalars.retain(|_| {
                number += 1;
                ![x, y, z].contains(&(number - 1))
            });
        }
        for (name, component) in scalars {
            self.push_scalar(&name, component);
        }
    }

    /// Gives the field of a kind a unit.
    pub(super) fn set_unit(&mut self, kind: FieldKind, unit: &Unit) {
        for (field, _) in self.fields.iter_mut().filter(|(field, _)| field.kind == kind) {
            field.unit = unit.clone();
        }
    }

    /// Gives the field of a name a unit.
    pub(super) fn set_unit_of(&mut self, name: &str, unit: &Unit) {
        for (field, _) in self.fields.iter_mut().filter(|(field, _)| field.name == name) {
            field.unit = unit.clone();
        }
    }

    /// Gives the field that is stored as this, or whose first axis is, a unit.
    pub(super) fn set_unit_stored_as(&mut self, stored_as: &str, unit: &Unit) {
        let is_meant =
            |field: &Field| field.stored_as == stored_as || field.stored_as.split(',').next() == Some(stored_as);
        for (field, _) in self.fields.iter_mut().filter(|(field, _)| is_meant(field)) {
            field.unit = unit.clone();
        }
    }

    /// The unit of the field of a kind; unknown without one.
    pub(super) fn unit_of(&self, kind: FieldKind) -> Unit {
        let field = self.fields.iter().find(|(field, _)| field.kind == kind);
        field.map(|(field, _)| field.unit.clone()).unwrap_or_default()
    }

    /// Whether it has positions.
    pub(super) fn has_positions(&self) -> bool {
        self.fields.iter().any(|(field, _)| field.kind == FieldKind::Position)
    }

    /// The family of these fields, and where they are. Of particles whose rows are `runs`.
    pub(super) fn family(mut self, name: FamilyName, count: u64, runs: Vec<Run>) -> (FamilyInfo, TypedFamily) {
        self.fields.sort_by_key(|(field, _)| field.kind);
        let (described, fields) = self.fields.into_iter().unzip();
        (FamilyInfo { name, count, fields: described }, TypedFamily { parts: vec![fields], runs })
    }
}

/// Name, names of the axes and kind of a vector.
pub(super) type Vector = (&'static str, [&'static str; 3], FieldKind);

/// Vectors that most files name so.
pub(super) const VECTORS: [Vector; 3] = [
    ("position", ["x", "y", "z"], FieldKind::Position),
    ("velocity", ["vx", "vy", "vz"], FieldKind::Velocity),
    ("normal", ["nx", "ny", "nz"], FieldKind::Other),
];

/// Where the fields of one family are.
pub(super) struct TypedFamily {
    /// By part and field: its components. Parts are apart from each other, in other files or places.
    parts: Vec<Vec<Vec<Component>>>,
    /// In the order of particles, the first of which is in the first; none is empty.
    runs: Vec<Run>,
}

impl TypedFamily {
    /// Adds particles of the same fields, which are elsewhere; `before` particles come before them.
    pub(super) fn extend(&mut self, other: TypedFamily, before: u64) {
        let first = self.parts.len();
        let moved = |run: Run| Run { particle: before + run.particle, part: first + run.part, ..run };
        self.runs.extend(other.runs.into_iter().map(moved));
        self.parts.extend(other.parts);
    }
}

/// An opened source.
pub(super) struct TypedColumns {
    description: Description,
    storages: Vec<Storage>,
    families: Vec<TypedFamily>,
}

impl TypedColumns {
    /// A source of these families. That the columns end before their storages do is up to the caller.
    pub(super) fn new(
        mut description: Description,
        storages: Vec<Storage>,
        families: Vec<(FamilyInfo, TypedFamily)>,
    ) -> TypedColumns {
        let (described, families) = families.into_iter().unzip();
        description.families = described;
        TypedColumns { description, storages, families }
    }

    /// Calls `read(run, row, rows, at)` for every run that holds a part of a range: the part's first row and number of rows, and where it
    /// begins in the range.
    fn runs(
        &self,
        family: usize,
        range: &Range<u64>,
        mut read: impl FnMut(&Run, u64, usize, usize) -> Result<(), ImportError>,
    ) -> Result<(), ImportError> {
        let runs = &self.families[family].runs;
        let mut at = range.start;
        let mut index = runs.partition_point(|run| run.particle <= at).saturating_sub(1);
        while at < range.end {
            let Some(run) = runs.get(index) else { break };
            let end = runs.get(index + 1).map_or(range.end, |next| next.particle.min(range.end));
            let row = run.row + (at - run.particle);
            read(run, row, (end - at) as usize, (at - range.start) as usize)?;
            (at, index) = (end, index + 1);
        }
        Ok(())
    }

    /// Calls `piece(raw, done)` with `rows` records of a column from row `row` on, `span` bytes of each, in pieces of bounded size: `done` of
    /// them came before.
    fn pieces(
        &self,
        column: &Column,
        row: u64,
        rows: usize,
        span: u64,
        mut piece: impl FnMut(&[u8], usize),
    ) -> Result<(), ImportError> {
        let Some(storage) = self.storages.get(column.storage) else { return Ok(()) };
        let most = (PIECE / column.stride.max(1)).max(1) as usize;
        let mut done = 0;
        while done < rows {
            let count = most.min(rows - done);
            let bytes = (count as u64 - 1) * column.stride + span;
            let start = column.offset.saturating_add((row + done as u64).saturating_mul(column.stride));
            RAW.with_borrow_mut(|raw| {
                raw.resize(bytes as usize, 0);
                storage.read(&self.description.path, start, raw)?;
                piece(raw, done);
                Ok::<(), ImportError>(())
            })?;
            done += count;
        }
        Ok(())
    }

    /// Reads `rows` rows from `row` on of a field into `out`, component by component.
    fn rows(
        &self,
        components: &[Component],
        run: &Run,
        row: u64,
        rows: usize,
        out: &mut [f64],
    ) -> Result<(), ImportError> {
        let width = components.len();
        let mut index = 0;
        while let Some(component) = components.get(index) {
            let values = out.iter_mut().skip(index).step_by(width);
            let first = match component {
                Component::Stored(column, _) => column,
                unstored => {
                    match unstored {
                        Component::Row => values.zip(row..).for_each(|(value, row)| *value = row as f64),
                        Component::Constant(same) => values.for_each(|value| *value = *same),
                        _ => values.for_each(|value| *value = run.mass),
                    }
                    index += 1;
                    continue;
                }
            };
            // What lies in one record is read together.
            let end = |column: &Column| column.offset + column.number.size() as u64;
            let is_near = |component: &&Component| match component {
                Component::Stored(other, _) => {
                    (other.storage, other.stride) == (first.storage, first.stride)
                        && other.offset >= first.offset
                        && end(other) <= first.offset.saturating_add(first.stride)
                }
                _ => false,
            };
            let together: Vec<(Column, Meaning)> = components[index..]
                .iter()
                .take_while(is_near)
                .filter_map(|component| match component {
                    Component::Stored(column, meaning) => Some((*column, *meaning)),
                    _ => None,
                })
                .collect();
            let span = together.iter().map(|(column, _)| end(column) - first.offset).max().unwrap_or(1);
            self.pieces(first, row, rows, span, |raw, done| {
                for (place, (column, meaning)) in together.iter().enumerate() {
                    let Some(raw) = raw.get((column.offset - first.offset) as usize..) else { continue };
                    let values = out.iter_mut().skip(done * width + index + place).step_by(width);
                    decode(column, raw, values, |number| meaning.of(number, run.mass));
                }
            })?;
            // A column that does not fit into its own record is left at what it was.
            index += together.len().max(1);
        }
        Ok(())
    }
}

impl Meaning {
    /// The value of a stored number.
    fn of(self, number: f64, mass: f64) -> f64 {
        match self {
            Meaning::AsStored => number,
            Meaning::LinearUnless { none, .. } if number == none => f64::NAN,
            Meaning::Linear { factor, first } | Meaning::LinearUnless { factor, first, .. } => factor * number + first,
            Meaning::Bits(bits) => f64::from(number as u8 & bits),
            Meaning::MassOverCube { factor } => mass * (factor / number).powi(3),
        }
    }
}

impl Source for TypedColumns {
    fn description(&self) -> &Description {
        &self.description
    }

    fn read(&self, family: usize, field: usize, range: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        let width = self.description.check_range(family, field, &range, out.len())?.components;
        self.runs(family, &range, |run, row, rows, at| {
            let out = &mut out[at * width..(at + rows) * width];
            self.rows(&self.families[family].parts[run.part][field], run, row, rows, out)
        })
    }

    fn read_ids(&self, family: usize, field: usize, range: Range<u64>, out: &mut [u64]) -> Result<(), ImportError> {
        let info = self.description.check_range(family, field, &range, out.len())?;
        self.runs(family, &range, |run, row, rows, at| {
            let out = &mut out[at..at + rows];
            match self.families[family].parts[run.part][field][..] {
                [Component::Row] => {
                    out.iter_mut().zip(row..).for_each(|(id, row)| *id = row);
                    Ok(())
                }
                [component @ Component::Stored(column, _)] if component.is_whole() => {
                    let span = column.number.size() as u64;
                    self.pieces(&column, row, rows, span, |raw, done| whole(&column, raw, out.iter_mut().skip(done)))
                }
                _ => {
                    let expected = "a column of whole numbers";
                    Err(ImportError::malformed(&self.description.path, &*info.name, "other numbers", expected))
                }
            }
        })
    }
}

/// Calls `each(row, number)` for every number of a column without gaps.
pub(super) fn each_number(
    path: &Path,
    storages: &[Storage],
    column: Column,
    count: u64,
    mut each: impl FnMut(u64, f64),
) -> Result<(), ImportError> {
    let Some(storage) = storages.get(column.storage) else { return Ok(()) };
    let size = column.number.size();
    let (mut raw, mut values): (Vec<u8>, Vec<f64>) = (Vec::new(), Vec::new());
    for range in chunks(count) {
        raw.resize((range.end - range.start) as usize * size, 0);
        storage.read(path, column.offset + range.start * size as u64, &mut raw)?;
        if column.order != Order::NATIVE {
            raw.chunks_mut(size).for_each(<[u8]>::reverse);
        }
        values.clear();
        column.number.decode(&raw, 1, &mut values);
        range.zip(&values).for_each(|(row, value)| each(row, *value));
    }
    Ok(())
}

/// Whether all numbers of a column without gaps are above 0.
pub(super) fn all_positive(path: &Path, storages: &[Storage], column: Column, count: u64) -> Result<bool, ImportError> {
    let mut all = true;
    each_number(path, storages, column, count, |_, value| all &= value > 0.0 && value.is_finite())?;
    Ok(all)
}

thread_local! {
    /// Bytes on their way from a storage, one buffer per thread.
    static RAW: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
}

/// Puts what `of` makes of the number of `N` bytes, least significant first, at the start of every `stride` bytes into `out`.
fn each<'a, const N: usize, T: 'a>(
    column: &Column,
    raw: &[u8],
    out: impl Iterator<Item = &'a mut T>,
    of: impl Fn([u8; N]) -> T,
) {
    let stride = (column.stride as usize).max(1);
    for (record, out) in raw.chunks(stride).zip(out) {
        if let Some(word) = record.first_chunk::<N>() {
            let mut word = *word;
            if column.order == Order::Big {
                word.reverse();
            }
            *out = of(word);
        }
    }
}

/// Puts the numbers of a column into `out`, as `of` has them.
pub(super) fn decode<'a>(column: &Column, raw: &[u8], out: impl Iterator<Item = &'a mut f64>, of: impl Fn(f64) -> f64) {
    match column.number {
        SampleType::I8 => each(column, raw, out, |b| of(i8::from_le_bytes(b).into())),
        SampleType::U8 => each(column, raw, out, |b| of(u8::from_le_bytes(b).into())),
        SampleType::I16 => each(column, raw, out, |b| of(i16::from_le_bytes(b).into())),
        SampleType::U16 => each(column, raw, out, |b| of(u16::from_le_bytes(b).into())),
        SampleType::I32 => each(column, raw, out, |b| of(i32::from_le_bytes(b).into())),
        SampleType::U32 => each(column, raw, out, |b| of(u32::from_le_bytes(b).into())),
        SampleType::I64 => each(column, raw, out, |b| of(i64::from_le_bytes(b) as f64)),
        SampleType::U64 => each(column, raw, out, |b| of(u64::from_le_bytes(b) as f64)),
        SampleType::F32 => each(column, raw, out, |b| of(f32::from_le_bytes(b).into())),
        SampleType::F64 => each(column, raw, out, |b| of(f64::from_le_bytes(b))),
    }
}

/// Puts the whole numbers of a column into `out`. Negative ones become what their bits mean without a sign.
pub(super) fn whole<'a>(column: &Column, raw: &[u8], out: impl Iterator<Item = &'a mut u64>) {
    match column.number.size() {
        1 => each(column, raw, out, |b| u8::from_le_bytes(b).into()),
        2 => each(column, raw, out, |b| u16::from_le_bytes(b).into()),
        4 => each(column, raw, out, |b| u32::from_le_bytes(b).into()),
        _ => each(column, raw, out, u64::from_le_bytes),
    }
}
