//! The footer of a file of heights: the field, what its samples say, its levels, and a record of each chunk; as bytes and back.

use super::node::{NodeRecord, RECORD_LEN};
use super::photo::StoredPhoto;
use super::{ROUNDED, VERSION, WITH_PHOTO};
use crate::codec::heights;
use crate::codec::values::Values;
use crate::hierarchy::chunks::Lattice;
use crate::model::{Facts, HeightGrid, Invalid, Plane};
use deepfield_data::model::{SampleType, Scale, Unit};
use deepfield_data::store::error::Damage;
use deepfield_data::store::wire::{Decoder, Encoder};
use serde::Serialize;
use std::path::PathBuf;

/// Most samples of a field's side: with this many every number of samples is far from any limit.
const MOST_SIDE: u64 = 1 << 31;

/// What is known of a file of heights without reading a page.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightAbout {
    /// Where it came from.
    pub source: PathBuf,
    /// That file's format.
    pub format: String,
    /// That file's size, bytes.
    pub source_bytes: u64,
    /// Whether the source says how far samples are apart.
    pub has_spacing: bool,
    /// What the import assumed and the build found, a sentence each.
    pub notes: Vec<String>,
    /// The grid.
    pub grid: HeightGrid,
    /// What its samples say.
    pub facts: Facts,
    /// Samples that were not measured, by what stood in their place.
    pub invalid: Invalid,
    /// Area of T, in halves of cells.
    pub area: u64,
    /// From differences of stored samples along columns and rows to the slopes in space that normals are made of.
    pub slopes: [f64; 2],
    /// Its levels, the finest first.
    pub levels: Vec<LevelAbout>,
    /// How its samples are rounded; nothing where they are the source's own.
    pub rounded: Option<Rounded>,
    /// The photo that lies over it.
    pub photo: Option<StoredPhoto>,
}

/// How samples are rounded, and how far that is at most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rounded {
    /// No height is farther from the source's than this, in the unit of heights.
    pub error: f64,
    /// Values that are left.
    pub values: Values,
}

impl Rounded {
    fn encode(&self, out: &mut Encoder) {
        [self.error, self.values.step().unwrap_or_default()].into_iter().for_each(|value| out.f64(value));
    }

    fn decode(input: &mut Decoder<'_>, sample_type: SampleType) -> Result<Rounded, Damage> {
        let (error, step) = (input.f64("the height error")?, input.f64("the step of samples")?);
        let values = Values::stepped(sample_type, step).filter(|_| error.is_finite() && error > 0.0);
        let expected = || format!("a height error above 0 and a step of {sample_type}, found {error} and {step}");
        values.map(|values| Rounded { error, values }).ok_or_else(|| Damage::new("footer", expected()))
    }
}

impl HeightAbout {
    /// The version of a file that says this.
    pub(super) fn version(&self) -> u32 {
        match (self.rounded, &self.photo) {
            (Some(_), _) => ROUNDED,
            (None, Some(_)) => WITH_PHOTO,
            (None, None) => VERSION,
        }
    }

    /// The values that samples have.
    pub fn values(&self) -> Values {
        self.rounded.map_or(Values::all(self.grid.sample_type), |rounded| rounded.values)
    }
}

/// A level of chunks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LevelAbout {
    /// 0 is full resolution.
    pub level: u32,
    /// Chunks with something in them.
    pub chunks: u64,
    /// Samples of the level, those of no chunk among them.
    pub samples: u64,
    /// Bytes that its chunks take.
    pub bytes: u64,
}

impl HeightAbout {
    /// The levels of its grid.
    pub fn lattice_of(grid: &HeightGrid, side_bits: u32) -> Lattice {
        Lattice { side_bits, ..Lattice::new(grid.rows, grid.columns) }
    }
}

/// The bytes.
pub(super) fn encode(about: &HeightAbout, lattice: &Lattice, nodes: &[NodeRecord]) -> Vec<u8> {
    let mut out = Encoder::default();
    out.text(&about.source.to_string_lossy());
    out.text(&about.format);
    out.u64(about.source_bytes);
    out.u8(about.has_spacing.into());
    out.u32(about.notes.len() as u32);
    about.notes.iter().for_each(|note| out.text(note));
    let grid = &about.grid;
    [grid.columns, grid.rows].into_iter().for_each(|count| out.u64(count));
    grid.origin.into_iter().chain(grid.step).for_each(|value| out.f64(value));
    out.text(&grid.xy_unit.0);
    out.text(&grid.height_unit.0);
    out.text(grid.sample_type.name());
    out.f64(grid.scale.slope);
    out.f64(grid.scale.intercept);
    out.u32(grid.planes.len() as u32);
    grid.planes.iter().for_each(|plane| out.text(&plane.name));
    out.u8(grid.crs.is_some().into());
    out.text(grid.crs.as_deref().unwrap_or_default());
    let facts = &about.facts;
    let Invalid { no_data, nan, infinite } = about.invalid;
    [facts.valid, facts.lone, no_data, nan, infinite, about.area].into_iter().for_each(|count| out.u64(count));
    [facts.min, facts.max, facts.mean].into_iter().chain(about.slopes).for_each(|value| out.f64(value));
    out.u32(lattice.side_bits);
    out.u32(about.levels.len() as u32);
    for level in &about.levels {
        out.u32(level.level);
        [level.chunks, level.samples, level.bytes].into_iter().for_each(|count| out.u64(count));
    }
    nodes.iter().for_each(|node| node.encode(&mut out));
    if let Some(rounded) = &about.rounded {
        rounded.encode(&mut out);
        out.u8(about.photo.is_some().into());
    }
    if let Some(photo) = &about.photo {
        photo.encode(&mut out);
    }
    out.bytes
}

/// Reads the bytes, of a file of a version: what they say, the lattice, and a record of each of its chunks.
pub(super) fn decode(bytes: &[u8], version: u32) -> Result<(HeightAbout, Lattice, Vec<NodeRecord>), Damage> {
    let mut whole = Decoder::new(bytes, "footer");
    let input = &mut whole;
    let wrong = |expected: String| Damage::new("footer", expected);
    let flag = |input: &mut Decoder<'_>, field: &str| match input.u8(field)? {
        0 => Ok(false),
        1 => Ok(true),
        other => Err(Damage::new("footer", format!("{field} of 0 or 1, found {other}"))),
    };
    let source = input.text("the source's path")?.into();
    let format = input.text("the source's format")?;
    let source_bytes = input.u64("the source's size")?;
    let has_spacing = flag(input, "whether distances are stated")?;
    let notes = (0..input.count(4, "notes")?).map(|_| input.text("a note")).collect::<Result<_, _>>()?;
    let (columns, rows) = (input.u64("the number of columns")?, input.u64("the number of rows")?);
    if ![columns, rows].iter().all(|count| (2..=MOST_SIDE).contains(count)) {
        return Err(wrong(format!("from 2 to {MOST_SIDE} columns and rows, found {columns} x {rows}")));
    }
    let mut pair =
        || -> Result<[f64; 2], Damage> { Ok([input.f64("places of samples")?, input.f64("places of samples")?]) };
    let (origin, step) = (pair()?, pair()?);
    let is_placed = origin.iter().chain(&step).all(|value| value.is_finite()) && step.iter().all(|step| *step != 0.0);
    let (xy_unit, height_unit) = (Unit(input.text("a unit")?), Unit(input.text("a unit")?));
    let sample_type: SampleType = input.text("the type of samples")?.parse().map_err(wrong)?;
    let scale = Scale { slope: input.f64("a slope")?, intercept: input.f64("an intercept")? };
    let is_scaled = scale.slope.is_finite() && scale.intercept.is_finite() && scale.slope != 0.0;
    if !is_placed || !is_scaled || !heights::is_coded(sample_type) {
        return Err(wrong("finite places, steps and scales, and samples of at most 32 bits or of floats".into()));
    }
    let planes = (0..input.count(4, "colour planes")?)
        .map(|_| Ok(Plane { name: input.text("a plane's name")? }))
        .collect::<Result<Vec<_>, _>>()?;
    let has_crs = flag(input, "whether there is a reference system")?;
    let crs = Some(input.text("the reference system")?).filter(|_| has_crs);
    let grid = HeightGrid { columns, rows, origin, step, xy_unit, height_unit, sample_type, scale, planes, crs };
    let mut counts = [0; 6];
    for count in &mut counts {
        *count = input.u64("a count")?;
    }
    let [valid, lone, no_data, nan, infinite, area] = counts;
    let mut values = [0.0; 5];
    for value in &mut values {
        *value = input.f64("a range")?;
    }
    let [min, max, mean, along_columns, along_rows] = values;
    let facts = Facts { valid, lone, min, max, mean };
    let side_bits = input.u32("the size of chunks")?;
    if !(1..=12).contains(&side_bits) {
        return Err(wrong(format!("chunks of 2 to 4096 cells a side, found 2^{side_bits}")));
    }
    let lattice = HeightAbout::lattice_of(&grid, side_bits);
    let number = input.count(28, "levels")?;
    if number != lattice.levels() as usize {
        return Err(wrong(format!("{} levels, found {number}", lattice.levels())));
    }
    let mut levels = Vec::with_capacity(number);
    for level in 0..number as u32 {
        let found = LevelAbout {
            level: input.u32("a level")?,
            chunks: input.u64("a level's chunks")?,
            samples: input.u64("a level's samples")?,
            bytes: input.u64("a level's bytes")?,
        };
        let [rows, columns] = lattice.samples_of(level);
        if found.level != level || found.samples != rows * columns {
            return Err(wrong(format!("level {level} of {rows} x {columns} samples, found {found:?}")));
        }
        levels.push(found);
    }
    let chunks = lattice.chunks();
    // Before anything of that size is allocated.
    if chunks.checked_mul(RECORD_LEN as u64).is_none_or(|len| len > bytes.len() as u64) {
        return Err(wrong(format!("room for {chunks} chunks")));
    }
    let nodes = (0..chunks).map(|_| NodeRecord::decode(input)).collect::<Result<Vec<_>, _>>()?;
    let rounded = (version == ROUNDED).then(|| Rounded::decode(input, sample_type)).transpose()?;
    let has_photo = if rounded.is_some() { flag(input, "whether there is a photo")? } else { version == WITH_PHOTO };
    let photo = has_photo.then(|| StoredPhoto::decode(input, bytes.len() as u64)).transpose()?;
    whole.finish()?;
    for (level, own) in levels.iter().enumerate() {
        let of_level = |(key, _): &(crate::hierarchy::chunks::ChunkKey, &NodeRecord)| usize::from(key.level) == level;
        let there = || lattice.keys().zip(&nodes).filter(of_level).filter(|(_, record)| record.place.is_written());
        let (count, len) =
            (there().count() as u64, there().map(|(_, record)| u64::from(record.place.len)).sum::<u64>());
        if (count, len) != (own.chunks, own.bytes) {
            return Err(wrong(format!("level {level} with {count} chunks of {len} bytes, found {own:?}")));
        }
    }
    let slopes = [along_columns, along_rows];
    let about = HeightAbout {
        source,
        format,
        source_bytes,
        has_spacing,
        notes,
        grid,
        facts,
        invalid: Invalid { no_data, nan, infinite },
        area,
        slopes,
        levels,
        rounded,
        photo,
    };
    Ok((about, lattice, nodes))
}
