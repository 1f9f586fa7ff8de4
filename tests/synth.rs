//! A generated snapshot, written as a file, comes back through the importer as it was made.

use deepfield::import::{LoadOptions, load};
use deepfield::synth::{clusters::Clusters, dataset, gadget};

#[test]
fn generated_snapshots_import_as_they_were_made() {
    let generator = Clusters::new(9, 70_001);
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("clusters");
    let mut bytes = Vec::new();
    gadget::write(&generator, &mut bytes, &()).expect("written");
    std::fs::write(&path, &bytes).expect("file");
    let (made, read) = (dataset(&generator), load(&path, &LoadOptions::default(), &()).expect("import"));
    let (made, read) = (&made.families[0], &read.families[0]);
    assert_eq!(made.name, read.name);
    assert_eq!(made.positions, read.positions);
    assert_eq!(made.smoothing_length, read.smoothing_length);
    assert_eq!(made.density, read.density);
    assert_eq!(made.mass, read.mass);
    let energy = read.attribute("internal-energy").expect("internal energy");
    assert_eq!(energy.values, made.attributes[0].values);
}
