//! A selection's rows in memory, column by column: what a table file would hold, for programs that go on computing with it.

use super::{Block, Layout, Writing};
use crate::explore::batch::Work;
use crate::explore::data::Data;
use crate::explore::error::ExploreError;
use crate::explore::query::{Of, Query, Wanted};
use crate::model::{FamilyName, Unit};
use std::io;
use std::sync::Mutex;

/// The id in rows of a family that has none, where others have some.
pub const NO_ID: u64 = u64::MAX;

/// Rows as columns of one length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rows {
    /// The families of the data.
    pub families: Vec<FamilyName>,
    /// Of each row the place of its family among [`Rows::families`].
    pub family: Vec<u16>,
    /// Ids, where there are any; [`NO_ID`] in rows of a family without.
    pub ids: Option<Vec<u64>>,
    /// Numbers by name, as tables have them.
    pub columns: Vec<RowColumn>,
    /// Whether values are the source's own; otherwise those of a page file, and there are no ids.
    pub exact: bool,
}

/// A column of numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct RowColumn {
    /// Its name: `x`, `vx`, `temperature`, `acceleration-x`.
    pub name: String,
    /// Its unit.
    pub unit: Unit,
    /// A number a row; NaN in rows of a family without.
    pub values: Vec<f64>,
}

/// Reads the rows of a selection. `fields` names the columns, or all of the components of a quantity such as `position`, and `id`; everything without.
/// They may take `memory` bytes.
///
/// # Errors
/// [`ExploreError`] when the data cannot be read, has no such field, or rows take more memory.
pub fn rows<'a>(
    data: Data,
    of: impl Into<Of<'a>>,
    fields: Option<&[String]>,
    memory: u64,
    periodic: Option<f64>,
    work: Work,
) -> Result<Rows, ExploreError> {
    let mut layout = Layout::of(data, false);
    if let Some(fields) = fields {
        layout.only(data, fields)?;
    }
    let wanted = match data {
        Data::Source(_) => Wanted { rows: true, only: fields.map(|_| layout.fields_of(data)), ..Wanted::default() },
        Data::Pages(_) => Wanted { columns: layout.names.clone(), ..Wanted::default() },
    };
    let query = Query::new(data, of.into(), wanted, periodic)?;
    let columns = layout.columns.iter();
    let columns =
        columns.map(|column| RowColumn { name: column.name.clone(), unit: column.unit.clone(), values: Vec::new() });
    let whole = Rows {
        families: layout.families.clone(),
        family: Vec::new(),
        ids: layout.has_ids.then(Vec::new),
        columns: columns.collect(),
        exact: data.is_exact(),
    };
    let table = InMemory { rows: whole, memory };
    let writing = Writing { layout: &layout, out: data.path(), doing: "selecting", table: Mutex::new(table) };
    query.ask(data, &writing, work)?;
    let table = writing.table.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
    Ok(table.rows)
}

/// Rows that grow.
struct InMemory {
    rows: Rows,
    /// Bytes that they may take.
    memory: u64,
}

impl super::Table for InMemory {
    type Piece = Block;

    fn prepare(block: Block) -> Block {
        block
    }

    fn write(&mut self, block: Block) -> io::Result<()> {
        let InMemory { rows, memory } = self;
        let count = rows.family.len() + block.rows;
        let each = size_of::<u16>() + size_of::<u64>() * (usize::from(rows.ids.is_some()) + rows.columns.len());
        if (count as u64).saturating_mul(each as u64) > *memory {
            let found = format!("found {count} rows and more of {each} bytes each");
            let expected = format!("at most {memory} bytes: a smaller region, fewer fields or more memory");
            return Err(io::Error::other(format!("{found}, expected {expected}")));
        }
        let family = rows.families.iter().position(|family| *family == block.family).unwrap_or_default();
        rows.family.resize(count, family as u16);
        if let Some(ids) = &mut rows.ids {
            ids.extend_from_slice(&block.ids.unwrap_or_default());
            ids.resize(count, NO_ID);
        }
        for (column, own) in rows.columns.iter_mut().zip(block.columns) {
            column.values.extend_from_slice(&own.unwrap_or_default());
            column.values.resize(count, f64::NAN);
        }
        Ok(())
    }

    fn finish(self) -> io::Result<u64> {
        Ok(self.rows.family.len() as u64)
    }
}
