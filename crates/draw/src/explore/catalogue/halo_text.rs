//! Catalogues of halo finders as text, also compressed with gzip: Rockstar and AHF, whose first line is `#` and names of columns, perhaps
//! with their numbers (`Mvir(4)`), and VELOCIraptor, where two lines of two whole numbers are before the names, and the first number of the
//! second line is that of the haloes. Columns are apart by spaces or tabs.

use super::finder::{AHF, Columns, Finder, ROCKSTAR, VELOCIRAPTOR};
use super::{Catalogue, MOST_OBJECTS, Object};
use crate::explore::ExploreError;
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

/// Reads a catalogue; `None` of what is none of a halo finder.
pub(super) fn read(path: &Path) -> Result<Option<Catalogue>, ExploreError> {
    let mut lines = Lines::open(path)?;
    let Some(heading) = Heading::read(&mut lines) else { return Ok(None) };
    let Heading { finder, columns: Columns { id, numbers }, rows } = heading;
    let most = numbers.into_iter().chain(id).max().unwrap_or(0) + 1;
    let mut stated = Stated::default();
    let mut objects = Vec::new();
    while let Some(line) = lines.row()? {
        if let Some(comment) = line.strip_prefix('#') {
            stated.learn(comment);
            continue;
        }
        let fields: Vec<&str> = line.split_whitespace().collect();
        if fields.is_empty() {
            continue;
        }
        let wrong = |field: &str, found: &str, expected: String| {
            let found: String = found.chars().filter(|letter| !letter.is_control()).take(40).collect();
            ExploreError::malformed(path, format!("{field} in line {}", lines.number), found, expected)
        };
        if fields.len() < most {
            let expected = format!("at least {most}, as the header has names for them");
            return Err(wrong("values", &fields.len().to_string(), expected));
        }
        if objects.len() as u64 == MOST_OBJECTS {
            return Err(ExploreError::malformed(path, "haloes", "more", format!("at most {MOST_OBJECTS}")));
        }
        let mut values = [0.0; 5];
        let names = [finder.position[0], finder.position[1], finder.position[2], "mass", "radius"];
        for ((value, column), name) in values.iter_mut().zip(numbers).zip(names) {
            *value = fields[column].parse().map_err(|_| wrong(name, fields[column], "a number".into()))?;
        }
        let name = match id.map(|id| fields[id]) {
            Some(id) if id.len() <= 40 && id.bytes().all(|letter| letter.is_ascii_alphanumeric() || letter == b'-') => {
                format!("Halo {id}")
            }
            Some(id) => return Err(wrong("id", id, "a number".into())),
            None => format!("Halo {}", objects.len()),
        };
        let [x, y, z, mass, radius] = values;
        objects.push(Object { name, position: DVec3::new(x, y, z), radius: Some(radius), mass: Some(mass) });
    }
    if let Some(rows) = rows.filter(|rows| *rows != objects.len() as u64) {
        let expected = format!("{rows}, as the second line says");
        return Err(ExploreError::malformed(path, "haloes", objects.len(), expected));
    }
    let [length, radius, mass] = stated.units(finder);
    if radius != length {
        let factor = radius.ratio(&length).ok_or_else(|| {
            ExploreError::malformed(path, "unit of radii", &radius, format!("a length as that of positions, {length}"))
        })?;
        objects.iter_mut().for_each(|object| object.radius = object.radius.map(|radius| radius * factor));
    }
    Ok(Some(Catalogue {
        path: path.into(),
        format: finder.format,
        length_unit: length,
        mass_unit: mass,
        box_size: stated.box_size,
        left_out: 0,
        objects,
        is_in_plane: false,
        tree: None,
    }))
}

/// What stands before the rows.
struct Heading {
    finder: &'static Finder,
    columns: Columns,
    /// How many rows there are, where it says so.
    rows: Option<u64>,
}

impl Heading {
    /// Reads it; `None` where the file begins otherwise.
    fn read(lines: &mut Lines) -> Option<Heading> {
        let first = lines.beginning()?;
        if first.starts_with('#') {
            let names = names(&first);
            let known = [&ROCKSTAR, &AHF].into_iter().find_map(|finder| Some((finder, finder.columns(&names)?)));
            let known = known.filter(|(finder, columns)| finder.format != ROCKSTAR.format || columns.id.is_some());
            return known.map(|(finder, columns)| Heading { finder, columns, rows: None });
        }
        pair(&first)?;
        let [rows, _] = pair(&lines.beginning()?)?;
        let columns = VELOCIRAPTOR.columns(&names(&lines.beginning()?))?;
        Some(Heading { finder: &VELOCIRAPTOR, columns, rows: Some(rows) })
    }
}

/// Two whole numbers and nothing else.
fn pair(line: &str) -> Option<[u64; 2]> {
    let mut words = line.split_whitespace();
    let pair = [words.next()?.parse().ok()?, words.next()?.parse().ok()?];
    words.next().is_none().then_some(pair)
}

/// Names of columns in lower case without their numbers; none of a table that this program has a manner of its own for.
fn names(line: &str) -> Vec<String> {
    let name = |word: &str| {
        let numbered = word.strip_suffix(')').and_then(|word| word.rsplit_once('('));
        let plain = numbered.filter(|(_, number)| number.bytes().all(|digit| digit.is_ascii_digit()));
        plain.map_or(word, |(name, _)| name).to_lowercase()
    };
    let names: Vec<String> = line.trim_start_matches('#').split_whitespace().map(name).collect();
    let is_other = line.contains([',', ';']) || names.iter().any(|name| OTHERS.contains(&name.as_str()));
    if is_other { Vec::new() } else { names }
}

/// What comments behind the header say, as Rockstar writes them.
#[derive(Default)]
struct Stated {
    lengths: Option<Unit>,
    radii: Option<Unit>,
    masses: Option<Unit>,
    box_size: Option<f64>,
}

impl Stated {
    fn learn(&mut self, comment: &str) {
        if let Some(text) = comment.trim_start().strip_prefix("Box size:") {
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
            what if what.ends_with("radii") || what.starts_with("Radii") => self.radii = Some(unit),
            _ => {}
        }
    }

    /// Units of lengths, radii and masses.
    fn units(&self, finder: &Finder) -> [Unit; 3] {
        let stated = [&self.lengths, &self.radii, &self.masses];
        let mut units = finder.units.map(Unit::new);
        for (unit, stated) in units.iter_mut().zip(stated) {
            if let Some(stated) = stated {
                *unit = stated.clone();
            }
        }
        units
    }
}

/// The lines of a file.
struct Lines<'a> {
    path: &'a Path,
    reader: BufReader<Box<dyn Read>>,
    /// That of the line that was read last, from 1.
    number: u64,
}

impl Lines<'_> {
    fn open(path: &Path) -> Result<Lines<'_>, ExploreError> {
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
    fn row(&mut self) -> Result<Option<String>, ExploreError> {
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
}
