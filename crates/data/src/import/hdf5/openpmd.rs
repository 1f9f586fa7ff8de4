//! Particles of openPMD files (Huebl et al. 2015, the openPMD standard 1.0 and 1.1): iterations, in each species, in each records, whose components
//! are data sets, or groups with one value for all. Values are given in SI.

use super::file::{Attributes, Column, H5, H5Group};
use crate::import::{Description, FamilyInfo, Field, FieldKind, ImportError, Source, step_name};
use crate::model::{FamilyName, Motion, Unit};
use std::ops::Range;

/// The most species, and records of one.
const MOST_SPECIES: usize = 256;
const MOST_RECORDS: usize = 256;

/// Axes of vectors, and units of the seven dimensions of `unitDimension`.
const AXES: [&str; 3] = ["x", "y", "z"];
const DIMENSIONS: [&str; 7] = ["m", "kg", "s", "A", "K", "mol", "cd"];

/// Where iterations are, and particles in them.
struct Places {
    base: String,
    particles: String,
}

impl Places {
    /// Of an openPMD file; `None` of any other, and where it says of no particles.
    fn of(file: &H5) -> Result<Option<Places>, ImportError> {
        // What is damaged there belongs to none of these files for certain.
        let Ok(root) = file.root()?.attributes() else { return Ok(None) };
        if !root.has("openPMD") {
            return Ok(None);
        }
        let trimmed = |text: &str| text.trim_matches(['/', '\0', ' ']).to_owned();
        let base = root.text("basePath").unwrap_or_else(|| "/data/%T/".into());
        let Some(particles) = root.text("particlesPath") else { return Ok(None) };
        let base = base.split_once("%T").map_or(&*base, |(before, _)| before);
        Ok(Some(Places { base: trimmed(base), particles: trimmed(&particles) }))
    }

    /// The names of iterations that have particles, in the order of their numbers.
    fn iterations(&self, file: &H5) -> Result<Vec<String>, ImportError> {
        let Some(base) = file.group_at(&self.base)? else { return Ok(Vec::new()) };
        let mut numbered: Vec<(u64, String)> =
            base.members()?.0.into_iter().filter_map(|name| Some((name.parse().ok()?, name))).collect();
        numbered.sort();
        let mut found = Vec::new();
        for (_, name) in numbered {
            let species = file.group_at(&format!("{}/{name}/{}", self.base, self.particles))?;
            let has_any = species.map(|species| Ok::<_, ImportError>(!species.members()?.0.is_empty())).transpose()?;
            if has_any == Some(true) {
                found.push(name);
            }
        }
        Ok(found)
    }
}

/// The names of a file's iterations with particles; none of a file that is not of openPMD.
///
/// # Errors
/// When it cannot be read.
pub(super) fn iterations(file: &H5) -> Result<Vec<String>, ImportError> {
    Places::of(file)?.map_or(Ok(Vec::new()), |places| places.iterations(file))
}

/// Numbers of a record.
enum Numbers {
    /// One for each particle.
    Column(Box<Column>),
    /// The same for all.
    Constant(f64),
}

/// Numbers, and what one of them is in SI.
struct Part {
    numbers: Numbers,
    unit: f64,
    /// Of how many particles it is.
    rows: u64,
}

/// What the values of a component are: the sum of some numbers, times others.
#[derive(Default)]
struct Component {
    sum: Vec<Part>,
    times: Option<Part>,
}

/// A field on its way to the description.
struct Record {
    field: Field,
    components: Vec<Component>,
}

/// An iteration of an openPMD file.
pub(super) struct OpenPmd {
    description: Description,
    families: Vec<Vec<Vec<Component>>>,
}

impl OpenPmd {
    /// Opens iteration number `step`, in the order of their numbers, or the first one; `iterations` are their names.
    ///
    /// # Errors
    /// When there is no such iteration, or it is damaged or has no particles.
    pub(super) fn open(file: &H5, iterations: &[String], step: Option<u64>) -> Result<OpenPmd, ImportError> {
        let path = &*file.path;
        let number = step.unwrap_or(0);
        let name = usize::try_from(number).ok().and_then(|number| iterations.get(number));
        let Some(name) = name else {
            let expected = format!("a number below {}, the number of iterations with particles", iterations.len());
            return Err(ImportError::malformed(path, "iteration", number, expected));
        };
        let missing = |what: &str| ImportError::missing(path, what, "a group of the file");
        let places = Places::of(file)?.ok_or_else(|| missing("particlesPath"))?;
        let iteration = format!("{}/{name}", places.base);
        let group = file.group_at(&iteration)?.ok_or_else(|| missing(&iteration))?;
        let is_named = iterations.len() > 1 || step.is_some();
        let named = if is_named { step_name(path, number) } else { path.to_owned() };
        let mut about = Description::unitless(&named, "openpmd", file.bytes);
        about.steps = iterations.len() as u64;
        about.motion = Motion::Coordinate;
        (about.length_unit, about.mass_unit) = (Unit::new("m"), Unit::new("kg"));
        let attributes = group.attributes()?;
        let second = attributes.number("timeUnitSI").unwrap_or(1.0);
        about.time = attributes.number("time").map(|time| time * second).filter(|time| time.is_finite());
        about.notes.push("values are those of the file in SI units".into());
        let particles = format!("{iteration}/{}", places.particles);
        let species = file.group_at(&particles)?.ok_or_else(|| missing(&particles))?;
        let names = species.members()?.0;
        if names.len() > MOST_SPECIES {
            return Err(ImportError::malformed(
                path,
                particles,
                names.len(),
                format!("at most {MOST_SPECIES} species"),
            ));
        }
        let mut families: Vec<(FamilyInfo, Vec<Vec<Component>>)> = Vec::new();
        for (index, name) in names.iter().enumerate() {
            let own = species.group(name)?;
            let (count, records) = records(&own, &mut about.notes)?;
            if count == 0 {
                continue;
            }
            let plain = FamilyName::parse(&name.to_lowercase().replace('_', "-"));
            let is_free = |family: &FamilyName| families.iter().all(|(info, _)| info.name != *family);
            let other = || FamilyName::parse(&format!("species-{}", index + 1));
            let Some(family) = plain.filter(is_free).or_else(other).filter(is_free) else {
                about.notes.push(format!("species number {} is left out, as others have its names", index + 1));
                continue;
            };
            let (fields, components) = records.into_iter().map(|record| (record.field, record.components)).unzip();
            families.push((FamilyInfo { name: family, count, fields }, components));
        }
        if families.is_empty() {
            return Err(ImportError::NoParticles { path: path.into(), field: particles });
        }
        families.sort_by_key(|(info, _)| info.name);
        let (infos, families) = families.into_iter().unzip();
        about.families = infos;
        Ok(OpenPmd { description: about, families })
    }
}

/// How many particles a species has, and its records as fields.
fn records(species: &H5Group, notes: &mut Vec<String>) -> Result<(u64, Vec<Record>), ImportError> {
    let (groups, datasets) = species.members()?;
    let wrong =
        |found: String, expected: &str| ImportError::malformed(&species.file.path, &*species.name, found, expected);
    if groups.len() + datasets.len() > MOST_RECORDS {
        return Err(wrong(format!("{} records", groups.len() + datasets.len()), "fewer"));
    }
    let vector = |name: &str| -> Result<Option<Vec<(String, Part)>>, ImportError> {
        if !groups.iter().any(|group| group == name) {
            return Ok(None);
        }
        let own = species.group(name)?;
        let (constants, columns) = own.members()?;
        let mut parts = Vec::new();
        for axis in constants.into_iter().chain(columns) {
            if let Some(part) = part(&own, &axis)? {
                parts.push((axis, part));
            }
        }
        parts.sort_by(|(one, _), (other, _)| one.cmp(other));
        Ok(Some(parts))
    };
    let mut offsets = vector("positionOffset")?.unwrap_or_default();
    let mut found: Vec<Record> = Vec::new();
    for name in groups.iter().filter(|name| !["positionOffset", "particlePatches"].contains(&&***name)) {
        let about = species.group(name)?.attributes()?;
        if about.has("value") {
            found.extend(scalar(species, name, &about)?);
            continue;
        }
        let mut parts = vector(name)?.unwrap_or_default();
        if parts.is_empty() {
            continue;
        }
        let is_of_axes = parts.iter().all(|(axis, _)| AXES.contains(&&**axis));
        let mut components: Vec<Component> = Vec::new();
        if is_of_axes {
            // Of runs in fewer dimensions others are 0.
            for axis in AXES {
                let mut component = Component::default();
                let place = parts.iter().position(|(other, _)| other == axis);
                component.sum.extend(place.map(|place| parts.swap_remove(place).1));
                if name == "position" {
                    let place = offsets.iter().position(|(other, _)| other == axis);
                    component.sum.extend(place.map(|place| offsets.swap_remove(place).1));
                }
                components.push(component);
            }
        } else {
            components.extend(parts.into_iter().map(|(_, part)| Component { sum: vec![part], times: None }));
        }
        let kind = match &**name {
            "position" if is_of_axes => FieldKind::Position,
            "velocity" if is_of_axes => FieldKind::Velocity,
            _ => FieldKind::Other,
        };
        found.push(Record { field: field(name, kind, components.len(), &about), components });
    }
    for name in &datasets {
        let about = species.column(name)?.map(|column| column.attributes()).transpose()?;
        match about {
            Some(about) => found.extend(scalar(species, name, &about)?),
            None => notes.push(format!("{name} is no column of numbers and is left out")),
        }
    }
    // Of every number as many.
    let parts = |record: &Record| -> Vec<u64> {
        let all = record.components.iter().flat_map(|component| component.sum.iter().chain(&component.times));
        all.map(|part| part.rows).collect()
    };
    let Some(position) = found.iter().find(|record| record.field.kind == FieldKind::Position) else {
        return Err(ImportError::missing(
            &species.file.path,
            format!("{}/position", species.name),
            "components x, y or z",
        ));
    };
    let is_stored = |part: &Part| matches!(part.numbers, Numbers::Column(_));
    if !position.components.iter().any(|component| component.sum.iter().any(is_stored)) {
        return Err(wrong("the same position for all".into(), "one for each particle"));
    }
    let count = parts(position).first().copied().unwrap_or(0);
    if let Some(record) = found.iter().find(|record| parts(record).iter().any(|rows| *rows != count)) {
        return Err(wrong(
            format!("{} of {:?} particles", record.field.name, parts(record)),
            &format!("{count} of each"),
        ));
    }
    found.sort_by_key(|record| record.field.kind);
    Ok((count, found))
}

/// A record of one number for each particle. Masses are those of the particles of the simulation, which may stand for many.
fn scalar(species: &H5Group, name: &str, about: &Attributes) -> Result<Option<Record>, ImportError> {
    let Some(own) = part(species, name)? else { return Ok(None) };
    let is_whole = matches!(&own.numbers, Numbers::Column(column) if column.is_whole());
    let kind = match name {
        "mass" => FieldKind::Mass,
        "id" if is_whole => FieldKind::Id,
        _ => FieldKind::Other,
    };
    let is_of_one = about.number("macroWeighted") == Some(0.0) && about.number("weightingPower") == Some(1.0);
    let (groups, datasets) = species.members()?;
    let has_weights = groups.iter().chain(&datasets).any(|other| other == "weighting");
    let times = if kind == FieldKind::Mass && is_of_one && has_weights { part(species, "weighting")? } else { None };
    let components = vec![Component { sum: vec![own], times }];
    Ok(Some(Record { field: field(name, kind, 1, about), components }))
}

/// The description of a record.
fn field(name: &str, kind: FieldKind, components: usize, about: &Attributes) -> Field {
    let unit = match kind {
        FieldKind::Position => Unit::new("m"),
        FieldKind::Velocity => Unit::new("m/s"),
        FieldKind::Mass => Unit::new("kg"),
        _ => Unit::new(unit_of(&about.numbers("unitDimension").unwrap_or_default())),
    };
    Field { name: name.into(), stored_as: name.into(), unit, components, kind }
}

/// The unit of these powers of the seven base units.
fn unit_of(powers: &[f64]) -> String {
    let factor = |unit: &str, power: f64| if power == 1.0 { unit.to_owned() } else { format!("{unit}^{power}") };
    let named = || DIMENSIONS.iter().zip(powers.iter().map(|power| if power.is_finite() { *power } else { 0.0 }));
    let above: Vec<String> =
        named().filter(|(_, power)| *power > 0.0).map(|(unit, power)| factor(unit, power)).collect();
    let below: String =
        named().filter(|(_, power)| *power < 0.0).map(|(unit, power)| format!("/{}", factor(unit, -power))).collect();
    match (above.is_empty(), below.is_empty()) {
        (true, true) => String::new(),
        (true, false) => format!("1{below}"),
        _ => above.join(" ") + &below,
    }
}

/// The numbers of a component, or of a record of one; `None` where they are none.
fn part(group: &H5Group, name: &str) -> Result<Option<Part>, ImportError> {
    if group.members()?.1.iter().any(|dataset| dataset == name) {
        let Some(column) = group.column(name)?.filter(|column| column.components == 1) else { return Ok(None) };
        let unit = column.attributes()?.number("unitSI").unwrap_or(1.0);
        let rows = column.rows;
        return Ok(Some(Part { numbers: Numbers::Column(Box::new(column)), unit, rows }));
    }
    let about = group.group(name)?.attributes()?;
    let (Some(value), Some(shape)) = (about.number("value"), about.number("shape")) else { return Ok(None) };
    if !(0.0..9e15).contains(&shape) {
        return Err(about.malformed("shape", shape.to_string(), "a number of particles"));
    }
    let unit = about.number("unitSI").unwrap_or(1.0);
    Ok(Some(Part { numbers: Numbers::Constant(value), unit, rows: shape as u64 }))
}

impl Part {
    /// Reads numbers in SI.
    fn read(&self, range: &Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        match &self.numbers {
            Numbers::Constant(value) => out.fill(value * self.unit),
            Numbers::Column(column) => {
                column.read(range.clone(), out)?;
                if self.unit != 1.0 {
                    out.iter_mut().for_each(|value| *value *= self.unit);
                }
            }
        }
        Ok(())
    }
}

impl Source for OpenPmd {
    fn description(&self) -> &Description {
        &self.description
    }

    fn read(&self, family: usize, field: usize, range: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        self.description.check_range(family, field, &range, out.len())?;
        let components = &self.families[family][field];
        let mut numbers = vec![0.0; (range.end - range.start) as usize];
        out.fill(0.0);
        for (index, component) in components.iter().enumerate() {
            let width = components.len();
            for part in &component.sum {
                part.read(&range, &mut numbers)?;
                let own = out.iter_mut().skip(index).step_by(width);
                own.zip(&numbers).for_each(|(value, number)| *value += number);
            }
            if let Some(times) = &component.times {
                times.read(&range, &mut numbers)?;
                let own = out.iter_mut().skip(index).step_by(width);
                own.zip(&numbers).for_each(|(value, number)| *value *= number);
            }
        }
        Ok(())
    }

    fn read_ids(&self, family: usize, field: usize, range: Range<u64>, out: &mut [u64]) -> Result<(), ImportError> {
        let info = self.description.check_range(family, field, &range, out.len())?;
        if let [Component { sum, times: None }] = &self.families[family][field][..]
            && let [Part { numbers: Numbers::Column(column), .. }] = &sum[..]
            && column.is_whole()
        {
            return column.read_whole(range, out);
        }
        Err(ImportError::malformed(&self.description.path, &*info.name, "other numbers", "a column of whole numbers"))
    }
}
