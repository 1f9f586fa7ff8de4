//! Files of the format's own library, and files made here byte by byte, in which frames are what the schema says; damage is an error.

use crate::import::{FieldKind, LoadOptions, RunOptions, Source, load, open, open_run, step_name, steps_in, summarize};
use crate::model::ReadMethod;
use proptest::prelude::*;
use std::path::{Path, PathBuf};

/// A chunk: its name, columns, type, and the bytes of its rows.
struct Chunk(&'static str, usize, u8, Vec<u8>);

fn floats(name: &'static str, columns: usize, values: impl IntoIterator<Item = f32>) -> Chunk {
    Chunk(name, columns, 9, values.into_iter().flat_map(f32::to_le_bytes).collect())
}

fn whole(name: &'static str, values: impl IntoIterator<Item = u32>) -> Chunk {
    Chunk(name, 1, 3, values.into_iter().flat_map(u32::to_le_bytes).collect())
}

/// A file of these frames in version 1 or 2 of the file layer, with room for three more entries.
fn written(version: u32, frames: &[Vec<Chunk>]) -> Vec<u8> {
    let mut names: Vec<&str> = Vec::new();
    let (mut data, mut index): (Vec<u8>, Vec<u8>) = (vec![0; 256], Vec::new());
    for (number, frame) in frames.iter().enumerate() {
        for Chunk(name, columns, kind, bytes) in frame {
            let place = names.iter().position(|own| own == name).unwrap_or_else(|| {
                names.push(name);
                names.len() - 1
            });
            let size = [0, 1, 2, 4, 8, 1, 2, 4, 8, 4, 8, 1][usize::from(*kind)];
            for word in [number, bytes.len() / size / columns, data.len()] {
                index.extend((word as u64).to_le_bytes());
            }
            index.extend((*columns as u32).to_le_bytes());
            index.extend((place as u16).to_le_bytes());
            index.extend([*kind, 0]);
            data.extend(bytes);
        }
    }
    index.resize(index.len() + 96, 0);
    let width = if version == 1 { 64 } else { 0 };
    let mut list: Vec<u8> = Vec::new();
    for name in names {
        let end = list.len() + width.max(name.len() + 1);
        list.extend(name.as_bytes());
        list.resize(end, 0);
    }
    list.resize((list.len() / 64 + 1) * 64, 0);
    let numbers = [0x65df_65df_65df_65df, data.len() + list.len(), index.len() / 32, data.len(), list.len() / 64];
    let head: Vec<u8> = numbers.into_iter().flat_map(|number| (number as u64).to_le_bytes()).collect();
    data[..40].copy_from_slice(&head);
    data[44..48].copy_from_slice(&(version << 16).to_le_bytes());
    data[112..117].copy_from_slice(b"hoomd");
    [data, list, index].concat()
}

fn file(folder: &Path, bytes: &[u8]) -> PathBuf {
    let path = folder.join("movie.gsd");
    std::fs::write(&path, bytes).unwrap();
    path
}

/// Every value of a field, read so many particles at a time; `None` where there is no such field.
fn values(source: &dyn Source, family: usize, name: &str, step: u64) -> Option<Vec<f64>> {
    let info = &source.description().families[family];
    let field = info.named(name)?;
    let mut all = Vec::new();
    for start in (0..info.count).step_by(step as usize) {
        let range = start..info.count.min(start + step);
        let mut out = vec![f64::NAN; (range.end - range.start) as usize * info.fields[field].components];
        source.read(family, field, range, &mut out).unwrap();
        all.extend(out);
    }
    Some(all)
}

fn ids(source: &dyn Source, family: usize) -> Option<Vec<u64>> {
    let info = &source.description().families[family];
    let mut out = vec![0; info.count as usize];
    source.read_ids(family, info.find(FieldKind::Id)?, 0..info.count, &mut out).unwrap();
    Some(out)
}

/// The numbers of row `row` in frame `frame`, of columns from `first` on.
fn numbers<const N: usize>(frame: usize, row: usize, first: usize) -> [f32; N] {
    std::array::from_fn(|column| ((frame * 31 + row * 7 + (first + column) * 3) % 11) as f32 * 0.5 - 2.5)
}

fn type_of(frame: usize, row: usize) -> usize {
    (frame + row * row) % 2
}

/// What a frame stores of types, places, velocities and charges.
type Stored = (usize, [bool; 4]);

fn sample(version: u32, frames: &[Stored], is_cube: bool) -> Vec<u8> {
    let frame = |(frame, (count, has)): (usize, &Stored)| {
        let rows = 0..*count;
        let tilt = if is_cube { 0.0 } else { 0.5 };
        let mut chunks = vec![
            Chunk("configuration/step", 1, 4, (10 * frame as u64).to_le_bytes().to_vec()),
            floats("configuration/box", 1, [8.0, 8.0, 8.0, tilt, 0.0, 0.0]),
            whole("particles/N", [*count as u32]),
            Chunk("particles/types", 6, 5, b"A\0\0\0\0\0Long_b".to_vec()),
        ];
        let stored = [
            whole("particles/typeid", rows.clone().map(|row| type_of(frame, row) as u32)),
            floats("particles/position", 3, rows.clone().flat_map(|row| numbers::<3>(frame, row, 0))),
            floats("particles/velocity", 3, rows.clone().flat_map(|row| numbers::<3>(frame, row, 3))),
            floats("particles/charge", 1, rows.flat_map(|row| numbers::<1>(frame, row, 6))),
        ];
        chunks.extend(stored.into_iter().zip(has).filter(|(_, has)| **has).map(|(chunk, _)| chunk));
        chunks
    };
    written(version, &frames.iter().enumerate().map(frame).collect::<Vec<_>>())
}

proptest! {
    #![proptest_config(crate::cases::cases(48))]

    #[test]
    fn frames_are_what_the_schema_says(
        frames in prop::collection::vec((1..9usize, any::<[bool; 4]>()), 1..5),
        (version, step, is_cube) in (1..3u32, 1..5u64, any::<bool>()),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = file(folder.path(), &sample(version, &frames, is_cube));
        prop_assert_eq!(steps_in(&path).unwrap(), frames.len() as u64);
        let keeps_count = frames.iter().all(|(count, _)| *count == frames[0].0);
        for (number, (count, has)) in frames.iter().enumerate() {
            // The frame whose chunk holds.
            let owner = |what: usize| {
                let of_first = (frames[0].1[what] && frames[0].0 == *count).then_some(0);
                if has[what] { Some(number) } else { of_first }
            };
            let opened = open(&step_name(&path, number as u64));
            let Some(placed) = owner(1) else {
                let told = opened.err().unwrap().to_string();
                prop_assert!(told.contains("particles/position: missing"), "{}", told);
                continue;
            };
            let source = opened.unwrap();
            let about = source.description();
            let edge = is_cube.then_some(8.0);
            prop_assert_eq!((about.time, about.box_size), (Some(10.0 * number as f64), edge));
            let corner = if is_cube { -4.0 } else { 0.0 };
            let kind = |row: usize| owner(0).map_or(0, |frame| type_of(frame, row));
            let families = [(0, "a"), (1, "long-b")].map(|(own, name)| {
                (name, (0..*count).filter(|row| kind(*row) == own).collect::<Vec<_>>())
            });
            let families: Vec<_> = families.into_iter().filter(|(_, rows)| !rows.is_empty()).collect();
            prop_assert_eq!(about.families.len(), families.len());
            for (family, (name, rows)) in families.into_iter().enumerate() {
                let info = &about.families[family];
                prop_assert_eq!((info.name.as_str(), info.count), (name, rows.len() as u64));
                let read = |name: &str| values(source.as_ref(), family, name, step);
                let places = rows.iter().flat_map(|row| numbers::<3>(placed, *row, 0)).map(|x| f64::from(x) - corner);
                prop_assert_eq!(read("position"), Some(places.collect::<Vec<_>>()));
                // A name that no frame has is no field, a chunk that a frame lacks is all defaults.
                let of = |what: usize, of_frame: &dyn Fn(usize, usize) -> Vec<f32>, width: usize| {
                    frames.iter().any(|(_, has)| has[what]).then(|| match owner(what) {
                        Some(frame) => rows.iter().flat_map(|row| of_frame(frame, *row)).map(f64::from).collect(),
                        None => vec![0.0; width * rows.len()],
                    })
                };
                prop_assert_eq!(read("velocity"), of(2, &|frame, row| numbers::<3>(frame, row, 3).to_vec(), 3));
                prop_assert_eq!(read("charge"), of(3, &|frame, row| numbers::<1>(frame, row, 6).to_vec(), 1));
                let tags: Vec<u64> = rows.iter().map(|row| *row as u64).collect();
                let rounded: Vec<f64> = tags.iter().map(|tag| *tag as f64).collect();
                prop_assert_eq!(read("id"), keeps_count.then_some(rounded));
                prop_assert_eq!(ids(source.as_ref(), family), keeps_count.then_some(tags));
            }
        }
    }

    #[test]
    fn damage_is_an_error_or_another_trajectory(
        version in 1..3u32,
        cut in prop::option::of(0.0..1.0f64),
        changes in prop::collection::vec((0.0..1.0f64, any::<bool>(), any::<u8>()), 0..12),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let mut bytes = sample(version, &[(5, [true; 4]), (5, [false, true, true, false]), (3, [true; 4])], false);
        let length = bytes.len();
        for (at, is_of_header, byte) in changes {
            // The header, or what is anywhere: data, names and index.
            bytes[(at * if is_of_header { 48.0 } else { length as f64 }) as usize] = byte;
        }
        bytes.truncate(cut.map_or(length, |at| (at * length as f64) as usize));
        let path = file(folder.path(), &bytes);
        let one_line = |error: String| assert!(!error.contains('\n') && error.contains("movie.gsd"), "{error}");
        for step in 0..steps_in(&path).unwrap_or(1).min(4) {
            let path = step_name(&path, step);
            let _ = summarize(&path).map_err(|error| one_line(error.to_string()));
            let _ = load(&path, &LoadOptions::default(), &()).map_err(|error| one_line(error.to_string()));
        }
    }
}

/// The numbers of the format's own library, in an inclined cell through whose faces particles went.
#[test]
fn frames_of_the_library_of_the_format_are_read() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/trajectory.gsd");
    assert_eq!(steps_in(&path).unwrap(), 3);
    for (k, count) in [5, 5, 3].into_iter().enumerate() {
        let source = open(&step_name(&path, k as u64)).unwrap();
        let about = source.description();
        assert_eq!((&*about.format, about.steps, about.time), ("gsd", 3, Some(100.0 * k as f64)));
        assert_eq!(about.box_size, None);
        assert!(about.notes.iter().any(|note| note.contains("image flags")), "{:?}", about.notes);
        let k = k as f64;
        for (family, name) in ["a", "big-one"].into_iter().enumerate() {
            let info = &about.families[family];
            assert_eq!(info.name.as_str(), name);
            let rows = || (family..count).step_by(2).map(|row| row as f64);
            let each = |of: &dyn Fn(f64) -> Vec<f64>| Some(rows().flat_map(of).collect::<Vec<f64>>());
            let read = |name: &str| values(source.as_ref(), family, name, 2);
            // Edges are (4, 0, 0), (0.25 * 5, 5, 0) and (0.5 * 6, -0.5 * 6, 6).
            let place = |row: f64| {
                let (x, z) = (row - 2.0, k);
                vec![0.25 * row - 0.5 + 4.0 * x + 3.0 * z, 0.5 * row - 1.0 - 3.0 * z, 0.125 * k + 6.0 * z]
            };
            assert_eq!(read("position"), each(&place));
            assert_eq!(read("velocity"), each(&|row| vec![row, -row, k]));
            assert_eq!(read("smoothing-length"), each(&|row| vec![0.25 * (row + 1.0)]));
            assert_eq!(read("charge"), each(&|row| vec![if k == 1.0 { 0.5 - row } else { 0.0 }]));
            assert_eq!(read("energies"), each(&|row| vec![2.0 * row + k]));
            // Not of particles, and what no frame has.
            assert!(["total", "image", "mass"].into_iter().all(|name| read(name).is_none()));
        }
    }
    let run = open_run(std::slice::from_ref(&path), &RunOptions::default(), ReadMethod::default()).unwrap();
    assert_eq!(run.steps.iter().map(|step| step.time).collect::<Vec<_>>(), [0.0, 100.0, 200.0]);
    let beyond = open(&step_name(&path, 3)).err().unwrap().to_string();
    assert!(beyond.ends_with("trajectory.gsd: frame: found 3, expected a frame from 0 to 2"), "{beyond}");
}

#[test]
fn what_is_wrong_is_said() {
    let place = || floats("particles/position", 3, [0.0; 6]);
    let count = |count: u32| whole("particles/N", [count]);
    let good = written(2, &[vec![count(2), place()]]);
    let with = |at: usize, bytes: &[u8]| {
        let mut changed = good.clone();
        changed[at..at + bytes.len()].copy_from_slice(bytes);
        changed
    };
    let much = u64::MAX.to_le_bytes();
    // The entries of the index, of 32 bytes each, are the last of the file.
    let entry = good.len() - 160;
    let cases = [
        (with(44, &[0, 0, 9, 0]), "version: found 9.0, expected 1 or 2"),
        (with(112, b"other"), "schema: found \"other\", expected \"hoomd\""),
        (with(8, &much), "index: found 5 entries of 32 bytes from byte 18446744073709551615 on"),
        (with(16, &much), "index: found 18446744073709551615 entries"),
        (with(32, &much), "names: found 18446744073709551615 entries"),
        (with(entry + 32, &much), "frames: found frame 18446744073709551615, expected fewer than"),
        (with(entry + 40, &much), "frame 0: particles/position: found 18446744073709551615 x 3 numbers"),
        (with(entry + 48, &[0xff; 7]), "frame 0: particles/position: found 2 x 3 numbers of 4 bytes from byte"),
        (with(entry + 62, &[99]), "frame 0: particles/position: found type 99"),
        (written(2, &[vec![count(3), place()]]), "particles/position: found 2 x 3 numbers, expected 3 x 3 numbers"),
        (written(2, &[vec![count(u32::MAX)]]), "frame 0: particles/position: missing"),
        (written(2, &[vec![count(0), place()]]), "frame 0: particles/N: no particles"),
        (
            written(2, &[vec![count(2), place(), whole("particles/typeid", [0, 1])]]),
            "typeid: found 1, expected one of 1",
        ),
        (
            written(2, &[vec![count(2), place(), floats("configuration/box", 1, [1.0, 1.0])]]),
            "box: found 2 x 1 numbers",
        ),
        (written(2, &[]), "frames: found none, expected a frame"),
        (good[..200].to_vec(), "header: found 200 bytes, expected 256 bytes"),
    ];
    for (bytes, expected) in cases {
        let folder = tempfile::tempdir().unwrap();
        let path = file(folder.path(), &bytes);
        let told = load(&path, &LoadOptions::default(), &()).unwrap_err().to_string();
        assert!(told.contains(expected) && told.contains("movie.gsd: ") && !told.contains('\n'), "{expected}: {told}");
    }
}
