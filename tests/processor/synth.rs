//! Generated snapshots: written as files they come back through the importer as they were made, the same for any number
//! of threads and on any machine, and they are as clustered as they promise.

use deepfield::import::{LoadOptions, load};
use deepfield::model::{Family, FamilyName};
use deepfield::synth::cosmology::Cosmology;
use deepfield::synth::merger::Merger;
use deepfield::synth::{Generator, clusters::Clusters, dataset, files, gadget};
use std::io::Cursor;
use std::path::Path;

/// The bytes of a snapshot in one file.
fn bytes(generator: &dyn Generator) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    gadget::write(generator, &mut out, &()).expect("written");
    out.into_inner()
}

fn cosmology(count: u64) -> Cosmology {
    Cosmology::new(1, count, 100.0, &())
}

fn read(path: &Path) -> deepfield::model::Dataset {
    load(path, &LoadOptions::default(), &()).expect("import")
}

#[track_caller]
fn assert_same(made: &Family, read: &Family) {
    assert_eq!(made.name, read.name);
    assert_eq!(made.positions, read.positions);
    assert_eq!(made.smoothing_length, read.smoothing_length);
    assert_eq!(made.density, read.density);
    assert_eq!(made.mass, read.mass);
    for attribute in &made.attributes {
        assert_eq!(read.attribute(&attribute.name).expect("attribute").values, attribute.values, "{}", attribute.name);
    }
}

#[test]
fn generated_snapshots_import_as_they_were_made() {
    let generators: [(Box<dyn Generator>, FamilyName, &str); 3] = [
        (Box::new(Clusters::new(9, 70_001)), FamilyName::Gas, "internal-energy"),
        (Box::new(Merger::new(9, 70_001)), FamilyName::Gas, "temperature"),
        (Box::new(cosmology(70_001)), FamilyName::Dark, "velocity-dispersion"),
    ];
    let folder = tempfile::tempdir().expect("folder");
    for (generator, family, attribute) in generators {
        let path = folder.path().join("snapshot");
        files::write(generator.as_ref(), &path, gadget::MOST, &()).expect("written");
        let (made, read) = (dataset(generator.as_ref()), read(&path));
        assert_eq!(read.families.len(), 1);
        assert_eq!(read.families[0].name, family);
        assert_eq!(read.len(), 70_001);
        assert_same(&made.families[0], &read.families[0]);
        assert!(read.families[0].attribute(attribute).is_some());
        assert_eq!(read.provenance.box_size, made.provenance.box_size);
        // Nothing had to be estimated.
        assert!(read.provenance.notes.is_empty() && read.skipped.is_empty(), "{:?}", read.provenance.notes);
    }
}

#[test]
fn bytes_depend_on_nothing_but_the_arguments() {
    let make = |kind: usize, seed: u64| -> Vec<u8> {
        match kind {
            0 => bytes(&Cosmology::new(seed, 70_000, 100.0, &())),
            1 => bytes(&Merger::new(seed, 70_000)),
            _ => bytes(&Clusters::new(seed, 70_000)),
        }
    };
    let found: Vec<u32> = (0..3)
        .map(|kind| {
            let of_threads = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                pool.install(|| make(kind, 1))
            };
            let first = of_threads(1);
            for threads in [2, 3, 7] {
                assert!(first == of_threads(threads), "kind {kind}: {threads} threads make other bytes than one");
            }
            assert!(first != make(kind, 2), "kind {kind}: another seed makes the same");
            crc32c::crc32c(&first)
        })
        .collect();
    assert_eq!(found, KNOWN, "{found:#x?}");
}

/// Checksums of a small box, merger and clusters: whatever machine makes other bytes than these breaks the promise.
const KNOWN: [u32; 3] = [0x5d6d_a894, 0xcc1f_603b, 0xb02b_08a1];

#[test]
fn snapshots_in_several_files_are_the_same_particles() {
    let folder = tempfile::tempdir().expect("folder");
    let generator = cosmology(70_001);
    let names = files::write(&generator, &folder.path().join("box.gadget2"), 20_000, &()).expect("written");
    assert_eq!(names.len(), 4);
    assert!(names[3].ends_with("box.gadget2.3"));
    let (made, read) = (dataset(&generator), read(&names[2]));
    assert_same(&made.families[0], &read.families[0]);
    // No other file is left, and none at all after a failure.
    let entries = |folder: &Path| std::fs::read_dir(folder).expect("folder").count();
    assert_eq!(entries(folder.path()), 4);
    let error = files::write(&generator, &folder.path().join("box.7"), 20_000, &()).expect_err("a number at the end");
    assert!(error.to_string().contains("box.7: ") && error.to_string().contains("FILE.0"), "{error}");
    let error = files::write(&generator, &folder.path().join("no/box"), 20_000, &()).expect_err("no folder");
    assert!(error.to_string().contains("box.0: "), "{error}");
    std::fs::create_dir(folder.path().join("taken")).expect("folder");
    let error = files::write(&generator, &folder.path().join("taken"), gadget::MOST, &()).expect_err("a folder");
    assert!(error.to_string().contains("taken: "), "{error}");
    assert_eq!(entries(folder.path()), 5);
}

#[test]
fn any_number_of_particles_can_be_made() {
    for count in [1, 2, 7, 100, 4_097] {
        for edge in [1.0, 100.0, 3_000.0] {
            let data = dataset(&Cosmology::new(5, count, edge, &()));
            let family = &data.families[0];
            assert_eq!(family.len() as u64, count);
            assert!(family.positions.iter().flatten().all(|&x| (0.0..1e3 * edge).contains(&x)));
            let columns = [&family.density, &family.smoothing_length, &family.attributes[0].values];
            assert!(columns.iter().all(|column| column.iter().all(|&x| x > 0.0 && x.is_finite())));
        }
        assert_eq!(dataset(&Merger::new(5, count)).len() as u64, count);
    }
}

/// A box that takes its time to be made, and what it promises.
#[test]
fn a_box_has_the_mean_density_and_is_clustered_on_all_scales() {
    let data = dataset(&cosmology(400_000));
    has_the_mean_density_and_a_wide_range_of_it(&data.families[0]);
    is_clustered_on_all_scales(&data.families[0]);
}

fn has_the_mean_density_and_a_wide_range_of_it(family: &Family) {
    // Omega_m = 0.3 of 27.75 (1e10 Msun/h) in a cubic Mpc/h.
    let mean = 0.3 * 27.753_662_7e-9;
    let volume = 1e5f64.powi(3);
    let mass: f64 = family.mass.iter().map(|&m| f64::from(m)).sum();
    assert!((mass / volume / mean - 1.0).abs() < 1e-5, "{}", mass / volume);
    // Volumes of the particles add up to that of the box, as far as local estimates can.
    let filled: f64 = family.density.iter().zip(&family.mass).map(|(&rho, &m)| f64::from(m / rho)).sum();
    assert!((0.7..1.3).contains(&(filled / volume)), "{}", filled / volume);
    let range = |values: &[f32]| values.iter().fold((f32::MAX, 0f32), |(a, b), &x| (a.min(x), b.max(x)));
    let (low, high) = range(&family.density);
    assert!(high / low > 1e5 && f64::from(low) < 0.3 * mean, "{low} {high}");
    let (low, high) = range(&family.attributes[0].values);
    assert!(high / low > 50.0 && high < 3000.0, "{low} {high}");
    // h^3 rho / m is the same for all: 32 particles of mean density in the kernel.
    for i in 0..family.len() {
        let h = f64::from(family.smoothing_length[i]);
        let constant = h * h * h * f64::from(family.density[i]) / f64::from(family.mass[i]);
        assert!((constant / (96.0 / (4.0 * std::f64::consts::PI)) - 1.0).abs() < 1e-5, "{constant}");
    }
}

/// Variance of the counts in cells of a grid beyond that of random points, relative to the squared mean.
fn excess(family: &Family, cells: usize) -> f64 {
    let mut counts = vec![0f64; cells * cells * cells];
    for position in &family.positions {
        let [x, y, z] = position.map(|x| (x / 1e5 * cells as f64) as usize);
        counts[(z * cells + y) * cells + x] += 1.0;
    }
    let mean = family.len() as f64 / counts.len() as f64;
    let variance = counts.iter().map(|count| (count - mean) * (count - mean)).sum::<f64>() / counts.len() as f64;
    (variance - mean) / (mean * mean)
}

fn is_clustered_on_all_scales(family: &Family) {
    let excess: Vec<f64> = [50, 25, 12, 6].map(|cells| excess(family, cells)).to_vec();
    assert!(excess.windows(2).all(|pair| pair[0] > 1.5 * pair[1]), "{excess:?}");
    // Cells of 2, 8.3 and 16.7 Mpc/h; a cube of 12.9 Mpc/h has the volume of a sphere of 8 Mpc/h, where sigma is 0.8.
    assert!(excess[0] > 10.0 && (0.3..3.0).contains(&excess[2]) && (0.1..1.2).contains(&excess[3]), "{excess:?}");
}
