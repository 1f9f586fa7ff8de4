//! Merger trees of AHF (Knollmann and Knebe 2009): lists `NAME_NNN.zZ.AHF_halos`, a step each, and beside them what its `MergerTree` writes,
//! `NAME_NNN.zZ.AHF_mtree`: of every halo the haloes of the step before whose particles it has.
//!
//! Behind comments there is for each halo a row with its number, perhaps how many particles it has, and how many progenitors; and for each of these a
//! row with its number, or with the particles that both have, its number, and how many it has (and what that is worth). As a halo may stand below
//! several, it becomes the one for which shared^2 / (own x other) is largest; where numbers alone are told, the one below which it stands first.

use super::series::{Places, beside};
use super::{Halo, Read};
use crate::explore::ExploreError;
use crate::explore::catalogue::halo_text::{self, Lines};
use std::ops::Range;
use std::path::{Path, PathBuf};

const HALOES: &str = ".AHF_halos";
const LINKS: &str = ".AHF_mtree";

/// What the name of a list says.
struct Name<'a> {
    /// What stands before the number of the step, which is that of all steps of a run.
    run: &'a str,
    number: Option<u64>,
    /// The scale factor.
    time: f64,
}

/// The parts of `NAME_NNN.zZ.AHF_halos` or `NAME_NNN.0000.zZ.AHF_halos`, the number of the process that wrote it.
fn name_of(path: &Path) -> Option<Name<'_>> {
    let (before, redshift) = path.file_name()?.to_str()?.strip_suffix(HALOES)?.rsplit_once(".z")?;
    let time = redshift.parse().ok().map(|redshift: f64| 1.0 / (1.0 + redshift))?;
    let is_process = |part: &str| part.len() == 4 && part.bytes().all(|digit| digit.is_ascii_digit());
    let before = before.rsplit_once('.').filter(|(_, part)| is_process(part)).map_or(before, |(before, _)| before);
    let run = before.trim_end_matches(|letter: char| letter.is_ascii_digit());
    (time > 0.0 && time.is_finite()).then(|| Name { run, number: before[run.len()..].parse().ok(), time })
}

/// The file of the links from a list to that of the step before, where it is there.
fn links_of(list: &Path) -> Option<PathBuf> {
    let name = list.file_name()?.to_str()?.strip_suffix(HALOES)?;
    Some(list.with_file_name(format!("{name}{LINKS}"))).filter(|links| links.is_file())
}

/// The lists of which the file is one; `None` where there are no links between them.
pub(super) fn series(path: &Path) -> Result<Option<Read>, ExploreError> {
    let Some(own) = name_of(path) else { return Ok(None) };
    // Of positive numbers the bits are in their order.
    let time_of = |file: &Path| Some(name_of(file).filter(|name| name.run == own.run)?.time.to_bits());
    let files = beside(path, time_of, |_| false);
    if files.len() < 2 || files.iter().all(|(_, file)| links_of(file).is_none()) {
        return Ok(None);
    }
    let mut read = Read::new(path, "ahf");
    let (mut before, mut places_before) = (0..0, Places::default());
    for (place, (time, file)) in files.iter().enumerate() {
        let list = halo_text::haloes(file)?.filter(|list| list.format == read.format);
        let list = list.ok_or_else(|| ExploreError::missing(file, "header", "names of columns as of AHF"))?;
        (read.length_unit, read.mass_unit) = (list.length_unit, list.mass_unit);
        let number = name_of(file).and_then(|name| name.number).unwrap_or(place as u64);
        let time = f64::from_bits(*time);
        if time == own.time {
            read.own = Some(number);
        }
        let haloes = read.push(file, (number, time), "Halo", list.objects)?;
        let places = Places::of(file, &read.haloes, haloes.clone())?;
        // Those of the first list lead to haloes of which there is none.
        if let Some(links) = links_of(file).filter(|_| !before.is_empty()) {
            link(&links, &mut read.haloes, (&places_before, before), &places)?;
        }
        (before, places_before) = (haloes, places);
    }
    Ok(Some(read))
}

/// A halo whose progenitors are being read.
struct Open {
    place: usize,
    /// How many particles it has, where that is told.
    particles: Option<u64>,
    /// Progenitors that are read, and how many there should be.
    read: u64,
    all: u64,
}

/// Reads the links to haloes of the step `before`.
fn link(
    path: &Path,
    haloes: &mut [Halo],
    (places_before, before): (&Places, Range<usize>),
    places: &Places,
) -> Result<(), ExploreError> {
    let mut lines = Lines::open(path)?;
    // What the link of each halo of the step before is worth so far.
    let mut worths = vec![0.0; before.len()];
    let mut open = Open { place: 0, particles: None, read: 0, all: 0 };
    while let Some(line) = lines.row()? {
        if line.starts_with('#') {
            continue;
        }
        let words: Vec<&str> = line.split_whitespace().collect();
        let number = |name: &str, word: &str| -> Result<u64, ExploreError> {
            word.parse().map_err(|_| lines.wrong(name, word, "a whole number from 0"))
        };
        let is_done = open.read == open.all;
        match words[..] {
            [] => {}
            // How many haloes there are; some versions count those without progenitors, too, which have no row.
            [count] if is_done => _ = number("number of haloes", count)?,
            [id, all] | [id, _, all] if is_done => {
                let place = places.find(number("HaloID", id)?);
                let place = place.ok_or_else(|| lines.wrong("HaloID", id, "a halo of the list"))?;
                let particles = (words.len() == 3).then(|| number("HaloPart", words[1])).transpose()?;
                open = Open { place, particles, read: 0, all: number("NumProgenitors", all)? };
            }
            [id] | [_, id, _] | [_, id, _, _] if !is_done => {
                let place = places_before.find(number("HaloID of a progenitor", id)?);
                let expected = "a halo of the list of the step before";
                let place = place.ok_or_else(|| lines.wrong("HaloID of a progenitor", id, expected))?;
                let worth = match (open.particles, &words[..]) {
                    (Some(own), [shared, _, other, ..]) => {
                        let shared = number("SharedPart", shared)? as f64;
                        shared * shared / (own as f64 * number("HaloPart", other)? as f64).max(1.0)
                    }
                    _ => 1.0 / (1.0 + open.read as f64),
                };
                let best = &mut worths[place - before.start];
                if worth > *best {
                    (*best, haloes[place].descendant) = (worth, Some(open.place));
                }
                open.read += 1;
            }
            _ => {
                let expected = if is_done { "2 or 3, of a halo" } else { "1, 3 or 4, of a progenitor" };
                return Err(lines.wrong("values", &words.len().to_string(), expected));
            }
        }
    }
    if open.read != open.all {
        let (found, expected) = (open.read, format!("{}, as stands before them", open.all));
        return Err(ExploreError::malformed(path, "progenitors of the last halo", found, expected));
    }
    Ok(())
}
