//! Levels of detail for volumes (F12 5.5.1, 5.5.2): what merging keeps, how both trees share a file, and how near the resampled
//! field is to that of the source particles.

use crate::support::{Random, in_repository};
use deepfield::build::{BuildOptions, build};
use deepfield::codec::{CodebookScope, VqBits};
use deepfield::cpu::volume::bricks::Slab;
use deepfield::cpu::volume::exact::ExactField;
use deepfield::cpu::volume::resample::Resampler;
use deepfield::cpu::volume::{Prepared, VolumeOptions, prepare};
use deepfield::cpu::{Extent, Positions, Splats};
use deepfield::hierarchy::{OctreeOptions, Purpose};
use deepfield::model::{Attribute, Dataset, Family, FamilyName, Kernel, Provenance, Unit};
use deepfield::store::{Encoding, Node, NodeRef, Page, PageFile, PageId, verify};
use deepfield::stream::{Scene, SceneSelection};
use deepfield::synth::merger::Merger;
use deepfield::view::{Detail, PerspectiveGrid, Projection, View};
use glam::DVec3;
use proptest::prelude::*;
use std::sync::Arc;
use tempfile::TempDir;

/// A page file and the particles it was built from.
struct Built {
    family: Family,
    file: Arc<PageFile>,
    pages: Vec<Page>,
    _folder: TempDir,
}

fn built(family: Family, octree: OctreeOptions) -> Built {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("built.df");
    let dataset = Dataset {
        families: vec![family.clone()],
        length_unit: Unit::default(),
        mass_unit: Unit::default(),
        kernel: Kernel::CubicSpline,
        skipped: Vec::new(),
        provenance: Provenance::default(),
    };
    build(dataset, &BuildOptions { octree, ..BuildOptions::default() }, &path, &()).unwrap();
    verify(&path, &()).unwrap();
    let file = Arc::new(PageFile::open(&path).unwrap());
    let pages = (0..file.page_count()).map(|id| file.read_page(PageId(id)).unwrap()).collect();
    Built { family, file, pages, _folder: folder }
}

impl Built {
    fn node(&self, at: NodeRef) -> &Node {
        &self.pages[at.page.0 as usize].nodes[at.node as usize]
    }

    fn children(&self, at: NodeRef) -> &[NodeRef] {
        self.pages[at.page.0 as usize].children(at.node as usize)
    }

    fn root(&self, levels: Purpose) -> NodeRef {
        NodeRef { page: self.file.metadata().families[0].root_page_of(levels).unwrap(), node: 0 }
    }

    /// The nodes of a tree, parents before children.
    fn tree(&self, levels: Purpose) -> Vec<NodeRef> {
        let mut nodes = vec![self.root(levels)];
        let mut next = 0;
        while let Some(&at) = nodes.get(next) {
            nodes.extend(self.children(at));
            next += 1;
        }
        nodes
    }

    /// Position, smoothing length and mass of what is drawn for a node.
    fn drawn(&self, at: NodeRef) -> Vec<(DVec3, f32, f32)> {
        let info = &self.file.metadata().families[0];
        let (node, particles) = (self.node(at), self.pages[at.page.0 as usize].particles(at.node as usize));
        let book = &info.codebooks[usize::from(node.codebook)];
        let particle = |i: usize| {
            let code = usize::from(particles.codes[i]);
            let position = node.frame.position(particles.fraction(i));
            (position, book.smoothing_length[code], book.mass[code] * node.mass_scale)
        };
        (0..particles.len()).map(particle).collect()
    }

    /// Indices of the source particles in a node's cell.
    fn sources(&self, at: NodeRef) -> Vec<usize> {
        let cell = self.node(at).frame.bounds();
        let inside = |p: &[f64; 3]| {
            let p = DVec3::from_array(*p);
            p.cmpge(cell.min).all() && p.cmplt(cell.max).all()
        };
        (0..self.family.positions.len()).filter(|&i| inside(&self.family.positions[i])).collect()
    }
}

/// Particles in clumps, with smoothing lengths from far below merging cells to far above.
fn clumps(seed: u64, count: usize) -> Family {
    let mut random = Random(seed);
    let mut next = || random.next();
    let mut family = Family {
        name: FamilyName::Gas,
        positions: Vec::new(),
        mass: Vec::new(),
        smoothing_length: Vec::new(),
        density: Vec::new(),
        attributes: vec![Attribute { name: "temperature".into(), unit: Unit::default(), values: Vec::new() }],
    };
    for i in 0..count {
        let spread = 10.0_f64.powi(-((i % 5) as i32));
        family.positions.push([0; 3].map(|_| 50.0 + 7.0 * (i % 3) as f64 + 40.0 * spread * (next() - 0.5)));
        let h = spread * 10.0_f64.powf(2.0 * next() - 1.5);
        family.smoothing_length.push(h as f32);
        family.mass.push((0.5 + next()) as f32);
        family.density.push((1.0 / h.powi(3)) as f32);
        family.attributes[0].values.push((1e4 * (0.1 + next())) as f32);
    }
    family
}

fn options(vq_bits: VqBits, leaf_capacity: usize) -> OctreeOptions {
    OctreeOptions { vq_bits, leaf_capacity, volume_levels: true, ..OctreeOptions::default() }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..crate::cases::cases(12) })]

    /// In every node and at every depth: masses and mass-weighted means are those of the source particles, volumes are where nothing
    /// is enlarged, and nothing is smaller than a merging cell.
    #[test]
    fn every_node_keeps_mass_means_and_volume(seed: u64, count in 200..3000_usize, capacity in 5..120_usize) {
        let built = built(clumps(seed, count), options(VqBits::Sixteen, capacity));
        let info = &built.file.metadata().families[0];
        let mut grids = 0;
        let mut enlarged_nodes = 0;
        for at in built.tree(Purpose::Samples) {
            let node = built.node(at);
            if node.encoding != Encoding::Grid {
                continue;
            }
            grids += 1;
            prop_assert!(matches!(info.codebooks[usize::from(node.codebook)].scope, CodebookScope::VolumeDepth(d) if d == node.depth));
            let (sources, drawn) = (built.sources(at), built.drawn(at));
            let mass: f64 = sources.iter().map(|&i| f64::from(built.family.mass[i])).sum();
            let own: f64 = drawn.iter().map(|particle| f64::from(particle.2)).sum();
            prop_assert!((node.mass / mass - 1.0).abs() < 1e-12 && (own / mass - 1.0).abs() < 1e-6, "{} {} {}", mass, node.mass, own);
            prop_assert!((f64::from(node.mass_scale) - 1.0).abs() < 1e-5, "nothing is left out: {}", node.mass_scale);
            let q = node.spacing;
            prop_assert!(drawn.iter().all(|particle| f64::from(particle.1) >= q * (1.0 - 1e-4)));
            let cube = |h: f32| f64::from(h).powi(3);
            let volume: f64 = sources.iter().map(|&i| cube(built.family.smoothing_length[i])).sum();
            let grown: f64 = drawn.iter().map(|particle| cube(particle.1)).sum();
            prop_assert!(grown >= volume * (1.0 - 1e-4), "{} {}", grown, volume);
            let enlarged = node.points > 0 || grown > volume * (1.0 + 1e-4);
            enlarged_nodes += u32::from(enlarged);
            // Where no particle is smaller than a cell there is nothing to do.
            let smallest = sources.iter().map(|&i| built.family.smoothing_length[i]).fold(f32::INFINITY, f32::min);
            prop_assert!(!enlarged || f64::from(smallest) < q);
            // Largest source distance from what is drawn for it.
            let farthest = sources.iter().map(|&i| {
                let source = DVec3::from_array(built.family.positions[i]);
                drawn.iter().map(|particle| particle.0.distance(source)).fold(f64::INFINITY, f64::min)
            });
            prop_assert!(farthest.fold(0.0, f64::max) <= node.delta * (1.0 + 1e-9));
        }
        prop_assert!(grids > 0 || info.levels[0].leaf_nodes > 0 || enlarged_nodes == 0);
        // By cut: what a selection at one depth draws stands for everything once.
        let total: f64 = built.family.mass.iter().map(|&m| f64::from(m)).sum();
        for depth in 0..info.levels.len() as u8 {
            let mut stack = vec![built.root(Purpose::Samples)];
            let (mut drawn, mut particles) = (0.0, 0);
            while let Some(at) = stack.pop() {
                let node = built.node(at);
                if node.encoding != Encoding::Relay && (node.is_leaf() || node.depth >= depth) {
                    drawn += built.drawn(at).iter().map(|particle| f64::from(particle.2)).sum::<f64>();
                    particles += node.source_particles;
                } else {
                    stack.extend(built.children(at));
                }
            }
            prop_assert!((drawn / total - 1.0).abs() < 1e-6);
            prop_assert_eq!(particles, count as u64);
        }
        // The table adds up, and its leaves are those of the other levels.
        let volume = info.volume.as_ref().unwrap();
        prop_assert_eq!(volume.levels.len(), info.levels.len());
        for (i, level) in volume.levels.iter().enumerate() {
            prop_assert_eq!((level.leaf_nodes, level.leaf_particles, level.skipped), (0, 0, 0));
            let arriving = volume.levels.get(i + 1).map_or(0, |below| below.input - below.merged);
            let leaves = info.levels.get(i + 1).map_or(0, |below| below.leaf_particles);
            prop_assert_eq!(level.input, arriving + leaves);
        }
    }

    /// The levels for splats are the same with those for volumes beside them, and so are the leaves of both.
    #[test]
    fn both_trees_are_in_one_file(seed: u64, count in 1..2000_usize, capacity in 5..200_usize) {
        let refined = seed % 2 == 0;
        let octree = OctreeOptions { refined, ..options(VqBits::Eight, capacity) };
        let with = built(clumps(seed, count), octree);
        let without = built(clumps(seed, count), OctreeOptions { volume_levels: false, ..octree });
        let (splats, plain) = (with.tree(Purpose::Splats), without.tree(Purpose::Splats));
        prop_assert_eq!(splats.len(), plain.len());
        for (&a, &b) in splats.iter().zip(&plain) {
            let placeless = |node: &Node| Node { children: 0..0, ..node.clone() };
            prop_assert_eq!(placeless(with.node(a)), placeless(without.node(b)));
            let words = |built: &Built, at: NodeRef| {
                let particles = built.pages[at.page.0 as usize].particles(at.node as usize);
                (particles.words().to_vec(), particles.codes.to_vec())
            };
            prop_assert_eq!(words(&with, a), words(&without, b));
        }
        let (a, b) = (&with.file.metadata().families[0], &without.file.metadata().families[0]);
        prop_assert_eq!(&a.levels, &b.levels);
        prop_assert_eq!(&a.codebooks[..b.codebooks.len()], &b.codebooks[..]);
        prop_assert!(b.volume.is_none() && !without.file.metadata().has_volume_levels());
        let leaves = |levels| {
            let mut leaves = with.tree(levels);
            leaves.retain(|&at| with.node(at).is_leaf());
            leaves.sort_unstable();
            leaves
        };
        prop_assert_eq!(leaves(Purpose::Splats), leaves(Purpose::Samples));
        // Inner nodes are their own, in the same cells.
        let cells = |levels| with.tree(levels).into_iter().map(|at| with.node(at).frame).collect::<Vec<_>>();
        prop_assert_eq!(cells(Purpose::Splats), cells(Purpose::Samples));
        let version = |built: &Built| std::fs::read(built.file.path()).unwrap()[8];
        let expected = match (a.levels.len() > 15, refined) {
            (true, _) => (6, 6),
            (_, true) => (5, 5),
            _ => (3, 2),
        };
        prop_assert_eq!((version(&with), version(&without)), expected);
    }
}

/// Particles of a selection, as the renderer takes them.
struct Cloud {
    positions: Vec<[f64; 3]>,
    smoothing_length: Vec<f32>,
    mass: Vec<f32>,
}

impl Cloud {
    fn of(built: &Built, selection: &SceneSelection) -> Cloud {
        let mut cloud = Cloud { positions: Vec::new(), smoothing_length: Vec::new(), mass: Vec::new() };
        for (position, h, mass) in selection.nodes.iter().flat_map(|drawn| built.drawn(drawn.node)) {
            cloud.positions.push(position.to_array());
            cloud.smoothing_length.push(h);
            cloud.mass.push(mass);
        }
        cloud
    }

    fn batch(&self) -> Splats<'_> {
        let extent = Extent::World(&self.smoothing_length);
        Splats::new(Positions::World(&self.positions), extent, &self.mass, None).unwrap()
    }
}

/// Relative L2 differences of the field that is resampled from a file's levels for volumes.
#[derive(Debug)]
struct Differences {
    /// From the exact sum over the source particles.
    exact: f64,
    /// The same difference of the field that is resampled from the source particles.
    source: f64,
    /// From the same resampling of the source particles.
    same: f64,
    /// Particles drawn.
    particles: u64,
}

/// What the source particles give on the grid of a view around them.
struct Source {
    view: View,
    depths: PerspectiveGrid,
    /// Some of its cells: where, the density as it is resampled, and the exact one.
    cells: Vec<([usize; 3], f64, f64)>,
}

impl Source {
    /// Of every `stride`-th cell.
    fn new(built: &Built, view: View, stride: usize) -> Source {
        let family = &built.family;
        let cloud = Cloud {
            positions: family.positions.clone(),
            smoothing_length: family.smoothing_length.clone(),
            mass: family.mass.clone(),
        };
        let options = VolumeOptions::default();
        let depths = prepare(&view, &[cloud.batch()], &options).unwrap().grid;
        let (prepared, slab) = resampled(&view, &cloud, &depths);
        let exact = ExactField::new(&[cloud.batch()], options.kernel);
        let [k, l, m] = depths.size.map(|size| size as usize);
        let cells = (0..k * l * m).step_by(stride).map(|index| {
            let cell = [index % k, index / k % l, index / k / l];
            let center = depths.center(cell.map(|c| c as u32));
            let world = view.eye + center.x * view.right + center.y * view.up + center.z * view.forward;
            (cell, f64::from(slab.at(cell, prepared.brick_grid())[0]), exact.at(world).density)
        });
        let cells = cells.collect();
        Source { view, depths, cells }
    }
}

/// Resamples particles between the planes of a grid.
fn resampled(view: &View, cloud: &Cloud, depths: &PerspectiveGrid) -> (Prepared, Slab) {
    let options = VolumeOptions { near: Some(depths.near), far: Some(depths.far), ..VolumeOptions::default() };
    let prepared = prepare(view, &[cloud.batch()], &options).unwrap();
    let layers = 0..prepared.brick_grid().bricks[2];
    let (layers, _) = Resampler::new(&prepared, options.kernel).resample(layers, &[]);
    (prepared, Slab { first: 0, layers })
}

/// Resamples what lies within `detail` cells and compares it with what the source particles give.
fn differences(built: &Built, Source { view, depths, cells }: &Source, detail: f64) -> Differences {
    let mut scene = Scene::new(Arc::clone(&built.file), u64::MAX);
    scene.purpose = Purpose::Samples;
    let sigma = detail * PerspectiveGrid::sigma_of(view, 1.0);
    let selection = scene.converge_blocking(view, Detail::Sampling { sigma, near: 0.0 }).unwrap();
    assert!(selection.converged);
    let (prepared, slab) = resampled(view, &Cloud::of(built, &selection), depths);
    let (mut squares, mut norms) = ([0.0; 3], [0.0; 3]);
    for &(cell, whole, exact) in cells {
        let found = f64::from(slab.at(cell, prepared.brick_grid())[0]);
        for (i, (found, reference)) in [(found, exact), (whole, exact), (found, whole)].into_iter().enumerate() {
            squares[i] += (found - reference).powi(2);
            norms[i] += reference.powi(2);
        }
    }
    let [exact, source, same] = [0, 1, 2].map(|i: usize| (squares[i] / norms[i]).sqrt());
    Differences { exact, source, same, particles: selection.particles }
}

fn merger(count: u64) -> Family {
    deepfield::synth::dataset(&Merger::new(3, count)).families.remove(0)
}

/// With the sampling rate, the field comes nearer to the exact one; with the detail, to what the source particles give on the same
/// grid.
#[test]
fn the_resampled_field_converges_with_the_sampling_rate() {
    let octree = OctreeOptions { root_particles: 1 << 9, ..options(VqBits::Sixteen, 300) };
    let built = built(merger(60_000), octree);
    // From far away, so that all depths are sampled alike and few nodes are larger than the picture.
    let view = |side: u32| {
        let projection = Projection::Perspective { fov_y: 0.03 };
        View::look_at(DVec3::new(400.0, 800.0, 1500.0), DVec3::ZERO, DVec3::Y, projection, side, side).unwrap()
    };
    let sources = [(8, 1), (16, 3), (32, 31), (64, 251)].map(|(side, stride)| Source::new(&built, view(side), stride));
    let by_rate = sources.each_ref().map(|source| {
        let found = differences(&built, source, 1.0);
        println!("{} cells: {found:?}", source.view.width);
        found
    });
    // Which samples lie in the dense heart depends on the planes: twice the rate may find more of it, four times finds less.
    for rates in by_rate.windows(3) {
        assert!(rates[2].exact < 0.6 * rates[0].exact && rates[2].particles >= rates[0].particles, "{rates:?}");
    }
    for found in &by_rate {
        assert!(found.exact < 1.05 * found.source && found.same < 0.05, "{found:?}");
    }
    assert!(by_rate[0].particles < 30_000 && by_rate[3].particles > 50_000, "{by_rate:?}");
    let [coarse, less, finest] = [4.0, 2.0, 0.5].map(|detail| {
        let found = differences(&built, &sources[1], detail);
        println!("detail {detail}: {found:?}");
        found
    });
    let by_detail = [&coarse, &less, &by_rate[1], &finest];
    for pair in by_detail.windows(2) {
        assert!(pair[1].same <= pair[0].same && pair[1].particles >= pair[0].particles, "{pair:?}");
    }
    assert!(by_detail[3].same < 0.1 * by_detail[0].same, "{by_detail:?}");
}

/// A file that an earlier version of the program has written.
#[test]
fn files_of_version_2_are_read() {
    let path = in_repository("tests/data/version2.df");
    let verified = verify(&path, &()).unwrap();
    let file = PageFile::open(&path).unwrap();
    assert!(verified.particles > 0 && verified.particles == file.metadata().particles());
    assert!(!file.metadata().has_volume_levels());
}
