//! Alicona's focus-variation images (`.al3d`): tags of 52 bytes, then heights as floats, then planes of 8 bits.

use super::content::{Content, latin1};
use super::dimensions::{dimensions, distance};
use super::raw::{Layout, RawSamples};
use super::{HeightDescription, HeightFormat, HeightSource, NoData, always};
use crate::model::{HeightGrid, Plane};
use deepfield_data::import::{ByteOrder, ImportError};
use deepfield_data::model::{SampleType, Unit};

/// Depth images and the pictures that belong to them.
pub(super) const AL3D: HeightFormat = HeightFormat {
    name: "al3d",
    extensions: &["al3d"],
    is_sure: always,
    detect: |content| content.head.starts_with(b"AliconaImaging"),
    open,
};

/// Where the first tag begins, bytes of a tag, and of its name.
const FIRST: usize = 17;
const TAG: usize = 52;
const NAME: usize = 20;

/// Rows begin at multiples of so many bytes.
const ALIGNED: u64 = 8;

/// The most planes that are looked for.
const MOST_PLANES: u64 = 64;

/// Names and values.
struct Tags<'c> {
    content: &'c Content,
    found: Vec<(String, String)>,
}

impl Tags<'_> {
    /// Those at the file's beginning; they end where no tag follows.
    fn read(content: &Content) -> Tags<'_> {
        let records = content.head.get(FIRST..).unwrap_or_default().chunks_exact(TAG);
        let tags = records.take_while(|tag| tag.ends_with(b"\r\n"));
        let found = tags.map(|tag| (latin1(&tag[..NAME]), latin1(&tag[NAME..TAG - 2]))).collect();
        Tags { content, found }
    }

    fn get(&self, name: &str) -> Option<&str> {
        self.found.iter().rev().find(|(own, _)| own == name).map(|(_, value)| &**value)
    }

    /// A number that has to be there.
    fn number<T: std::str::FromStr>(&self, name: &str, expected: &str) -> Result<T, ImportError> {
        let value = self.get(name).ok_or_else(|| self.content.missing(name, "a tag of the header"))?;
        value.parse().map_err(|_| self.content.malformed(name, value, expected))
    }
}

fn open(content: &Content) -> Result<HeightSource, ImportError> {
    let tags = Tags::read(content);
    let whole = "a whole number";
    let [columns, rows] = [tags.number::<i64>("Cols", whole)?, tags.number("Rows", whole)?];
    let size = dimensions(content, ("Cols", columns.into()), ("Rows", rows.into()), SampleType::F32)?;
    let mut grid = HeightGrid::new(size[0], size[1], SampleType::F32);
    if content.options.spacing.is_none() {
        for (step, name) in grid.step.iter_mut().zip(["PixelSizeXMeter", "PixelSizeYMeter"]) {
            *step = distance(content, name, tags.number(name, "a number")?)?;
        }
    }
    (grid.xy_unit, grid.height_unit) = (Unit::new("m"), Unit::new("m"));
    let no_data = match tags.get("InvalidPixelValue") {
        // Stored in single precision, whatever digits the text has.
        Some(_) => NoData::Value(f64::from(tags.number::<f32>("InvalidPixelValue", "a number")?)),
        None => NoData::Nothing,
    };
    let offset = tags.number("DepthImageOffset", whole)?;
    if offset == 0 {
        return Err(content.malformed("DepthImageOffset", offset, "where a depth image begins: there is none"));
    }
    let aligned = |bytes: u64| bytes.next_multiple_of(ALIGNED);
    let packed = Layout::packed(size, offset, SampleType::F32, ByteOrder::Little);
    let layout = Layout { row_stride: aligned(packed.row_stride), ..packed };
    let mut samples = RawSamples::new(content, "depth image", layout)?;

    let begins: u64 = tags.get("TextureImageOffset").map_or(Ok(0), |_| tags.number("TextureImageOffset", whole))?;
    let planes: u64 = match begins {
        0 => 0,
        _ => tags.number("NumberOfPlanes", whole)?,
    };
    if planes > MOST_PLANES {
        return Err(content.malformed("NumberOfPlanes", planes, format!("at most {MOST_PLANES}")));
    }
    let stride = aligned(size[0]);
    for plane in 0..planes {
        let too_large = || content.malformed("TextureImageOffset", begins, "one that is in the file");
        let before = plane.checked_mul(stride).and_then(|bytes| bytes.checked_mul(size[1]));
        let offset = before.and_then(|bytes| bytes.checked_add(begins)).ok_or_else(too_large)?;
        let packed = Layout::packed(size, offset, SampleType::U8, ByteOrder::Little);
        let name = name_of_plane(&tags, plane);
        samples =
            samples.with_plane(content, &format!("texture plane {plane}"), Layout { row_stride: stride, ..packed })?;
        grid.planes.push(Plane { name });
    }
    let mut about = HeightDescription::new(content, AL3D.name, grid);
    about.has_spacing = true;
    Ok(HeightSource::new(about, Box::new(samples), no_data))
}

/// Which planes are colours, and which says how well heights are known, stands in tags: numbers of planes between semicolons.
fn name_of_plane(tags: &Tags, plane: u64) -> String {
    let numbers = |name: &str| -> Vec<Option<u64>> {
        tags.get(name).map_or(Vec::new(), |list| list.split(';').map(|number| number.trim().parse().ok()).collect())
    };
    let texture = numbers("TexturePtr");
    let at = texture.iter().position(|number| *number == Some(plane));
    match (at, texture.len()) {
        (Some(at @ 0..3), 3) => ["red", "green", "blue"][at].to_owned(),
        (Some(_), 1) => "grey".to_owned(),
        _ if numbers("DepthImageResPtr").contains(&Some(plane)) => "quality".to_owned(),
        _ => format!("plane-{plane}"),
    }
}
