//! Export of a selection as a table: one row for each particle, with its id and every field, from the source at its true precision
//! (or from the page file where the source is gone, within its quantisation).
//!
//! Rows are streamed, so a selection may be larger than memory. The file is written under a temporary name and appears when it is
//! complete.

mod columnwise;
mod csv;
mod fits;
mod frame;
mod gadget;
pub mod gaussian_splats;
pub mod grid;
mod hdf5;
pub mod mesh;
mod parquet;
mod ply;
pub mod rows;
mod stated;
mod vtp;

pub use vtp::escaped as xml_escaped;

use super::batch::{Batch, Gather, Work};
use super::data::Data;
use super::error::ExploreError;
use super::query::{Of, Query, Wanted};
use crate::import::FieldKind;
use crate::model::{FamilyName, Unit};
use crate::store::temporary::{self, Temporary};
use columnwise::Array;
pub use frame::Frame;
use frame::Scaled;
use serde::Serialize;
use stated::Stated;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::Path;
use std::sync::Mutex;

/// What kind of table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Comma-separated values with a header that names columns and units: `x [Mpc/h]`.
    Csv,
    /// Apache Parquet, with units as metadata.
    Parquet,
    /// Points in the polygon file format, binary, with units as comments.
    Ply,
    /// A binary table of FITS, with units.
    Fits,
    /// VTK's points in XML, with units as labels.
    Vtp,
    /// HDF5 in the layout of Gadget's snapshots, with units as attributes.
    Gadget,
}

impl Format {
    /// The endings of names that ask for a format, as messages list them.
    pub const ENDINGS: &'static str = ".csv, .parquet, .ply, .fits, .vtp or .hdf5";

    /// The format that a file's name asks for.
    pub fn of(path: &Path) -> Option<Format> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "csv" => Some(Format::Csv),
            "parquet" | "pq" => Some(Format::Parquet),
            "ply" => Some(Format::Ply),
            "fits" | "fit" => Some(Format::Fits),
            "vtp" => Some(Format::Vtp),
            "hdf5" | "h5" => Some(Format::Gadget),
            _ => None,
        }
    }

    /// The ending of its files' names.
    pub fn extension(self) -> &'static str {
        match self {
            Format::Csv => "csv",
            Format::Parquet => "parquet",
            Format::Ply => "ply",
            Format::Fits => "fits",
            Format::Vtp => "vtp",
            Format::Gadget => "hdf5",
        }
    }
}

/// What was written.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Exported {
    /// Rows.
    pub rows: u64,
    /// Names of the columns, in order.
    pub columns: Vec<String>,
    /// Whether values are the source's own; otherwise those of a page file, and there are no ids.
    pub exact: bool,
    /// Size of the file, bytes.
    pub bytes: u64,
}

/// Writes a selection to the file `out`. Regions are those of the data, whatever the frame.
///
/// # Errors
/// [`ExploreError`] when the data cannot be read or the file not be written; a file that was there before stays as it was.
pub fn export<'a>(
    data: Data,
    of: impl Into<Of<'a>>,
    format: Format,
    frame: &Frame,
    out: &Path,
    periodic: Option<f64>,
    work: Work,
) -> Result<Exported, ExploreError> {
    let layout = Layout { frame: frame.clone(), ..Layout::of(data, *frame != Frame::Stored) };
    let wanted = match data {
        Data::Source(_) => Wanted { rows: true, ..Wanted::default() },
        Data::Pages(_) => Wanted { columns: layout.names.clone(), ..Wanted::default() },
    };
    let query = Query::new(data, of.into(), wanted, periodic)?;
    let failed = |source| ExploreError::io(out, "writing", source);
    temporary::clean(out, temporary::folder_of(out));
    let file = Temporary::create(out, None).map_err(failed)?;
    let to = BufWriter::with_capacity(1 << 20, file.file());
    let rows = match format {
        Format::Csv => write(data, &query, &layout, csv::Csv::new(to, &layout).map_err(failed)?, out, work)?,
        Format::Ply => write(data, &query, &layout, ply::Ply::new(to, &layout).map_err(failed)?, out, work)?,
        Format::Parquet => {
            let about = metadata(data, &layout);
            write(data, &query, &layout, parquet::Parquet::new(to, &layout, about).map_err(failed)?, out, work)?
        }
        Format::Fits => {
            let about = metadata(data, &layout);
            let table = fits::Fits::new(to, &layout, &Stated::of(data, frame), &about).map_err(failed)?;
            write(data, &query, &layout, table, out, work)?
        }
        Format::Vtp => {
            let table = vtp::Vtp::new(to, &layout, &Stated::of(data, frame), out).map_err(failed)?;
            write(data, &query, &layout, table, out, work)?
        }
        Format::Gadget => {
            let table = gadget::Gadget::new(to, &layout, Stated::of(data, frame), out).map_err(failed)?;
            write(data, &query, &layout, table, out, work)?
        }
    };
    let bytes = file.file().metadata().map_err(failed)?.len();
    file.persist(out).map_err(failed)?;
    let columns = layout.columns.iter().map(|column| column.name.clone());
    let ids = layout.has_ids.then(|| "id".to_owned());
    let columns = ["family".to_owned()].into_iter().chain(ids).chain(columns).collect();
    Ok(Exported { rows, columns, exact: data.is_exact(), bytes })
}

fn write<T: Table>(
    data: Data,
    query: &Query,
    layout: &Layout,
    table: T,
    out: &Path,
    work: Work,
) -> Result<u64, ExploreError> {
    let writing = Writing { layout, out, doing: "writing", table: Mutex::new(table) };
    let rows: Vec<Piece<T>> = query.ask(data, &writing, work)?;
    // What has been joined is written; nothing is left over.
    debug_assert!(rows.is_empty());
    let table = writing.table.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
    table.finish().map_err(|source| ExploreError::io(out, "writing", source))
}

/// What is said about the whole table.
fn metadata(data: Data, layout: &Layout) -> Vec<(String, String)> {
    let mut about = vec![
        ("deepfield.source".to_owned(), data.path().display().to_string()),
        ("deepfield.exact".to_owned(), data.is_exact().to_string()),
    ];
    let units = layout.columns.iter().filter(|column| !column.unit.is_unknown());
    about.extend(units.map(|column| (format!("unit.{}", column.name), column.unit.0.clone())));
    about
}

/// A column of numbers.
#[derive(Clone, Debug, PartialEq)]
struct Column {
    name: String,
    unit: Unit,
    /// How it depends on the frame.
    scaled: Option<Scaled>,
}

/// Where a column of a family comes from: field and component; of a page file field 0 is the position, and 1 and on are the columns
/// that were asked for.
type From = Option<(usize, usize)>;

/// The columns after `family` and `id`, and where they come from.
struct Layout {
    has_ids: bool,
    /// Whether every family has ids.
    all_have_ids: bool,
    columns: Vec<Column>,
    /// By family and column.
    from: Vec<Vec<From>>,
    /// Number of components of each field, by family.
    components: Vec<Vec<usize>>,
    families: Vec<FamilyName>,
    /// Fields to ask a page file for.
    names: Vec<String>,
    frame: Frame,
}

impl Layout {
    /// `physical`: whether units have no powers of the scale factor.
    fn of(data: Data, physical: bool) -> Layout {
        let mut layout = Layout {
            has_ids: false,
            all_have_ids: matches!(data, Data::Source(_)),
            columns: Vec::new(),
            from: Vec::new(),
            components: Vec::new(),
            families: data.families().into_iter().map(|(name, _)| name).collect(),
            names: Vec::new(),
            frame: Frame::Stored,
        };
        match data {
            Data::Source(source) => {
                let about = source.description();
                for info in &about.families {
                    layout.family();
                    layout.has_ids |= info.find(FieldKind::Id).is_some();
                    layout.all_have_ids &= info.find(FieldKind::Id).is_some();
                    for (index, field) in info.fields.iter().enumerate() {
                        layout.component_of(field.components);
                        if field.kind == FieldKind::Id {
                            continue;
                        }
                        let unit = if field.kind == FieldKind::Position { &about.length_unit } else { &field.unit };
                        for component in 0..field.components {
                            let name = column_name(&field.name, field.kind, component, field.components);
                            layout.column(name, unit, Scaled::of(&field.name, field.kind), (index, component));
                        }
                    }
                }
            }
            Data::Pages(file) => {
                for family in &file.metadata().families {
                    for info in family.quantities.iter().chain(&family.attributes) {
                        if !layout.names.contains(&info.name) {
                            layout.names.push(info.name.clone());
                        }
                    }
                }
                for family in &file.metadata().families {
                    layout.family();
                    layout.component_of(3);
                    for component in 0..3 {
                        let name = column_name("position", FieldKind::Position, component, 3);
                        layout.column(name, &file.metadata().length_unit, None, (0, component));
                    }
                    for info in family.quantities.iter().chain(&family.attributes) {
                        let index = layout.names.iter().position(|name| *name == info.name).unwrap_or(0);
                        layout.column(info.name.clone(), &info.unit, None, (1 + index, 0));
                    }
                }
            }
        }
        let columns = layout.columns.len();
        layout.from.iter_mut().for_each(|from| from.resize(columns, None));
        for column in layout.columns.iter_mut().filter(|column| physical && column.scaled.is_some()) {
            column.unit = column.unit.without_scale_factor();
        }
        layout
    }

    /// Leaves out all columns but those of these names: a column's own, or that of the quantity whose components some are. Ids are among them where
    /// they are named.
    fn only(&mut self, data: Data, fields: &[String]) -> Result<(), ExploreError> {
        let arrays = Array::all(&self.columns);
        let mut kept: Vec<usize> = Vec::new();
        let mut names_ids = false;
        for field in fields {
            if field == "id" && self.has_ids {
                names_ids = true;
                continue;
            }
            let own = self.columns.iter().position(|column| column.name == *field).map(|at| at..at + 1);
            let components = || arrays.iter().find(|array| array.name == *field).map(|array| array.columns.clone());
            let found = own.or_else(components).ok_or_else(|| {
                let names: Vec<&str> = self.columns.iter().map(|column| column.name.as_str()).collect();
                let ids = if self.has_ids { "id, " } else { "" };
                let expected = format!("one of {ids}{}", names.join(", "));
                ExploreError::missing(data.path(), format!("field {field}"), expected)
            })?;
            for column in found {
                if !kept.contains(&column) {
                    kept.push(column);
                }
            }
        }
        self.has_ids = names_ids;
        self.columns = kept.iter().map(|&column| self.columns[column].clone()).collect();
        for from in &mut self.from {
            *from = kept.iter().map(|&column| from[column]).collect();
        }
        if let Data::Pages(_) = data {
            // Those are asked for alone that are kept; field 0 is the position.
            let mut names = Vec::new();
            for (field, _) in self.from.iter_mut().flatten().flatten().filter(|(field, _)| *field > 0) {
                let name = &self.names[*field - 1];
                *field = 1 + names.iter().position(|other| other == name).unwrap_or_else(|| {
                    names.push(name.clone());
                    names.len() - 1
                });
            }
            self.names = names;
        }
        Ok(())
    }

    /// The names of the fields of a source that the columns are of.
    fn fields_of(&self, data: Data) -> Vec<String> {
        let Data::Source(source) = data else { return Vec::new() };
        let families = source.description().families.iter().zip(&self.from);
        let named =
            families.flat_map(|(info, from)| from.iter().flatten().map(move |(field, _)| &info.fields[*field].name));
        let mut names: Vec<String> = named.cloned().collect();
        names.sort_unstable();
        names.dedup();
        names
    }

    fn family(&mut self) {
        self.from.push(vec![None; self.columns.len()]);
        self.components.push(Vec::new());
    }

    fn component_of(&mut self, components: usize) {
        if let Some(last) = self.components.last_mut() {
            last.push(components);
        }
    }

    /// Notes that the last family has a column; the first one of a name counts.
    fn column(&mut self, name: String, unit: &Unit, scaled: Option<Scaled>, from: (usize, usize)) {
        let index = self.columns.iter().position(|column| column.name == name).unwrap_or_else(|| {
            self.columns.push(Column { name, unit: unit.clone(), scaled });
            self.columns.len() - 1
        });
        if let Some(family) = self.from.last_mut() {
            family.resize(family.len().max(index + 1), None);
            family[index] = family[index].or(Some(from));
        }
    }

    /// The rows of a batch as columns.
    fn block(&self, batch: &Batch) -> Block {
        let values = |&(field, component): &(usize, usize)| -> Vec<f64> {
            if batch.rows.is_empty() {
                return match field {
                    0 => batch.positions.iter().map(|at| at[component]).collect(),
                    field => batch.columns.get(field - 1).cloned().unwrap_or_default(),
                };
            }
            let components = self.components[batch.family][field];
            batch.rows[field].iter().skip(component).step_by(components).copied().collect()
        };
        let mut columns: Vec<_> = self.from[batch.family].iter().map(|from| from.as_ref().map(values)).collect();
        self.frame.apply(self, &mut columns);
        Block {
            family: self.families[batch.family],
            rows: batch.len(),
            has_ids: self.has_ids,
            ids: (!batch.ids.is_empty()).then(|| batch.ids.clone()),
            columns,
        }
    }
}

/// `x`, `vx`, `metallicity`, `acceleration-x`, `abundances-7`.
pub(in crate::explore) fn column_name(field: &str, kind: FieldKind, component: usize, components: usize) -> String {
    let axis = ["x", "y", "z"].get(component).filter(|_| components == 3);
    match (kind, axis) {
        (FieldKind::Position, Some(axis)) => (*axis).to_owned(),
        (FieldKind::Velocity, Some(axis)) => format!("v{axis}"),
        (_, Some(axis)) => format!("{field}-{axis}"),
        (_, None) if components == 1 => field.to_owned(),
        (_, None) => format!("{field}-{component}"),
    }
}

/// Rows of one family as columns of one length; `None` for what the family does not have.
struct Block {
    family: FamilyName,
    rows: usize,
    /// Whether the table has a column of ids.
    has_ids: bool,
    ids: Option<Vec<u64>>,
    columns: Vec<Option<Vec<f64>>>,
}

impl Block {
    /// Its rows as bytes, and how many there are: the type of Gadget or 255, the id, all bits set where there is none, and each column.
    fn packed(&self, id_bytes: impl Fn(u64) -> [u8; 8], value_bytes: impl Fn(f64) -> [u8; 8]) -> (Vec<u8>, usize) {
        let mut bytes = Vec::with_capacity(self.rows * (9 + 8 * self.columns.len()));
        for row in 0..self.rows {
            bytes.push(self.family.gadget_type().unwrap_or(u8::MAX));
            if self.has_ids {
                let id = self.ids.as_ref().and_then(|ids| ids.get(row)).copied().unwrap_or(u64::MAX);
                bytes.extend(id_bytes(id));
            }
            for column in &self.columns {
                let value = column.as_ref().and_then(|column| column.get(row)).copied().unwrap_or(f64::NAN);
                bytes.extend(value_bytes(value));
            }
        }
        (bytes, self.rows)
    }
}

/// A kind of table that rows are written to.
trait Table: Send {
    /// What becomes of a block before its turn to be written comes.
    type Piece: Send;

    /// Prepares a block; many at a time.
    fn prepare(block: Block) -> Self::Piece;

    /// Writes what was prepared; one after the other, in order.
    fn write(&mut self, piece: Self::Piece) -> io::Result<()>;

    /// Writes what is left, and tells the number of rows.
    fn finish(self) -> io::Result<u64>;
}

type Piece<T> = <T as Table>::Piece;

struct Writing<'a, T> {
    layout: &'a Layout,
    /// The file that errors name, and what is done.
    out: &'a Path,
    doing: &'static str,
    table: Mutex<T>,
}

impl<T: Table> Gather for Writing<'_, T> {
    type Part = Vec<T::Piece>;

    fn part(&self) -> Vec<T::Piece> {
        Vec::new()
    }

    fn take(&self, part: &mut Vec<T::Piece>, batch: &Batch) {
        if !batch.is_empty() {
            part.push(T::prepare(self.layout.block(batch)));
        }
    }

    fn join(&self, _whole: &mut Vec<T::Piece>, next: Vec<T::Piece>) -> Result<(), ExploreError> {
        let mut table = self.table.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let written = next.into_iter().try_for_each(|piece| table.write(piece));
        written.map_err(|source| ExploreError::io(self.out, self.doing, source))
    }
}

/// Where tables are written.
pub type Out<'a> = BufWriter<&'a File>;
