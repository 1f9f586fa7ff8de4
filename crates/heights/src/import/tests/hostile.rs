//! Files that are cut and changed: an answer or one line, never a panic.

use super::super::{HeightOptions, open_heights, summarize_heights};
use crate::model::{Heights, Window};
use rand_pcg::Pcg32;
use rand_pcg::rand_core::{Rng, SeedableRng};
use std::path::Path;

/// Changed copies of every file.
const MUTATIONS: u32 = 2000;

/// Places of its body that a file is cut at.
const CUTS: u64 = 200;

/// Cuts a file at every byte of its header, which is so many bytes, and at places of its body, and changes copies of it at random. Every one opens or
/// is refused in one line that names it. `is_own` formats are read by nothing but this crate, so that even a caught panic is an error.
pub(in crate::import) fn hostile(name: &str, whole: &[u8], header: usize, is_own: bool) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    let mut random = Pcg32::seed_from_u64(whole.len() as u64);
    let (mut opened, mut refused) = (0, 0);
    let mut count = |is_open: bool| if is_open { opened += 1 } else { refused += 1 };
    let header = header.min(whole.len());
    for end in 0..header {
        count(attempt(&path, &whole[..end], true, is_own));
    }
    for _ in 0..CUTS {
        let body = (whole.len() - header).max(1) as u64;
        let end = header + (u64::from(random.next_u32()) % body) as usize;
        count(attempt(&path, &whole[..end.min(whole.len())], true, is_own));
    }
    for case in 0..MUTATIONS {
        let mut bytes = whole.to_vec();
        let reach = if case % 2 == 0 { header } else { bytes.len() };
        for _ in 0..1 + random.next_u32() % 8 {
            let at = random.next_u32() as usize % reach.max(1);
            bytes[at] = match random.next_u32() % 4 {
                0 => 0,
                1 => 255,
                2 => bytes[at] ^ (1 << (random.next_u32() % 8)),
                _ => random.next_u32() as u8,
            };
        }
        count(attempt(&path, &bytes, false, is_own));
    }
    eprintln!("{name}: {opened} opened, {refused} refused");
    assert!(refused > 0, "{name}: nothing was refused");
}

/// Opens and reads a file of these bytes; whether that went well.
fn attempt(path: &Path, bytes: &[u8], is_cut: bool, is_own: bool) -> bool {
    // A new file each time: one that is written over waits for the disk.
    let _ = std::fs::remove_file(path);
    std::fs::write(path, bytes).unwrap();
    let options = HeightOptions { is_asked: true, ..HeightOptions::default() };
    let read = || {
        let source = open_heights(path, &options)?;
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
            let name = path.file_name().unwrap().to_str().unwrap();
            assert!(!text.chars().any(char::is_control), "{text:?}");
            assert!(text.contains(name), "{text}");
            assert!(!is_cut || text.contains("expected"), "{text}");
            assert!(!(is_own && text.contains("gave up")), "{text}");
            assert!(text.len() < 2000, "{text}");
            false
        }
    }
}
