//! Trees that are no page files, streamed, selected and drawn as page files are: particles in memory, and a made-up hierarchy whose
//! nodes have three or six children in slabs, spans of time, and moving content.

use crate::support::{draw_nodes, sum_nodes};
use deepfield::codec::{Codebook, CodebookScope, QuantityError};
use deepfield::cpu::{Extent, Method, Positions, SplatOptions, Splats, draw_counted};
use deepfield::explore::{Data, Members, ProbeOptions, Region, Work, probe};
use deepfield::mode::{Depiction, Plan, Settings};
use deepfield::model::{Bounds, Dataset, Family, FamilyName, Kernel, Provenance, Unit};
use deepfield::modes;
use deepfield::picture::decode::{batches, decode_planned};
use deepfield::store::{
    Branch, Content, InMemory, Metadata, Node, NodeRef, Page, PageBytes, PageId, Particles, StoreError, Tree,
};
use deepfield::stream::{Scene, SceneSelection};
use deepfield::synth::merger::Merger;
use deepfield::view::{Projection, View};
use glam::DVec3;
use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

const NAME: &str = "swinging";
/// Particles of a leaf.
const LEAF: usize = 40;
/// Depth of the leaves.
const DEPTH: u32 = 3;
/// Bytes of a made-up page.
const BYTES: u64 = 100;

/// Particles that move along y: content that is no particle.
#[derive(Debug)]
struct Moving {
    at_rest: Particles,
    velocity: Vec<f64>,
}

impl Content for Moving {
    fn particles(&self, time: f64) -> Cow<'_, Particles> {
        let mut now = self.at_rest.clone();
        now.positions.iter_mut().zip(&self.velocity).for_each(|(at, velocity)| at[1] += velocity * time);
        Cow::Owned(now)
    }

    fn memory(&self) -> u64 {
        self.at_rest.memory() + 8 * self.velocity.len() as u64
    }
}

/// A tree of slabs along x, each cut into three that are not equally wide. Nodes above the leaves have six children: three until
/// time 1, three others from then on. A page is a node; the pages below a node follow one another.
#[derive(Debug, Default)]
struct Slabs {
    metadata: Option<Metadata>,
    fetched: AtomicU64,
}

/// A node of [`Slabs`].
#[derive(Clone, Copy, Debug)]
struct Slab {
    depth: u32,
    x: [f64; 2],
    time: [f64; 2],
}

impl Slab {
    fn bounds(&self) -> Bounds {
        Bounds { min: DVec3::new(self.x[0], -3.0, 0.0), max: DVec3::new(self.x[1], 3.0, 0.5) }
    }

    fn children(&self) -> Vec<Slab> {
        let width = self.x[1] - self.x[0];
        let ends = [0.0, 0.2, 0.5, 1.0].map(|share| self.x[0] + share * width);
        let spans = match self.depth + 1 == DEPTH {
            true => &[[f64::NEG_INFINITY, 1.0], [1.0, f64::INFINITY]][..],
            false => &[[f64::NEG_INFINITY, f64::INFINITY]],
        };
        let of_span = |&time| ends.windows(2).map(move |x| Slab { depth: self.depth + 1, x: [x[0], x[1]], time });
        if self.depth == DEPTH { Vec::new() } else { spans.iter().flat_map(of_span).collect() }
    }

    /// All nodes, parents before children, with the number of the first child of each.
    fn all() -> Vec<(Slab, usize)> {
        let always = [f64::NEG_INFINITY, f64::INFINITY];
        let mut all = vec![(Slab { depth: 0, x: [0.0, 9.0], time: always }, 0)];
        let mut next = 0;
        while next < all.len() {
            all[next].1 = all.len();
            let children = all[next].0.children();
            all.extend(children.into_iter().map(|child| (child, 0)));
            next += 1;
        }
        all
    }

    /// Particles of a leaf; those of the later span move the other way.
    fn moving(&self) -> Moving {
        let later = self.time[0] == 1.0;
        let share = |i: usize| (i as f64 + 0.5) / LEAF as f64;
        let at = |i: usize| [self.x[0] + share(i) * (self.x[1] - self.x[0]), 0.3 * (7.0 * share(i)).sin(), 0.25];
        let velocity = |i: usize| if later { -0.5 - share(i) } else { 0.5 + share(i) };
        Moving { at_rest: particles((0..LEAF).map(at).collect(), 1.0), velocity: (0..LEAF).map(velocity).collect() }
    }

    /// What stands for everything below: one particle for each leaf.
    fn merged(&self) -> Particles {
        let leaves = 3_usize.pow(DEPTH - self.depth);
        let x = |i: usize| self.x[0] + (i as f64 + 0.5) / leaves as f64 * (self.x[1] - self.x[0]);
        particles((0..leaves).map(|i| [x(i), 0.0, 0.25]).collect(), LEAF as f32)
    }
}

fn particles(positions: Vec<[f64; 3]>, mass: f32) -> Particles {
    let column = |value: f32| vec![value; positions.len()];
    let values = Codebook {
        scope: CodebookScope::Leaves,
        particles: positions.len() as u64,
        mass: column(mass),
        density: column(2.0),
        smoothing_length: column(0.1),
        attributes: Vec::new(),
        errors: vec![QuantityError::default(); 3],
    };
    Particles { positions, values, covariances: Vec::new() }
}

impl Slabs {
    fn new() -> Slabs {
        let metadata = InMemory::new(at_time(0.0)).metadata().clone();
        Slabs { metadata: Some(metadata), ..Slabs::default() }
    }
}

impl Tree for Slabs {
    fn metadata(&self) -> &Metadata {
        self.metadata.as_ref().unwrap()
    }

    fn path(&self) -> &Path {
        Path::new("slabs")
    }

    fn page_count(&self) -> u32 {
        Slab::all().len() as u32
    }

    fn page_bytes(&self, _page: PageId) -> u64 {
        BYTES
    }

    fn page_memory(&self, page: PageId) -> u64 {
        self.decode_page(PageBytes::new(page, page.0.to_le_bytes().to_vec())).map_or(0, |page| page.memory())
    }

    fn fetch_page(&self, page: PageId) -> Result<PageBytes, StoreError> {
        self.fetched.fetch_add(1, Ordering::Relaxed);
        Ok(PageBytes::new(page, page.0.to_le_bytes().to_vec()))
    }

    fn decode_page(&self, bytes: PageBytes) -> Result<Page, StoreError> {
        assert_eq!(bytes.bytes(), bytes.page().0.to_le_bytes());
        let (slab, first) = Slab::all()[bytes.page().0 as usize];
        let child = |(i, child): (usize, Slab)| (NodeRef { page: PageId((first + i) as u32), node: 0 }, child.bounds());
        let content: Arc<dyn Content> = match slab.depth == DEPTH {
            true => Arc::new(slab.moving()),
            false => Arc::new(slab.merged()),
        };
        let count = content.particles(0.0).len() as u32;
        let leaf = Node { smoothing_length_max: 0.1, time: slab.time, ..Node::leaf(slab.bounds(), count) };
        // What a slab draws stands for what is anywhere in it.
        let delta = if slab.depth == DEPTH { 0.0 } else { slab.bounds().size().length() };
        let source_particles = 3_u64.pow(DEPTH - slab.depth) * LEAF as u64;
        let node = Node { delta, source_particles, mass: source_particles as f64, ..leaf };
        let children = slab.children().into_iter().enumerate().map(child).collect();
        Ok(Page::new(bytes.page(), 0, [Branch { node, children, content }]))
    }
}

/// What is there at a time.
fn at_time(time: f64) -> Dataset {
    let leaves = Slab::all().into_iter().map(|(slab, _)| slab).filter(|slab| slab.depth == DEPTH);
    let now = leaves.filter(|slab| slab.time[0] <= time && time < slab.time[1]);
    let positions: Vec<[f64; 3]> = now.flat_map(|slab| slab.moving().particles(time).positions.clone()).collect();
    let count = positions.len();
    let family = Family {
        name: FamilyName::parse(NAME).unwrap(),
        positions,
        mass: vec![1.0; count],
        smoothing_length: vec![0.1; count],
        density: vec![2.0; count],
        attributes: Vec::new(),
    };
    Dataset {
        families: vec![family],
        length_unit: Unit::default(),
        mass_unit: Unit::default(),
        kernel: Kernel::CubicSpline,
        skipped: Vec::new(),
        provenance: Provenance { path: NAME.into(), ..Provenance::default() },
    }
}

fn view(time: f64) -> View {
    let projection = Projection::Orthographic { height: 9.0 };
    let middle = DVec3::new(4.5, 0.0, 0.25);
    let view = View::look_at(middle + 20.0 * DVec3::Z, middle, DVec3::Y, projection, 128, 96).unwrap();
    View { time, ..view }
}

fn depiction(metadata: &Metadata) -> Depiction {
    Depiction::new(modes::find("column-density").unwrap(), Settings::default(), None, metadata).unwrap()
}

fn picture(view: &View, tree: &dyn Tree, selection: &SceneSelection) -> Vec<f32> {
    let metadata = tree.metadata();
    sum_nodes(view, &depiction(metadata), metadata, &selection.nodes).p
}

#[test]
fn a_hierarchy_of_another_kind_is_streamed_selected_and_drawn() {
    let slabs = Arc::new(Slabs::new());
    let leaves = 3_usize.pow(DEPTH);
    for time in [0.0, 0.9, 1.0, 2.0] {
        let view = view(time);
        // Less than half of the pages fit.
        for budget in [u64::MAX, 8000] {
            let mut scene = Scene::new(Arc::clone(&slabs), budget);
            let selection = scene.converge_blocking(&view, 0.5).unwrap();
            if budget < u64::MAX {
                assert!(scene.streamer.residency.statistics().bytes <= budget);
                continue;
            }
            assert!(selection.converged && selection.error_pixels <= 0.5);
            assert_eq!((selection.nodes.len(), selection.particles), (leaves, (leaves * LEAF) as u64));
            let drawn = picture(&view, &slabs, &selection);
            let exact = InMemory::new(at_time(time));
            let mut scene = Scene::new(Arc::new(exact), u64::MAX);
            let all = scene.converge_blocking(&view, 0.5).unwrap();
            let expected = picture(&view, &**scene.streamer.residency.tree(), &all);
            let difference: f64 = drawn.iter().zip(&expected).map(|(a, b)| f64::from((a - b).abs())).sum();
            let total: f64 = expected.iter().map(|&p| f64::from(p)).sum();
            assert!(total > 0.0 && difference <= 1e-5 * total, "at {time}: {difference} of {total}");
        }
        // Coarse: what stands for everything has its mass.
        let mut scene = Scene::new(Arc::clone(&slabs), u64::MAX);
        let coarse = scene.converge_blocking(&view, 1e4).unwrap();
        assert_eq!((coarse.nodes.len(), coarse.particles), (1, leaves as u64));
        let pixel = (9.0_f64 / 96.0).powi(2);
        let mass: f64 = picture(&view, &slabs, &coarse).iter().map(|&p| f64::from(p) * pixel).sum();
        assert!((mass / (leaves * LEAF) as f64 - 1.0).abs() < 0.02, "{mass}");
    }
    assert!(slabs.fetched.load(Ordering::Relaxed) > 0);
}

#[test]
fn particles_in_memory_are_drawn_as_they_are_to_the_bit() {
    let dataset = deepfield::synth::dataset(&Merger::new(5, 8000));
    let bounds = dataset.bounds();
    let eye = bounds.center() + 1.5 * bounds.size().length() * DVec3::new(0.3, 0.4, 0.86);
    let plain =
        View::look_at(eye, bounds.center(), DVec3::Y, Projection::Perspective { fov_y: 0.8 }, 160, 120).unwrap();
    let tree = InMemory::new(dataset.clone());
    let metadata = tree.metadata().clone();
    let mut scene = Scene::new(Arc::new(tree), u64::MAX);
    let selection = scene.converge_blocking(&plain, 0.0).unwrap();
    assert!(selection.converged && selection.particles == dataset.len() as u64);
    let depiction = depiction(&metadata);
    for method in [Method::Pyramid, Method::Exact] {
        let plan = Plan::default();
        let drawn = draw_nodes(&plain, &depiction, &metadata, &selection.nodes, method, &plan);
        let (drawn, _) = drawn.sums(depiction.mode).unwrap();
        let batches = dataset.families.iter().map(|family| {
            let (positions, extent) = (Positions::World(&family.positions), Extent::World(&family.smoothing_length));
            Splats::new(positions, extent, &family.mass, None).unwrap()
        });
        let options = SplatOptions { method, kernel: dataset.kernel, ..SplatOptions::default() };
        let (expected, _) = draw_counted(&plain, &batches.collect::<Vec<_>>(), &options);
        assert!(drawn.p.iter().zip(&expected.p).all(|(a, b)| a.to_bits() == b.to_bits()));
    }
    // A thinned picture draws some of them.
    let plan = Plan { share: 0.25, ..Plan::default() };
    let some = decode_planned(&plain, &depiction, &metadata, &selection.nodes, &plan);
    let kept: usize = batches(&depiction, &some).unwrap().iter().map(|batch| batch.len()).sum();
    assert!((1600..2400).contains(&kept), "{kept}");
}

#[test]
fn particles_in_memory_answer_questions() {
    let dataset = deepfield::synth::dataset(&Merger::new(5, 8000));
    let bounds = dataset.bounds();
    let radius = 0.2 * bounds.size().max_element();
    let inside = |at: &&[f64; 3]| DVec3::from(**at).distance(bounds.center()) <= radius;
    let count = dataset.families.iter().flat_map(|family| &family.positions).filter(inside).count();
    let tree = InMemory::new(dataset);
    let members = Members::Region(Region::sphere(bounds.center(), radius));
    let found = probe(Data::Pages(&tree), &members, &ProbeOptions::default(), Work::quiet()).unwrap();
    assert_eq!(found.count, count as u64);
    let everything = Members::Region(Region::whole());
    let found = probe(Data::Pages(&tree), &everything, &ProbeOptions::default(), Work::quiet()).unwrap();
    assert_eq!(found.count, tree.metadata().particles());
}
