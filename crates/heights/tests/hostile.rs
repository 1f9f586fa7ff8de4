//! Files of heights that were cut or changed, or that are a thousand times as large unpacked: what is wrong with them is said within a second, and
//! takes no more memory than their size allows.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]
#![allow(unsafe_code, reason = "an allocator that counts is unsafe to write")]

use counting::counted;
use deepfield_data::model::SampleType;
use deepfield_heights::export::{ExportOptions, export_heights};
use deepfield_heights::import::{HeightOptions, open_heights, summarize_heights};
use deepfield_heights::model::{HeightField, HeightGrid, Window};
use rand_pcg::Pcg32;
use rand_pcg::rand_core::{Rng, SeedableRng};
use std::io::Write;
use std::path::Path;
use std::time::{Duration, Instant};

#[path = "../../data/tests/support/counting.rs"]
mod counting;
#[path = "../src/import/tests/files.rs"]
mod files;

/// Changed copies of each file.
const CHANGES: u32 = 200;

/// Places that each file is cut at.
const CUTS: usize = 50;

/// Four times the file, and what is read at once.
fn most(bytes: usize) -> usize {
    4 * bytes + (64 << 20)
}

/// A sound file of each format but those of two files, or of a size of their own: its name and its bytes.
fn every(folder: &Path) -> Vec<(&'static str, Vec<u8>)> {
    let grid = HeightGrid { step: [0.5, 0.5], ..HeightGrid::new(9, 7, SampleType::U16) };
    let field =
        HeightField { grid, stored: (0..63).map(|index| f64::from(index * index)).collect(), planes: Vec::new() };
    let exported = ["a.npy", "a.tif", "a.asc", "a.png"].map(|name| {
        let path = folder.join(name);
        export_heights(&field, Window::all(&field.grid), &path, &ExportOptions::default(), &()).unwrap();
        (name, std::fs::read(path).unwrap())
    });
    let archive = files::zip(&[("z.npy", &exported[0].1)]);
    let written = [
        ("a.sur", files::sur(16, false)),
        ("a.sur", files::sur(32, true)),
        ("a.al3d", files::al3d()),
        ("a.frt", files::frt(16)),
        ("a.x3p", files::x3p(("SUR", "SUR"))),
        ("a.grd", files::DSAA.as_bytes().to_vec()),
        ("a.grd", files::dsbb()),
        ("a.grd", files::dsrb()),
        ("a.gwy", files::gwy()),
        ("a.plu", files::plu()),
        ("a.plux", files::plux(files::INDEX, &files::PLUX)),
        ("a.npz", archive),
        ("a.nc", include_bytes!("../src/import/netcdf/gebco.nc").to_vec()),
    ];
    written.into_iter().chain(exported).collect()
}

/// Opens a file of these bytes and reads all of it, within time and memory. What is said of one that cannot be.
fn tried(folder: &Path, name: &str, bytes: &[u8]) -> Option<String> {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    let options = HeightOptions { is_asked: true, ..HeightOptions::default() };
    let attempt = || {
        let begun = Instant::now();
        let (result, took) = counted(|| open_heights(&path, &options).and_then(|source| summarize_heights(&source)));
        assert!(took <= most(bytes.len()), "{name}: {took} bytes of memory for {} of a file", bytes.len());
        (begun.elapsed(), result.err().map(|error| error.to_string()))
    };
    let (mut took, said) = attempt();
    // What others on the machine held up is fast the next time.
    if took > Duration::from_secs(1) {
        took = attempt().0;
    }
    assert!(took <= Duration::from_secs(1), "{name}: {took:?}, {said:?}");
    said
}

#[test]
fn damage_is_told_soon_and_takes_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut random = Pcg32::seed_from_u64(15);
    let mut refused = 0;
    for (name, whole) in every(folder) {
        assert_eq!(tried(folder, name, &whole), None, "{name}");
        for part in 0..CUTS {
            refused += u32::from(tried(folder, name, &whole[..whole.len() * part / CUTS]).is_some());
        }
        for round in 0..CHANGES {
            let mut bytes = whole.clone();
            let among = if round % 2 == 0 { bytes.len() } else { bytes.len().min(600) };
            for _ in 0..1 + random.next_u32() % 8 {
                let at = random.next_u32() as usize % among;
                // Numbers as large as can be are what sizes are made of.
                bytes[at] = if random.next_u32().is_multiple_of(4) { 0xff } else { random.next_u32() as u8 };
            }
            refused += u32::from(tried(folder, name, &bytes).is_some());
        }
    }
    assert!(refused > 500, "{refused}");
    // All but the last sample are there, a thousandth as large: in memory, and in a temporary file what there is more of than may be in memory.
    for [columns, rows] in [[5000, 3000], [12_000, 3000]] {
        let bytes = almost_whole(columns, rows);
        assert!(bytes.len() < 1 << 17, "{}", bytes.len());
        let (stated, found) = (2 * columns * rows, 2 * columns * rows - 2);
        let said = tried(folder, "zeros.sur", &bytes).unwrap();
        let expected =
            format!("compressed samples: found {found} bytes, expected {stated} ({columns} x {rows} of int16)");
        assert!(said.ends_with(&expected), "{said}");
    }
}

/// A packed surface of zeros without its last sample.
fn almost_whole(columns: i32, rows: i32) -> Vec<u8> {
    let samples = vec![0; 2 * (columns * rows - 1) as usize];
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(&samples).unwrap();
    let packed = encoder.finish().unwrap();
    let mut file = files::sur(16, true);
    // Of these the number of streams follows the comment, and their sizes that.
    file.truncate(512 + 10);
    for (at, count) in [(108, columns), (112, rows), (116, columns * rows)] {
        file[at..at + 4].copy_from_slice(&count.to_le_bytes());
    }
    for number in [1, 2 * columns * rows, packed.len() as i32] {
        file.extend(number.to_le_bytes());
    }
    file.extend(packed);
    file
}
