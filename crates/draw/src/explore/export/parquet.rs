//! Apache Parquet: <https://parquet.apache.org/docs/file-format/>. Each column of a row group is one page, in plain encoding,
//! compressed with gzip. A row group holds rows of one family, so a column is there for all of its rows or for none.

use super::thrift::{Struct, varint};
use super::{Block, Layout, Out, Table};
use crate::model::FamilyName;
use flate2::Compression;
use flate2::write::GzEncoder;
use rayon::prelude::*;
use std::io::{self, Write};

const MAGIC: &[u8; 4] = b"PAR1";

/// Rows of a row group at most, but for the last block that is added.
const GROUP_ROWS: usize = 1 << 18;

/// Numbers of the format's enumerations.
const INT64: i32 = 2;
const DOUBLE: i32 = 5;
const BYTE_ARRAY: i32 = 6;
const OPTIONAL: i32 = 1;
const UTF8: i32 = 0;
const UINT_64: i32 = 14;
const PLAIN: i32 = 0;
const RLE: i32 = 3;
const GZIP: i32 = 2;
const DATA_PAGE: i32 = 0;

pub(super) struct Parquet<'a> {
    out: Out<'a>,
    at: u64,
    columns: Vec<SchemaColumn>,
    about: Vec<(String, String)>,
    /// Rows that wait for their row group to be full.
    waiting: Option<Block>,
    groups: Vec<Group>,
    rows: u64,
}

struct SchemaColumn {
    name: String,
    kind: i32,
    converted: Option<i32>,
}

/// A row group that was written.
struct Group {
    rows: u64,
    columns: Vec<Written>,
}

/// A column of a row group that was written.
struct Written {
    offset: u64,
    plain: u64,
    compressed: u64,
}

impl<'a> Parquet<'a> {
    pub(super) fn new(mut out: Out<'a>, layout: &Layout, about: Vec<(String, String)>) -> io::Result<Parquet<'a>> {
        out.write_all(MAGIC)?;
        let mut columns = vec![SchemaColumn { name: "family".into(), kind: BYTE_ARRAY, converted: Some(UTF8) }];
        if layout.has_ids {
            columns.push(SchemaColumn { name: "id".into(), kind: INT64, converted: Some(UINT_64) });
        }
        let numbers = layout.columns.iter();
        columns.extend(numbers.map(|column| SchemaColumn { name: column.name.clone(), kind: DOUBLE, converted: None }));
        Ok(Parquet { out, at: MAGIC.len() as u64, columns, about, waiting: None, groups: Vec::new(), rows: 0 })
    }

    /// Writes the rows that wait as a row group.
    fn flush(&mut self) -> io::Result<()> {
        let Some(block) = self.waiting.take() else { return Ok(()) };
        let rows = block.rows;
        let ids = block.has_ids.then_some(Values::Ids(block.ids.as_deref()));
        let numbers = block.columns.iter().map(|column| Values::Numbers(column.as_deref()));
        let values: Vec<Values> = [Values::Family(block.family)].into_iter().chain(ids).chain(numbers).collect();
        let pages: Vec<io::Result<Page>> = values.par_iter().map(|values| Page::of(values, rows)).collect();
        let mut group = Group { rows: rows as u64, columns: Vec::new() };
        for page in pages {
            let page = page?;
            let header = page.header(rows);
            self.out.write_all(&header)?;
            self.out.write_all(&page.compressed)?;
            group.columns.push(Written {
                offset: self.at,
                plain: (header.len() + page.plain) as u64,
                compressed: (header.len() + page.compressed.len()) as u64,
            });
            self.at += (header.len() + page.compressed.len()) as u64;
        }
        self.rows += rows as u64;
        self.groups.push(group);
        Ok(())
    }

    /// The footer's structure.
    fn footer(&self) -> Vec<u8> {
        let root = Struct::default().text(4, "schema").i32(5, self.columns.len() as i32);
        let mut schema = vec![root];
        schema.extend(self.columns.iter().map(|column| {
            let element = Struct::default().i32(1, column.kind).i32(3, OPTIONAL).text(4, &column.name);
            column.converted.into_iter().fold(element, |element, converted| element.i32(6, converted))
        }));
        let groups = self.groups.iter().map(|group| {
            let chunks = self.columns.iter().zip(&group.columns).map(|(column, written)| {
                let about = Struct::default()
                    .i32(1, column.kind)
                    .i32s(2, &[PLAIN, RLE])
                    .texts(3, &[&column.name])
                    .i32(4, GZIP)
                    .i64(5, group.rows as i64)
                    .i64(6, written.plain as i64)
                    .i64(7, written.compressed as i64)
                    .i64(9, written.offset as i64);
                Struct::default().i64(2, written.offset as i64).inner(3, about)
            });
            let plain: u64 = group.columns.iter().map(|written| written.plain).sum();
            Struct::default().structs(1, chunks).i64(2, plain as i64).i64(3, group.rows as i64)
        });
        let about = self.about.iter().map(|(key, value)| Struct::default().text(1, key).text(2, value));
        Struct::default()
            .i32(1, 1)
            .structs(2, schema.into_iter())
            .i64(3, self.rows as i64)
            .structs(4, groups)
            .structs(5, about)
            .text(6, concat!("deepfield version ", env!("CARGO_PKG_VERSION")))
            .finish()
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
        let footer = self.footer();
        self.out.write_all(&footer)?;
        let length = u32::try_from(footer.len()).map_err(|_| io::Error::other("the footer is larger than 4 GiB"))?;
        self.out.write_all(&length.to_le_bytes())?;
        self.out.write_all(MAGIC)?;
        self.out.flush()?;
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

/// A column's values; none where the family does not have it.
enum Values<'a> {
    Family(FamilyName),
    Ids(Option<&'a [u64]>),
    Numbers(Option<&'a [f64]>),
}

/// A data page.
struct Page {
    plain: usize,
    compressed: Vec<u8>,
}

impl Page {
    fn of(values: &Values, rows: usize) -> io::Result<Page> {
        let is_there = !matches!(values, Values::Ids(None) | Values::Numbers(None));
        // Definition levels: one run of `rows` times 1 (there) or 0.
        let mut levels = Vec::new();
        varint(&mut levels, (rows as u64) << 1);
        levels.push(u8::from(is_there));
        let mut plain = Vec::with_capacity(levels.len() + 4 + 12 * rows);
        plain.extend_from_slice(&(levels.len() as u32).to_le_bytes());
        plain.extend(levels);
        match values {
            Values::Family(family) => {
                let name = family.as_str().as_bytes();
                let value = [&(name.len() as u32).to_le_bytes()[..], name].concat();
                (0..rows).for_each(|_| plain.extend_from_slice(&value));
            }
            Values::Ids(ids) => ids.iter().copied().flatten().for_each(|id| plain.extend_from_slice(&id.to_le_bytes())),
            Values::Numbers(values) => {
                values.iter().copied().flatten().for_each(|value| plain.extend_from_slice(&value.to_le_bytes()));
            }
        }
        let mut encoder = GzEncoder::new(Vec::with_capacity(plain.len() / 2), Compression::fast());
        encoder.write_all(&plain)?;
        Ok(Page { plain: plain.len(), compressed: encoder.finish()? })
    }

    fn header(&self, rows: usize) -> Vec<u8> {
        let data = Struct::default().i32(1, rows as i32).i32(2, PLAIN).i32(3, RLE).i32(4, RLE);
        Struct::default()
            .i32(1, DATA_PAGE)
            .i32(2, self.plain as i32)
            .i32(3, self.compressed.len() as i32)
            .inner(5, data)
            .finish()
    }
}
