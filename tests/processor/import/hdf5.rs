//! HDF5 snapshots of several codes: units, conventions, files.

use super::writers::file;
use super::{data, message, read_all};
use crate::support::hdf5::{Hdf5, Values};
use deepfield::build::{BuildOptions, RunBuild, TrackOptions, compare_with_sources};
use deepfield::import::{
    AttributeChoice, FieldKind, GridOptions, LoadOptions, RunOptions, Smoothing, Source, grid_format, load, open,
    open_grid, open_run, summarize,
};
use deepfield::model::{FamilyName, Kernel, ReadMethod};
use deepfield::store::RunFile;
use std::path::Path;
use std::sync::Arc;

fn unit(source: &dyn Source, family: usize, name: &str) -> String {
    let info = &source.description().families[family];
    info.fields[info.named(name).unwrap()].unit.to_string()
}

#[test]
fn swift_smoothing_lengths_become_support_radii() {
    let source = open(&data("swift.hdf5")).unwrap();
    assert_eq!(source.description().format, "swift");
    let names: Vec<FamilyName> = source.description().families.iter().map(|family| family.name).collect();
    assert_eq!(names, [FamilyName::Gas, FamilyName::Stars]);
    for family in 0..2 {
        let lengths = read_all(source.as_ref(), family, "smoothing-length", 40);
        // Wendland C2 in three dimensions: 1.936492 times the stored 0.5.
        assert!(lengths.len() == 96 && lengths.iter().all(|h| (h - 0.968246).abs() < 1e-9), "{lengths:?}");
    }
    assert!(source.description().notes.iter().any(|note| note.contains("1.936492")));
    assert_eq!(unit(source.as_ref(), 0, "position"), "a Mpc");
    assert_eq!(unit(source.as_ref(), 0, "velocity"), "a Mpc/Gyr");
    assert_eq!(unit(source.as_ref(), 0, "internal-energy"), "(Mpc/Gyr)^2/a^2");
}

#[test]
fn swifts_kernels_are_taken_by_name() {
    assert_eq!(open(&data("swift.hdf5")).unwrap().description().kernel, Kernel::WendlandC2);
    let bytes = std::fs::read(data("swift.hdf5")).unwrap();
    let name = b"Wendland C2";
    let place = bytes.windows(name.len()).position(|window| window == name).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for (name, kernel, gamma) in [
        (b"Cubic (M4) ", Kernel::CubicSpline, 1.825742),
        (b"Quartic(M5)", Kernel::QuarticSpline, 2.018932),
        (b"Quintic(M6)", Kernel::QuinticSpline, 2.195775),
        (b"Wendland-C4", Kernel::WendlandC4, 2.207940),
        (b"Wendland C6", Kernel::WendlandC6, 2.449490),
        (b"Gauss by us", Kernel::CubicSpline, 1.825742),
    ] {
        let mut other = bytes.clone();
        other[place..place + name.len()].copy_from_slice(name);
        let path = folder.path().join("named.hdf5");
        std::fs::write(&path, other).unwrap();
        let source = open(&path).unwrap();
        assert_eq!(source.description().kernel, kernel);
        let lengths = read_all(source.as_ref(), 0, "smoothing-length", 40);
        assert!(lengths.iter().all(|h| (h - 0.5 * gamma).abs() < 1e-9), "{lengths:?}");
        let is_unknown = source.description().notes.iter().any(|note| note.contains("Gauss by us"));
        assert_eq!(is_unknown, name == b"Gauss by us");
    }
}

#[test]
fn kernels_of_gadget_4_and_gizmo_are_what_they_say() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("told.hdf5");
    let kernel = |group: &str, name: &str, value: Values| {
        let mut file = gizmo(0.0, &[(1, 0, 0, [0.0; 3]), (2, 0, 0, [1.0; 3])]);
        file.attribute(group, name, value);
        file.write(&path);
        let source = open(&path).unwrap();
        // Lengths are of the support already.
        assert!(read_all(source.as_ref(), 0, "smoothing-length", 2).iter().all(|h| *h == 0.5));
        let about = source.description();
        (about.kernel, about.notes.iter().any(|note| note.contains("taken for the cubic spline")))
    };
    let option = |name| kernel("Config", name, Values::Text("\0"));
    assert_eq!(option("SELFGRAVITY"), (Kernel::CubicSpline, false));
    assert_eq!(option("CUBIC_SPLINE_KERNEL"), (Kernel::CubicSpline, false));
    assert_eq!(option("WENDLAND_C2_KERNEL"), (Kernel::WendlandC2, false));
    assert_eq!(option("WENDLAND_C6_KERNEL"), (Kernel::WendlandC6, false));
    let number = |id| kernel("Header", "Kernel_Function_ID", Values::I32(vec![id]));
    assert_eq!(number(3), (Kernel::CubicSpline, false));
    assert_eq!(number(5), (Kernel::QuinticSpline, false));
    assert_eq!(number(7), (Kernel::WendlandC4, false));
    assert_eq!([2, 77].map(number), [(Kernel::CubicSpline, true); 2]);
}

#[test]
fn both_files_of_a_snapshot_open_under_either_name() {
    let sources = ["arepo.0.hdf5", "arepo.1.hdf5"].map(|name| open(&data(name)).unwrap());
    for source in &sources {
        let counts: Vec<u64> = source.description().families.iter().map(|family| family.count).collect();
        assert_eq!(counts, [64, 16]);
        // The first file holds ids 0 to 39, the second one 1000 to 1023; coordinate i is i / 7.
        let ids: Vec<f64> = (0..40).chain(1000..1024).map(|id| id as f64).collect();
        for step in [1, 39, 64] {
            assert_eq!(read_all(source.as_ref(), 0, "id", step), ids);
        }
        let first: Vec<f64> = (0..120).chain(1000..1072).map(|index| index as f64 / 7.0).collect();
        assert_eq!(read_all(source.as_ref(), 0, "position", 11), first);
        assert_eq!(read_all(source.as_ref(), 1, "mass", 7), [0.25; 16]);
        assert_eq!(unit(source.as_ref(), 0, "position"), "a kpc/h");
        assert_eq!(unit(source.as_ref(), 0, "mass"), "1e10 Msun/h");
        assert_eq!(source.description().redshift, Some(1.0));
        assert!(source.description().notes.iter().any(|note| note.contains("tracers")));
    }
}

#[test]
fn cells_are_as_large_as_their_volume_says() {
    let source = open(&data("arepo.0.hdf5")).unwrap();
    assert_eq!(unit(source.as_ref(), 0, "smoothing-length"), "a kpc/h");
    let [mass, density, length] =
        ["mass", "density", "smoothing-length"].map(|name| read_all(source.as_ref(), 0, name, 7));
    for ((mass, density), length) in mass.iter().zip(&density).zip(&length) {
        // The sphere holds as much as 32 cells.
        let sphere = 4.0 / 3.0 * std::f64::consts::PI * length.powi(3);
        assert!((sphere * density / (32.0 * mass) - 1.0).abs() < 1e-12, "{length} for {mass} and {density}");
    }
    let loaded = load(&data("arepo.0.hdf5"), &LoadOptions::default(), &()).unwrap();
    assert_eq!(loaded.families[0].smoothing_length, length.iter().map(|h| *h as f32).collect::<Vec<_>>());
    let notes = &loaded.provenance.notes;
    assert!(notes.iter().any(|note| note.contains("32 such cells")), "{notes:?}");
    // Another way is still to be had.
    let options = LoadOptions { smoothing: Smoothing::Knn(8), ..LoadOptions::default() };
    let estimated = load(&data("arepo.0.hdf5"), &options, &()).unwrap();
    assert_ne!(estimated.families[0].smoothing_length, loaded.families[0].smoothing_length);
}

#[test]
fn a_virtual_file_stands_for_the_files_with_the_particles() {
    let folder = tempfile::tempdir().unwrap();
    let put = |place: &Path| {
        for (from, to) in [("arepo.0.hdf5", "snap.0.hdf5"), ("arepo.1.hdf5", "snap.1.hdf5")] {
            std::fs::copy(data(from), place.join(to)).unwrap();
        }
    };
    // An attribute of a number becomes SWIFT's flag.
    let mut bytes = std::fs::read(data("arepo.0.hdf5")).unwrap();
    let places: Vec<usize> = (0..bytes.len() - 7).filter(|&at| &bytes[at..at + 7] == b"BoxSize").collect();
    places.iter().for_each(|&at| bytes[at..at + 7].copy_from_slice(b"Virtual"));
    let path = folder.path().join("snap.hdf5");
    std::fs::write(&path, bytes).unwrap();
    let text = message(&open(&path).err().unwrap(), &path);
    assert!(text.contains("snap.0.hdf5: missing"), "{text}");
    // In a folder of its name, then beside it.
    std::fs::create_dir(folder.path().join("snap")).unwrap();
    put(&folder.path().join("snap"));
    assert_eq!(open(&path).unwrap().description().particles(), 80);
    std::fs::remove_dir_all(folder.path().join("snap")).unwrap();
    put(folder.path());
    for path in [&path, &folder.path().to_path_buf()] {
        assert_eq!(open(path).unwrap().description().particles(), 80, "{}", path.display());
    }
}

#[test]
fn a_virtual_file_says_where_the_files_with_the_particles_are() {
    let folder = tempfile::tempdir().unwrap();
    let parts = folder.path().join("parts");
    let direct = open(&data("arepo.0.hdf5")).unwrap();
    let positions = |source: &dyn Source| read_all(source, 0, "position", 11);
    for name in ["virtual.hdf5", "virtual_latest.hdf5"] {
        let path = folder.path().join(name);
        std::fs::copy(data(name), &path).unwrap();
        let text = message(&open(&path).err().unwrap(), &path);
        assert!(text.contains("./parts/arepo.0.hdf5: missing"), "{text}");
        std::fs::create_dir(&parts).unwrap();
        for part in ["arepo.0.hdf5", "arepo.1.hdf5"] {
            std::fs::copy(data(part), parts.join(part)).unwrap();
        }
        let source = open(&path).unwrap();
        assert_eq!(source.description().particles(), 80);
        assert_eq!(positions(source.as_ref()), positions(direct.as_ref()));
        // One that leads to it is opened where it is itself.
        #[cfg(unix)]
        {
            std::fs::create_dir(folder.path().join("elsewhere")).unwrap();
            let link = folder.path().join("elsewhere").join(name);
            std::os::unix::fs::symlink(&path, &link).unwrap();
            assert_eq!(open(&link).unwrap().description().particles(), 80);
            std::fs::remove_dir_all(folder.path().join("elsewhere")).unwrap();
        }
        // A virtual file in place of a part leads nowhere, least of all back to itself.
        std::fs::copy(&path, parts.join("arepo.0.hdf5")).unwrap();
        let text = message(&open(&path).err().unwrap(), &parts.join("arepo.0.hdf5"));
        assert!(text.contains("Header/Virtual: found 1"), "{text}");
        std::fs::remove_dir_all(&parts).unwrap();
    }
}

#[test]
fn damaged_virtual_files_give_particles_or_errors() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("parts")).unwrap();
    for part in ["arepo.0.hdf5", "arepo.1.hdf5"] {
        std::fs::copy(data(part), folder.path().join("parts").join(part)).unwrap();
    }
    for name in ["virtual.hdf5", "virtual_latest.hdf5"] {
        let whole = std::fs::read(data(name)).unwrap();
        let path = folder.path().join(name);
        let check = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            match open(&path) {
                Ok(source) => assert!(source.description().particles() > 0),
                Err(error) => assert!(!error.to_string().contains(['\n', '\r']), "{error}"),
            }
        };
        (0..whole.len()).step_by(101).for_each(|length| check(&whole[..length]));
        for at in (0..whole.len()).step_by(7) {
            let mut bytes = whole.clone();
            bytes[at] ^= 0xff;
            check(&bytes);
        }
    }
}

#[test]
fn a_file_of_several_that_stands_alone_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("arepo.0.hdf5");
    std::fs::copy(data("arepo.0.hdf5"), &path).unwrap();
    let text = message(&open(&path).err().unwrap(), &path);
    assert!(text.contains("arepo.1.hdf5") && text.contains("missing"), "{text}");
    let renamed = folder.path().join("arepo.hdf5");
    std::fs::rename(&path, &renamed).unwrap();
    let text = message(&open(&renamed).err().unwrap(), &renamed);
    assert!(text.contains("file name"), "{text}");
}

#[test]
fn eagle_units_come_from_its_exponents() {
    let source = open(&data("eagle.hdf5")).unwrap();
    let units = ["position", "velocity", "mass", "density", "temperature", "smoothing-length"]
        .map(|name| unit(source.as_ref(), 0, name));
    let expected =
        ["a Mpc/h", "a^0.5 km/s", "1e10 Msun/h", "1e10 Msun h^2/a^3/Mpc^3", "K", "a Mpc/h"].map(str::to_string);
    assert_eq!(units, expected);
    assert!(read_all(source.as_ref(), 0, "mass", 50).iter().all(|mass| (1.0..2.0).contains(mass)));
}

#[test]
fn gizmo_families_and_arrays() {
    let source = open(&data("gizmo.hdf5")).unwrap();
    let families: Vec<(FamilyName, u64)> =
        source.description().families.iter().map(|family| (family.name, family.count)).collect();
    assert_eq!(families, [(FamilyName::Gas, 96), (FamilyName::Stars, 8), (FamilyName::BlackHoles, 4)]);
    let info = &source.description().families[0];
    assert_eq!(info.fields[info.named("metallicity").unwrap()].components, 11);
    assert_eq!(unit(source.as_ref(), 0, "density"), "1e10 Msun h^2/a^3/kpc^3");
    let all = load(&data("gizmo.hdf5"), &LoadOptions { families: vec![FamilyName::Stars], ..Default::default() }, &());
    assert_eq!(all.unwrap().len(), 8);
}

#[test]
fn a_gadget_4_snapshot_has_its_known_numbers() {
    // Step 25 of the sequence: 1472 particles, total mass 1, u and h ranges as the reference reader gives them.
    let summary = summarize(&data("gas_sphere_collapse_025.hdf5")).unwrap();
    assert_eq!((summary.particles, summary.about.time), (1472, Some(1.5)));
    assert!((summary.families[0].mass - 1.0).abs() < 1e-7);
    let loaded = load(&data("gas_sphere_collapse_025.hdf5"), &LoadOptions::default(), &()).unwrap();
    let range = |values: &[f32]| values.iter().fold((f32::MAX, f32::MIN), |(a, b), v| (a.min(*v), b.max(*v)));
    let gas = &loaded.families[0];
    assert_eq!(range(&gas.smoothing_length), (0.06630332, 0.39836153));
    let (least, most) = range(&gas.attribute("internal-energy").unwrap().values);
    assert!((least - 0.2688107).abs() < 1e-6 && (most - 1.161395).abs() < 1e-6, "{least} {most}");
    assert!((range(&gas.density).1 - 35.39663).abs() < 1e-5);
    assert!(loaded.skipped.is_empty());
}

#[test]
fn densities_that_are_not_positive_are_summed_up() {
    let loaded = load(&data("emitter_000.hdf5"), &LoadOptions::default(), &()).unwrap();
    assert_eq!(loaded.len(), 1962);
    assert!(loaded.families[0].density.iter().all(|rho| *rho > 0.0));
    assert!(loaded.provenance.notes.iter().any(|note| note.contains("24 densities")));
}

#[test]
fn smoothing_lengths_on_request() {
    let path = data("gas_sphere_collapse_025.hdf5");
    let own = load(&path, &LoadOptions::default(), &()).unwrap();
    let near = LoadOptions { smoothing: Smoothing::Knn(8), ..Default::default() };
    let estimated = load(&path, &near, &()).unwrap();
    assert!(estimated.families[0].smoothing_length != own.families[0].smoothing_length);
    let field = LoadOptions { smoothing: Smoothing::Field("Pressure".into()), ..Default::default() };
    let all = AttributeChoice::All;
    let odd = load(&path, &LoadOptions { attributes: all, ..field }, &()).unwrap();
    assert_eq!(odd.families[0].smoothing_length, odd.families[0].attribute("pressure").unwrap().values);
    let lacking = LoadOptions { smoothing: Smoothing::Field("hsml2".into()), ..Default::default() };
    let text = message(&load(&path, &lacking, &()).err().unwrap(), &path);
    assert!(text.contains("hsml2") && text.contains("smoothing-length"), "{text}");
}

#[test]
fn what_is_asked_for_must_be_there() {
    let path = data("gas_sphere_collapse_025.hdf5");
    let stars = LoadOptions { families: vec![FamilyName::Stars], ..Default::default() };
    let text = message(&load(&path, &stars, &()).err().unwrap(), &path);
    assert!(text.contains("family stars") && text.contains("gas"), "{text}");
    let named = AttributeChoice::Named(vec!["colour".into()]);
    let text =
        message(&load(&path, &LoadOptions { attributes: named, ..Default::default() }, &()).err().unwrap(), &path);
    assert!(text.contains("attribute colour") && text.contains("pressure"), "{text}");
}

#[test]
fn reads_outside_the_source_are_errors() {
    let path = data("gas_sphere_collapse_025.hdf5");
    let source = open(&path).unwrap();
    let position = source.description().families[0].find(FieldKind::Position).unwrap();
    let mut out = [0.0; 6];
    assert!(source.read(0, position, 1470..1472, &mut out).is_ok());
    assert!(source.read(0, position, 1471..1473, &mut out).is_err());
    assert!(source.read(0, position, 0..1, &mut out).is_err());
    assert!(source.read(0, 99, 0..2, &mut out).is_err());
    assert!(source.read(1, position, 0..2, &mut out).is_err());
    #[expect(clippy::reversed_empty_ranges, reason = "a range that runs backwards is what is tested")]
    let backwards = 3..1;
    assert!(source.read(0, position, backwards, &mut out).is_err());
}

/// `units.hdf5` with some of its bytes, all that are `from`, replaced.
fn with_bytes(folder: &std::path::Path, from: &[u8], to: &[u8]) -> std::path::PathBuf {
    let mut bytes = std::fs::read(data("units.hdf5")).unwrap();
    let places: Vec<usize> = (0..bytes.len() - from.len()).filter(|at| bytes[*at..].starts_with(from)).collect();
    assert!(!places.is_empty());
    places.iter().for_each(|at| bytes[*at..at + from.len()].copy_from_slice(to));
    file(folder, "changed.hdf5", &bytes)
}

#[test]
fn units_in_words_are_those_of_the_values() {
    let source = open(&data("units.hdf5")).unwrap();
    assert_eq!(source.description().length_unit.to_string(), "kpc");
    assert_eq!(
        (unit(source.as_ref(), 0, "smoothing-length"), unit(source.as_ref(), 0, "temperature")),
        ("kpc".into(), "hot".into())
    );
    let lengths = read_all(source.as_ref(), 0, "smoothing-length", 2);
    assert!((lengths[0] / 0.306_601_394 - 1.0).abs() < 1e-8 && lengths[2] == 4.0 * lengths[0], "{lengths:?}");
}

#[test]
fn units_of_positions_that_are_unknown_are_named() {
    let folder = tempfile::tempdir().unwrap();
    for (from, to, field, found) in
        [(b"kpc", b"ell", "Coordinates/units", "\"ell\""), (b"ly\0", b"ko\0", "SmoothingLength/units", "\"ko\"")]
    {
        let path = with_bytes(folder.path(), from, to);
        let text = message(&open(&path).err().unwrap(), &path);
        assert!(text.contains(&format!("{field}: found {found}, expected a length: pc")), "{text}");
    }
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let path = with_bytes(folder.path(), &3.085678e21f64.to_le_bytes(), &f64::to_le_bytes(bad));
        let text = message(&open(&path).err().unwrap(), &path);
        assert!(text.contains("Header/UnitLength_in_cm: found"), "{text}");
        assert!(text.contains("expected a positive number of centimetres"), "{text}");
    }
}

/// A snapshot of gas in GIZMO's layout: of each particle id, number among the children, generation and place.
fn gizmo(time: f64, particles: &[(u32, u32, u32, [f64; 3])]) -> Hdf5 {
    let mut file = Hdf5::default();
    let count = particles.len() as u32;
    for name in ["NumPart_ThisFile", "NumPart_Total"] {
        file.attribute("Header", name, Values::U32(vec![count, 0, 0, 0, 0, 0]));
    }
    file.attribute("Header", "MassTable", Values::F64(vec![0.0; 6]));
    file.attribute("Header", "Time", Values::F64(vec![time]));
    file.attribute("Header", "NumFilesPerSnapshot", Values::I32(vec![1]));
    let of = |value: &dyn Fn(&(u32, u32, u32, [f64; 3])) -> u32| Values::U32(particles.iter().map(value).collect());
    file.dataset("PartType0", "ParticleIDs", 1, of(&|particle| particle.0));
    file.dataset("PartType0", "ParticleChildIDsNumber", 1, of(&|particle| particle.1));
    file.dataset("PartType0", "ParticleIDGenerationNumber", 1, of(&|particle| particle.2));
    let places = particles.iter().flat_map(|particle| particle.3).collect();
    file.dataset("PartType0", "Coordinates", 3, Values::F64(places));
    let still = |columns: usize, value: f64| Values::F64(vec![value; columns * particles.len()]);
    file.dataset("PartType0", "Velocities", 3, still(3, 0.0));
    file.dataset("PartType0", "Masses", 1, still(1, 1.0));
    file.dataset("PartType0", "SmoothingLength", 1, still(1, 0.5));
    file.dataset("PartType0", "Density", 1, still(1, 1.0));
    file
}

#[test]
fn particles_that_gizmo_splits_stay_who_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let place = |id: u32| [f64::from(id), f64::from(id % 7), f64::from(id % 5)];
    let beside = |id: u32, child: u32| place(id).map(|x| x + 0.01 * f64::from(child));
    let whole = |from: u32| (from..=40).map(|id| (id, 0, 0, place(id)));
    // Ten are split, and then all of these halves.
    let halves = |children: &[u32], generation: u32| -> Vec<_> {
        let of_one = |id| children.iter().map(move |child| (id, *child, generation, beside(id, *child)));
        (1..=10).flat_map(of_one).chain(whole(11)).rev().collect()
    };
    let steps = [whole(1).collect(), halves(&[0, 1], 1), halves(&[0, 1, 2, 3], 2)];
    let paths: Vec<_> = (0..3).map(|step| folder.path().join(format!("snapshot_{step}.hdf5"))).collect();
    for ((path, step), time) in paths.iter().zip(&steps).zip([0.0, 1.0, 2.0]) {
        gizmo(time, step).write(path);
    }
    let source = open(&paths[2]).unwrap();
    let mut ids = vec![0; steps[2].len()];
    source.read_ids(0, source.description().families[0].find(FieldKind::Id).unwrap(), 0..70, &mut ids).unwrap();
    // Whoever has no number keeps the plain id; others have theirs from the highest bit down.
    let upper = [0, 1 << 63, 1 << 62, 3 << 62];
    let expected: Vec<u64> = steps[2].iter().map(|(id, child, ..)| u64::from(*id) | upper[*child as usize]).collect();
    assert_eq!(ids, expected);
    let different: std::collections::HashSet<u64> = expected.iter().copied().collect();
    assert_eq!(different.len(), steps[2].len());

    let run = open_run(&paths, &RunOptions::default(), ReadMethod::default()).unwrap();
    let out = folder.path().join("run.df");
    let (load, options, tracks) = (LoadOptions::default(), BuildOptions::default(), TrackOptions::default());
    let build = RunBuild { load: &load, options: &options, tracks: Some(&tracks), skip_damaged: false, still_of: None };
    let built = build.build(run, &out, &()).unwrap().directory;
    let found: Vec<_> = built.intervals.iter().map(|interval| &interval.families[0].matches).collect();
    let counts = |k: usize| (found[k].matched, found[k].born, found[k].vanished, found[k].ambiguous);
    assert_eq!([counts(0), counts(1)], [(40, 10, 0, 0), (50, 20, 0, 0)]);
    // Nobody has moved: so every track ends where it began.
    let file = Arc::new(RunFile::open(&out, ReadMethod::default()).unwrap());
    assert_eq!(compare_with_sources(&file, &()).unwrap(), 40 + 50 + 70);
}

#[test]
fn columns_at_the_root_are_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("columns.hdf5");
    let ids = vec![7, (1 << 60) + 1, u64::MAX];
    let mut file = Hdf5::default();
    for (name, first) in [("x", 0.0), ("y", 10.0), ("z", 20.0), ("vx", 1.0), ("vy", 2.0), ("vz", 3.0), ("mass", 5.0)] {
        file.dataset("", name, 1, Values::F64((0..3).map(|row| first + f64::from(row)).collect()));
    }
    file.dataset("", "ID", 1, Values::U64(ids.clone()));
    file.dataset("", "Num_of_groups", 1, Values::U64(vec![3]));
    file.dataset("Info", "x", 1, Values::F64(vec![0.0; 9]));
    file.write(&path);
    let source = open(&path).unwrap();
    let about = source.description();
    assert_eq!((&*about.format, about.particles(), about.families[0].named("Num_of_groups")), ("hdf5", 3, None));
    assert_eq!(read_all(&*source, 0, "position", 2), [0.0, 10.0, 20.0, 1.0, 11.0, 21.0, 2.0, 12.0, 22.0]);
    assert_eq!(read_all(&*source, 0, "velocity", 2), [1.0, 2.0, 3.0, 2.0, 3.0, 4.0, 3.0, 4.0, 5.0]);
    assert_eq!(read_all(&*source, 0, "mass", 2), [5.0, 6.0, 7.0]);
    let mut found = vec![0; 3];
    source.read_ids(0, about.families[0].find(FieldKind::Id).unwrap(), 0..3, &mut found).unwrap();
    assert_eq!(found, ids);
    // Places of samples along the axes of an array are none of particles.
    let mut axes = file.clone();
    axes.attribute("z", "CLASS", Values::Text("DIMENSION_SCALE"));
    axes.write(&path);
    let told = message(&open(&path).err().unwrap(), &path);
    assert!(told.contains("Coordinates: no particles"), "{told}");
    let mut uneven = Hdf5::default();
    for (name, rows) in [("x", 3), ("y", 3), ("z", 2)] {
        uneven.dataset("", name, 1, Values::F64(vec![1.0; rows]));
    }
    uneven.write(&path);
    let told = message(&open(&path).err().unwrap(), &path);
    assert!(told.contains("z: found 2 rows, expected 3, as x has"), "{told}");
}

#[test]
fn columns_mean_what_their_attributes_say() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drifters.nc");
    let mut file = Hdf5::default();
    for name in ["x", "y", "z"] {
        file.dataset("", name, 1, Values::F64(vec![1.0, 2.0, 3.0]));
        file.attribute(name, "units", Values::Text("kpc"));
    }
    file.dataset("", "warmth", 1, Values::I32(vec![10, -9, 30]));
    file.attribute("warmth", "_FillValue", Values::I32(vec![-9]));
    file.attribute("warmth", "scale_factor", Values::F64(vec![0.5]));
    file.attribute("warmth", "add_offset", Values::F64(vec![100.0]));
    file.attribute("warmth", "units", Values::Text("K"));
    // More than a double tells apart, whatever stands for none.
    let ids = vec![7, (1 << 60) + 1, 9];
    file.dataset("", "ID", 1, Values::U64(ids.clone()));
    file.attribute("ID", "_FillValue", Values::U64(vec![u64::MAX]));
    file.dataset("", "obs", 1, Values::F64(vec![0.0; 3]));
    file.attribute("obs", "NAME", Values::Text("This is a netCDF dimension but not a netCDF variable.         3"));
    file.write(&path);
    let source = open(&path).unwrap();
    let about = source.description();
    assert_eq!((&*about.length_unit.0, about.families[0].named("obs")), ("kpc", None));
    assert_eq!(unit(&*source, 0, "warmth"), "K");
    let warmth = read_all(&*source, 0, "warmth", 2);
    assert!(warmth[0] == 105.0 && warmth[1].is_nan() && warmth[2] == 115.0, "{warmth:?}");
    let mut found = vec![0; 3];
    source.read_ids(0, about.families[0].find(FieldKind::Id).unwrap(), 0..3, &mut found).unwrap();
    assert_eq!(found, ids);
}

#[test]
fn an_empty_group_is_a_family_of_none() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("gas.hdf5");
    let mut file = Hdf5::default();
    file.dataset("PartType0", "Coordinates", 3, Values::F64(vec![1.0; 6]));
    file.attribute("PartType4", "Note", Values::Text("no stars yet"));
    file.write(&path);
    let families = open(&path)
        .unwrap()
        .description()
        .families
        .iter()
        .map(|family| (family.name, family.count))
        .collect::<Vec<_>>();
    assert_eq!(families, [(FamilyName::Gas, 2)]);
}

#[test]
fn columns_of_several_numbers_are_of_the_table() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("columns.hdf5");
    let numbers = |count: u32| Values::F64((0..count).map(f64::from).collect());
    let mut file = Hdf5::default();
    for name in ["x", "y", "z"] {
        file.array("", name, &[4, 1], numbers(4));
    }
    file.array("", "vel", &[4, 3], numbers(12));
    file.write(&path);
    assert_eq!(grid_format(&path).unwrap(), None);
    let source = open(&path).unwrap();
    let places: Vec<f64> = (0..4).flat_map(|row| [f64::from(row); 3]).collect();
    assert_eq!(read_all(&*source, 0, "position", 3), places);
    assert_eq!(read_all(&*source, 0, "vel", 3), (0..12).map(f64::from).collect::<Vec<f64>>());
    // What is named is an image all the same.
    let named = folder.path().join("columns.hdf5#vel");
    assert_eq!(open_grid(&named, &GridOptions::default()).unwrap().grid().shape, [3, 4, 1]);
    // Of an image or a volume they are the places of samples along its axes; what is elsewhere is of no table.
    for (group, shape) in [("", &[4, 4, 4][..]), ("", &[4, 4][..]), ("Slices", &[4, 3][..])] {
        let mut file = Hdf5::default();
        for name in ["x", "y", "z"] {
            file.dataset("", name, 1, numbers(4));
        }
        file.array(group, "density", shape, numbers(shape.iter().product::<usize>() as u32));
        file.write(&path);
        assert_eq!(grid_format(&path).unwrap(), Some("hdf5"), "{group} {shape:?}");
    }
}

/// Haloes that h5py wrote in the layout of VELOCIraptor.
#[test]
fn haloes_of_velociraptor_are_particles() {
    let source = open(&data("velociraptor.hdf5")).unwrap();
    let places: Vec<f64> = (0..5).map(f64::from).flat_map(|k| [k + 0.5, 2.0 * k, 10.0 - k]).collect();
    assert_eq!(read_all(&*source, 0, "position", 2), places);
    assert_eq!(read_all(&*source, 0, "Mass_200crit", 2), [2.0, 3.0, 4.0, 5.0, 6.0]);
    assert_eq!(read_all(&*source, 0, "id", 2), [1.0, 2.0, 3.0, 4.0, 5.0]);
    assert_eq!(load(&data("velociraptor.hdf5"), &LoadOptions::default(), &()).unwrap().len(), 5);
}
