//! VTK's image data in XML: samples as text, base64 or raw, inline or appended, compressed by zlib or not
//! (<https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html>).

use super::content::Content;
use super::fields::{Entry, sample_type};
use super::layout::{INTERLEAVED, Layout};
use super::source::checked;
use super::vtk::named;
use super::vtk_array::{VtkArray, XML_POINTS, XML_TYPES, xml_data_set};
use super::xml::{Element, elements};
use super::{GridDescription, GridFormat, GridSource};
use crate::import::ImportError;
use crate::import::bytes::Order;
use crate::model::Grid;
use glam::{DAffine3, DMat3, DVec3};

/// `ImageData` in one piece.
pub(super) const VTI: GridFormat = GridFormat {
    name: "vti",
    extensions: &["vti"],
    has_parts: false,
    detect: |content| xml_data_set(&content.head).is_some_and(|kind| !XML_POINTS.contains(&&*kind)),
    open,
};

/// The array that is read: its element, whether it is of cells, and the names of the others.
struct Chosen<'e> {
    array: &'e Element,
    is_of_cells: bool,
    left_out: Vec<&'e str>,
}

fn open(content: &Content) -> Result<GridSource, ImportError> {
    let path = &*content.path;
    let elements = elements(content)?;
    let find = |name: &str| elements.iter().find(|element| element.name == name);
    let needed = |name: &str| find(name).ok_or_else(|| ImportError::missing(path, name, "an element of this name"));
    let file = needed("VTKFile")?;
    if file.get("type") != Some("ImageData") {
        let found = Entry { path, name: "VTKFile: type", text: file.get("type").unwrap_or_default() };
        return Err(found.wrong("ImageData"));
    }
    let image = needed("ImageData")?;
    let extent = Entry { path, name: "WholeExtent", text: image.get("WholeExtent").unwrap_or_default() };
    let extents: Vec<i64> = extent.exactly(6)?;
    if let Some(piece) = find("Piece").and_then(|piece| piece.get("Extent")) {
        let piece = Entry { path, name: "Piece: Extent", text: piece };
        if piece.exactly::<i64>(6)? != extents {
            return Err(piece.wrong("the whole extent"));
        }
    }
    let Chosen { array, is_of_cells, left_out } =
        chosen(&elements).ok_or_else(|| ImportError::missing(path, "DataArray", "an array of points or cells"))?;
    let attribute = |name: &'static str| Entry { path, name, text: array.get(name).unwrap_or_default() };
    let points = |axis: usize| {
        let count = extents[2 * axis + 1].checked_sub(extents[2 * axis]).and_then(|count| count.checked_add(1));
        count.and_then(|count| u64::try_from(count).ok()).ok_or_else(|| extent.wrong("ends behind beginnings"))
    };
    let points = [points(0)?, points(1)?, points(2)?];
    let shape = points.map(|count| if is_of_cells && count > 1 { count - 1 } else { count });
    let kind = sample_type(attribute("type"), XML_TYPES)?;
    let components: u64 = match array.get("NumberOfComponents") {
        None => 1,
        Some(text) => Entry { path, name: "NumberOfComponents", text }.value("a number")?,
    };
    let channels = named(array.get("Name").unwrap_or_default(), components.min(4097));
    let mut grid = Grid::volume(shape, kind, channels);
    grid.dimensions = if points[2] == 1 { 2 } else { 3 };
    place(&mut grid, image, content, &extents, is_of_cells)?;
    let bytes = checked(path, &grid, "WholeExtent", "Direction")?;
    let order = if file.get("byte_order") == Some("BigEndian") { Order::Big } else { Order::Little };
    let VtkArray { storage, offset, order, .. } = VtkArray::open(content, &elements, array, bytes, &grid, order)?;
    let layout = Layout::packed(&grid, INTERLEAVED, offset, order);
    let mut about = GridDescription::new(path, VTI.name, content.length, grid);
    if !left_out.is_empty() {
        about.notes.push(format!("other arrays are left out: {}", left_out.join(", ")));
    }
    Ok(GridSource::new(about, storage, layout))
}

/// Of the points' arrays the one that is named as their scalars, else the first, else that of cells.
fn chosen(elements: &[Element]) -> Option<Chosen<'_>> {
    let mut section: Option<&Element> = None;
    let mut arrays: Vec<(&Element, bool, bool)> = Vec::new();
    for element in elements {
        match &*element.name {
            "PointData" | "CellData" => section = Some(element),
            "/PointData" | "/CellData" => section = None,
            "DataArray" => {
                if let Some(section) = section {
                    let is_named = section.get("Scalars").is_some_and(|name| element.get("Name") == Some(name));
                    arrays.push((element, section.name == "CellData", is_named));
                }
            }
            _ => {}
        }
    }
    let (array, is_of_cells, _) = *arrays.iter().min_by_key(|(_, is_of_cells, is_named)| (*is_of_cells, !*is_named))?;
    let others = arrays.iter().filter(|(other, ..)| !std::ptr::eq(*other, array));
    let left_out = others.map(|(other, ..)| other.get("Name").unwrap_or("one without a name")).collect();
    Some(Chosen { array, is_of_cells, left_out })
}

/// Puts the samples to where the image is.
fn place(
    grid: &mut Grid,
    image: &Element,
    content: &Content,
    extents: &[i64],
    is_of_cells: bool,
) -> Result<(), ImportError> {
    let numbers = |name: &str, usual: &[f64]| -> Result<Vec<f64>, ImportError> {
        match image.get(name) {
            None => Ok(usual.to_vec()),
            Some(text) => Entry { path: &content.path, name, text }.exactly(usual.len()),
        }
    };
    let origin = numbers("Origin", &[0.0; 3])?;
    let mut spacing = numbers("Spacing", &[1.0; 3])?;
    let direction = numbers("Direction", &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])?;
    if grid.dimensions == 2 && spacing[2] == 0.0 {
        spacing[2] = 1.0;
    }
    // Columns of the matrix are axes; the origin is the place of index 0, which need not be in the extent.
    let column = |axis: usize| DVec3::new(direction[axis], direction[3 + axis], direction[6 + axis]) * spacing[axis];
    let matrix = DMat3::from_cols(column(0), column(1), column(2));
    let first = [0, 1, 2].map(|axis| {
        let half = if is_of_cells && extents[2 * axis] != extents[2 * axis + 1] { 0.5 } else { 0.0 };
        extents[2 * axis] as f64 + half
    });
    let at = DVec3::new(origin[0], origin[1], origin[2]) + matrix * DVec3::from_array(first);
    grid.to_world = DAffine3::from_mat3_translation(matrix, at);
    Ok(())
}
