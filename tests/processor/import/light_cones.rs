//! Light cones of GADGET-4: what they do not share with its snapshots.

use super::read_all;
use crate::support::hdf5::{Hdf5, Values};
use deepfield::import::open;
use deepfield::model::{FamilyName, Motion};

#[test]
fn a_light_cone_has_no_box_and_a_scale_factor_for_each_particle() {
    let mut file = Hdf5::default();
    for name in ["NumPart_ThisFile", "NumPart_Total"] {
        file.attribute("Header", name, Values::U32(vec![0, 3, 0, 0, 0, 0]));
    }
    file.attribute("Header", "NumFiles", Values::I32(vec![1]));
    file.attribute("Header", "Npix_ThisFile", Values::U32(vec![12]));
    file.attribute("Header", "Npix_Total", Values::U32(vec![12]));
    file.attribute("Parameters", "ComovingIntegrationOn", Values::I32(vec![1]));
    for (name, value) in [("BoxSize", 100.0), ("Omega0", 0.3), ("OmegaLambda", 0.7), ("HubbleParam", 0.7)] {
        file.attribute("Parameters", name, Values::F64(vec![value]));
    }
    // Far beyond the box.
    let places: Vec<f64> = (0..9).map(|i| 250.0 * f64::from(i)).collect();
    file.dataset("PartType1", "Coordinates", 3, Values::F64(places.clone()));
    file.dataset("PartType1", "Velocities", 3, Values::F64(vec![1.0; 9]));
    file.dataset("PartType1", "ParticleIDs", 1, Values::U64(vec![5, 6, 7]));
    file.dataset("PartType1", "Ascale", 1, Values::F64(vec![0.5, 0.75, 1.0]));
    file.dataset("HealPixHashTable", "ParticleCount", 1, Values::I32(vec![0; 12]));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("conesnap_0000.hdf5");
    file.write(&path);
    let source = open(&path).unwrap();
    let about = source.description();
    assert_eq!((about.box_size, about.scale_factor, about.time), (None, None, None));
    assert_eq!((about.motion, about.families.len()), (Motion::Unknown, 1));
    assert_eq!((about.families[0].name, about.families[0].count), (FamilyName::Dark, 3));
    assert!(about.notes.iter().any(|note| note.contains("light cone")), "{:?}", about.notes);
    assert_eq!(read_all(source.as_ref(), 0, "position", 2), places);
    assert_eq!(read_all(source.as_ref(), 0, "scale-factor", 2), [0.5, 0.75, 1.0]);

    // The same with a time is a snapshot.
    file.attribute("Header", "Time", Values::F64(vec![0.5]));
    file.write(&path);
    let source = open(&path).unwrap();
    assert_eq!((source.description().box_size, source.description().scale_factor), (Some(100.0), Some(0.5)));
}
