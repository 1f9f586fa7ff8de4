//! From particles to a page file and back: the promises of hierarchy, codec and store, on generated particles.

use crate::support::Random;
use deepfield::build::{BuildOptions, build};
use deepfield::codec::{CodeBits, CodebookScope, VqBits};
use deepfield::hierarchy::OctreeOptions;
use deepfield::hierarchy::cell::CELL_DEPTH;
use deepfield::model::{Attribute, Dataset, Family, FamilyName, Kernel, Provenance, ReadMethod, Skipped, Unit};
use deepfield::store::{Encoding, Metadata, NodeRef, Page, PageFile, PageId, verify};
use glam::DVec3;
use proptest::prelude::*;
use std::collections::HashMap;
use std::path::Path;
use tempfile::TempDir;

/// `count` particles: a third uniform, the rest in clumps whose smoothing lengths go from far below a grid cell to far
/// above.
fn clustered(count: usize, seed: u64) -> Family {
    let mut random = Random(seed);
    let clumps: Vec<[f64; 4]> = (0..7).map(|_| std::array::from_fn(|_| random.next())).collect();
    let mut family = Family {
        name: FamilyName::Gas,
        positions: Vec::new(),
        mass: Vec::new(),
        smoothing_length: Vec::new(),
        density: Vec::new(),
        attributes: vec![
            Attribute { name: "temperature".into(), unit: Unit::new("K"), values: Vec::new() },
            Attribute { name: "speed".into(), unit: Unit::new("km/s"), values: Vec::new() },
        ],
    };
    for i in 0..count {
        let spread = if i % 3 == 0 { 1.0 } else { 0.1 * 10.0_f64.powf(-4.0 * clumps[i % 7][3]) };
        let center = &clumps[i % 7];
        let position: [f64; 3] = std::array::from_fn(|axis| {
            if i % 3 == 0 {
                100.0 * random.next()
            } else {
                100.0 * center[axis] + 30.0 * spread * (random.next() - 0.5)
            }
        });
        let h = spread * 10.0_f64.powf(random.next() - 1.0);
        family.positions.push(position);
        family.mass.push((1.0 + 3.0 * (i % 2) as f64) as f32);
        family.smoothing_length.push(h as f32);
        family.density.push((1.0 / h.powi(3)) as f32);
        family.attributes[0].values.push((1e4 * 10.0_f64.powf(3.0 * random.next())) as f32);
        family.attributes[1].values.push(if i % 50 == 0 { f32::NAN } else { (random.next() - 0.5) as f32 });
    }
    family
}

fn dataset(families: Vec<Family>) -> Dataset {
    Dataset {
        families,
        length_unit: Unit::new("kpc"),
        mass_unit: Unit::new("Msun"),
        kernel: Kernel::Poly6,
        skipped: vec![Skipped { reason: "non-finite position".into(), count: 3 }],
        provenance: Provenance { format: "test".into(), notes: vec!["made up".into()], ..Provenance::default() },
    }
}

fn small_leaves(vq_bits: VqBits, leaf_capacity: usize) -> BuildOptions {
    BuildOptions {
        octree: OctreeOptions { vq_bits, leaf_capacity, ..OctreeOptions::default() },
        ..BuildOptions::default()
    }
}

fn build_in(folder: &TempDir, families: Vec<Family>, options: &BuildOptions) -> (std::path::PathBuf, Metadata) {
    let path = folder.path().join("test.df");
    let built = build(dataset(families), options, &path, &()).unwrap();
    assert_eq!(built.bytes, std::fs::metadata(&path).unwrap().len());
    verify(&path, &()).unwrap();
    (path, built.metadata)
}

struct Tree {
    metadata: Metadata,
    pages: Vec<Page>,
}

impl Tree {
    fn read(path: &Path) -> Tree {
        let file = PageFile::open(path).unwrap();
        let pages = (0..file.page_count()).map(|id| file.read_page(PageId(id)).unwrap()).collect();
        Tree { metadata: file.metadata().clone(), pages }
    }

    fn nodes(&self) -> impl Iterator<Item = NodeRef> + '_ {
        self.pages.iter().flat_map(|page| (0..page.nodes.len() as u32).map(|node| NodeRef { page: page.id, node }))
    }

    fn node(&self, at: NodeRef) -> &deepfield::store::Node {
        &self.pages[at.page.0 as usize].nodes[at.node as usize]
    }

    /// World positions and codes of a node's particles.
    fn drawn(&self, at: NodeRef) -> Vec<(DVec3, usize)> {
        let page = &self.pages[at.page.0 as usize];
        let node = self.node(at);
        let particles = page.particles(at.node as usize);
        (0..particles.len())
            .map(|i| (node.frame.position(particles.fraction(i)), usize::from(particles.codes[i])))
            .collect()
    }

    fn codebook(&self, at: NodeRef) -> &deepfield::codec::Codebook {
        let family = self.pages[at.page.0 as usize].family;
        &self.metadata.families[family as usize].codebooks[usize::from(self.node(at).codebook)]
    }
}

proptest! {
    #![proptest_config(crate::cases::cases(12))]

    #[test]
    fn sources_are_within_delta_of_what_is_drawn_for_them(seed: u64, count in 200..2500_usize, capacity in 5..120_usize) {
        let family = clustered(count, seed);
        let folder = tempfile::tempdir().unwrap();
        let mut options = small_leaves(VqBits::Sixteen, capacity);
        options.octree.thinning_budget = 0.0;
        options.octree.exact_positions = seed % 2 == 0;
        let (path, _) = build_in(&folder, vec![family.clone()], &options);
        let tree = Tree::read(&path);
        let root = tree.metadata.families[0].root;
        for at in tree.nodes() {
            let node = tree.node(at);
            let cell = node.frame.bounds();
            // Parts of a smallest cell are told apart by nothing but their order.
            if node.depth > CELL_DEPTH {
                continue;
            }
            let inside = |p: &DVec3| p.cmpge(cell.min).all() && p.cmplt(cell.max).all();
            let sources: Vec<DVec3> = family.positions.iter().map(|p| DVec3::from_array(*p)).filter(inside).collect();
            prop_assert_eq!(sources.len() as u64, node.source_particles);
            let slack = DVec3::splat(1e-9 * root.size);
            let within = |p: &DVec3| p.cmpge(node.bounds.min - slack).all() && p.cmple(node.bounds.max + slack).all();
            prop_assert!(sources.iter().all(within));
            if node.encoding == Encoding::Relay {
                continue;
            }
            let drawn = tree.drawn(at);
            prop_assert!(drawn.iter().all(|(p, _)| within(p)));
            let farthest = sources
                .iter()
                .map(|s| drawn.iter().map(|(p, _)| s.distance(*p)).fold(f64::INFINITY, f64::min))
                .fold(0.0, f64::max);
            prop_assert!(farthest <= node.delta * (1.0 + 1e-9), "{} > {}", farthest, node.delta);
            // Sources and their drawn particle share a cell, so nothing can be farther than its diagonal; those of leaves are
            // rounded to a fraction of their smoothing lengths, if at all.
            let mut step = node.frame.size / if node.encoding == Encoding::Leaf { 2_f64.powi(21) } else { 128.0 };
            if node.encoding == Encoding::Leaf && !options.octree.exact_positions {
                step = step.max(f64::from(node.smoothing_length_max) / 512.0);
                for (source, h) in family.positions.iter().zip(&family.smoothing_length) {
                    let source = DVec3::from_array(*source);
                    let nearest = || drawn.iter().map(|(p, _)| source.distance(*p)).fold(f64::INFINITY, f64::min);
                    let limit = f64::from(*h) / 590.0 + node.frame.size / 2_f64.powi(21);
                    prop_assert!(!inside(&source) || nearest() <= limit);
                }
            }
            prop_assert!(node.delta <= 3.0_f64.sqrt() / 2.0 * step * (1.0 + 1e-6) + 1e-12 * root.size);
            let book = tree.codebook(at);
            prop_assert!(drawn.iter().all(|&(_, code)| book.smoothing_length[code] <= node.smoothing_length_max));
        }
    }

    #[test]
    fn every_level_conserves_mass_and_presence(seed: u64, count in 200..4000_usize, capacity in 5..200_usize) {
        let family = clustered(count, seed);
        let folder = tempfile::tempdir().unwrap();
        let (path, metadata) = build_in(&folder, vec![family.clone()], &small_leaves(VqBits::Eight, capacity));
        let tree = Tree::read(&path);
        let mass: f64 = family.mass.iter().map(|&m| f64::from(m)).sum();
        let presence: f64 = family.mass.iter().zip(&family.density).map(|(&m, &rho)| f64::from(m) * f64::from(rho)).sum();
        let info = &metadata.families[0];
        prop_assert!((info.mass - mass).abs() <= 1e-9 * mass && (info.mass_density - presence).abs() <= 1e-9 * presence);
        // By codebook: the decoded sums are the true ones but for what thinning left out.
        let mut sums: HashMap<u16, [f64; 4]> = HashMap::new();
        for at in tree.nodes() {
            let (node, book) = (tree.node(at), tree.codebook(at));
            if node.encoding == Encoding::Relay {
                continue;
            }
            let decoded = tree.drawn(at).iter().fold([0.0; 2], |[m, p], &(_, code)| {
                let mass = f64::from(book.mass[code]);
                [m + mass, p + mass * f64::from(book.density[code])]
            });
            prop_assert!((decoded[0] * f64::from(node.mass_scale) / node.mass - 1.0).abs() < 1e-6);
            prop_assert!((decoded[1] * f64::from(node.mass_density_scale) / node.mass_density - 1.0).abs() < 1e-6);
            let sum = sums.entry(node.codebook).or_default();
            sum.iter_mut().zip([decoded[0], decoded[1], node.mass, node.mass_density]).for_each(|(a, b)| *a += b);
        }
        for (codebook, [m, p, mass, presence]) in sums {
            let budget = if info.codebooks[usize::from(codebook)].scope == CodebookScope::Leaves { 0.0 } else { 5e-4 };
            prop_assert!((-1e-6..=budget + 1e-6).contains(&(1.0 - m / mass)), "{} of {}", m, mass);
            prop_assert!((-1e-6..=budget + 1e-6).contains(&(1.0 - p / presence)), "{} of {}", p, presence);
        }
        // By cut: the nodes that a selection at one depth draws stand for everything once.
        for depth in 0..info.levels.len() as u8 {
            let mut stack = vec![NodeRef { page: info.root_page, node: 0 }];
            let (mut cut, mut particles) = (0.0, 0);
            while let Some(at) = stack.pop() {
                let node = tree.node(at);
                if node.encoding != Encoding::Relay && (node.is_leaf() || node.depth >= depth) {
                    cut += node.mass;
                    particles += node.source_particles;
                } else {
                    stack.extend(tree.pages[at.page.0 as usize].children(at.node as usize));
                }
            }
            prop_assert!((cut / mass - 1.0).abs() < 1e-12);
            prop_assert_eq!(particles, count as u64);
        }
    }

    #[test]
    fn the_table_adds_up(seed: u64, count in 100..6000_usize, capacity in 5..300_usize) {
        let folder = tempfile::tempdir().unwrap();
        let (_, metadata) = build_in(&folder, vec![clustered(count, seed)], &small_leaves(VqBits::Twelve, capacity));
        let levels = &metadata.families[0].levels;
        for (i, level) in levels.iter().enumerate() {
            prop_assert_eq!(usize::from(level.depth), i);
            let passed_on = level.skipped + level.relayed + level.sprites + level.points;
            prop_assert_eq!(level.input, level.merged + passed_on);
            // What a level passes on, skipped particles included, is the next coarser level's input.
            let arriving = levels.get(i + 1).map_or(0, |below| {
                below.input - below.merged + below.leaf_particles
            });
            prop_assert_eq!(level.input, arriving);
        }
        prop_assert_eq!(levels.iter().map(|level| level.leaf_particles).sum::<u64>(), count as u64);
    }

    #[test]
    fn leaves_hold_the_source(seed: u64, count in 1..2000_usize, capacity in 1..200_usize) {
        let mut family = clustered(count, seed);
        family.attributes.clear();
        let folder = tempfile::tempdir().unwrap();
        let (path, _) = build_in(&folder, vec![family.clone()], &small_leaves(VqBits::Sixteen, capacity));
        let tree = Tree::read(&path);
        // With no more particles than codes every value is there, up to what the quantiser's metric can tell apart.
        let mut found = [Vec::new(), Vec::new(), Vec::new()];
        for at in tree.nodes().filter(|&at| tree.node(at).is_leaf()) {
            let book = tree.codebook(at);
            for (_, code) in tree.drawn(at) {
                let decoded = [book.mass[code], book.density[code], book.smoothing_length[code]];
                found.iter_mut().zip(decoded).for_each(|(column, value)| column.push(value));
            }
        }
        for (mut found, mut expected) in found.into_iter().zip([family.mass, family.density, family.smoothing_length]) {
            found.sort_by(f32::total_cmp);
            expected.sort_by(f32::total_cmp);
            prop_assert_eq!(found.len(), expected.len());
            prop_assert!(found.iter().zip(&expected).all(|(a, b)| (a / b - 1.0).abs() < 2e-5));
        }
    }
}

#[test]
fn metadata_and_nodes_survive_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let mut stars = clustered(900, 5);
    stars.name = FamilyName::Stars;
    stars.attributes.truncate(1);
    let (path, written) = build_in(&folder, vec![clustered(3000, 4), stars], &small_leaves(VqBits::Twelve, 50));
    let file = PageFile::open(&path).unwrap();
    assert_eq!(file.metadata(), &written);
    assert_eq!(written.particles(), 3900);
    assert_eq!(written.family(FamilyName::Stars).unwrap().0, 1);
    let speed = written.families[0].attribute("speed").unwrap().1;
    assert_eq!((speed.missing, speed.unit.0.as_str()), (60, "km/s"));
    assert!(written.families[0].quantities[1].unit.0.contains("Msun"));
}

#[test]
fn a_family_that_is_none_of_gadgets_keeps_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let named = |name: &str| Family { name: FamilyName::parse(name).unwrap(), ..clustered(400, 6) };
    for volume_levels in [false, true] {
        let mut options = small_leaves(VqBits::Eight, 50);
        options.octree.volume_levels = volume_levels;
        options.octree.refined = false;
        let version = |path: &std::path::Path| std::fs::read(path).unwrap()[8];
        let (path, written) = build_in(&folder, vec![named("gas"), named("tracer")], &options);
        let file = PageFile::open(&path).unwrap();
        assert_eq!((version(&path), file.metadata()), (4, &written));
        let (index, tracer) = written.family(FamilyName::parse("tracer").unwrap()).unwrap();
        assert!(tracer.count == 400 && tracer.volume.is_some() == volume_levels);
        assert_eq!(file.read_page(tracer.root_page).unwrap().family, index);
        // A file says no more than it has to, so that older programs read it.
        let (path, _) = build_in(&folder, vec![named("gas")], &options);
        assert_eq!(version(&path), if volume_levels { 3 } else { 2 });
    }
}

/// Codes of leaves are refined or not, those of other nodes never; and what a file says of it comes back.
#[test]
fn refined_codes_are_those_of_leaves() {
    let folder = tempfile::tempdir().unwrap();
    let error_of = |bits: VqBits, refined: bool| {
        let mut options = small_leaves(bits, 300);
        options.octree.refined = refined;
        let (path, written) = build_in(&folder, vec![clustered(20_000, 8)], &options);
        let tree = Tree::read(&path);
        assert_eq!(tree.metadata, written);
        let codes = if refined { CodeBits::refined(bits) } else { CodeBits::plain(bits) };
        let version = match (written.families[0].levels.len() > 15, codes.is_refined()) {
            (true, _) => 6,
            (_, true) => 5,
            _ => 2,
        };
        assert_eq!((written.bits, std::fs::read(&path).unwrap()[8]), (codes, version));
        let family = &written.families[0];
        assert_eq!(family.column_error.is_some(), codes.is_refined());
        for book in &family.codebooks {
            let is_refined = codes.is_refined() && book.scope == CodebookScope::Leaves;
            assert!(book.len() <= codes.of(is_refined).entries(), "{:?}: {} entries", book.scope, book.len());
        }
        let leaves = family.codebooks.iter().filter(|book| book.scope == CodebookScope::Leaves).count();
        assert_eq!(family.refinements.len(), if codes.is_refined() { leaves } else { 0 });
        let error = |k: usize| {
            let books = family.codebooks.iter().filter(|book| book.scope == CodebookScope::Leaves);
            books.map(|book| book.particles as f64 * book.errors[k].mean).sum::<f64>() / 20_000.0
        };
        error(2)
    };
    let [plain, refined] = [false, true].map(|refined| error_of(VqBits::Eight, refined));
    assert!(3.0 * refined < plain, "smoothing lengths are {plain} off, refined {refined}");
    error_of(VqBits::Twelve, true);
    // With 16 bits there is no place left.
    assert_eq!(error_of(VqBits::Sixteen, true), error_of(VqBits::Sixteen, false));
}

#[test]
fn a_mapped_file_has_the_same_pages_for_threads_that_read_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = build_in(&folder, vec![clustered(40_000, 6)], &small_leaves(VqBits::Eight, 100));
    let tree = Tree::read(&path);
    let mapped = PageFile::open_with(&path, ReadMethod::Mapped).unwrap();
    assert_eq!((mapped.metadata(), mapped.read_method()), (&tree.metadata, ReadMethod::Mapped));
    std::thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                for page in &tree.pages {
                    let read = mapped.read_page(page.id).unwrap();
                    assert_eq!(read.nodes, page.nodes);
                    for node in 0..page.nodes.len() {
                        let (a, b) = (read.particles(node), page.particles(node));
                        assert_eq!(a.codes, b.codes);
                        assert!((0..a.len()).all(|i| a.fraction(i) == b.fraction(i)));
                    }
                }
            });
        }
    });
}

#[test]
fn any_number_of_threads_writes_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = |threads| {
        let options = BuildOptions { threads: Some(threads), ..small_leaves(VqBits::Eight, 300) };
        std::fs::read(build_in(&folder, vec![clustered(70_000, 9)], &options).0).unwrap()
    };
    let one = bytes(1);
    assert!(one == bytes(2) && one == bytes(5));
}

#[test]
fn every_option_of_the_hierarchy_changes_what_it_says_and_is_noted() {
    let folder = tempfile::tempdir().unwrap();
    let usual = small_leaves(VqBits::Eight, 300);
    let notes = |options: &BuildOptions| build_in(&folder, vec![clustered(500, 9)], options).1.provenance.notes;
    assert_eq!(notes(&BuildOptions::default()), ["made up"]);
    // Pages; nodes; particles of grid nodes; those that thinning leaves out; relays.
    let count = |change: fn(&mut BuildOptions), note: &str| {
        let mut options = usual.clone();
        change(&mut options);
        let (path, metadata) = build_in(&folder, vec![clustered(30_000, 9)], &options);
        let noted = &metadata.provenance.notes[1];
        assert!(metadata.provenance.notes.len() == 2 && noted.contains(note), "{noted}");
        let tree = Tree::read(&path);
        let of = |encoding: Encoding| tree.nodes().filter(|at| tree.node(*at).encoding == encoding).collect::<Vec<_>>();
        let grid: u64 = of(Encoding::Grid).iter().map(|at| u64::from(tree.node(*at).particles)).sum();
        let skipped: u64 = metadata.families[0].levels.iter().map(|level| level.skipped).sum();
        [tree.pages.len() as u64, tree.nodes().count() as u64, grid, skipped, of(Encoding::Relay).len() as u64]
    };
    let [pages, nodes, _, skipped, relays] = count(|_| {}, "leaves of 300 particles");
    assert!(skipped > 0 && relays > 0, "{skipped} {relays}");
    assert!(count(|options| options.page_bytes = 64 << 10, "pages of 65536 bytes")[0] > pages);
    assert!(count(|options| options.octree.leaf_capacity = 30, "leaves of 30 particles")[1] > nodes);
    // Where more merges, fewer nodes are relays.
    let whole = |options: &mut BuildOptions| options.octree.relay_fraction = 1.0;
    let fused = |options: &mut BuildOptions| (options.octree.relay_fraction, options.octree.fusion) = (1.0, 8.0);
    assert!(count(fused, "fusion within 8 cells")[2] < count(whole, "relays from 1")[2]);
    assert_eq!(count(|options| options.octree.thinning_budget = 0.0, "thinning of 0")[3], 0);
    assert_eq!(count(|options| options.octree.refined = false, "plain codes of leaves")[1], nodes);
    assert!(count(|options| options.octree.thinning_budget = 0.05, "thinning of 0.05")[3] > skipped);
    assert_eq!(count(whole, "relays from 1")[4], 0);
    assert!(count(|options| options.octree.relay_fraction = 0.1, "relays from 0.1")[4] > relays);
}

#[test]
fn families_with_more_particles_have_larger_roots_whose_nodes_draw_less() {
    let folder = tempfile::tempdir().unwrap();
    // Size of the root cell, and what its node draws.
    let root = |root_particles: u64| {
        let usual = small_leaves(VqBits::Eight, 300);
        let options = BuildOptions { octree: OctreeOptions { root_particles, ..usual.octree }, ..usual };
        let (_, metadata) = build_in(&folder, vec![clustered(30_000, 9)], &options);
        let noted = metadata.provenance.notes[1].contains(&format!("a larger root beyond {root_particles} particles"));
        assert_eq!(noted, root_particles != OctreeOptions::default().root_particles);
        let family = &metadata.families[0];
        (family.root.size, family.levels[0].sprites + family.levels[0].points)
    };
    let (size, drawn) = root(OctreeOptions::default().root_particles);
    assert_eq!(root(30_000), (size, drawn));
    let (larger, fewer) = root(1000);
    assert!(larger == 4.0 * size && fewer < drawn, "{larger} {size} {fewer} {drawn}");
    assert_eq!(root(1).0, 16.0 * size);
}

#[test]
fn degenerate_particles_build() {
    let folder = tempfile::tempdir().unwrap();
    let column = |values: &[f32], count: usize| (0..count).map(|i| values[i % values.len()]).collect::<Vec<f32>>();
    let cases: Vec<(&str, Vec<[f64; 3]>, [&[f32]; 4])> = vec![
        ("one", vec![[1.0, 2.0, 3.0]], [&[1.0], &[1.0], &[1.0], &[5.0]]),
        ("one at the origin", vec![[0.0; 3]], [&[1.0], &[1e-30], &[1.0], &[0.0]]),
        ("same place", vec![[7e5, -2.0, 0.1]; 500], [&[1.0], &[0.1], &[2.0], &[f32::NAN]]),
        (
            "two places",
            (0..500).map(|i| [f64::from(i % 2), 0.0, 0.0]).collect(),
            [&[1.0], &[1e-9], &[2.0], &[1.0, -1.0]],
        ),
        ("line", (0..800).map(|i| [f64::from(i).powi(3), 0.0, 5.0]).collect(), [&[1.0], &[0.1], &[2.0], &[0.0, 1e30]]),
        (
            "extreme",
            (0..700).map(|i| [10.0_f64.powi(i % 60 - 30), -(10.0_f64.powi(i % 7)), f64::from(i) * 1e27]).collect(),
            [&[1e-30, 1e30, 1.0], &[1e30, 1e-30], &[1e30, 1.0, 1e-30, 1e20], &[-1e30, 1e30, 0.0, 1e-30]],
        ),
        (
            "far from the origin",
            (0..900).map(|i| [1e9 + f64::from(i) * 1e-3, -1e9, 1e9 + f64::from(i % 30)]).collect(),
            [&[1.0], &[0.01], &[1.0], &[1.0]],
        ),
        ("tiny box", (0..600).map(|i| [f64::from(i) * 1e-300, 0.0, 0.0]).collect(), [&[1.0], &[1e-30], &[1.0], &[1.0]]),
        (
            "huge box",
            (0..600).map(|i| [f64::from(i - 300) * 1e140, 0.0, 0.0]).collect(),
            [&[1.0], &[1e30], &[1.0], &[1.0]],
        ),
    ];
    for (what, positions, [mass, smoothing, density, values]) in cases {
        let count = positions.len();
        let family = Family {
            name: FamilyName::Dark,
            mass: column(mass, count),
            smoothing_length: column(smoothing, count),
            density: column(density, count),
            attributes: vec![Attribute { name: "x".into(), unit: Unit::default(), values: column(values, count) }],
            positions: positions.clone(),
        };
        let mut options = small_leaves(VqBits::Eight, 20);
        options.octree.exact_positions = true;
        let (path, metadata) = build_in(&folder, vec![family], &options);
        let tree = Tree::read(&path);
        assert_eq!(metadata.particles(), count as u64, "{what}");
        let root = metadata.families[0].root;
        // Leaf positions are as exact as 21 bits of a leaf allow.
        let leaves: Vec<NodeRef> = tree.nodes().filter(|&at| tree.node(at).is_leaf()).collect();
        for at in &leaves {
            let limit = tree.node(*at).frame.size / 2_f64.powi(20) + 1e-12 * root.min.abs().max_element();
            for (drawn, _) in tree.drawn(*at) {
                let nearest =
                    positions.iter().map(|p| DVec3::from_array(*p).distance(drawn)).fold(f64::INFINITY, f64::min);
                assert!(nearest <= limit, "{what}: {nearest} > {limit}");
            }
        }
    }
}

#[test]
fn magnitudes_add_their_fluxes() {
    let folder = tempfile::tempdir().unwrap();
    let mut family = clustered(4000, 3);
    family.smoothing_length.fill(1e-6);
    family.attributes.truncate(1);
    family.attributes[0].name = "magnitude".into();
    family.attributes[0].values = (0..4000).map(|i| 5.0 + (i % 90) as f32 * 0.1).collect();
    let flux = |magnitude: f32| 10.0_f64.powf(-0.4 * f64::from(magnitude));
    let total: f64 = family.attributes[0].values.iter().map(|&m| flux(m)).sum();
    let mut options = small_leaves(VqBits::Eight, 40);
    options.octree.thinning_budget = 0.0;
    let (path, metadata) = build_in(&folder, vec![family], &options);
    let tree = Tree::read(&path);
    let at = NodeRef { page: metadata.families[0].root_page, node: 0 };
    let (node, book) = (tree.node(at), tree.codebook(at));
    assert!(node.particles < 4000 && node.points == node.particles);
    let decoded: f64 = tree.drawn(at).iter().map(|&(_, code)| flux(book.attributes[0][code])).sum();
    assert!((decoded / total - 1.0).abs() < 1e-5, "{decoded} against {total}");
}

#[test]
fn wrong_columns_are_named_and_leave_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("never.df");
    let broken: [(&str, fn(&mut Family)); 5] = [
        ("mass", |family| family.mass[3] = 0.0),
        ("density", |family| family.density[3] = f32::NAN),
        ("smoothing-length", |family| family.smoothing_length[3] = f32::INFINITY),
        ("position", |family| family.positions[3][1] = f64::NAN),
        ("temperature", |family| family.attributes[0].values.truncate(99)),
    ];
    for (field, breaks) in broken {
        let mut family = clustered(100, 1);
        breaks(&mut family);
        let error = build(dataset(vec![family]), &BuildOptions::default(), &path, &()).unwrap_err().to_string();
        assert!(error.contains(field) && error.contains("gas"), "{error}");
    }
    let missing = BuildOptions { families: vec![FamilyName::Stars], ..BuildOptions::default() };
    assert!(build(dataset(vec![clustered(10, 1)]), &missing, &path, &()).unwrap_err().to_string().contains("stars"));
    let missing = BuildOptions { attributes: Some(vec!["pressure".into()]), ..BuildOptions::default() };
    assert!(build(dataset(vec![clustered(10, 1)]), &missing, &path, &()).unwrap_err().to_string().contains("pressure"));
    let small = BuildOptions { memory: Some(1 << 20), ..BuildOptions::default() };
    assert!(build(dataset(vec![clustered(20_000, 1)]), &small, &path, &()).unwrap_err().to_string().contains("MiB"));
    assert!(build(dataset(vec![]), &BuildOptions::default(), &path, &()).is_err());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
