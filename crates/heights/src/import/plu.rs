//! Sensofar's older files (`.plu`): a header of 500 bytes, then a size, heights as floats in micrometres, their range, and pictures.

use super::content::{Content, latin1, word};
use super::dimensions::{dimensions, distance};
use super::raw::{Layout, RawSamples};
use super::{HeightDescription, HeightFormat, HeightSource, NoData, always};
use crate::model::{HeightGrid, Plane};
use deepfield_data::import::{ByteOrder, ImportError};
use deepfield_data::model::{SampleType, Unit};

/// Topographies.
pub(super) const PLU: HeightFormat = HeightFormat { name: "plu", extensions: &["plu"], is_sure: always, detect, open };

/// What stands for samples that were not measured.
pub(super) const LOST: f64 = 1_000_001.0;

/// Bytes of the date that a file begins with.
const DATE: usize = 128;
/// Where rows and columns are, micrometres from a column and a row to the next, what was measured, and how many pictures there are.
const SIZE: usize = 388;
const STEPS: usize = 404;
const KIND: usize = 428;
const PICTURES: usize = 492;
/// Where rows and columns are once more, and the heights.
const OWN_SIZE: usize = 500;
const HEIGHTS: u64 = 508;
/// Bytes of the range between heights and pictures.
const RANGE: u64 = 8;

/// What may be measured, by its number.
const KINDS: [&str; 7] = [
    "a picture",
    "a profile",
    "several profiles",
    "a topography",
    "coordinates",
    "a thickness at one point",
    "something of another program",
];
const TOPOGRAPHY: usize = 3;

/// Two numbers of 32 bits.
fn pair(head: &[u8], at: usize) -> [u32; 2] {
    [at, at + 4].map(|at| u32::from_le_bytes(word(head, at)))
}

/// There is no mark: a date in words, and two sizes that agree.
fn detect(content: &Content) -> bool {
    let head = &content.head;
    let date = head.get(..DATE).unwrap_or_default();
    let text = date.iter().position(|byte| *byte == 0).unwrap_or(DATE);
    let is_text = (6..DATE).contains(&text)
        && date[..text].iter().all(|byte| (32..127).contains(byte))
        && date[..text].iter().any(u8::is_ascii_digit);
    let size = pair(head, SIZE);
    let kind = u32::from_le_bytes(word(head, KIND));
    let agrees = head.len() as u64 >= HEIGHTS
        && is_text
        && (kind as usize) < KINDS.len()
        && size == pair(head, OWN_SIZE)
        && size.iter().all(|count| (1..1 << 24).contains(count));
    agrees || content.has_extension("plu")
}

fn open(content: &Content) -> Result<HeightSource, ImportError> {
    let head = &content.head;
    if (head.len() as u64) < HEIGHTS {
        return Err(content.malformed("header", format!("{} bytes", head.len()), format!("{HEIGHTS}")));
    }
    let kind = u32::from_le_bytes(word(head, KIND)) as usize;
    if kind != TOPOGRAPHY {
        let found = KINDS.get(kind).map_or_else(|| format!("number {kind}"), |name| format!("{kind}, {name}"));
        return Err(content.malformed("kind of measurement (byte 428)", found, "3, a topography"));
    }
    let [rows, columns] = pair(head, OWN_SIZE);
    let names = ["columns (byte 504)", "rows (byte 500)"];
    let size = dimensions(content, (names[0], columns.into()), (names[1], rows.into()), SampleType::F32)?;
    let mut grid = HeightGrid::new(size[0], size[1], SampleType::F32);
    if content.options.spacing.is_none() {
        for (axis, name) in ["step along x (byte 404)", "step along y (byte 408)"].into_iter().enumerate() {
            let step = f32::from_le_bytes(word(head, STEPS + 4 * axis));
            grid.step[axis] = distance(content, name, step.into())?;
        }
    }
    (grid.xy_unit, grid.height_unit) = (Unit::new("um"), Unit::new("um"));
    let layout = Layout::packed(size, HEIGHTS, SampleType::F32, ByteOrder::Little);
    let mut samples = RawSamples::new(content, "heights", layout)?;
    let mut notes = Vec::new();
    let stated = pair(head, SIZE);
    if stated != [rows, columns] {
        let [stated_rows, stated_columns] = stated;
        notes.push(format!("{columns} x {rows} samples of {stated_columns} x {stated_rows}, with the steps of those"));
    }
    // A picture has a byte for red, green and blue of each sample.
    let pictures = head[PICTURES];
    let first = HEIGHTS + grid.samples() * 4 + RANGE;
    let room = content.length.saturating_sub(first) / (3 * grid.samples());
    if pictures > 0 && room > 0 {
        let packed = Layout::packed(size, first, SampleType::U8, ByteOrder::Little);
        for (number, name) in ["red", "green", "blue"].into_iter().enumerate() {
            let plane = Layout { offset: first + number as u64, column_stride: 3, row_stride: 3 * size[0], ..packed };
            samples = samples.with_plane(content, name, plane)?;
            grid.planes.push(Plane { name: name.into() });
        }
    }
    if u64::from(pictures) > room.min(1) {
        notes.push(format!("{} of {pictures} pictures are left out", u64::from(pictures) - room.min(1)));
    }
    let mut about = HeightDescription::new(content, PLU.name, grid);
    about.has_spacing = true;
    let date = latin1(&head[..DATE]);
    if !date.is_empty() {
        notes.push(format!("measured on {}", super::content::in_one_line(&date)));
    }
    about.notes = notes;
    Ok(HeightSource::new(about, Box::new(samples), NoData::Value(LOST)))
}
