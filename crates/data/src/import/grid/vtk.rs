//! VTK's legacy files of structured points: text, and samples as text or big-endian
//! (<https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html>).

use super::content::Content;
use super::fields::{Entry, TypeNames, sample_type};
use super::layout::{INTERLEAVED, Layout, NATIVE};
use super::source::checked;
use super::{GridDescription, GridFormat, GridSource, ascii};
use crate::import::ImportError;
use crate::import::bytes::Order;
use crate::model::{Channel, Grid, SampleType};
use glam::{DAffine3, DVec3};

/// `STRUCTURED_POINTS` of legacy files; other data sets are named as unsupported.
pub(super) const VTK: GridFormat = GridFormat {
    name: "vtk",
    extensions: &["vtk"],
    has_parts: false,
    detect: |content| content.head.starts_with(b"# vtk DataFile") && !is_of_points(&content.head),
    open,
};

/// Whether a legacy file that begins with these bytes is of points, which are particles and no grid.
pub(in crate::import) fn is_of_points(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(&head[..head.len().min(4096)]);
    let dataset = |line: &str| {
        let mut words = line.split_whitespace();
        words.next().filter(|word| word.eq_ignore_ascii_case("DATASET"))?;
        words.next().map(str::to_ascii_uppercase)
    };
    // Version and title come first; the title may be anything.
    let found = text.lines().skip(2).find_map(dataset);
    head.starts_with(b"# vtk DataFile") && found.is_some_and(|kind| POINTS.contains(&&*kind))
}

/// Data sets of points.
const POINTS: [&str; 2] = ["POLYDATA", "UNSTRUCTURED_GRID"];

/// The types of numbers under their names, in lower case.
pub(in crate::import) const TYPES: TypeNames = &[
    ("char", SampleType::I8),
    ("signed_char", SampleType::I8),
    ("unsigned_char", SampleType::U8),
    ("short", SampleType::I16),
    ("unsigned_short", SampleType::U16),
    ("int", SampleType::I32),
    ("unsigned_int", SampleType::U32),
    ("long", SampleType::I64),
    ("unsigned_long", SampleType::U64),
    ("vtktypeint8", SampleType::I8),
    ("vtktypeuint8", SampleType::U8),
    ("vtktypeint16", SampleType::I16),
    ("vtktypeuint16", SampleType::U16),
    ("vtktypeint32", SampleType::I32),
    ("vtktypeuint32", SampleType::U32),
    ("vtktypeint64", SampleType::I64),
    ("vtktypeuint64", SampleType::U64),
    ("vtktypefloat32", SampleType::F32),
    ("vtktypefloat64", SampleType::F64),
    ("float", SampleType::F32),
    ("double", SampleType::F64),
];

/// The lines of a header.
struct Lines<'a> {
    content: &'a Content,
    at: usize,
}

impl<'a> Lines<'a> {
    /// The next line that is not empty.
    fn next(&mut self, expected: &str) -> Result<String, ImportError> {
        while let Some(rest) = self.content.head.get(self.at..).filter(|rest| !rest.is_empty()) {
            let length = rest.iter().position(|&byte| byte == b'\n').map_or(rest.len(), |at| at + 1);
            self.at += length;
            let text = String::from_utf8_lossy(&rest[..length]).trim().to_owned();
            if !text.is_empty() {
                return Ok(text);
            }
        }
        Err(ImportError::missing(&self.content.path, "header", expected))
    }

    fn entry<'e>(&'e self, name: &'e str, text: &'e str) -> Entry<'e> {
        Entry { path: &self.content.path, name, text }
    }
}

/// The grid's axes as the header has them.
struct Axes {
    sizes: Vec<u64>,
    origin: Vec<f64>,
    spacing: Vec<f64>,
}

/// What stands in front of the samples.
struct Array {
    name: String,
    kind: String,
    components: u64,
    is_of_cells: bool,
}

fn open(content: &Content) -> Result<GridSource, ImportError> {
    let path = &*content.path;
    let mut lines = Lines { content, at: 0 };
    lines.next("a version")?;
    // The title may be empty: it is the second line, whatever stands there.
    let title = content.head[lines.at..]
        .iter()
        .position(|&byte| byte == b'\n')
        .map_or(content.head.len(), |at| lines.at + at + 1);
    lines.at = title;
    let coding = lines.next("BINARY or ASCII")?;
    let is_text = match &*coding.to_uppercase() {
        "ASCII" => true,
        "BINARY" => false,
        _ => return Err(lines.entry("coding", &coding).wrong("BINARY or ASCII")),
    };
    let dataset = lines.next("DATASET STRUCTURED_POINTS")?;
    if dataset.to_uppercase().split_whitespace().ne(["DATASET", "STRUCTURED_POINTS"]) {
        let found = dataset.split_once(' ').map_or(&*dataset, |(_, kind)| kind);
        return Err(lines.entry("DATASET", found).wrong("STRUCTURED_POINTS"));
    }
    let (axes, array) = header(&mut lines)?;
    let is_cells = array.is_of_cells;
    // Cells lie between points, of which there is one more along each axis; an image has no cells across it.
    let size = |axis: usize| match (is_cells, axes.sizes[axis]) {
        (true, points @ 2..) => points - 1,
        (_, points) => points,
    };
    let kind = sample_type(lines.entry("type", &array.kind.to_lowercase()), TYPES)?;
    let channels = named(&array.name, array.components.min(4097));
    let mut grid = Grid::volume([size(0), size(1), size(2)], kind, channels);
    grid.dimensions = if axes.sizes[2] == 1 { 2 } else { 3 };
    let vector = |numbers: &[f64]| DVec3::new(numbers[0], numbers[1], numbers[2]);
    let half = if is_cells { 0.5 } else { 0.0 };
    let mut steps = vector(&axes.spacing);
    if grid.dimensions == 2 && steps.z == 0.0 {
        steps.z = 1.0;
    }
    let first = vector(&axes.origin)
        + half * steps * DVec3::from_array([0, 1, 2].map(|axis| if axes.sizes[axis] > 1 { 1.0 } else { 0.0 }));
    grid.to_world = DAffine3::from_translation(first) * DAffine3::from_scale(steps);
    let bytes = checked(path, &grid, "DIMENSIONS", "SPACING")?;
    let start = lines.at as u64;
    if is_text {
        let most = content.most().saturating_sub(start);
        let storage = ascii::parsed(content.reader(start)?, path, most, bytes, &grid)?;
        let layout = Layout::packed(&grid, INTERLEAVED, 0, NATIVE);
        return Ok(GridSource::new(GridDescription::new(path, VTK.name, content.length, grid), storage, layout));
    }
    let storage = content.samples(start, bytes, &grid)?;
    let layout = Layout::packed(&grid, INTERLEAVED, if content.is_packed { 0 } else { start }, Order::Big);
    Ok(GridSource::new(GridDescription::new(path, VTK.name, content.length, grid), storage, layout))
}

/// Reads up to the first array of samples.
fn header(lines: &mut Lines) -> Result<(Axes, Array), ImportError> {
    let mut axes = Axes { sizes: Vec::new(), origin: vec![0.0; 3], spacing: vec![1.0; 3] };
    let mut count: Option<(bool, u64)> = None;
    loop {
        let line = lines.next("POINT_DATA and SCALARS")?;
        let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((&line, ""));
        let words: Vec<&str> = rest.split_whitespace().collect();
        let array = |name: &str, kind: &str, components: u64, is_of_cells: bool| Array {
            name: name.to_owned(),
            kind: kind.to_owned(),
            components,
            is_of_cells,
        };
        match (&*word.to_uppercase(), count) {
            ("DIMENSIONS", _) => axes.sizes = lines.entry("DIMENSIONS", rest).exactly(3)?,
            ("ORIGIN", _) => axes.origin = lines.entry("ORIGIN", rest).exactly(3)?,
            ("SPACING" | "ASPECT_RATIO", _) => axes.spacing = lines.entry("SPACING", rest).exactly(3)?,
            (data @ ("POINT_DATA" | "CELL_DATA"), _) => {
                count = Some((data == "CELL_DATA", lines.entry(word, rest).value("a number of samples")?));
            }
            (kind @ ("SCALARS" | "VECTORS" | "NORMALS" | "FIELD"), Some((is_of_cells, count))) => {
                let found = match (kind, &words[..]) {
                    ("FIELD", _) => {
                        let line = lines.next("an array of the field")?;
                        let words: Vec<&str> = line.split_whitespace().collect();
                        let [name, components, _, kind] = words[..] else {
                            return Err(lines.entry("FIELD", &line).wrong("name, components, tuples and type"));
                        };
                        array(name, kind, lines.entry("FIELD", components).value("a number")?, is_of_cells)
                    }
                    ("SCALARS", [name, kind]) => array(name, kind, 1, is_of_cells),
                    ("SCALARS", [name, kind, components, ..]) => {
                        array(name, kind, lines.entry("SCALARS", components).value("a number")?, is_of_cells)
                    }
                    (_, [name, kind, ..]) => array(name, kind, 3, is_of_cells),
                    _ => return Err(lines.entry(kind, rest).wrong("a name and a type")),
                };
                // A table of colours may be named behind SCALARS.
                let at = lines.at;
                if kind == "SCALARS"
                    && !lines.next("samples").is_ok_and(|line| line.to_uppercase().starts_with("LOOKUP_TABLE"))
                {
                    lines.at = at;
                }
                if axes.sizes.len() != 3 {
                    return Err(ImportError::missing(&lines.content.path, "DIMENSIONS", "three sizes"));
                }
                let expected = axes.sizes.iter().try_fold(1_u64, |all, &size| {
                    all.checked_mul(if is_of_cells && size > 1 { size - 1 } else { size })
                });
                if expected != Some(count) {
                    let expected = expected.map_or("fewer".into(), |count| count.to_string());
                    let field = if is_of_cells { "CELL_DATA" } else { "POINT_DATA" };
                    return Err(ImportError::malformed(&lines.content.path, field, count, expected));
                }
                return Ok((axes, found));
            }
            (other, None) if !other.is_empty() => {
                return Err(lines.entry("header", &line).wrong("POINT_DATA or CELL_DATA"));
            }
            _ => return Err(lines.entry("array", &line).wrong("SCALARS, VECTORS or FIELD")),
        }
    }
}

/// Channels of an array of this name.
pub(super) fn named(name: &str, components: u64) -> Vec<Channel> {
    match components {
        1 if !name.is_empty() => vec![Channel::new(name)],
        3 if !name.is_empty() => ["x", "y", "z"].iter().map(|axis| Channel::new(format!("{name}-{axis}"))).collect(),
        several => Channel::numbered(several),
    }
}
