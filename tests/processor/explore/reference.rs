//! The reference data, where it is there: numbers that h5py and NumPy found in the same files.

use crate::support::in_reference_data;
use deepfield::build::{BuildOptions, build_source};
use deepfield::explore::probe::FamilyProbe;
use deepfield::explore::{
    Catalogue, Data, Fields, Probe, ProbeOptions, ProfileOptions, Region, Work, find_id, ids_of, probe,
};
use deepfield::import::{LoadOptions, open};
use deepfield::store::PageFile;
use glam::DVec3;

fn close(a: f64, b: f64, relative: f64) {
    assert!((a - b).abs() <= relative * a.abs().max(b.abs()), "{a} {b}");
}

fn field<'a>(family: &'a FamilyProbe, name: &str) -> &'a deepfield::explore::probe::FieldStatistics {
    family.fields.iter().find(|field| field.name == name).unwrap()
}

/// Everything within R200 of the largest halo.
fn halo(data: Data) -> Probe {
    let catalogue = Catalogue::read(&in_reference_data("particles/lcdm64_z0_groups.hdf5")).unwrap();
    let object = catalogue.ranked(0).unwrap();
    assert_eq!(object.name, "Group 0");
    let region = Region::sphere(object.position, object.radius.unwrap());
    let edge = data.periodic_edge().unwrap();
    assert_eq!(edge, Some(50.0));
    let profile = Some(ProfileOptions::logarithmic(10));
    probe(data, &region, &ProbeOptions { fields: Fields::All, profile, periodic: edge }, Work::quiet()).unwrap()
}

fn check_halo(found: &Probe, tolerance: f64) {
    let dark = &found.families[0];
    close(found.mass, 8191.074828780471, tolerance.max(1e-12));
    let com = found.center_of_mass.unwrap();
    let expected = [29.17671861, 35.01047586, 27.36153082];
    assert!(com.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6 + tolerance), "{com:?}");
    let dispersion = field(dark, "velocity-dispersion");
    close(dispersion.mean.unwrap(), 818.7438767010893, tolerance.max(1e-12));
    let counts: Vec<u64> = found.profile.as_ref().unwrap().shells.iter().map(|shell| shell.count).collect();
    let expected = [1, 2, 4, 14, 48, 126, 292, 399, 559, 565];
    let off: u64 = counts.iter().zip(expected).map(|(a, b)| a.abs_diff(b)).sum();
    let most = if tolerance > 0.0 { 4 } else { 0 };
    assert!(off <= most, "{counts:?}");
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn the_largest_halo_is_what_numpy_says() {
    let source = open(&in_reference_data("particles/lcdm64_z0.hdf5")).unwrap();
    let found = halo(Data::Source(source.as_ref()));
    assert_eq!(found.count, 2010);
    check_halo(&found, 0.0);
    let dark = &found.families[0];
    let velocity = dark.velocity.unwrap();
    for (own, expected) in velocity.mean.iter().zip([141.28059093, -81.0977669, -4.12300617]) {
        close(*own, expected, 1e-8);
    }
    for (own, expected) in velocity.dispersion.iter().zip([588.96473064, 482.49476447, 435.36787859]) {
        close(*own, expected, 1e-8);
    }
    close(velocity.dispersion_1d, 506.36806158919626, 1e-12);
    let dispersion = field(dark, "velocity-dispersion");
    close(dispersion.dispersion.unwrap(), 131.7917914475279, 1e-12);
    assert_eq!((dispersion.min, dispersion.max), (Some(492.0044860839844), Some(1135.6748046875)));
    close(field(dark, "density").mean.unwrap(), 79654.52326391419, 1e-12);
    close(field(dark, "smoothing-length").mean.unwrap(), 0.16402934870464886, 1e-12);
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn a_page_file_says_the_same_within_its_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lcdm.df");
    let (load, build) = (LoadOptions::default(), BuildOptions::default());
    build_source(&in_reference_data("particles/lcdm64_z0.hdf5"), &load, &build, &path, &()).unwrap();
    let file = PageFile::open(&path).unwrap();
    let found = halo(Data::Pages(&file));
    let dark = &found.families[0];
    let uncertain = dark.uncertain.unwrap();
    assert!(found.count.abs_diff(2010) <= uncertain.count && uncertain.count < 20, "{} {uncertain:?}", found.count);
    let error = field(dark, "velocity-dispersion").error.unwrap();
    // The errors of single particles; means of many are far nearer.
    assert!(error.max < 0.5 && error.mean < 0.1, "{error:?}");
    check_halo(&found, 0.01);
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn spheres_go_on_at_the_opposite_face() {
    let source = open(&in_reference_data("particles/lcdm64_z0.hdf5")).unwrap();
    let data = Data::Source(source.as_ref());
    let region = Region::sphere(DVec3::new(49.9, 0.2, 25.0), 4.0);
    let asked = ProbeOptions { periodic: Some(50.0), ..ProbeOptions::default() };
    let found = probe(data, &region, &asked, Work::quiet()).unwrap();
    assert_eq!(found.count, 140);
    let com = found.center_of_mass.unwrap();
    assert!(com.iter().zip([0.50959214, 0.67074087, 24.677123]).all(|(a, b)| (a - b).abs() < 1e-6), "{com:?}");
    close(field(&found.families[0], "velocity-dispersion").mean.unwrap(), 77.44051241193499, 1e-12);
    close(found.families[0].velocity.unwrap().dispersion_1d, 43.85990628902141, 1e-12);
    let alone = probe(data, &region, &ProbeOptions::default(), Work::quiet()).unwrap();
    assert!(alone.count < 140 && alone.count > 0);
    let ids = ids_of(source.as_ref(), &region, Some(50.0), Work::quiet()).unwrap();
    assert_eq!((ids.len(), ids.iter().sum::<u64>()), (140, 20897600));
    assert!([37, 38, 39, 101, 102].into_iter().eq(ids.iter().take(5)));
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn boxes_and_ranges_are_what_numpy_says() {
    let source = open(&in_reference_data("particles/lcdm64_z0.hdf5")).unwrap();
    let data = Data::Source(source.as_ref());
    let region = Region::cuboid(DVec3::splat(10.0), DVec3::new(20.0, 15.0, 30.0));
    let ask = |region: &Region| probe(data, region, &ProbeOptions::default(), Work::quiet()).unwrap();
    let found = ask(&region);
    assert_eq!(found.count, 1195);
    close(field(&found.families[0], "velocity-dispersion").mean.unwrap(), 89.31376881938598, 1e-12);
    assert_eq!(ask(&region.with_range("velocity-dispersion", Some(100.0), Some(200.0))).count, 310);
    // The densest particle, as the data's description has it.
    let densest = find_id(source.as_ref(), 93741, Work::quiet()).unwrap().unwrap();
    let at = DVec3::from_array(densest.position);
    assert!((at - DVec3::new(21.91557, 38.98755, 33.07759)).length() < 1e-5);
    close(densest.fields.iter().find(|field| field.name == "density").unwrap().values[0], 1240589.0, 1e-6);
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn gas_near_the_centre_of_a_galaxy_is_what_numpy_says() {
    let source = open(&in_reference_data("particles/fire_galaxy_a.hdf5")).unwrap();
    let data = Data::Source(source.as_ref());
    assert_eq!(data.periodic_edge().unwrap(), None);
    let region = Region::sphere(DVec3::ZERO, 10.0).with_family(deepfield::model::FamilyName::Gas);
    let asked = ProbeOptions {
        fields: Fields::Named(vec!["log10Density".into(), "log10Temperature".into(), "velocity-y".into()]),
        ..ProbeOptions::default()
    };
    let found = probe(data, &region, &asked, Work::quiet()).unwrap();
    // Without masses, particles count 1 each.
    assert_eq!((found.count, found.mass), (3969, 3969.0));
    let gas = &found.families[0];
    close(field(gas, "log10Density").mean.unwrap(), -2.0276160459798516, 1e-12);
    close(field(gas, "log10Density").dispersion.unwrap(), 0.9352544372905721, 1e-12);
    close(field(gas, "log10Temperature").mean.unwrap(), 2.9663075973357445, 1e-12);
    assert_eq!(field(gas, "log10Temperature").max, Some(6.98874044418335));
    close(field(gas, "velocity-y").mean.unwrap(), 41.48002111, 1e-8);
    let velocity = gas.velocity.unwrap();
    for (own, expected) in velocity.dispersion.iter().zip([231.72381503, 256.65124201, 118.55956807]) {
        close(*own, expected, 1e-8);
    }
    assert!(source.description().families.len() == 2);
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn group_catalogues_are_read() {
    let catalogue = Catalogue::read(&in_reference_data("particles/lcdm64_z0_groups.hdf5")).unwrap();
    assert_eq!((catalogue.objects.len(), catalogue.format, catalogue.left_out), (486 + 541, "groups", 0));
    let first = catalogue.named("group 0").unwrap();
    close(first.mass.unwrap(), 13415.43, 1e-6);
    assert!((first.position - DVec3::new(29.16367, 35.00242, 27.36399)).length() < 1e-4);
    close(first.radius.unwrap(), 0.706311047077179, 1e-12);
    let masses: Vec<f64> = catalogue.objects.iter().map(|object| object.mass.unwrap()).collect();
    assert!(masses.windows(2).all(|pair| pair[0] >= pair[1]));
    let snapshot = open(&in_reference_data("particles/lcdm64_z0.hdf5")).unwrap();
    assert_eq!(catalogue.length_unit, snapshot.description().length_unit);
}
