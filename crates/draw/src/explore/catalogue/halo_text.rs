//! Catalogues of halo finders as text, also compressed with gzip: Rockstar and AHF, whose first line is `#` and names of columns, perhaps
//! with their numbers (`Mvir(4)`), and VELOCIraptor, where two lines of two whole numbers are before the names: which file of how many it is, and
//! how many haloes it and all of them have. Columns are apart by spaces or tabs. Trees of consistent-trees begin as its lists do; they are read by
//! `merger_tree`.

use super::finder::{AHF, Columns, Finder, ROCKSTAR, VELOCIRAPTOR};
use super::properties::Kept;
use super::{Catalogue, MOST_OBJECTS, Object};
use crate::explore::ExploreError;
use crate::import::names_of_parts;
use crate::model::Unit;
use flate2::read::MultiGzDecoder;
use glam::DVec3;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// The longest line, and the most of all lines, bytes.
const LONGEST: u64 = 1 << 17;
const MOST_TEXT: u64 = 64 << 30;

/// Names of columns of tables and trees in this program's own manner, which no halo finder has.
const OTHERS: [&str; 11] =
    ["name", "object", "label", "designation", "proper", "step", "snapshot", "snapnum", "snap", "time", "scale_factor"];

/// Whether a file is the list of a halo finder, by what stands before its rows.
///
/// # Errors
/// When it cannot be opened.
pub(in crate::explore) fn is_list(path: &Path) -> Result<bool, ExploreError> {
    Ok(Heading::read(&mut Lines::open(path)?).is_some())
}

/// Whether a list is one of trees of consistent-trees: haloes have descendants, and the first line behind the comments is one word alone, how many
/// trees there are, or a tree begins.
///
/// # Errors
/// When it cannot be opened.
pub(in crate::explore) fn is_forest(path: &Path) -> Result<bool, ExploreError> {
    let mut lines = Lines::open(path)?;
    let heading = Heading::read(&mut lines).filter(|heading| heading.finder.format == ROCKSTAR.format);
    if heading.and_then(|heading| heading.column("desc_id")).is_none() {
        return Ok(false);
    }
    // What is no line of text is an error for whoever reads all of it.
    while let Ok(Some(line)) = lines.row() {
        if line.starts_with("#tree ") {
            return Ok(true);
        }
        let words = line.split_whitespace().count();
        if words > 0 && !line.starts_with('#') {
            return Ok(words == 1);
        }
    }
    Ok(false)
}

/// The haloes of a list, in its order, and nothing else of them; `None` of what is none of a halo finder.
///
/// # Errors
/// When it cannot be read or is damaged.
pub(in crate::explore) fn haloes(path: &Path) -> Result<Option<Catalogue>, ExploreError> {
    read(path, &mut Kept::nothing())
}

/// Reads a catalogue; `None` of what is none of a halo finder.
pub(super) fn read(path: &Path, kept: &mut Kept) -> Result<Option<Catalogue>, ExploreError> {
    let Some(first) = Heading::read(&mut Lines::open(path)?) else { return Ok(None) };
    if is_forest(path)? {
        return Ok(None);
    }
    let mut stated = Stated::default();
    let mut objects = Vec::new();
    for part in names_of_parts(path, first.files)? {
        let mut lines = Lines::open(&part)?;
        let heading = Heading::read(&mut lines).filter(|own| std::ptr::eq(own.finder, first.finder));
        let heading =
            heading.ok_or_else(|| ExploreError::missing(&part, "header", "names of columns as in other files"))?;
        push(lines, heading, &mut stated, &mut objects, kept)?;
    }
    let (length_unit, mass_unit, factor) = first.units(path, &stated)?;
    if factor != 1.0 {
        objects.iter_mut().for_each(|object| object.radius = object.radius.map(|radius| radius * factor));
    }
    Ok(Some(Catalogue {
        path: path.into(),
        format: first.finder.format,
        length_unit,
        mass_unit,
        box_size: stated.box_size,
        left_out: 0,
        properties: kept.finished(objects.len()),
        objects,
        is_in_plane: false,
        tree: None,
    }))
}

/// Adds the haloes of a file, and what its comments say.
fn push(
    mut lines: Lines,
    heading: Heading,
    stated: &mut Stated,
    objects: &mut Vec<Object>,
    kept: &mut Kept,
) -> Result<(), ExploreError> {
    let path = lines.path;
    let Columns { id, numbers } = heading.columns;
    let before = objects.len();
    let others = heading.names.iter().enumerate();
    let others = others.filter(|(column, _)| !numbers.contains(column) && id != Some(*column));
    let places = others.filter_map(|(column, name)| Some((column, kept.place(name, &Unit::default())?)));
    let places: Vec<(usize, usize)> = places.collect();
    while let Some(line) = lines.row()? {
        if let Some(comment) = line.strip_prefix('#') {
            stated.learn(comment);
            continue;
        }
        let Some((words, [x, y, z, mass, radius])) = heading.row(&lines, &line)? else { continue };
        if objects.len() as u64 == MOST_OBJECTS {
            return Err(ExploreError::malformed(path, "haloes", "more", format!("at most {MOST_OBJECTS}")));
        }
        let name = match id.map(|id| words[id]) {
            Some(id) if id.len() <= 40 && id.bytes().all(|letter| letter.is_ascii_alphanumeric() || letter == b'-') => {
                format!("Halo {id}")
            }
            Some(id) => return Err(lines.wrong("id", id, "a number")),
            None => format!("Halo {}", objects.len()),
        };
        kept.check_room(path, objects.len() + 1)?;
        for (column, place) in &places {
            let value = words.get(*column).and_then(|word| word.parse().ok());
            kept.put(*place, objects.len(), [value.unwrap_or(f64::NAN)]);
        }
        objects.push(Object { name, position: DVec3::new(x, y, z), radius: Some(radius), mass: Some(mass) });
    }
    let found = objects.len() - before;
    if let Some(rows) = heading.rows.filter(|rows| *rows != found as u64) {
        let expected = format!("{rows}, as the second line says");
        return Err(ExploreError::malformed(path, "haloes", found, expected));
    }
    Ok(())
}

/// The words of a row, and its place, mass and radius.
pub(in crate::explore) type Row<'a> = (Vec<&'a str>, [f64; 5]);

/// What stands before the rows.
pub(in crate::explore) struct Heading {
    finder: &'static Finder,
    columns: Columns,
    /// The names of all columns.
    names: Vec<String>,
    /// In how many files the catalogue is.
    files: u64,
    /// How many rows there are, where it says so.
    rows: Option<u64>,
}

impl Heading {
    /// Reads it; `None` where the file begins otherwise.
    pub fn read(lines: &mut Lines) -> Option<Heading> {
        let first = lines.beginning()?;
        if first.starts_with('#') {
            let names = names(&first);
            let known = [&ROCKSTAR, &AHF].into_iter().find_map(|finder| Some((finder, finder.columns(&names)?)));
            let known = known.filter(|(finder, columns)| finder.format != ROCKSTAR.format || columns.id.is_some());
            return known.map(|(finder, columns)| Heading { finder, columns, names, files: 1, rows: None });
        }
        let [_, files] = pair(&first)?;
        let [rows, _] = pair(&lines.beginning()?)?;
        let names = names(&lines.beginning()?);
        let columns = VELOCIRAPTOR.columns(&names)?;
        Some(Heading { finder: &VELOCIRAPTOR, columns, names, files, rows: Some(rows) })
    }

    /// The column of that name, capital letters or not.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|other| other.eq_ignore_ascii_case(name))
    }

    /// Takes the line that was read last apart; `None` of one without words.
    ///
    /// # Errors
    /// Where it has too few of them, or something else than a number.
    pub fn row<'a>(&self, lines: &Lines, line: &'a str) -> Result<Option<Row<'a>>, ExploreError> {
        let Columns { id, numbers } = self.columns;
        let words: Vec<&str> = line.split_whitespace().collect();
        if words.is_empty() {
            return Ok(None);
        }
        let most = numbers.into_iter().chain(id).max().unwrap_or(0) + 1;
        if words.len() < most {
            let expected = format!("at least {most}, as the header has names for them");
            return Err(lines.wrong("values", &words.len().to_string(), expected));
        }
        let [x, y, z] = self.finder.position;
        let mut values = [0.0; 5];
        for ((value, column), name) in values.iter_mut().zip(numbers).zip([x, y, z, "mass", "radius"]) {
            *value = words[column].parse().map_err(|_| lines.wrong(name, words[column], "a number"))?;
        }
        Ok(Some((words, values)))
    }

    /// Units of places and masses, as comments state them or the finder has them, and what brings a radius to that of places.
    ///
    /// # Errors
    /// Where radii are no lengths.
    pub fn units(&self, path: &Path, stated: &Stated) -> Result<(Unit, Unit, f64), ExploreError> {
        let mut units = self.finder.units.map(Unit::new);
        for (unit, stated) in units.iter_mut().zip([&stated.lengths, &stated.radii, &stated.masses]) {
            if let Some(stated) = stated {
                *unit = stated.clone();
            }
        }
        let [length, radius, mass] = units;
        let factor = if radius == length { Some(1.0) } else { radius.ratio(&length) };
        let factor = factor.ok_or_else(|| {
            ExploreError::malformed(path, "unit of radii", &radius, format!("a length as that of positions, {length}"))
        })?;
        Ok((length, mass, factor))
    }
}

/// Two whole numbers and nothing else.
fn pair(line: &str) -> Option<[u64; 2]> {
    let mut words = line.split_whitespace();
    let pair = [words.next()?.parse().ok()?, words.next()?.parse().ok()?];
    words.next().is_none().then_some(pair)
}

/// Names of columns without their numbers; none of a table that this program has a manner of its own for.
fn names(line: &str) -> Vec<String> {
    let name = |word: &str| {
        let numbered = word.strip_suffix(')').and_then(|word| word.rsplit_once('('));
        let plain = numbered.filter(|(_, number)| number.bytes().all(|digit| digit.is_ascii_digit()));
        plain.map_or(word, |(name, _)| name).to_owned()
    };
    let names: Vec<String> = line.trim_start_matches('#').split_whitespace().map(name).collect();
    let is_known = |name: &String| OTHERS.iter().any(|other| name.eq_ignore_ascii_case(other));
    let is_other = line.contains([',', ';']) || names.iter().any(is_known);
    if is_other { Vec::new() } else { names }
}

/// What comments behind the header say, as Rockstar and consistent-trees write them.
#[derive(Default)]
pub(in crate::explore) struct Stated {
    lengths: Option<Unit>,
    radii: Option<Unit>,
    masses: Option<Unit>,
    /// Edge of the periodic box, in the unit of places.
    pub box_size: Option<f64>,
}

impl Stated {
    /// Takes what a comment says.
    pub fn learn(&mut self, comment: &str) {
        let edge = ["Box size:", "Full box size ="];
        if let Some(text) = edge.iter().find_map(|words| comment.trim_start().strip_prefix(words)) {
            let number = text.split_whitespace().next().and_then(|number| number.parse().ok());
            self.box_size = number.filter(|edge: &f64| *edge > 0.0 && edge.is_finite()).or(self.box_size);
        }
        let Some((what, unit)) = comment.trim_start().strip_prefix("Units:").and_then(|text| text.split_once(" in "))
        else {
            return;
        };
        let is_comoving = unit.contains("(comoving");
        // `Mpc / h (comoving)`; what is in brackets is no part of a unit's name.
        let plain: String = unit.split('(').next().unwrap_or_default().split_whitespace().collect();
        let is_name = |text: &str| text.len() <= 40 && text.chars().all(|c| c.is_ascii_graphic());
        if plain.is_empty() || !is_name(&plain) {
            return;
        }
        let unit = Unit::new(if is_comoving { format!("a {plain}") } else { plain });
        match what.trim() {
            what if what.starts_with("Masses") => self.masses = Some(unit),
            what if what.starts_with("Positions") => self.lengths = Some(unit),
            what if what.ends_with("radii") || what.ends_with("Radii") => self.radii = Some(unit),
            _ => {}
        }
    }
}

/// The lines of a file.
pub(in crate::explore) struct Lines<'a> {
    path: &'a Path,
    reader: BufReader<Box<dyn Read>>,
    /// That of the line that was read last, from 1.
    number: u64,
}

impl Lines<'_> {
    /// Opens a file, unpacking it where it is compressed.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn open(path: &Path) -> Result<Lines<'_>, ExploreError> {
        let io = |source| ExploreError::io(path, "reading", source);
        let mut file = BufReader::new(File::open(path).map_err(io)?);
        let is_gzip = file.fill_buf().map_err(io)?.starts_with(&[0x1f, 0x8b]);
        let reader: Box<dyn Read> =
            if is_gzip { Box::new(MultiGzDecoder::new(file).take(MOST_TEXT)) } else { Box::new(file) };
        Ok(Lines { path, reader: BufReader::with_capacity(1 << 18, reader), number: 0 })
    }

    /// The next line's bytes, at most so many as a line may have; none at the end.
    fn bytes(&mut self) -> Result<Vec<u8>, ExploreError> {
        let mut line = Vec::new();
        let read = (&mut self.reader).take(LONGEST).read_until(b'\n', &mut line);
        read.map_err(|source| ExploreError::io(self.path, "reading", source))?;
        self.number += 1;
        Ok(line)
    }

    /// A line of the header; `None` of what is no text, or too long for a line, as in files of other kinds.
    fn beginning(&mut self) -> Option<String> {
        // What is no intact stream is no catalogue of a halo finder; whoever reads it else says what is wrong.
        let line = self.bytes().ok().filter(|line| line.len() as u64 != LONGEST)?;
        String::from_utf8(line).ok().filter(|line| !line.trim().is_empty())
    }

    /// The next line; `None` at the end.
    ///
    /// # Errors
    /// When it cannot be read, is too long, or no text.
    pub fn row(&mut self) -> Result<Option<String>, ExploreError> {
        let line = self.bytes()?;
        if line.is_empty() {
            return Ok(None);
        }
        let wrong = |found: &str| {
            let expected = format!("text of fewer than {LONGEST} bytes");
            ExploreError::malformed(self.path, format!("line {}", self.number), found, expected)
        };
        if line.len() as u64 == LONGEST {
            return Err(wrong("a longer one"));
        }
        String::from_utf8(line).map(Some).map_err(|_| wrong("other bytes"))
    }

    /// What is wrong with the line that was read last.
    pub fn wrong(&self, field: &str, found: &str, expected: impl Into<String>) -> ExploreError {
        let found: String = found.chars().filter(|letter| !letter.is_control()).take(40).collect();
        ExploreError::malformed(self.path, format!("{field} in line {}", self.number), found, expected)
    }
}
