//! From an opened source to particles in memory.

use super::attributes;
use super::check::{CHUNK_LENGTH, Flaws, LeftOut, chunks};
use super::neighbours::Neighbours;
use super::{Description, FamilyInfo, FieldKind, ImportError, Source};
use crate::model::{Attribute, Dataset, Family, FamilyName, Progress, Provenance};
use rayon::prelude::*;
use std::path::Path;

/// Where smoothing lengths come from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Smoothing {
    /// The source's own where it has them, else the distance to the [`DEFAULT_NEIGHBOURS`]th nearest neighbour.
    #[default]
    Auto,
    /// The field of that name; an error where a family lacks it.
    Field(String),
    /// The distance to the K-th nearest neighbour of the same family.
    Knn(usize),
}

/// Neighbours that an estimated smoothing length reaches to.
pub const DEFAULT_NEIGHBOURS: usize = 32;

/// Which scalar attributes to load beside mass, smoothing length and density.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
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
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LoadOptions {
    /// Only these families; all when empty.
    pub families: Vec<FamilyName>,
    /// Which attributes.
    pub attributes: AttributeChoice,
    /// Where smoothing lengths come from.
    pub smoothing: Smoothing,
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
    let about = source.description();
    check_families(about, options)?;
    let mut notes = about.notes.clone();
    let mut left_out = LeftOut::default();
    let mut families = Vec::new();
    for (index, info) in about.families.iter().enumerate() {
        if options.families.is_empty() || options.families.contains(&info.name) {
            let plan = attributes::plan(about, info, &options.attributes);
            let loader = FamilyLoader { source, about, family: index, info, progress };
            let loaded = loader.load(&plan, &options.smoothing, &mut notes, &mut left_out)?;
            if !loaded.is_empty() {
                families.push(loaded);
            }
        }
    }
    if families.is_empty() {
        return Err(ImportError::NoParticles { path: about.path.clone(), field: "particles that can be drawn".into() });
    }
    Ok(Dataset { families, skipped: left_out.into_skipped(), ..about_dataset(about, notes) })
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
        for name in names {
            if about.families.iter().all(|info| attributes::named(about, info, name).is_none()) {
                let expected = format!("one of {}", attributes::available(about).join(", "));
                return Err(ImportError::missing(&about.path, format!("attribute {name}"), expected));
            }
        }
    }
    Ok(())
}

/// The field that [`Smoothing::Field`] names: scalar, of this family.
pub(super) fn smoothing_field(about: &Description, info: &FamilyInfo, name: &str) -> Result<usize, ImportError> {
    let scalar = |index: &usize| info.fields[*index].components == 1;
    info.named(name).filter(scalar).ok_or_else(|| {
        let fields = info.fields.iter().filter(|field| field.components == 1);
        let names: Vec<&str> = fields.map(|field| field.name.as_str()).collect();
        let expected = format!("a scalar field of {}: {}", info.name, names.join(", "));
        ImportError::missing(&about.path, format!("smoothing length {name}"), expected)
    })
}

/// Loads one family.
struct FamilyLoader<'a> {
    source: &'a dyn Source,
    about: &'a Description,
    family: usize,
    info: &'a FamilyInfo,
    progress: &'a dyn Progress,
}

impl FamilyLoader<'_> {
    fn load(
        &self,
        plan: &[attributes::Planned],
        smoothing: &Smoothing,
        notes: &mut Vec<String>,
        left_out: &mut LeftOut,
    ) -> Result<Family, ImportError> {
        let name = self.info.name;
        let columns = 3 + plan.len() as u64;
        self.progress.begin(&format!("reading {name}"), self.info.count.saturating_mul(columns));
        let mut positions = self.positions()?;
        let mut mass = self.optional(self.info.find(FieldKind::Mass))?;
        if mass.as_ref().is_none_or(|mass| !mass.iter().any(|m| *m > 0.0)) {
            notes.push(format!("{name}: no masses, each particle counts 1"));
            mass = None;
        }
        let wanted = match smoothing {
            Smoothing::Auto => self.info.find(FieldKind::SmoothingLength),
            Smoothing::Knn(_) => None,
            Smoothing::Field(field) => Some(smoothing_field(self.about, self.info, field)?),
        };
        let mut lengths = self.optional(wanted)?;
        if lengths.as_ref().is_some_and(|lengths| !lengths.iter().any(|h| *h > 0.0)) {
            notes.push(format!("{name}: no smoothing length is positive, so they are estimated"));
            lengths = None;
        }
        let mut density = self.optional(self.info.find(FieldKind::Density))?;
        let mut attributes = Vec::with_capacity(plan.len());
        for planned in plan {
            let values = self.column(planned.field, planned.part)?;
            attributes.push(Attribute { name: planned.name.clone(), unit: planned.unit.clone(), values });
        }

        let flaws = |index: usize| {
            let at = |column: &Option<Vec<f32>>| column.as_ref().map(|column| column[index]);
            Flaws::of(positions[index], at(&mass), at(&lengths))
        };
        let keep: Vec<bool> = (0..positions.len()).into_par_iter().map(|index| flaws(index).none()).collect();
        if keep.contains(&false) {
            (0..positions.len()).for_each(|index| left_out.count(flaws(index), 1));
            retain(&mut positions, &keep);
            let scalars = attributes.iter_mut().map(|attribute| &mut attribute.values);
            for column in [&mut mass, &mut lengths, &mut density].into_iter().flatten().chain(scalars) {
                retain(column, &keep);
            }
        }
        let mass = mass.unwrap_or_else(|| vec![1.0; positions.len()]);
        let neighbours = match smoothing {
            Smoothing::Knn(k) => *k,
            _ => DEFAULT_NEIGHBOURS,
        };
        let (smoothing_length, density) =
            complete(name, &positions, &mass, lengths, density, neighbours, notes, self.progress);
        Ok(Family { name, positions, mass, smoothing_length, density, attributes })
    }

    fn positions(&self) -> Result<Vec<[f64; 3]>, ImportError> {
        let Some(field) = self.info.find(FieldKind::Position) else {
            let field = format!("positions of {}", self.info.name);
            return Err(ImportError::missing(&self.about.path, field, "coordinates"));
        };
        let mut positions = vec![[0.0; 3]; self.info.count as usize];
        positions.par_chunks_mut(CHUNK_LENGTH).zip(chunks(self.info.count)).try_for_each(|(part, range)| {
            self.source.read(self.family, field, range, part.as_flattened_mut())?;
            self.progress.advance(part.len() as u64);
            Ok(())
        })?;
        Ok(positions)
    }

    fn optional(&self, field: Option<usize>) -> Result<Option<Vec<f32>>, ImportError> {
        field.map(|field| self.column(field, attributes::Part::Component(0))).transpose()
    }

    fn column(&self, field: usize, part: attributes::Part) -> Result<Vec<f32>, ImportError> {
        let components = self.info.fields[field].components;
        let mut column = vec![0.0f32; self.info.count as usize];
        column.par_chunks_mut(CHUNK_LENGTH).zip(chunks(self.info.count)).try_for_each_init(
            Vec::new,
            |buffer, (column, range)| {
                buffer.resize(column.len() * components, 0.0);
                self.source.read(self.family, field, range, buffer)?;
                for (value, values) in column.iter_mut().zip(buffer.chunks_exact(components)) {
                    *value = part.of(values);
                }
                self.progress.advance(column.len() as u64);
                Ok(())
            },
        )?;
        Ok(column)
    }
}

/// Keeps the entries whose flag is set.
fn retain<T>(column: &mut Vec<T>, keep: &[bool]) {
    let mut flags = keep.iter();
    column.retain(|_| flags.next().copied().unwrap_or(false));
}

/// Fills in smoothing lengths and densities that the source lacks; everything it returns is positive and finite.
fn complete(
    name: FamilyName,
    positions: &[[f64; 3]],
    mass: &[f32],
    lengths: Option<Vec<f32>>,
    density: Option<Vec<f32>>,
    neighbours: usize,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> (Vec<f32>, Vec<f32>) {
    let usable = |rho: &f32| *rho > 0.0 && rho.is_finite();
    let lacking = density.as_ref().map_or(positions.len(), |rho| rho.iter().filter(|rho| !usable(rho)).count());
    if lacking > 0 && density.is_some() {
        notes.push(format!("{name}: {lacking} densities are not positive and are replaced by estimates"));
    }
    let stated = |density: Option<Vec<f32>>, estimates: Vec<f32>| match density {
        Some(stated) => stated.into_iter().zip(estimates).map(|(a, b)| if usable(&a) { a } else { b }).collect(),
        None => estimates,
    };
    if let Some(lengths) = lengths {
        let density = match density {
            Some(density) if lacking == 0 => density,
            density => {
                notes.extend(density.is_none().then(|| format!("{name}: density from mass and smoothing length")));
                progress.begin(&format!("density of {name}"), positions.len() as u64);
                let tree = Neighbours::of(positions);
                let sums = tree.map_or_else(Vec::new, |tree| tree.density(&lengths, mass, None, progress));
                stated(density, sums.into_iter().map(positive).collect())
            }
        };
        return (lengths, density);
    }
    notes.push(format!("{name}: smoothing length is the distance to neighbour {neighbours}"));
    notes.extend(density.is_none().then(|| format!("{name}: density from mass and that smoothing length")));
    progress.begin(&format!("neighbours of {name}"), positions.len() as u64);
    let tree = Neighbours::of(positions);
    let estimates = tree.map_or_else(Vec::new, |tree| tree.estimate(neighbours, mass, None, progress));
    let lengths = estimates.iter().map(|estimate| positive(estimate.smoothing_length)).collect();
    let sums = estimates.iter().map(|estimate| positive(estimate.density)).collect();
    (lengths, stated(density, sums))
}

/// The nearest positive finite `f32`.
fn positive(value: f64) -> f32 {
    (value as f32).clamp(f32::MIN_POSITIVE, f32::MAX)
}
