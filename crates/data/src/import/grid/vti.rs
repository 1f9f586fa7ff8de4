//! VTK's image data in XML: samples as text, base64 or raw, inline or appended, compressed by zlib or not
//! (<https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html>).

use super::base64::Base64;
use super::content::{Content, filled, in_one_line, too_few};
use super::fields::{Entry, TypeNames, sample_type};
use super::layout::{INTERLEAVED, Layout, NATIVE};
use super::scratch::{Scratch, Storage};
use super::source::checked;
use super::vtk::named;
use super::xml::{Element, elements};
use super::{GridDescription, GridFormat, GridSource, ascii};
use crate::import::ImportError;
use crate::import::bytes::Order;
use crate::model::{Grid, SampleType};
use flate2::read::ZlibDecoder;
use glam::{DAffine3, DMat3, DVec3};
use std::io::{BufReader, Read};

/// `ImageData` in one piece.
pub(super) const VTI: GridFormat = GridFormat {
    name: "vti",
    extensions: &["vti"],
    has_parts: false,
    detect: |content| {
        let start = String::from_utf8_lossy(&content.head[..content.head.len().min(4096)]);
        let start = start.trim_start_matches('\u{feff}').trim_start();
        start.starts_with('<') && start.contains("<VTKFile")
    },
    open,
};

const TYPES: TypeNames = &[
    ("Int8", SampleType::I8),
    ("UInt8", SampleType::U8),
    ("Int16", SampleType::I16),
    ("UInt16", SampleType::U16),
    ("Int32", SampleType::I32),
    ("UInt32", SampleType::U32),
    ("Int64", SampleType::I64),
    ("UInt64", SampleType::U64),
    ("Float32", SampleType::F32),
    ("Float64", SampleType::F64),
];

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
    let kind = sample_type(attribute("type"), TYPES)?;
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
    let (storage, layout) = samples(content, &elements, array, bytes, &grid, order)?;
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

/// The samples, and how they lie.
fn samples(
    content: &Content,
    elements: &[Element],
    array: &Element,
    bytes: u64,
    grid: &Grid,
    order: Order,
) -> Result<(Storage, Layout), ImportError> {
    let path = &*content.path;
    let find = |name: &str| elements.iter().find(|element| element.name == name);
    let packed = |offset: u64, order: Order| Layout::packed(grid, INTERLEAVED, offset, order);
    let file = find("VTKFile");
    let is_compressed = match file.and_then(|file| file.get("compressor")) {
        None => false,
        Some("vtkZLibDataCompressor") => true,
        Some(text) => return Err(Entry { path, name: "compressor", text }.wrong("vtkZLibDataCompressor")),
    };
    let word = match file.and_then(|file| file.get("header_type")) {
        None | Some("UInt32") => 4,
        Some("UInt64") => 8,
        Some(text) => return Err(Entry { path, name: "header_type", text }.wrong("UInt32 or UInt64")),
    };
    let format = Entry { path, name: "format", text: array.get("format").unwrap_or("ascii") };
    let inline = || content.reader(array.end).map(|reader| reader.take(array.text));
    let (reader, is_raw, start): (Box<dyn Read>, bool, u64) = match format.text {
        "ascii" => {
            let most = array.text.min(content.most());
            return Ok((ascii::parsed(inline()?, path, most, bytes, grid)?, packed(0, NATIVE)));
        }
        "binary" => (Box::new(Base64::new(inline()?)), false, array.end),
        "appended" => {
            let missing = || ImportError::missing(path, "AppendedData", "an element of this name, and _ in it");
            let appended = find("AppendedData").ok_or_else(missing)?;
            let offset = Entry { path, name: "offset", text: array.get("offset").unwrap_or_default() };
            let offset: u64 = offset.value("a number of bytes")?;
            let begin = underscore(content, appended.end)?.ok_or_else(missing)?;
            let start = begin.checked_add(offset).filter(|start| *start <= content.most());
            let start = start.ok_or_else(|| ImportError::malformed(path, "offset", offset, "a byte in the file"))?;
            let reader = content.reader(start)?;
            match appended.get("encoding") {
                Some("raw") => (reader, true, start),
                _ => (Box::new(Base64::new(reader)), false, start),
            }
        }
        _ => return Err(format.wrong("ascii, binary or appended")),
    };
    let mut blocks = Blocks { reader: BufReader::new(reader), content, word, order, bytes, grid };
    if is_compressed {
        content.check_packed(content.most(), bytes, grid)?;
        return Ok((blocks.unpacked()?, packed(0, order)));
    }
    let stated = blocks.number()?;
    if stated != bytes {
        return Err(too_few(path, &format!("{stated} bytes"), bytes, grid));
    }
    if is_raw && !content.is_packed {
        let offset = start + word as u64;
        return Ok((content.samples(offset, bytes, grid)?, packed(offset, order)));
    }
    content.check_packed(content.length, bytes, grid)?;
    // What follows an array is another, no checksum.
    Ok((filled(blocks.reader.take(bytes), path, bytes, grid)?, packed(0, order)))
}

/// The byte behind the `_` that appended data begins with.
fn underscore(content: &Content, from: u64) -> Result<Option<u64>, ImportError> {
    let mut start = Vec::new();
    let read = content.reader(from)?.take(4096).read_to_end(&mut start);
    read.map_err(|error| ImportError::io(&content.path, "AppendedData", error))?;
    let found = start.iter().position(|byte| !byte.is_ascii_whitespace()).filter(|&at| start[at] == b'_');
    Ok(found.map(|at| from + at as u64 + 1))
}

/// An array with sizes in front of it.
struct Blocks<'a> {
    reader: BufReader<Box<dyn Read + 'a>>,
    content: &'a Content,
    /// Bytes of a size.
    word: usize,
    order: Order,
    bytes: u64,
    grid: &'a Grid,
}

impl Blocks<'_> {
    /// The next size.
    fn number(&mut self) -> Result<u64, ImportError> {
        let mut bytes = [0; 8];
        let read = self.reader.read_exact(&mut bytes[..self.word]);
        read.map_err(|error| too_few(&self.content.path, &in_one_line(&error), self.bytes, self.grid))?;
        Ok(match (self.word, self.order) {
            (4, order) => order.u32(&bytes, 0).into(),
            (_, order) => order.f64(&bytes, 0).to_bits(),
        })
    }

    /// Unpacks all blocks: their number, the size of all but the last, that of the last (0: as the others), and what each has as it is
    /// compressed, stand in front of them.
    fn unpacked(mut self) -> Result<Storage, ImportError> {
        let path = &self.content.path;
        let (count, size, last) = (self.number()?, self.number()?, self.number()?);
        let whole = if last == 0 { Some(count) } else { count.checked_sub(1) };
        let stated = whole.and_then(|whole| whole.checked_mul(size)).and_then(|bytes| bytes.checked_add(last));
        // Every block has its size among those in front, so that there are no more than the file has words.
        if stated != Some(self.bytes) || count > self.content.most() / self.word as u64 {
            let found = stated.map_or_else(|| "too many bytes".into(), |bytes| format!("{bytes} bytes"));
            return Err(too_few(path, &format!("{found} in {count} blocks"), self.bytes, self.grid));
        }
        let mut sizes = Vec::new();
        for _ in 0..count {
            sizes.push(self.number()?);
        }
        let mut scratch = Scratch::new(path);
        let mut buffer = vec![0; 1 << 16];
        for (number, packed) in sizes.iter().enumerate() {
            let mut left = if last > 0 && number as u64 + 1 == count { last } else { size };
            let mut input = (&mut self.reader).take(*packed);
            let mut block = ZlibDecoder::new(&mut input);
            while left > 0 {
                let most = buffer.len().min(usize::try_from(left).unwrap_or(usize::MAX));
                let read = block.read(&mut buffer[..most]);
                match read {
                    Ok(read @ 1..) => {
                        scratch.write(&buffer[..read])?;
                        left -= read as u64;
                    }
                    Ok(_) => {
                        let found = format!("{left} bytes less in block {}", number + 1);
                        return Err(too_few(path, &found, self.bytes, self.grid));
                    }
                    Err(error) => {
                        let field = format!("data: block {}", number + 1);
                        return Err(ImportError::malformed(path, field, in_one_line(&error), "zlib"));
                    }
                }
            }
            let rest = std::io::copy(&mut input, &mut std::io::sink());
            rest.map_err(|error| ImportError::malformed(path, "data", in_one_line(&error), "more blocks"))?;
        }
        scratch.into_storage()
    }
}
