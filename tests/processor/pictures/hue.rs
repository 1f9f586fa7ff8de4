//! The hue of a picture does not depend on the level of detail, where dense particles are hotter than others near by.

use crate::support::{Random, dataset_of, gas, sum_nodes};
use deepfield::build::{BuildOptions, build};
use deepfield::codec::VqBits;
use deepfield::look::{Attribute, CameraConfig, LookPatch, Shot};
use deepfield::mode::{Columns, Depiction, Mode, Raw, Settings};
use deepfield::model::{self, Dataset, Unit};
use deepfield::modes::{column_density, density_squared, points};
use deepfield::picture::{Picture, Session};
use deepfield::store::PageFile;
use deepfield::stream::Scene;
use deepfield::view::{Projection, Surround, View};
use glam::DVec3;
use std::sync::Arc;
use tempfile::TempDir;

const EDGE: f64 = 100.0;
const CLUMPS: usize = 1200;
/// Particles of a clump, which lie in one cell of any node's grid.
const OF_CLUMP: usize = 8;

/// Clumps of one dense and hot particle and seven others.
fn clumps() -> Dataset {
    let mut random = Random(11);
    let mut family = gas();
    for _ in 0..CLUMPS {
        let middle = [(); 3].map(|()| EDGE * random.next());
        for i in 0..OF_CLUMP {
            family.positions.push(middle.map(|x| x + 1e-6 * random.next()));
            family.mass.push((1.0 + random.next()) as f32);
            family.smoothing_length.push(2.0);
            family.density.push(if i == 0 { 1000.0 } else { 1.0 });
            family.attributes[0].values.push(if i == 0 { 1e6 } else { 1e4 });
        }
    }
    dataset_of(family)
}

/// The same with magnitudes: the dense and hot one of a clump is a thousand times as bright as another.
fn stars() -> Dataset {
    let mut dataset = clumps();
    let family = &mut dataset.families[0];
    let values = (0..CLUMPS * OF_CLUMP).map(|i| if i % OF_CLUMP == 0 { 0.0 } else { 7.5 }).collect();
    family.attributes.push(model::Attribute { name: "magnitude".into(), unit: Unit::new("mag"), values });
    dataset
}

/// The mean temperature, weighted as a mode does.
fn mean(dataset: &Dataset, mode: &Mode) -> f64 {
    let gas = &dataset.families[0];
    let attributes: Vec<(&str, &[f32])> = gas.attributes.iter().map(|one| (&*one.name, &one.values[..])).collect();
    let (mass, density, smoothing_length) = (&gas.mass, &gas.density, &gas.smoothing_length);
    let weights = (mode.weight)(&Columns { mass, density, smoothing_length, attributes: &attributes });
    let add = |[sum, hot]: [f64; 2], (&weight, &t): (&f32, &f32)| {
        [sum + f64::from(weight), hot + f64::from(weight) * f64::from(t)]
    };
    let [sum, hot] = weights.iter().zip(&gas.attributes[0].values).fold([0.0; 2], add);
    hot / sum
}

/// A page file with so many particles in a leaf at most.
fn built(dataset: Dataset, leaf_capacity: usize) -> (Arc<PageFile>, TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clumps.df");
    let mut options = BuildOptions::with_vq_bits(VqBits::Sixteen);
    options.octree.leaf_capacity = leaf_capacity;
    build(dataset, &options, &path, &()).unwrap();
    (Arc::new(PageFile::open(&path).unwrap()), folder)
}

#[test]
fn means_of_an_attribute_are_those_of_the_source_in_merged_particles() {
    let dataset = clumps();
    let expected = mean(&dataset, &column_density::MODE);
    let (file, _folder) = built(dataset, 64);
    let middle = DVec3::splat(0.5 * EDGE);
    let projection = Projection::Orthographic { height: 1.2 * EDGE };
    let view = View::look_at(middle + DVec3::Z * 2.0 * EDGE, middle, DVec3::Y, projection, 48, 48).unwrap();
    let metadata = file.metadata();
    let depiction = Depiction::new(&column_density::MODE, Settings::default(), Some("temperature"), metadata).unwrap();
    let pictures = [1e-6, 4.0].map(|tau| {
        let selection = Scene::new(Arc::clone(&file), u64::MAX).converge_blocking(&view, tau).unwrap();
        sum_nodes(&view, &depiction, metadata, &selection.nodes)
    });
    for picture in &pictures {
        assert!(picture.has_attribute());
        let mean = picture.ps.iter().map(|&ps| f64::from(ps)).sum::<f64>() / picture.sum();
        // What thinning may leave out is 5e-4 of the mass.
        assert!((mean / expected - 1.0).abs() < 0.01, "{mean} {expected}");
    }
    // Other particles were drawn, by their places.
    assert!(pictures[0].p != pictures[1].p);
}

/// Merged particles have means by mass, so that a mode that weighs otherwise draws what is not merged, within the same error.
fn has_the_hue_of_the_source(dataset: Dataset, own: &'static Mode) {
    let [by_mass, expected] = [&column_density::MODE, own].map(|mode| mean(&dataset, mode));
    // Leaves right below the first node.
    let (file, _folder) = built(dataset, 2000);
    let mut session = Session::of(file, u64::MAX);
    let hue = |picture: &Picture| {
        let Raw::Sums(sums, _) = &picture.values else { panic!("colours") };
        sums.ps.iter().map(|&ps| f64::from(ps)).sum::<f64>() / sums.sum()
    };
    for (surround, ortho) in [(Surround::Flat, Some(1.2 * EDGE)), (Surround::Equirectangular, None)] {
        let about = format!("{}, {surround:?}", own.name);
        let mut draw = |mode: &'static Mode, is_colored: bool, error_px: f64| {
            let attribute = if is_colored { Attribute::Named("temperature".into()) } else { Attribute::None };
            let (mode, attribute, error_px) = (Some(mode), Some(attribute), Some(error_px));
            let look = LookPatch { mode, attribute, error_px, ..LookPatch::default() };
            let middle = 0.5 * EDGE;
            let (eye, target) = (Some([middle, middle, 3.0 * EDGE]), Some([middle; 3]));
            let camera = CameraConfig { eye, target, ortho, ..CameraConfig::default() };
            let picture =
                session.draw(&Shot { look, camera, size: Some((64, 32)), surround, ..Shot::default() }).unwrap();
            assert!(picture.converged, "{about}");
            picture
        };
        let merged = draw(own, false, 64.0);
        let tau = 1.25 * merged.error_px;
        let plain = draw(own, false, tau);
        let mass = draw(&column_density::MODE, true, tau);
        assert_eq!([plain.particles, mass.particles], [merged.particles; 2], "{about}");
        assert!((hue(&mass) / by_mass - 1.0).abs() < 0.02, "{about}: {} {by_mass}", hue(&mass));
        let colored = draw(own, true, tau);
        assert!(colored.particles > 4 * merged.particles, "{about}: {} {}", colored.particles, merged.particles);
        assert!(colored.error_px <= own.hue_tolerance * tau, "{about}: {} of {tau}", colored.error_px);
        assert!((hue(&colored) / expected - 1.0).abs() < 0.01, "{about}: {} {expected}", hue(&colored));
        // What it is of merged particles.
        let coarse = draw(own, true, tau / own.hue_tolerance);
        assert!(coarse.particles == merged.particles && hue(&coarse) < 0.3 * expected, "{about}: {}", hue(&coarse));
    }
}

#[test]
fn squared_densities_have_the_hue_of_the_source_where_others_draw_merged_particles() {
    has_the_hue_of_the_source(clumps(), &density_squared::MODE);
}

/// Colours of stars are those of the bright ones. Points of mass are no finer than others.
#[test]
fn stars_have_the_hue_of_the_source_where_others_draw_merged_particles() {
    has_the_hue_of_the_source(stars(), &points::MODE);
    let shares = [stars(), clumps()].map(|dataset| {
        let (file, _folder) = built(dataset, 2000);
        let metadata = file.metadata();
        let depiction = Depiction::new(&points::MODE, Settings::default(), Some("temperature"), metadata).unwrap();
        depiction.error_share(metadata)
    });
    assert_eq!(shares, [points::MODE.hue_tolerance, 1.0]);
}
