//! Files of instruments against their decoded copies and the numbers that are stated of them.

use super::super::{HeightOptions, open_heights, summarize_heights};
use super::{heights, open, plane};
use crate::model::{Heights, Window};
use std::path::PathBuf;

/// A file of the shared data, where it is at hand.
fn real(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("DEEPFIELD_DATA")?;
    Some(PathBuf::from(folder).join("heightfields").join(name)).filter(|path| path.is_file())
}

/// The heights of a NumPy file of floats.
fn copy(name: &str) -> Vec<f64> {
    let bytes = std::fs::read(real(name).unwrap()).unwrap();
    npyz::NpyFile::new(&bytes[..]).unwrap().into_vec::<f32>().unwrap().into_iter().map(f64::from).collect()
}

/// Whether each is within one step of single precision of its copy.
fn is_copy(found: &[f64], copied: &[f64]) -> bool {
    let step = |value: f64| (f64::from((value.abs() as f32).next_up()) - value.abs()).abs();
    let close = |(a, b): (&f64, &f64)| (a.is_nan() && b.is_nan()) || (a - b).abs() <= step(*b);
    found.len() == copied.len() && found.iter().zip(copied).all(close)
}

/// What is stated of a file: name, format, type, units, columns, rows, valid, min, max, mean, and the sides' lengths.
type Stated = (&'static str, &'static str, &'static str, &'static str, [u64; 3], [f64; 3], [f64; 2]);

const STATED: [Stated; 4] = [
    (
        "sur-2.sur",
        "sur",
        "i32",
        "mm",
        [563, 484, 563 * 484 - 117],
        [0.008912, 0.010388, 0.01015738],
        [1.961492, 1.686256],
    ),
    (
        "al3d-1.al3d",
        "al3d",
        "f32",
        "m",
        [200, 296, 59200],
        [0.0763232, 0.07635815, 0.07634093],
        [8.76054e-5, 0.000129656],
    ),
    ("frt-2.frt", "frt", "u16", "m", [150, 300, 45000 - 12314], [2.636799e-7, 0.0003036518, 7.262714e-5], [0.03, 0.06]),
    (
        "x3p-2.x3p",
        "x3p",
        "f64",
        "m",
        [650, 650, 422500],
        [-3.144207e-7, 2.399155e-7, -2.491824e-9],
        [8.297673e-5, 0.0002044784],
    ),
];

#[test]
fn real_files_are_as_stated() {
    for (name, format, sample_type, unit, [columns, rows, valid], range, sides) in STATED {
        let Some(path) = real(name) else { continue };
        let source = open(&path);
        let found = summarize_heights(&source).unwrap();
        assert_eq!(
            (&*found.format, found.sample_type, found.columns, found.rows),
            (format, sample_type, columns, rows),
            "{name}"
        );
        assert_eq!((&*found.xy_unit.0, &*found.height_unit.0), (unit, unit));
        assert_eq!((found.valid, found.invalid.no_data), (valid, columns * rows - valid), "{name}");
        for (found, stated) in [found.min, found.max, found.mean].into_iter().zip(range) {
            assert!(
                (found - stated).abs() <= 1e-6 * range[0].abs().max(range[1].abs()),
                "{name}: {found}, not {stated}"
            );
        }
        let counts = [columns as f64, rows as f64];
        for axis in 0..2 {
            let side = found.spacing[axis] * counts[axis];
            assert!((side / sides[axis] - 1.0).abs() < 1e-6, "{name}: {side}, not {}", sides[axis]);
        }
        let all = heights(&source);
        if real(&format!("{name}.npy")).is_some() {
            assert!(is_copy(&all, &copy(&format!("{name}.npy"))), "{name} is not its copy");
        }
        // Windows are parts of the whole.
        let window = Window { row: 17, column: 31, rows: 40, columns: 53 };
        let mut part = vec![0.0; window.samples() as usize];
        source.heights(window, &mut part).unwrap();
        for (index, value) in part.iter().enumerate() {
            let at = (window.row as usize + index / 53) * columns as usize + window.column as usize + index % 53;
            assert_eq!(value.to_bits(), all[at].to_bits(), "{name}");
        }
        eprintln!("{name}: {:?}", found.notes);
    }
}

#[test]
fn the_texture_of_a_depth_image_is_its_picture() {
    let (Some(path), Some(picture)) = (real("al3d-1.al3d"), real("al3d-1_texture.png")) else { return };
    let source = open(&path);
    let names: Vec<&str> = source.grid().planes.iter().map(|plane| &*plane.name).collect();
    assert_eq!(names, ["red", "green", "blue", "quality"]);
    let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(picture).unwrap()));
    let mut reader = decoder.read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    for channel in 0..3 {
        let expected: Vec<u8> = pixels.iter().skip(channel).step_by(3).copied().collect();
        assert!(plane(&source, channel) == expected, "plane {channel}");
    }
}

#[test]
fn what_the_user_says_comes_first() {
    let Some(path) = real("frt-2.frt") else { return };
    let options = HeightOptions {
        no_data: Some(0.0),
        spacing: Some([2.0, 3.0]),
        xy_unit: Some(deepfield_data::model::Unit::new("km")),
        ..HeightOptions::default()
    };
    let found = summarize_heights(&open_heights(&path, &options).unwrap()).unwrap();
    assert_eq!((found.spacing, &*found.xy_unit.0, found.invalid.no_data), ([2.0, 3.0], "km", 0));
}

/// Some damage to whole files; small ones of every format have much more.
#[test]
fn damaged_real_files_are_refused_in_one_line() {
    use rand_pcg::Pcg32;
    use rand_pcg::rand_core::{Rng, SeedableRng};
    let mut random = Pcg32::seed_from_u64(7);
    for name in ["sur-2.sur", "al3d-1.al3d", "frt-2.frt", "x3p-2.x3p"] {
        let Some(path) = real(name) else { continue };
        let whole = std::fs::read(path).unwrap();
        for case in 0..12 {
            let mut bytes = whole.clone();
            if case % 2 == 0 {
                bytes.truncate(random.next_u32() as usize % whole.len());
            } else {
                for _ in 0..20 {
                    let at = random.next_u32() as usize % if case % 4 == 1 { 1024 } else { whole.len() };
                    bytes[at] = random.next_u32() as u8;
                }
            }
            let (_folder, path) = super::file_of(name, &bytes);
            let read = open_heights(&path, &HeightOptions::default()).and_then(|source| summarize_heights(&source));
            if let Err(error) = read {
                let text = error.to_string();
                assert!(text.contains(name) && text.contains("expected") && !text.contains('\n'), "{text}");
            }
        }
    }
}
