//! Gwyddion's files (`.gwy`): named values in containers, among them fields of doubles, in metres.

use super::content::{Content, in_one_line, word};
use super::dimensions::{dimensions, distance};
use super::raw::{Layout, RawSamples};
use super::units::length;
use super::{HeightDescription, HeightFormat, HeightSource, NoData, always};
use crate::model::HeightGrid;
use deepfield_data::import::{ByteOrder, ImportError};
use deepfield_data::model::SampleType;

/// The field with the least number in a file.
pub(super) const GWY: HeightFormat = HeightFormat {
    name: "gwy",
    extensions: &["gwy"],
    is_sure: always,
    detect: |content| content.head.starts_with(MAGIC),
    open,
};

const MAGIC: &[u8] = b"GWYP";

/// The longest name or text, and the most values of a container that are looked at.
const LONGEST: u64 = 1 << 10;
const MOST: usize = 1 << 14;

/// A named value: its kind's letter, and where it lies.
#[derive(Debug)]
struct Value {
    name: String,
    kind: u8,
    start: u64,
    end: u64,
}

/// A text that a 0 ends, and the byte behind that.
fn text(content: &Content, at: u64, end: u64) -> Result<(String, u64), ImportError> {
    let most = LONGEST.min(end.saturating_sub(at));
    let bytes = content.bytes("name", at, most)?;
    let length = bytes.iter().position(|byte| *byte == 0);
    let length = length
        .ok_or_else(|| content.malformed("name", format!("{most} bytes without an end"), "a text that a 0 ends"))?;
    Ok((in_one_line(&String::from_utf8_lossy(bytes.get(..length).unwrap_or_default())), at + length as u64 + 1))
}

fn u32_at(content: &Content, at: u64, end: u64) -> Result<u64, ImportError> {
    if at.checked_add(4).is_none_or(|after| after > end) {
        return Err(content.malformed("size", format!("{} bytes", end.saturating_sub(at)), "4"));
    }
    Ok(u64::from(u32::from_le_bytes(word(&content.bytes("size", at, 4)?, 0))))
}

/// An object's name, and where its values begin and end.
fn object(content: &Content, at: u64, end: u64) -> Result<(String, u64, u64), ImportError> {
    let (name, at) = text(content, at, end)?;
    let size = u32_at(content, at, end)?;
    let start = at + 4;
    if size > end - start {
        return Err(content.malformed(&name, format!("{} bytes", end - start), format!("{size}")));
    }
    Ok((name, start, start + size))
}

/// The values of an object.
fn values(content: &Content, start: u64, end: u64) -> Result<Vec<Value>, ImportError> {
    let mut found = Vec::new();
    let mut at = start;
    while at < end && found.len() < MOST {
        let (name, kind_at) = text(content, at, end)?;
        let kind = content.bytes(&name, kind_at, 1)?.first().copied().unwrap_or(0);
        let start = kind_at + 1;
        let array = |size: u64| Ok(start + 4 + u32_at(content, start, end)?.saturating_mul(size));
        let next = match kind {
            b'b' | b'c' => start + 1,
            b'i' => start + 4,
            b'q' | b'd' => start + 8,
            b's' => text(content, start, end)?.1,
            b'o' => object(content, start, end)?.2,
            b'C' => array(1)?,
            b'I' => array(4)?,
            b'Q' | b'D' => array(8)?,
            b'S' | b'O' => {
                let count = u32_at(content, start, end)?;
                let mut next = start + 4;
                if count > MOST as u64 {
                    return Err(content.malformed(&name, format!("{count} parts"), format!("at most {MOST}")));
                }
                for _ in 0..count {
                    next = if kind == b'S' { text(content, next, end)?.1 } else { object(content, next, end)?.2 };
                }
                next
            }
            other => {
                return Err(content.malformed(
                    &name,
                    format!("a value of the kind {:?}", char::from(other)),
                    "one of bciqdsoCIQDSO",
                ));
            }
        };
        if next > end {
            let found = format!("{} bytes", end.saturating_sub(start));
            return Err(content.malformed(&name, found, format!("{}", next - start)));
        }
        found.push(Value { name, kind, start, end: next });
        at = next;
    }
    Ok(found)
}

/// The values of a field.
struct Field<'c> {
    content: &'c Content,
    values: Vec<Value>,
}

impl Field<'_> {
    fn find(&self, name: &str, kind: u8) -> Option<&Value> {
        self.values.iter().find(|value| value.name == name && value.kind == kind)
    }

    fn bytes<const N: usize>(&self, name: &str, kind: u8) -> Result<Option<[u8; N]>, ImportError> {
        let read = |value: &Value| Ok(word(&self.content.bytes(name, value.start, N as u64)?, 0));
        self.find(name, kind).map(read).transpose()
    }

    fn whole(&self, name: &str) -> Result<i128, ImportError> {
        let found = self.bytes(name, b'i')?.ok_or_else(|| self.content.missing(name, "a number of the field"))?;
        Ok(i32::from_le_bytes(found).into())
    }

    fn number(&self, name: &str) -> Result<Option<f64>, ImportError> {
        Ok(self.bytes(name, b'd')?.map(f64::from_le_bytes))
    }

    /// The text of a unit; empty where there is none.
    fn unit(&self, name: &str) -> Result<String, ImportError> {
        let Some(value) = self.find(name, b'o') else { return Ok(String::new()) };
        let (_, start, end) = object(self.content, value.start, value.end)?;
        let parts = values(self.content, start, end)?;
        match parts.iter().find(|part| part.name == "unitstr" && part.kind == b's') {
            Some(part) => Ok(text(self.content, part.start, part.end)?.0),
            None => Ok(String::new()),
        }
    }
}

fn open(content: &Content) -> Result<HeightSource, ImportError> {
    let (_, start, end) = object(content, MAGIC.len() as u64, content.length)?;
    let all = values(content, start, end)?;
    // Channels are called /0/data, /1/data, and their masks /0/mask.
    let number = |value: &Value| value.name.strip_prefix('/')?.strip_suffix("/data")?.parse::<u64>().ok();
    let mut channels: Vec<(u64, &Value)> =
        all.iter().filter(|value| value.kind == b'o').filter_map(|value| Some((number(value)?, value))).collect();
    channels.sort_by_key(|(number, _)| *number);
    let Some((first, value)) = channels.first() else {
        return Err(content.missing("/0/data", "a field of heights"));
    };
    let (name, start, end) = object(content, value.start, value.end)?;
    if name != "GwyDataField" {
        return Err(content.malformed(&value.name, name, "GwyDataField"));
    }
    let field = Field { content, values: values(content, start, end)? };
    let size = dimensions(content, ("xres", field.whole("xres")?), ("yres", field.whole("yres")?), SampleType::F64)?;
    let mut grid = HeightGrid::new(size[0], size[1], SampleType::F64);
    for (axis, [real, offset]) in [["xreal", "xoff"], ["yreal", "yoff"]].into_iter().enumerate() {
        if content.options.spacing.is_none() {
            let side = field.number(real)?.ok_or_else(|| content.missing(real, "the length of a side"))?;
            grid.step[axis] = distance(content, real, side)? / size[axis] as f64;
        }
        // Sides go from edge to edge: a sample is in the middle of its area.
        grid.origin[axis] = field.number(offset)?.unwrap_or(0.0) + grid.step[axis] / 2.0;
    }
    let [xy, z] = [field.unit("si_unit_xy")?, field.unit("si_unit_z")?];
    let told = &content.options;
    grid.xy_unit = length(content, "si_unit_xy", &xy, &z, told.xy_unit.as_ref(), "--xy-unit")?;
    grid.height_unit = length(content, "si_unit_z", &z, &xy, told.height_unit.as_ref(), "--height-unit")?;
    let data = field.find("data", b'D').ok_or_else(|| content.missing("data", "the heights"))?;
    let count = (data.end - data.start - 4) / 8;
    if count != grid.samples() {
        return Err(content.malformed(
            "data",
            format!("{count} numbers"),
            format!("{} ({})", grid.samples(), grid.described()),
        ));
    }
    let layout = Layout::packed(size, data.start + 4, SampleType::F64, ByteOrder::Little);
    let samples = RawSamples::new(content, "data", layout)?;
    let mut about = HeightDescription::new(content, GWY.name, grid);
    about.has_spacing = true;
    if channels.len() > 1 {
        about.notes.push(format!("channel {first} of {} is read, the others are left out", channels.len()));
    }
    if all.iter().any(|value| value.name == format!("/{first}/mask")) {
        about.notes.push("the mask is left out: every sample counts as measured".into());
    }
    Ok(HeightSource::new(about, Box::new(samples), NoData::Nothing))
}
