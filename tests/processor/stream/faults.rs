//! Streaming from disks and files that misbehave: what cannot be read is drawn coarser and told once, everything else
//! goes on, and no frame waits.

use super::disk::{Answer, FaultyDisk, offset_of, sound};
use crate::support::run;
use deepfield::model::ReadMethod;
use deepfield::store::{PageFile, PageId};
use deepfield::stream::{Scene, SceneSelection, StreamOptions};
use deepfield::view::{Projection, View};
use glam::DVec3;
use std::io::{ErrorKind, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A view that needs every page.
fn everything(file: &PageFile) -> (View, f64) {
    let bounds = file.metadata().bounds();
    let projection = Projection::Perspective { fov_y: 1.0 };
    let eye = bounds.center() + 1.2 * DVec3::Z * bounds.size().max_element();
    (View::look_at(eye, bounds.center(), DVec3::Y, projection, 640, 480).unwrap(), 1e-3)
}

fn options(stall: Duration) -> StreamOptions {
    StreamOptions { budget: u64::MAX, in_flight: 4, stall, prefetch: false, ..StreamOptions::default() }
}

/// Converges a scene of the file and says what was told.
fn converge(file: &Arc<PageFile>, stall: Duration) -> (Scene, SceneSelection, Vec<String>) {
    let mut scene = Scene::with_options(Arc::clone(file), options(stall));
    let (view, tau) = everything(file);
    let mut told = Vec::new();
    let selection = scene.converge(&view, tau, &mut |message| told.push(message)).unwrap();
    (scene, selection, told)
}

/// Some page that is neither the first nor the parent of all others.
fn last_page(file: &PageFile) -> PageId {
    PageId(file.page_count() - 1)
}

fn write_sound(folder: &Path) -> std::path::PathBuf {
    let path = folder.join("sound.df");
    std::fs::write(&path, sound()).unwrap();
    path
}

/// The picture is coarser in one place only, and one message says why.
fn assert_coarser(file: &PageFile, selection: &SceneSelection, told: &[String], words: &[&str]) {
    assert!(!selection.converged && selection.error_pixels > 1e-3 && !selection.nodes.is_empty());
    assert_eq!(selection.nodes.iter().map(mass).sum::<f64>().round(), total_mass(file).round());
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(words.iter().all(|word| told[0].contains(word)) && !told[0].contains('\n'), "{told:?}");
}

fn mass(node: &deepfield::stream::SceneNode) -> f64 {
    node.page.nodes[node.node.node as usize].source_particles as f64
}

fn total_mass(file: &PageFile) -> f64 {
    file.metadata().particles() as f64
}

#[test]
fn a_page_whose_checksum_fails_is_told_and_drawn_coarser() {
    let folder = tempfile::tempdir().unwrap();
    let path = write_sound(folder.path());
    let file = Arc::new(PageFile::open(&path).unwrap());
    let bad = last_page(&file);
    let mut open = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    open.seek(SeekFrom::Start(offset_of(sound(), bad) + 500)).unwrap();
    open.write_all(&[0xa5, 0x5a, 0xa5]).unwrap();
    let (_, selection, told) = converge(&file, Duration::from_secs(20));
    assert_coarser(&file, &selection, &told, &["sound.df", &format!("page {}", bad.0), "checksum", "coarser"]);
}

#[test]
fn a_file_cut_short_while_open_is_told_and_drawn_coarser() {
    cut_short_is_told(ReadMethod::Positioned);
}

/// Windows refuses to cut a file that is mapped.
#[cfg(unix)]
#[test]
fn a_mapped_file_cut_short_is_told_and_drawn_coarser_and_ends_nothing() {
    cut_short_is_told(ReadMethod::Mapped);
}

fn cut_short_is_told(method: ReadMethod) {
    let folder = tempfile::tempdir().unwrap();
    let path = write_sound(folder.path());
    let file = Arc::new(PageFile::open_with(&path, method).unwrap());
    let bad = last_page(&file);
    let len = offset_of(sound(), bad) + 100;
    std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(len).unwrap();
    let (_, selection, told) = converge(&file, Duration::from_secs(20));
    // That it is shorter is found out with the first page, that a page is lost with the last.
    assert!(!selection.converged && selection.error_pixels > 1e-3);
    assert!(told[0].contains("sound.df: the file was cut from"), "{told:?}");
    let page = format!("page {}: the file was cut from {} to {len} bytes", bad.0, sound().len());
    assert!(told.len() == 2 && told[1].contains(&page) && told[1].contains("coarser"), "{told:?}");
    assert_eq!(selection.nodes.iter().map(mass).sum::<f64>(), total_mass(&file));
}

#[test]
fn a_file_rewritten_in_place_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = write_sound(folder.path());
    let file = Arc::new(PageFile::open(&path).unwrap());
    // The root is in memory before the file changes.
    let mut scene = Scene::with_options(Arc::clone(&file), options(Duration::from_secs(20)));
    let (view, tau) = everything(&file);
    scene.converge(&view, 1e6, &mut |_| {}).unwrap();
    let other: Vec<u8> = sound().iter().map(|byte| byte.wrapping_add(1)).collect();
    std::fs::OpenOptions::new().write(true).open(&path).unwrap().write_all(&other).unwrap();
    let mut told = Vec::new();
    let selection = scene.converge(&view, tau, &mut |message| told.push(message)).unwrap();
    assert!(!selection.converged && !selection.nodes.is_empty());
    assert_eq!(selection.nodes.iter().map(mass).sum::<f64>(), total_mass(&file));
    assert!(told[0].contains("page") && told[0].contains("rewritten while it was open"), "{told:?}");
    assert!(told.len() <= 4, "not a flood: {told:?}");
}

#[cfg(unix)]
#[test]
fn a_file_replaced_or_deleted_while_open_is_told_and_goes_on_where_the_system_lets_it() {
    use deepfield::store::Change;
    let folder = tempfile::tempdir().unwrap();
    for (change, word) in [(Change::Replaced, "replaced by another one"), (Change::Deleted, "deleted")] {
        let path = write_sound(folder.path());
        let file = Arc::new(PageFile::open(&path).unwrap());
        if change == Change::Replaced {
            let other = folder.path().join("other.df");
            std::fs::write(&other, b"something else").unwrap();
            std::fs::rename(&other, &path).unwrap();
        } else {
            std::fs::remove_file(&path).unwrap();
        }
        assert_eq!(file.change_of(PageId(0)), Some(change));
        let (_, selection, told) = converge(&file, Duration::from_secs(20));
        assert!(selection.converged, "an open file outlives its name");
        assert!(told.len() == 1 && told[0].contains(word) && told[0].contains("sound.df"), "{told:?}");
    }
}

#[test]
fn a_disk_that_fails_now_and_then_is_tried_again_in_silence() {
    let disk = FaultyDisk::new(sound());
    let file = Arc::new(PageFile::open_on(Path::new("faulty.df"), disk.clone()).unwrap());
    for page in 0..file.page_count() {
        disk.set(PageId(page), Answer::Fail { times: page % 3, kind: ErrorKind::Other });
    }
    let (scene, selection, told) = converge(&file, Duration::from_secs(20));
    assert!(selection.converged && told.is_empty(), "{told:?}");
    assert_eq!(scene.streamer.residency.statistics().failed, 0);
}

#[test]
fn a_page_that_always_fails_is_told_once_and_comes_when_the_disk_is_well_again() {
    let disk = FaultyDisk::new(sound());
    let file = Arc::new(PageFile::open_on(Path::new("faulty.df"), disk.clone()).unwrap());
    let bad = last_page(&file);
    disk.set(bad, Answer::Fail { times: u32::MAX, kind: ErrorKind::TimedOut });
    let (mut scene, selection, told) = converge(&file, Duration::from_secs(20));
    assert_coarser(&file, &selection, &told, &["faulty.df", &format!("page {}", bad.0), "coarser"]);
    disk.set(bad, Answer::Sound);
    let start = Instant::now();
    let (view, tau) = everything(&file);
    let mut messages = Vec::new();
    loop {
        let selection = scene.converge(&view, tau, &mut |message| messages.push(message)).unwrap();
        if selection.converged {
            break;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "the page does not come back");
        std::thread::sleep(Duration::from_millis(50));
    }
    assert!(messages.is_empty(), "{messages:?}");
}

#[test]
fn a_disk_of_50_ms_delays_the_picture_and_no_frame() {
    let disk = FaultyDisk::new(sound());
    let file = Arc::new(PageFile::open_on(Path::new("slow.df"), disk.clone()).unwrap());
    (0..file.page_count()).for_each(|page| disk.set(PageId(page), Answer::After(Duration::from_millis(50))));
    let mut scene = Scene::with_options(Arc::clone(&file), options(Duration::from_secs(20)));
    let (view, tau) = everything(&file);
    let roots = scene.streamer.roots(scene.families.iter().copied(), scene.purpose, 0.0);
    let start = Instant::now();
    let mut frames = Vec::new();
    loop {
        let frame = Instant::now();
        scene.streamer.arrive();
        let selection = scene.streamer.select(&view, tau, &roots);
        scene.streamer.serve();
        frames.push(frame.elapsed());
        if selection.is_converged() {
            break;
        }
        assert!(start.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(2));
    }
    frames.sort();
    assert!(frames.len() > 20, "the picture converged at once: {}", frames.len());
    // The median, since a busy machine may take any single frame's processor away.
    assert!(frames[frames.len() / 2] < Duration::from_millis(25), "{:?}", frames[frames.len() / 2]);
    let learned = scene.streamer.prefetch_distance();
    assert_eq!(learned, 0.0, "a camera at rest reads nothing ahead");
}

#[test]
fn a_read_that_never_returns_is_told_and_blocks_nothing_else() {
    let disk = FaultyDisk::new(sound());
    let file = Arc::new(PageFile::open_on(Path::new("hung.df"), disk.clone()).unwrap());
    let bad = last_page(&file);
    disk.set(bad, Answer::Never);
    let start = Instant::now();
    let (mut scene, selection, told) = converge(&file, Duration::from_millis(300));
    assert!(start.elapsed() < Duration::from_secs(20));
    assert_coarser(&file, &selection, &told, &["hung.df", &format!("page {}", bad.0), "not answered", "coarser"]);
    let statistics = scene.streamer.residency.statistics();
    assert_eq!((statistics.stalled, statistics.resident as u32), (1, file.page_count() - 1));
    // The answer comes after all.
    disk.set(bad, Answer::Sound);
    let (view, tau) = everything(&file);
    let mut messages = Vec::new();
    while !scene.select(&view, tau).converged {
        messages.extend(scene.streamer.arrive().messages);
        assert!(start.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(messages.len() == 1 && messages[0].contains("answers again"), "{messages:?}");
}

#[test]
fn a_disk_that_stops_answering_stops_nothing_but_pages() {
    let disk = FaultyDisk::new(sound());
    let file = Arc::new(PageFile::open_on(Path::new("dead.df"), disk.clone()).unwrap());
    let (view, tau) = everything(&file);
    let mut scene = Scene::with_options(Arc::clone(&file), options(Duration::from_millis(100)));
    scene.converge(&view, 1e6, &mut |_| {}).unwrap();
    (0..file.page_count()).for_each(|page| disk.set(PageId(page), Answer::Never));
    let roots = scene.streamer.roots(scene.families.iter().copied(), scene.purpose, 0.0);
    let mut told = Vec::new();
    let start = Instant::now();
    let mut frames = 0;
    while start.elapsed() < Duration::from_secs(2) {
        told.extend(scene.streamer.arrive().messages);
        let selection = scene.streamer.select(&view, tau, &roots);
        scene.streamer.serve();
        assert!(!selection.draw.is_empty(), "the coarse picture stays");
        assert!(scene.streamer.residency.statistics().loading <= 4);
        frames += 1;
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(frames > 100, "{frames}");
    assert!(told.len() == 1 && told[0].contains("dead.df: page"), "{told:?}");
    // Closing the file does not wait for the disk either.
    let start = Instant::now();
    drop(scene);
    assert!(start.elapsed() < Duration::from_secs(1));
    (0..file.page_count()).for_each(|page| disk.set(PageId(page), Answer::Sound));
}

#[test]
fn a_root_that_cannot_be_read_is_an_error() {
    let disk = FaultyDisk::new(sound());
    let file = Arc::new(PageFile::open_on(Path::new("rootless.df"), disk.clone()).unwrap());
    let (view, tau) = everything(&file);
    for (answer, notes) in [(Answer::Never, 1), (Answer::Fail { times: u32::MAX, kind: ErrorKind::UnexpectedEof }, 0)] {
        for is_listed in [false, true] {
            disk.set(PageId(0), answer);
            // A busy machine's threads may take long for an answer that says no.
            let stall = if notes == 0 { Duration::from_secs(20) } else { Duration::from_millis(100) };
            let mut scene = Scene::with_options(Arc::clone(&file), options(stall));
            let mut told = Vec::new();
            let mut tell = |message: String| told.push(message);
            let outcome = match is_listed {
                true => scene.list(&view, tau, &mut tell).map(drop),
                false => scene.converge(&view, tau, &mut tell).map(drop),
            };
            let error = outcome.unwrap_err().to_string();
            assert!(error.contains("rootless.df: page 0"), "{error}");
            // That a disk does not answer is told while it is waited for; nothing else comes before the error.
            assert_eq!(told.len(), notes, "{told:?}");
            disk.set(PageId(0), Answer::Sound);
        }
    }
}

#[test]
fn a_root_that_was_given_up_is_drawn_if_it_comes_after_all() {
    let disk = FaultyDisk::new(sound());
    let file = Arc::new(PageFile::open_on(Path::new("late.df"), disk.clone()).unwrap());
    disk.set(PageId(0), Answer::Fail { times: 4, kind: ErrorKind::TimedOut });
    let (_, selection, told) = converge(&file, Duration::from_secs(20));
    assert!(selection.converged && told.is_empty(), "{told:?}");
    assert_eq!(selection.nodes.iter().map(mass).sum::<f64>(), total_mass(&file));
}

#[test]
fn a_picture_of_a_file_with_a_damaged_root_says_so_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = write_sound(folder.path());
    let root = PageFile::open(&path).unwrap().metadata().families[0].root_page;
    let mut open = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    open.seek(SeekFrom::Start(offset_of(sound(), root) + 500)).unwrap();
    open.write_all(&[0xa5, 0x5a, 0xa5]).unwrap();
    let arguments = ["render", "sound.df", "-o", "a.png", "--size", "64x48", "--backend", "cpu"];
    // With all pages at once, and in passes.
    for memory in ["1GiB", "16MiB"] {
        let output = run(folder.path(), &[&arguments[..], &["--memory", memory]].concat());
        let told = String::from_utf8(output.stderr).unwrap();
        let page = format!("sound.df: page {}", root.0);
        assert!(!output.status.success() && told.matches(&page).count() == 1, "{memory}: {told}");
        assert!(told.contains("checksum") && !told.contains("coarser"), "{memory}: {told}");
    }
}
