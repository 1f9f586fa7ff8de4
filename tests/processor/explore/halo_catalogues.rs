//! Catalogues of halo finders: haloes that were written in their layouts are read, and what is damaged is refused by file and line.

use crate::support::{gzip, in_repository};
use deepfield::explore::{Catalogue, Object};
use glam::DVec3;
use proptest::prelude::*;
use std::path::PathBuf;
use tempfile::TempDir;

/// Place, mass and radius.
type Made = ([f64; 3], f64, f64);

/// Names of formats, units of lengths and masses, and what radii are multiplied with to be in the unit of places.
const FINDERS: [(&str, &str, &str, f64); 3] =
    [("rockstar", "a Mpc/h", "Msun/h", 1e-3), ("ahf", "a kpc/h", "Msun/h", 1.0), ("velociraptor", "", "", 1.0)];

/// A catalogue as a finder writes it; the halo in row `i` has the number `3 i + 1`.
fn text(finder: usize, made: &[Made]) -> String {
    let count = made.len();
    let mut text = match finder {
        0 => "#ID DescID Mvir Vmax Rvir Rs Np X Y Z VX\n#a = 0.500000\n#Box size: 50.000000 Mpc/h\n\
              #Units: Masses in Msun / h\n#Units: Positions in Mpc / h (comoving)\n\
              #Units: Halo distances, lengths, and radii in kpc / h (comoving)\n"
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
