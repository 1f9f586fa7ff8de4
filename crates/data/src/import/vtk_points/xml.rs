//! Data sets of points in XML, in one piece.

use super::arrays::{Arrays, MOST_ARRAYS, MOST_COMPONENTS, Place};
use crate::import::ImportError;
use crate::import::bytes::Order;
use crate::import::grid::{Content, Element, Entry, VtkArray, XML_TYPES, sample_type, xml_elements};
use crate::import::packed::MOST_EXPANSION;
use crate::model::{Channel, Grid, SampleType, Unit};
use std::io::Read;

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

/// The arrays of the piece that has points.
///
/// # Errors
/// When the file cannot be read, or is damaged.
pub(super) fn open(content: &Content) -> Result<Arrays, ImportError> {
    let path = &*content.path;
    let elements = xml_elements(content)?;
    let file = elements.iter().find(|element| element.name == "VTKFile");
    let file = file.ok_or_else(|| ImportError::missing(path, "VTKFile", "an element of this name"))?;
    let order = if file.get("byte_order") == Some("BigEndian") { Order::Big } else { Order::Little };
    let (count, found) = piece(content, &elements)?;
    let expansion = if file.get("compressor").is_some() { MOST_EXPANSION } else { MOST_AS_TEXT };
    let mut left = content.most().saturating_mul(expansion);
    let mut arrays = Arrays::new(count);
    for (number, Found { section, element, unit }) in found.into_iter().enumerate() {
        let name = element.get("Name").unwrap_or_default();
        let entry = |name: &'static str| Entry { path, name, text: element.get(name).unwrap_or_default() };
        let components: u64 = match element.get("NumberOfComponents") {
            None => 1,
            Some(_) => entry("NumberOfComponents").value("a number")?,
        };
        let is_points = section == Section::Points;
        let kind = sample_type(entry("type"), XML_TYPES);
        let kind = match kind {
            Ok(kind) if (1..=MOST_COMPONENTS).contains(&components) && arrays.storages.len() < MOST_ARRAYS => kind,
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
        let bytes = grid.bytes().filter(|bytes| *bytes <= left);
        let Some(bytes) = bytes else {
            let expected = format!("no more than a file of {} bytes can hold", content.length);
            return Err(ImportError::malformed(path, "NumberOfPoints", count, expected));
        };
        left -= bytes;
        let VtkArray { storage, offset, order } = VtkArray::open(content, &elements, element, bytes, &grid, order)?;
        let place = Place { storage: arrays.storages.len(), offset, number: kind, order, components };
        arrays.storages.push(storage);
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

/// The text of an element, as a unit.
fn unit_in(content: &Content, element: &Element) -> Result<Unit, ImportError> {
    let mut text = Vec::new();
    let io = |error| ImportError::io(&content.path, "UNITS_LABEL", error);
    content.reader(element.end)?.take(element.text.min(LONGEST_UNIT)).read_to_end(&mut text).map_err(io)?;
    let text: String = String::from_utf8_lossy(&text).chars().filter(|letter| !letter.is_control()).collect();
    let plain = [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&apos;", "'"), ("&amp;", "&")];
    Ok(Unit::new(plain.iter().fold(text, |text, (name, letter)| text.replace(name, letter)).trim()))
}

/// An array of a piece, and the element that says its unit.
struct Found<'e> {
    section: Section,
    element: &'e Element,
    unit: Option<&'e Element>,
}

/// Points in the one piece that has some, and the arrays of it.
fn piece<'e>(content: &Content, elements: &'e [Element]) -> Result<(u64, Vec<Found<'e>>), ImportError> {
    let path = &*content.path;
    let mut points: Option<u64> = None;
    let (mut is_read, mut section) = (false, Section::Other);
    let mut found: Vec<Found> = Vec::new();
    for element in elements {
        match &*element.name {
            "Piece" => {
                let text = element.get("NumberOfPoints").unwrap_or_default();
                let count: u64 = Entry { path, name: "NumberOfPoints", text }.value("a number of points")?;
                is_read = count > 0;
                if is_read && points.is_some() {
                    return Err(ImportError::malformed(path, "Piece", "several", "one piece with points"));
                }
                points = points.or(is_read.then_some(count));
                section = Section::Other;
            }
            "Points" => section = Section::Points,
            "PointData" => section = Section::PointData,
            "DataArray" if is_read && section != Section::Other => found.push(Found { section, element, unit: None }),
            "InformationKey" if section != Section::Other && element.get("name") == Some("UNITS_LABEL") => {
                if let Some(array) = found.last_mut() {
                    array.unit = Some(element);
                }
            }
            "DataArray" | "/DataArray" | "InformationKey" | "/InformationKey" | "Value" | "/Value" => {}
            _ => section = Section::Other,
        }
    }
    let none = || ImportError::NoParticles { path: path.into(), field: "NumberOfPoints".into() };
    Ok((points.ok_or_else(none)?, found))
}

/// An array of `count` times `components` numbers, for messages.
fn described(count: u64, kind: SampleType, components: u64) -> Grid {
    Grid { dimensions: 1, ..Grid::volume([count, 1, 1], kind, Channel::numbered(components)) }
}
