//! Apache Parquet. A row group holds rows of one family, so a column is there for all of its rows or for none.

use super::{Block, Layout, Out, Table};
use crate::columnar::{ColumnKind, ColumnValues, TableWriter};
use std::io;

/// Rows of a row group at most, but for the last block that is added.
const GROUP_ROWS: usize = 1 << 18;

pub(super) struct Parquet<'a> {
    table: TableWriter<Out<'a>>,
    /// Rows that wait for their row group to be full.
    waiting: Option<Block>,
    rows: u64,
}

impl<'a> Parquet<'a> {
    pub(super) fn new(out: Out<'a>, layout: &Layout, about: Vec<(String, String)>) -> io::Result<Parquet<'a>> {
        let ids = layout.has_ids.then(|| ("id".to_owned(), ColumnKind::Whole));
        let numbers = layout.columns.iter().map(|column| (column.name.clone(), ColumnKind::Number));
        let columns: Vec<(String, ColumnKind)> =
            [("family".to_owned(), ColumnKind::Text)].into_iter().chain(ids).chain(numbers).collect();
        Ok(Parquet { table: TableWriter::new(out, &columns, about)?, waiting: None, rows: 0 })
    }

    /// Writes the rows that wait as a row group.
    fn flush(&mut self) -> io::Result<()> {
        let Some(block) = self.waiting.take() else { return Ok(()) };
        let ids = block.has_ids.then_some(ColumnValues::Whole(block.ids.as_deref()));
        let numbers = block.columns.iter().map(|column| ColumnValues::Numbers(column.as_deref()));
        let family = ColumnValues::Text(block.family.as_str());
        let values: Vec<ColumnValues> = [family].into_iter().chain(ids).chain(numbers).collect();
        self.rows += block.rows as u64;
        self.table.write_rows(block.rows, &values)
    }
}

impl Table for Parquet<'_> {
    type Piece = Block;

    fn prepare(block: Block) -> Block {
        block
    }

    fn write(&mut self, next: Block) -> io::Result<()> {
        match &mut self.waiting {
            Some(waiting) if waiting.family == next.family => waiting.append(next),
            _ => {
                self.flush()?;
                self.waiting = Some(next);
            }
        }
        match &self.waiting {
            Some(waiting) if waiting.rows >= GROUP_ROWS => self.flush(),
            _ => Ok(()),
        }
    }

    fn finish(mut self) -> io::Result<u64> {
        self.flush()?;
        self.table.finish()?;
        Ok(self.rows)
    }
}

impl Block {
    /// Adds rows of the same family.
    fn append(&mut self, next: Block) {
        self.rows += next.rows;
        if let (Some(ids), Some(next)) = (&mut self.ids, next.ids) {
            ids.extend(next);
        }
        for (own, next) in self.columns.iter_mut().zip(next.columns) {
            if let (Some(own), Some(next)) = (own, next) {
                own.extend(next);
            }
        }
    }
}
