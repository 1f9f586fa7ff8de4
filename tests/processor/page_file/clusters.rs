//! The promises of clusters (HE03): sums and means at any number, displacements, and bytes that depend on the particles alone.

use crate::support::{Random, dataset_of, gas};
use deepfield::build::{BuildOptions, build};
use deepfield::codec::clusters::cluster_limit;
use deepfield::hierarchy::kind::PCA;
use deepfield::hierarchy::pca::SplitRule;
use deepfield::hierarchy::{ClusterOptions, Kinds, OctreeOptions};
use deepfield::model::{Family, Kernel, Placement};
use deepfield::store::{Encoding, NodeRef, PageFile, PageId, Particles, Representative, verify};
use glam::{DMat3, DVec3};
use proptest::prelude::*;
use std::path::{Path, PathBuf};

/// Particles in a thin background, two rods and a dense clump: shapes and densities of all kinds.
fn particles(count: usize, seed: u64, coincide: bool) -> Family {
    let mut random = Random(seed);
    let mut family = gas();
    for i in 0..count {
        let mut next = || random.next();
        let [a, b, c] = [next(), next(), next()];
        let (position, h) = match i % 4 {
            0 => ([a, b, c], 0.1),
            1 => ([a, a + 0.002 * (b - 0.5), 0.5 + 0.002 * (c - 0.5)], 0.01),
            2 => ([0.3, 0.4 + 0.002 * (b - 0.5), c], 0.01),
            _ => ([0.7 + 1e-4 * a, 0.2 + 1e-4 * b, 0.6 + 1e-4 * c], 1e-5 * (1.0 + next())),
        };
        let position = if coincide && i % 4 == 3 { [0.7, 0.2, 0.6] } else { position };
        family.positions.push(position.map(|x| 10.0 * x));
        family.mass.push((1.0 + (i % 3) as f64) as f32);
        family.smoothing_length.push(10.0 * h as f32);
        family.density.push((1.0 / h) as f32);
        family.attributes[0].values.push((1e4 * 10.0_f64.powf(next())) as f32);
    }
    family
}

fn options(hierarchies: Kinds, rule: SplitRule) -> BuildOptions {
    BuildOptions {
        hierarchies,
        clusters: ClusterOptions { rule, ..ClusterOptions::default() },
        octree: OctreeOptions { leaf_capacity: 150, ..OctreeOptions::default() },
        ..BuildOptions::default()
    }
}

fn both() -> Kinds {
    Kinds::of_particles()
}

fn built(folder: &Path, family: Family, options: &BuildOptions) -> PathBuf {
    let path = folder.join("clusters.df");
    build(dataset_of(family), options, &path, &()).unwrap();
    verify(&path, &()).unwrap();
    path
}

/// The particles in a node's subtree, as leaves have them: place, mass, variance of the kernel.
fn below(file: &PageFile, at: NodeRef, out: &mut Vec<(DVec3, f64, f64)>) {
    let page = file.read_page(at.page).unwrap();
    let node = &page.nodes[at.node as usize];
    if node.encoding == Encoding::Leaf {
        let particles = page.particles(at.node as usize);
        let book = &file.metadata().families[page.family as usize].codebooks[usize::from(node.codebook)];
        out.extend((0..particles.len()).map(|i| {
            let code = usize::from(particles.codes[i]);
            let h = f64::from(book.smoothing_length[code]);
            let mass = f64::from(node.mass_scale * book.mass[code]);
            (node.frame.position(particles.fraction(i)), mass, Kernel::CubicSpline.variance() * h * h)
        }));
    }
    page.children(at.node as usize).iter().for_each(|&child| below(file, child, out));
}

fn outer(d: DVec3) -> DMat3 {
    DMat3::from_cols(d * d.x, d * d.y, d * d.z)
}

proptest! {
    #![proptest_config(crate::cases::cases(8))]

    /// Of any part of any node: the mass, the centre of mass, and within what codes round the second moments of the particles; every
    /// particle is within `delta` of some cluster.
    #[test]
    fn any_part_of_a_node_has_the_sums_of_its_particles(
        seed: u64,
        count in 300..4000_usize,
        coincide: bool,
        published: bool,
        octree: bool,
    ) {
        let folder = tempfile::tempdir().unwrap();
        let rule = if published { SplitRule::Distortion } else { SplitRule::Relative };
        let mut own = options(if octree { both() } else { Kinds::of([&PCA]) }, rule);
        own.octree.vq_bits = deepfield::codec::VqBits::Sixteen;
        let path = built(folder.path(), particles(count, seed, coincide), &own);
        let file = PageFile::open(&path).unwrap();
        let family = &file.metadata().families[0];
        prop_assert_eq!((family.has_octree(), family.clusters.is_some()), (octree, true));
        let mut nodes = 0;
        for id in (0..file.page_count()).map(PageId) {
            let page = file.read_page(id).unwrap();
            for (i, node) in page.nodes.iter().enumerate().filter(|(_, node)| node.encoding.is_clusters()) {
                nodes += 1;
                let mut sources = Vec::new();
                below(&file, NodeRef { page: id, node: i as u32 }, &mut sources);
                prop_assert_eq!(sources.len() as u64, node.source_particles);
                let mass: f64 = sources.iter().map(|own| own.1).sum();
                let centre = sources.iter().map(|own| own.1 * own.0).sum::<DVec3>() / mass;
                let moments = |(at, m, v): &(DVec3, f64, f64)| (outer(*at - centre) + DMat3::from_diagonal(DVec3::splat(*v))) * *m;
                let spread = sources.iter().map(moments).fold(DMat3::ZERO, |sum, own| sum + own) * mass.recip();
                let trace = spread.x_axis.x + spread.y_axis.y + spread.z_axis.z;
                let content = page.content(i).unwrap();
                let mut before = 0;
                for part in [1, 2, 7, 40, 300].map(Some).into_iter().chain([None]) {
                    let drawn = content.clusters(part, Representative::Ellipsoid).unwrap();
                    let count = drawn.len();
                    prop_assert!(part.is_none_or(|part| count <= part as usize) && count >= before);
                    before = count;
                    let own: f64 = drawn.values.mass.iter().map(|&m| f64::from(m)).sum();
                    prop_assert!((f64::from(node.mass_scale) * own / mass - 1.0).abs() < 1e-5);
                    let weights = || drawn.values.mass.iter().map(|&m| f64::from(m) / own);
                    let middle: DVec3 = weights().zip(&drawn.positions).map(|(w, at)| w * DVec3::from_array(*at)).sum();
                    prop_assert!((middle - centre).length() < 1e-5 * node.frame.size, "{middle} {centre}");
                    let moments = weights().zip(&drawn.positions).zip(&drawn.covariances).map(|((w, at), own)| {
                        (outer(DVec3::from_array(*at) - centre) + own.matrix()) * w
                    });
                    let found = moments.fold(DMat3::ZERO, |sum, own| sum + own);
                    let off = (found - spread).to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max);
                    prop_assert!(off < 0.1 * trace, "{found} {spread}");
                    let round = content.clusters(part, Representative::Published).unwrap();
                    prop_assert!(round.covariances.is_empty() && round.values.smoothing_length.iter().all(|h| *h > 0.0));
                }
                prop_assert_eq!(before, node.particles as usize);
                let all = content.particles(0.0);
                for (at, ..) in &sources {
                    let nearest = all.positions.iter().map(|own| DVec3::from_array(*own).distance(*at));
                    prop_assert!(nearest.fold(f64::INFINITY, f64::min) <= node.delta);
                }
                // What a part is worth never grows with what is drawn.
                let steps = content.steps();
                prop_assert_eq!(steps.last().map(|step| step.clusters), Some(node.particles));
                let falling = &steps[..steps.len() - 1];
                prop_assert!(falling.windows(2).all(|pair| pair[1].priority <= pair[0].priority * 1.01));
            }
        }
        prop_assert!(nodes > 0);
    }
}

#[test]
fn a_file_depends_on_the_particles_alone() {
    let folder = tempfile::tempdir().unwrap();
    let mut family = particles(20_000, 5, true);
    let first = std::fs::read(built(folder.path(), family.clone(), &options(both(), SplitRule::Relative))).unwrap();
    for threads in [1, 3] {
        let own =
            BuildOptions { threads: Some(threads), memory: Some(64 << 20), ..options(both(), SplitRule::Relative) };
        assert!(std::fs::read(built(folder.path(), family.clone(), &own)).unwrap() == first, "{threads} threads");
    }
    family.positions.reverse();
    for column in
        [&mut family.mass, &mut family.smoothing_length, &mut family.density, &mut family.attributes[0].values]
    {
        column.reverse();
    }
    assert!(std::fs::read(built(folder.path(), family, &options(both(), SplitRule::Relative))).unwrap() == first);
}

/// The octree of a file is what it is without clusters.
#[test]
fn an_octree_is_the_same_with_clusters() {
    let folder = tempfile::tempdir().unwrap();
    for (refined, versions) in [(false, [2, 4]), (true, [5, 5])] {
        let of = |kinds: Kinds| {
            let mut own = options(kinds, SplitRule::Relative);
            own.octree.refined = refined;
            // So large that no leaf is deeper than those of any version.
            own.octree.leaf_capacity = 500;
            let path = built(folder.path(), particles(5000, 3, false), &own);
            (std::fs::read(&path).unwrap()[8], PageFile::open(&path).unwrap().metadata().clone())
        };
        let ((plain, without), (clustered, with)) = (of(Kinds::default()), of(both()));
        assert_eq!([plain, clustered], versions);
        let (with, without) = (&with.families[0], &without.families[0]);
        assert_eq!((&with.levels, &with.codebooks), (&without.levels, &without.codebooks));
        assert_eq!((&with.refinements, with.column_error), (&without.refinements, without.column_error));
    }
}

/// Where a scene's units take densities beyond 32-bit numbers, clusters have the nearest that are, as leaves do.
#[test]
fn densities_of_clusters_end_where_32_bits_do() {
    let folder = tempfile::tempdir().unwrap();
    let path = built(folder.path(), particles(2000, 7, false), &options(Kinds::of([&PCA]), SplitRule::Relative));
    for (scale, expected) in [(1e-20, f32::MAX), (1e20, f32::MIN_POSITIVE)] {
        let placement = Placement { scale, ..Placement::HERE };
        let (file, _) = PageFile::join(vec![(PageFile::open(&path).unwrap(), placement)]).unwrap();
        let mut nodes = 0;
        for page in (0..file.page_count()).map(|id| file.read_page(PageId(id)).unwrap()) {
            for i in (0..page.nodes.len()).filter(|i| page.nodes[*i].encoding.is_clusters()) {
                nodes += 1;
                let drawn = page.content(i).unwrap().clusters(Some(40), Representative::Ellipsoid).unwrap();
                assert!(drawn.values.density.iter().all(|density| *density == expected), "{:?}", drawn.values.density);
            }
        }
        assert!(nodes > 0);
    }
}

#[test]
fn one_cluster_has_the_axes_of_a_flat_cloud() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = Random(11);
    let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.0);
    let mut family = particles(30_000, 1, false);
    let mut normal = || (0..12).map(|_| random.next()).sum::<f64>() - 6.0;
    for (at, h) in family.positions.iter_mut().zip(&mut family.smoothing_length) {
        *at = (turn * DVec3::new(normal(), 0.2 * normal(), 0.05 * normal())).to_array();
        *h = 0.01;
    }
    let path = built(folder.path(), family, &options(both(), SplitRule::Relative));
    let file = PageFile::open(&path).unwrap();
    let root = file.metadata().families[0].clusters.as_ref().unwrap().root_page;
    let page = file.read_page(root).unwrap();
    let one = page.content(0).unwrap().clusters(Some(1), Representative::Ellipsoid).unwrap();
    assert_eq!(one.len(), 1);
    let (values, axes) = one.covariances[0].principal();
    for (k, deviation) in [1.0, 0.2, 0.05].into_iter().enumerate() {
        assert!((values[k].sqrt() / deviation - 1.0).abs() < 0.03, "{values}");
        let degrees = axes.col(k).dot(turn * DMat3::IDENTITY.col(k)).abs().min(1.0).acos().to_degrees();
        assert!(degrees < 1.0, "{degrees}");
    }
}

/// What renderers choose from many times holds for every number what is drawn of it, in the same order of splits, and no more than one less
/// than twice the clusters.
#[test]
fn unions_are_what_is_drawn_of_any_number() {
    let folder = tempfile::tempdir().unwrap();
    let path = built(folder.path(), particles(9000, 5, true), &options(both(), SplitRule::Distortion));
    let file = PageFile::open(&path).unwrap();
    let page = file.read_page(file.metadata().families[0].clusters.as_ref().unwrap().root_page).unwrap();
    let content = page.content(0).unwrap();
    let all = page.nodes[0].particles;
    for representative in [Representative::Ellipsoid, Representative::Round, Representative::Published] {
        let unions = content.cluster_unions(representative).unwrap();
        assert!(unions.from.is_sorted() && unions.clusters.len() < 2 * all as usize);
        for count in (1..all).step_by(37).map(Some).chain([Some(all), None]) {
            let limit = cluster_limit(count, all);
            let is_drawn = |i: &u32| (unions.from[*i as usize]..=unions.to[*i as usize]).contains(&limit);
            let which: Vec<u32> = (0..unions.clusters.len() as u32).filter(is_drawn).collect();
            let (found, expected) = (unions.clusters.some(&which), content.clusters(count, representative).unwrap());
            // Sums of sums round otherwise than sums of clusters.
            let entries = |of: &Particles| {
                let entry = |i: usize| {
                    let values = &of.values;
                    let own = [values.mass[i], values.density[i], values.smoothing_length[i]].into_iter();
                    let own = own.chain(values.attributes.iter().map(|column| column[i]));
                    let shape = of.covariances.get(i).map_or([0.0; 6], |covariance| covariance.0);
                    (of.positions[i], own.collect::<Vec<f32>>(), shape)
                };
                let mut entries: Vec<_> = (0..of.len()).map(entry).collect();
                entries.sort_by(|a, b| a.partial_cmp(b).unwrap());
                entries
            };
            let (found, expected) = (entries(&found), entries(&expected));
            assert_eq!(found.len(), expected.len(), "{count:?}");
            for (found, expected) in found.iter().zip(&expected) {
                let near = |a: &[f64], b: &[f64], most: f64| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= most);
                assert!(near(&found.0, &expected.0, 1e-12), "{count:?}: {found:?} {expected:?}");
                let single = |a: &f32, b: &f32| (a - b).abs() <= 1e-4 * a.abs();
                assert!(
                    found.1.iter().zip(&expected.1).all(|(a, b)| single(a, b)),
                    "{count:?}: {found:?} {expected:?}"
                );
                let most = 1e-6 * f64::from(expected.2[0] + expected.2[1] + expected.2[2]) + 1e-12;
                let [a, b] = [found.2, expected.2].map(|shape| shape.map(f64::from));
                assert!(near(&a, &b, most), "{count:?}: {found:?} {expected:?}");
            }
        }
    }
}
