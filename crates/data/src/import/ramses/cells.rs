//! Cells of RAMSES: the leaves of its tree of grids of 2^3 cells, from `amr_NNNNN.outPPPPP` (`output_amr.f90`) and what is in them from
//! `hydro_NNNNN.outPPPPP` (`output_hydro.f90`).
//!
//! Every process writes its own grids and, level by level, those of others around them, which are passed over. A cell becomes a particle of gas
//! in its middle.

use super::info;
use super::particles::VECTORS;
use super::records::{Array, Walk};
use super::rows::{Rows, component};
use super::{Found, Output};
use crate::import::typed_columns::{Component, FieldList, Run};
use crate::import::{DEFAULT_NEIGHBOURS, FieldKind, ImportError};
use crate::model::{FamilyName, Unit};
use std::f64::consts::PI;
use std::ops::Range;

/// Cells of a grid.
const CELLS: usize = 8;
/// The deepest level and the most quantities of a cell.
const MOST_LEVELS: u32 = 64;
const MOST_VARIABLES: u32 = 256;
/// Grids that are read at a time.
const CHUNK: u64 = 1 << 13;
/// Numbers of a row before the quantities: place, smoothing length, mass.
const BEFORE: usize = 5;

/// What a file of grids says of them.
struct Grids {
    levels: u32,
    /// By level and process, then by level and boundary: how many.
    counts: Vec<u32>,
    boundaries: Vec<u32>,
    boundary_count: u32,
    /// Bytes of a float.
    float: u64,
    /// Coarse cells along each axis.
    coarse: [u32; 3],
}

impl Grids {
    /// Reads the header of a file of grids.
    fn read(walk: &mut Walk, cpus: u32) -> Result<Grids, ImportError> {
        let stated = walk.whole("ncpu", u32::MAX)?;
        if stated != cpus {
            return Err(walk.wrong("ncpu", stated, format!("{cpus}, as many as the output has")));
        }
        let dimensions = walk.whole("ndim", 3)?;
        if dimensions != 3 {
            return Err(walk.wrong("ndim", dimensions, "3"));
        }
        let coarse = walk.wholes("nx, ny, nz", 3, 1 << 10)?;
        let levels = walk.whole("nlevelmax", MOST_LEVELS)?;
        walk.skip("ngridmax", 1)?;
        let boundary_count = walk.whole("nboundary", 1 << 10)?;
        walk.skip("ngrid_current", 1)?;
        let (_, float) = walk.float("boxlen")?;
        // Numbers and times of outputs, times, steps, energies, the universe, and where lists of grids begin and end.
        walk.skip("header", 13)?;
        let most = i32::MAX as u32;
        let counts = walk.wholes("numbl", u64::from(levels) * u64::from(cpus), most)?;
        walk.skip("numbtot", 1)?;
        let mut boundaries = Vec::new();
        if boundary_count > 0 {
            walk.skip("headb and tailb", 2)?;
            boundaries = walk.wholes("numbb", u64::from(levels) * u64::from(boundary_count), most)?;
        }
        walk.skip("free memory", 1)?;
        let ordering = walk.bytes("ordering", 1 << 10)?;
        walk.skip("domains", if ordering.starts_with(b"bisection") { 5 } else { 1 })?;
        walk.skip("coarse cells", 3)?;
        let [x, y, z] = [0, 1, 2].map(|axis| coarse.get(axis).copied().unwrap_or(1));
        Ok(Grids { levels, counts, boundaries, boundary_count, float, coarse: [x, y, z] })
    }

    /// How many grids of a level belong to a process or a boundary, which are numbered behind these.
    fn count(&self, level: u32, owner: u32, cpus: u32) -> u64 {
        let (list, index) = match owner.checked_sub(cpus) {
            None => (&self.counts, level * cpus + owner),
            Some(boundary) => (&self.boundaries, level * self.boundary_count + boundary),
        };
        list.get(index as usize).copied().unwrap_or(0).into()
    }

    /// Edge of the box, where it is a cube that repeats.
    fn box_size(&self, output: &Output) -> Option<f64> {
        let [x, y, z] = self.coarse;
        (self.boundary_count == 0 && x == y && y == z).then(|| output.info.coarse * f64::from(x))
    }

    /// Coarse cells before the box along each axis, of which there is one where it has boundaries.
    fn before(&self) -> [f64; 3] {
        self.coarse.map(|cells| if self.boundary_count > 0 { f64::from(cells / 2) } else { 0.0 })
    }
}

/// What is in the cells, by the place of a quantity in a file.
struct Variables {
    names: Vec<String>,
    density: usize,
    /// The pressure, and the ratio of specific heats less 1.
    pressure: Option<(usize, f64)>,
}

/// Edge of the box of an output, where it is a cube that repeats.
///
/// # Errors
/// When the first file of grids is missing or damaged.
pub(super) fn box_size(output: &Output) -> Result<Option<f64>, ImportError> {
    let mut amr = Walk::open(&output.file("amr", 1), output.method)?;
    Ok(Grids::read(&mut amr, output.info.cpus)?.box_size(output))
}

/// Adds the cells of an output to what was found.
///
/// # Errors
/// When a file is missing, damaged or unlike the others.
pub(super) fn read(output: &Output, found: &mut Found) -> Result<(), ImportError> {
    let names = info::text(&output.folder.join("hydro_file_descriptor.txt"))?;
    let names: Vec<String> =
        names.map_or_else(Vec::new, |text| info::described(&text).into_iter().map(|d| d.0).collect());
    let mut variables: Option<Variables> = None;
    let mut rows = Rows::new(&output.path);
    for cpu in 0..output.info.cpus {
        let mut amr = Walk::open(&output.file("amr", cpu + 1), output.method)?;
        let mut hydro = Walk::open(&output.file("hydro", cpu + 1), output.method)?;
        found.file(&amr);
        found.file(&hydro);
        let grids = Grids::read(&mut amr, output.info.cpus)?;
        let own = head(&mut hydro, &grids, output.info.cpus, &names)?;
        let is_unlike = |known: &Variables| {
            known.names.len() != own.names.len() || known.pressure.is_some() != own.pressure.is_some()
        };
        if variables.as_ref().is_some_and(is_unlike) {
            return Err(hydro.wrong("nvar", own.names.len(), "the quantities of the files before"));
        }
        let own = variables.insert(own);
        if cpu == 0 {
            found.box_size = grids.box_size(output);
        }
        read_file(output, (&mut amr, &mut hydro), (&grids, cpu), own, &mut rows)?;
    }
    let (Some(variables), true) = (variables, rows.count > 0) else { return Ok(()) };
    let number = found.storages.len();
    let count = rows.count;
    found.storages.push(rows.into_storage()?);
    let fields = variables.fields(output, number);
    found.families.push(fields.family(FamilyName::Gas, count, vec![Run::WHOLE]));
    let note =
        "cells are gas: of mass rho dx^3, with the smoothing length of a sphere that holds as much as 32 of them";
    found.notes.push(note.into());
    Ok(())
}

/// Passes over the header of a file of quantities and tells what these are.
fn head(walk: &mut Walk, grids: &Grids, cpus: u32, names: &[String]) -> Result<Variables, ImportError> {
    let same = |walk: &mut Walk, name: &str, expected: u32| {
        let found = walk.whole(name, u32::MAX)?;
        if found == expected {
            return Ok(());
        }
        Err(walk.wrong(name, found, format!("{expected}, as the file of grids has")))
    };
    same(walk, "ncpu", cpus)?;
    let count = walk.whole("nvar", MOST_VARIABLES)? as usize;
    same(walk, "ndim", 3)?;
    same(walk, "nlevelmax", grids.levels)?;
    same(walk, "nboundary", grids.boundary_count)?;
    let (gamma, _) = walk.float("gamma")?;
    const USUAL: [&str; 5] = ["density", "velocity_x", "velocity_y", "velocity_z", "pressure"];
    // A description of another number of quantities is that of something else.
    let described = if names.len() == count { names } else { &[] };
    let name = |index: usize| match (described.get(index), USUAL.get(index)) {
        (Some(name), _) => name.clone(),
        (None, Some(name)) => (*name).to_owned(),
        (None, None) => format!("variable-{}", index + 1),
    };
    let names: Vec<String> = (0..count).map(name).collect();
    let place = |wanted: &[&str]| names.iter().position(|name| wanted.contains(&&**name));
    let Some(density) = place(&["density"]) else {
        return Err(walk.wrong("nvar", format!("{count} quantities without a density"), "one among them"));
    };
    let pressure = place(&["pressure", "thermal_pressure"]).filter(|_| gamma > 1.0 && gamma.is_finite());
    Ok(Variables { pressure: pressure.map(|place| (place, gamma - 1.0)), density, names })
}

/// The grids of a process on a level: their middles, whether their cells are divided, and what is in these.
struct Own {
    middles: [Array; 3],
    sons: Vec<Array>,
    /// By cell and quantity.
    values: Vec<Vec<Array>>,
}

/// Adds the leaves of a process.
fn read_file(
    output: &Output,
    (amr, hydro): (&mut Walk, &mut Walk),
    (grids, cpu): (&Grids, u32),
    variables: &Variables,
    rows: &mut Rows,
) -> Result<(), ImportError> {
    let cpus = output.info.cpus;
    let count = variables.names.len();
    for level in 0..grids.levels {
        for owner in 0..cpus + grids.boundary_count {
            let own = grids.count(level, owner, cpus);
            let field = format!("level {}", level + 1);
            let stated = (hydro.whole(&field, u32::MAX)?, hydro.whole(&field, u32::MAX)?);
            if (stated.0, u64::from(stated.1)) != (level + 1, own) {
                let found = format!("level {} of {} grids", stated.0, stated.1);
                return Err(hydro.wrong(
                    &field,
                    found,
                    format!("level {} of {own}, as the file of grids has", level + 1),
                ));
            }
            if own == 0 {
                continue;
            }
            if owner != cpu {
                amr.jump(3, 4 * own);
                amr.jump(3, grids.float * own);
                amr.jump(31, 4 * own);
                hydro.jump((CELLS * count) as u64, grids.float * own);
                continue;
            }
            amr.skip(&field, 3)?;
            let middles = [amr.array(&field, own)?, amr.array(&field, own)?, amr.array(&field, own)?];
            // The cell above and six neighbours; behind the sons, processes and marks of refinement.
            amr.skip(&field, 7)?;
            let sons: Vec<Array> = (0..CELLS).map(|_| amr.array(&field, own)).collect::<Result<_, _>>()?;
            amr.skip(&field, 2 * CELLS)?;
            let arrays = |hydro: &mut Walk| (0..count).map(|_| hydro.array(&field, own)).collect::<Result<Vec<_>, _>>();
            let values: Vec<Vec<Array>> = (0..CELLS).map(|_| arrays(hydro)).collect::<Result<_, _>>()?;
            let own_grids = Own { middles, sons, values };
            let mut start = 0;
            while start < own {
                let range = start..own.min(start + CHUNK);
                start = range.end;
                leaves(output, (&*amr, &*hydro), (grids, level), &own_grids, &range, variables, rows)?;
            }
        }
    }
    amr.end("grids")?;
    hydro.end("cells")
}

/// Adds the leaves of some grids.
fn leaves(
    output: &Output,
    (amr, hydro): (&Walk, &Walk),
    (grids, level): (&Grids, u32),
    own: &Own,
    range: &Range<u64>,
    variables: &Variables,
    rows: &mut Rows,
) -> Result<(), ImportError> {
    let mut raw = Vec::new();
    let mut middles = [Vec::new(), Vec::new(), Vec::new()];
    for (array, words) in own.middles.iter().zip(&mut middles) {
        amr.words(array.taken_as(false), range, &mut raw, words)?;
    }
    // Of a coarse cell.
    let edge = 0.5f64.powi(level as i32 + 1);
    let before = grids.before();
    let size = edge * output.info.coarse;
    let smoothing = size * (DEFAULT_NEIGHBOURS as f64 * 3.0 / (4.0 * PI)).cbrt();
    let mut sons = Vec::new();
    let mut values: Vec<Vec<[u8; 8]>> = vec![Vec::new(); variables.names.len()];
    for (cell, (son, arrays)) in own.sons.iter().zip(&own.values).enumerate() {
        amr.words(son.taken_as(true), range, &mut raw, &mut sons)?;
        if sons.iter().all(|son| *son != [0; 8]) {
            continue;
        }
        for (array, words) in arrays.iter().zip(&mut values) {
            hydro.words(array.taken_as(false), range, &mut raw, words)?;
        }
        // x is the fastest.
        let half = [0, 1, 2].map(|axis| ((cell >> axis) & 1) as f64 - 0.5);
        for grid in (0..sons.len()).filter(|grid| sons[*grid] == [0; 8]) {
            let value = |place: usize| f64::from_ne_bytes(values[place][grid]);
            let at = [0, 1, 2].map(|axis| {
                let middle = f64::from_ne_bytes(middles[axis][grid]);
                (middle - before[axis] + half[axis] * edge) * output.info.coarse
            });
            let mass = value(variables.density) * size.powi(3);
            let energy = variables.pressure.map(|(place, less)| value(place) / (less * value(variables.density)));
            let first = at.into_iter().chain([smoothing, mass]).chain(energy);
            rows.push(first.map(f64::to_ne_bytes).chain(values.iter().map(|words| words[grid])))?;
        }
    }
    Ok(())
}

impl Variables {
    /// What is in the cells as fields.
    fn fields(&self, output: &Output, storage: usize) -> FieldList {
        let has_energy = usize::from(self.pressure.is_some());
        let width = BEFORE + has_energy + self.names.len();
        let velocity = output.info.velocity_factor();
        let at = |slot: usize, factor: f64| component(storage, slot, width, false, factor);
        let mut fields = FieldList::default();
        fields.push("position", "xg", FieldKind::Position, (0..3).map(|axis| at(axis, 1.0)).collect());
        fields.push("smoothing-length", "dx", FieldKind::SmoothingLength, vec![at(3, 1.0)]);
        fields.push("mass", "density dx^3", FieldKind::Mass, vec![at(4, 1.0)]);
        if has_energy > 0 {
            let factor = velocity.map_or(1.0, |factor| factor * factor);
            let stored_as = "pressure/((gamma-1) density)";
            fields.push("internal-energy", stored_as, FieldKind::Other, vec![at(BEFORE, factor)]);
            if velocity.is_some() {
                fields.set_unit_of("internal-energy", &Unit::new("(km/s)^2"));
            }
        }
        let named = self.names.iter().enumerate().map(|(index, name)| {
            let is_velocity = VECTORS[1].1.contains(&&**name);
            let factor = velocity.filter(|_| is_velocity).unwrap_or(1.0);
            (name.clone(), at(BEFORE + has_energy + index, factor))
        });
        let scalars: Vec<(String, Component)> = named.collect();
        fields.push_named(scalars, &VECTORS[1..]);
        output.name_units(&mut fields);
        fields
    }
}
