//! The rows of many files as one table. Columns that any look at a table may take are copied while the files are opened, and others once they
//! are announced and read; what is not copied is read from its file again, of which the last few are kept.

mod begun;

use super::columns::{Column, Opened, Table, left_out_note, shown};
use super::store::{Store, StoreWriter};
use super::{STANDARD, catalogue, sky};
use crate::import::ImportError;
use crate::import::attributes::KINDS;
use crate::model::ReadMethod;
use begun::{Begun, Found, append};
use std::collections::{BTreeSet, VecDeque};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};

/// Opens one of the files. Whoever waits for it may hold a lock, so that it must not let other work run on its thread.
pub(super) type Open = fn(&Path, ReadMethod) -> Result<Opened, ImportError>;

/// Size of all files up to which every column is copied at once, bytes.
const SMALL: u64 = 1 << 30;

/// How many files are opened side by side, each of which may take 64 MiB.
const MOST_OPENED: usize = 8;

/// The rows of all files, one file after the other. What a column holds besides numbers in some file leaves it out.
///
/// # Errors
/// When a file cannot be opened, or has other columns than the first.
pub(super) fn open(path: &Path, files: &[PathBuf], open: Open, method: ReadMethod) -> Result<Opened, ImportError> {
    let length = |file: &PathBuf| std::fs::metadata(file).map_or(0, |about| about.len());
    let is_small = files.iter().map(length).fold(0, u64::saturating_add) <= SMALL;
    let (table, about) = join(path, files, open, method, &|column| is_small || is_usual(column))?;
    Ok(Opened { table: Box::new(table), format: about.format, bytes: about.bytes, notes: about.notes })
}

/// Whether any look at a table may take a column: for positions, velocities and ids, or as what is loaded unless others are asked for.
fn is_usual(column: &Column) -> bool {
    let key = column.key();
    STANDARD.iter().any(|(names, ..)| names.contains(&key.as_str()))
        || sky::is_needed(column)
        || sky::may_be_vector(&column.name)
        || catalogue::VELOCITY_AXES.as_flattened().contains(&key.as_str())
        || KINDS.contains(&column.name.as_str())
}

/// Opens files side by side, a few at a time, and hands them on in their order.
fn each(
    files: &[PathBuf],
    open: Open,
    method: ReadMethod,
    mut take: impl FnMut(&Path, Opened) -> Result<(), ImportError>,
) -> Result<(), ImportError> {
    for some in files.chunks(rayon::current_num_threads().clamp(1, MOST_OPENED)) {
        // By threads of their own: others may wait for this one, which must not take up their work meanwhile.
        let opened: Vec<_> = std::thread::scope(|scope| {
            let begun: Vec<_> = some.iter().map(|file| scope.spawn(move || open(file, method))).collect();
            begun.into_iter().map(|thread| thread.join()).collect()
        });
        for (file, opened) in some.iter().zip(opened) {
            match opened {
                Ok(opened) => take(file, opened?)?,
                Err(panic) => std::panic::resume_unwind(panic),
            }
        }
    }
    Ok(())
}

/// What is known of all files.
struct About {
    format: &'static str,
    bytes: u64,
    notes: Vec<String>,
}

/// Opens all files, and copies the columns for which `is_copied` says so.
fn join(
    path: &Path,
    files: &[PathBuf],
    open: Open,
    method: ReadMethod,
    is_copied: &dyn Fn(&Column) -> bool,
) -> Result<(Joined, About), ImportError> {
    let mut all: Option<(Begun, About)> = None;
    let mut starts = vec![0];
    each(files, open, method, |file, Opened { table, format, bytes, notes }| {
        let (begun, about) = all.get_or_insert_with(|| {
            let begun = Begun::of(path, table.columns(), is_copied);
            (begun, About { format, bytes: 0, notes })
        });
        about.bytes = about.bytes.saturating_add(bytes);
        begun.add(file, &*table)?;
        starts.push(begun.rows());
        Ok(())
    })?;
    let Some((begun, mut about)) = all else {
        return Err(ImportError::missing(path, "tables", "files with the same columns"));
    };
    let (columns, dropped) = begun.finish()?;
    about.notes.extend(left_out_note(&dropped));
    let (mut copies, mut is_blank, mut lacks_ids, mut named) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for Found { column, copy, has_numbers } in columns {
        is_blank.push(!has_numbers);
        lacks_ids.push(copy.as_ref().is_some_and(|(store, place)| store.lacks_ids(*place)));
        copies.push(copy);
        named.push(column);
    }
    let joined = Joined {
        path: path.into(),
        columns: named,
        is_blank,
        lacks_ids,
        copies: RwLock::new(copies),
        announced: Mutex::default(),
        files: files.into(),
        starts,
        open,
        method,
        last: Mutex::default(),
    };
    Ok((joined, about))
}

/// A column of some store.
type Copied = (Arc<Store>, usize);

/// The error of a file that is not as another is, or as it was.
pub(super) fn unlike(file: &Path, found: String, expected: String) -> ImportError {
    ImportError::Unlike { path: file.into(), found, expected }
}

/// A file that is open, or about to be.
type Slot = Arc<Mutex<Option<Arc<dyn Table>>>>;

/// A table whose rows are those of files, one file after the other.
struct Joined {
    path: PathBuf,
    columns: Vec<Column>,
    is_blank: Vec<bool>,
    lacks_ids: Vec<bool>,
    /// Where columns are copied; none of ids is not.
    copies: RwLock<Vec<Option<Copied>>>,
    /// Columns that are to be copied once one of them is read.
    announced: Mutex<BTreeSet<usize>>,
    files: Vec<PathBuf>,
    /// The first row of each file, and behind the last how many rows there are.
    starts: Vec<u64>,
    open: Open,
    method: ReadMethod,
    /// The files that were read last, by number, the latest at the end.
    last: Mutex<VecDeque<(usize, Slot)>>,
}

/// What a lock holds, which is whole whatever a thread that held it did.
fn locked<T>(lock: &Mutex<T>) -> MutexGuard<'_, T> {
    lock.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Joined {
    fn copied(&self, column: usize) -> Option<Copied> {
        self.copies.read().unwrap_or_else(PoisonError::into_inner)[column].clone()
    }

    /// Where a column is copied; if it was announced, it is from now on.
    fn copy_of(&self, column: usize) -> Result<Option<Copied>, ImportError> {
        if let Some(copy) = self.copied(column) {
            return Ok(Some(copy));
        }
        // Whoever reads one of them meanwhile waits.
        let mut announced = locked(&self.announced);
        if announced.contains(&column) {
            // What cannot be copied is not tried again by all who wait, each with a pass of its own.
            let columns = std::mem::take(&mut *announced);
            self.copy(columns.into_iter().filter(|column| self.copied(*column).is_none()).collect())?;
        }
        Ok(self.copied(column))
    }

    /// Copies columns that are not yet, in one pass over all files.
    fn copy(&self, columns: Vec<usize>) -> Result<(), ImportError> {
        let named = columns.iter().map(|column| self.columns[*column].clone());
        let mut writer = StoreWriter::new(&self.path, named.collect());
        let mut number = 0;
        each(&self.files, self.open, self.method, |_, opened| {
            self.check_rows(number, &*opened.table)?;
            let places = columns.iter().map(|column| self.place(number, &*opened.table, *column));
            let places = places.collect::<Result<Vec<usize>, ImportError>>()?;
            let own = columns.iter().map(|column| &self.columns[*column]);
            let copied: Vec<(&Column, Option<usize>)> = own.zip(places.into_iter().map(Some)).collect();
            number += 1;
            append(&*opened.table, &copied, &mut writer)
        })?;
        let store = Arc::new(writer.finish(|_| true)?);
        let mut copies = self.copies.write().unwrap_or_else(PoisonError::into_inner);
        for (place, column) in columns.into_iter().enumerate() {
            copies[column] = Some((Arc::clone(&store), place));
        }
        Ok(())
    }

    /// The place of a file, from now on the latest of those that are kept.
    fn slot(&self, number: usize) -> Slot {
        let mut last = locked(&self.last);
        let kept = last.iter().position(|(other, _)| *other == number).and_then(|at| last.remove(at));
        let (_, slot) = kept.unwrap_or_default();
        last.push_back((number, Arc::clone(&slot)));
        // One for each thread, and that behind whose rows it is about to end. Those that are being opened stay, however long that takes.
        let is_idle = |(_, slot): &(usize, Slot)| Arc::strong_count(slot) == 1;
        while last.len() > rayon::current_num_threads() + 1
            && let Some(at) = last.iter().position(is_idle)
        {
            last.remove(at);
        }
        slot
    }

    /// A file, which is kept while few others are read.
    fn file(&self, number: usize) -> Result<Arc<dyn Table>, ImportError> {
        let slot = self.slot(number);
        // Whoever wants the same file waits.
        let mut table = locked(&slot);
        if let Some(table) = &*table {
            return Ok(Arc::clone(table));
        }
        let opened: Arc<dyn Table> = Arc::from((self.open)(&self.files[number], self.method)?.table);
        self.check_rows(number, &*opened)?;
        *table = Some(Arc::clone(&opened));
        // Others have been read meanwhile.
        self.slot(number);
        Ok(opened)
    }

    /// Which file has a row: the last that begins there or before, as those without rows are passed by.
    fn number_of(&self, row: u64) -> usize {
        self.starts.partition_point(|start| *start <= row).saturating_sub(1)
    }

    /// A file that was opened again has as many rows as before.
    fn check_rows(&self, number: usize, table: &dyn Table) -> Result<(), ImportError> {
        let rows = self.starts[number + 1] - self.starts[number];
        if table.rows() != rows {
            let expected = format!("{rows}, as when it was opened first");
            return Err(unlike(&self.files[number], format!("{} rows", table.rows()), expected));
        }
        Ok(())
    }

    /// Which column of a file that was opened again one of all is.
    fn place(&self, number: usize, table: &dyn Table, column: usize) -> Result<usize, ImportError> {
        let own = &self.columns[column];
        let place = table.columns().iter().position(|other| other == own);
        let expected = "numbers in this column, as when the file was opened first";
        place.ok_or_else(|| ImportError::missing(&self.files[number], shown(&own.name), expected))
    }
}

impl Table for Joined {
    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn rows(&self) -> u64 {
        self.starts.last().copied().unwrap_or(0)
    }

    fn read(&self, column: usize, rows: Range<u64>, mut out: &mut [f64]) -> Result<(), ImportError> {
        if let Some((store, place)) = self.copy_of(column)? {
            return store.read(place, rows, out);
        }
        let components = self.columns[column].components;
        let mut at = rows.start;
        while at < rows.end {
            let number = self.number_of(at);
            let Some(next) = self.starts.get(number + 1) else {
                return Err(ImportError::malformed(&self.path, "rows", rows.end, format!("{} rows", self.rows())));
            };
            let (start, end) = (self.starts[number], rows.end.min(*next));
            let length = ((end - at) as usize * components).min(out.len());
            let (some, rest) = std::mem::take(&mut out).split_at_mut(length);
            let table = self.file(number)?;
            table.read(self.place(number, &*table, column)?, at - start..end - start, some)?;
            (out, at) = (rest, end);
        }
        Ok(())
    }

    fn read_whole(&self, column: usize, rows: Range<u64>, out: &mut [Option<u64>]) -> Result<bool, ImportError> {
        self.copied(column).map_or(Ok(false), |(store, place)| store.read_whole(place, rows, out))
    }

    fn lacks_ids(&self, column: usize) -> bool {
        self.lacks_ids[column]
    }

    fn is_blank(&self, column: usize) -> bool {
        self.is_blank[column]
    }

    fn announce(&self, columns: &[usize]) {
        locked(&self.announced).extend(columns.iter().filter(|column| self.copied(**column).is_none()));
    }

    fn at_hand_until(&self, row: u64) -> Option<u64> {
        let copies = self.copies.read().unwrap_or_else(PoisonError::into_inner);
        let is_in_files = copies.iter().zip(&self.is_blank).any(|(copy, is_blank)| copy.is_none() && !is_blank);
        if is_in_files { self.starts.get(self.number_of(row) + 1).copied() } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::table::catalogue::Catalogue;
    use crate::import::table::{Csv, separated};
    use crate::import::{AttributeChoice, LoadOptions, Source, load_source, summarize_source};

    /// Files of a table with many columns of which few are usual; one is text in a file, one has no number, and one begins with none.
    fn files(folder: &Path) -> Vec<PathBuf> {
        const COLUMNS: usize = 12;
        // The second has no rows, and rows of the others are in no more than a part of a chunk.
        [5000, 0, 4500, 1]
            .into_iter()
            .enumerate()
            .map(|(number, rows)| {
                let others: Vec<String> = (0..COLUMNS).map(|column| format!("other_{column}")).collect();
                let mut text = format!("source_id,ra,dec,parallax,bp_rp,word,blank,late,{}\n", others.join(","));
                for row in 0..rows {
                    let id = (1_u64 << 62) + 1 + 10_000 * number as u64 + row;
                    let word = if number == 2 && row == 7 { "Vega" } else { "1" };
                    let late = if number < 3 { "null".to_owned() } else { row.to_string() };
                    text += &format!("{id},{},{},{},{},{word},null,{late}", row % 360, row % 90, 1 + row % 50, row % 3);
                    (0..COLUMNS as u64)
                        .for_each(|column| text += &format!(",{}", 1 + row * 31 + column * number as u64));
                    text.push('\n');
                }
                let path = folder.join(format!("part_{number}.csv"));
                std::fs::write(&path, text).unwrap();
                path
            })
            .collect()
    }

    fn joined(folder: &Path, files: &[PathBuf], is_copied: &dyn Fn(&Column) -> bool) -> Joined {
        join(folder, files, separated::open::<Csv>, ReadMethod::default(), is_copied).unwrap().0
    }

    fn source(folder: &Path, files: &[PathBuf], is_copied: &dyn Fn(&Column) -> bool) -> Catalogue {
        let table = Box::new(joined(folder, files, is_copied));
        Catalogue::in_files(folder, Opened { table, format: "csv", bytes: 0, notes: Vec::new() }, files.len()).unwrap()
    }

    fn copies(table: &Joined) -> Vec<&str> {
        let names = table.columns.iter().enumerate().filter(|(at, _)| table.copied(*at).is_some());
        names.map(|(_, column)| column.name.as_str()).collect()
    }

    #[test]
    fn usual_columns_are_copied_and_others_once_they_are_announced_and_read() {
        let folder = tempfile::tempdir().unwrap();
        let files = files(folder.path());
        let usual = ["source_id", "ra", "dec", "parallax", "bp_rp"];
        let table = joined(folder.path(), &files, &is_usual);
        assert_eq!(copies(&table), usual);
        let place = |name: &str| table.columns.iter().position(|column| column.name == name).unwrap();
        let (first, second, third) = (place("other_1"), place("other_7"), place("other_8"));
        let all = joined(folder.path(), &files, &|_| true);
        assert_eq!(copies(&all).len(), all.columns.len());
        assert!(all.columns == table.columns && all.starts == table.starts && all.is_blank == table.is_blank);
        let agree = |column: usize| {
            for range in [0..1, 4990..5010, 0..table.rows(), table.rows() - 2..table.rows()] {
                let [found, expected] = [(&table, 0.0), (&all, -1.0)].map(|(table, filled)| {
                    let mut values = vec![filled; (range.end - range.start) as usize];
                    table.read(column, range.clone(), &mut values).unwrap();
                    values
                });
                assert_eq!(found, expected, "column {column}, {range:?}");
            }
        };
        agree(first);
        assert_eq!(copies(&table), usual, "what was not announced is not copied");
        table.announce(&[first, second, place("ra")]);
        assert_eq!(copies(&table), usual, "nor what was not read");
        agree(third);
        assert_eq!(copies(&table), usual);
        agree(second);
        assert_eq!(copies(&table), ["source_id", "ra", "dec", "parallax", "bp_rp", "other_1", "other_7"]);
        agree(first);
    }

    #[test]
    fn what_is_copied_changes_nothing_that_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let files = files(folder.path());
        let few = source(folder.path(), &files, &is_usual);
        let all = source(folder.path(), &files, &|_| true);
        // File by file; the second has no rows.
        let ends = [0, 4999, 5000, 9500].map(|row| few.at_hand_until(0, row));
        assert_eq!((ends, all.at_hand_until(0, 0)), ([5000, 5000, 9500, 9501].map(Some), None));
        assert_eq!(few.description(), all.description());
        assert_eq!(summarize_source(&few).unwrap(), summarize_source(&all).unwrap());
        let named = AttributeChoice::Named(vec!["late".into(), "other_3".into(), "bp_rp".into()]);
        for attributes in [AttributeChoice::Usual, named, AttributeChoice::All] {
            let options = LoadOptions { attributes, ..LoadOptions::default() };
            let [few, all] = [&few, &all].map(|source| load_source(source, &options, &()).unwrap());
            // As text, in which numbers that are missing are alike.
            assert!(format!("{few:?}") == format!("{all:?}"), "{options:?}");
        }
        assert_eq!(few.at_hand_until(0, 0), None, "all attributes were announced and read");
        let id = few.description().families[0].find(crate::import::FieldKind::Id).unwrap();
        let mut ids = vec![0; 2];
        few.read_ids(0, id, 4999..5001, &mut ids).unwrap();
        assert_eq!(ids, [(1 << 62) + 5000, (1 << 62) + 20_001]);
    }

    #[test]
    fn a_file_that_is_another_when_it_is_read_again_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let files = files(folder.path());
        let text = std::fs::read_to_string(&files[2]).unwrap();
        let cases = [
            (text.lines().take(10).map(|line| format!("{line}\n")).collect::<String>(), "found 9 rows, expected 4500"),
            (text.replace("other_1,", "another,"), "other_1: missing"),
        ];
        for (other, told) in cases {
            std::fs::write(&files[2], &text).unwrap();
            let table = joined(folder.path(), &files, &is_usual);
            let column = table.columns.iter().position(|column| column.name == "other_1").unwrap();
            std::fs::write(&files[2], other).unwrap();
            for is_announced in [false, true] {
                if is_announced {
                    table.announce(&[column]);
                }
                let error = table.read(column, 4990..5010, &mut [0.0; 20]).unwrap_err().to_string();
                assert!(error.contains("part_2.csv") && error.contains(told), "{error}");
            }
        }
    }
}
