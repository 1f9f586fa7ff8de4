//! Particles so close together that cells of a depth of 14, or even the smallest ones, do not part them.

use crate::support::{Random, draw_pages, draw_source};
use deepfield::build::{BuildOptions, build};
use deepfield::cpu::Method;
use deepfield::explore::particle::{ParticleRef, describe};
use deepfield::explore::{Data, ProbeOptions, Region, Work, probe};
use deepfield::hierarchy::{Kinds, OctreeOptions};
use deepfield::model::{Dataset, Family, FamilyName, Kernel, Provenance, Unit};
use deepfield::store::{Located, NodeRef, Page, PageFile, PageId, SourcePlace, verify};
use deepfield::view::{Projection, View};
use glam::DVec3;
use proptest::prelude::*;
use std::collections::HashSet;
use std::iter::repeat_n;
use std::path::Path;
use std::sync::Arc;

/// Particles at these positions, with one smoothing length.
fn dataset(positions: Vec<[f64; 3]>, smoothing: f64) -> Dataset {
    let count = positions.len();
    let family = Family {
        name: FamilyName::Dark,
        positions,
        mass: (0..count).map(|i| 1.0 + (i % 3) as f32).collect(),
        smoothing_length: vec![smoothing as f32; count],
        density: vec![1e6; count],
        attributes: Vec::new(),
    };
    Dataset {
        families: vec![family],
        length_unit: Unit::default(),
        mass_unit: Unit::default(),
        kernel: Kernel::CubicSpline,
        skipped: Vec::new(),
        provenance: Provenance::default(),
    }
}

/// Clusters of as many particles each, whose edges are `edge` of the box, all at one position where that is 0.
struct Clusters {
    data: Dataset,
    centers: Vec<DVec3>,
    each: usize,
    edge: f64,
}

impl Clusters {
    fn new(seed: u64, clusters: usize, each: usize, edge: f64) -> Clusters {
        let mut random = Random(seed);
        let mut any = || DVec3::new(random.next(), random.next(), random.next());
        let centers: Vec<DVec3> = (0..clusters).map(|_| any()).collect();
        let count = clusters * each;
        let positions = (0..count).map(|i| (centers[i % clusters] + edge * (any() - 0.5)).to_array()).collect();
        let data = dataset(positions, 0.2 * edge.max(1e-8));
        Clusters { data, centers, each, edge }
    }

    /// Checks leaves ([`check_leaves`]), and what is found around every cluster.
    fn check(&self, path: &Path, capacity: usize) -> Arc<PageFile> {
        let own: Vec<[f64; 3]> = self.data.families[0].positions.iter().step_by(self.centers.len()).copied().collect();
        let (file, found) = check_leaves(&self.data, path, capacity, &own);
        assert_eq!(found as usize, self.each);
        for center in &self.centers {
            check_sphere(&file, &self.data, *center, 1e-3);
        }
        file
    }

    /// Checks that pictures from near are those of the source, by relative differences of column densities, and that nothing is lost from
    /// afar, where a cluster is a point that may be in the pixel beside.
    fn check_pictures(&self, file: &Arc<PageFile>) {
        let near = Projection::Orthographic { height: 2.0 * self.edge.max(1e-8) };
        let pictures = |middle: DVec3, projection, tau| {
            let view = View::look_at(middle + 2.0 * DVec3::Z, middle, DVec3::Y, projection, 48, 48).unwrap();
            let expected = draw_source(&self.data, "column-density", &view, Method::Pyramid);
            (draw_pages(file, "column-density", &view, tau), expected)
        };
        let (found, expected) = pictures(DVec3::splat(0.5), Projection::Orthographic { height: 1.2 }, 0.5);
        assert!((found.sum() / expected.sum() - 1.0).abs() < 1e-3, "{} of {}", found.sum(), expected.sum());
        // Half a pixel is a fifth of where kernels are a few pixels wide, and another fifth where they were; a cluster that is lost is all.
        for (middle, tau, most) in [(self.centers[0], 1e-3, 0.03), (self.centers[1], 0.5, 0.4)] {
            let (found, expected) = pictures(middle, near, tau);
            let difference: f64 =
                found.p.iter().zip(&expected.p).map(|(a, b)| (f64::from(*a) - f64::from(*b)).abs()).sum();
            assert!(difference <= most * expected.sum(), "{difference} of {}, tau {tau}", expected.sum());
        }
    }
}

/// Checks that a file has no larger leaves, that every particle is in one of them, and none is anywhere else; and counts some of them in leaves.
fn check_leaves(data: &Dataset, path: &Path, capacity: usize, some: &[[f64; 3]]) -> (Arc<PageFile>, u32) {
    let positions = &data.families[0].positions;
    assert_eq!(verify(path, &()).unwrap().particles, positions.len() as u64);
    let file = Arc::new(PageFile::open(path).unwrap());
    let family = &file.metadata().families[0];
    assert!(family.levels.len() > 15, "{} levels", family.levels.len());
    assert_eq!(std::fs::read(path).unwrap()[8], 6);
    let pages: Vec<Page> = (0..file.page_count()).map(|id| file.read_page(PageId(id)).unwrap()).collect();
    let nodes = || pages.iter().flat_map(|page| page.nodes.iter().enumerate().map(move |node| (page, node)));
    let leaves = || nodes().filter(|(_, (_, node))| node.is_leaf());
    // What is drawn at random differs from leaf to leaf, those of one cell too.
    assert_eq!(leaves().map(|(_, (_, node))| node.seed).collect::<HashSet<u32>>().len(), leaves().count());
    let place = |at: &[f64; 3]| -> SourcePlace { family.place(DVec3::from_array(*at)) };
    let all = Located::new(positions.iter().map(place).collect());
    let some = Located::new(some.iter().map(place).collect());
    let (mut bits, mut found) = (Vec::new(), 0);
    for (page, (index, node)) in leaves() {
        assert!(node.particles as usize <= capacity, "{} particles in a leaf", node.particles);
        assert_eq!(all.mark(page, index, &mut bits), node.particles);
        found += some.mark(page, index, &mut bits);
        let at = NodeRef { page: page.id, node: index as u32 };
        let told = describe(&*file, ParticleRef { node: at, index: node.particles / 2 }).unwrap();
        let apart = |source: &[f64; 3]| (DVec3::from_array(*source) - told.position).abs().max_element();
        let is_found = positions.iter().any(|source| apart(source) <= told.rounding + 1e-12);
        assert!(is_found, "{}", told.position);
    }
    (file, found)
}

/// Checks how many particles are found in a sphere.
fn check_sphere(file: &PageFile, data: &Dataset, center: DVec3, radius: f64) {
    let is_inside = |at: &&[f64; 3]| DVec3::from_array(**at).distance(center) <= radius;
    let inside = data.families[0].positions.iter().filter(is_inside).count();
    let region = Region::sphere(center, radius);
    let told = probe(Data::Pages(file), &region, &ProbeOptions::default(), Work::quiet()).unwrap();
    assert_eq!(told.count, inside as u64);
}

proptest! {
    #![proptest_config(crate::cases::cases(4))]

    /// Whatever the particles' distances are, and the same bytes whoever builds.
    #[test]
    fn tight_clusters_are_found_again(
        seed: u64,
        edge in prop_oneof![Just(0.0), Just(1e-7), -7.0..-5.5_f64],
        capacity in 16..60_usize,
        volume_levels: bool,
        clusters: bool,
    ) {
        let edge = if edge < 0.0 { 10_f64.powf(edge) } else { edge };
        let folder = tempfile::tempdir().unwrap();
        let own = Clusters::new(seed, 10, 300, edge);
        let octree = OctreeOptions {
            bucket_particles: Some(400),
            leaf_capacity: capacity,
            root_particles: 1 << 40,
            volume_levels,
            refined: seed % 2 == 0,
            ..OctreeOptions::default()
        };
        let hierarchies = if clusters { Kinds::of_particles() } else { Kinds::default() };
        let path = folder.path().join("deep.df");
        let built = |threads: usize, memory: Option<u64>| {
            let options = BuildOptions { octree, hierarchies, memory, threads: Some(threads), ..BuildOptions::default() };
            build(own.data.clone(), &options, &path, &()).unwrap();
            std::fs::read(&path).unwrap()
        };
        let bytes = built(1, None);
        for (threads, memory) in [(2, None), (2, Some(8 << 20))] {
            prop_assert!(built(threads, memory) == bytes, "{threads} threads, {memory:?} bytes of memory");
        }
        let file = own.check(&path, capacity);
        own.check_pictures(&file);
    }
}

/// Cells of all depths beside each other: a clump in a wider one, and few particles all around.
#[test]
fn clumps_within_clumps_are_found_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("nested.df");
    for seed in 1..=3 {
        let mut random = Random(seed);
        let mut any = || DVec3::new(random.next(), random.next(), random.next());
        let center = any();
        let widths = [(3000, 1e-5), (400, 2e-3)].into_iter().flat_map(|(count, width)| repeat_n(width, count));
        let clumps: Vec<DVec3> = widths.map(|width| center + width * (any() - 0.5)).collect();
        let positions = clumps.into_iter().chain((0..2000).map(|_| any())).map(|at| at.to_array()).collect();
        let data = dataset(positions, 1e-7);
        let octree = OctreeOptions {
            bucket_particles: Some(400),
            leaf_capacity: 50,
            root_particles: 1 << 40,
            volume_levels: seed == 2,
            ..OctreeOptions::default()
        };
        build(data.clone(), &BuildOptions { octree, ..BuildOptions::default() }, &path, &()).unwrap();
        let (file, _) = check_leaves(&data, &path, 50, &[]);
        // All of the clump, and of the wider one.
        for radius in [1e-5, 2e-3] {
            check_sphere(&file, &data, center, radius);
        }
    }
}

#[test]
fn many_particles_at_one_position_share_leaves() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("one.df");
    let own = Clusters::new(1, 2, 50_000, 0.0);
    let options = BuildOptions::default();
    let metadata = build(own.data.clone(), &options, &path, &()).unwrap().metadata;
    let file = PageFile::open(&path).unwrap();
    assert_eq!(verify(&path, &()).unwrap().particles, 100_000);
    let levels = &metadata.families[0].levels;
    let leaves: u64 = levels.iter().map(|level| level.leaf_nodes).sum();
    assert_eq!((levels.len(), leaves), (23, 2 * 50_000_u64.div_ceil(options.octree.leaf_capacity as u64)));
    // Merged they are one.
    assert_eq!(levels[21].points + levels[21].sprites, 2);
    for center in own.centers {
        let told = probe(Data::Pages(&file), &Region::sphere(center, 1e-9), &ProbeOptions::default(), Work::quiet());
        assert_eq!(told.unwrap().count, 50_000);
    }
}
