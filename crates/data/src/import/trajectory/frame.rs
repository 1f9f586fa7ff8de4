//! A frame of a trajectory as a source: its rows are read and parsed in blocks, of which a few are kept.

use super::cell::{Cell, Cells};
use super::columns::{ATOMS, Part, Units};
use super::index::{BLOCK, Frame, Index};
use super::known::index_of;
use super::species::SpeciesKind;
use super::{Damage, Text, elements, first_of, row};
use crate::import::bytes::RangeFile;
use crate::import::{Description, FamilyInfo, Field, FieldKind, ImportError, Source, step_name};
use crate::model::{FamilyName, ReadMethod, Unit};
use std::collections::VecDeque;
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// Values of parsed blocks that a source keeps, beside the latest block.
const MOST_VALUES: usize = 1 << 23;

/// The rows of a block as numbers.
struct Block {
    /// Row by row, one for each column.
    values: Vec<f64>,
    ids: Vec<u64>,
}

/// A frame.
pub(super) struct FrameSource {
    file: RangeFile,
    index: Arc<Index>,
    number: usize,
    frame: Frame,
    description: Description,
    /// Of each field.
    parts: Vec<Part>,
    /// What is taken from every place: the corner of a periodic cube.
    corner: [f64; 3],
    /// The cell, where particles are followed through its faces.
    images: Option<Cell>,
    /// The latest last.
    blocks: Mutex<VecDeque<(u64, Arc<Block>)>>,
}

/// How many frames a file has.
///
/// # Errors
/// When it cannot be read, or has none.
pub(super) fn count(path: &Path, text: &dyn Text) -> Result<u64, ImportError> {
    Ok(index_of(path, text)?.frames.len() as u64)
}

/// Opens a frame: the first one, unless told which.
///
/// # Errors
/// When the file cannot be read, or has no such frame, or that is damaged or empty.
pub(super) fn open(
    path: &Path,
    text: &dyn Text,
    step: Option<u64>,
    method: ReadMethod,
) -> Result<Box<dyn Source>, ImportError> {
    let index = index_of(path, text)?;
    let last = index.frames.len().saturating_sub(1);
    let number = step.map_or(Some(0), |step| usize::try_from(step).ok()).filter(|number| *number <= last);
    let Some((number, frame)) = number.and_then(|number| Some((number, index.frames.get(number)?))) else {
        let expected = format!("a frame from 0 to {last}");
        return Err(ImportError::malformed(path, "frame", step.unwrap_or(0), expected));
    };
    let frame = frame.as_ref().map_err(|damage| damage.error(path, number))?.clone();
    if frame.count == 0 {
        return Err(ImportError::NoParticles { path: path.into(), field: format!("frame {number}: rows") });
    }
    let file = match &index.unpacked {
        Some(unpacked) => {
            let unpacked = unpacked.try_clone().map_err(|error| ImportError::io(path, "unpacked text", error))?;
            RangeFile::of(path, unpacked, method)?
        }
        None => RangeFile::open(path, method)?,
    };
    Ok(Box::new(FrameSource::new(path, text, file, index, number, frame, step.is_some())))
}

impl FrameSource {
    fn new(
        path: &Path,
        text: &dyn Text,
        file: RangeFile,
        index: Arc<Index>,
        number: usize,
        frame: Frame,
        is_named: bool,
    ) -> FrameSource {
        let steps = index.frames.len();
        let is_one_of_many = steps > 1;
        let end = frame.blocks.last().copied().unwrap_or(frame.start);
        let bytes = if is_one_of_many { end - frame.start } else { index.bytes };
        let named = if is_one_of_many || is_named { step_name(path, number as u64) } else { path.to_owned() };
        let layout = Arc::clone(&frame.layout);
        let kind = index.species.kind;
        let are_elements = layout.label.is_some() && kind == SpeciesKind::Elements;
        let units = layout.units.unwrap_or(if are_elements { ATOMS } else { Units::default() });
        let mut description = Description {
            length_unit: Unit::new(units.length),
            mass_unit: Unit::new(units.mass),
            time: index.time(number),
            steps: steps as u64,
            keeps_rows: text.keeps_rows(),
            notes: notes(&index, &frame, is_named),
            ..Description::unitless(&named, text.name(), bytes)
        };
        let mut corner = [0.0; 3];
        let images = frame.cell.filter(|cell| cell.repeats());
        let images = match index.cells {
            Cells::Cube(edge, own) if !layout.is_unwrapped => {
                (description.box_size, corner) = (Some(edge), own);
                None
            }
            _ => images.filter(|_| !layout.is_unwrapped),
        };
        let (mut fields, mut parts) = (Vec::new(), Vec::new());
        for (field, part) in &layout.fields {
            let mut field = Field { unit: unit_of(field.kind, &units), ..field.clone() };
            let names_kinds = matches!(part, Part::Columns(columns) if columns.first() == layout.label.as_ref());
            let weighs_words = field.kind == FieldKind::Mass && layout.weighs_labels && kind != SpeciesKind::Elements;
            let momentum_of_words =
                matches!(part, Part::Momentum(..)) && layout.weighs_labels && kind != SpeciesKind::Elements;
            if weighs_words || momentum_of_words || (names_kinds && kind == SpeciesKind::Unknown) {
                continue;
            }
            let is_free = |name: &str| layout.fields.iter().all(|(other, _)| other.name != name);
            match kind {
                SpeciesKind::Elements if names_kinds && is_free("atomic-number") => field.name = "atomic-number".into(),
                SpeciesKind::Numbers if names_kinds && is_free("particle-type") => field.name = "particle-type".into(),
                _ => {}
            }
            fields.push(field);
            parts.push(part.clone());
        }
        description.families.push(FamilyInfo { name: FamilyName::Dark, count: frame.count, fields });
        let blocks = Mutex::new(VecDeque::new());
        FrameSource { file, index, number, frame, description, parts, corner, images, blocks }
    }

    /// The rows of a block.
    fn block(&self, number: u64) -> Result<Arc<Block>, ImportError> {
        let known = self.blocks.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, block)) = known.iter().find(|(other, _)| *other == number) {
            return Ok(Arc::clone(block));
        }
        drop(known);
        let block = Arc::new(self.parsed(number)?);
        let mut known = self.blocks.lock().unwrap_or_else(PoisonError::into_inner);
        let mut held: usize = known.iter().map(|(_, block)| block.values.len()).sum();
        while held + block.values.len() > MOST_VALUES
            && let Some((_, oldest)) = known.pop_front()
        {
            held -= oldest.values.len();
        }
        known.push_back((number, Arc::clone(&block)));
        Ok(block)
    }

    fn parsed(&self, number: u64) -> Result<Block, ImportError> {
        let damaged = |damage: Damage| damage.error(&self.file.path, self.number);
        let rows = (self.frame.count - number * BLOCK).min(BLOCK);
        let at = number as usize;
        let (Some(from), Some(to)) = (self.frame.blocks.get(at), self.frame.blocks.get(at + 1)) else {
            return Err(damaged(Damage::new("rows", "no more", format!("{} rows", self.frame.count))));
        };
        // No longer than the part of the file that was looked through.
        let mut text = vec![0; (to - from) as usize];
        self.file.read(*from, &mut text, "rows")?;
        let layout = &self.frame.layout;
        let mut block = Block { values: Vec::with_capacity(rows as usize * layout.words.len()), ids: Vec::new() };
        let mut lines = text.split(|byte| *byte == b'\n');
        for row in 0..rows {
            let line = lines.next().unwrap_or_default();
            row::read(line, layout, &self.index.species, &mut block.values, &mut block.ids).map_err(|damage| {
                let line = self.frame.line + number * BLOCK + row;
                damaged(Damage { field: format!("line {line}: {}", damage.field), ..damage })
            })?;
        }
        Ok(block)
    }

    /// The values of a field for one row.
    fn values(&self, part: &Part, row: &[f64], out: &mut [f64]) {
        let value = |column: usize| row.get(column).copied().unwrap_or(f64::NAN);
        match part {
            Part::Columns(columns) => out.iter_mut().zip(columns).for_each(|(out, column)| *out = value(*column)),
            Part::Id(column) => out.fill(value(*column)),
            // What is no element, such as a site without an atom, weighs 1.
            Part::Weight(column) => out.fill(elements::weight_of(value(*column)).unwrap_or(1.0)),
            Part::Momentum(columns, mass) => {
                let mut by = [1.0];
                self.values(mass, row, &mut by);
                out.iter_mut().zip(columns).for_each(|(out, column)| *out = value(*column) / by[0]);
            }
            Part::Place { columns, is_scaled, images } => {
                let mut place = columns.map(value);
                if let (true, Some(cell)) = (*is_scaled, &self.frame.cell) {
                    place = cell.place(place);
                }
                if let (Some(cell), Some(images)) = (&self.images, images) {
                    place = cell.image(place, images.map(value));
                }
                for ((out, x), corner) in out.iter_mut().zip(place).zip(self.corner) {
                    *out = x - corner;
                }
            }
        }
    }

    /// Calls `each` for every block that holds a part of `range`: the block, its rows, and where they begin in the range.
    fn blocks(&self, range: Range<u64>, mut each: impl FnMut(&Block, Range<usize>, usize)) -> Result<(), ImportError> {
        let mut row = range.start;
        while row < range.end {
            let number = row / BLOCK;
            let first = number * BLOCK;
            let end = range.end.min(first + BLOCK);
            each(&*self.block(number)?, (row - first) as usize..(end - first) as usize, (row - range.start) as usize);
            row = end;
        }
        Ok(())
    }
}

fn unit_of(kind: FieldKind, units: &Units) -> Unit {
    Unit::new(match kind {
        FieldKind::Position | FieldKind::SmoothingLength => units.length,
        FieldKind::Velocity => units.velocity,
        FieldKind::Mass => units.mass,
        _ => "",
    })
}

/// What was assumed of a frame.
fn notes(index: &Index, frame: &Frame, is_named: bool) -> Vec<String> {
    let mut notes = frame.layout.notes.clone();
    notes.extend(first_of(index.frames.len() as u64, is_named));
    notes.extend(index.time_of.note().map(str::to_owned));
    let follows = frame.layout.fields.iter().any(|(_, part)| matches!(part, Part::Place { images: Some(_), .. }));
    notes.extend(match index.cells {
        Cells::Cube(..) | Cells::Other(_) if frame.layout.is_unwrapped => {
            Some("positions are unwrapped, so the periodic cell is left out".into())
        }
        cells => cells.note(follows),
    });
    if frame.layout.label.is_some() {
        notes.extend(index.species.note());
    }
    let damaged = index.frames.iter().enumerate().filter_map(|(number, frame)| Some((number, frame.as_ref().err()?)));
    notes.extend(damaged.take(4).map(|(number, damage)| {
        format!("frame {number} is damaged: {}: found {}, expected {}", damage.field, damage.found, damage.expected)
    }));
    notes
}

impl Source for FrameSource {
    fn description(&self) -> &Description {
        &self.description
    }

    fn read(&self, family: usize, field: usize, range: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        let components = self.description.check_range(family, field, &range, out.len())?.components;
        let Some(part) = self.parts.get(field) else { return Ok(()) };
        let width = self.frame.layout.words.len();
        self.blocks(range, |block, rows, at| {
            let rows = block.values.chunks_exact(width).skip(rows.start).take(rows.len());
            let out = out.chunks_exact_mut(components).skip(at);
            rows.zip(out).for_each(|(row, out)| self.values(part, row, out));
        })
    }

    fn read_ids(&self, family: usize, field: usize, range: Range<u64>, out: &mut [u64]) -> Result<(), ImportError> {
        self.description.check_range(family, field, &range, out.len())?;
        self.blocks(range, |block, rows, at| {
            let ids = block.ids.iter().skip(rows.start).take(rows.len());
            ids.zip(out.iter_mut().skip(at)).for_each(|(id, out)| *out = *id);
        })
    }
}
