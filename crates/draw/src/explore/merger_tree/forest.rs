//! Trees of consistent-trees (Behroozi et al. 2013), `tree_I_J_K.dat`: a header as that of lists of Rockstar, a line with the number of trees, and of each
//! `#tree ID` and its haloes at all steps, in any order. `desc_id` is the id of a halo at the next step, as no other of the run has it; -1: there is none.

use super::series::Places;
use super::{Halo, MOST_HALOES, Read, TreeStep};
use crate::explore::ExploreError;
use crate::explore::catalogue::halo_text::{Heading, Lines, Stated};
use glam::DVec3;
use std::collections::HashMap;
use std::path::Path;

/// A halo before all steps are known.
struct Row {
    scale: f64,
    id: u64,
    descendant: Option<u64>,
    /// Place, mass and radius.
    values: [f64; 5],
}

/// The haloes of a file of trees.
pub(super) fn read(path: &Path) -> Result<Read, ExploreError> {
    let mut lines = Lines::open(path)?;
    let missing = |name: &str| ExploreError::missing(path, name, "a column of that name");
    let heading = Heading::read(&mut lines).ok_or_else(|| missing("id"))?;
    let column = |name: &str| heading.column(name).ok_or_else(|| missing(name));
    let (scale, id, descendant) = (column("scale")?, column("id")?, column("desc_id")?);
    let step = heading.column("snap_num").or_else(|| heading.column("snap_idx"));
    let mut stated = Stated::default();
    // How many trees there should be, and how many there are.
    let (mut said, mut trees): (Option<u64>, u64) = (None, 0);
    // The numbers of steps, by their scale factors.
    let mut numbers: HashMap<u64, u64> = HashMap::new();
    let mut rows: Vec<Row> = Vec::new();
    while let Some(line) = lines.row()? {
        if let Some(comment) = line.strip_prefix('#') {
            trees += u64::from(comment.starts_with("tree "));
            stated.learn(comment);
            continue;
        }
        let word = line.trim();
        if said.is_none() && trees == 0 && !word.is_empty() {
            said = Some(word.parse().map_err(|_| lines.wrong("number of trees", word, "a whole number from 0"))?);
            continue;
        }
        let Some((words, values)) = heading.row(&lines, &line)? else { continue };
        let word = |column: usize| words.get(column).copied().unwrap_or("nothing");
        let whole = |name: &str, column: usize| -> Result<u64, ExploreError> {
            word(column).parse().map_err(|_| lines.wrong(name, word(column), "a whole number from 0"))
        };
        let time = word(scale).parse().ok().filter(|time: &f64| *time > 0.0 && time.is_finite());
        let time = time.ok_or_else(|| lines.wrong("scale", word(scale), "a number above 0"))?;
        let becomes = match word(descendant) {
            "-1" => None,
            _ => Some(whole("desc_id", descendant)?),
        };
        if let Some(step) = step {
            numbers.entry(time.to_bits()).or_insert(whole("number of the step", step)?);
        }
        if rows.len() as u64 == MOST_HALOES {
            return Err(ExploreError::malformed(path, "haloes", "more", format!("at most {MOST_HALOES}")));
        }
        rows.push(Row { scale: time, id: whole("id", id)?, descendant: becomes, values });
    }
    if let Some(said) = said.filter(|said| *said != trees) {
        let expected = format!("{said}, as the line before the first says");
        return Err(ExploreError::malformed(path, "trees", trees, expected));
    }
    let (length_unit, mass_unit, factor) = heading.units(path, &stated)?;
    rows.sort_unstable_by(|a, b| a.scale.total_cmp(&b.scale).then(a.id.cmp(&b.id)));
    let halo = |Row { id, values: [x, y, z, mass, radius], .. }: &Row| Halo {
        id: *id,
        name: None,
        position: DVec3::new(*x, *y, *z),
        radius: Some(radius * factor),
        mass: Some(*mass),
        descendant: None,
    };
    let mut haloes: Vec<Halo> = rows.iter().map(halo).collect();
    let places = Places::of(path, &haloes, 0..haloes.len())?;
    for (halo, row) in haloes.iter_mut().zip(&rows) {
        let Some(id) = row.descendant else { continue };
        let field = || format!("desc_id of halo {}", row.id);
        let expected = "-1, or the id of a halo of a later step";
        halo.descendant = Some(places.find(id).ok_or_else(|| ExploreError::malformed(path, field(), id, expected))?);
    }
    let mut steps: Vec<TreeStep> = Vec::new();
    for own in rows.chunk_by(|a, b| a.scale == b.scale) {
        let (first, time) = (steps.last().map_or(0, |step| step.haloes.end), own[0].scale);
        let number = numbers.get(&time.to_bits()).copied().unwrap_or(steps.len() as u64);
        let haloes = first..first + own.len();
        steps.push(TreeStep { number, time, redshift: Some(1.0 / time - 1.0), haloes });
    }
    let read = Read::new(path, "consistent-trees");
    Ok(Read { length_unit, mass_unit, box_size: stated.box_size, steps, haloes, ..read })
}
