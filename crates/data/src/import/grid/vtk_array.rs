//! The arrays of VTK's files in XML: numbers as text, base64 or raw, inline or appended, compressed by zlib or LZ4 or not
//! (<https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html>).

use super::ascii;
use super::base64::Base64;
use super::content::{Content, filled, in_one_line, too_few};
use super::fields::{Entry, TypeNames};
use super::scratch::{Scratch, Storage};
use super::xml::Element;
use crate::import::ImportError;
use crate::import::bytes::Order;
use crate::model::{Grid, SampleType};
use flate2::read::ZlibDecoder;
use std::io::{BufReader, Read};

/// Data sets that are points, and those whose points are in other files: they are particles, no grids.
pub(in crate::import) const XML_POINTS: [&str; 4] = ["PolyData", "UnstructuredGrid", "PPolyData", "PUnstructuredGrid"];

/// The data set that a file in XML names at its beginning; empty where it names none, `None` for files of other formats.
pub(in crate::import) fn xml_data_set(head: &[u8]) -> Option<String> {
    let start = String::from_utf8_lossy(&head[..head.len().min(4096)]);
    let start = start.trim_start_matches('\u{feff}').trim_start();
    let (_, tag) = start.split_once("<VTKFile").filter(|_| start.starts_with('<'))?;
    let tag = tag.split('>').next().unwrap_or_default();
    let value = tag.split_whitespace().find_map(|attribute| attribute.strip_prefix("type=")).unwrap_or_default();
    Some(value.trim_matches(['"', '\'', '/']).to_owned())
}

/// The types of numbers under their names in XML.
pub(in crate::import) const XML_TYPES: TypeNames = &[
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

/// An array that is read: from byte `offset` of its storage on, without gaps.
pub(in crate::import) struct VtkArray {
    pub storage: Storage,
    pub offset: u64,
    pub order: Order,
    /// Whether the storage is the file itself.
    pub is_in_place: bool,
}

impl VtkArray {
    /// Finds the `bytes` bytes of an array whose element is `array`, which `grid` describes. Bytes are in the order `order` unless the array is of
    /// text.
    ///
    /// # Errors
    /// When the file cannot be read, or has fewer.
    pub(in crate::import) fn open(
        content: &Content,
        elements: &[Element],
        array: &Element,
        bytes: u64,
        grid: &Grid,
        order: Order,
    ) -> Result<VtkArray, ImportError> {
        let path = &*content.path;
        let find = |name: &str| elements.iter().find(|element| element.name == name);
        let unpacked = |storage: Storage, order: Order| VtkArray { storage, offset: 0, order, is_in_place: false };
        let file = find("VTKFile");
        let compressor = match file.and_then(|file| file.get("compressor")) {
            None => None,
            Some("vtkZLibDataCompressor") => Some(Compressor::Zlib),
            Some("vtkLZ4DataCompressor") => Some(Compressor::Lz4),
            Some(text) => {
                let expected = "vtkZLibDataCompressor or vtkLZ4DataCompressor";
                return Err(Entry { path, name: "compressor", text }.wrong(expected));
            }
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
                return Ok(unpacked(ascii::parsed(inline()?, path, most, bytes, grid)?, Order::NATIVE));
            }
            "binary" => (Box::new(Base64::new(inline()?)), false, array.end),
            "appended" => {
                let missing = || ImportError::missing(path, "AppendedData", "an element of this name, and _ in it");
                let appended = find("AppendedData").ok_or_else(missing)?;
                let offset = Entry { path, name: "offset", text: array.get("offset").unwrap_or_default() };
                let offset: u64 = offset.value("a number of bytes")?;
                let begin = underscore(content, appended.end)?.ok_or_else(missing)?;
                let start = begin.checked_add(offset).filter(|start| *start <= content.most());
                let start =
                    start.ok_or_else(|| ImportError::malformed(path, "offset", offset, "a byte in the file"))?;
                let reader = content.reader(start)?;
                match appended.get("encoding") {
                    Some("raw") => (reader, true, start),
                    _ => (Box::new(Base64::new(reader)), false, start),
                }
            }
            _ => return Err(format.wrong("ascii, binary or appended")),
        };
        let mut blocks = Blocks { reader: BufReader::new(reader), content, word, order, bytes, grid };
        if let Some(compressor) = compressor {
            content.check_packed(content.most(), bytes, grid)?;
            return Ok(unpacked(blocks.unpacked(compressor)?, order));
        }
        let stated = blocks.number()?;
        if stated != bytes {
            return Err(too_few(path, &format!("{stated} bytes"), bytes, grid));
        }
        if is_raw && !content.is_packed {
            let offset = start + word as u64;
            let storage = content.samples(offset, bytes, grid)?;
            return Ok(VtkArray { storage, offset, order, is_in_place: true });
        }
        content.check_packed(content.length, bytes, grid)?;
        // What follows an array is another, no checksum.
        Ok(unpacked(filled(blocks.reader.take(bytes), path, bytes, grid)?, order))
    }
}

/// The byte behind the `_` that appended data begins with.
fn underscore(content: &Content, from: u64) -> Result<Option<u64>, ImportError> {
    let mut start = Vec::new();
    let read = content.reader(from)?.take(4096).read_to_end(&mut start);
    read.map_err(|error| ImportError::io(&content.path, "AppendedData", error))?;
    let found = start.iter().position(|byte| !byte.is_ascii_whitespace()).filter(|&at| start[at] == b'_');
    Ok(found.map(|at| from + at as u64 + 1))
}

/// How blocks are compressed.
#[derive(Clone, Copy)]
enum Compressor {
    Zlib,
    Lz4,
}

/// The most bytes that a byte of LZ4 stands for.
const LZ4_EXPANSION: u64 = 255;

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
    fn unpacked(mut self, compressor: Compressor) -> Result<Storage, ImportError> {
        let path = &*self.content.path;
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
        for (number, packed) in sizes.iter().enumerate() {
            let bytes = if last > 0 && number as u64 + 1 == count { last } else { size };
            let wrong = |found: String, expected: &str| {
                ImportError::malformed(path, format!("data: block {}", number + 1), found, expected)
            };
            let mut input = (&mut self.reader).take(*packed);
            let left = match compressor {
                Compressor::Zlib => inflate(&mut input, bytes, &mut scratch, &wrong)?,
                Compressor::Lz4 => {
                    let mut block = Vec::new();
                    input.read_to_end(&mut block).map_err(|error| wrong(in_one_line(&error), "LZ4"))?;
                    if bytes > LZ4_EXPANSION * block.len() as u64 {
                        return Err(wrong(format!("{} bytes for {bytes}", block.len()), "LZ4"));
                    }
                    let mut out = vec![0; bytes as usize];
                    let filled = lz4_flex::block::decompress_into(&block, &mut out);
                    let filled = filled.map_err(|error| wrong(in_one_line(&error), "LZ4"))?;
                    scratch.write(&out[..filled])?;
                    bytes - filled as u64
                }
            };
            if left > 0 {
                let found = format!("{left} bytes less in block {}", number + 1);
                return Err(too_few(path, &found, self.bytes, self.grid));
            }
            let rest = std::io::copy(&mut input, &mut std::io::sink());
            rest.map_err(|error| ImportError::malformed(path, "data", in_one_line(&error), "more blocks"))?;
        }
        scratch.into_storage()
    }
}

/// Unpacks a block of zlib to the end of it or to so many bytes; gives how many are missing.
fn inflate(
    packed: &mut impl Read,
    bytes: u64,
    scratch: &mut Scratch,
    wrong: &dyn Fn(String, &str) -> ImportError,
) -> Result<u64, ImportError> {
    let mut block = ZlibDecoder::new(packed).take(bytes);
    let mut buffer = vec![0; 1 << 16];
    loop {
        match block.read(&mut buffer) {
            Ok(0) => return Ok(block.limit()),
            Ok(read) => scratch.write(&buffer[..read])?,
            Err(error) => return Err(wrong(in_one_line(&error), "zlib")),
        }
    }
}
