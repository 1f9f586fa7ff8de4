//! Page files behind a URL, from servers that answer well and badly: nothing wrong is ever shown, what cannot be read is drawn coarser
//! and told, and nothing is read twice.

mod buckets;
#[cfg(unix)]
mod cache;
#[cfg(target_os = "linux")]
mod certificates;
mod commands;
mod index;
mod requests;
#[cfg(unix)]
mod secrets;
mod servers;

use super::stream::disk::{in_memory, kept, offset_of};
use super::stream::soak::soak;
use crate::support::fault_server::{Asked, Fault, FaultServer};
use crate::support::{Random, alone, program, run};
use deepfield::build::BuildOptions;
use deepfield::look::{DataKind, DatasetRef, SceneFile};
use deepfield::model::ReadMethod;
use deepfield::store::{PageFile, PageId, RunFile, Tree};
use deepfield::stream::{Scene, SceneSelection, StreamOptions};
use deepfield::view::{Projection, View};
use glam::DVec3;
use serde_json::Value;
use std::collections::HashMap;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::{Duration, Instant};

/// What opening reads of each end.
const ENDS: [u64; 2] = [64 << 10, 256 << 10];

/// The bytes of a page file with many small pages.
fn sound() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| {
        kept("clusters-of-small-pages", 300_000, &BuildOptions { page_bytes: 128 << 10, ..BuildOptions::default() })
    })
}

fn served() -> FaultServer {
    FaultServer::new(sound().to_vec())
}

/// The file under a name of its own: what was opened just now is not asked about again, and servers may come by the same address.
fn open(server: &FaultServer) -> Arc<PageFile> {
    static OPENED: AtomicUsize = AtomicUsize::new(0);
    let name = format!("{}.df", OPENED.fetch_add(1, Ordering::Relaxed));
    Arc::new(PageFile::open(Path::new(&server.url(&name))).unwrap())
}

/// First byte and the one after the last of a page.
fn place(page: PageId) -> (u64, u64) {
    let start = offset_of(sound(), page);
    (start, start + in_memory(sound()).page_bytes(page))
}

/// The pages that no root is in and that opening does not read.
fn pages_apart(file: &PageFile) -> Vec<PageId> {
    let is_apart = |page: &PageId| place(*page).1 < file.bytes() - ENDS[1] && place(*page).0 >= ENDS[0];
    (0..file.page_count()).map(PageId).filter(|page| !file.is_root(*page)).filter(is_apart).collect()
}

/// One of them.
fn some_page(file: &PageFile) -> PageId {
    *pages_apart(file).last().unwrap()
}

/// Converges a scene that needs every page, and says what was told.
fn converge(file: &Arc<PageFile>) -> (SceneSelection, Vec<String>) {
    let stall = Duration::from_secs(20);
    let options = StreamOptions { budget: u64::MAX, in_flight: 4, stall, prefetch: false, ..StreamOptions::default() };
    let mut scene = Scene::with_options(Arc::clone(file), options);
    let bounds = file.metadata().bounds();
    let eye = bounds.center() + 1.2 * DVec3::Z * bounds.size().max_element();
    let projection = Projection::Perspective { fov_y: 1.0 };
    let view = View::look_at(eye, bounds.center(), DVec3::Y, projection, 640, 480).unwrap();
    let mut told = Vec::new();
    let selection = scene.converge(&view, 1e-3, &mut |message| told.push(message)).unwrap();
    // Coarser or not, every particle is drawn, once.
    let particles = |node: &deepfield::stream::SceneNode| node.page.nodes[node.node.node as usize].source_particles;
    assert_eq!(selection.nodes.iter().map(particles).sum::<u64>(), file.metadata().particles());
    (selection, told)
}

/// Takes away what says who asks: whoever runs the tests may have a bucket.
fn without_keys(command: &mut Command) -> &mut Command {
    for (name, _) in std::env::vars_os().filter(|(name, _)| name.to_string_lossy().starts_with("AWS_")) {
        command.env_remove(name);
    }
    command
}

/// Answers requests for one page with a fault so many times, and all others well.
fn faulty(server: &FaultServer, page: PageId, fault: Fault, times: usize) {
    let (start, left) = (place(page).0, Mutex::new(times));
    server.answer(move |asked: &Asked| {
        let mut left = left.lock().unwrap();
        match asked.range {
            Some((from, _)) if from == start && *left > 0 => {
                *left -= 1;
                fault
            }
            _ => Fault::Sound,
        }
    });
}

#[test]
fn a_file_opens_with_two_requests_and_each_page_with_one() {
    let (server, local) = (served(), in_memory(sound()));
    let file = open(&server);
    assert_eq!(server.asked().len(), 2);
    assert_eq!(file.metadata(), local.metadata());
    for page in (0..file.page_count()).map(PageId) {
        let [there, here] = [&file, &local].map(|file| file.fetch_page(page).unwrap());
        assert_eq!(there.bytes(), here.bytes(), "page {}", page.0);
    }
    let mut asked: HashMap<u64, usize> = HashMap::new();
    server.asked().iter().for_each(|asked_for| *asked.entry(asked_for.range.unwrap().0).or_default() += 1);
    assert!(asked.values().all(|times| *times == 1), "{asked:?}");
    let pages: u64 = (0..file.page_count()).map(|page| file.page_bytes(PageId(page))).sum();
    assert!(server.sent() <= pages + pages / 20 + ENDS.iter().sum::<u64>(), "{} of {pages}", server.sent());
    // What kind of file it is, and what it holds, is one question.
    assert_eq!(DataKind::of(Path::new(&server.url("other.df"))).unwrap(), DataKind::Pages);
    PageFile::open(Path::new(&server.url("other.df"))).unwrap();
    assert_eq!(server.asked().iter().filter(|asked| asked.target == "/other.df").count(), 2);
}

#[test]
fn what_may_pass_is_asked_for_again_and_shows_in_no_picture() {
    let faults = [
        Fault::Status(503, None),
        Fault::Status(429, None),
        Fault::Status(408, None),
        Fault::Short,
        Fault::WrongPart,
        Fault::Long,
        Fault::Cut,
    ];
    std::thread::scope(|scope| {
        for fault in faults {
            scope.spawn(move || {
                let server = served();
                let file = open(&server);
                let page = some_page(&file);
                faulty(&server, page, fault, 2);
                let (selection, told) = converge(&file);
                assert!(selection.converged && told.is_empty(), "{fault:?}: {told:?}");
                let times = server.asked().iter().filter(|asked| asked.range == Some(place(page))).count();
                assert_eq!(times, 3, "{fault:?}");
            });
        }
        // What goes on failing is told, with the server and the cause.
        scope.spawn(|| {
            let server = served();
            let file = open(&server);
            let page = some_page(&file);
            faulty(&server, page, Fault::Status(500, None), usize::MAX);
            let (selection, told) = converge(&file);
            assert!(!selection.converged && told.len() == 1, "{told:?}");
            let number = format!("page {}: ", page.0);
            let words = [number.as_str(), "127.0.0.1 has a fault of its own (status 500)", "coarser"];
            assert!(words.iter().all(|word| told[0].contains(word)), "{told:?}");
        });
    });
}

#[test]
fn what_was_damaged_on_its_way_is_asked_for_once_more() {
    let (server, local) = (served(), in_memory(sound()));
    let file = open(&server);
    let page = some_page(&file);
    let times = || server.asked().iter().filter(|asked| asked.range == Some(place(page))).count();
    faulty(&server, page, Fault::Damaged, 1);
    assert_eq!(file.fetch_page(page).unwrap().bytes(), local.fetch_page(page).unwrap().bytes());
    assert_eq!(times(), 2);
    // What lies there damaged is told.
    faulty(&server, page, Fault::Damaged, usize::MAX);
    let told = file.read_page(page).unwrap_err().to_string();
    assert!(told.contains("checksum"), "{told}");
    assert_eq!(times(), 4);
    // The last bytes of the file, which hold the footer.
    let (server, end) = (served(), sound().len() as u64);
    let last = (end - ENDS[1], end);
    server.answer(move |asked| if asked.range == Some(last) { Fault::Damaged } else { Fault::Sound });
    assert_eq!(open(&server).metadata(), local.metadata());
    assert_eq!(server.asked().len(), 3);
}

#[test]
fn a_file_that_is_replaced_while_it_is_opened_is_opened_again() {
    let (folder, server) = (tempfile::tempdir().unwrap(), served());
    let last = sound().len() as u64 - ENDS[1];
    // What was seen of it before is not shown in its place.
    for _ in 0..2 {
        let times = AtomicUsize::new(0);
        server.answer(move |asked| match asked.range {
            Some((from, _)) if from == last => match times.fetch_add(1, Ordering::Relaxed) {
                0 => Fault::Cut,
                1 => Fault::Status(412, None),
                _ => Fault::Sound,
            },
            _ => Fault::Sound,
        });
        let output = run(folder.path(), &["info", &server.url("a.df")]);
        let told = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && !told.contains("was read of it before"), "{told}");
    }
}

#[test]
fn a_server_that_asks_to_be_left_alone_is() {
    let server = served();
    let file = open(&server);
    let page = some_page(&file);
    faulty(&server, page, Fault::Status(503, Some(1)), 1);
    let start = Instant::now();
    let told = file.read_page(page).unwrap_err().to_string();
    assert!(told.ends_with("127.0.0.1 asks for fewer requests (status 503), and for none within 1 s"), "{told}");
    let is_late = || assert!(start.elapsed() >= Duration::from_secs(1));
    std::thread::scope(|scope| {
        // No other file of that server is asked for either.
        scope.spawn(|| {
            open(&server);
            is_late();
        });
        file.read_page(page).unwrap();
        is_late();
    });
    assert_eq!(server.asked().len(), 6);
}

#[test]
fn what_will_not_pass_is_told_once_and_drawn_coarser() {
    let faults = [
        (Fault::Status(401, None), "DEEPFIELD_TOKEN"),
        (Fault::Status(403, None), "does not let this be read (status 403)"),
        (Fault::Status(404, None), "deleted"),
        (Fault::Status(412, None), "replaced"),
        (Fault::Status(416, None), "(status 416)"),
        (Fault::Whole, "byte ranges"),
        (Fault::Unsized, "Content-Length"),
    ];
    for (fault, words) in faults {
        let server = served();
        let file = open(&server);
        let page = some_page(&file);
        // The others come first, so that nothing else is lacking where the file is gone.
        (0..file.page_count()).map(PageId).filter(|other| *other != page).for_each(|other| drop(file.read_page(other)));
        faulty(&server, page, fault, usize::MAX);
        let before = server.asked().len();
        assert!(file.read_page(page).unwrap_err().to_string().contains(words), "{fault:?}");
        assert_eq!(server.asked().len(), before + 1, "{fault:?}");
        if matches!(fault, Fault::Status(401 | 403 | 416, _) | Fault::Whole | Fault::Unsized) {
            let (selection, told) = converge(&file);
            assert!(!selection.converged && told.len() == 1, "{fault:?}: {told:?}");
            assert!(told[0].contains(words) && !told[0].contains('\n'), "{told:?}");
        }
    }
    // Of pages that do not come for one cause the first is told; the last ones lie below none of each other.
    let server = served();
    let file = open(&server);
    let starts: Vec<u64> = pages_apart(&file).into_iter().rev().take(3).map(|page| place(page).0).collect();
    let is_refused = move |asked: &Asked| asked.range.is_some_and(|(from, _)| starts.contains(&from));
    let refuses = is_refused.clone();
    server.answer(move |asked| if refuses(asked) { Fault::Status(403, None) } else { Fault::Sound });
    let (selection, told) = converge(&file);
    assert!(!selection.converged && told.len() == 1 && told[0].contains("(status 403)"), "{told:?}");
    let asked = server.asked();
    assert!(asked.iter().filter(|asked| is_refused(asked)).count() > 1, "{asked:?}");
}

#[test]
fn another_version_is_told_and_never_shown() {
    let first = "Sun, 06 Nov 1994 08:49:37 GMT";
    let later = "Sun, 06 Nov 1994 08:49:38 GMT";
    let other: Vec<u8> = sound().iter().map(|byte| byte ^ 0x5a).collect();
    // The length, the tag or the time tells; where none does, checksums do.
    let longer = [other.as_slice(), &[0; 8]].concat();
    for (bytes, tag, modified, words) in [
        (other.clone(), Some("\"second\""), Some(first), "replaced"),
        (longer, None, Some(first), "replaced"),
        (other.clone(), None, Some(later), "replaced"),
        (other, Some("W/\"weak\""), None, "checksum"),
    ] {
        let server = served();
        if tag.is_none_or(|tag| tag.starts_with("W/")) {
            server.replace(sound().to_vec(), None, Some(first));
        }
        let file = open(&server);
        let page = some_page(&file);
        server.replace(bytes, tag, modified);
        let error = file.read_page(page).unwrap_err().to_string();
        assert!(error.contains(words), "{tag:?}, {modified:?}: {error}");
        // Opened again, it is what is there now: none of the program's files.
        if words == "replaced" {
            assert!(PageFile::open(file.path()).is_err());
        }
    }
}

#[test]
fn a_read_without_an_answer_holds_up_nothing_else() {
    let server = served();
    let file = open(&server);
    let page = some_page(&file);
    faulty(&server, page, Fault::Stall, usize::MAX);
    std::thread::scope(|scope| {
        let stalled = scope.spawn(|| file.read_page(page).map(|page| page.id));
        for other in (0..file.page_count()).map(PageId).filter(|other| *other != page) {
            file.read_page(other).unwrap();
        }
        assert!(!stalled.is_finished());
        server.answer(|_| Fault::Sound);
        assert_eq!(stalled.join().unwrap().unwrap(), page);
    });
}

#[test]
fn a_slow_link_brings_everything_and_nothing_is_told() {
    let server = FaultServer::over_link(sound().to_vec(), Duration::from_millis(10), 1e7);
    let file = open(&server);
    let (selection, told) = converge(&file);
    assert!(selection.converged && told.is_empty(), "{told:?}");
    // Four to begin with, and one more for each round trip at most.
    let most = 16.0 + 2.0 * server.asked().len() as f64;
    assert!((server.most_at_once() as f64) <= most.sqrt() + 1.0, "{} at a time", server.most_at_once());
}

/// A link of 20 MB/s where one answer in eight is of no use; `deepfield bench remote --faults` flies for longer.
#[test]
fn a_flight_over_a_bad_link_stays_within_its_budget() {
    let fly = || {
        let server = FaultServer::over_link(sound().to_vec(), Duration::from_millis(2), 2e7);
        let file = open(&server);
        let random = Mutex::new(Random(5));
        server.answer(move |_| {
            let faults = [
                Fault::Status(503, None),
                Fault::Status(500, None),
                Fault::Short,
                Fault::WrongPart,
                Fault::Long,
                Fault::Cut,
            ];
            let number = (8.0 * faults.len() as f64 * random.lock().unwrap().next()) as usize;
            faults.get(number).copied().unwrap_or(Fault::Sound)
        });
        soak(&file, 8_000, |message| message.contains("127.0.0.1"));
    };
    alone("remote::a_flight_over_a_bad_link_stays_within_its_budget", fly);
}

#[test]
fn what_cannot_be_opened_says_why_in_one_line_without_secrets() {
    let folder = tempfile::tempdir().unwrap();
    for (fault, words) in [
        (Fault::Status(401, None), "127.0.0.1 asks for a token"),
        (Fault::Status(403, None), "127.0.0.1 does not let this be read"),
        (Fault::Status(404, None), "127.0.0.1 has no such file"),
        (Fault::Whole, "byte ranges"),
        // Nothing is asked for that would leave the machine unencrypted.
        (Fault::Elsewhere("http://data.example/a.df?sig=s3cr3t"), "127.0.0.1 says that this is elsewhere"),
    ] {
        let server = served();
        server.answer(move |_| fault);
        let mut info = program();
        info.args(["info", &server.url("a.df?sig=s3cr3t")]).env("XDG_CACHE_HOME", folder.path());
        info.env_remove("DEEPFIELD_ALLOW_HTTP");
        let output = info.env("DEEPFIELD_TOKEN", "t0ken").output().unwrap();
        let told = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success() && told.contains(words) && told.lines().count() == 1, "{told}");
        assert!(told.contains("/a.df:") && !told.contains("s3cr3t") && !told.contains("t0ken"), "{told}");
        let asked = server.asked();
        assert!(asked.iter().all(|asked| asked.target == "/a.df?sig=s3cr3t"), "{asked:?}");
        assert!(asked.iter().all(|asked| asked.authorization.as_deref() == Some("Bearer t0ken")), "{asked:?}");
    }
    let server = FaultServer::new(b"x,y,z\n1,2,3\n".repeat(1000));
    let url = server.url("a.csv");
    for (command, rest, words) in [
        ("render", ["-o", "a.png"], "deepfield build"),
        ("build", ["-o", "a.df"], "deepfield build"),
        ("contours", ["--interval=1", "-oa.csv"], "not a deepfield"),
        ("serve", ["--listen", "127.0.0.1:0"], "--view"),
        ("catalogue", ["--most", "5"], "found a URL, expected a file or folder of this machine"),
        ("catalogue", ["--time", "last"], "found a URL, expected a file or folder of this machine"),
    ] {
        let output = run(folder.path(), &[command, &url, rest[0], rest[1]]);
        let told = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success() && told.lines().count() == 1, "{command}: {told}");
        assert!(told.contains("a.csv") && told.contains(words), "{command}: {told}");
    }
    // Scenes and what they name but for data lie on this machine; no server is asked for them.
    let asked = server.asked().len();
    let [data, scene] = ["a.df", "a.scene.ron"].map(|name| folder.path().join(name));
    std::fs::write(&data, sound()).unwrap();
    let [labels, afar, look] =
        ["l.csv", "b.scene.ron", "c.scene.ron"].map(|name| server.url(&format!("{name}?sig=s3cr3t")));
    let names =
        SceneFile { labels: Some(labels.clone().into()), ..SceneFile::new(vec![DatasetRef::of(&data, &scene)]) };
    names.write(&scene).unwrap();
    for (arguments, name) in [
        (&["render", &afar][..], "b.scene.ron: "),
        (&["render", "a.df", "--scene", &look][..], "c.scene.ron: "),
        (&["render", "a.df", "--labels", &labels][..], "l.csv: "),
        (&["render", "a.scene.ron", "--annotate=labels"][..], "l.csv: "),
    ] {
        let rest = ["--size", "64x48", "--backend", "cpu", "-o", "a.png"];
        let output = run(folder.path(), &[arguments, &rest].concat());
        let told = String::from_utf8(output.stderr).unwrap();
        let line = told.lines().last().unwrap_or_default();
        assert!(!output.status.success() && line.contains(name), "{arguments:?}: {told}");
        assert!(line.contains("found a URL, expected a file") && !told.contains("s3cr3t"), "{arguments:?}: {told}");
    }
    assert_eq!(server.asked().len(), asked);
}

#[test]
fn a_token_is_not_shown_where_a_server_sends_on_to_another() {
    let (folder, first, second) = (tempfile::tempdir().unwrap(), served(), served());
    let place: &'static str = second.url("b.df").leak();
    first.answer(move |_| Fault::Elsewhere(place));
    let mut info = program();
    info.args(["info", &first.url("a.df")]).env("XDG_CACHE_HOME", folder.path()).env("DEEPFIELD_TOKEN", "t0ken");
    let output = info.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let [first, second] = [first, second].map(|server| server.asked());
    assert!(first.iter().all(|asked| asked.authorization.as_deref() == Some("Bearer t0ken")), "{first:?}");
    assert!(second.len() == first.len() && second.iter().all(|asked| asked.authorization.is_none()), "{second:?}");
}

#[test]
fn what_was_seen_once_is_there_without_a_network() {
    let folder = tempfile::tempdir().unwrap();
    let server = served();
    let url = server.url("sound.df");
    let info = |url: &str| {
        let output = run(folder.path(), &["info", url]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        (output.stdout, String::from_utf8(output.stderr).unwrap())
    };
    let render = |url: &str, name: &str| {
        let size = ["--size", "64x48", "--backend", "cpu", "-o", name];
        let output = run(folder.path(), &[&["render", url][..], &size[..]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        (std::fs::read(folder.path().join(name)).unwrap(), String::from_utf8(output.stderr).unwrap())
    };
    let (about, _) = info(&url);
    assert_eq!(server.asked().len(), 2);
    std::fs::write(folder.path().join("sound.df"), sound()).unwrap();
    let (picture, _) = render(&url, "afar.png");
    assert_eq!(picture, render("sound.df", "here.png").0);
    // Pages come from here by now.
    let before = server.asked().len();
    assert_eq!(render(&url, "again.png").0, picture);
    assert_eq!(server.asked().len(), before + 2);
    // A scene names it, too.
    let scene = format!("(version: 1, datasets: [(path: {url:?})])");
    let path = folder.path().join("a.scene.ron");
    std::fs::write(&path, scene).unwrap();
    let located = SceneFile::read(&path).unwrap().locate(&path).unwrap();
    assert_eq!((located.members[0].path.as_path(), located.notes.len()), (Path::new(&url), 0));
    drop(server);
    let (offline, told) = info(&url);
    assert_eq!(offline, about);
    assert!(told.contains("127.0.0.1 cannot be reached") && told.lines().count() == 1, "{told}");
    let (offline, told) = render(&url, "offline.png");
    assert_eq!(offline, picture);
    assert_eq!(told.matches("cannot be reached").count(), 1, "{told}");
}

#[test]
fn a_run_that_was_seen_is_there_without_a_network() {
    let folder = tempfile::tempdir().unwrap();
    let ok = |arguments: &[&str]| {
        let output = run(folder.path(), arguments);
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stderr).unwrap()
    };
    // Two versions of a run, of which opening does not read all.
    for (name, seed) in [("run", "1"), ("other", "2")] {
        ok(&["synth", "orbits", "-n", "20000", "--steps", "3", "--seed", seed, "-o", name]);
        let steps = [0, 1, 2].map(|step| format!("{name}_00{step}"));
        ok(&["build", &steps[0], &steps[1], &steps[2], "-o", &format!("{name}.df")]);
    }
    let [bytes, other] = ["run.df", "other.df"].map(|name| std::fs::read(folder.path().join(name)).unwrap());
    let local = RunFile::open(&folder.path().join("run.df"), ReadMethod::default()).unwrap();
    let steps = &local.directory().steps;
    let between = 0.5 * (steps[0].time + steps[1].time);
    assert!((ENDS[0]..bytes.len() as u64 - ENDS[1]).contains(&steps[1].still.offset));
    let server = FaultServer::new(bytes);
    let url = server.url("run.df");
    let camera = ["--size", "64x48", "--backend", "cpu", "-o", "picture.png"];
    let picture = |path: &str, time: &str| {
        let told = ok(&[&["render", path, "--time", time], &camera[..]].concat());
        (std::fs::read(folder.path().join("picture.png")).unwrap(), told)
    };
    let times = ["step:1".to_owned(), between.to_string()];
    let seen = times.each_ref().map(|time| picture(&url, time).0);
    assert!(seen == times.each_ref().map(|time| picture("run.df", time).0));
    server.answer(|_| Fault::Cut);
    let before = server.asked().len();
    for (time, seen) in times.iter().zip(&seen) {
        let (picture, told) = picture(&url, time);
        assert!(picture == *seen && told.matches("read of it before is shown").count() == 1, "{time}: {told}");
    }
    // Each is opened, and nothing else is asked for.
    assert!(server.asked().len() <= before + 4);
    let output = run(folder.path(), &[&["render", &url, "--time", "step:2"], &camera[..]].concat());
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success() && told.contains("127.0.0.1"), "{told}");
    // A server that answers again has the last word.
    server.replace(other, Some("\"second\""), None);
    server.answer(|_| Fault::Sound);
    assert_eq!(picture(&url, "step:1").0, picture("other.df", "step:1").0);
}

#[test]
fn what_a_link_is_measured_to_do_agrees_with_what_it_is() {
    const RATE: f64 = 50e6 / 8.0;
    const LATENCY: f64 = 0.02;
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("sound.df"), sound()).unwrap();
    // With this seed an answer stalls only after a hundred others.
    let link = ["--rate", "50Mbit", "--latency", "20ms", "--faults", "--minutes", "0.02", "--seed", "4"];
    let flight = ["--size", "160x120", "--error-px", "0.4", "--duration", "0.3", "--velocity", "0.5", "--json", "-"];
    let output = run(folder.path(), &[&["bench", "remote", "sound.df"][..], &link[..], &flight[..]].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let outcomes: Value = serde_json::from_slice(&output.stdout).unwrap();
    let outcome = &outcomes[0];
    let number = |at: &str| outcome.pointer(at).and_then(Value::as_f64).unwrap_or_else(|| panic!("{at}: {outcome:#}"));
    // A connection and a request; what was sent takes as long as the link takes.
    assert_eq!(number("/info/requests"), 2.0, "{outcome:#}");
    for step in ["info", "first_picture", "converged"] {
        let [seconds, bytes] = ["seconds", "bytes"].map(|what| number(&format!("/{step}/{what}")));
        assert!(seconds >= 2.0 * LATENCY && seconds >= 0.9 * bytes / RATE, "{step}: {outcome:#}");
    }
    for what in ["seconds", "requests", "bytes"] {
        let [first, all] = ["first_picture", "converged"].map(|step| number(&format!("/{step}/{what}")));
        assert!(first <= all, "{what}: {outcome:#}");
    }
    let (read, wanted) = (number("/converged/bytes"), number("/wanted_bytes"));
    let most = number("/bytes") + ENDS.iter().sum::<u64>() as f64 + 1000.0 * number("/converged/requests");
    assert!(wanted > 0.0 && read >= wanted && read <= most, "{outcome:#}");
    assert_eq!(outcome["is_same"], true, "{outcome:#}");
    assert!(number("/disk/frames") > 0.0 && number("/link/frames") > 0.0 && number("/link_passed/bytes") > 0.0);
    assert!(number("/faults/stops") > 0.0 && number("/faults/passed/spoilt") > 0.0, "{outcome:#}");
    assert_eq!(number("/faults/different"), 0.0, "{outcome:#}");
    assert!(cfg!(not(target_os = "linux")) || outcome["faults"]["resident_bytes"].as_array().unwrap().len() == 5);
    assert!(!folder.path().join("deepfield/pages").exists(), "pages are left in the cache");
}
