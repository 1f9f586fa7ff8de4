//! An HDF5 snapshot of one or several files as a [`Source`].

use super::file::{Column, H5, H5Group};
use super::header::{Header, kernel_gamma, named_kernel};
use super::names::{self, Quantity};
use super::units;
use super::virtual_source;
use crate::import::multifile;
use crate::import::units::conversion;
use crate::import::{DEFAULT_NEIGHBOURS, Description, FamilyInfo, Field, FieldKind, ImportError, Source};
use crate::model::{FamilyName, ReadMethod, Unit};
use std::f64::consts::PI;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// An opened snapshot.
pub(super) struct Snapshot {
    description: Description,
    families: Vec<FamilyData>,
}

/// Where the fields of one family are.
struct FamilyData {
    fields: Vec<Stored>,
    /// The field with the numbers of particles among those that share an id since they were split.
    children: Option<usize>,
}

/// Where one field is.
enum Stored {
    /// The same value for every particle of a file: `(particles, value)` by file.
    Constant(Vec<(u64, f64)>),
    /// One column per file, in order.
    Columns(Vec<Column>, Transform),
    /// Smoothing lengths of cells, from their masses and densities.
    Cells,
}

/// What is done to stored values.
#[derive(Clone, Copy, PartialEq)]
enum Transform {
    None,
    Times(f64),
    PowerOfTen,
}

/// One data set of the first file as a field.
struct Planned {
    dataset: Option<String>,
    field: Field,
    transform: Transform,
}

impl Snapshot {
    /// Opens the snapshot that the file belongs to, with its other files in the way `method`.
    pub(super) fn open(file: H5, method: ReadMethod) -> Result<Snapshot, ImportError> {
        let (named, names) = parts(file, method)?;
        let path = named.h5.path.clone();
        let path = &*path;
        let mut named = Some(named);
        let files = names.iter().map(|name| match named.take_if(|file| file.h5.path == *name) {
            Some(file) => Ok(file),
            None => File::open(name, method),
        });
        let files: Vec<File> = files.collect::<Result<_, ImportError>>()?;
        let mut description = describe(path, &files);
        let mut families = Vec::new();
        for (number, name) in FamilyName::GADGET.into_iter().enumerate() {
            if let Some((info, data)) = open_family(&files, name, number, &mut description)? {
                description.families.push(info);
                families.push(data);
            }
        }
        if description.families.is_empty() {
            let field = "x, y and z at the root, PartType0 to PartType5, Coordinates".to_string();
            return Err(ImportError::NoParticles { path: path.into(), field });
        }
        let positions = description.families[0].find(FieldKind::Position);
        let unit = |index: usize| description.families[0].fields[index].unit.clone();
        description.length_unit = positions.map(unit).unwrap_or_default();
        let masses =
            description.families.iter().find_map(|info| Some(info.fields[info.find(FieldKind::Mass)?].unit.clone()));
        description.mass_unit = masses.unwrap_or_default();
        let powers =
            [FieldKind::Position, FieldKind::Velocity].map(|kind| stated_powers(&description, &families, kind));
        let [position, velocity] = powers;
        files[0].header.expansion.describe(&files[0].header, position?, velocity?, &mut description);
        Ok(Snapshot { description, families })
    }
}

impl Source for Snapshot {
    fn description(&self) -> &Description {
        &self.description
    }

    fn read(&self, family: usize, field: usize, range: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        let info = self.description.check_range(family, field, &range, out.len())?;
        let components = info.components;
        match &self.families[family].fields[field] {
            Stored::Constant(values) => {
                multifile::pieces(values.iter().map(|(count, _)| *count), range, |file, rows, at| {
                    out[at..at + (rows.end - rows.start) as usize].fill(values[file].1);
                    Ok(())
                })
            }
            Stored::Cells => {
                let fields = &self.description.families[family];
                let (Some(mass), Some(density)) = (fields.find(FieldKind::Mass), fields.find(FieldKind::Density))
                else {
                    out.fill(f64::NAN);
                    return Ok(());
                };
                let mut densities = vec![0.0; out.len()];
                self.read(family, mass, range.clone(), out)?;
                self.read(family, density, range, &mut densities)?;
                out.iter_mut().zip(densities).for_each(|(value, density)| *value = cell_size(*value, density));
                Ok(())
            }
            Stored::Columns(columns, transform) => {
                multifile::pieces(columns.iter().map(|column| column.rows), range, |file, rows, at| {
                    let length = (rows.end - rows.start) as usize * components;
                    let out = &mut out[at * components..at * components + length];
                    columns[file].read(rows, out)?;
                    match transform {
                        Transform::None => {}
                        Transform::Times(factor) => out.iter_mut().for_each(|value| *value *= factor),
                        Transform::PowerOfTen => out.iter_mut().for_each(|value| *value = 10f64.powf(*value)),
                    }
                    Ok(())
                })
            }
        }
    }

    fn read_ids(&self, family: usize, field: usize, range: Range<u64>, out: &mut [u64]) -> Result<(), ImportError> {
        let info = self.description.check_range(family, field, &range, out.len())?;
        let FamilyData { fields, children } = &self.families[family];
        let read = |field: usize, out: &mut [u64]| {
            let Stored::Columns(columns, Transform::None) = &fields[field] else {
                let expected = "a data set of whole numbers";
                return Err(ImportError::malformed(&self.description.path, &*info.name, "a constant", expected));
            };
            multifile::pieces(columns.iter().map(|column| column.rows), range.clone(), |file, rows, at| {
                let out = &mut out[at..at + (rows.end - rows.start) as usize];
                columns[file].read_whole(rows, out)
            })
        };
        read(field, out)?;
        if let (Some(children), FieldKind::Id) = (*children, info.kind) {
            let mut numbers = vec![0; out.len()];
            read(children, &mut numbers)?;
            out.iter_mut().zip(numbers).for_each(|(id, child)| *id = id_of_child(*id, child));
        }
        Ok(())
    }
}

/// The data set in which GIZMO tells apart the particles that share an id since they were split. Their generation, which it writes too,
/// counts the splits of both halves, so that it is not the same before and after.
const CHILDREN: &str = "ParticleChildIDsNumber";

/// The id of a particle of GIZMO: that of the particle from which it was split, with the bits of its number among the children in reverse
/// order from the top. Of a number below `2^n` they are the `n` highest bits, which leaves all others for ids.
fn id_of_child(id: u64, child: u64) -> u64 {
    id ^ child.reverse_bits()
}

/// The smoothing length of a cell that holds this mass at this density: of a sphere with as much in it as so many such cells as there are
/// neighbours within an estimated one.
fn cell_size(mass: f64, density: f64) -> f64 {
    (DEFAULT_NEIGHBOURS as f64 * 3.0 / (4.0 * PI) * mass / density).cbrt()
}

/// The files of the snapshot that a file belongs to, and the one that is named or, where that has no particles of its own, the first.
fn parts(file: H5, method: ReadMethod) -> Result<(File, Vec<PathBuf>), ImportError> {
    let mut named = File::of(file)?;
    if named.header.is_virtual {
        named = File::open(&first_part(&named)?, method)?;
        if named.header.is_virtual {
            let expected = "a file with particles, as another virtual file stands for it";
            return Err(ImportError::malformed(&named.h5.path, "Header/Virtual", 1, expected));
        }
    }
    let names = multifile::names(&named.h5.path, named.header.files)?;
    Ok((named, names))
}

/// The files that are read of the snapshot that a file belongs to, itself among them.
///
/// # Errors
/// When its header cannot be read, or one of the files is not there.
pub(super) fn files(file: H5) -> Result<Vec<PathBuf>, ImportError> {
    let path = file.path.clone();
    let (_, mut files) = parts(file, ReadMethod::Positioned)?;
    if !files.contains(&path) {
        files.push(path);
    }
    Ok(files)
}

/// The first of the files that a file without particles stands for: where its positions say that they are, else beside it, or in a folder of its
/// name.
fn first_part(file: &File) -> Result<PathBuf, ImportError> {
    let path = &*file.h5.path;
    // What is damaged may have its particles beside it all the same.
    let stated = file.source_of_positions();
    let named = stated.as_ref().ok().and_then(Option::as_deref);
    let stated_places = named.into_iter().flat_map(|named| virtual_source::places(path, named));
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    // That of a compressed file has another ending behind the format's.
    let ends = name.rmatch_indices('.').map(|(end, _)| end).filter(|end| *end > 0).take(2).chain([name.len()]);
    let parts: Vec<(&str, String)> =
        ends.map(|end| (&name[..end], format!("{}.0{}", &name[..end], &name[end..]))).collect();
    let beside =
        parts.iter().flat_map(|(name, part)| [path.with_file_name(part), path.with_file_name(name).join(part)]);
    if let Some(place) = stated_places.chain(beside).find(|place| place.is_file()) {
        return Ok(place);
    }
    let expected = "the first of the files that have the particles, beside this one";
    Err(ImportError::missing(path, stated?.unwrap_or_else(|| parts[0].1.clone()), expected))
}

/// One file of a snapshot.
struct File {
    h5: H5,
    groups: Vec<String>,
    datasets: Vec<String>,
    header: Header,
}

impl File {
    fn open(path: &Path, method: ReadMethod) -> Result<File, ImportError> {
        File::of(H5::open(path, method)?)
    }

    fn of(h5: H5) -> Result<File, ImportError> {
        let root = h5.root()?;
        let (groups, datasets) = root.members()?;
        let header = Header::read(&root, &groups)?;
        drop(root);
        Ok(File { h5, groups, datasets, header })
    }

    /// The file that has the first positions of a virtual one, as that calls it; `None` where it does not say.
    fn source_of_positions(&self) -> Result<Option<String>, ImportError> {
        let root = self.h5.root()?;
        for name in self.groups.iter().filter(|name| name.starts_with("PartType")) {
            if let Some(source) = virtual_source::source_file(&root.group(name)?, "Coordinates")? {
                return Ok(Some(source));
            }
        }
        Ok(None)
    }

    fn has_group(&self, name: &str) -> bool {
        self.groups.iter().any(|group| group == name)
    }

    /// The group of a particle type, if this file has particles of it; the root for a bare file.
    fn group(&self, number: usize) -> Result<Option<H5Group<'_>>, ImportError> {
        let name = format!("PartType{number}");
        let claimed = self.header.counts.as_ref().map(|counts| counts.get(number).copied().unwrap_or(0));
        if self.has_group(&name) {
            if claimed == Some(0) {
                return Ok(None);
            }
            let group = self.h5.root()?.group(&name)?;
            // Without a header an empty group says what it holds.
            let is_empty = claimed.is_none() && group.members()?.1.is_empty();
            return Ok((!is_empty).then_some(group));
        }
        if claimed.is_some_and(|count| count > 0) {
            let expected = format!("a group of {} particles as in the header", claimed.unwrap_or(0));
            return Err(ImportError::missing(&self.h5.path, name, expected));
        }
        let catalogue = GROUP_CATALOGUE.into_iter().find(|(kind, name)| *kind == number && self.has_group(name));
        if let Some((_, name)) = catalogue.filter(|_| claimed.is_none()) {
            // A file of several may hold no group at all.
            let group = self.h5.root()?.group(name)?;
            let is_empty = group.members()?.1.is_empty();
            return Ok((!is_empty).then_some(group));
        }
        let bare = number == BARE_TYPE && claimed.is_none() && !self.groups.iter().any(|g| g.starts_with("PartType"));
        let positions = |name: &String| is_kind(name, FamilyName::Dark, FieldKind::Position);
        if bare && self.datasets.iter().any(positions) { self.h5.root().map(Some) } else { Ok(None) }
    }
}

/// The type of particles in a file that has neither header nor groups.
const BARE_TYPE: usize = 1;

/// The groups of a Gadget-4 or AREPO group catalogue, as types of particles: friends-of-friends groups and subhaloes.
const GROUP_CATALOGUE: [(usize, &str); 2] = [(1, "Group"), (2, "Subhalo")];

pub(super) fn is_kind(dataset: &str, family: FamilyName, kind: FieldKind) -> bool {
    names::quantity(dataset, family).is_some_and(|(quantity, _)| quantity.kind == kind)
}

fn describe(path: &Path, files: &[File]) -> Description {
    let header = &files[0].header;
    let format = match (&header.counts, header.swift) {
        (_, true) => "swift",
        (Some(_), _) => "gadget-hdf5",
        (None, _) if files[0].groups.iter().any(|group| group.starts_with("PartType")) => "gadget-hdf5",
        (None, _) => "hdf5",
    };
    let mut about = Description {
        files: files.len(),
        time: header.time,
        redshift: header.redshift,
        box_size: header.box_size,
        ..Description::unitless(path, format, files.iter().map(|file| file.h5.bytes).sum())
    };
    match (named_kernel(header), &header.kernel) {
        (Some((_, kernel, _)), _) => about.kernel = *kernel,
        (None, Some(name)) => {
            about.notes.push(format!("kernel function \"{name}\" is not known: taken for the cubic spline"));
        }
        (None, None) => {}
    }
    about
}

fn open_family(
    files: &[File],
    name: FamilyName,
    number: usize,
    description: &mut Description,
) -> Result<Option<(FamilyInfo, FamilyData)>, ImportError> {
    let mut plan: Option<Vec<Planned>> = None;
    let mut stored: Vec<Stored> = Vec::new();
    let mut count = 0u64;
    for file in files {
        let Some(group) = file.group(number)? else { continue };
        if is_tracers(&group)? {
            let note = format!("{name}: Monte Carlo tracers of AREPO have no positions of their own and are not read");
            description.notes.push(note);
            return Ok(None);
        }
        let planned = match &mut plan {
            Some(planned) => planned,
            none => {
                let planned = plan_family(file, &group, name, number, description)?;
                stored = planned.iter().map(|planned| planned.empty()).collect();
                none.insert(planned)
            }
        };
        let rows = claimed_rows(file, &group, planned, number)?;
        if rows == 0 {
            continue;
        }
        for (planned, stored) in planned.iter().zip(&mut stored) {
            planned.add(file, &group, rows, number, stored)?;
        }
        count = count.saturating_add(rows);
    }
    check_total(files, number, count)?;
    let info = plan.filter(|_| count > 0).map(|plan| FamilyInfo {
        name,
        count,
        fields: plan.into_iter().map(|planned| planned.field).collect(),
    });
    Ok(info.map(|info| {
        let children = info.fields.iter().position(|field| field.stored_as == CHILDREN && field.components == 1);
        let children = children.filter(|_| info.find(FieldKind::Id).is_some());
        description
            .notes
            .extend(children.map(|_| format!("{name}: ids are ParticleIDs with {CHILDREN} in their upper bits")));
        (info, FamilyData { fields: stored, children })
    }))
}

/// The powers of `a` and `h` that the first data set of a kind states.
fn stated_powers(
    description: &Description,
    families: &[FamilyData],
    kind: FieldKind,
) -> Result<Option<(f64, f64)>, ImportError> {
    for (info, data) in description.families.iter().zip(families) {
        if let Some(Stored::Columns(columns, _)) = info.find(kind).map(|field| &data.fields[field])
            && let Some(column) = columns.first()
        {
            return Ok(units::powers_of_a_and_h(&column.attributes()?));
        }
    }
    Ok(None)
}

/// Whether a group holds AREPO's Monte Carlo tracers, which belong to cells and have no coordinates.
fn is_tracers(group: &H5Group) -> Result<bool, ImportError> {
    let (_, datasets) = group.members()?;
    let has = |name: &str| datasets.iter().any(|dataset| dataset == name);
    Ok(has("TracerID") && has("ParentID") && !has("Coordinates"))
}

/// The number of particles that a file claims to have of a type: what its header says, else the rows of the positions.
fn claimed_rows(file: &File, group: &H5Group, plan: &[Planned], number: usize) -> Result<u64, ImportError> {
    if let Some(counts) = &file.header.counts {
        return Ok(counts.get(number).copied().unwrap_or(0));
    }
    let position = plan.iter().find(|planned| planned.field.kind == FieldKind::Position);
    let column = position.and_then(|planned| planned.dataset.as_ref()).map(|name| group.column(name)).transpose()?;
    Ok(column.flatten().map_or(0, |column| column.rows))
}

/// All files together hold as many particles as each header says the snapshot has; some writers leave that number 0.
fn check_total(files: &[File], number: usize, count: u64) -> Result<(), ImportError> {
    let header = &files[0].header;
    let total = header.totals.as_ref().and_then(|totals| totals.get(number)).copied();
    match total {
        Some(total) if total != 0 && total != count => Err(ImportError::malformed(
            &files[0].h5.path,
            format!("Header/NumPart_Total of PartType{number}"),
            total,
            format!("{count}, the particles of {} file(s) together", files.len()),
        )),
        _ => Ok(()),
    }
}

/// The fields of a family, from the data sets of the first file that has it.
fn plan_family(
    file: &File,
    group: &H5Group,
    name: FamilyName,
    number: usize,
    description: &mut Description,
) -> Result<Vec<Planned>, ImportError> {
    let (_, mut datasets) = group.members()?;
    datasets.sort();
    datasets.dedup();
    // Of several data sets of one quantity the one that its list names first counts; the others keep their own names.
    let mut best: Vec<(Quantity, usize, &String)> = Vec::new();
    for dataset in &datasets {
        if let Some((quantity, rank)) = names::quantity(dataset, name) {
            match best.iter_mut().find(|(other, ..)| other.name == quantity.name) {
                Some(other) if other.1 <= rank => {}
                Some(other) => *other = (quantity, rank, dataset),
                None => best.push((quantity, rank, dataset)),
            }
        }
    }
    let mut plan = Vec::new();
    let mut units_of_cells = UnitsOfCells::default();
    for dataset in &datasets {
        let Some(column) = group.column(dataset)? else {
            description.notes.push(format!("{name}: data set {dataset} is not a column of numbers and is left out"));
            continue;
        };
        let attributes = column.attributes()?;
        let quantity = best.iter().find(|(_, _, best)| *best == dataset).map(|(quantity, ..)| *quantity);
        let shaped = quantity.filter(|quantity| match quantity.kind {
            FieldKind::Position | FieldKind::Velocity => column.components == 3,
            FieldKind::Other => true,
            _ => column.components == 1,
        });
        let mut transform = Transform::None;
        if shaped.is_some_and(|quantity| quantity.kind == FieldKind::SmoothingLength) && file.header.swift {
            let gamma = kernel_gamma(&file.header);
            transform = Transform::Times(gamma);
            let note = format!("SWIFT smoothing lengths are multiplied by {gamma} to give the support radius");
            description.notes.extend((!description.notes.contains(&note)).then_some(note));
        }
        let kind = shaped.map_or(FieldKind::Other, |quantity| quantity.kind);
        let in_words = units::in_words(&attributes, kind)?;
        units_of_cells.learn(kind, in_words.is_some(), units::powers_of_a_and_h(&attributes));
        let unit = match in_words {
            Some(unit) => unit,
            None => file.header.units.unit_of(&attributes, shaped),
        };
        let field = Field {
            name: shaped.map_or(dataset.clone(), |quantity| quantity.name.into()),
            stored_as: dataset.clone(),
            unit,
            components: column.components,
            kind,
        };
        plan.push(Planned { dataset: Some(dataset.clone()), field, transform });
        let plain = |quantity: &Quantity| !best.iter().any(|(other, ..)| other.name == quantity.name);
        if let Some(quantity) = names::logarithm(dataset, name).filter(plain).filter(|_| column.components == 1) {
            let field = Field {
                name: quantity.name.into(),
                stored_as: dataset.clone(),
                unit: Unit::new(quantity.fixed),
                components: 1,
                kind: quantity.kind,
            };
            description.notes.push(format!("{name}: {} is 10 to the power of {dataset}", quantity.name));
            plan.push(Planned { dataset: Some(dataset.clone()), field, transform: Transform::PowerOfTen });
        }
    }
    let has = |kind| plan.iter().any(|planned: &Planned| planned.field.kind == kind);
    if !has(FieldKind::Position) {
        let field = format!("PartType{number}/Coordinates");
        return Err(ImportError::missing(&file.h5.path, field, "a data set of 3 coordinates per particle"));
    }
    let table = |file: &File| file.header.masses.get(number).copied().unwrap_or(0.0);
    if !has(FieldKind::Mass) && table(file) > 0.0 {
        let mass = names::quantity("masses", name).map(|(quantity, _)| quantity);
        let unit = file.header.units.unit_of(&group.attributes()?, mass);
        let stored_as = "MassTable".to_string();
        let field = Field { name: "mass".into(), stored_as, unit, components: 1, kind: FieldKind::Mass };
        plan.push(Planned { dataset: None, field, transform: Transform::None });
    }
    // Codes with cells, as AREPO, have no smoothing lengths.
    let has = |kind| plan.iter().any(|planned: &Planned| planned.field.kind == kind);
    // Densities that a file has as logarithms are in units of their own.
    let is_density =
        |planned: &Planned| planned.field.kind == FieldKind::Density && planned.transform == Transform::None;
    let are_cells = name == FamilyName::Gas && has(FieldKind::Mass) && plan.iter().any(is_density);
    if are_cells && !has(FieldKind::SmoothingLength) && units_of_cells.fit() {
        let position = plan.iter().find(|planned| planned.field.kind == FieldKind::Position);
        let unit = position.map(|planned| planned.field.unit.clone()).unwrap_or_default();
        let (kind, stored_as) = (FieldKind::SmoothingLength, "volume of the cell".to_string());
        let field = Field { name: "smoothing-length".into(), stored_as, unit, components: 1, kind };
        plan.push(Planned { dataset: None, field, transform: Transform::None });
        let note = "smoothing length is that of a sphere with the mass of";
        description.notes.push(format!("{name}: {note} {DEFAULT_NEIGHBOURS} such cells at the cell's density"));
    }
    one_unit_of_length(&file.h5.path, &mut plan, &mut description.notes);
    plan.sort_by_key(|planned| planned.field.kind);
    Ok(plan)
}

/// Whether the mass by the density of a cell is the cube of a length in the unit of positions, as far as data sets say.
#[derive(Default)]
struct UnitsOfCells {
    /// Some unit is named in words, which are not compared.
    in_words: bool,
    /// Powers of `a` and `h` of positions, masses and densities.
    powers: [Option<(f64, f64)>; 3],
}

impl UnitsOfCells {
    fn learn(&mut self, kind: FieldKind, in_words: bool, powers: Option<(f64, f64)>) {
        let kinds = [FieldKind::Position, FieldKind::Mass, FieldKind::Density];
        if let Some(place) = kinds.iter().position(|other| *other == kind) {
            self.in_words |= in_words;
            self.powers[place] = powers;
        }
    }

    fn fit(&self) -> bool {
        let [Some(position), Some(mass), Some(density)] = self.powers else { return !self.in_words };
        let is_cube = |position: f64, mass: f64, density: f64| (mass - density - 3.0 * position).abs() < 1e-3;
        !self.in_words && is_cube(position.0, mass.0, density.0) && is_cube(position.1, mass.1, density.1)
    }
}

/// Brings smoothing lengths to the unit of the positions, where both are known and differ.
fn one_unit_of_length(path: &Path, plan: &mut [Planned], notes: &mut Vec<String>) {
    let position = plan.iter().find(|planned| planned.field.kind == FieldKind::Position);
    let Some(to) = position.map(|planned| planned.field.unit.clone()).filter(|unit| !unit.is_unknown()) else { return };
    for planned in plan.iter_mut().filter(|planned| planned.field.kind == FieldKind::SmoothingLength) {
        let from = &planned.field.unit;
        if *from == to || from.is_unknown() {
            continue;
        }
        let Ok(factor) = conversion(path, &planned.field.stored_as, &from.0, &to.0) else {
            notes.push(format!("{} has the unit {from}, positions {to}: taken for the same", planned.field.stored_as));
            continue;
        };
        planned.field.unit = to.clone();
        match &mut planned.transform {
            Transform::None if factor != 1.0 => planned.transform = Transform::Times(factor),
            Transform::Times(times) => *times *= factor,
            _ => {}
        }
    }
}

impl Planned {
    fn empty(&self) -> Stored {
        match (&self.dataset, self.field.kind) {
            (Some(_), _) => Stored::Columns(Vec::new(), self.transform),
            (None, FieldKind::SmoothingLength) => Stored::Cells,
            (None, _) => Stored::Constant(Vec::new()),
        }
    }

    /// Adds the field's column of one more file.
    fn add(
        &self,
        file: &File,
        group: &H5Group,
        rows: u64,
        number: usize,
        stored: &mut Stored,
    ) -> Result<(), ImportError> {
        match (stored, &self.dataset) {
            (Stored::Columns(columns, _), Some(dataset)) => {
                let label = format!("PartType{number}/{dataset}");
                let Some(column) = group.column(dataset)? else {
                    return Err(ImportError::missing(&file.h5.path, label, "a column of numbers as in the first file"));
                };
                if column.rows != rows || column.components != self.field.components {
                    let found = format!("{} x {} values", column.rows, column.components);
                    let expected = format!("{rows} x {} values", self.field.components);
                    return Err(ImportError::malformed(&file.h5.path, column.label, found, expected));
                }
                columns.push(column);
            }
            (Stored::Constant(values), _) => {
                values.push((rows, file.header.masses.get(number).copied().unwrap_or(0.0)));
            }
            (Stored::Columns(..), None) | (Stored::Cells, _) => {}
        }
        Ok(())
    }
}
