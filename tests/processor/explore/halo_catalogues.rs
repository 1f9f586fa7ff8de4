//! Catalogues of halo finders: haloes that were written in their layouts are read, and what is damaged is refused by file and line.

use crate::support::{gzip, in_repository};
use deepfield::explore::{Catalogue, Object};
use deepfield::import::{FieldKind, open};
use glam::DVec3;
use proptest::prelude::*;
use std::path::PathBuf;
use tempfile::TempDir;

/// Place, mass and radius.
type Made = ([f64; 3], f64, f64);

/// Names of formats, units of lengths and masses, and what radii are multiplied with to be in the unit of places.
const FINDERS: [(&str, &str, &str, f64); 3] =
    [("rockstar", "a Mpc/h", "Msun/h", 1e-6), ("ahf", "a kpc/h", "Msun/h", 1.0), ("velociraptor", "", "", 1.0)];

/// A catalogue as a finder writes it; the halo in row `i` has the number `3 i + 1`.
fn text(finder: usize, made: &[Made]) -> String {
    let count = made.len();
    let mut text = match finder {
        0 => "#ID DescID Mvir Vmax Rvir Rs Np X Y Z VX\n#a = 0.500000\n#Box size: 50.000000 Mpc/h\n\
              #Units: Masses in Msun / h\n#Units: Positions in Mpc / h (comoving)\n\
              #Units: Halo Distances, Lengths, and Radii in pc / h (comoving)\n"
            .to_owned(),
        1 => "#ID(1)\thostHalo(2)\tMvir(3)\tnpart(4)\tXc(5)\tYc(6)\tZc(7)\tVXc(8)\tRvir(9)\tRmax(10)\n".to_owned(),
        _ => format!("0\t1\n{count}\t{count}\nID(1) ID_mbp(2) Mass_200crit(3) R_200crit(4) Zc(5) Yc(6) Xc(7) \n"),
    };
    for (row, ([x, y, z], mass, radius)) in made.iter().enumerate() {
        let id = 3 * row + 1;
        text += &match finder {
            0 => format!("{id} -1 {mass:e} 200.5 {radius} 1e2 20 {x} {y} {z} -3\n"),
            1 => format!("{id}\t0\t{mass:e}\t20\t{x}\t{y}\t{z}\t5.5\t{radius}\t1\t\n"),
            _ => format!("{id} 17 {mass:e} {radius} {z} {y} {x} \n"),
        };
    }
    text
}

fn written(name: &str, bytes: &[u8]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

fn halo() -> impl Strategy<Value = Made> {
    let place = -1e3..1e5_f64;
    ([place.clone(), place.clone(), place], 1e8..1e16_f64, 1e-3..1e4_f64)
}

proptest! {
    #![proptest_config(crate::cases::cases(60))]

    #[test]
    fn haloes_are_read_as_they_were_written(made in prop::collection::vec(halo(), 1..20), finder in 0..3_usize) {
        let (_folder, path) = written("halos.txt", text(finder, &made).as_bytes());
        let catalogue = Catalogue::read(&path).unwrap();
        let (format, length, mass_unit, factor) = FINDERS[finder];
        prop_assert_eq!(catalogue.format, format);
        prop_assert_eq!((&*catalogue.length_unit.0, &*catalogue.mass_unit.0), (length, mass_unit));
        prop_assert_eq!(catalogue.box_size, (finder == 0).then_some(50.0));
        prop_assert_eq!(catalogue.objects.len(), made.len());
        for (row, (place, mass, radius)) in made.iter().enumerate() {
            let object: &Object = catalogue.named(&format!("halo {}", 3 * row + 1)).unwrap();
            prop_assert_eq!((object.position, object.mass), (DVec3::from_array(*place), Some(*mass)));
            prop_assert!((object.radius.unwrap() / (radius * factor) - 1.0).abs() < 1e-14);
        }
        prop_assert!(catalogue.objects.is_sorted_by(|a, b| a.mass >= b.mass));
    }

    /// Each object has the numbers of its row, whatever the order and in however many files of VELOCIraptor they are; and what is left out has none.
    #[test]
    fn properties_go_with_their_objects(made in prop::collection::vec(halo(), 2..20), cut in any::<prop::sample::Index>()) {
        let folder = tempfile::tempdir().unwrap();
        let (count, cut) = (made.len(), cut.index(made.len()));
        for (part, rows) in [0..cut, cut..count].into_iter().enumerate() {
            let mut text = format!("{part} 2\n{} {count}\nID(1) Mvir(2) Rvir(3) Xc(4) Yc(5) Zc(6) Npart(7) Type(8)\n", rows.len());
            for (row, ([x, y, z], mass, radius)) in made.iter().enumerate().take(rows.end).skip(rows.start) {
                let x = if row == 1 { f64::NAN } else { *x };
                text += &format!("{} {mass:e} {radius} {x} {y} {z} {} field\n", row + 1, 7 * row);
            }
            std::fs::write(folder.path().join(format!("halo.properties.{part}")), text).unwrap();
        }
        for part in 0..2 {
            let path = folder.path().join(format!("halo.properties.{part}"));
            let catalogue = Catalogue::read_whole(&path, None, 1 << 20).unwrap();
            prop_assert_eq!((catalogue.objects.len(), catalogue.left_out), (count - 1, 1));
            let names: Vec<&str> = catalogue.properties.iter().map(|property| &*property.name).collect();
            prop_assert_eq!(names, ["Npart", "Type"]);
            let [numbers, words] = [0, 1].map(|place| &catalogue.properties[place].values);
            for (object, number) in catalogue.objects.iter().zip(numbers) {
                let row = *number as usize / 7;
                prop_assert_eq!(&object.name, &format!("Halo {}", row + 1));
                prop_assert_eq!(object.position, DVec3::from_array(made[row].0));
            }
            prop_assert!(words.len() == count - 1 && words.iter().all(|word| word.is_nan()));
            prop_assert_eq!(Catalogue::read(&path).unwrap(), Catalogue { properties: Vec::new(), ..catalogue });
        }
        let some = Catalogue::read_whole(&folder.path().join("halo.properties.0"), Some(&["Type".to_owned()]), 1 << 20);
        prop_assert_eq!(some.unwrap().properties.len(), 1);
    }

    #[test]
    fn damage_is_an_error_or_leaves_a_catalogue(
        made in prop::collection::vec(halo(), 1..4),
        finder in 0..3_usize,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..4),
        keep in 0.01..1.0_f64,
    ) {
        let mut bytes = text(finder, &made).into_bytes();
        for (at, byte) in changes {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        bytes.truncate((bytes.len() as f64 * keep).ceil() as usize);
        let (_folder, path) = written("halos.txt", &bytes);
        match Catalogue::read(&path) {
            Ok(catalogue) => prop_assert!(catalogue.objects.iter().all(|object| object.position.is_finite())),
            Err(error) => {
                let message = error.to_string();
                prop_assert!(message.contains("halos.txt") && !message.contains('\n'), "{}", message);
            }
        }
    }
}

#[test]
fn properties_that_are_not_there_or_too_many_are_refused() {
    let (_folder, path) = written("halos.txt", text(0, &[([1.0; 3], 1e12, 1.0), ([2.0; 3], 1e13, 1.0)]).as_bytes());
    // Of 8 bytes each: DescID, Vmax, Rs, Np and VX of two haloes.
    assert_eq!(Catalogue::read_whole(&path, None, 80).unwrap().properties.len(), 5);
    let refused = |fields: Option<&[String]>, memory| {
        let message = Catalogue::read_whole(&path, fields, memory).unwrap_err().to_string();
        assert!(message.contains("halos.txt"), "{message}");
        message
    };
    assert!(refused(None, 79).contains("at most 79 bytes"));
    assert!(refused(Some(&["vmax".into()]), 80).contains("field vmax: not there, expected one of name, "));
    // Records of HBT+ in two files, each of which names both.
    for name in ["hbt.0.hdf5", "hbt.1.hdf5"] {
        let catalogue = Catalogue::read_whole(&in_repository("tests/data").join(name), None, 1 << 10).unwrap();
        let path = in_repository("tests/data").join(name);
        let [some, none] =
            ["Nbound", "bound"].map(|field| Catalogue::read_whole(&path, Some(&[field.to_owned()]), 1 << 10));
        assert_eq!(some.unwrap().properties, catalogue.properties);
        let message = none.unwrap_err().to_string();
        assert!(message.contains("field bound: not there") && message.ends_with("Nbound"), "{message}");
        let [bound] = &catalogue.properties[..] else { panic!("{:?}", catalogue.properties) };
        assert_eq!((&*bound.name, &bound.values[..]), ("Nbound", &[96.0, 97.0, 98.0, 99.0, 100.0][..]));
    }
}

/// A list of consistent-trees, whose names with brackets are no times.
#[test]
fn lists_with_descendants_are_of_one_step() {
    let names = "#scale(0) id(1) desc_scale(2) desc_id(3) mvir(4) rvir(5) x(6) y(7) z(8) A[x](9)";
    let text = format!("{names}\n#Omega_M = 0.3\n0.5 7 0.6 9 1e12 300 1 2 3 0.25\n");
    let (_folder, path) = written("hlist_0.5.list", text.as_bytes());
    let catalogue = Catalogue::read_at(&path, None, true).unwrap();
    assert_eq!((catalogue.format, catalogue.tree.is_none()), ("rockstar", true));
    assert_eq!(catalogue.named("Halo 7").unwrap().position, DVec3::new(1.0, 2.0, 3.0));
}

#[test]
fn rows_that_are_wrong_are_named() {
    let rockstar = "#ID Mvir Rvir X Y Z\n";
    for (text, parts) in [
        (format!("{rockstar}1 2 3 4 5\n"), &["line 2", "5", "6"][..]),
        (format!("{rockstar}# a comment\n1 2 3 4 far 6\n"), &["y in line 3", "far", "a number"]),
        (format!("{rockstar}1;2 2 3 4 5 6\n"), &["id in line 2", "1;2"]),
        (format!("{rockstar}1 2 3 nan 5 6\n"), &["objects", "none with a position"]),
        (rockstar.to_owned(), &["objects", "none with a position"]),
        (
            format!("{rockstar}#Units: Positions in Mpc / h\n#Units: Radii in Msun\n1 2 3 4 5 6\n"),
            &["unit of radii", "Msun"],
        ),
        ("0 1\n3 3\nID Mvir Rvir Xc Yc Zc\n1 2 3 4 5 6\n".to_owned(), &["haloes", "1", "3, as the second line says"]),
        (format!("{rockstar}{}\n", "1 ".repeat(1 << 17)), &["line 2", "a longer one"]),
    ] {
        let (_folder, path) = written("halos.txt", text.as_bytes());
        let message = Catalogue::read(&path).unwrap_err().to_string();
        assert!(message.contains("halos.txt") && parts.iter().all(|part| message.contains(part)), "{message}");
    }
}

/// Lists that the finders themselves wrote of the same clumps of particles: each is where it was put, as heavy, and some hundred times as dense
/// as what is critical, in the units that the list or its finder says.
#[test]
fn finders_of_others_find_the_same_clumps() {
    /// Where clumps are, Mpc/h, and their masses, Msun/h, as `tests/data/make_finders.py` has them.
    const CLUMPS: [([f64; 3], f64); 4] =
        [([4.0, 5.0, 6.0], 4e13), ([12.0, 3.0, 15.0], 2e13), ([16.5, 14.0, 8.0], 1e13), ([4.55, 5.3, 6.2], 6e12)];
    /// Msun/h in a cube of 1 Mpc/h.
    const CRITICAL: f64 = 2.775e11;
    /// Of the heaviest halo: its name, place, mass and radius, as they stand in the list.
    type Heaviest = (&'static str, [f64; 3], f64, f64);
    /// The file, its format, its unit of lengths, one of them in Mpc/h, one of its masses in Msun/h, its box and how many clumps are apart.
    type List = (&'static str, &'static str, &'static str, f64, f64, Option<f64>, usize);
    let lists: [(List, Heaviest); 4] = [
        (
            ("out_0.list", "rockstar", "a Mpc/h", 1.0, 1.0, Some(20.0), 4),
            ("Halo 0", [3.99271, 4.99671, 6.00197], 4.59e13, 730.856),
        ),
        (
            ("halos_0.0.ascii", "rockstar", "a Mpc/h", 1.0, 1.0, Some(20.0), 4),
            ("Halo 0", [3.992713, 4.996709, 6.001967], 4.59e13, 730.855652),
        ),
        (
            ("clumps.AHF_halos", "ahf", "a kpc/h", 1e-3, 1.0, None, 4),
            ("Halo 0", [3991.16522039, 4984.68252476, 5985.6903065], 3.89e13, 561.59),
        ),
        // In Mpc and 1e10 solar masses, as `.units` beside it says; a clump that touches another is one with it.
        (
            ("clumps.properties", "velociraptor", "", 0.7, 0.7e10, None, 3),
            ("Halo 1", [5.805720369, 7.197164577, 8.615398796], 6571.428571, 1.095678479),
        ),
    ];
    for ((file, format, unit, length, mass, box_size, apart), (name, place, heaviest, radius)) in lists {
        let path = in_repository("tests/data/finders").join(file);
        let catalogue = Catalogue::read(&path).unwrap();
        assert_eq!(
            (catalogue.format, &*catalogue.length_unit.0, catalogue.box_size),
            (format, unit, box_size),
            "{file}"
        );
        let first = &catalogue.objects[0];
        assert_eq!(
            (&*first.name, first.position, first.mass),
            (name, DVec3::from_array(place), Some(heaviest)),
            "{file}"
        );
        let scale = if format == "rockstar" { 1e-3 } else { 1.0 };
        assert!((first.radius.unwrap() / (radius * scale) - 1.0).abs() < 1e-12, "{file}: {first:?}");
        assert_eq!(catalogue.objects.len(), apart, "{file}");
        // Heaviest first, as clumps are.
        for (object, (place, expected)) in catalogue.objects.iter().zip(CLUMPS) {
            let far = (object.position * length).distance(DVec3::from_array(place));
            let (found, radius) = (object.mass.unwrap() * mass, object.radius.unwrap() * length);
            assert!(far < 0.1 && (found / expected - 1.0).abs() < 0.2, "{file}: {object:?}");
            let density = found / (4.0 / 3.0 * std::f64::consts::PI * radius.powi(3)) / CRITICAL;
            assert!((80.0..320.0).contains(&density), "{file}: {density} of {object:?}");
        }
        // A table of particles, too, in the file's order: the heaviest comes first in each.
        let source = open(&path).unwrap();
        let family = &source.description().families[0];
        assert_eq!(family.count, apart as u64, "{file}");
        let position = family.find(FieldKind::Position).unwrap();
        let mut places = vec![f64::NAN; 3 * apart];
        source.read(0, position, 0..family.count, &mut places).unwrap();
        assert_eq!(places[..3], place, "{file}");
    }
}

/// Files that other libraries wrote.
#[test]
fn haloes_in_hdf5_are_read() {
    for (name, format, length, mass_unit) in [
        ("hbt.0.hdf5", "hbt", "a Mpc/h", "1e10 Msun/h"),
        ("hbt.1.hdf5", "hbt", "a Mpc/h", "1e10 Msun/h"),
        ("velociraptor.hdf5", "velociraptor", "Mpc", "1e10 Msun"),
    ] {
        let catalogue = Catalogue::read(&in_repository("tests/data").join(name)).unwrap();
        assert_eq!((catalogue.format, &*catalogue.length_unit.0, &*catalogue.mass_unit.0), (format, length, mass_unit));
        let of = |k: usize| {
            let number = k as f64;
            let name = if format == "hbt" { format!("Track {k}") } else { format!("Halo {}", k + 1) };
            Object {
                name,
                position: DVec3::new(number + 0.5, 2.0 * number, 10.0 - number),
                radius: Some(0.125 * (number + 1.0)),
                mass: Some(2.0 + number),
            }
        };
        assert_eq!(catalogue.objects, (0..5).rev().map(of).collect::<Vec<_>>());
    }
}

#[test]
fn compressed_haloes_in_hdf5_are_those_of_the_files_without() {
    const FILES: [&str; 3] = ["hbt.0.hdf5", "hbt.1.hdf5", "velociraptor.hdf5"];
    let folder = tempfile::tempdir().unwrap();
    let plain = |name: &str| in_repository("tests/data").join(name);
    let packed = |name: &str| folder.path().join(format!("{name}.gz"));
    for name in FILES {
        std::fs::write(packed(name), gzip(&std::fs::read(plain(name)).unwrap())).unwrap();
    }
    for name in FILES {
        let expected = Catalogue { path: packed(name), ..Catalogue::read(&plain(name)).unwrap() };
        assert_eq!(Catalogue::read(&packed(name)).unwrap(), expected);
    }
    // Haloes of a part alone would pass for all.
    std::fs::remove_file(packed("hbt.0.hdf5")).unwrap();
    let told = Catalogue::read(&packed("hbt.1.hdf5")).unwrap_err().to_string();
    assert!(told.contains("hbt.0.hdf5.gz: file 0: missing"), "{told}");
}
