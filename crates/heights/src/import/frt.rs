//! FRT's scans (`.frt`): blocks of a number, a size and as many bytes. Rows are stored from the last to the first.

use super::content::{Content, word};
use super::dimensions::{dimensions, distance};
use super::raw::{Layout, RawSamples};
use super::{HeightDescription, HeightFormat, HeightSource, NoData, always};
use crate::model::HeightGrid;
use deepfield_data::import::{ByteOrder, ImportError};
use deepfield_data::model::{SampleType, Scale, Unit};

/// Scans of one channel.
pub(super) const FRT: HeightFormat = HeightFormat {
    name: "frt",
    extensions: &["frt"],
    is_sure: always,
    detect: |content| content.head.starts_with(MAGIC),
    open,
};

const MAGIC: &[u8] = b"FRTM_GLIDER";

/// Where the first block begins, and the bytes of its number and its size.
const FIRST: u64 = 18;
const HEAD: u64 = 6;

/// The most blocks that are looked at.
const MOST_BLOCKS: usize = 1 << 12;

/// Numbers of blocks: the samples; columns, rows and bits; lengths of the sides in metres; a height of 1.
const SAMPLES: u16 = 11;
const SIZE: u16 = 102;
const SIDES: u16 = 103;
const HEIGHT: u16 = 108;

/// What stands for samples that were not measured.
const INVALID: f64 = 1.0;

/// A block's number, where it begins, and its size.
struct Block {
    number: u16,
    offset: u64,
    size: u64,
}

/// The blocks of a file, as far as it goes.
fn blocks(content: &Content) -> Result<Vec<Block>, ImportError> {
    let mut found = Vec::new();
    let mut at = FIRST;
    while found.len() < MOST_BLOCKS && at.checked_add(HEAD).is_some_and(|end| end <= content.length) {
        let mut head = [0; HEAD as usize];
        content.read("block", at, &mut head)?;
        let size = u64::from(u32::from_le_bytes(word(&head, 2)));
        found.push(Block { number: u16::from_le_bytes(word(&head, 0)), offset: at + HEAD, size });
        at += HEAD + size;
    }
    Ok(found)
}

fn open(content: &Content) -> Result<HeightSource, ImportError> {
    let blocks = blocks(content)?;
    let find = |number: u16, what: &str| {
        let found = blocks.iter().find(|block| block.number == number);
        found.ok_or_else(|| content.missing(&format!("block {number}"), what))
    };
    let bytes = |number: u16, what: &str, count: u64| {
        let block = find(number, what)?;
        if block.size < count {
            return Err(content.malformed(
                &format!("block {number}"),
                format!("{} bytes", block.size),
                format!("{count} ({what})"),
            ));
        }
        content.bytes(&format!("block {number}"), block.offset, count)
    };
    let size = bytes(SIZE, "columns, rows and bits", 12)?;
    let [columns, rows, bits] = [0, 4, 8].map(|at| i32::from_le_bytes(word(&size, at)));
    let sample_type = match bits {
        16 => SampleType::U16,
        32 => SampleType::U32,
        other => return Err(content.malformed("bits of a sample (block 102)", other, "16 or 32")),
    };
    let names = ["columns (block 102)", "rows (block 102)"];
    let size = dimensions(content, (names[0], columns.into()), (names[1], rows.into()), sample_type)?;
    let mut grid = HeightGrid::new(size[0], size[1], sample_type);
    if content.options.spacing.is_none() {
        let sides = bytes(SIDES, "lengths of the sides", 16)?;
        for (axis, name) in ["length along x (block 103)", "length along y (block 103)"].into_iter().enumerate() {
            let length = f64::from_le_bytes(word(&sides, 8 * axis));
            grid.step[axis] = distance(content, name, length)? / size[axis] as f64;
        }
    }
    (grid.xy_unit, grid.height_unit) = (Unit::new("m"), Unit::new("m"));
    let slope = f64::from_le_bytes(word(&bytes(HEIGHT, "a height", 12)?, 4));
    grid.scale = Scale { slope, intercept: 0.0 };

    let block = find(SAMPLES, "samples")?;
    let packed = Layout::packed(size, block.offset, sample_type, ByteOrder::Little);
    let asked = packed.row_stride.saturating_mul(size[1]);
    if block.size != asked {
        let expected = format!("{asked} ({})", grid.described());
        return Err(content.malformed("samples (block 11)", format!("{} bytes", block.size), expected));
    }
    let samples = RawSamples::new(content, "samples (block 11)", Layout { is_reversed: true, ..packed })?;
    let mut about = HeightDescription::new(content, FRT.name, grid);
    about.has_spacing = true;
    Ok(HeightSource::new(about, Box::new(samples), NoData::Value(INVALID)))
}
