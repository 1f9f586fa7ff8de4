//! Merger trees as tables: a row for each halo and step, with columns `id`, `step` (or `snapshot`, `snapnum`) or `time`, and `descendant`;
//! positions, `radius`, `mass` and `name` as of catalogues.
//!
//! A descendant is the id of a halo at the next step that the table has; where no two haloes of the table have the same id, at any later
//! step. Empty or -1: there is none.

use super::{Halo, MOST_HALOES, Read, TreeStep, whole};
use crate::explore::ExploreError;
use crate::explore::catalogue::table::{is_radius, key, names};
use crate::import::{FieldKind, open};
use glam::DVec3;
use std::collections::HashMap;
use std::path::Path;

const STEPS: [&str; 4] = ["step", "snapshot", "snapnum", "snap"];
const TIMES: [&str; 3] = ["time", "a", "scale_factor"];
const REDSHIFTS: [&str; 2] = ["redshift", "z_red"];
const DESCENDANTS: [&str; 3] = ["descendant", "desc_id", "descendant_id"];

pub(super) fn read(path: &Path) -> Result<Option<Read>, ExploreError> {
    let Ok(source) = open(path) else { return Ok(None) };
    let about = source.description();
    let [info] = &about.families[..] else { return Ok(None) };
    let field = |names: &[&str]| {
        info.fields.iter().position(|field| field.components == 1 && names.contains(&key(&field.stored_as).as_str()))
    };
    let (step, time) = (field(&STEPS), field(&TIMES));
    let (Some(id), Some(descendant), true) = (info.find(FieldKind::Id), field(&DESCENDANTS), (step.or(time)).is_some())
    else {
        return Ok(None);
    };
    if info.count > MOST_HALOES {
        return Err(ExploreError::malformed(path, "rows", info.count, format!("at most {MOST_HALOES}")));
    }
    let count = info.count as usize;
    let column = |field: Option<usize>| -> Result<Option<Vec<f64>>, ExploreError> {
        let Some(field) = field else { return Ok(None) };
        let mut values = vec![0.0; count];
        source.read(0, field, 0..info.count, &mut values)?;
        Ok(Some(values))
    };
    let mut ids = vec![0; count];
    source.read_ids(0, id, 0..info.count, &mut ids)?;
    let mut positions = vec![[f64::NAN; 3]; count];
    if let Some(position) = info.find(FieldKind::Position) {
        source.read(0, position, 0..info.count, positions.as_flattened_mut())?;
    }
    let radius = column(info.fields.iter().position(|field| field.components == 1 && is_radius(&field.stored_as)))?;
    let (mass, redshift) = (column(info.find(FieldKind::Mass))?, column(field(&REDSHIFTS))?);
    let (step, time, descendant) = (column(step)?, column(time)?, column(Some(descendant))?.unwrap_or_default());
    // A table of haloes need not name them.
    let names = names(path).ok().filter(|names| names.len() == count);
    let wrong = |row: usize, field: &str, found: f64, expected: &str| {
        ExploreError::malformed(path, format!("line {}: {field}", row + 2), found, expected)
    };
    let at = |column: &Option<Vec<f64>>, row: usize| column.as_ref().map(|values| values[row]);
    // Steps by number, without one by time.
    let mut order = Vec::with_capacity(count);
    for row in 0..count {
        let number = match at(&step, row) {
            Some(value) => match whole(value) {
                Ok(Some(number)) => number as f64,
                _ => return Err(wrong(row, "step", value, "a whole number from 0")),
            },
            None => at(&time, row).unwrap_or(f64::NAN),
        };
        let own = at(&time, row).unwrap_or(number);
        if !own.is_finite() || !number.is_finite() {
            return Err(wrong(row, "time", own, "a number"));
        }
        order.push((number, own, row));
    }
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(ids[a.2].cmp(&ids[b.2])));
    let mut steps: Vec<TreeStep> = Vec::new();
    let mut place_of_row = vec![0; count];
    let mut place_of_id: HashMap<(usize, u64), usize> = HashMap::with_capacity(count);
    let mut before = None;
    for (place, (number, time, row)) in order.iter().enumerate() {
        if before != Some(*number) {
            let redshift = at(&redshift, *row).filter(|redshift| redshift.is_finite());
            let name = if step.is_some() { *number as u64 } else { steps.len() as u64 };
            steps.push(TreeStep { number: name, time: *time, redshift, haloes: place..place });
            before = Some(*number);
        }
        let number = steps.len() - 1;
        let last = &mut steps[number];
        if last.time != *time {
            return Err(wrong(*row, "time", *time, &format!("{}, as of others at step {}", last.time, last.number)));
        }
        last.haloes.end = place + 1;
        place_of_row[*row] = place;
        if place_of_id.insert((number, ids[*row]), place).is_some() {
            let field = format!("line {}: id", row + 2);
            return Err(ExploreError::malformed(path, field, ids[*row], "an id that no other halo of the step has"));
        }
    }
    // Where ids are those of the whole run, they say the step, too.
    let mut anywhere: HashMap<u64, usize> = HashMap::with_capacity(count);
    let are_unique = ids.iter().zip(&place_of_row).all(|(id, place)| anywhere.insert(*id, *place).is_none());
    let step_of = |place: usize| steps.partition_point(|step| step.haloes.end <= place);
    let mut haloes = Vec::with_capacity(count);
    for (place, (.., row)) in order.iter().enumerate() {
        let descendant = match whole(descendant[*row]) {
            Ok(None) => None,
            Ok(Some(id)) => {
                let found = match are_unique {
                    true => anywhere.get(&id).copied().filter(|other| step_of(*other) > step_of(place)),
                    false => place_of_id.get(&(step_of(place) + 1, id)).copied(),
                };
                let expected =
                    if are_unique { "the id of a halo of a later step" } else { "the id of a halo of the next step" };
                Some(found.ok_or_else(|| wrong(*row, "descendant", id as f64, expected))?)
            }
            Err(value) => return Err(wrong(*row, "descendant", value, "an id, or -1")),
        };
        haloes.push(Halo {
            id: ids[*row],
            name: names.as_ref().map(|names| names[*row].as_str().into()),
            position: DVec3::from_array(positions[*row]),
            radius: at(&radius, *row),
            mass: at(&mass, *row),
            descendant,
        });
    }
    Ok(Some(Read {
        path: path.into(),
        format: "csv",
        length_unit: about.length_unit.clone(),
        mass_unit: about.mass_unit.clone(),
        box_size: None,
        own: None,
        steps,
        haloes,
    }))
}
