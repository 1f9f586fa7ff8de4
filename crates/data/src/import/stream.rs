//! An opened source as streams of particles, for builds of what does not fit in memory.

use super::attributes::{self, Planned};
use super::check::{CHUNK_LENGTH, Flaws, LeftOut, chunks, drawable};
use super::choice::Chosen;
use super::derived;
use super::load::{about_dataset, check_families};
use super::{AttributeChoice, FamilyInfo, FieldKind, ImportError, LoadOptions, Source};
use crate::model::{Chunk, Dataset, Derivation, FamilyName, Kernel, ParticleStream, Skipped, StreamError, Unit};
use std::cell::RefCell;
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// The families of a source as streams.
pub struct Streams<'a> {
    /// All that is known of the source; without families, and without what is left out.
    pub about: Dataset,
    /// The families.
    pub families: Vec<SourceStream<'a>>,
}

/// The streams of the chosen families, with those of the attributes that `choose` names by index, of their names as the options have them.
///
/// # Errors
/// When the source cannot be read, or lacks a family or attribute that was asked for.
pub fn streams<'a>(
    source: &'a dyn Source,
    options: &LoadOptions,
    choose: &dyn Fn(&[&str]) -> Vec<usize>,
) -> Result<Streams<'a>, ImportError> {
    let about = source.description();
    check_families(about, options)?;
    let mut notes = about.notes.clone();
    let mut families = Vec::new();
    for (index, info) in about.families.iter().enumerate() {
        if !options.families.is_empty() && !options.families.contains(&info.name) {
            continue;
        }
        let chosen = Chosen::of(source, index, &options.smoothing)?;
        notes.extend(chosen.notes.iter().cloned());
        let derived = derived::plan(about, info, options)?;
        let mut planned = attributes::plan(about, info, options);
        let mut derivation = None;
        let mut inputs = Vec::new();
        if let Some(derived) = derived {
            let is_derived =
                |name: &str| derived.derivation.quantities.iter().any(|(quantity, _)| quantity.name() == name);
            planned.retain(|planned| !is_derived(&planned.name));
            notes.extend(derived.notes);
            inputs = derived.inputs;
            derivation = Some(derived.derivation);
        }
        let names: Vec<&str> = planned.iter().map(|planned| planned.asked.as_str()).collect();
        let mut planned: Vec<Planned> = choose(&names).into_iter().map(|index| planned[index].clone()).collect();
        if matches!(options.attributes, AttributeChoice::Named(_)) {
            planned.iter().try_for_each(|planned| attributes::check_precision(source, index, info, planned))?;
        }
        let attributes = planned.iter().map(|planned| (planned.name.clone(), planned.unit.clone())).collect();
        planned.extend(inputs);
        let fields = planned.iter().map(|planned| planned.field).chain(chosen.smoothing_length);
        source.announce(index, &fields.collect::<Vec<usize>>());
        families.push(SourceStream {
            source,
            family: index,
            info,
            chosen,
            attributes,
            planned,
            derivation,
            counted: chunks(info.count).iter().map(|_| AtomicBool::new(false)).collect(),
            left_out: Mutex::new(LeftOut::default()),
        });
    }
    notes.extend(derived::check(about, options, families.iter().filter_map(|family| family.derivation.as_ref()))?);
    Ok(Streams { about: about_dataset(about, notes), families })
}

/// A run of particles, who they are and how they move.
#[derive(Clone, Debug, Default)]
pub struct StateChunk {
    /// What every stream gives.
    pub chunk: Chunk,
    /// Their ids.
    pub ids: Vec<u64>,
    /// Their velocities, as the source has them.
    pub velocities: Vec<[f64; 3]>,
}

/// One family of a source. Particles that cannot be drawn are left out, by the rule of [`super::load`].
pub struct SourceStream<'a> {
    source: &'a dyn Source,
    family: usize,
    info: &'a FamilyInfo,
    pub(super) chosen: Chosen,
    /// Where attributes come from, and then the columns that the derivation takes.
    planned: Vec<Planned>,
    attributes: Vec<(String, Unit)>,
    derivation: Option<Derivation>,
    /// Chunks that have been read once, so that what is left out is counted once.
    counted: Vec<AtomicBool>,
    left_out: Mutex<LeftOut>,
}

impl SourceStream<'_> {
    /// What was left out of the chunks read so far.
    pub fn skipped(streams: &[SourceStream]) -> Vec<Skipped> {
        LeftOut::sum(streams.iter().map(SourceStream::left_out)).into_skipped()
    }

    /// How many particles were left out of the chunks read so far, by reason.
    pub fn left_out(&self) -> LeftOut {
        *self.left_out.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Whether smoothing lengths or densities are to be estimated, for all particles or for some.
    pub fn is_lacking(&self) -> bool {
        self.chosen.smoothing_length.is_none() || self.chosen.density.is_none()
    }

    /// The source's kernel.
    pub fn kernel(&self) -> Kernel {
        self.source.description().kernel
    }

    /// Unit of velocities; `None` where there are none.
    pub fn velocity_unit(&self) -> Option<&Unit> {
        self.info.find(FieldKind::Velocity).map(|field| &self.info.fields[field].unit)
    }

    /// Reads a chunk with who its particles are and how they move. Without velocities they are `NaN`; where `by_row`, ids are the
    /// particles' rows in the source.
    ///
    /// # Errors
    /// When the source cannot be read, or has no ids where they are asked for.
    pub fn read_states(&self, number: usize, by_row: bool, into: &mut StateChunk) -> Result<(), ImportError> {
        let keep = self.chunk(number, &mut into.chunk)?;
        let range = self.range(number);
        let len = (range.end - range.start) as usize;
        into.ids.clear();
        if by_row {
            into.ids.extend(range.clone());
        } else {
            let field = self.info.find(FieldKind::Id).ok_or_else(|| {
                let about = self.source.description();
                ImportError::missing(&about.path, format!("{}: ids", self.info.name), "ids")
            })?;
            into.ids.resize(len, 0);
            self.source.read_ids(self.family, field, range.clone(), &mut into.ids)?;
        }
        into.velocities.clear();
        into.velocities.resize(len, [f64::NAN; 3]);
        if let Some(field) = self.info.find(FieldKind::Velocity) {
            self.source.read(self.family, field, range, into.velocities.as_flattened_mut())?;
        }
        if let Some(keep) = keep {
            let mut flags = keep.iter();
            into.ids.retain(|_| flags.next().copied().unwrap_or(false));
            let mut flags = keep.iter();
            into.velocities.retain(|_| flags.next().copied().unwrap_or(false));
        }
        Ok(())
    }

    /// The rows of a chunk.
    fn range(&self, number: usize) -> Range<u64> {
        let start = (number * CHUNK_LENGTH) as u64;
        start..self.info.count.min(start + CHUNK_LENGTH as u64)
    }

    /// Reads a chunk as [`ParticleStream::read`] does; says which rows were kept, `None` where all were.
    ///
    /// # Errors
    /// When the source cannot be read.
    pub(super) fn chunk(&self, number: usize, into: &mut Chunk) -> Result<Option<Vec<bool>>, ImportError> {
        let range = self.range(number);
        let len = (range.end - range.start) as usize;
        into.positions.resize(len, [0.0; 3]);
        self.source.read(self.family, self.chosen.position, range.clone(), into.positions.as_flattened_mut())?;
        let scalar = attributes::Part::Component(0);
        let optional = |field: Option<usize>, otherwise: f32, out: &mut Vec<f32>| match field {
            Some(field) => self.column(field, scalar, &range, out),
            None => {
                out.clear();
                out.resize(len, otherwise);
                Ok(())
            }
        };
        optional(self.chosen.mass, 1.0, &mut into.mass)?;
        optional(self.chosen.smoothing_length, f32::NAN, &mut into.smoothing_length)?;
        optional(self.chosen.density, f32::NAN, &mut into.density)?;
        let has_smoothing_length = self.chosen.smoothing_length.is_some();
        into.attributes.resize_with(self.planned.len(), Vec::new);
        for (planned, out) in self.planned.iter().zip(&mut into.attributes) {
            self.column(planned.field, planned.part, &range, out)?;
        }
        let flaws = |i: usize| {
            Flaws::of(into.positions[i], Some(into.mass[i]), has_smoothing_length.then(|| into.smoothing_length[i]))
        };
        let keep: Vec<bool> = (0..len).map(|i| flaws(i).none()).collect();
        let first = !self.counted[number].swap(true, Ordering::Relaxed);
        let all = !keep.contains(&false);
        if !all {
            if first {
                let mut left_out = self.left_out.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
                (0..len).for_each(|i| left_out.count(flaws(i)));
            }
            let mut flags = keep.iter();
            into.positions.retain(|_| flags.next().copied().unwrap_or(false));
            let columns = [&mut into.mass, &mut into.smoothing_length, &mut into.density];
            for column in columns.into_iter().chain(&mut into.attributes) {
                let mut flags = keep.iter();
                column.retain(|_| flags.next().copied().unwrap_or(false));
            }
        }
        into.density.iter_mut().filter(|rho| !drawable(**rho)).for_each(|rho| *rho = f32::NAN);
        Ok((!all).then_some(keep))
    }

    fn column(
        &self,
        field: usize,
        part: attributes::Part,
        range: &Range<u64>,
        out: &mut Vec<f32>,
    ) -> Result<(), ImportError> {
        let components = self.info.fields[field].components;
        // Taken, not borrowed: reading may let other work run on this thread.
        let mut buffer = BUFFER.take();
        buffer.resize((range.end - range.start) as usize * components, 0.0);
        self.source.read(self.family, field, range.clone(), &mut buffer)?;
        out.clear();
        out.extend(buffer.chunks_exact(components).map(|values| part.of(values)));
        BUFFER.set(buffer);
        Ok(())
    }
}

thread_local! {
    /// Values on their way from the source, one buffer per thread.
    static BUFFER: RefCell<Vec<f64>> = const { RefCell::new(Vec::new()) };
}

impl ParticleStream for SourceStream<'_> {
    fn family(&self) -> FamilyName {
        self.info.name
    }

    fn attributes(&self) -> &[(String, Unit)] {
        &self.attributes
    }

    fn particles(&self) -> u64 {
        self.info.count
    }

    fn chunks(&self) -> usize {
        self.counted.len()
    }

    fn neighbours(&self) -> Option<usize> {
        Some(self.chosen.neighbours)
    }

    fn box_size(&self) -> Option<f64> {
        self.source.description().box_size
    }

    fn derivation(&self) -> Option<&Derivation> {
        self.derivation.as_ref()
    }

    fn read(&self, number: usize, into: &mut Chunk) -> Result<(), StreamError> {
        self.chunk(number, into)?;
        Ok(())
    }
}
