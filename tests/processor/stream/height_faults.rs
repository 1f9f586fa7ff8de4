//! Pages of heights from disks and files that misbehave: what cannot be read is drawn coarser and told once, everything else goes on, and no
//! picture waits for ever.

use super::disk::{Answer, FaultyDisk, offset_of};
use crate::support::Random;
use deepfield::cpu::surface::paged::PagedSurface;
use deepfield::cpu::surface::placed::{Map, Placed};
use deepfield::cpu::surface::select::Technique;
use deepfield::cpu::surface::sight::Sight;
use deepfield::cpu::surface::since::Since;
use deepfield::cpu::surface::source::SurfaceNodes;
use deepfield::cpu::surface::{SurfaceOptions, SurfacePicture, draw};
use deepfield::heights::build::{HeightBuildOptions, HeightOrigin, build_heights};
use deepfield::heights::hierarchy::chunks::ChunkKey;
use deepfield::heights::measure::Alignment;
use deepfield::heights::model::HeightField;
use deepfield::heights::store::HeightFile;
use deepfield::model::ReadMethod;
use deepfield::picture::surface::OpenSurface;
use deepfield::store::PageId;
use deepfield::view::{Projection, View};
use glam::DVec3;
use std::fs::OpenOptions;
use std::io::{ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// Columns and rows: four whole chunks by two, and two levels above them.
const SIZE: [u64; 2] = [1025, 513];
/// The page of a chunk of full resolution; the last page is that of the coarsest one.
const LEAF: PageId = PageId(0);
/// Reads are waited for so long where the disk is to answer.
const LONG: Duration = Duration::from_secs(20);

/// The bytes of a file of rough hills, each chunk of which is a page.
fn sound() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| {
        let mut random = Random(1);
        let height = |index: u64| {
            let [x, y] = [index % SIZE[0], index / SIZE[0]].map(|at| at as f64);
            (20.0 * ((x / 50.0).sin() + (y / 70.0).cos()) + 300.0 * random.next()).round() / 64.0
        };
        let heights = (0..SIZE[0] * SIZE[1]).map(height).collect();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hills.df");
        let field = HeightField::of(SIZE[0], SIZE[1], heights);
        build_heights(&field, &HeightOrigin::default(), &HeightBuildOptions::default(), &path, &()).unwrap();
        let file = HeightFile::open(&path, ReadMethod::default()).unwrap();
        assert_eq!(u64::from(file.pages()), file.lattice().chunks(), "a page for each chunk");
        std::fs::read(path).unwrap()
    })
}

fn write_sound(folder: &Path) -> PathBuf {
    let path = folder.join("sound.df");
    std::fs::write(&path, sound()).unwrap();
    path
}

fn nodes(file: HeightFile, stall: Duration) -> PagedSurface {
    let mut nodes = PagedSurface::new(Arc::new(file), 1 << 30);
    nodes.wait_for(stall);
    nodes
}

fn opened(path: &Path) -> PagedSurface {
    nodes(HeightFile::open(path, ReadMethod::default()).unwrap(), LONG)
}

fn on_disk(name: &str, stall: Duration) -> (Arc<FaultyDisk>, PagedSurface) {
    let disk = FaultyDisk::new(sound());
    let nodes = nodes(HeightFile::open_on(Path::new(name), disk.clone()).unwrap(), stall);
    (disk, nodes)
}

/// Draws the field from above, with heights that may be off by so many pixels; and what is told of that, and whether nothing is missing.
fn drawn(nodes: &mut PagedSurface, tau: f64) -> (SurfacePicture, Vec<String>, bool) {
    let placed = Placed::new(&nodes.file().about().grid, Map::Plate, 1.0, 0.0);
    let [columns, rows] = SIZE.map(|side| side as f64);
    let middle = placed.world(rows / 2.0, columns / 2.0, 0.0);
    let projection = Projection::Orthographic { height: 0.9 * rows };
    let view = View::look_at(middle + 1000.0 * DVec3::Z, middle, DVec3::Y, projection, 160, 76).unwrap();
    let options = SurfaceOptions { technique: Technique::Rays, tau, raw: true, ..SurfaceOptions::default() };
    let sight = Sight::Flat(view);
    nodes.place(&placed);
    nodes.prepare(&placed, &sight, &options);
    let picture = draw(nodes, &placed, &sight, &options);
    let is_whole = picture.report.is_converged && nodes.error().is_none();
    (picture, nodes.take_messages(), is_whole)
}

/// Everything at full resolution.
fn whole(nodes: &mut PagedSurface) -> (SurfacePicture, Vec<String>, bool) {
    drawn(nodes, 0.0)
}

/// The coarsest chunk, which is in memory from now on.
fn coarsest(nodes: &mut PagedSurface) {
    let (picture, told, is_whole) = drawn(nodes, 1e6);
    assert!(is_whole && told.is_empty() && picture.report.nodes_drawn == 1, "{told:?}");
}

/// Heights of a picture, and how far they are from the field's own at most: infinite where something is missing.
fn away(picture: &SurfacePicture) -> f64 {
    static OWN: OnceLock<Vec<f64>> = OnceLock::new();
    let heights = |picture: &SurfacePicture| picture.raw.iter().map(|channels| channels[3]).collect::<Vec<f64>>();
    let own = OWN.get_or_init(|| heights(&whole(&mut on_disk("own.df", LONG).1).0));
    assert!(own.iter().all(|height| !height.is_nan()), "the field fills the picture");
    let away = heights(picture).into_iter().zip(own).map(|(height, own)| (height - own).abs());
    away.fold(0.0_f64, |most, away| if away.is_nan() { f64::INFINITY } else { most.max(away) })
}

/// The picture is coarser, without gaps, and as near to the field as is known of its chunks.
fn assert_coarser(nodes: &PagedSurface, picture: &SurfacePicture, is_whole: bool) {
    let file = nodes.file();
    let deltas = file.lattice().keys().map(|key| file.node(key).unwrap().delta);
    let (found, most) = (away(picture), deltas.fold(0.0, f64::max));
    assert!(!is_whole && found > 0.0 && found <= most + 1e-9, "{is_whole} {found} {most}");
}

fn assert_told(told: &[String], words: &[&str]) {
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(words.iter().all(|word| told[0].contains(word)) && !told[0].contains('\n'), "{told:?}");
}

#[test]
fn a_page_whose_checksum_fails_is_told_and_drawn_coarser() {
    let folder = tempfile::tempdir().unwrap();
    let path = write_sound(folder.path());
    let mut nodes = opened(&path);
    let mut open = OpenOptions::new().write(true).open(&path).unwrap();
    open.seek(SeekFrom::Start(offset_of(sound(), LEAF) + 500)).unwrap();
    open.write_all(&[0xa5, 0x5a, 0xa5]).unwrap();
    let (picture, told, is_whole) = whole(&mut nodes);
    assert_coarser(&nodes, &picture, is_whole);
    assert_told(&told, &["sound.df", "page 0", "checksum", "coarser"]);
    // It is told once.
    let (picture, told, is_whole) = whole(&mut nodes);
    assert_coarser(&nodes, &picture, is_whole);
    assert!(told.is_empty(), "{told:?}");
}

#[test]
fn a_file_cut_short_while_open_is_told_and_drawn_coarser() {
    cut_short_is_told(ReadMethod::Positioned);
    // Windows refuses to cut a file that is mapped.
    if cfg!(unix) {
        cut_short_is_told(ReadMethod::Mapped);
    }
}

fn cut_short_is_told(method: ReadMethod) {
    let folder = tempfile::tempdir().unwrap();
    let path = write_sound(folder.path());
    let mut nodes = nodes(HeightFile::open(&path, method).unwrap(), LONG);
    coarsest(&mut nodes);
    let len = offset_of(sound(), PageId(2)) + 100;
    OpenOptions::new().write(true).open(&path).unwrap().set_len(len).unwrap();
    let (picture, told, is_whole) = whole(&mut nodes);
    assert_coarser(&nodes, &picture, is_whole);
    // That it is shorter may be found out with a page that is there, then come three that are lost, and that there are more.
    let cut = format!("the file was cut from {} to {len} bytes", sound().len());
    let pages = told.iter().filter(|told| told.contains("sound.df: page") && told.contains("coarser"));
    assert!(pages.clone().count() == 3 && pages.clone().all(|told| told.contains(&cut)), "{told:?}");
    assert!(told.len() <= 5 && told.last().unwrap().contains("more pages"), "{told:?}");
}

#[test]
fn a_file_rewritten_in_place_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = write_sound(folder.path());
    let mut nodes = opened(&path);
    coarsest(&mut nodes);
    let other: Vec<u8> = sound().iter().map(|byte| byte.wrapping_add(1)).collect();
    OpenOptions::new().write(true).open(&path).unwrap().write_all(&other).unwrap();
    let (picture, told, is_whole) = whole(&mut nodes);
    assert_coarser(&nodes, &picture, is_whole);
    assert!(told[0].contains("page") && told[0].contains("rewritten while it was open"), "{told:?}");
    assert!(told.len() <= 4, "not a flood: {told:?}");
}

#[cfg(unix)]
#[test]
fn a_file_replaced_or_deleted_while_open_is_told_and_goes_on_where_the_system_lets_it() {
    let folder = tempfile::tempdir().unwrap();
    for word in ["replaced by another one", "deleted"] {
        let path = write_sound(folder.path());
        let mut nodes = opened(&path);
        match word {
            "deleted" => std::fs::remove_file(&path).unwrap(),
            _ => {
                let other = folder.path().join("other.df");
                std::fs::write(&other, b"something else").unwrap();
                std::fs::rename(&other, &path).unwrap();
            }
        }
        let (picture, told, is_whole) = whole(&mut nodes);
        assert!(is_whole && away(&picture) == 0.0, "an open file outlives its name");
        assert_told(&told, &["sound.df", word]);
    }
}

#[test]
fn a_disk_that_fails_now_and_then_or_is_slow_is_tried_again_in_silence() {
    let (disk, mut nodes) = on_disk("faulty.df", LONG);
    for page in 0..nodes.file().pages() {
        let answer = match page % 3 {
            0 => Answer::After(Duration::from_millis(50)),
            times => Answer::Fail { times, kind: ErrorKind::Other },
        };
        disk.set(PageId(page), answer);
    }
    let (picture, told, is_whole) = whole(&mut nodes);
    assert!(is_whole && told.is_empty() && away(&picture) == 0.0, "{told:?}");
}

#[test]
fn a_page_that_always_fails_is_told_once_and_left_alone_for_longer_and_longer() {
    let (disk, mut nodes) = on_disk("faulty.df", LONG);
    disk.set(LEAF, Answer::Fail { times: u32::MAX, kind: ErrorKind::TimedOut });
    let (picture, told, is_whole) = whole(&mut nodes);
    assert_coarser(&nodes, &picture, is_whole);
    assert_told(&told, &["faulty.df", "page 0", "coarser"]);
    // The next picture does not wait for it, whatever the disk would answer.
    disk.set(LEAF, Answer::Never);
    let again = nodes.again().unwrap().saturating_duration_since(Instant::now());
    assert!(again > Duration::from_secs(1) && again <= Duration::from_secs(30), "{again:?}");
    let start = Instant::now();
    let (picture, told, is_whole) = whole(&mut nodes);
    assert_coarser(&nodes, &picture, is_whole);
    assert!(told.is_empty() && start.elapsed() < again, "{told:?}");
}

#[test]
fn a_read_that_never_returns_is_told_and_holds_nothing_else_up() {
    let (disk, mut nodes) = on_disk("hung.df", Duration::from_millis(500));
    disk.set(LEAF, Answer::Never);
    let start = Instant::now();
    let (picture, told, is_whole) = whole(&mut nodes);
    assert_coarser(&nodes, &picture, is_whole);
    assert_told(&told, &["hung.df", "page 0", "not answered", "coarser"]);
    assert!(whole(&mut nodes).1.is_empty() && start.elapsed() < LONG);
    // The answer comes after all.
    disk.set(LEAF, Answer::Sound);
    let mut messages = Vec::new();
    loop {
        let (picture, told, is_whole) = whole(&mut nodes);
        messages.extend(told);
        if is_whole {
            assert_eq!(away(&picture), 0.0);
            break;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "the page does not come back");
        std::thread::sleep(Duration::from_millis(5));
    }
    assert_told(&messages, &["hung.df", "answers again"]);
}

#[test]
fn a_disk_that_stops_answering_leaves_what_was_read() {
    let (disk, mut nodes) = on_disk("dead.df", Duration::from_millis(200));
    coarsest(&mut nodes);
    let pages = || (0..sound_pages()).map(PageId);
    pages().for_each(|page| disk.set(page, Answer::Never));
    let start = Instant::now();
    let (picture, told, is_whole) = whole(&mut nodes);
    assert_coarser(&nodes, &picture, is_whole);
    assert_told(&told, &["dead.df: page", "not answered"]);
    drop(nodes);
    assert!(start.elapsed() < Duration::from_secs(10), "closing the file does not wait for the disk either");
    pages().for_each(|page| disk.set(page, Answer::Sound));
}

/// How many pages the file has.
fn sound_pages() -> u32 {
    HeightFile::open_on(Path::new("sound.df"), FaultyDisk::new(sound())).unwrap().pages()
}

/// Changes since the same field on a disk of its own, which gives a chunk after so many attempts or never.
#[test]
fn an_earlier_field_is_asked_for_again_and_told_as_well() {
    let key = ChunkKey { level: 0, row: 0, column: 0 };
    for (times, kind) in [(2, ErrorKind::Other), (u32::MAX, ErrorKind::UnexpectedEof)] {
        let disk = FaultyDisk::new(sound());
        let earlier = HeightFile::open_on(Path::new("earlier.df"), disk.clone()).unwrap();
        disk.set(earlier.page_of(key).unwrap(), Answer::Fail { times, kind });
        let (_, mut nodes) = on_disk("later.df", LONG);
        let grid = nodes.file().about().grid.clone();
        let alignment = Alignment::new(["later.df", "earlier.df"], &grid, &grid).unwrap();
        nodes.compare(Some(&Arc::new(Since::new(Arc::new(earlier), alignment, 1 << 30))));
        let (picture, told, is_whole) = whole(&mut nodes);
        let changes = nodes.samples(key).unwrap().changes.clone();
        assert_eq!(away(&picture), 0.0, "its own heights are there");
        if times == 2 {
            assert!(is_whole && told.is_empty() && changes.iter().all(|change| *change == 0.0), "{told:?}");
        } else {
            assert!(!is_whole && changes.iter().all(|change| change.is_nan() || *change == 0.0));
            assert!(changes[0].is_nan(), "what is not known is not made up");
            assert_told(&told, &["earlier.df", "page", "coarser"]);
        }
    }
}

#[test]
fn a_coarsest_chunk_that_cannot_be_read_is_an_error() {
    let disk = FaultyDisk::new(sound());
    let root = PageId(sound_pages() - 1);
    disk.set(root, Answer::Fail { times: u32::MAX, kind: ErrorKind::UnexpectedEof });
    let file = HeightFile::open_on(Path::new("rootless.df"), disk).unwrap();
    let error = OpenSurface::new(Path::new("rootless.df"), file).err().unwrap().to_string();
    assert!(error.contains(&format!("rootless.df: page {}", root.0)), "{error}");
}
