//! What a source holds, with statistics of every field: the content of `info --json`.

use super::check::{LeftOut, Survey, chunks};
use super::choice::Chosen;
use super::{Description, FamilyInfo, Field, ImportError, Smoothing, Source};
use crate::model::{Bounds, FamilyName, Skipped};
use rayon::prelude::*;
use serde::Serialize;
use std::ops::Range;
use std::path::Path;

/// A number for a scalar field, one for each component of a vector field.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Statistic {
    /// Of a scalar field.
    Scalar(f64),
    /// Of a field with several components.
    Vector(Vec<f64>),
}

/// Statistics of one field over all its finite values.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FieldSummary {
    /// The field.
    #[serde(flatten)]
    pub about: Field,
    /// Smallest value.
    pub min: Statistic,
    /// Largest value.
    pub max: Statistic,
    /// Mean, summed in double precision.
    pub mean: Statistic,
    /// How many values are not finite.
    pub non_finite: u64,
}

/// One family of a source.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FamilySummary {
    /// Which family.
    pub name: FamilyName,
    /// Number of particles in the source.
    pub count: u64,
    /// Sum of the positive masses, or the count where the source has no masses.
    pub mass: f64,
    /// The box around the finite positions; absent if there is none.
    pub bounds: Option<Bounds>,
    /// Every field.
    pub fields: Vec<FieldSummary>,
}

/// Everything that `info --json` says about a source.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// What the data is: `particles`.
    pub kind: &'static str,
    /// What the source says about itself; the notes also say what a load assumes, converts or estimates.
    #[serde(flatten)]
    pub about: Description,
    /// Number of particles in the source, all families.
    pub particles: u64,
    /// The families that hold particles.
    pub families: Vec<FamilySummary>,
    /// The box around all finite positions; absent if there is none.
    pub bounds: Option<Bounds>,
    /// Particles that [`super::load`] leaves out, by reason.
    pub skipped: Vec<Skipped>,
}

/// Opens the source at `path` and reads every field once, in bounded chunks.
///
/// # Errors
/// [`ImportError`] when the source cannot be opened or read.
pub fn summarize(path: &Path) -> Result<Summary, ImportError> {
    summarize_source(super::open(path)?.as_ref())
}

/// [`summarize`] of an opened source.
///
/// # Errors
/// [`ImportError`] when the source cannot be read.
pub fn summarize_source(source: &dyn Source) -> Result<Summary, ImportError> {
    let mut about = source.description().clone();
    let mut families = Vec::with_capacity(about.families.len());
    let mut left_out = LeftOut::default();
    for (index, info) in source.description().families.iter().enumerate() {
        let chosen = Chosen::of(source, index, &Smoothing::Auto)?;
        let survey = Survey::of(source, index, info, &chosen)?;
        left_out.add(&survey.left_out);
        families.push(summarize_family(source, index, info, &survey)?);
        about.notes.extend(chosen.notes);
    }
    let bounds = families.iter().filter_map(|family| family.bounds).reduce(Bounds::union);
    Ok(Summary {
        kind: "particles",
        particles: about.particles(),
        about,
        families,
        bounds,
        skipped: left_out.into_skipped(),
    })
}

/// Running statistics of the finite values of one component.
#[derive(Clone, Copy)]
struct Running {
    min: f64,
    max: f64,
    sum: f64,
    count: u64,
}

impl Running {
    const NOTHING: Running = Running { min: f64::INFINITY, max: f64::NEG_INFINITY, sum: 0.0, count: 0 };

    /// The same with one component of further values.
    fn with(self, values: &[f64], component: usize, components: usize) -> Running {
        let column = values[component..].iter().step_by(components).copied().filter(|value| value.is_finite());
        column.fold(self, |running, value| Running {
            min: running.min.min(value),
            max: running.max.max(value),
            sum: running.sum + value,
            count: running.count + 1,
        })
    }

    fn and(self, other: Running) -> Running {
        Running {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
            sum: self.sum + other.sum,
            count: self.count + other.count,
        }
    }
}

/// Statistics of fields, of their components one behind the other: the chunks are read in parallel and added up in order, so that sums do not
/// depend on the number of threads, nor on what of a chunk is read together.
fn running(
    source: &dyn Source,
    family: usize,
    info: &FamilyInfo,
    fields: Range<usize>,
) -> Result<Vec<Running>, ImportError> {
    let nothing = vec![Running::NOTHING; info.fields[fields.clone()].iter().map(|field| field.components).sum()];
    let of_range = |buffer: &mut Vec<f64>, range: &Range<u64>| -> Result<Vec<Running>, ImportError> {
        let mut all = nothing.clone();
        let mut at = range.start;
        while at < range.end {
            let end = source.at_hand_until(family, at).map_or(range.end, |end| end.clamp(at + 1, range.end));
            let mut sums = all.iter_mut();
            for field in fields.clone() {
                let components = info.fields[field].components;
                buffer.resize((end - at) as usize * components, 0.0);
                source.read(family, field, at..end, buffer)?;
                for (component, sum) in sums.by_ref().take(components).enumerate() {
                    *sum = sum.with(buffer, component, components);
                }
            }
            at = end;
        }
        Ok(all)
    };
    let mut all = nothing.clone();
    for some in chunks(info.count).chunks(CHUNKS) {
        let read: Result<Vec<Vec<Running>>, ImportError> = some.par_iter().map_init(Vec::new, of_range).collect();
        for chunk in read? {
            all.iter_mut().zip(chunk).for_each(|(sum, of_chunk)| *sum = sum.and(of_chunk));
        }
    }
    Ok(all)
}

/// Chunks of which statistics are held before they are added up.
const CHUNKS: usize = 1024;

fn statistic(running: &[Running], value: impl Fn(&Running) -> f64) -> Statistic {
    match running {
        [one] => Statistic::Scalar(value(one)),
        several => Statistic::Vector(several.iter().map(value).collect()),
    }
}

fn summarize_family(
    source: &dyn Source,
    index: usize,
    info: &FamilyInfo,
    survey: &Survey,
) -> Result<FamilySummary, ImportError> {
    let numbers = 0..info.fields.len();
    let at_once = if source.at_hand_until(index, 0).is_some() { numbers.len().max(1) } else { 1 };
    let mut all = Vec::new();
    for first in numbers.clone().step_by(at_once) {
        all.extend(running(source, index, info, first..numbers.end.min(first + at_once))?);
    }
    let mut rest = all.as_slice();
    let mut fields = Vec::with_capacity(info.fields.len());
    for field in &info.fields {
        let (running, others) = rest.split_at(field.components);
        rest = others;
        let values: u64 = running.iter().map(|component| component.count).sum();
        fields.push(FieldSummary {
            about: field.clone(),
            min: statistic(running, |component| component.min),
            max: statistic(running, |component| component.max),
            mean: statistic(running, |component| component.sum / component.count as f64),
            non_finite: info.count * field.components as u64 - values,
        });
    }
    let bounds = (!survey.bounds.is_empty()).then_some(survey.bounds);
    Ok(FamilySummary { name: info.name, count: info.count, mass: survey.mass, bounds, fields })
}
