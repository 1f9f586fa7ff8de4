//! What levels of detail and vector quantisation do to colours (F12 4.10.2, figure 4.8): the mean Euclidean distance in
//! RGB from the picture of the unquantised source particles, 255 being full intensity.

use crate::support::{
    Built, built, built_from, core, demo, draw_pages, draw_source, in_reference_data, in_repository, view_of,
};
use deepfield::codec::VqBits;
use deepfield::color::composite::composite_at;
use deepfield::color::transfer::TransferFunction;
use deepfield::cpu::Method;
use deepfield::import::LoadOptions;
use deepfield::model::{Bounds, Dataset, FamilyName};
use glam::DVec3;
use std::path::Path;

/// Largest mean colour error over several distances (in sizes of what `of` gives).
fn color_error(built: &Built, of: fn(&Dataset) -> Bounds, vq_bits: VqBits) -> f64 {
    let function = TransferFunction::preset("density-hue").unwrap();
    let mut largest = 0.0f64;
    for (distance, direction) in [(0.3, DVec3::new(0.2, 0.5, 1.0)), (1.2, DVec3::Z), (4.0, DVec3::new(1.0, 0.3, 0.2))] {
        let view = view_of(of(&built.dataset), direction, distance, 480, 320);
        let source = draw_source(&built.dataset, "density-squared", &view, Method::Pyramid);
        let pages = draw_pages(&built.file, "density-squared", &view, 0.8);
        let levels = function.levels(&source);
        let [a, b] = [&source, &pages].map(|picture| composite_at(picture, &function, &levels));
        let distances = a.rgba.iter().zip(&b.rgba).map(|(a, b)| {
            let square = |k: usize| (f64::from(a[k]) - f64::from(b[k])).powi(2);
            (square(0) + square(1) + square(2)).sqrt()
        });
        let mean = distances.sum::<f64>() / a.rgba.len() as f64;
        let name = built.dataset.provenance.path.display();
        println!("{name} at {distance} sizes, {vq_bits} bits: mean colour error {mean:.3}");
        largest = largest.max(mean);
    }
    largest
}

fn check(build: impl Fn(VqBits) -> Built, of: fn(&Dataset) -> Bounds) {
    for (bits, bound) in [(VqBits::Eight, 2.0), (VqBits::Sixteen, 0.2)] {
        let built = build(bits);
        let (error, name) = (color_error(&built, of, bits), built.dataset.provenance.path.display());
        assert!(error <= bound, "{name}: {error:.3}/255 with {bits} bits, bound {bound}/255");
    }
}

fn check_all(source: &Path) {
    check(|bits| built(source, bits), Dataset::bounds);
}

#[test]
fn dark_matter_keeps_its_colors() {
    check_all(&demo());
}

#[test]
fn a_gas_sphere_keeps_its_colors() {
    check_all(&in_repository("tests/data/gas_sphere_collapse_025.hdf5"));
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn reference_snapshots_keep_their_colors() {
    for name in ["sequences/star_merger/snapshot_012.hdf5", "particles/galaxy_littleendian.dat"] {
        check_all(&in_reference_data(name));
    }
}

/// Temperatures over six decades, and a galaxy of a few kpc in a box of 15 Mpc: looked at where most particles are.
#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn the_gas_of_a_galaxy_keeps_its_colors() {
    let options = LoadOptions { families: vec![FamilyName::Gas], ..LoadOptions::default() };
    check(|bits| built_from(&in_reference_data("particles/fire_galaxy_a.hdf5"), &options, bits), core);
}
