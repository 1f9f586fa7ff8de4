//! What formats have in common that hold a table column by column: which columns are the components of one array, and where rows wait
//! until their number is known.

use super::{Block, Column};
use crate::store::temporary::Temporary;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::Path;

/// Bytes of an array that wait in memory before they go to the temporary file.
const PIECE: usize = 1 << 19;

/// Columns that are the components of one quantity; one alone where it has no others.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Array {
    /// The quantity's name: `position`, `velocity`, `mass`, `acceleration`.
    pub name: String,
    /// Its columns.
    pub columns: Range<usize>,
}

impl Array {
    /// The arrays of a table, in the order of its columns.
    pub(super) fn all(columns: &[Column]) -> Vec<Array> {
        let mut arrays = Vec::new();
        let mut at = 0;
        while let Some(column) = columns.get(at) {
            let alone = || Array { name: column.name.clone(), columns: at..at + 1 };
            let array = Array::vector(columns, at).unwrap_or_else(alone);
            at = array.columns.end;
            arrays.push(array);
        }
        arrays
    }

    /// The array whose first component is the column `at`, if it has several.
    fn vector(columns: &[Column], at: usize) -> Option<Array> {
        let first = columns.get(at)?.name.as_str();
        let run = |named: &dyn Fn(usize) -> Option<String>| {
            let is_next = |i: &usize| {
                columns.get(at + i).zip(named(*i)).is_some_and(|(column, expected)| column.name == expected)
            };
            (0..columns.len()).take_while(is_next).count()
        };
        let axis = |before: &str, i: usize| Some(format!("{before}{}", ["x", "y", "z"].get(i)?));
        let (name, count) = match (first, first.strip_suffix("-x"), first.strip_suffix("-0")) {
            ("x", ..) => ("position", run(&|i| axis("", i))),
            ("vx", ..) => ("velocity", run(&|i| axis("v", i))),
            (_, Some(name), _) => (name, run(&|i| axis(&format!("{name}-"), i))),
            (_, None, Some(name)) => (name, run(&|i| Some(format!("{name}-{i}")))),
            _ => return None,
        };
        let is_vector = count == 3 || (count > 1 && first.ends_with("-0"));
        (is_vector && !name.is_empty()).then(|| Array { name: name.to_owned(), columns: at..at + count })
    }

    /// Numbers of a row.
    pub(super) fn components(&self) -> usize {
        self.columns.len()
    }

    /// Whether a block has it.
    pub(super) fn is_in(&self, block: &Block) -> bool {
        block.columns[self.columns.clone()].iter().any(Option::is_some)
    }

    /// Appends the numbers of a block, row by row; NaN where it has none.
    pub(super) fn write(&self, block: &Block, out: &mut Vec<u8>) {
        let columns = &block.columns[self.columns.clone()];
        out.reserve(8 * block.rows * columns.len());
        for row in 0..block.rows {
            for column in columns {
                let value = column.as_ref().and_then(|column| column.get(row)).copied().unwrap_or(f64::NAN);
                out.extend_from_slice(&value.to_le_bytes());
            }
        }
    }
}

/// Arrays that grow side by side, in one temporary file.
pub(super) struct Spool {
    file: Temporary,
    /// Bytes in the file.
    end: u64,
    arrays: Vec<Spooled>,
}

/// One of them.
#[derive(Clone, Debug, Default)]
struct Spooled {
    /// Where in the file its pieces are, and how many bytes each has.
    pieces: Vec<(u64, usize)>,
    /// What is behind these.
    fresh: Vec<u8>,
}

impl Spool {
    /// So many empty arrays, beside the file that they are for.
    pub(super) fn new(out: &Path, arrays: usize) -> io::Result<Spool> {
        Ok(Spool { file: Temporary::create(out, None)?, end: 0, arrays: vec![Spooled::default(); arrays] })
    }

    /// Appends to an array what `write` does.
    pub(super) fn push(&mut self, array: usize, write: impl FnOnce(&mut Vec<u8>)) -> io::Result<()> {
        let Spooled { pieces, fresh } = &mut self.arrays[array];
        write(fresh);
        if fresh.len() >= PIECE {
            let mut file: &File = self.file.file();
            file.write_all(fresh)?;
            pieces.push((self.end, fresh.len()));
            self.end += fresh.len() as u64;
            fresh.clear();
        }
        Ok(())
    }

    /// Bytes of an array.
    pub(super) fn bytes(&self, array: usize) -> u64 {
        let Spooled { pieces, fresh } = &self.arrays[array];
        pieces.iter().map(|(_, length)| *length as u64).sum::<u64>() + fresh.len() as u64
    }

    /// Writes an array from its beginning to its end; nothing is appended to any any more.
    pub(super) fn copy(&self, array: usize, to: &mut impl Write) -> io::Result<()> {
        let Spooled { pieces, fresh } = &self.arrays[array];
        let mut file: &File = self.file.file();
        let mut piece = Vec::new();
        for (at, length) in pieces {
            piece.resize(*length, 0);
            file.seek(SeekFrom::Start(*at))?;
            file.read_exact(&mut piece)?;
            to.write_all(&piece)?;
        }
        to.write_all(fresh)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Unit;

    #[test]
    fn components_are_found_by_their_names() {
        let names = "x,y,z,vx,vy,vz,mass,b-0,b-1,b-2,b-3,a-x,a-y,mass-x,c-0,d-x,d-y,d-z";
        let column = |name: &str| Column { name: name.to_owned(), unit: Unit::default(), scaled: None };
        let columns: Vec<Column> = names.split(',').map(column).collect();
        let found: Vec<(String, usize)> =
            Array::all(&columns).into_iter().map(|array| (array.name.clone(), array.components())).collect();
        let expected = [
            ("position", 3_usize),
            ("velocity", 3),
            ("mass", 1),
            ("b", 4),
            ("a-x", 1),
            ("a-y", 1),
            ("mass-x", 1),
            ("c-0", 1),
            ("d", 3),
        ];
        assert_eq!(found, expected.map(|(name, count)| (name.to_owned(), count)));
    }

    #[test]
    fn arrays_come_back_whole_however_they_grew() {
        let folder = tempfile::tempdir().unwrap();
        let mut spool = Spool::new(&folder.path().join("out"), 2).unwrap();
        let mut expected = [Vec::new(), Vec::new()];
        for step in 0..40_usize {
            let array = usize::from(step % 3 == 0);
            let bytes: Vec<u8> = (0..step * 1999).map(|i| (i * step) as u8).collect();
            expected[array].extend_from_slice(&bytes);
            spool.push(array, |out| out.extend_from_slice(&bytes)).unwrap();
        }
        assert!(spool.end > 0, "nothing went to the file");
        for (array, expected) in expected.iter().enumerate() {
            let mut found = Vec::new();
            spool.copy(array, &mut found).unwrap();
            assert_eq!(spool.bytes(array), found.len() as u64);
            assert!(found == *expected);
        }
    }
}
