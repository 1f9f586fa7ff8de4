//! The history of a halo: what it was and what it becomes, along the heaviest progenitors.

use super::MergerTree;
use serde::Serialize;
use std::fmt::Write as _;

/// A halo at a step of its history.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HaloAtStep {
    /// The step's number in the files.
    pub step: u64,
    /// Its time.
    pub time: f64,
    /// Its redshift, where the files say it.
    pub redshift: Option<f64>,
    /// The halo's number at that step.
    pub id: u64,
    /// Its name there.
    pub name: String,
    /// Where it is.
    pub position: [f64; 3],
    /// How large it is.
    pub radius: Option<f64>,
    /// Its mass.
    pub mass: Option<f64>,
    /// How many other haloes have merged into it since its main progenitor's step.
    pub mergers: usize,
    /// What these weighed together.
    pub merged_mass: f64,
}

impl MergerTree {
    /// The history of a halo, in the order of time: back along main progenitors, which are the heaviest ones, and on along descendants.
    pub fn history(&self, halo: usize) -> Vec<HaloAtStep> {
        // Every link leads to another step.
        let back = std::iter::successors(Some(halo), |halo| self.main_progenitor(*halo));
        let on = std::iter::successors(self.haloes[halo].descendant, |halo| self.haloes[*halo].descendant);
        let mut chain: Vec<usize> = back.collect();
        chain.reverse();
        chain.extend(on);
        let at = |(place, number): (usize, &usize)| {
            let (halo, step) = (&self.haloes[*number], &self.steps[self.step_of(*number)]);
            let before = place.checked_sub(1).map(|before| chain[before]);
            let merged = || self.progenitors(*number).iter().filter(move |other| Some(**other as usize) != before);
            HaloAtStep {
                step: step.number,
                time: step.time,
                redshift: step.redshift,
                id: halo.id,
                name: self.name(halo),
                position: halo.position.to_array(),
                radius: halo.radius,
                mass: halo.mass,
                mergers: merged().count(),
                merged_mass: merged()
                    .filter_map(|other| self.haloes[*other as usize].mass)
                    .fold(0.0, |sum, mass| sum + mass),
            }
        };
        chain.iter().enumerate().map(at).collect()
    }
}

/// A history as comma-separated values; units are in the header.
pub fn csv(tree: &MergerTree, history: &[HaloAtStep]) -> String {
    let unit = |name: &str, unit: &crate::model::Unit| match unit.is_unknown() {
        true => name.to_owned(),
        false => format!("{name} [{unit}]"),
    };
    let lengths = ["x", "y", "z", "radius"].map(|name| unit(name, &tree.length_unit)).join(",");
    let masses = ["mass", "merged-mass"].map(|name| unit(name, &tree.mass_unit));
    let mut text = format!("step,time,redshift,id,name,{lengths},{},mergers,{}\n", masses[0], masses[1]);
    let number = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
    for row in history {
        let name = if row.name.contains([',', '"', '\n', '\r']) {
            format!("\"{}\"", row.name.replace('"', "\"\"").replace(['\n', '\r'], " "))
        } else {
            row.name.clone()
        };
        let [x, y, z] = row.position;
        let (redshift, radius, mass) = (number(row.redshift), number(row.radius), number(row.mass));
        // Writing to a string cannot fail.
        let _ = write!(text, "{},{},{redshift},{},{name},{x},{y},{z},{radius},{mass}", row.step, row.time, row.id);
        let _ = writeln!(text, ",{},{}", row.mergers, row.merged_mass);
    }
    text
}
