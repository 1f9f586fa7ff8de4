//! MetaImage: a header of text and samples, in one file or two (<https://itk.org/Wiki/MetaIO/Documentation>).

use super::content::{Content, filled};
use super::fields::{Entry, TypeNames, sample_type};
use super::layout::{INTERLEAVED, Layout, NATIVE};
use super::source::checked;
use super::{GridDescription, GridFormat, GridSource, ascii};
use crate::import::ImportError;
use crate::import::bytes::Order;
use crate::model::{Channel, Grid, SampleType};
use flate2::read::ZlibDecoder;
use glam::{DAffine3, DMat3, DVec3};
use std::io::BufReader;
use std::path::Path;

/// `.mha` and `.mhd`.
pub(super) const METAIMAGE: GridFormat = GridFormat {
    name: "metaimage",
    extensions: &["mha", "mhd"],
    has_parts: false,
    detect: |content| {
        let start = &content.head[..content.head.len().min(4096)];
        let text = String::from_utf8_lossy(start);
        // The order of entries is free, but that the last one is where the samples are.
        let first = text.lines().next().and_then(|line| line.split_once('='));
        first.is_some_and(|(name, _)| matches!(name.trim(), "ObjectType" | "NDims" | "Comment" | "ObjectSubType"))
            && (text.contains("ElementType") || text.contains("DimSize"))
    },
    open,
};

const TYPES: TypeNames = &[
    ("MET_CHAR", SampleType::I8),
    ("MET_UCHAR", SampleType::U8),
    ("MET_SHORT", SampleType::I16),
    ("MET_USHORT", SampleType::U16),
    ("MET_INT", SampleType::I32),
    ("MET_UINT", SampleType::U32),
    ("MET_LONG", SampleType::I32),
    ("MET_ULONG", SampleType::U32),
    ("MET_LONG_LONG", SampleType::I64),
    ("MET_ULONG_LONG", SampleType::U64),
    ("MET_FLOAT", SampleType::F32),
    ("MET_DOUBLE", SampleType::F64),
];

/// The entries of a header in their order, and the byte behind it.
struct Header<'a> {
    path: &'a Path,
    entries: Vec<(String, String)>,
    end: u64,
}

impl Header<'_> {
    fn read(content: &Content) -> Result<Header<'_>, ImportError> {
        let mut entries = Vec::new();
        let mut at = 0;
        for line in content.head.split_inclusive(|&byte| byte == b'\n') {
            at += line.len();
            let text = String::from_utf8_lossy(line);
            let Some((name, value)) = text.split_once('=') else { continue };
            let name = name.trim().to_owned();
            let is_last = name == "ElementDataFile";
            entries.push((name, value.trim().to_owned()));
            if is_last {
                return Ok(Header { path: &content.path, entries, end: at as u64 });
            }
        }
        Err(ImportError::missing(&content.path, "ElementDataFile", "LOCAL or the name of a file"))
    }

    /// The first entry that is there under one of these names.
    fn entry<'e>(&'e self, names: &[&'e str]) -> Option<Entry<'e>> {
        names.iter().find_map(|name| {
            let (_, text) = self.entries.iter().find(|(known, _)| known == name)?;
            Some(Entry { path: self.path, name, text })
        })
    }

    fn needed<'e>(&'e self, name: &'e str, expected: &str) -> Result<Entry<'e>, ImportError> {
        self.entry(&[name]).ok_or_else(|| ImportError::missing(self.path, name, expected))
    }

    fn is_true(&self, names: &[&str]) -> bool {
        self.entry(names).is_some_and(|entry| entry.text.eq_ignore_ascii_case("true") || entry.text == "1")
    }
}

fn open(content: &Content) -> Result<GridSource, ImportError> {
    let header = Header::read(content)?;
    let path = &*content.path;
    let dimensions: usize = header.needed("NDims", "2 or 3")?.value("2 or 3")?;
    if !(2..=3).contains(&dimensions) {
        return Err(header.needed("NDims", "2 or 3")?.wrong("2 or 3"));
    }
    let sizes: Vec<u64> = header.needed("DimSize", "samples along each axis")?.exactly(dimensions)?;
    let kind = sample_type(header.needed("ElementType", "the type of samples")?, TYPES)?;
    let count: u64 = header.entry(&["ElementNumberOfChannels"]).map_or(Ok(1), |entry| entry.value("a number"))?;
    let mut grid = match sizes[..] {
        [x, y, z] => Grid::volume([x, y, z], kind, Channel::numbered(count.min(4097))),
        _ => Grid::image([sizes[0], sizes[1]], kind, Channel::of_picture(count.min(4097))),
    };
    place(&mut grid, &header, dimensions)?;
    let bytes = checked(path, &grid, "DimSize", "TransformMatrix")?;
    let is_big = header.is_true(&["BinaryDataByteOrderMSB", "ElementByteOrderMSB"]);
    let order = if is_big { Order::Big } else { Order::Little };
    let mut about = GridDescription::new(path, METAIMAGE.name, content.length, grid);
    let file = header.needed("ElementDataFile", "LOCAL or the name of a file")?;
    if file.text == "LOCAL" {
        let (storage, layout) = samples(&header, content, header.end, bytes, &about.grid, order)?;
        return Ok(GridSource::new(about, storage, layout));
    }
    if file.text.starts_with("LIST") || file.text.contains('%') || file.text.is_empty() {
        return Err(file.wrong("LOCAL or one file"));
    }
    let data = content.beside("ElementDataFile", file.text)?;
    about.files = 2;
    about.bytes += data.length;
    let (storage, layout) = samples(&header, &data, 0, bytes, &about.grid, order)?;
    Ok(GridSource::new(about, storage, layout))
}

/// Puts the samples to where the header says they are.
fn place(grid: &mut Grid, header: &Header, dimensions: usize) -> Result<(), ImportError> {
    let spacing = header.entry(&["ElementSpacing", "ElementSize"]);
    let matrix = header.entry(&["TransformMatrix", "Rotation", "Orientation"]);
    if spacing.is_none() && matrix.is_none() && dimensions == 2 {
        return Ok(());
    }
    let steps: Vec<f64> = spacing.map_or(Ok(vec![1.0; dimensions]), |entry| entry.exactly(dimensions))?;
    let turn: Option<Vec<f64>> = matrix.map(|entry| entry.exactly(dimensions * dimensions)).transpose()?;
    let mut columns = DVec3::AXES;
    for (axis, column) in columns.iter_mut().enumerate().take(dimensions) {
        if let Some(turn) = &turn {
            // Each row is the direction of an axis.
            let at = |other: usize| if other < dimensions { turn[axis * dimensions + other] } else { 0.0 };
            *column = DVec3::new(at(0), at(1), at(2));
        }
        *column *= steps[axis];
    }
    grid.to_world = DAffine3::from_mat3(DMat3::from_cols(columns[0], columns[1], columns[2]));
    if let Some(entry) = header.entry(&["Offset", "Position", "Origin"]) {
        let at: Vec<f64> = entry.exactly(dimensions)?;
        grid.to_world.translation = DVec3::new(at[0], at[1], at.get(2).copied().unwrap_or(0.0));
    }
    Ok(())
}

/// The samples, from byte `start` on, and how they lie.
fn samples(
    header: &Header,
    content: &Content,
    start: u64,
    bytes: u64,
    grid: &Grid,
    order: Order,
) -> Result<(super::scratch::Storage, Layout), ImportError> {
    let at = |offset: u64, order: Order| Layout::packed(grid, INTERLEAVED, offset, order);
    if header.entry(&["BinaryData"]).is_some_and(|entry| entry.text.eq_ignore_ascii_case("false")) {
        let most = content.most().saturating_sub(start);
        return Ok((ascii::parsed(content.reader(start)?, &content.path, most, bytes, grid)?, at(0, NATIVE)));
    }
    if header.is_true(&["CompressedData"]) {
        content.check_packed(content.most().saturating_sub(start), bytes, grid)?;
        let reader = ZlibDecoder::new(BufReader::new(content.reader(start)?));
        return Ok((filled(reader, &content.path, bytes, grid)?, at(0, order)));
    }
    let skip: i64 = header.entry(&["HeaderSize"]).map_or(Ok(0), |entry| entry.value("a number of bytes"))?;
    let offset = match u64::try_from(skip) {
        // The header's own size counts where the samples follow it.
        Ok(skip) => start.max(skip),
        Err(_) => content.length.saturating_sub(bytes),
    };
    let storage = content.samples(offset, bytes, grid)?;
    Ok((storage, at(if content.is_packed { 0 } else { offset }, order)))
}
