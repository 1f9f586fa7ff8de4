//! What particles are at each time that was asked for: sources of the steps of a run. They are kept in memory while they are few, else in a
//! temporary file without a name.

use super::particle::State;
use crate::import::grid::scratch::{Scratch, Storage};
use crate::import::{Description, FamilyInfo, Field, FieldKind, ImportError, Source};
use crate::model::{FamilyName, Unit};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The format of frames in `info`.
const FORMAT: &str = "trace";
/// Bytes of a particle: id, position, velocity in single precision, vorticity.
const WIDTHS: [u64; 4] = [8, 24, 12, 4];

/// What is the same for all frames.
pub(super) struct Common {
    /// The file of the field.
    pub path: PathBuf,
    /// Its size, bytes.
    pub bytes: u64,
    pub length_unit: Unit,
    pub velocity_unit: Unit,
    pub box_size: Option<f64>,
    /// Mass, smoothing length and density of each particle.
    pub mass: f64,
    pub smoothing_length: f64,
    pub density: f64,
}

/// Frames that are being written.
pub(super) struct FrameWriter {
    common: Common,
    scratch: Scratch,
    /// Where each begins, how many particles it has, and its time.
    frames: Vec<(u64, u64, f64)>,
    written: u64,
}

impl FrameWriter {
    /// None yet.
    pub(super) fn new(common: Common) -> FrameWriter {
        FrameWriter { scratch: Scratch::new(&common.path), common, frames: Vec::new(), written: 0 }
    }

    /// Adds the frame at a time; positions in a periodic box are those within it.
    ///
    /// # Errors
    /// When the temporary file cannot be written.
    pub(super) fn add(&mut self, time: f64, states: &[State], corner: [f64; 3]) -> Result<(), ImportError> {
        let mut bytes = Vec::with_capacity(states.len() * WIDTHS.iter().sum::<u64>() as usize);
        bytes.extend(states.iter().flat_map(|state| state.id.to_ne_bytes()));
        let edge = self.common.box_size;
        let placed = |state: &State| -> [f64; 3] {
            std::array::from_fn(|axis| match edge {
                None => state.position[axis],
                Some(edge) => {
                    let within = (state.position[axis] - corner[axis]).rem_euclid(edge);
                    // What is a rounding before the first face is rounded to the last.
                    if within < edge { within } else { 0.0 }
                }
            })
        };
        bytes.extend(states.iter().flat_map(|state| placed(state).map(f64::to_ne_bytes)).flatten());
        bytes.extend(states.iter().flat_map(|state| state.velocity.map(|v| (v as f32).to_ne_bytes())).flatten());
        bytes.extend(states.iter().flat_map(|state| (state.vorticity as f32).to_ne_bytes()));
        self.scratch.write(&bytes)?;
        self.frames.push((self.written, states.len() as u64, time));
        self.written += bytes.len() as u64;
        Ok(())
    }

    /// The frames, to be read.
    ///
    /// # Errors
    /// When the temporary file cannot be written.
    pub(super) fn finish(self) -> Result<Vec<Frame>, ImportError> {
        let FrameWriter { common, scratch, frames, .. } = self;
        let count = frames.len();
        let all = Arc::new(Frames { common, storage: scratch.into_storage()?, frames });
        Ok((0..count).map(|number| Frame { all: Arc::clone(&all), number }).collect())
    }
}

struct Frames {
    common: Common,
    storage: Storage,
    frames: Vec<(u64, u64, f64)>,
}

/// A frame: particles that were traced, at one time.
#[derive(Clone)]
pub struct Frame {
    all: Arc<Frames>,
    number: usize,
}

impl std::fmt::Debug for Frame {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Frame").field("number", &self.number).finish_non_exhaustive()
    }
}

impl PartialEq for Frame {
    fn eq(&self, other: &Frame) -> bool {
        Arc::ptr_eq(&self.all, &other.all) && self.number == other.number
    }
}

impl Frame {
    /// What it holds.
    pub(super) fn description(&self) -> Description {
        let Frames { common, frames, .. } = &*self.all;
        let (_, count, time) = frames.get(self.number).copied().unwrap_or_default();
        let unknown = Unit::default;
        let units = [
            common.length_unit.clone(),
            common.velocity_unit.clone(),
            unknown(),
            common.length_unit.clone(),
            unknown(),
            unknown(),
            unknown(),
        ];
        let fields = Column::ALL.iter().zip(units).map(|(column, unit)| column.field(unit)).collect();
        Description {
            length_unit: common.length_unit.clone(),
            time: Some(time),
            box_size: common.box_size,
            families: vec![FamilyInfo { name: FamilyName::Gas, count, fields }],
            ..Description::unitless(&name(&common.path, self.number), FORMAT, common.bytes)
        }
    }

    /// Opens it.
    pub fn open(&self) -> Box<dyn Source> {
        Box::new(FrameSource { description: self.description(), frame: self.clone() })
    }
}

/// What a frame is called: no file has it, so that nobody takes the field for the frame.
fn name(field: &Path, number: usize) -> PathBuf {
    let mut name = field.as_os_str().to_owned();
    name.push(format!("@{number}"));
    name.into()
}

/// What a field of a frame is.
#[derive(Clone, Copy)]
enum Column {
    Position,
    Velocity,
    Mass,
    SmoothingLength,
    Density,
    Id,
    Vorticity,
}

impl Column {
    /// In the order of a description's fields.
    const ALL: [Column; 7] = [
        Column::Position,
        Column::Velocity,
        Column::Mass,
        Column::SmoothingLength,
        Column::Density,
        Column::Id,
        Column::Vorticity,
    ];

    fn field(self, unit: Unit) -> Field {
        let (name, components, kind) = match self {
            Column::Position => ("position", 3, FieldKind::Position),
            Column::Velocity => ("velocity", 3, FieldKind::Velocity),
            Column::Mass => ("mass", 1, FieldKind::Mass),
            Column::SmoothingLength => ("smoothing-length", 1, FieldKind::SmoothingLength),
            Column::Density => ("density", 1, FieldKind::Density),
            Column::Id => ("id", 1, FieldKind::Id),
            Column::Vorticity => ("vorticity", 1, FieldKind::Other),
        };
        Field { name: name.into(), stored_as: name.into(), unit, components, kind }
    }
}

/// A frame that is being read.
struct FrameSource {
    description: Description,
    frame: Frame,
}

impl FrameSource {
    /// The bytes of some particles in a block of the frame.
    fn block(&self, block: usize, range: &Range<u64>) -> Result<Vec<u8>, ImportError> {
        let Frames { common, storage, frames } = &*self.frame.all;
        let (start, count, _) = frames.get(self.frame.number).copied().unwrap_or_default();
        let before: u64 = WIDTHS.iter().take(block).sum();
        let mut bytes = vec![0; ((range.end - range.start) * WIDTHS[block]) as usize];
        storage.read(&common.path, start + count * before + range.start * WIDTHS[block], &mut bytes)?;
        Ok(bytes)
    }
}

impl Source for FrameSource {
    fn description(&self) -> &Description {
        &self.description
    }

    fn read(&self, family: usize, field: usize, range: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        self.description.check_range(family, field, &range, out.len())?;
        let common = &self.frame.all.common;
        let single = |bytes: Vec<u8>, out: &mut [f64]| {
            let values = bytes.as_chunks().0.iter().map(|value| f64::from(f32::from_ne_bytes(*value)));
            out.iter_mut().zip(values).for_each(|(out, value)| *out = value);
        };
        match Column::ALL.get(field) {
            Some(Column::Position) => {
                let bytes = self.block(1, &range)?;
                let values = bytes.as_chunks().0.iter().map(|value| f64::from_ne_bytes(*value));
                out.iter_mut().zip(values).for_each(|(out, value)| *out = value);
            }
            Some(Column::Velocity) => single(self.block(2, &range)?, out),
            Some(Column::Vorticity) => single(self.block(3, &range)?, out),
            Some(Column::Mass) => out.fill(common.mass),
            Some(Column::SmoothingLength) => out.fill(common.smoothing_length),
            Some(Column::Density) => out.fill(common.density),
            Some(Column::Id) | None => {
                let bytes = self.block(0, &range)?;
                let values = bytes.as_chunks().0.iter().map(|value| u64::from_ne_bytes(*value) as f64);
                out.iter_mut().zip(values).for_each(|(out, value)| *out = value);
            }
        }
        Ok(())
    }
}
