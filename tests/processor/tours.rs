//! Tours from the command line: the shipped one looks as it should, recordings are the same files however often they are
//! interrupted, and every frame can be made again from its scene.

use crate::stream::disk::offset_of;
use crate::support::{in_repository, program, write_box};
use deepfield::annotate::overlay::read_png;
use deepfield::build::{BuildOptions, build};
use deepfield::heights::build::{HeightBuildOptions, HeightOrigin, build_heights};
use deepfield::heights::model::HeightField;
use deepfield::hierarchy::OctreeOptions;
use deepfield::store::{PageFile, PageId};
use deepfield::synth::{dataset, merger::Merger};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

fn tour(arguments: &[&str]) -> Command {
    let mut command = program();
    command.arg("tour").args(arguments).stdin(Stdio::null());
    command
}

fn run(mut command: Command) -> Output {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

/// Runs a command that fails, and says with which code and text.
fn failure(mut command: Command) -> (Option<i32>, String) {
    let output = command.output().unwrap();
    assert!(!output.status.success(), "{command:?}");
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

/// All files below a folder with their contents.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => files.extend(self::files(&path)),
            false => drop(files.insert(path.clone(), std::fs::read(&path).unwrap())),
        }
    }
    files
}

/// The same, by their names in the folder.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    files(folder).into_iter().map(|(path, bytes)| (path.strip_prefix(folder).unwrap().to_owned(), bytes)).collect()
}

/// A tour in which everything happens: a flight, a cut, cross-fades, words, a picture laid over, changing numbers. Small and coarse, for it is
/// drawn many times.
const EVERYTHING: &str = r#"(
    version: 1,
    size: (48, 27),
    rate: 4.0,
    keyframes: [
        (mode: "density-squared", error_px: 3.0, caption: "Words", images: [(path: "logo.png", height: 0.3)]),
        (after: 1.0, orbit: 40.0, settings: {"presence": 2000.0}),
        (after: 1.0, move: flight, around: (what: ball((58320.0, 70000.0, 54720.0), 1400.0)), caption: ""),
        (after: 0.25, mode: "volume", fade: 0.5, pause: 0.5),
        (after: 0.5, orbit: -30.0, settings: {"opacity": 3.0}, images: []),
        (move: cut, after: 0.5, fade: 0.5, mode: "isosurface", around: (what: data), pause: 0.75),
    ],
)"#;

/// A folder with a page file of few particles, and where that is.
fn few() -> (tempfile::TempDir, String) {
    let folder = tempfile::tempdir().unwrap();
    let data = write_box(folder.path()).display().to_string();
    (folder, data)
}

/// The same with that tour and its picture.
fn everything() -> (tempfile::TempDir, String, PathBuf) {
    let (folder, data) = few();
    let path = folder.path().join("everything.ron");
    std::fs::write(&path, EVERYTHING).unwrap();
    std::fs::copy(in_repository("tests/golden/points.png"), folder.path().join("logo.png")).unwrap();
    (folder, data, path)
}

fn demo() -> String {
    in_repository("assets/demo/lcdm64_z0.hdf5").display().to_string()
}

/// A tour past bright and dark places, and over a cut, for an eye that adapts; stars glow. Small and coarse as well.
const ADAPTING: &str = r#"(
    version: 1,
    size: (32, 18),
    rate: 4.0,
    keyframes: [
        (
            mode: "density-squared",
            error_px: 3.0,
            exposure: adaptive(dark: 0.3),
            bloom: (strength: 0.5, threshold: 0.2),
        ),
        (after: 1.0, around: (what: ball((58320.0, 70000.0, 54720.0), 1400.0))),
        (after: 0.5, move: cut, around: (what: data, distance: 4.0)),
        (after: 1.0, orbit: 30.0, bloom: (strength: 1.0)),
    ],
)"#;

#[test]
fn an_eye_that_adapts_sees_the_same_in_parts() {
    let (folder, data) = few();
    let path = folder.path().join("adapting.ron");
    std::fs::write(&path, ADAPTING).unwrap();
    let path = path.display().to_string();
    let at = |name: &str| folder.path().join(name);
    let record = |name: &str, part: &[&str]| {
        let mut command = tour(&[&path, &data, "--record", &at(name).display().to_string()]);
        command.args(part);
        run(command);
        contents(&at(name))
    };
    let whole = record("whole", &[]);
    assert_eq!(whole.len(), 2 * 11 + 2);
    // Begun, and gone on with later; and the last part alone.
    record("resumed", &["--end", "1"]);
    assert!(record("resumed", &[]) == whole);
    let last = record("last", &["--start", "1.75"]);
    let frames = last.iter().filter(|(name, _)| name.extension().is_some_and(|end| end == "png" || end == "ron"));
    let frames: Vec<_> = frames.filter(|(name, _)| name.to_string_lossy().contains("frame-")).collect();
    assert_eq!(frames.len(), 2 * 4);
    for (name, bytes) in frames {
        assert!(*bytes == whole[name], "{} differs", name.display());
    }
    // A frame's scene has the numbers that its eye was adapted to, and its bloom.
    let mut render = program();
    render.arg("render").arg(at("whole").join("scenes/frame-00005.scene.ron"));
    render.args(["--backend", "cpu", "-o"]).arg(at("again.png"));
    run(render);
    assert!(read_png(&at("again.png")).unwrap() == read_png(&at("whole").join("frame-00005.png")).unwrap());
    // Without adaptation and bloom it is another picture.
    let plain = at("plain.png");
    let mut command = tour(&[&path, &data, "--exposure", "auto", "--bloom", "0", "--frame", "5"]);
    command.arg(&plain);
    run(command);
    assert!(read_png(&plain).unwrap() != read_png(&at("whole").join("frame-00005.png")).unwrap());
}

#[test]
fn recordings_are_the_same_files_however_they_are_interrupted() {
    let (folder, data, path) = everything();
    let path = path.display().to_string();
    let at = |name: &str| folder.path().join(name);
    let record = |name: &str| tour(&[&path, &data, "--format", "png,exr", "--record", &at(name).display().to_string()]);
    run(record("once"));
    let once = contents(&at("once"));
    assert_eq!(once.len(), 3 * 19 + 2, "19 frames as PNG, EXR and scene, a manifest and a journal");

    // Killed 10 times, at moments that have nothing to do with the frames.
    let mut seed = 7u64;
    for _ in 0..10 {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let mut child = record("interrupted").stderr(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(20 + (seed >> 33) % 400));
        child.kill().unwrap();
        child.wait().unwrap();
    }
    // What a killed one was about to write, whenever that was.
    for beginning in [".deepfield-frame", "scenes/.deepfield-scene"] {
        std::fs::write(at("interrupted").join(beginning), b"half").unwrap();
    }
    run(record("interrupted"));
    let interrupted = contents(&at("interrupted"));
    assert_eq!(once.keys().collect::<Vec<_>>(), interrupted.keys().collect::<Vec<_>>());
    for (name, bytes) in &once {
        assert!(*bytes == interrupted[name], "{} differs", name.display());
    }

    // Damaged and missing frames are drawn again, the others are not.
    std::fs::write(at("interrupted").join("frame-00003.png"), b"damaged").unwrap();
    std::fs::remove_file(at("interrupted").join("scenes/frame-00005.scene.ron")).unwrap();
    let said = String::from_utf8_lossy(&run(record("interrupted")).stderr).into_owned();
    assert!(said.contains("2 frames drawn") && said.contains("17 were finished before"), "{said}");
    assert!(contents(&at("interrupted")) == once);

    // Something else does not go into the same folder, and what differs is named.
    let mut other = record("once");
    other.args(["--fps", "2", "--name", "f%d"]);
    let (code, said) = failure(other);
    assert!(code == Some(1) && said.contains("--fps was 4, now 2; --name was frame-%05d, now f%d"), "{said}");
    std::fs::write(folder.path().join("everything.ron"), EVERYTHING.replace("orbit: 40.0", "orbit: 41.0")).unwrap();
    let (_, said) = failure(record("once"));
    assert!(said.contains("another recording: the tour was checksum"), "{said}");
    std::fs::write(folder.path().join("everything.ron"), EVERYTHING).unwrap();
    // Another logo of the same name is another tour, too.
    std::fs::copy(at("once").join("frame-00000.png"), at("logo.png")).unwrap();
    let (_, said) = failure(record("once"));
    assert!(said.contains("another recording: the tour was checksum"), "{said}");
    std::fs::copy(in_repository("tests/golden/points.png"), at("logo.png")).unwrap();

    // Any frame is made again from its scene: in a pause, within cross-fades, with words and pictures.
    for frame in ["frame-00000", "frame-00010", "frame-00016", "frame-00018"] {
        let scene = at("once").join("scenes").join(format!("{frame}.scene.ron"));
        let again = at("again.png");
        let mut render = program();
        render.arg("render").arg(&scene).args(["--backend", "cpu", "-o"]).arg(&again);
        run(render);
        let (new, old) = (read_png(&again).unwrap(), read_png(&at("once").join(format!("{frame}.png"))).unwrap());
        assert!(new == old, "{frame} differs from what its scene makes");
    }

    // A part has the numbers and the pictures of the whole, and one frame is that frame.
    let mut part =
        tour(&[&path, &data, "--no-scenes", "--start", "1", "--end", "1.5", "--offset", "100", "--name", "p%d"]);
    part.arg("--record").arg(at("part"));
    run(part);
    let part = contents(&at("part"));
    assert_eq!(part.len(), 2 + 2);
    for i in 4..6 {
        assert!(part[Path::new(&format!("p{}.png", 100 + i))] == once[Path::new(&format!("frame-{i:05}.png"))], "{i}");
    }
    let one = at("one.png").display().to_string();
    run(tour(&[&path, &data, "--frame", "9", &one]));
    assert!(read_png(Path::new(&one)).unwrap() == read_png(&at("once").join("frame-00009.png")).unwrap());

    // Begun anew, a folder has nothing left of another recording, and still has other parts of the same.
    let anew = |part: [&str; 2]| {
        let mut anew = tour(&[&path, &data, "--no-scenes", "--fps", "1", "--restart"]);
        anew.args(part).arg("--record").arg(at("part"));
        run(anew);
        contents(&at("part")).into_keys().collect::<Vec<_>>()
    };
    let own = ["frame-00000.png", "frame-00001.png", "recording.journal", "recording.ron"].map(PathBuf::from);
    assert_eq!(anew(["--end", "1.5"]), own);
    assert_eq!(anew(["--start", "3.5"])[..2], own[..2]);
}

/// Half a turn of which no frame fits into a mebibyte.
const WIDE: &str = r#"(
    version: 1,
    size: (240, 160),
    rate: 4.0,
    keyframes: [(mode: "sorted-splats", error_px: 0.05), (after: 1.0, orbit: 40.0)],
)"#;

/// Frames that need more memory than there is are coarser, the same in whichever part of the tour they are drawn, and told once.
#[test]
fn frames_that_do_not_fit_into_memory_are_the_same_in_parts() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(at("wide.ron"), WIDE).unwrap();
    // Many small pages.
    let octree = OctreeOptions { leaf_capacity: 3000, ..OctreeOptions::default() };
    let options = BuildOptions { octree, page_bytes: 32 << 10, ..BuildOptions::default() };
    build(dataset(&Merger::new(3, 150_000)), &options, Path::new(&at("merger.df")), &()).unwrap();
    let of_tour = |arguments: &[&str]| {
        let mut command = tour(&[&at("wide.ron"), &at("merger.df")]);
        command.args(arguments);
        command
    };
    let said = |output: Output| String::from_utf8(output.stderr).unwrap();
    let told = said(run(of_tour(&["--record", &at("whole"), "--memory", "1MiB"])));
    let messages: Vec<&str> = told.lines().filter(|line| line.contains("is drawn coarser")).collect();
    assert!(matches!(&messages[..], [only] if only.contains("--memory") && only.contains("merger.df")), "{told}");
    let whole = contents(Path::new(&at("whole")));
    assert_eq!(whole.len(), 2 * 5 + 2);
    // One frame by itself, on one thread.
    run(of_tour(&["--frame", "3", &at("still.png"), "--memory", "1MiB", "--threads", "1"]));
    let still = std::fs::read(at("still.png")).unwrap();
    assert!(still == whole[Path::new("frame-00003.png")]);
    // A recording goes on in the memory that it began with, and in no other.
    run(of_tour(&["--record", &at("parts"), "--memory", "1MiB", "--end", "0.5"]));
    let (_, refused) = failure(of_tour(&["--record", &at("parts"), "--memory", "2MiB"]));
    assert!(refused.contains("--memory") && refused.contains("was 1048576 bytes, now 2097152 bytes"), "{refused}");
    run(of_tour(&["--record", &at("parts")]));
    assert!(contents(Path::new(&at("parts"))) == whole);
    // With enough of it nothing is told, and frames are finer.
    let silent = said(run(of_tour(&["--frame", "3", &at("fine.png"), "--memory", "1GiB"])));
    assert!(!silent.contains("coarser"), "{silent}");
    assert!(read_png(Path::new(&at("fine.png"))).unwrap() != read_png(Path::new(&at("still.png"))).unwrap());
    // What cannot be read is no want of memory, in a frame that is coarser either.
    let mut bytes = std::fs::read(at("merger.df")).unwrap();
    let pages = PageFile::open(Path::new(&at("merger.df"))).unwrap().page_count();
    for page in (1..pages).step_by(4) {
        let start = offset_of(&bytes, PageId(page)) as usize;
        bytes[start + 500] ^= 1;
    }
    std::fs::write(at("merger.df"), bytes).unwrap();
    let (_, told) = failure(of_tour(&["--frame", "3", &at("damaged.png"), "--memory", "1MiB"]));
    let last = told.lines().last().unwrap();
    assert!(last.ends_with("merger.df: pages that the frame needs cannot be read"), "{told}");
}

/// A quarter of a turn about heights of which no frame fits into two mebibytes.
const ROUGH: &str = r#"(
    version: 1,
    size: (240, 160),
    rate: 4.0,
    keyframes: [(mode: "surface", error_px: 0.05), (after: 1.0, orbit: 90.0)],
)"#;

/// As of particles, and what draws the scene of such a frame in as much memory draws that frame.
#[test]
fn frames_of_heights_that_do_not_fit_into_memory_are_the_same_in_parts() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(at("rough.ron"), ROUGH).unwrap();
    let (columns, rows) = (701_u64, 521_u64);
    let height = |index: u64| {
        let [x, y] = [index % columns, index / columns].map(|at| at as f64);
        20.0 * ((0.02 * x).sin() + (0.03 * y).cos()) + 4.0 * (0.7 * x).sin() * (0.9 * y).cos()
    };
    let field = HeightField::of(columns, rows, (0..columns * rows).map(height).collect());
    let path = at("rough.df");
    build_heights(&field, &HeightOrigin::default(), &HeightBuildOptions::default(), Path::new(&path), &()).unwrap();
    let of_tour = |arguments: &[&str]| {
        let mut command = tour(&[&at("rough.ron"), &path]);
        command.args(arguments);
        command
    };
    let said = |output: Output| String::from_utf8(output.stderr).unwrap();
    let told = said(run(of_tour(&["--record", &at("whole"), "--memory", "2MiB"])));
    let messages: Vec<&str> = told.lines().filter(|line| line.contains("is drawn coarser")).collect();
    assert!(matches!(&messages[..], [only] if only.contains("--memory") && only.contains("rough.df")), "{told}");
    let whole = contents(Path::new(&at("whole")));
    assert_eq!(whole.len(), 2 * 5 + 2);
    run(of_tour(&["--frame", "3", &at("still.png"), "--memory", "2MiB", "--threads", "1"]));
    let still = std::fs::read(at("still.png")).unwrap();
    assert!(still == whole[Path::new("frame-00003.png")]);
    let scene = Path::new(&at("whole")).join("scenes/frame-00003.scene.ron");
    let mut render = program();
    render.arg("render").arg(scene).args(["--backend", "cpu", "--memory", "2MiB", "-o"]).arg(at("again.png"));
    assert!(said(run(render)).contains("is drawn coarser"));
    assert!(read_png(Path::new(&at("again.png"))).unwrap() == read_png(Path::new(&at("still.png"))).unwrap());
    // A recording goes on in the memory that its frames are coarser for, and in no other: not in what is usual, either.
    run(of_tour(&["--record", &at("parts"), "--memory", "2MiB", "--end", "0.5"]));
    let (_, refused) = failure(of_tour(&["--record", &at("parts"), "--memory", "1GiB"]));
    assert!(refused.contains("--memory") && refused.contains("was 2097152 bytes, now 1073741824 bytes"), "{refused}");
    run(of_tour(&["--record", &at("parts")]));
    assert!(contents(Path::new(&at("parts"))) == whole);
    // What is usual is enough: nothing is told or noted, and frames are finer.
    let silent = said(run(of_tour(&["--record", &at("fine"), "--end", "0.25"])));
    assert!(!silent.contains("coarser"), "{silent}");
    let fine = contents(Path::new(&at("fine")));
    assert!(fine[Path::new("frame-00000.png")] != whole[Path::new("frame-00000.png")]);
    let is_noted = |files: &BTreeMap<PathBuf, Vec<u8>>| {
        String::from_utf8_lossy(&files[Path::new("recording.ron")]).contains("memory:")
    };
    assert!(is_noted(&whole) && !is_noted(&fine));
}

/// What keeps to a time that it is given has not converged, and is a frame.
#[test]
fn frames_of_a_volume_may_keep_to_a_time() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let head = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 24 24 24\nencoding: raw\n\n";
    let samples: Vec<u8> = (0..24_usize.pow(3)).map(|i| (10 * (i % 24)) as u8).collect();
    std::fs::write(at("ramp.nrrd"), [head.as_bytes(), &samples].concat()).unwrap();
    let text = r#"(
        version: 1,
        size: (48, 32),
        keyframes: [(mode: "volume", budget: {"frame-ms": 20.0}), (after: 1.0, orbit: 40.0)],
    )"#;
    std::fs::write(at("timed.ron"), text).unwrap();
    run(tour(&[&at("timed.ron"), &at("ramp.nrrd"), "--frame", "7", &at("still.png")]));
    let still = read_png(Path::new(&at("still.png"))).unwrap();
    assert!((still.width, still.height) == (48, 32) && still.rgba.iter().any(|pixel| pixel[..3] != still.rgba[0][..3]));
}

/// Compares a frame with its golden one.
fn check_golden(name: &str, out: &Path) {
    let golden = in_repository("tests/golden/tour").join(name);
    if std::env::var_os("DEEPFIELD_BLESS").is_some() {
        std::fs::copy(out, &golden).unwrap();
    }
    let (found, golden) = (read_png(out).unwrap(), read_png(&golden).unwrap());
    let pairs = found.rgba.as_flattened().iter().zip(golden.rgba.as_flattened());
    let sum: u64 = pairs.map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    let difference = sum as f64 / (3 * found.rgba.len()) as f64;
    assert!(found.rgba.len() == golden.rgba.len() && difference < 0.15, "{name} differs by {difference:.3}/255");
}

#[test]
fn the_shipped_tour_is_its_golden_frames() {
    let path = in_repository("assets/tours/demo.ron").display().to_string();
    let folder = tempfile::tempdir().unwrap();
    // One moment of each part.
    for second in [3, 15, 22, 33, 41, 48, 54, 60] {
        let name = format!("{second}.png");
        let out = folder.path().join(&name);
        let number = second.to_string();
        run(tour(&[&path, "--fps", "1", "--size", "192x108", "--frame", &number, &out.display().to_string()]));
        check_golden(&name, &out);
    }
}

#[test]
fn the_shipped_tour_has_a_dome_version() {
    let path = in_repository("assets/tours/demo-dome.ron").display().to_string();
    let folder = tempfile::tempdir().unwrap();
    // Each mode, and both flights: with a cut and without.
    for second in [22, 41, 48, 54] {
        let name = format!("dome-{second}.png");
        let out = folder.path().join(&name);
        let (number, to) = (second.to_string(), out.display().to_string());
        run(tour(&[&path, "--fps", "1", "--size", "160x160", "--frame", &number, &to]));
        check_golden(&name, &out);
    }
}

#[test]
fn the_shipped_tour_has_several_modes_and_is_comfortable() {
    for name in ["assets/tours/demo.ron", "assets/tours/demo-dome.ron"] {
        let path = in_repository(name);
        let tour_file = deepfield::tour::TourFile::read(&path).unwrap();
        let modes: std::collections::BTreeSet<_> =
            tour_file.keyframes.iter().filter_map(|k| k.look.mode.map(|mode| mode.name)).collect();
        assert!(tour_file.keyframes.len() >= 10 && modes.len() >= 3);
        assert!(tour_file.keyframes.iter().filter(|keyframe| keyframe.caption.is_some()).count() >= 5);
        let output = run(tour(&[&path.display().to_string(), "--check"]));
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(text.contains("nothing is too fast"), "{text}");
    }
}

#[test]
fn any_data_has_a_tour_and_a_video() {
    let (_beside, data) = few();
    let folder = tempfile::tempdir().unwrap();
    let video = folder.path().join("around.avi");
    let name = video.display().to_string();
    let size = ["--size", "64x36", "--error-px", "3"];
    run(tour(&[&["--around", &data, "--seconds", "2", "--fps", "5", "--video", &name][..], &size].concat()));
    let bytes = std::fs::read(&video).unwrap();
    assert!(bytes.starts_with(b"RIFF") && bytes.windows(4).filter(|word| word == b"00dc").count() >= 20);
    let files = || std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(files(), 1, "only the video stays");

    // Of one that was interrupted frames stay, and another of its name begins anew when that is said.
    let around = |fps: &str, more: &[&str]| {
        tour(&[&["--around", &data, "--seconds", "2", "--fps", fps][..], &size, more].concat())
    };
    run(around("1", &["--record", &format!("{name}.frames")]));
    let (code, said) = failure(around("2", &["--video", &name]));
    assert!(code == Some(1) && said.contains("--fps was 1, now 2") && said.contains("--restart"), "{said}");
    run(around("2", &["--video", &name, "--restart"]));
    assert_eq!(files(), 1);
}

#[test]
fn frames_are_not_written_over_what_they_are_of() {
    let folder = tempfile::tempdir().unwrap();
    let slices = folder.path().join("frames");
    std::fs::create_dir(&slices).unwrap();
    for name in ["frame-00000.png", "frame-00001.png"] {
        std::fs::copy(in_repository("tests/golden/points.png"), slices.join(name)).unwrap();
    }
    let before = contents(&slices);
    let name = slices.display().to_string();
    for (data, over) in [(name.clone(), "frame-00000.png"), (format!("{name}/frame-00001.png"), "frame-00001.png")] {
        let (_, said) = failure(tour(&["--around", &data, "--record", &name, "--size", "32x24", "--fps", "1"]));
        let expected = format!("{over}: cannot be written: found a file that is read, expected another folder");
        assert!(said.contains(&expected), "{said}");
        assert_eq!(contents(&slices), before);
    }
}

#[test]
fn mistakes_are_told_in_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t.ron");
    let text = path.display().to_string();
    std::fs::write(&path, "(version: 1, keyframes: [\n (), (pase: 1.0)])").unwrap();
    let (code, said) = failure(tour(&[&text, &demo(), "--check"]));
    assert!(
        code == Some(1) && said.contains("t.ron:2:") && said.contains("pase") && said.lines().count() == 1,
        "{said}"
    );
    std::fs::write(&path, "(version: 1, keyframes: [()])").unwrap();
    let (code, said) = failure(tour(&[&text, "--check"]));
    assert!(code == Some(1) && said.contains("names no dataset"), "{said}");
    let (code, said) = failure(tour(&[&demo(), "--check"]));
    assert!(code == Some(1) && said.contains("found no text, expected RON; --around "), "{said}");
    assert_eq!(failure(tour(&[&text, &demo()])).0, Some(2), "nothing to do");
    assert_eq!(failure(tour(&["--record", "x"])).0, Some(2), "no tour");
    let (code, said) = failure(tour(&[&text, &demo(), "--video", "a.gif"]));
    assert!(code == Some(1) && said.contains("a.gif: expected a name that ends in .avi"), "{said}");
    let (code, said) = failure(tour(&[&text, &demo(), "--frame", "7", "a.png"]));
    assert!(code == Some(1) && said.contains("expected a number from 0 to 0"), "{said}");
    // Before anything is drawn: the end of a long recording is no place to be told.
    for (wrong, told) in [("attribute: named(\"beauty\")", "beauty"), ("images: [(path: \"none.png\")]", "none.png")] {
        std::fs::write(&path, format!("(version: 1, keyframes: [(), (after: 9.0, {wrong})])")).unwrap();
        for what in [&["--check"][..], &["--frame", "0", "a.png"]] {
            let (code, said) = failure(tour(&[&[&text[..], &demo()][..], what].concat()));
            assert!(code == Some(1) && said.contains("t.ron: keyframe 2: ") && said.contains(told), "{said}");
        }
    }
    let mut view = program();
    view.args(["view", &demo(), "--tour", &text]).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
    let (code, said) = failure(view);
    assert!(code == Some(1) && said.contains("deepfield tour makes pictures and videos of it"), "{said}");
    let video = folder.path().join("a.avi").display().to_string();
    let (code, said) = failure(tour(&["--around", &demo(), "--video", &video, "--format", "exr"]));
    assert!(code == Some(1) && said.contains("add png to --format"), "{said}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing was recorded");
}
