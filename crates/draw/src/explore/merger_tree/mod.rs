//! Merger trees: haloes at several steps of a run, and which of them each one becomes. For their histories, and for where they are at
//! any time.
//!
//! Files of all steps are told apart by their content: Gadget-4's trees (`trees.hdf5`), trees of consistent-trees (`tree_I_J_K.dat`), and tables
//! (CSV) with ids, steps and descendants. Those of one step each by their names: Gadget-4's group catalogues with the links between them
//! (`subhalo_desc_NNN.hdf5`), lists of AHF with theirs (`_mtree`), and tracks of HBT+.

mod ahf;
mod forest;
mod gadget;
mod hbt;
mod history;
mod series;
mod table;

pub use history::{HaloAtStep, csv};

use super::catalogue::{Object, halo_text};
use super::error::ExploreError;
use super::followed::nearest;
use crate::hierarchy::spacetime::{HermiteSpline, chord, difference_at};
use crate::import::Hdf5Tables;
use crate::model::{StepTimes, Unit};
use glam::DVec3;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Most haloes of all steps together; each takes some 130 bytes.
pub const MOST_HALOES: u64 = 20_000_000;

/// A halo at a step.
#[derive(Clone, Debug, PartialEq)]
pub struct Halo {
    /// Its number, which no other halo of the step has.
    pub id: u64,
    /// The catalogue's own name, where it has one; else it is called by its number.
    pub name: Option<Box<str>>,
    /// Where it is, in the tree's length unit.
    pub position: DVec3,
    /// How large it is; positive.
    pub radius: Option<f64>,
    /// Its mass.
    pub mass: Option<f64>,
    /// What it becomes: a number among all haloes, of a later step.
    pub descendant: Option<usize>,
}

/// A step at which there are haloes.
#[derive(Clone, Debug, PartialEq)]
pub struct TreeStep {
    /// The number that the files give it.
    pub number: u64,
    /// Its time: of comoving data the scale factor.
    pub time: f64,
    /// Its redshift, where the files say it.
    pub redshift: Option<f64>,
    /// Its haloes' numbers.
    haloes: Range<usize>,
}

/// Haloes at several steps.
#[derive(Clone, Debug, PartialEq)]
pub struct MergerTree {
    /// The file.
    pub path: PathBuf,
    /// What kind of file: `csv`, `trees`, `groups`, `consistent-trees`, `ahf`, `hbt`.
    pub format: &'static str,
    /// Unit of positions and radii; empty when unknown.
    pub length_unit: Unit,
    /// Unit of masses; empty when unknown.
    pub mass_unit: Unit,
    /// Edge of the periodic box, where the files say so.
    pub box_size: Option<f64>,
    /// The step that the file itself holds; of a file with all of them the last.
    pub own_step: usize,
    steps: Vec<TreeStep>,
    haloes: Vec<Halo>,
    /// Of each halo the first of its progenitors below; one more at the end.
    first_progenitor: Vec<u32>,
    /// The heaviest of each first.
    progenitors: Vec<u32>,
}

/// What is read of a file, before the links are looked through.
struct Read {
    path: PathBuf,
    format: &'static str,
    length_unit: Unit,
    mass_unit: Unit,
    box_size: Option<f64>,
    /// The number of the step that the file itself holds, where it does not hold all.
    own: Option<u64>,
    /// In the order of time.
    steps: Vec<TreeStep>,
    haloes: Vec<Halo>,
}

impl MergerTree {
    /// Reads the tree that a file holds; `None` where it has haloes of one step alone.
    ///
    /// # Errors
    /// [`ExploreError`] with file and field when it cannot be read or is damaged, or a link leads to no halo of a later step.
    pub fn of_file(path: &Path) -> Result<Option<MergerTree>, ExploreError> {
        let read = match Hdf5Tables::are_in(path)? {
            true => gadget::trees(path)?,
            false if halo_text::is_forest(path)? => Some(forest::read(path)?),
            // That of a halo finder is of one step, though its haloes may have descendants.
            false if halo_text::is_list(path)? => None,
            false => table::read(path)?,
        };
        read.map(MergerTree::linked).transpose()
    }

    /// The same, and the tree of catalogues of one step each of which the file is one.
    ///
    /// # Errors
    /// As [`MergerTree::of_file`], of any of the files.
    pub fn of_series(path: &Path) -> Result<Option<MergerTree>, ExploreError> {
        if let Some(tree) = MergerTree::of_file(path)? {
            return Ok(Some(tree));
        }
        let read = match Hdf5Tables::are_in(path)? {
            true => match hbt::series(path)? {
                None => gadget::series(path)?,
                found => found,
            },
            false => ahf::series(path)?,
        };
        read.map(MergerTree::linked).transpose()
    }

    /// Looks the links through, and finds the progenitors.
    fn linked(read: Read) -> Result<MergerTree, ExploreError> {
        let Read { path, format, length_unit, mass_unit, box_size, own, steps, mut haloes } = read;
        if haloes.is_empty() {
            return Err(ExploreError::missing(&path, "haloes", "at least one"));
        }
        for pair in steps.windows(2) {
            if pair[0].time.partial_cmp(&pair[1].time) != Some(std::cmp::Ordering::Less) {
                let found = format!("{} behind {}", pair[1].time, pair[0].time);
                let field = format!("time of step {}", pair[1].number);
                return Err(ExploreError::malformed(&path, field, found, "times that rise"));
            }
        }
        for halo in &mut haloes {
            halo.radius = halo.radius.filter(|radius| *radius > 0.0 && radius.is_finite());
            halo.mass = halo.mass.filter(|mass| mass.is_finite());
        }
        let count = haloes.len();
        let mut first_progenitor = vec![0u32; count + 1];
        for step in &steps {
            for halo in &haloes[step.haloes.clone()] {
                let Some(descendant) = halo.descendant else { continue };
                // So that no chain of links comes back to where it began.
                if descendant < step.haloes.end || descendant >= count {
                    let field = format!("descendant of halo {} at step {}", halo.id, step.number);
                    return Err(ExploreError::malformed(
                        &path,
                        field,
                        "none of a later step",
                        "a halo of a later step",
                    ));
                }
                first_progenitor[descendant + 1] += 1;
            }
        }
        for i in 0..count {
            first_progenitor[i + 1] += first_progenitor[i];
        }
        let mut next = first_progenitor.clone();
        let mut progenitors = vec![0u32; first_progenitor[count] as usize];
        for (i, halo) in haloes.iter().enumerate() {
            if let Some(descendant) = halo.descendant {
                progenitors[next[descendant] as usize] = i as u32;
                next[descendant] += 1;
            }
        }
        let mass = |i: &u32| haloes[*i as usize].mass.unwrap_or(0.0);
        for i in 0..count {
            let own = first_progenitor[i] as usize..first_progenitor[i + 1] as usize;
            progenitors[own].sort_by(|a, b| mass(b).total_cmp(&mass(a)).then(a.cmp(b)));
        }
        let own_step = own.and_then(|own| steps.iter().position(|step| step.number == own));
        Ok(MergerTree {
            own_step: own_step.unwrap_or(steps.len() - 1),
            path,
            format,
            length_unit,
            mass_unit,
            box_size,
            steps,
            haloes,
            first_progenitor,
            progenitors,
        })
    }

    /// The steps, in the order of time.
    pub fn steps(&self) -> &[TreeStep] {
        &self.steps
    }

    /// When they are.
    pub fn times(&self) -> StepTimes {
        StepTimes {
            times: self.steps.iter().map(|step| step.time).collect(),
            redshifts: self.steps.iter().map(|step| step.redshift).collect(),
        }
    }

    /// Haloes of all steps.
    pub fn haloes(&self) -> &[Halo] {
        &self.haloes
    }

    /// The haloes that become a halo, the heaviest first.
    pub fn progenitors(&self, halo: usize) -> &[u32] {
        let own = self.first_progenitor[halo] as usize..self.first_progenitor[halo + 1] as usize;
        &self.progenitors[own]
    }

    /// The heaviest halo that becomes a halo.
    fn main_progenitor(&self, halo: usize) -> Option<usize> {
        self.progenitors(halo).first().map(|halo| *halo as usize)
    }

    fn name(&self, halo: &Halo) -> String {
        let word = match self.format {
            "trees" | "groups" => "Subhalo",
            "hbt" => "Track",
            _ => "Halo",
        };
        halo.name.as_ref().map_or_else(|| format!("{word} {}", halo.id), ToString::to_string)
    }

    /// The step of a halo.
    fn step_of(&self, halo: usize) -> usize {
        self.steps.partition_point(|step| step.haloes.end <= halo)
    }

    /// The halo of that name at a step, capital letters or not.
    ///
    /// # Errors
    /// [`ExploreError::Missing`] with names of others.
    pub fn named(&self, step: usize, name: &str) -> Result<usize, ExploreError> {
        let wanted = name.trim().to_lowercase();
        let own = self.steps.get(step).map_or(0..0, |step| step.haloes.clone());
        let found = own.clone().find(|halo| self.name(&self.haloes[*halo]).to_lowercase() == wanted);
        found.ok_or_else(|| {
            let some: Vec<String> = self.haloes[own.clone()].iter().take(3).map(|halo| self.name(halo)).collect();
            let number = self.steps.get(step).map_or(0, |step| step.number);
            let expected = format!("one of {} at step {number} such as {}", own.len(), some.join(", "));
            ExploreError::missing(&self.path, format!("halo {name:?}"), expected)
        })
    }

    /// The objects at a time, `None`: at the file's own step. Between two steps haloes are on splines through where they are at the steps, and
    /// who merges goes to where what it becomes is.
    pub fn objects_at(&self, time: Option<f64>) -> Vec<Object> {
        let time = time.filter(|time| time.is_finite()).unwrap_or(self.steps[self.own_step].time);
        let step = self.step_at(time);
        self.steps[step].haloes.clone().map(|halo| self.object_at(halo, step, time)).collect()
    }

    /// The step at or before a time; before the first one that.
    pub fn step_at(&self, time: f64) -> usize {
        self.steps.partition_point(|step| step.time <= time).saturating_sub(1)
    }

    /// How many haloes there are at a step.
    pub fn count(&self, step: usize) -> usize {
        self.steps.get(step).map_or(0, |step| step.haloes.len())
    }

    fn object_at(&self, number: usize, step: usize, time: f64) -> Object {
        let halo = &self.haloes[number];
        let object = |position, radius, mass| Object { name: self.name(halo), position, radius, mass };
        let begin = self.steps[step].time;
        let Some(descendant) = halo.descendant.filter(|_| time > begin) else {
            return object(halo.position, halo.radius, halo.mass);
        };
        let end = self.steps[self.step_of(descendant)].time;
        let u = ((time - begin) / (end - begin)).min(1.0);
        let other = &self.haloes[descendant];
        let positions = [DVec3::ZERO, self.way(number, descendant)];
        let velocities = [self.velocity(number, Some(descendant)), self.velocity(descendant, other.descendant)];
        let spline = HermiteSpline { positions, tangents: velocities.map(|velocity| velocity * (end - begin)) };
        // Who merges keeps what it has.
        let is_main = self.main_progenitor(descendant) == Some(number);
        let between = |own: Option<f64>, then: Option<f64>| match (own, then) {
            (Some(own), Some(then)) if is_main => Some(own + u * (then - own)),
            _ => own,
        };
        let place = halo.position + spline.position(u);
        let position =
            self.box_size.map_or(place, |edge| DVec3::from_array(place.to_array().map(|x| x.rem_euclid(edge))));
        object(position, between(halo.radius, other.radius), between(halo.mass, other.mass))
    }

    /// From one halo to another, on the shortest way around the box.
    fn way(&self, from: usize, to: usize) -> DVec3 {
        nearest(self.haloes[to].position - self.haloes[from].position, self.box_size)
    }

    /// How fast a halo moves that was its main progenitor and becomes `next`: through all three where they are known.
    fn velocity(&self, halo: usize, next: Option<usize>) -> DVec3 {
        let time = |halo: usize| self.steps[self.step_of(halo)].time;
        let before = self.main_progenitor(halo).map(|before| (time(before), -self.way(before, halo)));
        let after = next.map(|next| (time(next), self.way(halo, next)));
        let now = time(halo);
        match (before, after) {
            (Some((t0, x0)), Some((t2, x2))) => difference_at([t0, now, t2], [x0, DVec3::ZERO, x2], 1),
            (None, Some((t2, x2))) => chord([now, t2], [DVec3::ZERO, x2]),
            (Some((t0, x0)), None) => chord([t0, now], [x0, DVec3::ZERO]),
            (None, None) => DVec3::ZERO,
        }
    }
}

/// A number of a file that says which halo or step: whole and not negative, `None` for -1 and for no number.
///
/// # Errors
/// The number, where it is something else.
fn whole(value: f64) -> Result<Option<u64>, f64> {
    match value {
        value if value.is_nan() || value == -1.0 => Ok(None),
        value if (0.0..9e15).contains(&value) && value.fract() == 0.0 => Ok(Some(value as u64)),
        value => Err(value),
    }
}
