//! What snapshots say of the universe's expansion and of their velocities.

use super::writers::{GadgetStyle, Particles, file, gadget};
use super::{data, read_all};
use deepfield::import::{Description, open, summarize};
use deepfield::model::{ClockVariable, Cosmology, Motion};
use std::path::Path;

fn described(path: &Path) -> Description {
    open(path).unwrap().description().clone()
}

/// The bytes of a Gadget file of one particle with these numbers in the header.
fn gadget_header(big_endian: bool, format: u32, time: f64, redshift: f64, omegas: [f64; 2]) -> Vec<u8> {
    let style = GadgetStyle { big_endian, format, double: false, long_ids: false, table: [0.0; 6] };
    let mut particles: [Particles; 6] = Default::default();
    particles[1] = Particles { positions: vec![[1.0; 3]], velocities: vec![[2.0; 3]], ids: vec![1], masses: vec![1.0] };
    let mut bytes = gadget(style, &particles, [0, 1, 0, 0, 0, 0], 1);
    let header = if format == 2 { 20 } else { 4 };
    for (at, value) in [(72, time), (80, redshift), (136, omegas[0]), (144, omegas[1])] {
        let value = if big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
        bytes[header + at..][..8].copy_from_slice(&value);
    }
    bytes
}

#[test]
fn gadget_expands_where_there_is_matter_and_the_time_fits_the_redshift() {
    let folder = tempfile::tempdir().unwrap();
    for (big_endian, format) in [(false, 1), (true, 1), (false, 2), (true, 2)] {
        let of = |time, redshift, omegas| {
            described(&file(folder.path(), "snap", &gadget_header(big_endian, format, time, redshift, omegas)))
        };
        let about = of(0.25, 3.0, [0.3, 0.7]);
        let universe = Cosmology { omega_matter: 0.3, omega_lambda: 0.7, hubble: 100.0, hubble_assumed: true };
        assert_eq!((about.cosmology, about.scale_factor, about.motion), (Some(universe), Some(0.25), Motion::Gadget));
        assert!(about.notes.is_empty(), "{:?}", about.notes);
        let factor = ClockVariable::ScaleFactor.velocity_factor(&about.epoch()).unwrap();
        assert!((factor * 100.0 * (0.3f64 * 64.0 + 0.7).sqrt() / 8.0 - 1.0).abs() < 1e-14);
        // Nothing expands: no matter, or a time that is none of the redshift.
        for (time, redshift, omegas) in
            [(0.25, 3.0, [0.0; 2]), (1.0, 0.0, [0.0, 0.7]), (0.0, 0.0, [0.3, 0.7]), (2.0, 0.0, [0.3, 0.7])]
        {
            let about = of(time, redshift, omegas);
            assert_eq!((about.cosmology, about.scale_factor, about.motion), (None, None, Motion::Coordinate));
            assert!(about.notes.is_empty(), "{:?}", about.notes);
            assert_eq!(ClockVariable::Time.value(&about.epoch()), Some(time));
        }
    }
}

#[test]
fn numbers_that_cannot_be_are_left_out_with_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let of = |time, redshift, omegas| {
        described(&file(folder.path(), "snap", &gadget_header(false, 1, time, redshift, omegas)))
    };
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -0.3] {
        for (omegas, name) in [([bad, 0.7], "Omega0"), ([0.3, bad], "OmegaLambda")] {
            let about = of(0.25, 3.0, omegas);
            assert_eq!(about.cosmology, None);
            assert!(about.notes.len() == 1 && about.notes[0].starts_with(&format!("header {name}: found")));
            assert_eq!(ClockVariable::ScaleFactor.velocity_factor(&about.epoch()), None);
        }
        // Where nothing expands, nobody asks.
        assert!(of(0.7, 3.0, [bad, bad]).notes.is_empty());
        for (time, redshift) in [(bad, 3.0), (0.25, bad), (bad, bad)] {
            let about = of(time, redshift, [0.3, 0.7]);
            assert_eq!((about.cosmology, about.scale_factor), (None, None));
        }
    }
}

#[test]
fn hdf5_snapshots_say_how_they_expand() {
    let gadget4 = described(&data("comoving_gadget4.hdf5"));
    let universe = Cosmology { omega_matter: 0.3125, omega_lambda: 0.6875, hubble: 100.0, hubble_assumed: false };
    assert_eq!((gadget4.cosmology, gadget4.scale_factor), (Some(universe), Some(0.25)));
    assert_eq!(gadget4.motion, Motion::Gadget);
    // SWIFT: lengths without h, and Hubble's constant in the code's units, 16 of whose times make one of the snapshot's.
    let swift = described(&data("comoving_swift.hdf5"));
    let found = swift.cosmology.unwrap();
    assert!((found.hubble / 67.8 - 1.0).abs() < 1e-12 && !found.hubble_assumed, "{found:?}");
    assert_eq!((found.omega_matter, found.omega_lambda, swift.scale_factor), (0.3125, 0.6875, Some(0.25)));
    assert_eq!((swift.motion, swift.time), (Motion::Peculiar, Some(0.002)));
    assert!(gadget4.notes.is_empty() && swift.notes.is_empty());
    // The same universe: as much of it has passed, in time by (Mpc/h) / (km/s) and by Mpc / (km/s).
    let [a, b] = [&gadget4, &swift].map(|about| ClockVariable::Time.value(&about.epoch()).unwrap());
    assert!((a / (b * 0.678) - 1.0).abs() < 1e-12);
}

#[test]
fn layouts_without_densities_still_say_what_velocities_are() {
    for (name, scale_factor, motion) in [
        ("swift.hdf5", Some(0.5), Motion::Peculiar),
        ("arepo.0.hdf5", Some(0.5), Motion::Gadget),
        ("eagle.hdf5", Some(1.0), Motion::Gadget),
        ("gizmo.hdf5", Some(1.0), Motion::Gadget),
        ("gas_sphere_collapse_025.hdf5", None, Motion::Coordinate),
        ("emitter_000.hdf5", None, Motion::Coordinate),
        ("groups.0.hdf5", None, Motion::Unknown),
    ] {
        let about = described(&data(name));
        assert_eq!((about.cosmology, about.scale_factor, about.motion), (None, scale_factor, motion), "{name}");
    }
}

/// The bytes of a test file with one number, wherever it stands, in another's place.
fn with_number(name: &str, from: f64, to: f64) -> Vec<u8> {
    let mut bytes = std::fs::read(data(name)).unwrap();
    let places: Vec<usize> = (0..bytes.len() - 7).filter(|at| bytes[*at..*at + 8] == from.to_le_bytes()).collect();
    assert!(!places.is_empty());
    places.iter().for_each(|at| bytes[*at..*at + 8].copy_from_slice(&to.to_le_bytes()));
    bytes
}

#[test]
fn damaged_numbers_in_hdf5_are_left_out_with_a_note() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["comoving_gadget4.hdf5", "comoving_swift.hdf5"] {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -0.5, 0.0, 1e308, 1e-308] {
            // The density of matter; the cosmological constant, which may be 0; the scale factor.
            for (i, number) in [0.3125, 0.6875, 0.25].into_iter().enumerate() {
                let path = file(folder.path(), "snap.hdf5", &with_number(name, number, bad));
                let about = described(&path);
                let usable = bad.is_finite() && (bad > 0.0 || (i == 1 && bad == 0.0));
                assert_eq!(about.notes.len(), usize::from(!usable), "{name} {number} {bad}: {:?}", about.notes);
                assert_eq!(about.cosmology.is_some(), usable || i == 2, "{name} {number} {bad}");
                // Without a scale factor there is the redshift.
                let a = if i == 2 && usable { bad } else { 0.25 };
                assert_eq!(about.scale_factor, Some(a), "{name} {number} {bad}");
                let epoch = about.epoch();
                for clock in ClockVariable::ALL {
                    assert!(clock.value(&epoch).is_none_or(f64::is_finite));
                    assert!(clock.velocity_factor(&epoch).is_none_or(|factor| factor > 0.0 && factor.is_finite()));
                }
            }
        }
    }
    // Hubble's constant: without it, 100 km/s/Mpc in the header's units.
    let path = file(folder.path(), "snap.hdf5", &with_number("comoving_gadget4.hdf5", 100.0, f64::NAN));
    let about = described(&path);
    assert!(about.notes.len() == 1 && (about.cosmology.unwrap().hubble / 100.0 - 1.0).abs() < 1e-6);
    let path = file(folder.path(), "snap.hdf5", &with_number("comoving_swift.hdf5", 67.8 / 16.0, -1.0));
    let about = described(&path);
    assert!(about.notes.len() == 1 && (about.cosmology.unwrap().hubble / 67.8 - 1.0).abs() < 1e-6);
}

#[test]
fn json_has_the_cosmology_of_comoving_data_alone() {
    let json = |name: &str| serde_json::to_value(summarize(&data(name)).unwrap()).unwrap();
    let comoving = json("comoving_gadget4.hdf5");
    let expected = serde_json::json!({ "omega_matter": 0.3125, "omega_lambda": 0.6875, "hubble": 100.0 });
    assert_eq!((&comoving["cosmology"], &comoving["scale_factor"]), (&expected, &serde_json::json!(0.25)));
    let other = json("gas_sphere_collapse_025.hdf5");
    assert!(["cosmology", "scale_factor", "motion"].iter().all(|key| other.get(*key).is_none()));
    assert!(read_all(open(&data("comoving_swift.hdf5")).unwrap().as_ref(), 0, "velocity", 2).iter().all(|v| *v == 0.0));
}

#[test]
fn an_output_of_ramses_says_what_yt_reads_in_it() {
    let about = described(&data("others/ramses/expanding/output_00001"));
    assert_eq!((about.scale_factor, about.redshift, about.motion), (Some(0.5), Some(1.0), Motion::Peculiar));
    assert_eq!(about.box_size, Some(1.0));
    let universe = about.cosmology.unwrap();
    assert_eq!((universe.omega_matter, universe.omega_lambda, universe.hubble_assumed), (0.25, 0.75, false));
    // Velocities are in km/s, lengths in Mpc, of which the code has another one in the ninth digit.
    assert!((universe.hubble / 64.0 - 1.0).abs() < 1e-7, "{}", universe.hubble);
    let mass: f64 = about.mass_unit.0.strip_suffix(" g").unwrap().parse().unwrap();
    assert!((mass / 5.656_000_632_887_135e43 - 1.0).abs() < 1e-12, "{mass}");
}
