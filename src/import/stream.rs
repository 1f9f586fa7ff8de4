//! An opened source as streams of particles, for builds of what does not fit in memory.

use super::attributes::{self, Planned};
use super::check::{CHUNK_LENGTH, Flaws, LeftOut, chunks};
use super::load::{about_dataset, check_families};
use super::{FamilyInfo, FieldKind, ImportError, LoadOptions, Smoothing, Source};
use crate::model::{Chunk, Dataset, FamilyName, ParticleStream, Skipped, StreamError, Unit};
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

/// A density that has to be estimated, which takes all neighbours of a particle: the source must be loaded instead.
#[derive(Clone, Copy, Debug, thiserror::Error)]
#[error("some densities are not positive")]
pub struct DensityLacking;

/// The streams of the chosen families, with those of the attributes that `choose` names by index; `None` where smoothing lengths
/// or densities have to be estimated first, which only [`super::load`] does.
///
/// # Errors
/// When the source cannot be read, or lacks a family or attribute that was asked for.
pub fn streams<'a>(
    source: &'a dyn Source,
    options: &LoadOptions,
    choose: &dyn Fn(&[&str]) -> Vec<usize>,
) -> Result<Option<Streams<'a>>, ImportError> {
    let about = source.description();
    check_families(about, options)?;
    let mut notes = about.notes.clone();
    let mut families = Vec::new();
    for (index, info) in about.families.iter().enumerate() {
        if !options.families.is_empty() && !options.families.contains(&info.name) {
            continue;
        }
        let smoothing_length = match &options.smoothing {
            Smoothing::Auto => info.find(FieldKind::SmoothingLength),
            Smoothing::Field(name) => info.named(name).filter(|&field| info.fields[field].components == 1),
            Smoothing::Knn(_) => None,
        };
        let (Some(position), Some(smoothing_length), Some(density)) =
            (info.find(FieldKind::Position), smoothing_length, info.find(FieldKind::Density))
        else {
            return Ok(None);
        };
        let mass = info.find(FieldKind::Mass).map(|mass| Ok((mass, any_positive(source, index, info, mass)?)));
        let mass = mass.transpose()?.filter(|(_, any)| *any).map(|(mass, _)| mass);
        if mass.is_none() {
            notes.push(format!("{}: no masses, each particle counts 1", info.name));
        }
        if !any_positive(source, index, info, smoothing_length)? {
            return Ok(None);
        }
        let planned = attributes::plan(about, info, &options.attributes);
        let names: Vec<&str> = planned.iter().map(|planned| planned.name.as_str()).collect();
        let planned: Vec<Planned> = choose(&names).into_iter().map(|index| planned[index].clone()).collect();
        families.push(SourceStream {
            source,
            family: index,
            info,
            position,
            mass,
            smoothing_length,
            density,
            attributes: planned.iter().map(|planned| (planned.name.clone(), planned.unit.clone())).collect(),
            planned,
            counted: chunks(info.count).iter().map(|_| AtomicBool::new(false)).collect(),
            left_out: Mutex::new(LeftOut::default()),
        });
    }
    Ok(Some(Streams { about: about_dataset(about, notes), families }))
}

/// Whether a scalar field has a positive value; reads until it finds one.
fn any_positive(source: &dyn Source, family: usize, info: &FamilyInfo, field: usize) -> Result<bool, ImportError> {
    let mut values = Vec::new();
    for range in chunks(info.count) {
        values.resize((range.end - range.start) as usize, 0.0);
        source.read(family, field, range, &mut values)?;
        if values.iter().any(|&value| value as f32 > 0.0) {
            return Ok(true);
        }
    }
    Ok(false)
}

/// One family of a source. Particles that cannot be drawn are left out, by the rule of [`super::load`].
pub struct SourceStream<'a> {
    source: &'a dyn Source,
    family: usize,
    info: &'a FamilyInfo,
    position: usize,
    mass: Option<usize>,
    smoothing_length: usize,
    density: usize,
    planned: Vec<Planned>,
    attributes: Vec<(String, Unit)>,
    /// Chunks that have been read once, so that what is left out is counted once.
    counted: Vec<AtomicBool>,
    left_out: Mutex<LeftOut>,
}

impl SourceStream<'_> {
    /// What was left out of the chunks read so far.
    pub fn skipped(streams: &[SourceStream]) -> Vec<Skipped> {
        let mut all = LeftOut::default();
        for stream in streams {
            all.add(&stream.left_out.lock().unwrap_or_else(|poisoned| poisoned.into_inner()));
        }
        all.into_skipped()
    }

    fn column(
        &self,
        field: usize,
        part: attributes::Part,
        range: &Range<u64>,
        buffer: &mut Vec<f64>,
    ) -> Result<Vec<f32>, ImportError> {
        let components = self.info.fields[field].components;
        buffer.resize((range.end - range.start) as usize * components, 0.0);
        self.source.read(self.family, field, range.clone(), buffer)?;
        Ok(buffer.chunks_exact(components).map(|values| part.of(values)).collect())
    }
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

    fn read(&self, number: usize, into: &mut Chunk) -> Result<(), StreamError> {
        let start = (number * CHUNK_LENGTH) as u64;
        let range = start..self.info.count.min(start + CHUNK_LENGTH as u64);
        let len = (range.end - range.start) as usize;
        let mut buffer = Vec::new();
        let scalar = attributes::Part::Component(0);
        let mut positions = vec![[0.0; 3]; len];
        self.source.read(self.family, self.position, range.clone(), positions.as_flattened_mut())?;
        let mass = self.mass.map(|mass| self.column(mass, scalar, &range, &mut buffer)).transpose()?;
        let smoothing_length = self.column(self.smoothing_length, scalar, &range, &mut buffer)?;
        let density = self.column(self.density, scalar, &range, &mut buffer)?;
        let attributes =
            self.planned.iter().map(|planned| self.column(planned.field, planned.part, &range, &mut buffer));
        *into = Chunk {
            positions,
            mass: mass.unwrap_or_else(|| vec![1.0; len]),
            smoothing_length,
            density,
            attributes: attributes.collect::<Result<_, _>>()?,
        };
        let flaws = |i: usize| Flaws::of(into.positions[i], Some(into.mass[i]), Some(into.smoothing_length[i]));
        let keep: Vec<bool> = (0..len).map(|i| flaws(i).none()).collect();
        let first = !self.counted[number].swap(true, Ordering::Relaxed);
        if keep.contains(&false) {
            if first {
                let mut left_out = self.left_out.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
                (0..len).for_each(|i| left_out.count(flaws(i), 1));
            }
            let mut flags = keep.iter();
            into.positions.retain(|_| flags.next().copied().unwrap_or(false));
            let columns = [&mut into.mass, &mut into.smoothing_length, &mut into.density];
            for column in columns.into_iter().chain(&mut into.attributes) {
                let mut flags = keep.iter();
                column.retain(|_| flags.next().copied().unwrap_or(false));
            }
        }
        if into.density.iter().any(|&rho| !(rho > 0.0 && rho.is_finite())) {
            return Err(DensityLacking.into());
        }
        Ok(())
    }
}
