//! Catalogues partitioned by place on the sky in the layout of HATS (<https://www.ivoa.net/documents/Notes/HATS/>): Parquet files
//! `dataset/Norder=K/Dir=D/Npix=N.parquet`, or some in a folder `Npix=N`, beside a text `hats.properties` or `properties`. Of a collection of
//! catalogues, which a text `collection.properties` describes, the primary one is read.

use super::super::catalogue::Catalogue;
use super::super::columns::{Column, Opened, Table, shown};
use super::together;
use crate::import::table::text;
use crate::import::{Format, ImportError, Source};
use crate::model::ReadMethod;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Such catalogues.
pub(in crate::import) struct Hats;

/// What their texts are called.
const PROPERTIES: [&str; 2] = ["hats.properties", "properties"];

/// What the text of a collection is called, and the entry in it that names the folder of its primary catalogue.
const COLLECTION: &str = "collection.properties";
const PRIMARY: &str = "hats_primary_table_url";

/// Bytes of a text that are read.
const MOST_TEXT: u64 = 1 << 20;

/// Folders inside each other: of orders, of some pixels, of one pixel.
const LEVELS: usize = 3;

/// The most files of a catalogue: HEALPix has not many more pixels of the order that they are split to.
const MOST_FILES: usize = 1 << 20;

impl Format for Hats {
    fn name(&self) -> &'static str {
        "HATS catalogue"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["properties"]
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        text::head(head).is_some_and(|text| text.lines().any(|line| line.starts_with("hats_") && line.contains('=')))
    }

    /// `path` is the catalogue's folder, or the text in it, or that of a collection.
    fn open(&self, path: &Path, _: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        let folder = folder_of(path)?;
        let files = partitions(&folder)?;
        let properties = Properties::of(&folder);
        let mut opened = together(&files)?;
        opened.format = "hats";
        opened.notes.push(format!("{} files of the catalogue are read", files.len()));
        if let Some(stated) = properties.value("hats_nrows").and_then(|rows| rows.parse::<u64>().ok())
            && stated != opened.table.rows()
        {
            opened.notes.push(format!("{} of the catalogue's {stated} rows are there", opened.table.rows()));
        }
        let names = [("hats_col_ra", "ra"), ("hats_col_dec", "dec")];
        let names = names.map(|(key, name)| (properties.value(key).unwrap_or(name), name));
        let opened = Opened { table: Box::new(Named::new(opened.table, &names)), ..opened };
        Ok(Box::new(Catalogue::in_files(path, opened, files.len())?))
    }

    fn files(&self, path: &Path) -> Result<Vec<PathBuf>, ImportError> {
        let folder = folder_of(path)?;
        let mut files = partitions(&folder)?;
        let said = properties_of(&folder);
        if path.is_file() && said.as_deref() != Some(path) {
            files.push(path.to_owned());
        }
        files.extend(said);
        Ok(files)
    }
}

/// The folder of the catalogue that is meant by its folder or its text, or by the text of a collection.
fn folder_of(path: &Path) -> Result<PathBuf, ImportError> {
    if path.is_dir() {
        return Ok(path.to_owned());
    }
    match path.file_name().is_some_and(|name| name == COLLECTION) {
        true => primary(path),
        false => Ok(path.parent().unwrap_or(Path::new("")).to_owned()),
    }
}

/// The folder of the primary catalogue of the collection that a text describes.
fn primary(text: &Path) -> Result<PathBuf, ImportError> {
    let properties = Properties::read(text);
    let expected = "the folder of a HATS catalogue";
    let name = properties.value(PRIMARY).ok_or_else(|| ImportError::missing(text, PRIMARY, expected))?;
    let folder = text.parent().unwrap_or(Path::new("")).join(name);
    let wrong = || ImportError::malformed(text, PRIMARY, shown(name), expected);
    is_partitioned(&folder).then_some(folder).ok_or_else(wrong)
}

/// What opens the catalogue that a folder is: itself, or where it is a collection its primary catalogue; the collection's text where that is not
/// there, to tell so.
pub(in crate::import) fn catalogue_in(folder: &Path) -> Option<PathBuf> {
    if is_partitioned(folder) {
        return Some(folder.to_owned());
    }
    let text = folder.join(COLLECTION);
    text.is_file().then(|| primary(&text).unwrap_or(text))
}

/// Whether a folder is such a catalogue, with its text or without.
pub(in crate::import) fn is_partitioned(folder: &Path) -> bool {
    [folder.join("dataset"), folder.to_owned()].iter().any(|folder| has_orders(folder))
}

fn has_orders(folder: &Path) -> bool {
    let is_order = |path: PathBuf| number(&path, "Norder=").is_some() && path.is_dir();
    entries(folder).is_ok_and(|entries| entries.flatten().any(|entry| is_order(entry.path())))
}

/// What is in a folder; the one around a bare name has none itself.
fn entries(folder: &Path) -> std::io::Result<std::fs::ReadDir> {
    std::fs::read_dir(if folder.as_os_str().is_empty() { Path::new(".") } else { folder })
}

/// The number in a name behind `key`.
fn number(path: &Path, key: &str) -> Option<u64> {
    path.file_name()?.to_str()?.strip_prefix(key)?.split('.').next()?.parse().ok()
}

/// The files of a catalogue, by order, pixel and name.
fn partitions(folder: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let inner = folder.join("dataset");
    let mut found = Vec::new();
    collect(if has_orders(&inner) { &inner } else { folder }, [0; 2], 0, &mut found)?;
    if found.is_empty() {
        let expected = "files Norder=K/Dir=D/Npix=N.parquet here or in a folder dataset";
        return Err(ImportError::missing(folder, "partitions", expected));
    }
    found.sort();
    Ok(found.into_iter().map(|(_, path)| path).collect())
}

/// Adds the files below a folder, which is that of an order and a pixel where it lies so deep.
fn collect(
    folder: &Path,
    place: [u64; 2],
    depth: usize,
    found: &mut Vec<([u64; 2], PathBuf)>,
) -> Result<(), ImportError> {
    let io = |source| ImportError::io(folder, "folder", source);
    for entry in entries(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        let (order, pixel) = (number(&path, "Norder="), number(&path, "Npix="));
        let own = [order.unwrap_or(place[0]), pixel.unwrap_or(place[1])];
        if path.is_dir() {
            let is_known = order.or(pixel).or_else(|| number(&path, "Dir=")).is_some();
            if is_known && depth < LEVELS {
                collect(&path, own, depth + 1, found)?;
            }
        } else if (pixel.is_some() || number(folder, "Npix=").is_some())
            && path.extension().is_some_and(|ending| ["parquet", "parq", "pq"].iter().any(|known| ending == *known))
        {
            found.push((own, path));
            if found.len() > MOST_FILES {
                return Err(ImportError::malformed(folder, "files", found.len(), format!("at most {MOST_FILES}")));
            }
        }
    }
    Ok(())
}

/// The lines `key=value` of a catalogue's text.
struct Properties(String);

impl Properties {
    /// Those of a catalogue; none where it has no text.
    fn of(folder: &Path) -> Properties {
        properties_of(folder).map_or(Properties(String::new()), |path| Properties::read(&path))
    }

    /// Those of a text; none where it cannot be read, or is too long.
    fn read(path: &Path) -> Properties {
        let text = is_text(path).then(|| std::fs::read_to_string(path).ok()).flatten();
        Properties(text.unwrap_or_default())
    }

    fn value(&self, key: &str) -> Option<&str> {
        let pairs = self.0.lines().filter_map(|line| line.split_once('='));
        let mut values = pairs.filter(|(name, _)| name.trim() == key).map(|(_, value)| value.trim());
        values.find(|value| !value.is_empty())
    }
}

/// The text of a catalogue's folder, or of the one around its folder `dataset`.
fn properties_of(folder: &Path) -> Option<PathBuf> {
    let above = folder.parent().filter(|_| folder.ends_with("dataset"));
    let folders = std::iter::once(folder).chain(above);
    folders.flat_map(|folder| PROPERTIES.map(|name| folder.join(name))).find(|path| is_text(path))
}

/// Whether a file is there and no longer than texts are.
fn is_text(path: &Path) -> bool {
    path.metadata().is_ok_and(|about| about.is_file() && about.len() <= MOST_TEXT)
}

/// A table in which directions on the sky are called by the names that all tables have for them.
struct Named {
    table: Box<dyn Table>,
    columns: Vec<Column>,
}

impl Named {
    /// `names` are those of columns, and what each is called instead where no other is called so. They are in degrees where nothing else is stated.
    fn new(table: Box<dyn Table>, names: &[(&str, &str)]) -> Named {
        let mut columns = table.columns().to_vec();
        for (from, to) in names {
            let is_free = !columns.iter().any(|column| column.key() == *to);
            let Some(column) = columns.iter_mut().find(|column| column.name == *from) else { continue };
            if column.unit.is_empty() {
                column.unit = "deg".to_owned();
            }
            if is_free {
                column.name = (*to).to_owned();
            }
        }
        Named { table, columns }
    }
}

impl Table for Named {
    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn rows(&self) -> u64 {
        self.table.rows()
    }

    fn read(&self, column: usize, rows: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        self.table.read(column, rows, out)
    }

    fn read_whole(&self, column: usize, rows: Range<u64>, out: &mut [Option<u64>]) -> Result<bool, ImportError> {
        self.table.read_whole(column, rows, out)
    }

    fn is_blank(&self, column: usize) -> bool {
        self.table.is_blank(column)
    }

    fn lacks_ids(&self, column: usize) -> bool {
        self.table.lacks_ids(column)
    }
}
