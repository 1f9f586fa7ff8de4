//! Whether the steps of a run fit together: units, the periodic box and attributes.

use super::RunStep;
use crate::import::folder::name_of;
use crate::import::{Description, ImportError, attributes};
use crate::model::{FamilyName, Unit};
use std::collections::{BTreeMap, BTreeSet};

/// Edges of periodic boxes that differ by no more than this share are the same.
const SAME_EDGE: f64 = 1e-6;

/// Sets how many of the first step's lengths and masses one of each step's own is.
///
/// # Errors
/// [`ImportError`] where units have no known ratio, or edges of periodic boxes differ.
pub(super) fn scale(steps: &mut [RunStep], notes: &mut Vec<String>) -> Result<(), ImportError> {
    let Some((first, others)) = steps.split_first_mut() else { return Ok(()) };
    let first = &first.about;
    for step in others {
        let about = &step.about;
        let converted = |what: &str, own: &Unit, usual: &Unit| match own.ratio(usual) {
            _ if own == usual => Ok((1.0, None)),
            Some(ratio) => {
                // Names of the same unit.
                let told = (ratio != 1.0).then(|| format!("{what} in {own} are converted to {usual}"));
                Ok((ratio, told))
            }
            None => {
                let expected = format!("{usual} as in {}", name_of(&first.path));
                Err(ImportError::malformed(&about.path, format!("unit of {what}"), own, expected))
            }
        };
        let (length, lengths) = converted("lengths", &about.length_unit, &first.length_unit)?;
        let (mass, masses) = converted("masses", &about.mass_unit, &first.mass_unit)?;
        let told = [lengths, masses].into_iter().flatten();
        notes.extend(told.map(|what| format!("{}: {what}", name_of(&about.path))));
        (step.length, step.mass) = (length, mass);
        let edge = |size: Option<f64>| size.map_or("none".to_owned(), |size| size.to_string());
        let own = about.box_size.map(|size| size * length);
        let is_same = match (own, first.box_size) {
            (Some(own), Some(usual)) => (own - usual).abs() <= SAME_EDGE * usual.abs(),
            (own, usual) => own == usual,
        };
        if !is_same {
            let expected = format!("{} as in {}", edge(first.box_size), name_of(&first.path));
            return Err(ImportError::malformed(&about.path, "box size", edge(own), expected));
        }
    }
    Ok(())
}

/// The attributes that a family has in some of the steps that it is in, and not in all of them; each with a step that lacks it.
fn differing(steps: &[RunStep]) -> BTreeMap<String, usize> {
    let names = |about: &Description, family: FamilyName| -> Option<BTreeSet<String>> {
        let info = about.families.iter().find(|info| info.name == family)?;
        Some(attributes::available_in(info))
    };
    let families: BTreeSet<FamilyName> =
        steps.iter().flat_map(|step| step.about.families.iter().map(|info| info.name)).collect();
    let mut found = BTreeMap::new();
    for family in families {
        let there: Vec<(usize, BTreeSet<String>)> =
            (0..steps.len()).filter_map(|number| Some((number, names(&steps[number].about, family)?))).collect();
        let all: BTreeSet<&String> = there.iter().flat_map(|(_, names)| names).collect();
        for name in all {
            if let Some((lacking, _)) = there.iter().find(|(_, names)| !names.contains(name)) {
                found.entry(name.clone()).or_insert(*lacking);
            }
        }
    }
    found
}

/// The attributes that are left out because only some steps have them.
///
/// # Errors
/// [`ImportError`] where one of them was asked for.
pub(super) fn left_out(
    steps: &[RunStep],
    wanted: Option<&[String]>,
    notes: &mut Vec<String>,
) -> Result<Vec<String>, ImportError> {
    let differing = differing(steps);
    for name in wanted.unwrap_or_default() {
        if let Some(lacking) = differing.get(name) {
            let expected = "it in every step, since it was asked for";
            return Err(ImportError::missing(&steps[*lacking].about.path, format!("attribute {name}"), expected));
        }
    }
    for (name, lacking) in &differing {
        let path = name_of(&steps[*lacking].about.path);
        notes.push(format!("attribute {name} is left out: {path} lacks it"));
    }
    Ok(differing.into_keys().collect())
}
