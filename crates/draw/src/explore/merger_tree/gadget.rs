//! Merger trees of Gadget-4: `trees.hdf5`, or group catalogues `fof_subhalo_tab_NNN.hdf5` with the links between them,
//! `subhalo_desc_NNN.hdf5`, in one folder or in folders `groups_NNN`.
//!
//! In trees `TreeDescendant` counts from the beginning of a halo's own tree, `TreeIndex` says where in it a halo is. In the others
//! `DescSubhaloNr` is a number at the next step, in the order of all files of its catalogue. -1: there is none.

use super::series::beside;
use super::{Halo, MOST_HALOES, Read, TreeStep, whole};
use crate::explore::ExploreError;
use crate::explore::catalogue::groups;
use crate::import::{Hdf5Column, Hdf5Tables, ImportError, open};
use crate::model::ReadMethod;
use glam::DVec3;
use std::path::{Path, PathBuf};

const HALOES: &str = "TreeHalos";
const TIMES: &str = "TreeTimes";
const CATALOGUE: &str = "fof_subhalo_tab_";
const LINKS: &str = "subhalo_desc_";

/// A file of trees; `None` where it is none.
pub(super) fn trees(path: &Path) -> Result<Option<Read>, ExploreError> {
    let tables = Hdf5Tables::open(path, ReadMethod::default())?;
    if tables.has(HALOES) { read_trees(&tables).map(Some) } else { Ok(None) }
}

/// The catalogues of which the file is one; `None` where there are no links between them.
pub(super) fn series(path: &Path) -> Result<Option<Read>, ExploreError> {
    let mut series = beside(path, |file| Some(number_of(file)?.0), |folder| folder.starts_with("groups_"));
    series.dedup_by_key(|(number, _)| *number);
    let has_links = series.len() > 1 && series.iter().any(|(_, file)| links_of(file).is_some());
    if has_links { catalogues(path, &series).map(Some) } else { Ok(None) }
}

/// The haloes of a file of trees.
fn read_trees(tables: &Hdf5Tables) -> Result<Read, ExploreError> {
    let path = tables.path().clone();
    let read = |name: &str, components: usize| -> Result<Option<Hdf5Column>, ExploreError> {
        let column = tables.column(HALOES, name, MOST_HALOES)?;
        match column {
            Some(column) if column.components != components => {
                let found = format!("{} numbers a row", column.components);
                Err(ExploreError::malformed(&path, format!("{HALOES}/{name}"), found, components.to_string()))
            }
            column => Ok(column),
        }
    };
    let needed = |name: &str, components: usize, count: Option<usize>| -> Result<Hdf5Column, ExploreError> {
        let field = || format!("{HALOES}/{name}");
        let missing = || ExploreError::missing(&path, field(), "a column for each halo");
        let column = read(name, components)?.ok_or_else(missing)?;
        let rows = column.values.len() / components;
        match count {
            Some(count) if count != rows => {
                Err(ExploreError::malformed(&path, field(), format!("{rows} rows"), format!("{count} haloes")))
            }
            _ => Ok(column),
        }
    };
    let position = needed("SubhaloPos", 3, None)?;
    let count = position.values.len() / 3;
    let whole_of = |name: &str| -> Result<Vec<u64>, ExploreError> {
        let column = needed(name, 1, Some(count))?;
        let number = |(row, value): (usize, &f64)| {
            let wrong = || {
                ExploreError::malformed(&path, format!("{HALOES}/{name} of row {row}"), value, "a whole number from 0")
            };
            whole(*value).ok().flatten().ok_or_else(wrong)
        };
        column.values.iter().enumerate().map(number).collect()
    };
    let (numbers, trees, indices) = (whole_of("SubhaloNr")?, whole_of("TreeID")?, whole_of("TreeIndex")?);
    let snapshots = whole_of("SnapNum")?;
    let descendants = needed("TreeDescendant", 1, Some(count))?.values;
    let optional = |names: &[&str]| -> Result<Option<Hdf5Column>, ExploreError> {
        for name in names {
            if let Some(column) = read(name, 1)?.filter(|column| column.values.len() == count) {
                return Ok(Some(column));
            }
        }
        Ok(None)
    };
    let (mass, radius) = (optional(&["SubhaloMass", "Group_M_Crit200"])?, optional(&["SubhaloHalfmassRad"])?);
    let most = snapshots.iter().max().map_or(0, |most| most + 1);
    let time = |name: &str| -> Result<Option<Vec<f64>>, ExploreError> {
        let column = tables.column(TIMES, name, MOST_HALOES)?;
        Ok(column
            .filter(|column| column.components == 1 && column.values.len() as u64 >= most)
            .map(|column| column.values))
    };
    let times =
        time("Time")?.ok_or_else(|| ExploreError::missing(&path, format!("{TIMES}/Time"), "the time of every step"))?;
    let redshifts = time("Redshift")?;
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by_key(|row| (snapshots[*row], numbers[*row], *row));
    let mut place_of_row = vec![0; count];
    order.iter().enumerate().for_each(|(place, row)| place_of_row[*row] = place);
    let mut steps: Vec<TreeStep> = Vec::new();
    let mut haloes = Vec::with_capacity(count);
    for (place, &row) in order.iter().enumerate() {
        let number = snapshots[row];
        if steps.last().is_none_or(|step| step.number != number) {
            let at = number as usize;
            let redshift = redshifts.as_ref().map(|redshifts| redshifts[at]);
            steps.push(TreeStep { number, time: times[at], redshift, haloes: place..place });
        }
        if let Some(step) = steps.last_mut() {
            step.haloes.end = place + 1;
        }
        let wrong = |found: String, expected: &str| {
            ExploreError::malformed(&path, format!("{HALOES}/TreeDescendant of row {row}"), found, expected)
        };
        let descendant = match whole(descendants[row]) {
            Ok(None) => None,
            Ok(Some(descendant)) => {
                let first = (row as u64).checked_sub(indices[row]);
                let target =
                    first.and_then(|first| first.checked_add(descendant)).filter(|target| *target < count as u64);
                let target = target.map(|target| target as usize).filter(|target| {
                    trees[*target] == trees[row] && indices[*target] == descendant && snapshots[*target] > number
                });
                let target =
                    target.ok_or_else(|| wrong(descendant.to_string(), "a halo of the same tree at a later step"))?;
                Some(place_of_row[target])
            }
            Err(value) => return Err(wrong(value.to_string(), "a number in the tree, or -1")),
        };
        let of = |column: &Option<Hdf5Column>| column.as_ref().map(|column| column.values[row]);
        haloes.push(Halo {
            id: numbers[row],
            name: None,
            position: DVec3::from_slice(&position.values[3 * row..3 * row + 3]),
            radius: of(&radius),
            mass: of(&mass),
            descendant,
        });
    }
    let unit = |column: &Option<Hdf5Column>| column.as_ref().map(|column| column.unit.clone()).unwrap_or_default();
    Ok(Read {
        format: "trees",
        length_unit: position.unit,
        mass_unit: unit(&mass),
        box_size: tables.box_size(),
        own: None,
        steps,
        haloes,
        path,
    })
}

/// The number in `fof_subhalo_tab_NNN.hdf5` or `fof_subhalo_tab_NNN.0.hdf5`.
fn number_of(path: &Path) -> Option<(u64, &str)> {
    let name = path.file_name()?.to_str()?.strip_prefix(CATALOGUE)?;
    let digits = name.find(|c: char| !c.is_ascii_digit())?;
    let (number, rest) = name.split_at(digits);
    (rest == ".hdf5" || rest == ".0.hdf5").then_some((number.parse().ok()?, name))
}

/// The file of the links from a catalogue to the next one, where it is there.
fn links_of(catalogue: &Path) -> Option<PathBuf> {
    let (_, name) = number_of(catalogue)?;
    Some(catalogue.with_file_name(format!("{LINKS}{name}"))).filter(|links| links.is_file())
}

/// Catalogues with links between them.
fn catalogues(path: &Path, series: &[(u64, PathBuf)]) -> Result<Read, ExploreError> {
    let mut read = Read { own: number_of(path).map(|(number, _)| number), ..Read::new(path, "groups") };
    // Catalogues without a subhalo, as of early times, are no steps of the tree.
    let mut present = Vec::new();
    for (number, file) in series {
        let source = match open(file) {
            Err(ImportError::NoParticles { .. }) => continue,
            source => source?,
        };
        present.push((*number, file));
        let about = source.description();
        let first = read.haloes.len();
        let (subhaloes, mass_unit) = groups::subhaloes(file, source.as_ref())?;
        if (first + subhaloes.len()) as u64 > MOST_HALOES {
            let expected = format!("at most {MOST_HALOES} subhaloes in all catalogues");
            return Err(ExploreError::malformed(file, "Subhalo", subhaloes.len(), expected));
        }
        if read.steps.is_empty() {
            (read.length_unit, read.mass_unit) = (about.length_unit.clone(), mass_unit);
            read.box_size = about.box_size;
        }
        let time = about.scale_factor.or(about.time);
        let time = time.ok_or_else(|| ExploreError::missing(file, "time", "one in its header"))?;
        read.haloes.extend(subhaloes.into_iter().enumerate().map(|(i, object)| Halo {
            id: i as u64,
            name: None,
            position: object.position,
            radius: object.radius,
            mass: object.mass,
            descendant: None,
        }));
        let haloes = first..read.haloes.len();
        read.steps.push(TreeStep { number: *number, time, redshift: about.redshift, haloes });
    }
    for (at, (number, file)) in present.into_iter().enumerate() {
        let Some(next) =
            read.steps.get(at + 1).filter(|next| next.number == number + 1).map(|next| next.haloes.clone())
        else {
            continue;
        };
        let Some(file) = links_of(file) else { continue };
        let links = Hdf5Tables::open(&file, ReadMethod::default())?.column("Subhalo", "DescSubhaloNr", MOST_HALOES)?;
        let links = links.filter(|links| links.components == 1).map(|links| links.values).unwrap_or_default();
        let own = read.steps[at].haloes.clone();
        if links.len() != own.len() {
            let expected = format!("{}, one for each subhalo", own.len());
            return Err(ExploreError::malformed(&file, "Subhalo/DescSubhaloNr", links.len(), expected));
        }
        for (row, (value, halo)) in links.iter().zip(own).enumerate() {
            let expected = format!("-1, or a number below {}, the subhaloes at step {}", next.len(), number + 1);
            let wrong =
                || ExploreError::malformed(&file, format!("Subhalo/DescSubhaloNr of row {row}"), value, &*expected);
            read.haloes[halo].descendant = match whole(*value).map_err(|_| wrong())? {
                None => None,
                Some(link) if (link as usize) < next.len() => Some(next.start + link as usize),
                Some(_) => return Err(wrong()),
            };
        }
    }
    read.steps.retain(|step| !step.haloes.is_empty());
    Ok(read)
}
