//! X3P (ISO 25178-72): a ZIP archive of a description and the heights, in metres. Whole numbers keep their type, with
//! an increment and an offset, and have a mask where some were not measured; floats have NaN there.

use super::new_file::NewFile;
use super::numbers::encode;
use super::{Export, ExportError, Exported};
use crate::import::md5::Md5;
use crate::model::units::metres;
use crate::model::{HeightGrid, Window};
use deepfield_data::model::{SampleType, Unit};
use std::io::Write;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

/// The names of the archive's files.
const MAIN: &str = "main.xml";
const DATA: &str = "bindata/data.bin";
const MASK: &str = "bindata/valid.bin";
const CHECKSUM: &str = "md5checksum.hex";

/// How heights are written.
struct Numbers {
    /// The type's letter.
    letter: char,
    sample_type: SampleType,
    /// Metres of a number, and what is added.
    increment: f64,
    offset: f64,
}

impl Numbers {
    /// How a field's heights are written whose unit has so many metres.
    fn of(grid: &HeightGrid, metres: f64) -> Numbers {
        let floats = |letter, sample_type| Numbers { letter, sample_type, increment: metres, offset: 0.0 };
        let (increment, offset) = (grid.scale.slope * metres, grid.scale.intercept * metres);
        match grid.sample_type {
            SampleType::I8 | SampleType::U8 | SampleType::I16 => {
                Numbers { letter: 'I', sample_type: SampleType::I16, increment, offset }
            }
            SampleType::U16 | SampleType::I32 => {
                Numbers { letter: 'L', sample_type: SampleType::I32, increment, offset }
            }
            // Only what is in metres already stays as it is.
            SampleType::F32 if increment == 1.0 && offset == 0.0 => floats('F', SampleType::F32),
            _ => floats('D', SampleType::F64),
        }
    }

    fn is_whole(&self) -> bool {
        !self.sample_type.is_float()
    }
}

pub(super) fn write(export: &Export) -> Result<Exported, ExportError> {
    let grid = export.grid();
    let length = |field: &str, unit: &Unit, option: &str| {
        let found = if unit.is_unknown() { "none" } else { &unit.0 };
        let expected = format!("km, m, mm, um or nm, as .x3p is in metres ({option})");
        metres(unit).ok_or_else(|| export.refused(field, found, &expected))
    };
    let across = length("unit of places", &grid.xy_unit, "--xy-unit")?;
    let numbers = Numbers::of(grid, length("unit of heights", &grid.height_unit, "--height-unit")?);
    let [dx, dy] = grid.step;
    if dx < 0.0 {
        return Err(export.refused(
            "spacing",
            format!("{dx}, {dy}"),
            "columns from left to right: increments are above 0",
        ));
    }
    let is_turned = dy < 0.0;
    let mut file = NewFile::create(export.output, 0)?;
    let fail = |error: zip::result::ZipError| ExportError::io(export.output, error.into());
    let io = |source| ExportError::io(export.output, source);
    let mut archive = ZipWriter::new(file.inner());
    let samples = export.window.samples();
    let entry = |bytes: u64| {
        let options = SimpleFileOptions::default().compression_method(CompressionMethod::Deflated);
        // The same bytes at any time.
        options.last_modified_time(DateTime::default()).large_file(bytes >= u64::from(u32::MAX))
    };
    let each = |put: &mut dyn FnMut(Window, &[f64]) -> Result<(), ExportError>| match is_turned {
        true => export.each_band_turned(numbers.is_whole(), put),
        false => export.each_band(numbers.is_whole(), put),
    };

    archive.start_file(DATA, entry(samples.saturating_mul(numbers.sample_type.size() as u64))).map_err(fail)?;
    let mut digest = Md5::new();
    let (mut lengths, mut bytes) = (Vec::new(), Vec::new());
    let valid = each(&mut |_, values| {
        lengths.clear();
        match numbers.is_whole() {
            true => lengths.extend(values.iter().map(|value| if value.is_nan() { 0.0 } else { *value })),
            false => lengths.extend(values.iter().map(|value| value * numbers.increment)),
        }
        encode(numbers.sample_type, &lengths, &mut bytes);
        digest.put(&bytes);
        archive.write_all(&bytes).map_err(io)
    })?;
    let data_digest = digest.digest();

    let mut mask_digest = None;
    if numbers.is_whole() && valid < samples {
        archive.start_file(MASK, entry(samples / 8)).map_err(fail)?;
        let mut digest = Md5::new();
        let mut mask = Mask::default();
        each(&mut |_, values| {
            values.iter().for_each(|value| mask.push(!value.is_nan()));
            let bytes = mask.whole();
            digest.put(&bytes);
            archive.write_all(&bytes).map_err(io)
        })?;
        let bytes = mask.rest();
        digest.put(&bytes);
        archive.write_all(&bytes).map_err(io)?;
        mask_digest = Some(digest.digest());
    }

    let first = if is_turned { export.window.row + export.window.rows - 1 } else { export.window.row };
    let origin = grid.place(first as f64, export.window.column as f64).map(|axis| axis * across);
    let main =
        main(export.window, &numbers, [dx * across, dy.abs() * across], origin, &data_digest, mask_digest.as_deref());
    archive.start_file(MAIN, entry(0)).map_err(fail)?;
    archive.write_all(main.as_bytes()).map_err(io)?;
    let mut digest = Md5::new();
    digest.put(main.as_bytes());
    archive.start_file(CHECKSUM, entry(0)).map_err(fail)?;
    archive.write_all(format!("{} *{MAIN}\n", digest.digest()).as_bytes()).map_err(io)?;
    archive.finish().map_err(fail)?;
    file.finish()?;
    let mut done = export.done(valid);
    if is_turned {
        done.notes.push("rows are written from the last to the first: increments are above 0".into());
    }
    if !grid.planes.is_empty() {
        done.notes.push("colour planes are left out".into());
    }
    Ok(done)
}

/// Bits, the least of a byte first.
#[derive(Default)]
struct Mask {
    bytes: Vec<u8>,
    byte: u8,
    bits: u32,
}

impl Mask {
    fn push(&mut self, bit: bool) {
        self.byte |= u8::from(bit) << self.bits;
        self.bits += 1;
        if self.bits == 8 {
            self.bytes.push(self.byte);
            (self.byte, self.bits) = (0, 0);
        }
    }

    /// The bytes that are whole.
    fn whole(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.bytes)
    }

    /// The last one.
    fn rest(mut self) -> Vec<u8> {
        if self.bits > 0 {
            self.bytes.push(self.byte);
        }
        self.bytes
    }
}

/// The description; lengths are in metres.
fn main(window: Window, numbers: &Numbers, step: [f64; 2], origin: [f64; 2], data: &str, mask: Option<&str>) -> String {
    let axis = |name: &str, step: f64, offset: f64| {
        format!(
            "      <{name}>\n        <AxisType>I</AxisType>\n        <DataType>D</DataType>\n        <Increment>{step:e}</Increment>\n        \
             <Offset>{offset:e}</Offset>\n      </{name}>\n"
        )
    };
    let scale = match numbers.is_whole() {
        true => format!(
            "        <Increment>{:e}</Increment>\n        <Offset>{:e}</Offset>\n",
            numbers.increment, numbers.offset
        ),
        false => String::new(),
    };
    let links = mask.map_or(String::new(), |digest| {
        format!("      <ValidPointsLink>{MASK}</ValidPointsLink>\n      <MD5ChecksumValidPoints>{digest}</MD5ChecksumValidPoints>\n")
    });
    let version = env!("CARGO_PKG_VERSION");
    format!(
        r#"<?xml version="1.0" encoding="UTF-8" standalone="no" ?>
<p:ISO5436_2 xmlns:p="http://www.opengps.eu/2008/ISO5436_2" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:schemaLocation="http://www.opengps.eu/2008/ISO5436_2 http://www.opengps.eu/2008/ISO5436_2/ISO5436_2.xsd">
  <Record1>
    <Revision>ISO5436 - 2000</Revision>
    <FeatureType>SUR</FeatureType>
    <Axes>
{x}{y}      <CZ>
        <AxisType>A</AxisType>
        <DataType>{letter}</DataType>
{scale}      </CZ>
    </Axes>
  </Record1>
  <Record2>
    <Date>1970-01-01T00:00:00Z</Date>
    <Instrument>
      <Manufacturer>deepfield</Manufacturer>
      <Model>deepfield</Model>
      <Serial>not available</Serial>
      <Version>{version}</Version>
    </Instrument>
    <CalibrationDate>1970-01-01T00:00:00Z</CalibrationDate>
    <ProbingSystem>
      <Type>Software</Type>
      <Identification>not available</Identification>
    </ProbingSystem>
  </Record2>
  <Record3>
    <MatrixDimension>
      <SizeX>{columns}</SizeX>
      <SizeY>{rows}</SizeY>
      <SizeZ>1</SizeZ>
    </MatrixDimension>
    <DataLink>
      <PointDataLink>{DATA}</PointDataLink>
      <MD5ChecksumPointData>{data}</MD5ChecksumPointData>
{links}    </DataLink>
  </Record3>
  <Record4>
    <ChecksumFile>{CHECKSUM}</ChecksumFile>
  </Record4>
</p:ISO5436_2>
"#,
        x = axis("CX", step[0], origin[0]),
        y = axis("CY", step[1], origin[1]),
        letter = numbers.letter,
        columns = window.columns,
        rows = window.rows,
    )
}
