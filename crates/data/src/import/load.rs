//! From an opened source to particles in memory.

use super::attributes;
use super::choice::replaced_densities;
use super::derived;
use super::neighbours::{Moving, Neighbours};
use super::stream::{SourceStream, streams};
use super::{Description, ImportError, Source};
use crate::model::{
    Attribute, Bounds, Chunk, Dataset, Derivation, DerivedQuantity, Family, FamilyName, Kernel, ParticleStream,
    Progress, Provenance,
};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::str::FromStr;

/// Where smoothing lengths come from.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Smoothing {
    /// The source's own where it has them, else the distance to the [`DEFAULT_NEIGHBOURS`]th nearest neighbour.
    #[default]
    Auto,
    /// The field of that name; an error where a family lacks it.
    Field(String),
    /// The distance to the K-th nearest neighbour of the same family.
    Knn(usize),
}

impl FromStr for Smoothing {
    type Err = String;

    fn from_str(text: &str) -> Result<Smoothing, String> {
        match text.split_once(':') {
            None if text == "auto" => Ok(Smoothing::Auto),
            Some(("field", name)) if !name.is_empty() => Ok(Smoothing::Field(name.to_owned())),
            Some(("knn", k)) => match k.parse() {
                Ok(k @ 1..=4096) => Ok(Smoothing::Knn(k)),
                _ => Err("expected a number of neighbours from 1 to 4096, such as knn:32".into()),
            },
            _ => Err("expected auto, field:NAME or knn:K".into()),
        }
    }
}

/// Neighbours that an estimated smoothing length reaches to.
pub const DEFAULT_NEIGHBOURS: usize = 32;

/// Which scalar attributes to load beside mass, smoothing length and density.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AttributeChoice {
    /// The ones that colour a picture by default: velocity dispersion, temperature, internal energy, magnitude, colour
    /// index; the speed where a family has none of them.
    #[default]
    Usual,
    /// Every scalar field, and the speed.
    All,
    /// The ones named, by standard name or the source's own; `speed` and `velocity-x`, `-y`, `-z` come from the
    /// velocity, `NAME-x` and so on from any other field with three components.
    Named(Vec<String>),
}

/// What [`super::load`] keeps. The number of threads is that of the rayon pool it is called in.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoadOptions {
    /// Only these families; all when empty.
    pub families: Vec<FamilyName>,
    /// Which attributes.
    pub attributes: AttributeChoice,
    /// Attributes that are left out all the same.
    pub without: Vec<String>,
    /// Where smoothing lengths come from.
    pub smoothing: Smoothing,
    /// What is derived from velocities, as further attributes before those that are chosen; it takes the place of the source's own of the
    /// same name. A family that lacks what it takes goes without.
    pub derive: Vec<DerivedQuantity>,
}

/// Opens the source at `path` and brings the chosen families and attributes into memory.
///
/// Particles with a non-finite position, or a mass or smoothing length that is not positive, are left out and counted.
/// Where a source has no masses, or none that is positive, each particle gets mass 1; where it has no smoothing lengths,
/// or none that is positive, they are estimated; densities that are missing or not positive are summed up from mass and
/// smoothing length with the cubic spline. Each of these is noted in the provenance.
///
/// # Errors
/// [`ImportError`] when the source cannot be opened or read, lacks a family or attribute that was asked for, or has no
/// particle that can be drawn.
pub fn load(path: &Path, options: &LoadOptions, progress: &dyn Progress) -> Result<Dataset, ImportError> {
    load_source(super::open(path)?.as_ref(), options, progress)
}

/// [`load`] of an opened source.
///
/// # Errors
/// As [`load`].
pub fn load_source(
    source: &dyn Source,
    options: &LoadOptions,
    progress: &dyn Progress,
) -> Result<Dataset, ImportError> {
    let streams = streams(source, options, &|names| (0..names.len()).collect())?;
    let mut about = streams.about;
    let mut families = Vec::new();
    for stream in &streams.families {
        let kernel = about.kernel;
        let family = complete(stream, gather(stream, progress)?, kernel, &mut about.provenance.notes, progress);
        if !family.is_empty() {
            families.push(family);
        }
    }
    if families.is_empty() {
        let field = "particles that can be drawn".into();
        return Err(ImportError::NoParticles { path: about.provenance.path, field });
    }
    Ok(Dataset { families, skipped: SourceStream::skipped(&streams.families), ..about })
}

/// What a source says of all its particles.
pub(super) fn about_dataset(about: &Description, notes: Vec<String>) -> Dataset {
    Dataset {
        families: Vec::new(),
        length_unit: about.length_unit.clone(),
        mass_unit: about.mass_unit.clone(),
        kernel: about.kernel,
        skipped: Vec::new(),
        provenance: Provenance {
            path: about.path.clone(),
            format: about.format.clone(),
            bytes: about.bytes,
            time: about.time,
            redshift: about.redshift,
            box_size: about.box_size,
            notes,
        },
    }
}

/// Every family and attribute that was asked for by name is there.
pub(super) fn check_families(about: &Description, options: &LoadOptions) -> Result<(), ImportError> {
    for wanted in &options.families {
        if !about.families.iter().any(|family| family.name == *wanted) {
            let names: Vec<&str> = about.families.iter().map(|family| family.name.as_str()).collect();
            let expected = format!("one of {}", names.join(", "));
            return Err(ImportError::missing(&about.path, format!("family {wanted}"), expected));
        }
    }
    if let AttributeChoice::Named(names) = &options.attributes {
        let is_derived = |name: &&String| options.derive.iter().any(|quantity| quantity.name() == name.as_str());
        for name in names.iter().filter(|name| !is_derived(name)) {
            if about.families.iter().all(|info| attributes::named(about, info, name).is_none()) {
                let expected =
                    format!("one of {}", attributes::available(about).into_iter().collect::<Vec<_>>().join(", "));
                return Err(ImportError::missing(&about.path, format!("attribute {name}"), expected));
            }
        }
    }
    Ok(())
}

/// All chunks of a family as one, in their order.
fn gather(stream: &SourceStream, progress: &dyn Progress) -> Result<Chunk, ImportError> {
    progress.begin(&format!("reading {}", stream.family()), stream.chunks() as u64);
    let most = stream.particles() as usize;
    let mut all = Chunk {
        positions: Vec::with_capacity(most),
        mass: Vec::with_capacity(most),
        density: Vec::with_capacity(most),
        smoothing_length: Vec::with_capacity(most),
        attributes: (0..stream.columns()).map(|_| Vec::with_capacity(most)).collect(),
    };
    let numbers: Vec<usize> = (0..stream.chunks()).collect();
    for some in numbers.chunks(CHUNKS_PER_THREAD * rayon::current_num_threads()) {
        let read = |&number: &usize| {
            let mut chunk = Chunk::default();
            stream.chunk(number, &mut chunk)?;
            progress.advance(1);
            Ok(chunk)
        };
        let chunks: Vec<Chunk> = some.par_iter().map(read).collect::<Result<_, ImportError>>()?;
        for chunk in chunks {
            all.positions.extend(chunk.positions);
            all.mass.extend(chunk.mass);
            all.density.extend(chunk.density);
            all.smoothing_length.extend(chunk.smoothing_length);
            all.attributes.iter_mut().zip(chunk.attributes).for_each(|(all, values)| all.extend(values));
        }
    }
    Ok(all)
}

/// Chunks that a thread reads before they are put together, so that few are held twice.
const CHUNKS_PER_THREAD: usize = 8;

/// Fills in smoothing lengths and densities that the source lacks; everything it returns is positive and finite.
fn complete(
    stream: &SourceStream,
    particles: Chunk,
    kernel: Kernel,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Family {
    let name = stream.family();
    let Chunk { positions, mass, mut density, smoothing_length: mut lengths, mut attributes } = particles;
    let count = positions.len();
    let lacking = density.iter().filter(|rho| rho.is_nan()).count();
    if lacking > 0 && lacking < count {
        notes.push(replaced_densities(name, lacking as u64));
    }
    let replace = |density: &mut [f32], estimates: &mut dyn Iterator<Item = f64>| {
        density.iter_mut().zip(estimates).filter(|(rho, _)| rho.is_nan()).for_each(|(rho, sum)| *rho = positive(sum));
    };
    let edge = stream.periodic_edge(Bounds::of(positions.iter().copied()));
    if stream.chosen.smoothing_length.is_none() {
        progress.begin(&format!("neighbours of {name}"), count as u64);
        let estimates = Neighbours::of(&positions, edge, progress)
            .map_or_else(Vec::new, |tree| tree.estimate(stream.chosen.neighbours, &mass, None, progress));
        lengths = estimates.iter().map(|estimate| positive(estimate.smoothing_length)).collect();
        replace(&mut density, &mut estimates.iter().map(|estimate| estimate.density));
    } else if lacking > 0 {
        progress.begin(&format!("density of {name}"), count as u64);
        let sums = Neighbours::of(&positions, edge, progress)
            .map_or_else(Vec::new, |tree| tree.density(&lengths, &mass, None, progress));
        replace(&mut density, &mut sums.into_iter());
    }
    let inputs = attributes.split_off(stream.attributes().len());
    let mut named = Vec::new();
    if let Some(derivation) = stream.derivation() {
        progress.begin(&format!("motion in {name}"), count as u64);
        let velocities = derived::velocities(&inputs);
        let heat = inputs.get(Derivation::COMPONENTS).map(Vec::as_slice);
        let all = Moving {
            positions: &positions,
            mass: &mass,
            density: &density,
            smoothing_length: &lengths,
            velocities: &velocities,
            edge,
        };
        let columns = derived::columns(derivation, kernel, &all, (count, heat), progress);
        named.extend(derivation.attributes().zip(columns));
    }
    named.extend(stream.attributes().iter().cloned().zip(attributes));
    let attributes = named.into_iter().map(|((name, unit), values)| Attribute { name, unit, values });
    Family { name, positions, mass, smoothing_length: lengths, density, attributes: attributes.collect() }
}

/// The nearest positive finite `f32`.
fn positive(value: f64) -> f32 {
    (value as f32).clamp(f32::MIN_POSITIVE, f32::MAX)
}
