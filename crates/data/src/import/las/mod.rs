//! LAS: point clouds of laser scanners, versions 1.0 to 1.4 with point formats 0 to 10 (ASPRS, "LAS Specification 1.4 - R15"), also
//! compressed (`laz`). Positions are whole numbers with a factor and an offset for each axis.

mod extra;
mod laz;

use self::extra::Extra;
use self::laz::PackedPoints;
use super::bytes::{Order, RangeFile};
use super::grid::scratch::Storage;
use super::typed_columns::{Column, Component, FieldList, Meaning, Run, TypedColumns};
use super::{Description, FieldKind, Format, ImportError, Source};
use crate::model::{FamilyName, ReadMethod, SampleType};
use std::path::Path;

/// The LAS format.
pub(super) struct Las;

/// Bytes of a point of each format.
const POINT: [u64; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];

/// Where GPS time, red and near infrared begin in a point of each format; 0: it has none.
const TIME: [u64; 11] = [0, 20, 0, 20, 20, 20, 22, 22, 22, 22, 22];
const RED: [u64; 11] = [0, 0, 20, 28, 0, 28, 0, 30, 30, 0, 30];
const INFRARED: [u64; 11] = [0, 0, 0, 0, 0, 0, 0, 0, 36, 0, 36];

/// The first format of version 1.4, whose flags take more bits.
const EXTENDED: usize = 6;

/// Bytes of the header up to what version 1.4 adds, and with it.
const HEADER: u64 = 227;
const HEADER_1_4: u64 = 375;

impl Format for Las {
    fn name(&self) -> &'static str {
        "LAS"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["las", "laz"]
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        head.starts_with(b"LASF")
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        let file = RangeFile::open_unpacked(path, method)?;
        let mut head = vec![0; file.length.min(HEADER_1_4) as usize];
        file.read(0, &mut head, "header")?;
        let header = Header::parse(path, &head)?;
        let bytes = header.count.checked_mul(header.stride).and_then(|bytes| bytes.checked_add(header.start));
        if bytes.is_none_or(|bytes| bytes > file.length && !header.is_packed) {
            let found = format!("the file's end at byte {}", file.length);
            let expected = format!("{} points of {} bytes from byte {} on", header.count, header.stride, header.start);
            return Err(ImportError::malformed(path, "points", found, expected));
        }
        let mut about = Description::unitless(path, "las", file.length);
        let least = POINT[header.format];
        // Without such bytes nobody asks what they are.
        let record = match header.stride > least {
            true => record(&file, &header, &head, extra::USER, extra::NUMBER)?.unwrap_or_default(),
            false => Vec::new(),
        };
        let extras = extra::described(&record, least, header.stride);
        let left_out = header.stride - least - extras.iter().map(Extra::bytes).sum::<u64>();
        if left_out > 0 {
            about.notes.push(format!("{left_out} bytes of each point that nothing describes are left out"));
        }
        let (storage, start) = match header.is_packed {
            true => (Storage::Pieces(Box::new(PackedPoints::open(file, &header, &head)?)), 0),
            false => (Storage::File(file), header.start),
        };
        let header = Header { start, ..header };
        let family = header.fields(&extras).family(FamilyName::Dark, header.count, vec![Run::WHOLE]);
        Ok(Box::new(TypedColumns::new(about, vec![storage], vec![family])))
    }
}

/// What of the header says how points are stored.
struct Header {
    /// Their format.
    format: usize,
    is_packed: bool,
    /// Byte of the first.
    start: u64,
    /// Bytes from one to the next.
    stride: u64,
    count: u64,
    /// By axis.
    scale: [f64; 3],
    offset: [f64; 3],
}

impl Header {
    fn parse(path: &Path, head: &[u8]) -> Result<Header, ImportError> {
        let order = Order::Little;
        if (head.len() as u64) < HEADER {
            let found = format!("{} bytes", head.len());
            return Err(ImportError::malformed(path, "header", found, format!("at least {HEADER} bytes")));
        }
        let version = (head[24], head[25]);
        if version.0 != 1 || version.1 > 4 {
            let found = format!("{}.{}", version.0, version.1);
            return Err(ImportError::malformed(path, "version", found, "1.0 to 1.4"));
        }
        // LASzip marks its formats with a bit that is none of the number.
        let (format, is_packed) = (usize::from(head[104] & 0x3f), head[104] & 0xc0 != 0);
        let Some(&least) = POINT.get(format) else {
            return Err(ImportError::malformed(path, "point format", format, "0 to 10"));
        };
        let stride = u64::from(head[105]) | u64::from(head[106]) << 8;
        if stride < least {
            let expected = format!("at least {least} bytes for format {format}");
            return Err(ImportError::malformed(path, "length of a point", stride, expected));
        }
        let legacy = u64::from(order.u32(head, 107));
        let count = match version {
            (1, 4) if head.len() as u64 >= HEADER_1_4 => match order.f64(head, 247).to_bits() {
                0 => legacy,
                count => count,
            },
            _ => legacy,
        };
        if count == 0 {
            return Err(ImportError::NoParticles { path: path.into(), field: "number of points".into() });
        }
        let start = u64::from(order.u32(head, 96));
        if start < HEADER {
            let expected = format!("a byte behind the header, from {HEADER} on");
            return Err(ImportError::malformed(path, "offset to point data", start, expected));
        }
        let three = |at: usize| [0, 8, 16].map(|axis| order.f64(head, at + axis));
        let (scale, offset) = (three(131), three(155));
        if let Some(wrong) = scale.iter().find(|scale| !scale.is_finite() || **scale == 0.0) {
            return Err(ImportError::malformed(path, "scale factors", wrong, "numbers other than 0"));
        }
        if let Some(wrong) = offset.iter().find(|offset| !offset.is_finite()) {
            return Err(ImportError::malformed(path, "offsets", wrong, "finite numbers"));
        }
        Ok(Header { format, is_packed, start, stride, count, scale, offset })
    }

    /// A number of every point.
    fn column(&self, at: u64, number: SampleType) -> Column {
        Column { storage: 0, offset: self.start + at, stride: self.stride, number, order: Order::Little }
    }

    fn fields(&self, extras: &[Extra]) -> FieldList {
        let mut fields = FieldList::default();
        let position = [0, 1, 2].map(|axis| {
            let meaning = Meaning::Linear { factor: self.scale[axis], first: self.offset[axis] };
            Component::Stored(self.column(4 * axis as u64, SampleType::I32), meaning)
        });
        fields.push("position", "X,Y,Z", FieldKind::Position, position.to_vec());
        let mut scalar = |name: &str, at: u64, number: SampleType, meaning: Meaning| {
            fields.push(name, name, FieldKind::Other, vec![Component::Stored(self.column(at, number), meaning)]);
        };
        let plain = Meaning::AsStored;
        scalar("intensity", 12, SampleType::U16, plain);
        if self.format < EXTENDED {
            scalar("return-number", 14, SampleType::U8, Meaning::Bits(0x07));
            scalar("classification", 15, SampleType::U8, Meaning::Bits(0x1f));
            scalar("scan-angle", 16, SampleType::I8, plain);
            scalar("point-source", 18, SampleType::U16, plain);
        } else {
            scalar("return-number", 14, SampleType::U8, Meaning::Bits(0x0f));
            scalar("classification", 16, SampleType::U8, plain);
            // Degrees, as those of the older formats.
            scalar("scan-angle", 18, SampleType::I16, Meaning::Linear { factor: 0.006, first: 0.0 });
            scalar("point-source", 20, SampleType::U16, plain);
        }
        let has = |at: u64| (at > 0).then_some(at);
        if let Some(at) = has(TIME[self.format]) {
            scalar("gps-time", at, SampleType::F64, plain);
        }
        if let Some(at) = has(RED[self.format]) {
            for (name, more) in [("red", 0), ("green", 2), ("blue", 4)] {
                scalar(name, at + more, SampleType::U16, plain);
            }
        }
        if let Some(at) = has(INFRARED[self.format]) {
            scalar("near-infrared", at, SampleType::U16, plain);
        }
        for Extra { name, at, number, meanings } in extras {
            let axes = (*at..).step_by(number.size()).zip(meanings);
            let components: Vec<Component> =
                axes.map(|(at, meaning)| Component::Stored(self.column(at, *number), *meaning)).collect();
            match components[..] {
                [component] => fields.push_scalar(name, component),
                _ => fields.push(name, name, FieldKind::Other, components),
            }
        }
        fields
    }
}

/// Bytes of the header of a record.
const RECORD: u64 = 54;

/// What a record says of those between header and points, `None` where there is none of that user and number.
///
/// # Errors
/// When the file ends within it.
fn record(
    file: &RangeFile,
    header: &Header,
    head: &[u8],
    user: &str,
    number: u16,
) -> Result<Option<Vec<u8>>, ImportError> {
    let mut at = u64::from(head[94]) | u64::from(head[95]) << 8;
    for _ in 0..Order::Little.u32(head, 100) {
        let mut about = [0; RECORD as usize];
        if at + RECORD > header.start.min(file.length) {
            break;
        }
        file.read(at, &mut about, "variable length record")?;
        let length = u64::from(about[20]) | u64::from(about[21]) << 8;
        let own = about[2..18].split(|letter| *letter == 0).next().unwrap_or_default();
        if own == user.as_bytes() && u16::from_le_bytes([about[18], about[19]]) == number {
            let mut record = vec![0; length as usize];
            file.read(at + RECORD, &mut record, "variable length record")?;
            return Ok(Some(record));
        }
        at += RECORD + length;
    }
    Ok(None)
}
