//! Several datasets in one scene: the picture of all is the sum of the pictures of each where it lies, within the errors of the source
//! placed there; pages, nodes and probes know no difference.

use crate::support::{demo, draw_source, in_repository, sum_nodes, write_demo_pages};
use deepfield::build::{BuildOptions, build_source};
use deepfield::color::Accumulation;
use deepfield::color::accumulation::relative_error;
use deepfield::cpu::Method;
use deepfield::explore::{Data, Members, ProbeOptions, Region, Work, probe};
use deepfield::hierarchy::Kinds;
use deepfield::import::{LoadOptions, load};
use deepfield::look::{Member, OpenData, shown_families};
use deepfield::mode::{Depiction, Settings};
use deepfield::model::{Dataset, Moment, Placement, ReadMethod};
use deepfield::modes;
use deepfield::store::{PageFile, PageId, StoreError};
use deepfield::stream::Scene;
use deepfield::view::{Projection, View};
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

const OFFSET: DVec3 = DVec3::new(31.0, -6.0, 4.0);

/// The demo, and a blob of gas of 20 units in the middle of which its stars lie.
fn sources() -> [PathBuf; 2] {
    [demo(), in_repository("tests/data/gas_sphere_collapse_025.hdf5")]
}

struct Fixture {
    members: [Member; 2],
    whole: Arc<PageFile>,
    _folder: tempfile::TempDir,
}

fn fixture() -> Fixture {
    let folder = tempfile::tempdir().unwrap();
    let members = sources().map(|source| {
        let path = folder.path().join(source.file_name().unwrap()).with_extension("df");
        if source == demo() {
            write_demo_pages(&path, Kinds::default());
        } else {
            build_source(&source, &LoadOptions::default(), &BuildOptions::default(), &path, &()).unwrap();
        }
        Member::new(path)
    });
    let second = Member { offset: OFFSET, scale: Some(0.25), ..members[1].clone() };
    let members = [members[0].clone(), second];
    Fixture { whole: Arc::new(open(&members)), members, _folder: folder }
}

fn open(members: &[Member]) -> PageFile {
    join(members).unwrap().0
}

fn join(members: &[Member]) -> Result<(PageFile, Vec<String>), StoreError> {
    OpenData::open(members, ReadMethod::default(), |path| Ok::<_, StoreError>(path.to_owned()))?.at(Moment::default())
}

fn draw(file: &Arc<PageFile>, families: Option<Vec<u32>>, view: &View, tau: f64) -> Accumulation {
    let metadata = file.metadata();
    let mode = modes::find("column-density").unwrap();
    let depiction = Depiction::new(mode, Settings::default(), None, metadata).unwrap();
    let mut scene = Scene::new(Arc::clone(file), u64::MAX);
    scene.families = families.unwrap_or(scene.families);
    let selection = scene.converge_blocking(view, tau).unwrap();
    assert!(selection.converged);
    sum_nodes(view, &depiction, metadata, &selection.nodes)
}

/// What one file's own placement in the scene makes of its source.
fn placed(source: &Path, placement: Placement) -> Dataset {
    let mut dataset = load(source, &LoadOptions::default(), &()).unwrap();
    placement.place(&mut dataset);
    dataset
}

#[test]
fn the_picture_of_several_is_the_sum_of_their_pictures() {
    let Fixture { members, whole, _folder } = fixture();
    assert!(whole.is_joined() && whole.parts().len() == 2);
    let parts: Vec<_> = whole.parts().collect();
    let placements = [parts[0].placement, parts[1].placement];
    assert_eq!((placements[0], placements[1].offset, placements[1].scale), (Placement::HERE, OFFSET, 0.25));
    let datasets = [placed(&sources()[0], placements[0]), placed(&sources()[1], placements[1])];

    let target = 0.5 * (DVec3::splat(25.0) + OFFSET);
    let projection = Projection::Perspective { fov_y: 0.9 };
    let view = View::look_at(target + DVec3::new(20.0, 14.0, 70.0), target, DVec3::Y, projection, 160, 120).unwrap();
    let picture = draw(&whole, None, &view, 0.05);
    // Alone, and each where it lies.
    let of = |range: &std::ops::Range<usize>| Some(range.clone().map(|i| i as u32).collect());
    let separately =
        [draw(&whole, of(&parts[0].families), &view, 0.05), draw(&whole, of(&parts[1].families), &view, 0.05)];
    let sum = |pictures: &[Accumulation; 2]| -> Vec<f32> {
        pictures[0].p.iter().zip(&pictures[1].p).map(|(a, b)| a + b).collect()
    };
    let (l1, l2) = relative_error(&picture.p, &sum(&separately));
    assert!(l1 < 1e-6 && l2 < 1e-6, "{l1} {l2}");
    // The first is what it is alone; the second is its source, moved, scaled and with the masses of the scene.
    let alone = draw(&Arc::new(open(&members[..1])), None, &view, 0.05);
    assert_eq!(alone.p, separately[0].p);
    let exact = [0, 1].map(|i: usize| draw_source(&datasets[i], "column-density", &view, Method::Pyramid));
    for i in 0..2 {
        let total: f32 = exact[i].p.iter().sum();
        assert!(total > 0.0, "dataset {i} is in the picture");
        let (l1, l2) = relative_error(&separately[i].p, &exact[i].p);
        assert!(l1 < 2e-2 && l2 < 4e-2, "dataset {i}: {l1} {l2}");
    }
    // In coarse levels too.
    let (l1, _) = relative_error(&draw(&whole, None, &view, 4.0).p, &sum(&exact));
    assert!(l1 < 0.2, "{l1}");
}

#[test]
fn pages_and_probes_of_several_are_those_of_all() {
    let Fixture { whole, .. } = fixture();
    let metadata = whole.metadata();
    assert_eq!(metadata.periodic_box(), None, "not all of it is periodic");
    let mut counts = vec![0; metadata.families.len()];
    for number in 0..whole.page_count() {
        let page = whole.read_page(PageId(number)).unwrap();
        assert_eq!(page.id, PageId(number));
        let family = &metadata.families[page.family as usize];
        for (index, node) in page.nodes.iter().enumerate() {
            let cell = node.frame.bounds();
            let slack = 1e-9 * family.root.size;
            let inside = (node.bounds.min - cell.min).min(cell.max - node.bounds.max).min_element() >= -slack;
            assert!(inside, "{cell:?} {:?}", node.bounds);
            if node.is_leaf() {
                counts[page.family as usize] += node.source_particles;
            }
            for child in page.children(index) {
                assert_eq!(whole.read_page(child.page).unwrap().family, page.family);
            }
        }
    }
    assert_eq!(counts, metadata.families.iter().map(|family| family.count).collect::<Vec<_>>());
    assert!(whole.read_page(PageId(whole.page_count())).unwrap_err().to_string().contains("collapse"), "the last file");

    // A sphere around the second in a corner of the first.
    let stop = AtomicBool::new(false);
    let work = Work { progress: &(), stop: &stop };
    let region = Region::sphere(OFFSET + DVec3::new(1.0, 3.0, 1.0), 7.0);
    let members = Members::Region(region);
    let found = probe(Data::Pages(&whole), &members, &ProbeOptions::default(), work).unwrap();
    let placements: Vec<Placement> = whole.parts().map(|part| part.placement).collect();
    let (mut count, mut mass) = (0_u64, 0.0);
    for (source, placement) in sources().iter().zip(placements) {
        for family in placed(source, placement).families {
            for (at, m) in family.positions.iter().zip(&family.mass) {
                if DVec3::from(*at).distance(OFFSET + DVec3::new(1.0, 3.0, 1.0)) <= 7.0 {
                    (count, mass) = (count + 1, mass + f64::from(*m));
                }
            }
        }
    }
    assert!(count > 1000, "{count}");
    assert!(found.count.abs_diff(count) as f64 <= 2.0 + 2e-3 * count as f64, "{} of {count}", found.count);
    assert!((found.mass / mass - 1.0).abs() < 1e-2, "{} of {mass}", found.mass);
}

#[test]
fn what_does_not_fit_together_is_told_or_refused() {
    let Fixture { members, _folder, .. } = fixture();
    let (_, notes) = join(&members).unwrap();
    assert!(notes.iter().all(|note| note.contains("collapse")), "{notes:?}");
    let unscaled = [members[0].clone(), Member { scale: None, ..members[1].clone() }];
    let told = join(&unscaled).unwrap().1;
    assert!(told.iter().any(|note| note.contains("lengths in") && note.contains("a scale says otherwise")), "{told:?}");
    // By the name that its user has given, and not by that of the file in the cache.
    let mine = Member { path: "mine.hdf5".into(), ..unscaled[1].clone() };
    let of_mine = |mine: Member| {
        let built = |path: &Path| {
            let is_mine = path == mine.path;
            Ok::<_, StoreError>(if is_mine { members[1].path.clone() } else { path.to_owned() })
        };
        OpenData::open(&[members[0].clone(), mine.clone()], ReadMethod::default(), built)?.at(Moment::default())
    };
    let told = of_mine(mine.clone()).unwrap().1;
    assert!(!told.is_empty() && told.iter().all(|note| note.starts_with("mine.hdf5: ")), "{told:?}");
    let refused = of_mine(Member { scale: Some(-1.0), ..mine }).unwrap_err().to_string();
    assert!(refused.starts_with("mine.hdf5: cannot be shown"), "{refused}");
    for (offset, scale) in [(DVec3::new(f64::NAN, 0.0, 0.0), 1.0), (DVec3::ZERO, -1.0)] {
        let wrong = [members[0].clone(), Member { offset, scale: Some(scale), ..members[1].clone() }];
        let error = join(&wrong).unwrap_err().to_string();
        assert!(error.contains("collapse") && error.contains("offset and scale"), "{error}");
    }
    // Densities change by the cube of lengths: where they are no 32-bit numbers any more they are the nearest that are.
    let mut small = Member { scale: Some(1e-29), ..members[1].clone() };
    let (whole, told) = join(&[members[0].clone(), small.clone()]).unwrap();
    assert!(
        told.iter().any(|note| note.contains("collapse") && note.contains("densities are beyond 32-bit")),
        "{told:?}"
    );
    let densities =
        whole.metadata().families.iter().flat_map(|family| &family.codebooks).flat_map(|book| &book.density);
    assert!(
        densities.clone().all(|density| density.is_normal()) && densities.clone().any(|density| *density == f32::MAX)
    );
    small.scale = Some(1e-3);
    let told = join(&[members[0].clone(), small]).unwrap().1;
    assert!(told.iter().all(|note| !note.contains("densities")), "{told:?}");
    // Families that are shown are told by dataset: both have gas or dark matter of their own.
    let hidden = Member { families: Some(Vec::new()), ..members[0].clone() };
    let whole = open(&[hidden.clone(), members[1].clone()]);
    let (shown, missing) = shown_families(&whole, &[hidden, members[1].clone()]);
    assert!(missing.is_empty() && !shown[0] && shown[shown.len() - 1], "{shown:?}");
}

#[test]
fn the_source_of_a_dataset_that_was_moved_is_not_asked() {
    let Fixture { members, _folder, .. } = fixture();
    let of = |offset| open(&[Member { offset, ..members[0].clone() }]);
    assert!(deepfield::explore::data::source_path(&of(DVec3::ZERO)).is_some());
    let moved = of(DVec3::X);
    assert!(deepfield::explore::data::source_path(&moved).is_none());
    let refused = deepfield::explore::data::source_of(&moved).map(|_| ()).unwrap_err().to_string();
    assert!(refused.contains("moved"), "{refused}");
}

#[test]
fn the_command_line_names_where_a_dataset_lies() {
    let member = |text: &str| text.parse::<Member>();
    assert_eq!(member("b.df").unwrap(), Member::new("b.df"));
    let placed = Member { offset: DVec3::new(1.0, -2.5, 3e4), ..Member::new("a@b.df") };
    assert_eq!(member("a@b.df@1,-2.5,3e4").unwrap(), placed);
    assert_eq!(member("a@b.df@1,-2.5,3e4*0.1").unwrap(), Member { scale: Some(0.1), ..placed });
    for wrong in ["b.df@1,2", "b.df@x", "b.df@1,2,3*0", "b.df@1,2,inf", "b.df@1,2,3*x"] {
        assert!(member(wrong).unwrap_err().contains("expected"), "{wrong}");
    }
}
