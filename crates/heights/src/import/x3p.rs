//! X3P (ISO 25178-72): a ZIP archive with a description in XML and the heights beside it, in metres.

use super::archive::Archive;
use super::content::{Content, in_one_line};
use super::dimensions::{dimensions, distance};
use super::md5::Md5;
use super::raw::{Layout, RawSamples};
use super::source::{MASKED, Samples};
use super::xml::{Elements, parsed};
use super::{HeightDescription, HeightFormat, HeightSource, NoData, always};
use crate::model::{HeightGrid, Window};
use deepfield_data::import::{ByteOrder, ImportError};
use deepfield_data::model::{SampleType, Scale, Unit};

/// Surfaces with an increment along both axes.
pub(super) const X3P: HeightFormat = HeightFormat { name: "x3p", extensions: &["x3p"], is_sure: always, detect, open };

/// The description's name, and the most bytes that it has.
const MAIN: &str = "main.xml";
const LONGEST_XML: u64 = 4 << 20;

/// The file that the description's checksum is in, and the most bytes that it has.
const CHECKSUM: &str = "md5checksum.hex";
const LONGEST_CHECKSUM: u64 = 1 << 10;

/// A ZIP archive with a description in it; a damaged one where its first bytes or its name say so.
fn detect(content: &Content) -> bool {
    if !content.head.starts_with(b"PK\x03\x04") {
        return false;
    }
    let has = |name: &[u8]| content.head.windows(name.len()).any(|part| part == name);
    let named = || Archive::open(content).is_ok_and(|archive| archive.named(MAIN).is_some());
    content.has_extension("x3p") || has(MAIN.as_bytes()) && has(b"bindata/") || !has(b".npy") && named()
}

fn open(content: &Content) -> Result<HeightSource, ImportError> {
    let mut archive = Archive::open(content)?;
    let xml = archive.whole(MAIN, LONGEST_XML)?;
    let mut notes = Vec::new();
    check_main(&mut archive, &xml, &mut notes)?;
    let text = String::from_utf8_lossy(&xml);
    let document = parsed(content, MAIN, &text)?;
    let main = Elements { content, name: MAIN, document: &document };
    check_kind(&main)?;

    let sample_type = match main.needed(&["CZ", "DataType"])? {
        "I" => SampleType::I16,
        "L" => SampleType::I32,
        "F" => SampleType::F32,
        "D" => SampleType::F64,
        other => return Err(content.malformed("CZ/DataType", other, "I, L, F or D")),
    };
    let count = |name: &str| -> Result<i64, ImportError> {
        let found = main.number(&["MatrixDimension", name], "a whole number")?;
        found.ok_or_else(|| main.missing(&["MatrixDimension", name]))
    };
    let size = dimensions(content, ("SizeX", count("SizeX")?.into()), ("SizeY", count("SizeY")?.into()), sample_type)?;
    if let Some(layers) =
        main.number::<i64>(&["MatrixDimension", "SizeZ"], "a whole number")?.filter(|layers| *layers != 1)
    {
        return Err(content.malformed("MatrixDimension/SizeZ", format!("{layers} layers"), "1: one surface"));
    }
    let mut grid = HeightGrid::new(size[0], size[1], sample_type);
    (grid.xy_unit, grid.height_unit) = (Unit::new("m"), Unit::new("m"));
    let has_spacing = place(&main, &mut grid, &mut notes)?;

    let link = main.needed(&["DataLink", "PointDataLink"])?;
    let layout = Layout::packed(size, 0, sample_type, ByteOrder::Little);
    let bytes = layout.row_stride.saturating_mul(size[1]);
    let mut digest = Md5::new();
    let data = archive.unpack(link, bytes, &grid.described(), |piece| digest.put(piece))?;
    note_digest(link, main.text(&["DataLink", "MD5ChecksumPointData"]), digest, &mut notes);
    let samples = data.samples(content, link, layout)?;

    let samples: Box<dyn Samples> = match main.text(&["DataLink", "ValidPointsLink"]) {
        None => Box::new(samples),
        Some(link) => {
            let mut digest = Md5::new();
            let bits = grid.samples().div_ceil(8);
            let mask = archive.unpack(link, bits, "a bit a sample", |piece| digest.put(piece))?;
            note_digest(link, main.text(&["DataLink", "MD5ChecksumValidPoints"]), digest, &mut notes);
            Box::new(Masked { samples, bits: mask.bytes(content, link)?, columns: size[0] })
        }
    };
    let mut about = HeightDescription::new(content, X3P.name, grid);
    (about.has_spacing, about.notes) = (has_spacing, notes);
    Ok(HeightSource::new(about, samples, NoData::Nothing))
}

/// Refuses what is no surface.
fn check_kind(main: &Elements) -> Result<(), ImportError> {
    let refused =
        |field: &str, found: String| Err(main.content.malformed(field, found, "a surface (SUR): a matrix of heights"));
    match main.text(&["FeatureType"]) {
        None | Some("SUR") => {}
        Some("PRF") => return refused("FeatureType", "PRF, a profile".into()),
        Some("PCL") => return refused("FeatureType", "PCL, a point cloud".into()),
        Some(other) => return refused("FeatureType", other.to_owned()),
    }
    if main.find(&["MatrixDimension"]).is_none() && main.find(&["ListDimension"]).is_some() {
        return refused("ListDimension", "a list of points".into());
    }
    for axis in ["CX", "CY"] {
        if let Some(kind) = main.text(&[axis, "AxisType"]).filter(|kind| *kind != "I") {
            return refused(&format!("{axis}/AxisType"), format!("{kind}, a place of each sample's own"));
        }
    }
    if main.find(&["DataLink"]).is_none() && main.find(&["DataList"]).is_some() {
        return Err(main.content.malformed("DataList", "heights as text in main.xml", "DataLink: a file of them"));
    }
    Ok(())
}

/// Where samples are, and what their numbers mean. Whether it says how far they are apart.
fn place(main: &Elements, grid: &mut HeightGrid, notes: &mut Vec<String>) -> Result<bool, ImportError> {
    let content = main.content;
    let mut stated = 0;
    for (axis, name) in ["CX", "CY"].into_iter().enumerate() {
        grid.origin[axis] = main.number(&[name, "Offset"], "a number")?.unwrap_or(0.0);
        if content.options.spacing.is_some() {
            continue;
        }
        if let Some(step) = main.number(&[name, "Increment"], "a number")? {
            grid.step[axis] = distance(content, &format!("{name}/Increment"), step)?;
            stated += 1;
        }
    }
    let slope: f64 = main.number(&["CZ", "Increment"], "a number")?.unwrap_or(1.0);
    let intercept: f64 = main.number(&["CZ", "Offset"], "a number")?.unwrap_or(0.0);
    if !grid.sample_type.is_float() {
        grid.scale = Scale { slope, intercept };
    } else if slope != 1.0 || intercept != 0.0 {
        notes.push(format!("heights are floats: the increment {slope} and the offset {intercept} of z are left out"));
    }
    Ok(stated == 2)
}

/// Whether the description is what its checksum says.
fn check_main(archive: &mut Archive, xml: &[u8], notes: &mut Vec<String>) -> Result<(), ImportError> {
    if archive.named(CHECKSUM).is_none() {
        return Ok(());
    }
    let stated = archive.whole(CHECKSUM, LONGEST_CHECKSUM)?;
    let stated: String = stated.iter().map(|byte| char::from(*byte)).take_while(char::is_ascii_hexdigit).collect();
    let mut digest = Md5::new();
    digest.put(xml);
    note_digest(MAIN, Some(&stated).filter(|stated| !stated.is_empty()).map(String::as_str), digest, notes);
    Ok(())
}

/// Notes where a part is not what its checksum says.
fn note_digest(name: &str, stated: Option<&str>, digest: Md5, notes: &mut Vec<String>) {
    let found = digest.digest();
    if let Some(stated) = stated.filter(|stated| !stated.eq_ignore_ascii_case(&found)) {
        notes.push(format!(
            "{}: its MD5 is {found}, {} is stated: it was changed",
            in_one_line(&name),
            in_one_line(&stated)
        ));
    }
}

/// Samples, and a bit for each that says whether it was measured: that of sample i is bit i % 8 of byte i / 8.
struct Masked {
    samples: RawSamples,
    bits: Vec<u8>,
    columns: u64,
}

impl Samples for Masked {
    fn read(&self, window: Window, out: &mut [f64]) -> Result<(), ImportError> {
        self.samples.read(window, out)?;
        let width = (window.columns as usize).max(1);
        for (number, row) in out.chunks_mut(width).enumerate() {
            let first = (window.row + number as u64) * self.columns + window.column;
            for (sample, index) in row.iter_mut().zip(first..) {
                let byte = self.bits.get((index / 8) as usize).copied().unwrap_or(0);
                if byte >> (index % 8) & 1 == 0 {
                    *sample = MASKED;
                }
            }
        }
        Ok(())
    }
}
