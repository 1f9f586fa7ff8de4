//! Images and volumes by the program: from a file to points, to pictures, and back.

use crate::support::{run, text};
use std::path::Path;

/// A volume of three blobs, in NRRD with a spacing.
fn blobs(folder: &Path) -> Vec<u8> {
    let centers = [([10.0, 12.0, 9.0], 4.0), ([22.0, 20.0, 14.0], 5.0), ([16.0, 8.0, 18.0], 3.0)];
    let value = |i: usize| {
        let at = [i % 32, i / 32 % 32, i / 1024].map(|x| x as f64);
        let blob = |(center, radius): &([f64; 3], f64)| {
            let away: f64 = at.iter().zip(center).map(|(a, b)| (a - b) * (a - b)).sum();
            220.0 * (-away / (2.0 * radius * radius)).exp()
        };
        centers.iter().map(blob).sum::<f64>().min(255.0) as u8
    };
    let samples: Vec<u8> = (0..32 * 32 * 24).map(value).collect();
    let head = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 32 32 24\nencoding: raw\nspacings: 0.5 0.5 1\n\n";
    std::fs::write(folder.join("blobs.nrrd"), [head.as_bytes(), &samples].concat()).unwrap();
    samples
}

fn number(json: &str, path: &[&str]) -> f64 {
    let value: serde_json::Value = serde_json::from_str(json).unwrap();
    path.iter().fold(&value, |value, key| &value[*key]).as_f64().unwrap_or_else(|| panic!("{path:?} in {json}"))
}

#[test]
fn a_volume_is_built_told_drawn_and_given_back() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let samples = blobs(folder);
    text(folder, &["build", "blobs.nrrd", "-o", "blobs.df"]);
    text(folder, &["verify", "blobs.df"]);
    let told = text(folder, &["info", "blobs.df", "--json"]);
    assert!(told.contains("\"wavelet\"") && told.contains("wavelet_levels"), "{told}");
    text(folder, &["reconstruct", "blobs.df", "-o", "back.nrrd", "--exact"]);
    let back = std::fs::read(folder.join("back.nrrd")).unwrap();
    assert!(back.ends_with(&samples), "the same samples");
    let size = ["--size", "120x90"];
    for mode in ["volume", "isosurface", "volume-isosurface", "xray", "slice"] {
        let draw = |data: &str, more: &[&str]| {
            let out = format!("{mode}.png");
            let words = [&["render", data, "-o", &out, "--mode", mode, "--json", "-"], &size[..], more].concat();
            (text(folder, &words), crate::support::golden::picture_at(&folder.join(out)))
        };
        let (_, exact) = draw("blobs.nrrd", &[]);
        let lit = exact.rgba.iter().filter(|pixel| pixel[..3].iter().any(|byte| *byte > 24)).count();
        assert!(lit > 300, "{mode}: {lit} pixels");
        // From the most points down, each picture is further from the exact one.
        let mut before = -1e-9;
        for points in ["20000", "2000", "300"] {
            let (told, picture) = draw("blobs.df", &["--splats", points]);
            assert!(number(&told, &["points"]) <= points.parse().unwrap());
            let off = crate::support::golden::difference(&picture, &exact);
            assert!(off >= before && off < 20.0, "{mode}, {points} points: {off} after {before}");
            before = off;
        }
        let (told, near) = draw("blobs.df", &["--error-value", "1.5"]);
        if mode == "xray" {
            assert!(number(&told, &["error_value", "max"]) <= 1.5, "{told}");
        } else {
            assert!(number(&told, &["points"]) > 0.0);
        }
        assert!(crate::support::golden::difference(&near, &exact) < 1.0, "{mode}");
    }
    // What draws particles alone draws the source's voxels.
    let voxels = ["render", "blobs.nrrd", "-o", "x.png", "--mode", "sorted-splats", "--size", "80x60", "--json", "-"];
    let told = text(folder, &voxels);
    assert!(number(&told, &["particles_drawn"]) > 1000.0, "{told}");
    // Of what was built the points are drawn.
    for mode in ["sorted-splats", "primitives"] {
        let words =
            [&["render", "blobs.df", "-o", "x.png", "--mode", mode, "--splats", "2000", "--json", "-"], &size[..]];
        let told = text(folder, &words.concat());
        assert_eq!((number(&told, &["particles_drawn"]), number(&told, &["budget"])), (0.0, 2000.0), "{told}");
        let [points, seen] = [&["points"][..], &["grid", "particles"]].map(|path| number(&told, path));
        assert!(points <= 2000.0 && seen > 200.0 && seen < points, "{told}");
        let picture = crate::support::golden::picture_at(&folder.join("x.png"));
        let lit = picture.rgba.iter().filter(|pixel| pixel[..3].iter().any(|byte| *byte > 24)).count();
        assert!(lit > 300, "{mode}: {lit} pixels");
    }
    let refused = run(folder, &["render", "blobs.df", "-o", "x.png", "--mode", "image"]);
    let why = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!((refused.status.code(), why.lines().count()), (Some(1), 1), "{why}");
    assert!(why.contains("blobs.df") && why.contains("expected one of"), "{why}");
}

#[test]
fn a_slice_shows_what_a_look_through_the_volume_leaves_out() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // Waves that are air beside the ball in their middle.
    let value = |i: usize| {
        let [x, y, z] = [i % 48, i / 48 % 48, i / 2304].map(|x| x as f64);
        let away = (x - 24.0).hypot(y - 24.0).hypot(z - 12.0);
        if away < 6.0 { 220.0 } else { 20.0 + 12.0 * (x / 3.0).sin() * (y / 4.0 + z / 5.0).cos() }
    };
    let samples: Vec<u8> = (0..48 * 48 * 24).map(|i| value(i) as u8).collect();
    let head = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 48 48 24\nencoding: raw\nspacings: 1 1 2\n\n";
    std::fs::write(folder.join("waves.nrrd"), [head.as_bytes(), &samples].concat()).unwrap();
    text(folder, &["build", "waves.nrrd", "-o", "waves.df"]);
    for axis in ["axis=x", "axis=y", "axis=z", "normal=[1.0,2.0,3.0]"] {
        let draw = |more: &[&str]| {
            let words = ["render", "waves.df", "-o", "slice.png", "--mode", "slice", "--set", axis, "--size", "96x96"];
            text(folder, &[&words, more].concat());
            crate::support::golden::picture_at(&folder.join("slice.png"))
        };
        let (near, exact) = (draw(&[]), draw(&["--exact"]));
        let off = crate::support::golden::difference(&near, &exact);
        let pairs = near.rgba.as_flattened().iter().zip(exact.rgba.as_flattened());
        let most = pairs.map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(off < 1.5 && most < 16, "{axis}: {off} in the mean, {most} at most");
        // From in front it fills the picture.
        let lit = exact.rgba.iter().filter(|pixel| pixel[0] > 3).count();
        assert!(lit > 96 * 96 / 3, "{axis}: {lit} pixels");
    }
}

#[test]
fn tours_domes_and_pairs_of_pictures_show_volumes() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    blobs(folder);
    text(
        folder,
        &["tour", "--around", "blobs.nrrd", "--seconds", "0.1", "--fps", "20", "--size", "96x64", "--record", "frames"],
    );
    let frame = |i: usize| crate::support::golden::picture_at(&folder.join(format!("frames/frame-{i:05}.png")));
    let lit = |image: &deepfield::color::Image| {
        image.rgba.iter().filter(|pixel| pixel[..3].iter().any(|byte| *byte > 24)).count()
    };
    assert!(lit(&frame(0)) > 100 && frame(0).rgba != frame(1).rgba);
    // Any frame again, from its scene.
    text(folder, &["render", "frames/scenes/frame-00001.scene.ron", "-o", "again.png"]);
    assert!(crate::support::golden::picture_at(&folder.join("again.png")).rgba == frame(1).rgba);
    let pair = ["--stereo", "off-axis", "--eye-separation", "1", "--zero-parallax", "40"];
    for (mode, more, size) in [("volume", &["--projection", "dome"][..], [64, 64]), ("xray", &pair[..], [128, 64])] {
        let words =
            ["render", "blobs.nrrd", "-o", "p.png", "--mode", mode, "--attribute", "gradient", "--size", "64x64"];
        text(folder, &[&words[..], more].concat());
        let picture = crate::support::golden::picture_at(&folder.join("p.png"));
        assert_eq!([picture.width, picture.height], size);
        assert!(lit(&picture) > 300, "{mode}: {}", lit(&picture));
    }
}

/// The one line that a command that fails says.
fn refused(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    let why = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!((output.status.success(), why.lines().count()), (false, 1), "{arguments:?}: {why}");
    why
}

#[test]
fn parts_are_given_back_as_they_are_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let samples = blobs(folder);
    text(folder, &["build", "blobs.nrrd", "-o", "blobs.df"]);
    // A layer as a picture; standard output has the JSON alone.
    let layer = ["reconstruct", "blobs.df", "-o", "layer.png", "--exact", "--region", "0:32,0:32,12:13", "--json", "-"];
    let told = text(folder, &layer);
    assert_eq!((number(&told, &["points"]), number(&told, &["leaves"])), (1024.0, 1024.0));
    assert!(!folder.join("-").exists());
    let picture = crate::support::golden::picture_at(&folder.join("layer.png"));
    assert_eq!([picture.width, picture.height], [32, 32]);
    // A grey picture's bytes lie at the beginning.
    assert!(picture.rgba.as_flattened()[..1024] == samples[12 * 1024..13 * 1024]);
    let told = text(folder, &["reconstruct", "blobs.df", "-o", "few.npy", "--points", "2e3"]);
    assert!(told.contains(" points, "), "{told}");
    // Errors of small values are told in digits that these have.
    let head = b"NRRD0004\ntype: float\ndimension: 3\nsizes: 8 8 8\nencoding: raw\nendian: little\n\n";
    let small = (0..512_u32).flat_map(|k| (1e-9 * (k * 37 % 101) as f32).to_le_bytes());
    std::fs::write(folder.join("small.nrrd"), head.iter().copied().chain(small).collect::<Vec<u8>>()).unwrap();
    let told = text(folder, &["reconstruct", "small.nrrd", "-o", "x.nrrd", "--points", "9"]);
    assert!(told.contains("e-8 (rms), ") && told.contains("e-8 at most"), "{told}");
    let say = |words: &[&str]| refused(folder, &[&["reconstruct"][..], words].concat());
    let why = say(&["blobs.df", "-o", "x.npy", "--region", "0:1000,0:10"]);
    assert!(why.contains("--region: found 0:1000,0:10, expected a part of 32 x 32 x 24 of uint8"), "{why}");
    // Levels: from the root down to the samples.
    let why = say(&["blobs.df", "-o", "x.npy", "--level", "6"]);
    assert!(why.contains("blobs.df: --level: found 6, expected 0 (the samples) to 5 (a single node)"), "{why}");
    let both = run(folder, &["reconstruct", "blobs.df", "-o", "x.npy", "--level", "2", "--points", "9"]);
    assert_eq!(both.status.code(), Some(2), "{}", String::from_utf8_lossy(&both.stderr));
    let of_level = |data: &str, level: &str| {
        let told = text(folder, &["reconstruct", data, "-o", "level.nrrd", "--level", level, "--json", "-"]);
        (number(&told, &["points"]), number(&told, &["error_value", "rms"]))
    };
    let levels = ["5", "4", "3", "2", "1", "0"].map(|level| of_level("blobs.df", level));
    assert!(levels.windows(2).all(|pair| pair[0].0 <= pair[1].0 && pair[0].1 >= pair[1].1), "{levels:?}");
    assert!(levels[0].0 <= 3.0 && levels[5].1 == 0.0, "{levels:?}");
    assert!(std::fs::read(folder.join("level.nrrd")).unwrap().ends_with(&samples), "level 0 is the samples");
    assert_eq!(of_level("blobs.nrrd", "3").0, levels[2].0, "of a source as of what was built of it");
    let why = say(&["blobs.df", "-o", "missing/x.npy"]);
    assert!(why.contains("missing/x.npy: cannot be written: ") && !why.contains(".deepfield-"), "{why}");
    let why = say(&["blobs.df", "-o", "x.png"]);
    assert!(why.contains("found 32 x 32 x 24 of uint8, expected an image or one layer of a volume"), "{why}");
    // What counts as air takes no points.
    let output = run(folder, &["build", "blobs.nrrd", "-o", "air.df", "--ignore-below", "5"]);
    let noted = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && noted.contains("values below 5 count as air"), "{noted}");
    assert!(text(folder, &["info", "air.df"]).contains("values below 5 count as air"));
    let matter = samples.iter().filter(|value| **value >= 5).count() as f64;
    for data in [&["air.df"][..], &["blobs.nrrd", "--ignore-below", "5"]] {
        let words = ["reconstruct", "-o", "x.npy", "--error-value", "1.5", "--json", "-"];
        let told = text(folder, &[&words[..], data].concat());
        assert!(number(&told, &["points"]) <= matter && number(&told, &["error_value", "max"]) <= 1.5, "{told}");
    }
    for mode in ["volume", "primitives"] {
        text(folder, &["render", "air.df", "-o", "air.png", "--mode", mode, "--splats", "500", "--size", "60x40"]);
    }
    let why = say(&["air.df", "-o", "x.npy", "--ignore-below", "5"]);
    assert!(why.contains("air.df: --ignore-below: found a built image or volume"), "{why}");
    // What holds no grid.
    text(folder, &["build", "blobs.nrrd", "-o", "v.df", "--as", "particles"]);
    std::fs::write(folder.join("p.csv"), "x,y,z\n0,0,0\n1,2,3\n").unwrap();
    let why = say(&["v.df", "-o", "x.npy"]);
    assert!(why.contains("v.df: content: found a page file of particles, expected an image or a volume"), "{why}");
    let why = say(&["p.csv", "-o", "x.npy"]);
    assert!(why.contains("p.csv: content: found particles, expected an image or a volume"), "{why}");
    let why = refused(folder, &["build", "p.csv", "-o", "w.df", "--ignore-below", "5"]);
    assert!(why.contains("p.csv: --ignore-below: found particles, expected an image or a volume"), "{why}");
    let why = refused(folder, &["build", "v.df", "-o", "w.df"]);
    assert!(why.contains("v.df: content: found a page file of particles, expected a source"), "{why}");
    let why = refused(folder, &["build", "blobs.df", "-o", "w.df"]);
    assert!(why.contains("blobs.df: content: found a built image or volume, expected a source"), "{why}");
}

#[test]
fn what_was_built_of_a_volume_is_no_particles() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    blobs(folder);
    text(folder, &["build", "blobs.nrrd", "-o", "blobs.df"]);
    std::fs::write(folder.join("p.csv"), "x,y,z\n0,0,0\n4,5,6\n9,9,9\n").unwrap();
    let small = ["--size", "60x40"];
    let render = |first: &'static str, other: &'static str| {
        [&["render", first, "--with", other, "-o", "p.png", "--mode", "column-density"][..], &small[..]].concat()
    };
    // Beside particles it is drawn as what it is, built or not; a source's voxels are particles where that is said.
    for [first, other] in [["p.csv", "blobs.nrrd"], ["p.csv", "blobs.df"], ["blobs.df", "p.csv"]] {
        text(folder, &render(first, other));
    }
    let as_particles = ["--kind", "particles"];
    text(folder, &[&render("p.csv", "blobs.nrrd")[..], &as_particles].concat());
    let alone = refused(folder, &render("blobs.df", "blobs.df"));
    assert!(alone.contains("found column-density, which draws no volume among other data"), "{alone}");
    let expected = "blobs.df: content: found a built image or volume, expected particles, or a source";
    for words in [
        [&render("p.csv", "blobs.df")[..], &as_particles].concat(),
        vec!["export", "blobs.df", "--levels", "splats", "-o", "p.ply"],
    ] {
        let why = refused(folder, &words);
        assert!(why.contains(expected), "{words:?}: {why}");
    }
    // The time that was asked for is told.
    let draw = |data: &str, more: &[&str]| {
        let words = ["render", data, "-o", "p.png", "--backend", "cpu", "--json", "-"];
        text(folder, &[&words[..], &small, more].concat())
    };
    let told = draw("blobs.df", &["--frame-ms", "50"]);
    assert_eq!(number(&told, &["budget_ms"]), 50.0);
    let told = draw("p.csv", &[]);
    assert!(told.contains("\"budget_ms\": null"), "{told}");
}

#[test]
fn a_folder_of_slices_is_drawn_and_asked_as_a_volume() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let samples = blobs(folder);
    std::fs::create_dir(folder.join("slices")).unwrap();
    for z in 0..24 {
        let name = format!("slices/s{z}.png");
        let region = format!("0:32,0:32,{z}:{}", z + 1);
        text(folder, &["reconstruct", "blobs.nrrd", "-o", &name, "--exact", "--region", &region]);
    }
    let draw = |out: &str, more: &[&str]| {
        let words = ["render", "slices", "-o", out, "--size", "60x40", "--backend", "cpu"];
        text(folder, &[&words[..], more].concat());
    };
    draw("a.png", &["--mode", "xray"]);
    let picture = crate::support::golden::picture_at(&folder.join("a.png"));
    assert!(picture.rgba.iter().filter(|pixel| pixel[..3].iter().any(|byte| *byte > 24)).count() > 100);
    // As particles, too.
    draw("b.png", &["--mode", "column-density"]);
    draw("c.png", &["--exact"]);
    let told = text(folder, &["probe", "slices", "--json", "-"]);
    assert_eq!(number(&told, &["samples"]), samples.len() as f64, "{told}");
    text(folder, &["tour", "--around", "slices", "--frame", "0", "frame.png", "--size", "48x32"]);
    assert!(folder.join("frame.png").exists());
}

#[test]
fn voxels_are_particles_where_particles_are_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let samples = blobs(folder);
    let refused = run(folder, &["build", "blobs.nrrd", "-o", "v.df", "--hierarchy", "octree"]);
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--as particles"));
    text(folder, &["build", "blobs.nrrd", "-o", "v.df", "--as", "particles"]);
    let told = text(folder, &["info", "v.df", "--json"]);
    let most = f64::from(*samples.iter().max().unwrap());
    let kept = samples.iter().filter(|sample| f64::from(**sample) > 0.02 * most).count();
    let value: serde_json::Value = serde_json::from_str(&told).unwrap();
    assert_eq!(value["families"][0]["count"].as_u64(), Some(kept as u64), "{told}");
    // The sum of the values times a voxel's volume, but for the air: along any axis the same light. Two pixels a voxel, so that no pixel lies
    // on the volume's faces and kernels are sampled as often as their sum needs.
    let draw = |data: &str, mode: &str, raw: &str| {
        let eye = ["--eye", "8,8,200", "--target", "8,8,12", "--ortho", "40", "--size", "160x160"];
        let words = [&["render", data, "-o", "p.png", "--mode", mode, "--raw", raw, "--backend", "cpu"], &eye[..]];
        text(folder, &words.concat());
        let bytes = std::fs::read(folder.join(raw)).unwrap();
        let numbers =
            bytes[bytes.len() - 4 * 160 * 160..].chunks(4).map(|p| f32::from_le_bytes([p[0], p[1], p[2], p[3]]));
        numbers.map(f64::from).sum::<f64>()
    };
    let (voxels, lines) = (draw("v.df", "column-density", "a.npy"), draw("blobs.nrrd", "xray", "b.npy"));
    let sum = |least: f64| samples.iter().map(|sample| f64::from(*sample)).filter(|value| *value > least).sum::<f64>();
    let without_air = sum(0.02 * most) / sum(-1.0);
    assert!((voxels / lines / without_air - 1.0).abs() < 1e-4, "{voxels} {lines} {without_air}");
}
