//! Data sets of points in XML: their pieces, in the file itself or in those that a parallel one names.

use super::arrays::{Arrays, MOST_ARRAYS, MOST_COMPONENTS, Pieces, Place};
use crate::import::ImportError;
use crate::import::bytes::Order;
use crate::import::grid::scratch::{Scratch, Storage};
use crate::import::grid::{Content, Element, Entry, VtkArray, XML_TYPES, sample_type, xml_data_set, xml_elements};
use crate::import::packed::MOST_EXPANSION;
use crate::model::{Channel, Grid, SampleType, Unit};
use std::collections::BTreeSet;
use std::io::Read;
use std::path::Path;

/// How many times the size of the file its arrays may be together as text, where a digit and a space are a number of eight bytes.
const MOST_AS_TEXT: u64 = 8;

/// The longest unit, bytes.
const LONGEST_UNIT: u64 = 1 << 10;

/// What an array belongs to.
#[derive(Clone, Copy, PartialEq)]
enum Section {
    Points,
    PointData,
    Other,
}

/// The attribute of a piece that names the file that it is in.
pub(super) const SOURCE: &str = "Source";

/// The pieces that have points, and their arrays.
///
/// # Errors
/// When a file cannot be read, or is damaged, or one that is named names others itself, or is named twice.
pub(super) fn open(content: &Content) -> Result<Pieces, ImportError> {
    let mut all = Reading::new(&content.path);
    let Some(names) = sources(content)? else {
        all.file(content)?;
        return all.finished();
    };
    // It is one of them.
    (all.pieces.files, all.pieces.bytes) = (1, content.length);
    let mut known = BTreeSet::new();
    for name in names {
        let wrong = |expected: &str| Entry { path: &content.path, name: SOURCE, text: &name }.wrong(expected);
        let source = content.beside(SOURCE, &name)?;
        let own = source.path.canonicalize().map_err(|error| ImportError::io(&source.path, "file", error))?;
        if !known.insert(own) {
            return Err(wrong("each file once"));
        }
        if !matches!(xml_data_set(&source.head).as_deref(), Some("PolyData" | "UnstructuredGrid")) {
            return Err(wrong("a file with PolyData or UnstructuredGrid"));
        }
        all.file(&source)?;
    }
    all.finished()
}

/// The files with the points of a parallel file, as it names them; `None` where it has its points itself.
///
/// # Errors
/// When the file cannot be read, or is damaged.
pub(super) fn sources(content: &Content) -> Result<Option<Vec<String>>, ImportError> {
    if !matches!(xml_data_set(&content.head).as_deref(), Some("PPolyData" | "PUnstructuredGrid")) {
        return Ok(None);
    }
    let elements = elements(content)?;
    let name = |piece: &Element| {
        let missing = || ImportError::missing(&content.path, SOURCE, "the name of a file in each piece");
        piece.get(SOURCE).map(plain).ok_or_else(missing)
    };
    elements.iter().filter(|element| element.name == "Piece").map(name).collect::<Result<_, _>>().map(Some)
}

/// The tags of a file, of which all pieces are there.
fn elements(content: &Content) -> Result<Vec<Element>, ImportError> {
    let elements = xml_elements(content)?;
    let end = format!("/{}", xml_data_set(&content.head).unwrap_or_default());
    match elements.iter().any(|element| element.name == end) {
        true => Ok(elements),
        false => Err(ImportError::missing(&content.path, end, "the end of the data set, behind all pieces")),
    }
}

/// The place among the storages of what was unpacked.
const UNPACKED: usize = 0;

/// Pieces while they are read. What is unpacked of them lies in one storage, an array behind the other, so that any number of them takes as much memory
/// as one.
struct Reading {
    pieces: Pieces,
    unpacked: Scratch,
    /// Bytes in that.
    taken: u64,
}

impl Reading {
    /// None yet, of the file at `path`.
    fn new(path: &Path) -> Reading {
        let pieces = Pieces { storages: vec![Storage::Memory(Vec::new())], ..Pieces::default() };
        Reading { pieces, unpacked: Scratch::new(path), taken: 0 }
    }

    /// Adds the pieces of a file.
    fn file(&mut self, content: &Content) -> Result<(), ImportError> {
        let path = &*content.path;
        let elements = elements(content)?;
        let file = elements.iter().find(|element| element.name == "VTKFile");
        let file = file.ok_or_else(|| ImportError::missing(path, "VTKFile", "an element of this name"))?;
        let order = if file.get("byte_order") == Some("BigEndian") { Order::Big } else { Order::Little };
        let expansion = if file.get("compressor").is_some() { MOST_EXPANSION } else { MOST_AS_TEXT };
        let left = content.most().saturating_mul(expansion);
        let mut opened = Opened { content, elements: &elements, order, left, in_place: None };
        for (count, found) in with_points(content, &elements)? {
            let arrays = opened.arrays(count, found, self)?;
            self.pieces.arrays.push(arrays);
        }
        self.pieces.files += 1;
        self.pieces.bytes = self.pieces.bytes.saturating_add(content.length);
        Ok(())
    }

    /// Where an array is: its storage, and its first byte there. `in_place` is the storage that is its file, where that is open already.
    fn put(&mut self, storage: Storage, offset: u64, in_place: Option<usize>) -> Result<(usize, u64), ImportError> {
        match (storage, in_place) {
            (_, Some(known)) => Ok((known, offset)),
            (Storage::Memory(bytes), None) => {
                self.unpacked.write(&bytes)?;
                let first = self.taken;
                self.taken += bytes.len() as u64;
                Ok((UNPACKED, first + offset))
            }
            (own, None) => {
                self.pieces.storages.push(own);
                Ok((self.pieces.storages.len() - 1, offset))
            }
        }
    }

    /// All pieces.
    fn finished(mut self) -> Result<Pieces, ImportError> {
        self.pieces.storages[UNPACKED] = self.unpacked.into_storage()?;
        Ok(self.pieces)
    }
}

/// A file whose arrays are read.
struct Opened<'f> {
    content: &'f Content,
    elements: &'f [Element],
    order: Order,
    /// The most bytes that its other arrays can be.
    left: u64,
    /// Which storage is the file itself, where one is: it is open once.
    in_place: Option<usize>,
}

impl Opened<'_> {
    /// The arrays of a piece of `count` points.
    fn arrays(&mut self, count: u64, found: Vec<Found>, all: &mut Reading) -> Result<Arrays, ImportError> {
        let content = self.content;
        let path = &*content.path;
        let mut arrays = Arrays::new(count);
        let mut taken = 0;
        for (number, Found { section, element, unit }) in found.into_iter().enumerate() {
            let name = element.get("Name").unwrap_or_default();
            let entry = |name: &'static str| Entry { path, name, text: element.get(name).unwrap_or_default() };
            let components: u64 = match element.get("NumberOfComponents") {
                None => 1,
                Some(_) => entry("NumberOfComponents").value("a number")?,
            };
            let is_points = section == Section::Points;
            let kind = match sample_type(entry("type"), XML_TYPES) {
                Ok(kind) if (1..=MOST_COMPONENTS).contains(&components) && taken < MOST_ARRAYS => kind,
                Err(error) if is_points => return Err(error),
                // Texts, and matrices of any size.
                _ => {
                    arrays.left_out.push(name.chars().filter(|letter| !letter.is_control()).collect());
                    continue;
                }
            };
            if is_points && components != 3 {
                return Err(entry("NumberOfComponents").wrong("3, as points are in space"));
            }
            let grid = described(count, kind, components);
            let Some(bytes) = grid.bytes().filter(|bytes| *bytes <= self.left) else {
                let expected = format!("no more than a file of {} bytes can hold", content.length);
                return Err(ImportError::malformed(path, "NumberOfPoints", count, expected));
            };
            self.left -= bytes;
            taken += 1;
            let array = VtkArray::open(content, self.elements, element, bytes, &grid, self.order)?;
            let known = self.in_place.filter(|_| array.is_in_place);
            let (storage, offset) = all.put(array.storage, array.offset, known)?;
            if array.is_in_place {
                self.in_place = Some(storage);
            }
            let place = Place { storage, offset, number: kind, order: array.order, components };
            match is_points {
                true => arrays.push_points(&place),
                false => arrays.push(name, number, &place),
            }
            if let Some(unit) = unit {
                arrays.set_unit((!is_points).then_some(name), &unit_in(content, unit)?);
            }
        }
        Ok(arrays)
    }
}

/// The text of an element, as a unit.
fn unit_in(content: &Content, element: &Element) -> Result<Unit, ImportError> {
    let mut text = Vec::new();
    let io = |error| ImportError::io(&content.path, "UNITS_LABEL", error);
    content.reader(element.end)?.take(element.text.min(LONGEST_UNIT)).read_to_end(&mut text).map_err(io)?;
    let text: String = String::from_utf8_lossy(&text).chars().filter(|letter| !letter.is_control()).collect();
    Ok(Unit::new(plain(&text).trim()))
}

/// A text with the letters that XML has names for.
fn plain(text: &str) -> String {
    let letters = [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&apos;", "'"), ("&amp;", "&")];
    letters.iter().fold(text.to_owned(), |text, (name, letter)| text.replace(name, letter))
}

/// An array of a piece, and the element that says its unit.
struct Found<'e> {
    section: Section,
    element: &'e Element,
    unit: Option<&'e Element>,
}

/// The pieces that have points: how many, and the arrays of them.
fn with_points<'e>(content: &Content, elements: &'e [Element]) -> Result<Vec<(u64, Vec<Found<'e>>)>, ImportError> {
    let path = &*content.path;
    let mut pieces: Vec<(u64, Vec<Found>)> = Vec::new();
    let (mut is_read, mut section) = (false, Section::Other);
    for element in elements {
        match &*element.name {
            "Piece" => {
                let text = element.get("NumberOfPoints").unwrap_or_default();
                let count: u64 = Entry { path, name: "NumberOfPoints", text }.value("a number of points")?;
                is_read = count > 0;
                pieces.extend(is_read.then(|| (count, Vec::new())));
                section = Section::Other;
            }
            "Points" => section = Section::Points,
            "PointData" => section = Section::PointData,
            "DataArray" if is_read && section != Section::Other => {
                if let Some((_, found)) = pieces.last_mut() {
                    found.push(Found { section, element, unit: None });
                }
            }
            "InformationKey" if section != Section::Other && element.get("name") == Some("UNITS_LABEL") => {
                if let Some(array) = pieces.last_mut().and_then(|(_, found)| found.last_mut()) {
                    array.unit = Some(element);
                }
            }
            "DataArray" | "/DataArray" | "InformationKey" | "/InformationKey" | "Value" | "/Value" => {}
            _ => section = Section::Other,
        }
    }
    Ok(pieces)
}

/// An array of `count` times `components` numbers, for messages.
fn described(count: u64, kind: SampleType, components: u64) -> Grid {
    Grid { dimensions: 1, ..Grid::volume([count, 1, 1], kind, Channel::numbered(components)) }
}
