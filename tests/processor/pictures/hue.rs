//! The hue of a picture does not depend on the level of detail, where dense particles are hotter than others near by.

use crate::support::{Random, dataset_of, gas, sum_nodes};
use deepfield::build::{BuildOptions, build};
use deepfield::codec::VqBits;
use deepfield::mode::{Depiction, Settings};
use deepfield::model::Dataset;
use deepfield::modes;
use deepfield::store::PageFile;
use deepfield::stream::Scene;
use deepfield::view::{Projection, View};
use glam::DVec3;
use std::sync::Arc;

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

#[test]
fn means_of_an_attribute_are_those_of_the_source_in_merged_particles() {
    let dataset = clumps();
    let gas = &dataset.families[0];
    let own =
        gas.mass.iter().zip(&gas.attributes[0].values).map(|(&m, &t)| [f64::from(m), f64::from(m) * f64::from(t)]);
    let [mass, hot] = own.fold([0.0; 2], |[mass, hot], [m, t]| [mass + m, hot + t]);
    let expected = hot / mass;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clumps.df");
    let mut options = BuildOptions::with_vq_bits(VqBits::Sixteen);
    options.octree.leaf_capacity = 64;
    build(dataset, &options, &path, &()).unwrap();
    let file = Arc::new(PageFile::open(&path).unwrap());
    let middle = DVec3::splat(0.5 * EDGE);
    let projection = Projection::Orthographic { height: 1.2 * EDGE };
    let view = View::look_at(middle + DVec3::Z * 2.0 * EDGE, middle, DVec3::Y, projection, 48, 48).unwrap();
    let metadata = file.metadata();
    let mode = modes::find("column-density").unwrap();
    let depiction = Depiction::new(mode, Settings::default(), Some("temperature"), metadata).unwrap();
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
