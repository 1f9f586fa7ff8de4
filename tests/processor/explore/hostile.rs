//! Files that were damaged or made to harm: errors with the file's name, never a panic.

use crate::support::in_repository;
use deepfield::explore::{Catalogue, IdSet};
use proptest::prelude::*;

/// Changes some bytes and cuts the end off.
fn damaged(mut bytes: Vec<u8>, changes: &[(prop::sample::Index, u8)], keep: f64) -> Vec<u8> {
    for (at, byte) in changes {
        let at = at.index(bytes.len());
        bytes[at] = *byte;
    }
    let keep = (bytes.len() as f64 * keep).ceil() as usize;
    bytes.truncate(keep);
    bytes
}

proptest! {
    #![proptest_config(crate::cases::cases(200))]

    #[test]
    fn damaged_catalogues_and_ids_are_errors_or_catalogues(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        keep in prop_oneof![Just(1.0), 0.01..1.0_f64],
        kind in 0..6_usize,
    ) {
        let folder = tempfile::tempdir().unwrap();
        let (name, bytes) = match kind {
            0 => ("groups.0.hdf5", std::fs::read(in_repository("tests/data/groups.0.hdf5")).unwrap()),
            1 => ("a.csv", b"name,x [kpc],y,z,radius,mass\nA,1,2,3,4,5\n\"B, b\",1e3,2,3,,\n".to_vec()),
            2 => ("a.ron", b"(length_unit: \"kpc\", objects: [(name: \"A\", position: (1, 2, 3), mass: 4.0)])".to_vec()),
            4 => ("velociraptor.hdf5", std::fs::read(in_repository("tests/data/velociraptor.hdf5")).unwrap()),
            // One of two files: the other one is not there.
            5 => ("hbt.1.hdf5", std::fs::read(in_repository("tests/data/hbt.1.hdf5")).unwrap()),
            _ => ("a.ids", b"# 5 ids\n1-3\n7, 18446744073709551615\n".to_vec()),
        };
        let path = folder.path().join(name);
        std::fs::write(&path, damaged(bytes, &changes, keep)).unwrap();
        let message = if kind == 3 {
            IdSet::read(&path).map(|_| ()).map_err(|error| error.to_string())
        } else {
            let read = Catalogue::read(&path);
            if let Ok(catalogue) = &read {
                prop_assert!(!catalogue.objects.is_empty());
                prop_assert!(catalogue.objects.iter().all(|object| object.position.is_finite()));
            }
            read.map(|_| ()).map_err(|error| error.to_string())
        };
        if let Err(message) = message {
            let stem = name.split('.').next().unwrap();
            prop_assert!(message.contains(stem), "{}", message);
        }
    }
}
