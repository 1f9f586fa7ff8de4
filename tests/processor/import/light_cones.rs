//! Light cones of GADGET-4: what they do not share with its snapshots.

use super::{data, read_all};
use crate::support::hdf5::{Hdf5, Values};
use deepfield::import::open;
use deepfield::model::{FamilyName, Motion};

/// Far beyond the box.
fn places() -> Vec<f64> {
    (0..9).map(|i| 250.0 * f64::from(i)).collect()
}

/// One file of a cone in so many files, which are all alike.
fn cone(files: u32) -> Hdf5 {
    let mut file = Hdf5::default();
    for (name, count) in [("NumPart_ThisFile", 3), ("NumPart_Total", 3 * files)] {
        file.attribute("Header", name, Values::U32(vec![0, count, 0, 0, 0, 0]));
    }
    file.attribute("Header", "NumFiles", Values::U32(vec![files]));
    file.attribute("Header", "Npix_ThisFile", Values::U32(vec![12]));
    file.attribute("Header", "Npix_Total", Values::U32(vec![12 * files]));
    file.attribute("Parameters", "ComovingIntegrationOn", Values::I32(vec![1]));
    for (name, value) in [("BoxSize", 100.0), ("Omega0", 0.3), ("OmegaLambda", 0.7), ("HubbleParam", 0.7)] {
        file.attribute("Parameters", name, Values::F64(vec![value]));
    }
    file.dataset("PartType1", "Coordinates", 3, Values::F64(places()));
    file.dataset("PartType1", "Velocities", 3, Values::F64(vec![1.0; 9]));
    file.dataset("PartType1", "ParticleIDs", 1, Values::U64(vec![5, 6, 7]));
    file.dataset("PartType1", "Ascale", 1, Values::F64(vec![0.5, 0.75, 1.0]));
    file.dataset("HealPixHashTable", "ParticleCount", 1, Values::I32(vec![0; 12]));
    file
}

/// The bytes of one file of a cone in so many.
pub fn sample(files: u32) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cone.hdf5");
    cone(files).write(&path);
    std::fs::read(path).unwrap()
}

#[test]
fn a_light_cone_has_no_box_and_a_scale_factor_for_each_particle() {
    let mut file = cone(1);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("conesnap_0000.hdf5");
    file.write(&path);
    let source = open(&path).unwrap();
    let about = source.description();
    assert_eq!((about.box_size, about.scale_factor, about.time), (None, None, None));
    assert_eq!((about.motion, about.families.len()), (Motion::Unknown, 1));
    assert_eq!((about.families[0].name, about.families[0].count), (FamilyName::Dark, 3));
    assert!(about.notes.iter().any(|note| note.contains("light cone")), "{:?}", about.notes);
    assert_eq!(read_all(source.as_ref(), 0, "position", 2), places());
    assert_eq!(read_all(source.as_ref(), 0, "scale-factor", 2), [0.5, 0.75, 1.0]);

    // The same with a time is a snapshot.
    file.attribute("Header", "Time", Values::F64(vec![0.5]));
    file.write(&path);
    let source = open(&path).unwrap();
    assert_eq!((source.description().box_size, source.description().scale_factor), (Some(100.0), Some(0.5)));
}

/// One that the code itself wrote, an octant from a scale factor of 0.97 on: each particle is where light comes from that was sent then.
#[test]
fn a_light_cone_of_gadget_4_is_as_deep_as_it_is_old() {
    /// Hubble's distance, Mpc/h, and the densities of the run's `Parameters`.
    const HUBBLE: f64 = 2997.92458;
    const OMEGA: [f64; 2] = [0.308, 0.692];
    let source = open(&data("conesnap_0000.hdf5")).unwrap();
    let about = source.description();
    assert_eq!((about.box_size, about.scale_factor, about.motion), (None, None, Motion::Unknown));
    assert_eq!((about.families[0].name, about.particles()), (FamilyName::Dark, 220));
    let factors = read_all(source.as_ref(), 0, "scale-factor", 50);
    let places = read_all(source.as_ref(), 0, "position", 50);
    for (place, sent) in places.as_chunks::<3>().0.iter().zip(factors) {
        // The midpoint rule, which is right to 1e-5 of such a distance.
        let step = (1.0 - sent) / 64.0;
        let expansion = |a: f64| a * a * (OMEGA[0] / a.powi(3) + OMEGA[1]).sqrt();
        let way: f64 = (0..64).map(|i| HUBBLE * step / expansion(sent + (f64::from(i) + 0.5) * step)).sum();
        let far = place.iter().map(|x| x * x).sum::<f64>().sqrt();
        // Particles go straight on within a step.
        assert!((far - way).abs() < 0.1, "{place:?} at {sent}: {far}, {way}");
        assert!(place.iter().all(|x| *x > 0.0) && (0.97..1.0).contains(&sent), "{place:?} at {sent}");
    }
}
