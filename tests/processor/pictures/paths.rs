//! Paths in pictures of more than one view, by the program, and those of selections where clusters stand for particles.

use crate::support::golden::picture_at;
use crate::support::{json, ok};
use deepfield::color::Image;
use std::path::Path;

/// A run of 2000 particles on orbits around the origin, with flow levels.
fn built() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    ok(folder.path(), &["synth", "halo", "-n", "2000", "--steps", "4", "-o", "snap"]);
    ok(folder.path(), &["build", "snap_*", "-o", "run.df", "--flow-levels", "3"]);
    folder
}

/// A picture of the run with a configuration, and how many tracks it shows.
fn drawn(folder: &Path, config: &str, arguments: &[&str]) -> (Image, u64) {
    std::fs::write(folder.join("c.ron"), config).unwrap();
    let common = ["render", "run.df", "-o", "c.png", "--backend", "cpu", "--config", "c.ron", "--time", "step:2"];
    let told = json(folder, &[&common[..], &["--json", "-"], arguments].concat());
    let tracks = told["tracks_drawn"].as_u64().unwrap_or_else(|| panic!("{told}"));
    (picture_at(&folder.join("c.png")), tracks)
}

/// Light of the columns of a picture.
fn columns(image: &Image, range: std::ops::Range<usize>) -> Vec<f64> {
    let rows = image.rgba.chunks(image.width as usize);
    rows.fold(vec![0.0; range.len()], |mut sums, row| {
        for (sum, pixel) in sums.iter_mut().zip(&row[range.clone()]) {
            *sum += pixel[..3].iter().map(|part| f64::from(*part)).sum::<f64>();
        }
        sums
    })
}

/// Where the light of columns has its middle.
fn middle(light: &[f64]) -> f64 {
    let sum: f64 = light.iter().sum();
    light.iter().enumerate().map(|(x, light)| x as f64 * light).sum::<f64>() / sum
}

#[test]
fn both_eyes_see_paths_with_their_parallax() {
    let folder = built();
    let folder = folder.path();
    let config = r##"(mode: "paths", paths: (level: 0, tail: 1, width: 1.0, color: "#ffffff", halo: 0.0))"##;
    let camera = ["--eye", "0,0,100", "--target", "0,0,0", "--fov", "20", "--size", "300x200"];
    let stereo = ["--stereo", "off-axis", "--eye-separation", "4", "--zero-parallax", "50"];
    let (pair, tracks) = drawn(folder, config, &[&camera[..], &stereo].concat());
    let (left, alone) = drawn(folder, config, &[&camera[..], &stereo, &["--eyes", "left"]].concat());
    assert_eq!((pair.width, pair.height, left.width), (600, 200, 300));
    let halves = [columns(&pair, 0..300), columns(&pair, 300..600)];
    assert!(halves[0] == columns(&left, 0..300) && tracks >= alone && alone > 1000, "{tracks} {alone}");
    // Twice as far as the screen: half of the parallax of what is infinitely far.
    let focal = 100.0 / 10f64.to_radians().tan();
    let (found, expected) = (middle(&halves[1]) - middle(&halves[0]), 4.0 * focal * (1.0 / 50.0 - 1.0 / 100.0));
    assert!((found - expected).abs() < 0.06 * expected, "{found} {expected}");
}

#[test]
fn cuts_cut_paths_in_all_directions() {
    let folder = built();
    let folder = folder.path();
    let config = |cut: &str, mode: &str| {
        format!(
            r##"(mode: "{mode}", {cut} paths: (of: all, level: 0, tail: 1, width: 2.0, color: "#00ff00", halo: 0.0))"##
        )
    };
    let camera = ["--eye", "0,0,0", "--target", "0,0,-1"];
    let map = ["--projection", "equirectangular", "--size", "256x128"];
    let clip = "cut: (clip: (min: (0.0, -1000.0, -1000.0), max: (1000.0, 1000.0, 1000.0))),";
    let green = |image: &Image, range: std::ops::Range<usize>| {
        // Without the poles, where widths are as wide as the map.
        let rows = image.rgba.chunks(image.width as usize).skip(20).take(88);
        rows.flat_map(|row| &row[range.clone()]).filter(|[r, g, b, _]| *g > 100 && *r < 60 && *b < 60).count()
    };
    // Right of the front is right of the eye.
    let (cut, _) = drawn(folder, &config(clip, "paths"), &[&camera[..], &map].concat());
    let (whole, all) = drawn(folder, &config("", "paths"), &[&camera[..], &map].concat());
    assert_eq!(all, 2000);
    assert_eq!(green(&cut, 6..122), 0);
    assert!(green(&cut, 134..250) > 500 && green(&whole, 6..122) > 500);
    // Over sums, among a volume, and as a cube: they are there, too.
    let map = ["--projection", "equirectangular", "--size", "128x64"];
    let dome = ["--projection", "dome", "--aperture", "360", "--size", "96x96"];
    let cube = ["--projection", "cube", "--size", "48x48"];
    // Of few layers.
    let strip = [&cube[..], &["--layout", "strip", "--set", "layers=16"]].concat();
    for (mode, projection) in
        [("column-density", &map[..]), ("volume", &dome[..]), ("density-squared", &cube[..]), ("layered", &strip[..])]
    {
        let arguments = [&camera[..], projection].concat();
        let (picture, tracks) = drawn(folder, &config("", mode), &arguments);
        let none = config("", mode).replace("of: all", "of: none");
        let (without, _) = drawn(folder, &none, &arguments);
        // What is bright without them is yellow.
        let green = |[r, g, ..]: &[u8; 4]| i32::from(*g) - i32::from(*r);
        let greener = |(a, b): (&[u8; 4], &[u8; 4])| green(a) > green(b) + 40;
        let found = picture.rgba.iter().zip(&without.rgba).filter(|pair| greener(*pair)).count();
        assert!(found > 300 && tracks == 2000, "{mode}: {found} {tracks}");
    }
}

#[test]
fn clusters_are_shaded_by_how_much_of_them_is_selected() {
    let folder = built();
    let folder = folder.path();
    let camera = ["--eye", "0,0,60", "--target", "0,0,0", "--fov", "20", "--size", "240x160"];
    let picture = |of: &str, radius: f64, more: &str| {
        let config = format!(
            r##"(mode: "paths", selections: [(name: "some", members: Region((shapes: [Sphere(center: (0.0, 0.0, 0.0), radius: {radius:?})])))],
                 paths: (of: {of}, tail: 1, color: "#ff0000", shape: line, halo: 0.0, width: 1.5, {more}))"##
        );
        drawn(folder, &config, &camera)
    };
    for more in ["level: 1", "level: 2", "spacing: 10"] {
        let (all, tracks) = picture("all", 1.0, more);
        // Who is selected as a whole is drawn as everybody is.
        let (everybody, same) = picture(r#"["some"]"#, 1e9, more);
        assert!(all.rgba == everybody.rgba && tracks == same && tracks < 2000, "{more}: {tracks} {same}");
        // Of others what is not selected is grey.
        let (some, fewer) = picture(r#"["some"]"#, 1.0, more);
        assert!(fewer > 0 && fewer < tracks, "{more}: {fewer} {tracks}");
        let grey = |image: &Image| image.rgba.iter().filter(|[r, g, _, _]| *g > 20 && r >= g).count();
        assert!(grey(&some) > 0 && grey(&all) == 0, "{more}: {}", grey(&some));
    }
    let (_, particles) = picture(r#"["some"]"#, 1.0, "level: 0");
    assert!(particles > 100 && particles < 2000, "{particles}");
}
