//! Files that are cut and changed: an answer or one line, never a panic.

use super::super::{HeightOptions, open_heights, summarize_heights};
use crate::model::{Heights, Window};
use rand_pcg::Pcg32;
use rand_pcg::rand_core::{Rng, SeedableRng};
use rayon::prelude::*;
use std::fs::File;
use std::io::{Seek, Write};
use std::ops::Range;
use std::path::PathBuf;

/// Changed copies of the files of every format, unless `DEEPFIELD_MUTATIONS` has another number.
const MUTATIONS: usize = 100_000;

/// Places of its body that a file is cut at.
const CUTS: usize = 1000;

/// Cuts, or changed copies, that are tried one after another in the same place.
const AT_ONCE: usize = 500;

/// A file without damage: its name, its bytes, and which of these are its header.
pub(in crate::import) type Seed<'a> = (&'a str, &'a [u8], Range<usize>);

/// Cuts files of a format at every byte of their headers and at places of their bodies, and changes copies of them at random. Every one opens or is
/// refused in one line that names it. `is_own` formats are read by nothing but this crate, so that even a caught panic is an error.
pub(in crate::import) fn hostile(seeds: &[Seed<'_>], is_own: bool) {
    for seed in seeds {
        tried(seed, None, mutations().div_ceil(seeds.len()), is_own);
    }
}

/// The same for a format whose files lie in pairs: of the file that is opened, and beside it the one that is damaged.
pub(in crate::import) fn hostile_beside(opened: (&str, &[u8]), seed: Seed<'_>, is_own: bool) {
    tried(&seed, Some(opened), mutations(), is_own);
}

fn mutations() -> usize {
    std::env::var("DEEPFIELD_MUTATIONS").ok().and_then(|number| number.parse().ok()).unwrap_or(MUTATIONS)
}

fn tried(seed: &Seed<'_>, opened: Option<(&str, &[u8])>, mutations: usize, is_own: bool) {
    let (name, whole, header) = (seed.0, seed.1, seed.2.start..seed.2.end.min(seed.1.len()));
    let mut ends: Vec<usize> = (0..CUTS).map(|place| place * whole.len() / CUTS).chain(header.clone()).collect();
    ends.sort_unstable();
    ends.dedup();
    // From the longest on: a file that is only made shorter is not written again.
    ends.reverse();
    let cut = ends.par_chunks(AT_ONCE).map(|ends| {
        let mut target = Target::new(name, opened, is_own);
        target.write(whole);
        let opened = ends.iter().filter(|end| {
            target.file.set_len(**end as u64).unwrap();
            target.attempt(true)
        });
        opened.count()
    });
    let changed = (0..mutations.div_ceil(AT_ONCE)).into_par_iter().map(|part| {
        let mut target = Target::new(name, opened, is_own);
        let mut random = Pcg32::seed_from_u64((whole.len() + (part << 32)) as u64);
        let mut bytes = Vec::new();
        let cases = AT_ONCE.min(mutations - part * AT_ONCE);
        let opened = (0..cases).filter(|case| {
            bytes.clear();
            bytes.extend_from_slice(whole);
            // Headers are short, and say most.
            let part = if case % 3 == 0 { 0..whole.len() } else { header.clone() };
            for _ in 0..1 + random.next_u32() % 8 {
                change(&mut bytes, &part, &mut random);
            }
            target.write(&bytes);
            target.attempt(false)
        });
        opened.count()
    });
    let (tries, opened) = (ends.len() + mutations, cut.sum::<usize>() + changed.sum::<usize>());
    eprintln!("{name}: {opened} opened, {} refused", tries - opened);
    assert!(opened < tries, "{name}: nothing was refused");
}

/// What stands at the ends of ranges of lengths and offsets.
const EXTREMES: [u64; 10] =
    [0, 1, 0x7fff, 0x8000, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, i64::MAX as u64, 1 << 63, u64::MAX];

/// What stands in place of a digit.
const SIGNS: [u8; 10] = *b"019-+.eE, ";

/// Changes something in a part.
fn change(bytes: &mut [u8], part: &Range<usize>, random: &mut Pcg32) {
    let mut any = |below: usize| random.next_u32() as usize % below;
    let at = part.start + any(part.len());
    match any(8) {
        0 => bytes[at] = 0,
        1 => bytes[at] = 255,
        2 => bytes[at] ^= 1 << any(8),
        3 | 4 => bytes[at] = any(256) as u8,
        // A whole number of two, four or eight bytes, mostly where one begins.
        5 => {
            let len = 2 << any(3);
            let at = if any(4) == 0 { at } else { at - at % len.min(4) };
            let value = EXTREMES[any(EXTREMES.len())];
            let value = if any(2) == 0 { value.to_le_bytes() } else { (value << (64 - 8 * len)).to_be_bytes() };
            bytes[at..].iter_mut().zip(&value[..len]).for_each(|(byte, value)| *byte = *value);
        }
        // The next number that is written out.
        6 => {
            if let Some(digit) = bytes[at..].iter_mut().find(|byte| byte.is_ascii_digit()) {
                *digit = SIGNS[any(SIGNS.len())];
            }
        }
        // A few bytes of another place.
        _ => {
            let from = any(bytes.len());
            let len = (1 + any(16)).min(bytes.len() - from.max(at));
            bytes.copy_within(from..from + len, at);
        }
    }
}

/// A file that is written again and again, in a folder of its own: that takes a small part of the time of a new one.
struct Target {
    folder: tempfile::TempDir,
    file: File,
    opened: PathBuf,
    is_own: bool,
}

impl Target {
    /// With the file beside it that is opened in its place.
    fn new(name: &str, opened: Option<(&str, &[u8])>, is_own: bool) -> Target {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        let file = File::create(&path).unwrap();
        let opened = opened.map(|(name, bytes)| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        });
        Target { opened: opened.unwrap_or(path), folder, file, is_own }
    }

    /// Bytes that are as many each time.
    fn write(&mut self, bytes: &[u8]) {
        self.file.rewind().unwrap();
        self.file.write_all(bytes).unwrap();
    }

    /// Opens and reads the file; whether that went well.
    fn attempt(&self, is_cut: bool) -> bool {
        let options = HeightOptions { is_asked: true, ..HeightOptions::default() };
        let read = || {
            let source = open_heights(&self.opened, &options)?;
            let grid = source.grid();
            let window = Window { rows: grid.rows.min(3), columns: grid.columns.min(100), row: 0, column: 0 };
            let mut values = vec![0; window.samples() as usize];
            for plane in 0..grid.planes.len() {
                source.plane(plane, window, &mut values).map_err(|error| error.to_string()).unwrap_or(());
            }
            summarize_heights(&source).map(|summary| serde_json::to_string(&summary).unwrap())
        };
        match read() {
            Ok(json) => {
                assert!(!json.contains('\n'), "{json}");
                true
            }
            Err(error) => {
                let text = error.to_string();
                assert!(!text.chars().any(char::is_control), "{text:?}");
                assert!(text.contains(self.folder.path().to_str().unwrap()), "{text}");
                assert!(!is_cut || text.contains("expected"), "{text}");
                assert!(!(self.is_own && text.contains("gave up")), "{text}");
                assert!(text.len() < 2000, "{text}");
                false
            }
        }
    }
}
