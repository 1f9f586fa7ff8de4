//! What a selection is at each step of a run: how many, how heavy, where, how fast and what its fields are.

use super::batch::Work;
use super::data::Data;
use super::error::ExploreError;
use super::followed::{Following, nearest};
use super::probe::{Fields, Probe, ProbeOptions, probe};
use super::selection::Members;
use crate::hierarchy::spacetime::Interpolation;
use crate::model::{Moment, PhysicalFactors, Unit};
use crate::store::RunFile;
use glam::DVec3;
use serde::Serialize;
use std::sync::Arc;

/// A selection over a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OverTime {
    /// Unit of lengths.
    pub length_unit: Unit,
    /// Unit of masses.
    pub mass_unit: Unit,
    /// Names and units of the fields whose means there are.
    pub fields: Vec<(String, Unit)>,
    /// One for each step.
    pub steps: Vec<AtStep>,
}

/// A selection at a step.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AtStep {
    /// The step, from 0.
    pub step: usize,
    /// Its time, as the run counts it.
    pub time: f64,
    /// Its redshift, where it has one.
    pub redshift: Option<f64>,
    /// Number of particles.
    pub count: u64,
    /// Their mass.
    pub mass: f64,
    /// Their centre of mass, within the periodic box where there is one; `None` without particles.
    pub center: Option<[f64; 3]>,
    /// From the first centre that there is to this one, on the shortest way around the box.
    pub distance: Option<f64>,
    /// Their mean velocity, weighted with mass, where the data has velocities.
    pub velocity: Option<[f64; 3]>,
    /// The dispersion of their velocities along a line of sight, the mean over all directions.
    pub dispersion: Option<f64>,
    /// The mean of each field, of all families that have it; `None` without a value.
    pub means: Vec<Option<f64>>,
}

/// A selection at every step, from the tracks; of a run without tracks a region alone, from its stills. `wraps`: whether distances go
/// round a periodic box.
///
/// # Errors
/// When the run cannot be read, or has no such field or family, or no tracks where members are followed.
pub fn over_time(
    run: &Arc<RunFile>,
    following: Option<&Following>,
    members: &Members,
    fields: &Fields,
    wraps: bool,
    work: Work,
) -> Result<OverTime, ExploreError> {
    let steps = run.directory().steps.len();
    work.progress.begin("reading steps", steps as u64);
    let quiet = Work { progress: &(), stop: work.stop };
    let mut all = OverTime {
        length_unit: run.directory().length_unit.clone(),
        mass_unit: run.directory().mass_unit.clone(),
        fields: Vec::new(),
        steps: Vec::with_capacity(steps),
    };
    let mut probes = Vec::with_capacity(steps);
    for step in 0..steps {
        work.go_on()?;
        let moment = Moment { step, u: 0.0 };
        let options = |periodic| ProbeOptions { fields: fields.clone(), profile: None, periodic };
        let found = match following {
            Some(following) => {
                let periodic = following.periodic().filter(|_| wraps);
                let (snapshot, region) = following.snapshot(members, moment, Interpolation::Auto, quiet)?;
                probe(Data::Source(&snapshot), &region, &options(periodic), quiet)?
            }
            None => {
                let still = run.placed_still(step)?;
                let data = Data::Pages(&still);
                let periodic = if wraps { data.periodic_edge()? } else { None };
                probe(data, members, &options(periodic), quiet)?
            }
        };
        for field in found.families.iter().flat_map(|family| &family.fields) {
            if all.fields.iter().all(|(name, _)| *name != field.name) {
                all.fields.push((field.name.clone(), field.unit.clone()));
            }
        }
        probes.push(found);
        work.progress.advance(1);
    }
    let mut first = None;
    for (step, found) in probes.into_iter().enumerate() {
        let center = found.center_of_mass.map(DVec3::from);
        first = first.or(center);
        let distance = first.zip(center).map(|(first, now)| nearest(now - first, found.periodic_edge).length());
        let (velocity, dispersion) = velocities(&found).unzip();
        let moment = Moment { step, u: 0.0 };
        all.steps.push(AtStep {
            step,
            time: run.time(moment),
            redshift: run.redshift(moment),
            count: found.count,
            mass: found.mass,
            center: found.center_of_mass,
            distance,
            velocity,
            dispersion,
            means: all.fields.iter().map(|(name, _)| mean(&found, name)).collect(),
        });
    }
    Ok(all)
}

/// Mean velocity and dispersion of all families together.
fn velocities(found: &Probe) -> Option<([f64; 3], f64)> {
    let known = || found.families.iter().filter_map(|family| Some((family.mass, family.velocity?)));
    let mass: f64 = known().map(|(mass, _)| mass).sum();
    if mass.is_nan() || mass <= 0.0 {
        return None;
    }
    let mean = known().map(|(own, velocity)| own * DVec3::from(velocity.mean)).sum::<DVec3>() / mass;
    let squares = known().map(|(own, velocity)| {
        let spread = DVec3::from(velocity.dispersion).length_squared();
        own * (spread + (DVec3::from(velocity.mean) - mean).length_squared())
    });
    Some((mean.to_array(), (squares.sum::<f64>() / mass / 3.0).sqrt()))
}

/// The mean of a field over all families that have it.
fn mean(found: &Probe, name: &str) -> Option<f64> {
    let fields = found.families.iter().flat_map(|family| &family.fields).filter(|field| field.name == name);
    let (sum, count) = fields
        .filter_map(|field| Some((field.mean?, field.count as f64)))
        .fold((0.0, 0.0), |(sum, all), (mean, count)| (sum + mean * count, all + count));
    (count > 0.0).then(|| sum / count)
}

impl OverTime {
    /// Brings places, distances and velocities to the physical frame of each step; means of fields stay as they are. `None` where the run does
    /// not say enough.
    pub fn to_physical(&mut self, run: &RunFile) -> Option<()> {
        for row in &mut self.steps {
            let factors = PhysicalFactors::of(&run.epoch(row.step)?)?;
            let vectors = [(&mut row.center, factors.length), (&mut row.velocity, factors.velocity)];
            vectors.into_iter().for_each(|(vector, factor)| *vector = vector.map(|vector| vector.map(|x| x * factor)));
            row.distance = row.distance.map(|distance| distance * factors.length);
            row.dispersion = row.dispersion.map(|dispersion| dispersion * factors.velocity);
        }
        self.length_unit = self.length_unit.without_scale_factor();
        Some(())
    }

    /// The table as comma-separated values; units are in the header.
    pub fn csv(&self) -> String {
        let unit = |name: &str, unit: &Unit| match unit.is_unknown() {
            true => name.to_owned(),
            false => format!("{name} [{unit}]"),
        };
        let mut header: Vec<String> = ["step", "time", "redshift", "count"].map(str::to_owned).into();
        header.push(unit("mass", &self.mass_unit));
        header.extend(["x", "y", "z", "distance"].map(|name| unit(name, &self.length_unit)));
        header.extend(["vx", "vy", "vz", "velocity-dispersion"].map(str::to_owned));
        header.extend(self.fields.iter().map(|(name, of)| unit(&format!("mean-{name}"), of)));
        let quoted = |name: &String| match name.contains([',', '"']) {
            true => format!("\"{}\"", name.replace('"', "\"\"")),
            false => name.clone(),
        };
        let mut text = header.iter().map(quoted).collect::<Vec<_>>().join(",");
        text.push('\n');
        let number = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
        for row in &self.steps {
            let axes = |vector: Option<[f64; 3]>| [0, 1, 2].map(|axis| number(vector.map(|vector| vector[axis])));
            let mut cells = vec![row.step.to_string(), row.time.to_string(), number(row.redshift)];
            cells.extend([row.count.to_string(), row.mass.to_string()]);
            cells.extend(axes(row.center));
            cells.push(number(row.distance));
            cells.extend(axes(row.velocity));
            cells.push(number(row.dispersion));
            cells.extend(row.means.iter().map(|mean| number(*mean)));
            text.push_str(&cells.join(","));
            text.push('\n');
        }
        text
    }
}
