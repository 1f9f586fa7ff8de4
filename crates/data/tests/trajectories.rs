//! Trajectories as text: frames that are written are read back exactly, samples of the formats' documentation say what they should, and
//! damaged files are errors that name file and frame.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use deepfield_data::build::{BuildOptions, RunBuild, TrackOptions, compare_with_sources};
use deepfield_data::import::{
    FieldKind, LoadOptions, Run, RunOptions, Source, load, open, open_run, step_at, step_name, steps_in, summarize,
};
use deepfield_data::model::{ReadMethod, When};
use deepfield_data::store::RunFile;
use flate2::{Compression, write::GzEncoder};
use proptest::prelude::*;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Silicon, as the specification of extended XYZ has it, with one more frame.
const SILICON: &str = r#"8
Lattice="5.44 0.0 0.0 0.0 5.44 0.0 0.0 0.0 5.44" Properties=species:S:1:pos:R:3 Time=0.0
Si        0.00000000      0.00000000      0.00000000
Si        1.36000000      1.36000000      1.36000000
Si        2.72000000      2.72000000      0.00000000
Si        4.08000000      4.08000000      1.36000000
Si        2.72000000      0.00000000      2.72000000
Si        4.08000000      1.36000000      4.08000000
Si        0.00000000      2.72000000      2.72000000
Si        1.36000000      4.08000000      4.08000000
8
Lattice="5.44 0.0 0.0 0.0 5.44 0.0 0.0 0.0 5.44" Properties=species:S:1:pos:R:3 Time=1.5 pbc="T T T"
Si        0.10000000      0.00000000      0.00000000
Si        1.36000000      1.36000000      1.36000000
Si        2.72000000      2.72000000      0.00000000
Si        4.08000000      4.08000000      1.36000000
Si        2.72000000      0.00000000      2.72000000
Si        4.08000000      1.36000000      4.08000000
Si        0.00000000      2.72000000      2.72000000
Si        1.36000000      4.08000000      4.08000000
"#;

/// Two frames as `dump custom` writes them: scaled places, image flags, rows in any order.
const DUMP: &str = "ITEM: UNITS
metal
ITEM: TIME
0.5
ITEM: TIMESTEP
100
ITEM: NUMBER OF ATOMS
3
ITEM: BOX BOUNDS pp pp ff
-1 3
-1 3
-1 7
ITEM: ATOMS id type xs ys zs ix iy iz vx vy vz q
18446744073709551615 2 0.5 0.5 0.5 1 0 0 1 2 3 -1
1 1 0 0 0 0 0 0 0.5 0 0 1
2 1 0.25 0.75 1 0 -1 0 0 0 1e-3 0
ITEM: TIME
0.75
ITEM: TIMESTEP
200
ITEM: NUMBER OF ATOMS
3
ITEM: BOX BOUNDS pp pp ff
-1 3
-1 3
-1 7
ITEM: ATOMS id type xs ys zs ix iy iz vx vy vz q
1 1 0 0 0 0 0 0 0.5 0 0 1
2 1 0.25 0.75 1 0 -1 0 0 0 1e-3 0
18446744073709551615 2 0.5 0.5 0.5 1 0 0 1 2 3 -1
";

fn written(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    path
}

fn gzip(text: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(text).unwrap();
    encoder.finish().unwrap()
}

fn values(source: &dyn Source, name: &str) -> Vec<f64> {
    let info = &source.description().families[0];
    let field = info.named(name).unwrap_or_else(|| panic!("{name}: {:?}", info.fields));
    let mut out = vec![0.0; info.count as usize * info.fields[field].components];
    source.read(0, field, 0..info.count, &mut out).unwrap();
    out
}

fn ids(source: &dyn Source) -> Vec<u64> {
    let info = &source.description().families[0];
    let mut out = vec![0; info.count as usize];
    source.read_ids(0, info.find(FieldKind::Id).unwrap(), 0..info.count, &mut out).unwrap();
    out
}

fn runs(path: &Path, skip_damaged: bool) -> Result<Run, String> {
    let options = RunOptions { skip_damaged, ..RunOptions::default() };
    open_run(&[path.to_owned()], &options, ReadMethod::default()).map_err(|error| error.to_string())
}

#[test]
fn silicon_is_a_run_of_atoms_in_a_periodic_box() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), "si", SILICON);
    assert_eq!(steps_in(&path).unwrap(), 2);
    let first = open(&path).unwrap();
    let about = first.description();
    assert_eq!((about.format.as_str(), about.steps, about.time, about.box_size), ("xyz", 2, Some(0.0), Some(5.44)));
    assert_eq!((about.length_unit.0.as_str(), about.mass_unit.0.as_str()), ("Angstrom", "u"));
    assert!(about.path.to_str().unwrap().ends_with("si#0"));
    assert_eq!(values(&*first, "mass"), [28.085; 8]);
    assert_eq!(values(&*first, "atomic-number"), [14.0; 8]);
    let second = open(&step_name(&path, 1)).unwrap();
    assert_eq!(values(&*second, "position")[..6], [0.1, 0.0, 0.0, 1.36, 1.36, 1.36]);
    assert_eq!(summarize(&path).unwrap().particles, 8);
    let run = runs(&path, false).unwrap();
    assert_eq!(run.steps.iter().map(|step| step.time).collect::<Vec<_>>(), [0.0, 1.5]);
    for (when, step) in [(When::Last, 1), (When::Step(0), 0), (When::Time(1.5), 1)] {
        assert_eq!(step_at(&path, when, ReadMethod::default()).unwrap(), Some(step_name(&path, step)));
    }
    let between = step_at(&path, When::Time(1.0), ReadMethod::default()).unwrap_err().to_string();
    assert!(between.contains("--time: found 1, expected the time of a step, from 0 to 1.5"), "{between}");
    let beyond = open(&step_name(&path, 2)).err().unwrap().to_string();
    assert!(beyond.ends_with("si: frame: found 2, expected a frame from 0 to 1"), "{beyond}");

    // Atoms in order are who they are: no ids are needed.
    let out = folder.path().join("run.df");
    let tracks = TrackOptions::default();
    let (load, options) = (LoadOptions::default(), BuildOptions::default());
    let build = RunBuild { load: &load, options: &options, tracks: Some(&tracks), skip_damaged: false, still_of: None };
    build.build(run, &out, &()).unwrap();
    let built = Arc::new(RunFile::open(&out, ReadMethod::default()).unwrap());
    assert_eq!(built.directory().intervals[0].families[0].matches.matched, 8);
    assert_eq!(compare_with_sources(&built, &()).unwrap(), 16);
}

#[test]
fn dumps_have_units_ids_and_images() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), "dump", DUMP);
    let packed = folder.path().join("packed");
    std::fs::write(&packed, gzip(DUMP.as_bytes())).unwrap();
    for path in [path, packed] {
        let first = open(&path).unwrap();
        let about = first.description();
        assert_eq!(
            (about.format.as_str(), about.steps, about.time, about.box_size),
            ("lammps-dump", 2, Some(0.5), None)
        );
        assert_eq!(ids(&*first), [u64::MAX, 1, 2]);
        assert_eq!(values(&*first, "position"), [5.0, 1.0, 3.0, -1.0, -1.0, -1.0, 0.0, -2.0, 7.0]);
        assert_eq!(values(&*first, "velocity")[..3], [1.0, 2.0, 3.0]);
        assert_eq!(values(&*first, "charge"), [-1.0, 1.0, 0.0]);
        assert_eq!(values(&*first, "type"), [2.0, 1.0, 1.0]);
        let velocity = &about.families[0].fields[about.families[0].find(FieldKind::Velocity).unwrap()];
        assert_eq!(velocity.unit.0, "Angstrom/ps");
        assert!(about.notes.iter().any(|note| note.contains("image flags")), "{:?}", about.notes);
        // Units are stated before the first frame alone.
        let second = open(&step_name(&path, 1)).unwrap();
        assert_eq!((second.description().time, second.description().length_unit.0.as_str()), (Some(0.75), "Angstrom"));
        assert_eq!(ids(&*second), [1, 2, u64::MAX]);
    }
}

#[test]
fn a_cube_with_another_corner_is_moved_to_the_origin() {
    let folder = tempfile::tempdir().unwrap();
    let text = |edge: &str, number: u32| {
        format!(
            "ITEM: TIMESTEP\n{number}\nITEM: NUMBER OF ATOMS\n1\nITEM: BOX BOUNDS pp pp pp\n-2 {edge}\n-2 {edge}\n-2 {edge}\n\
             ITEM: ATOMS id x y z\n7 -2 0 1\n"
        )
    };
    let same = written(folder.path(), "same", &(text("2", 0) + &text("2", 10)));
    let source = open(&same).unwrap();
    assert_eq!((source.description().box_size, values(&*source, "position")), (Some(4.0), vec![0.0, 2.0, 3.0]));
    assert_eq!(open(&step_name(&same, 1)).unwrap().description().time, Some(10.0));
    // A box that changes is none, so that the run is not refused.
    let other = written(folder.path(), "other", &(text("2", 0) + &text("2.5", 10)));
    let source = open(&other).unwrap();
    assert_eq!((source.description().box_size, values(&*source, "position")), (None, vec![-2.0, 0.0, 1.0]));
    assert_eq!(runs(&other, false).unwrap().steps.len(), 2);
}

#[test]
fn plain_xyz_and_other_words_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let text =
        "2\n i = 5, time = 2.5, E = -1\nA 1 2 3 extra\nB -1 -2 1.5D+01 words\n\n2\ncomment\nA 1 2 3\nB 0 0 0\n\n";
    let path = written(folder.path(), "plain", text);
    let source = open(&path).unwrap();
    assert_eq!(values(&*source, "position"), [1.0, 2.0, 3.0, -1.0, -2.0, 15.0]);
    assert_eq!(values(&*source, "species"), [1.0, 2.0]);
    // One frame has no time, so that all have their numbers.
    assert_eq!(source.description().time, Some(0.0));
    assert!(source.description().families[0].find(FieldKind::Mass).is_none());
    assert!(source.description().notes.join("; ").contains("1 is A, 2 is B"));
    let momenta =
        "1\nProperties=species:S:1:pos:R:3:momenta:R:3:fixed:L:1:id:I:1\nHe 0 0 0 4.002602 0 -8.005204 T 12\n";
    let source = open(&written(folder.path(), "momenta", momenta)).unwrap();
    assert_eq!((values(&*source, "velocity"), values(&*source, "fixed")), (vec![1.0, 0.0, -2.0], vec![1.0]));
    assert_eq!((ids(&*source), source.description().time, source.description().steps), (vec![12], None, 1));
}

#[test]
fn what_is_wrong_with_a_frame_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let cut = written(folder.path(), "cut.xyz", &SILICON[..SILICON.len() - 100]);
    let told = runs(&cut, false).unwrap_err();
    assert!(told.ends_with("cut.xyz: frame 1: rows: found the end after 7, expected 8 rows"), "{told}");
    let run = runs(&cut, true).unwrap();
    assert_eq!(run.steps.len(), 1);
    assert!(run.notes.iter().any(|note| note.starts_with("left out:") && note.contains("frame 1")), "{:?}", run.notes);
    // A dump goes on behind a frame that is cut off.
    let half = DUMP.find("2 1 0.25").unwrap();
    let rest = half + DUMP[half..].find('\n').unwrap() + 1;
    let broken = written(folder.path(), "broken", &(DUMP[..half].to_owned() + &DUMP[rest..]));
    let run = runs(&broken, true).unwrap();
    assert_eq!(run.steps.iter().map(|step| step.time).collect::<Vec<_>>(), [0.75], "{:?}", run.notes);

    let cases = [
        ("8\nProperties=species:S:1:pos:R:3\nSi 0 0 zero\n", "the end after 1"),
        (
            "1\nProperties=species:S:1:pos:R:3\nSi 0 0 zero\n",
            "frame 0: line 3: column 4: found \"zero\", expected a number",
        ),
        ("1\nProperties=species:S:1:pos:R:3\nSi 0 0 0 0\n", "row: found \"0\" after 4 columns"),
        ("1\nProperties=species:S:1:pos:R:3\nSi 0 0\n", "row: found 3 columns, expected 4"),
        ("1\nProperties=species:S:1:pos:R\nSi 0 0 0\n", "Properties"),
        ("1\nProperties=species:S:1:velo:R:3\nSi 0 0 0\n", "expected those of positions"),
        ("1\nProperties=species:S:1:pos:R:99999999999\nSi 0 0 0\n", "1 to 4096 columns"),
        ("1\nLattice=\"1 2\" Properties=species:S:1:pos:R:3\nSi 0 0 0\n", "Lattice: found \"1 2\""),
        ("18446744073709551615\nProperties=species:S:1:pos:R:3\nSi 0 0 0\n", "as many as the file can hold"),
        ("0\nProperties=species:S:1:pos:R:3\n", "no particles"),
        ("1\nProperties=id:I:1:pos:R:3\n-1 0 0 0\n", "found \"-1\", expected an id"),
        ("ITEM: TIMESTEP\nx\n", "TIMESTEP: found \"x\", expected a number"),
        ("ITEM: TIMESTEP\n1\nITEM: NUMBER OF ATOMS\n1\nITEM: ATOMS x y z\n1 2 3\n", "no BOX BOUNDS before"),
        ("ITEM: UNITS\nfurlongs\n", "UNITS: found \"furlongs\""),
    ];
    for (text, expected) in cases {
        let path = written(folder.path(), "case", text);
        let told = load(&path, &LoadOptions::default(), &()).unwrap_err().to_string();
        assert!(told.contains(expected) && told.contains("case: ") && !told.contains('\n'), "{text:?}: {told}");
    }
}

#[test]
fn frames_behind_a_line_that_is_too_long_are_there() {
    let folder = tempfile::tempdir().unwrap();
    // A row of the first of two frames, and the time of the second.
    for (text, row, time) in [
        (SILICON, "Si        0.00000000      0.00000000      0.00000000\n", 1.5),
        (DUMP, "1 1 0 0 0 0 0 0 0.5 0 0 1\n", 0.75),
    ] {
        let digits: String = (0..(1u32 << 20))
            .map(|digit| char::from(b'0' + (digit.wrapping_mul(2_654_435_761) >> 24) as u8 % 10))
            .collect();
        let long = text.replacen(row, &row.replace('\n', &format!("{digits}\n")), 1);
        let line = text[..text.find(row).unwrap()].lines().count() + 1;
        for bytes in [long.clone().into_bytes(), gzip(long.as_bytes())] {
            let path = folder.path().join("long");
            std::fs::write(&path, bytes).unwrap();
            let told = open(&step_name(&path, 0)).err().unwrap().to_string();
            let expected =
                format!("long: frame 0: line {line}: found more than 1048576 bytes, expected a shorter line");
            assert!(told.ends_with(&expected), "{told}");
            let run = runs(&path, true).unwrap();
            assert_eq!(run.steps.iter().map(|step| step.time).collect::<Vec<_>>(), [time]);
            // The same numbers as without the long line before them.
            let plain = written(folder.path(), "plain", text);
            let [ours, theirs] = [path, plain].map(|path| values(&*open(&step_name(&path, 1)).unwrap(), "position"));
            assert_eq!(ours, theirs);
        }
    }
}

/// Frames of as many particles: their places, velocities and ids.
fn frames() -> impl Strategy<Value = Vec<Vec<([f64; 6], u64)>>> {
    let number = prop_oneof![-1e3..1e3, any::<f64>().prop_filter("finite", |x| x.is_finite())];
    let particle = (prop::array::uniform6(number), any::<u64>());
    (1usize..40).prop_flat_map(move |count| prop::collection::vec(prop::collection::vec(particle.clone(), count), 1..5))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn frames_come_back_as_they_were_written(frames in frames(), packed: bool) {
        let folder = tempfile::tempdir().unwrap();
        let (mut xyz, mut dump) = (String::new(), String::new());
        for (number, frame) in frames.iter().enumerate() {
            let count = frame.len();
            writeln!(xyz, "{count}\nProperties=pos:R:3:velo:R:3:id:I:1:species:S:1 Time={number}").unwrap();
            write!(dump, "ITEM: TIMESTEP\n{number}\nITEM: NUMBER OF ATOMS\n{count}\nITEM: BOX BOUNDS ff ff ff\n").unwrap();
            write!(dump, "0 1\n0 1\n0 1\nITEM: ATOMS vx vy vz xu yu zu id element\n").unwrap();
            for ([a, b, c, d, e, f], id) in frame {
                writeln!(xyz, "{a} {b} {c} {d:e} {e:e} {f:e} {id} C").unwrap();
                writeln!(dump, "{d} {e} {f} {a:e} {b:e} {c:e} {id} C ").unwrap();
            }
        }
        for text in [xyz, dump] {
            let path = folder.path().join("frames");
            let bytes = if packed { gzip(text.as_bytes()) } else { text.into_bytes() };
            std::fs::write(&path, bytes).unwrap();
            prop_assert_eq!(steps_in(&path).unwrap(), frames.len() as u64);
            for (number, frame) in frames.iter().enumerate() {
                let source = open(&step_name(&path, number as u64)).unwrap();
                let flat = |range: std::ops::Range<usize>| -> Vec<f64> {
                    frame.iter().flat_map(|(numbers, _)| numbers[range.clone()].to_vec()).collect()
                };
                prop_assert_eq!(source.description().time, Some(number as f64));
                prop_assert_eq!(values(&*source, "position"), flat(0..3));
                prop_assert_eq!(values(&*source, "velocity"), flat(3..6));
                prop_assert_eq!(ids(&*source), frame.iter().map(|(_, id)| *id).collect::<Vec<_>>());
                prop_assert_eq!(values(&*source, "mass"), vec![12.011; frame.len()]);
            }
        }
    }

    #[test]
    fn damaged_trajectories_are_errors_or_other_trajectories(
        which in 0..3usize, packed: bool, cut in 0.0..1.0, is_cut: bool,
        changes in prop::collection::vec((0.0..1.0, any::<u8>()), 0..8),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let plain = "2\n i = 5, time = 2.5\nA 1 2 3\nB -1 -2 1\n2\n\nA 1 2 3\nB 0 0 0\n";
        let text = [SILICON, DUMP, plain][which].as_bytes();
        let mut bytes = if packed { gzip(text) } else { text.to_vec() };
        if is_cut {
            bytes.truncate((cut * bytes.len() as f64) as usize);
        }
        for (at, byte) in changes {
            let at = (at * bytes.len() as f64) as usize;
            if let Some(old) = bytes.get_mut(at) {
                *old = byte;
            }
        }
        let path = folder.path().join("damaged");
        std::fs::write(&path, bytes).unwrap();
        let one_line = |error: String| assert!(!error.contains('\n'), "{error}");
        for step in 0..steps_in(&path).unwrap_or(1).min(4) {
            let path = step_name(&path, step);
            let _ = summarize(&path).map_err(|error| one_line(error.to_string()));
            let _ = load(&path, &LoadOptions::default(), &()).map_err(|error| one_line(error.to_string()));
        }
        let _ = runs(&path, true).map_err(one_line);
    }
}
