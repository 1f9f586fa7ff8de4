//! Dome masters and other projections from the command line: stars are where the sky has them, every mode shows the same whatever
//! the faces are that a picture is made of, and pictures are what they were.

use crate::support::{in_reference_data, in_repository, keep_demo_pages, program, write_box};
use glam::DVec3;
use std::path::Path;

const DEMO: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/demo/lcdm64_z0.hdf5");

fn render(folder: &Path, arguments: &[&str]) -> String {
    keep_demo_pages(folder);
    let output = program()
        .env("DEEPFIELD_CACHE", "1GB")
        .env("XDG_CACHE_HOME", folder)
        .arg("render")
        .args(arguments)
        .output()
        .unwrap();
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{arguments:?}: {told}");
    told
}

/// A NumPy array's shape and values.
fn read(path: &Path) -> (Vec<u64>, Vec<f32>) {
    let array = npyz::NpyFile::new(std::io::BufReader::new(std::fs::File::open(path).unwrap())).unwrap();
    (array.shape().to_vec(), array.into_vec::<f32>().unwrap())
}

/// Where a direction is in a dome master whose axis is `axis` and whose right is `right`: the angle from the axis grows evenly.
fn in_dome(direction: DVec3, [right, up, axis]: [DVec3; 3], size: f64, aperture: f64) -> Option<[f64; 2]> {
    let angle = direction.angle_between(axis);
    let [x, y] = [direction.dot(right), direction.dot(up)];
    let radius = angle / aperture.to_radians() * size;
    (radius < 0.5 * size - 6.0).then(|| {
        let scale = radius / x.hypot(y).max(1e-12);
        [0.5 * size + scale * x, 0.5 * size - scale * y]
    })
}

/// The direction that a point shows: the inverse.
fn of_dome([x, y]: [f64; 2], [right, up, axis]: [DVec3; 3], size: f64, aperture: f64) -> DVec3 {
    let [dx, dy] = [x - 0.5 * size, 0.5 * size - y];
    let radius = dx.hypot(dy);
    let (sin, cos) = (radius * aperture.to_radians() / size).sin_cos();
    cos * axis + sin / radius.max(1e-12) * (dx * right + dy * up)
}

/// The middle of the light around a place.
fn centroid(values: &[f32], size: usize, place: [f64; 2]) -> [f64; 2] {
    let (mut sum, mut weighted) = (0.0, [0.0; 2]);
    let [left, top] = place.map(|at| at.floor() as usize);
    for (x, y) in (top - 4..=top + 4).flat_map(|y| (left - 4..=left + 4).map(move |x| (x, y))) {
        let light = f64::from(values[y * size + x]);
        sum += light;
        weighted = [weighted[0] + light * (x as f64 + 0.5), weighted[1] + light * (y as f64 + 0.5)];
    }
    assert!(sum > 0.0, "nothing at {place:?}");
    weighted.map(|weighted| weighted / sum)
}

/// Directions of stars in dome masters of the catalogue with these apertures and tilts, against where they are: each to a fraction of a pixel,
/// and the angles between all pairs to a pixel.
fn check_angles(folder: &Path, catalogue: &Path, stars: &[DVec3], side: usize, domes: &[(f64, f64)]) {
    for &(aperture, tilt) in domes {
        let raw = folder.join("dome.npy");
        render(
            folder,
            &[
                catalogue.to_str().unwrap(),
                // A catalogue reaches as far as its furthest star: a page file is too coarse for the nearest ones.
                "--reference",
                "-o",
                folder.join("dome.png").to_str().unwrap(),
                "--raw",
                raw.to_str().unwrap(),
                "--mode",
                "points",
                "--projection",
                "dome",
                "--aperture",
                &aperture.to_string(),
                "--tilt",
                &tilt.to_string(),
                "--size",
                &format!("{side}x{side}"),
                "--eye",
                "0,0,0",
                "--target",
                "1,0.2,0",
                "--up",
                "0,0,1",
            ],
        );
        let (shape, values) = read(&raw);
        assert_eq!(shape, [side as u64; 2]);
        let front = DVec3::new(1.0, 0.2, 0.0).normalize();
        let (sin, cos) = tilt.to_radians().sin_cos();
        let axes = [front.cross(DVec3::Z), sin * DVec3::Z - cos * front, cos * DVec3::Z + sin * front];
        let pixel = aperture.to_radians() / side as f64;
        let mut found = Vec::new();
        for &star in stars {
            let Some(place) = in_dome(star, axes, side as f64, aperture) else { continue };
            let seen = centroid(&values, side, place);
            let away = (seen[0] - place[0]).hypot(seen[1] - place[1]);
            // Near the rim of 360 degrees the sky is stretched sideways without end, and so is a star.
            let stretched = star.angle_between(axes[2]) > 2.6;
            assert!(away < 0.5 || stretched, "{aperture} degrees: {star} is {away} pixels from its place");
            if !stretched {
                found.push((star, of_dome(seen, axes, side as f64, aperture)));
            }
        }
        assert!(found.len() > 5, "{aperture} degrees: {} stars", found.len());
        for (i, a) in found.iter().enumerate() {
            for b in &found[..i] {
                let error = (a.1.angle_between(b.1) - a.0.angle_between(b.0)).abs();
                assert!(error < pixel, "{aperture} degrees: the angle is wrong by {} pixels", error / pixel);
            }
        }
    }
}

fn on_sky(ra: f64, dec: f64) -> DVec3 {
    let ([sin, cos], [above, level]) =
        ([ra.to_radians().sin(), ra.to_radians().cos()], [dec.to_radians().sin(), dec.to_radians().cos()]);
    DVec3::new(level * cos, level * sin, above)
}

#[test]
fn angles_between_stars_are_right_to_a_pixel() {
    let folder = tempfile::tempdir().unwrap();
    let places = (0..60).map(|i| (f64::from(i) * 137.508 % 360.0, (f64::from(i) / 29.5 - 1.0).asin().to_degrees()));
    let places: Vec<(f64, f64)> = places.collect();
    let mut text = String::from("ra [deg],dec [deg],dist [pc],mag\n");
    for (i, (ra, dec)) in places.iter().enumerate() {
        text += &format!("{ra},{dec},{},{}\n", 3.0 + f64::from(i as u32 % 7) * 40.0, i % 5);
    }
    let catalogue = folder.path().join("stars.csv");
    std::fs::write(&catalogue, text).unwrap();
    let stars: Vec<DVec3> = places.iter().map(|&(ra, dec)| on_sky(ra, dec)).collect();
    check_angles(folder.path(), &catalogue, &stars, 600, &[(180.0, 0.0), (230.0, 30.0), (360.0, -40.0)]);
}

/// Bright stars of the Hipparcos catalogue: right ascension and declination, degrees, J2000.
const BRIGHT: [(f64, f64); 12] = [
    (101.287, -16.716),
    (95.988, -52.696),
    (213.915, 19.182),
    (279.235, 38.784),
    (79.172, 45.998),
    (78.634, -8.202),
    (114.825, 5.225),
    (24.429, -57.237),
    (297.696, 8.868),
    (68.980, 16.509),
    (344.413, -29.622),
    (310.358, 45.280),
];

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn angles_between_known_stars_are_right_to_a_pixel() {
    let folder = tempfile::tempdir().unwrap();
    let stars = BRIGHT.map(|(ra, dec)| on_sky(ra, dec));
    // The finest pixels, and the whole sky: what lies between has nothing to do with the catalogue.
    check_angles(
        folder.path(),
        &in_reference_data("stars/hyg_mag65.csv"),
        &stars,
        900,
        &[(180.0, 0.0), (360.0, -40.0)],
    );
}

/// Mean over blocks of pixels, so that neither picture's sampling counts.
fn blocks(values: &[f32], size: usize, block: usize) -> Vec<f64> {
    let channels = values.len() / (size * size);
    let count = size / block;
    let mut out = vec![0.0; count * count * channels];
    for (index, value) in values.iter().enumerate() {
        let (pixel, channel) = (index / channels, index % channels);
        let [x, y] = [pixel % size / block, pixel / size / block];
        if x < count && y < count {
            out[(y * count + x) * channels + channel] += f64::from(*value) / (block * block) as f64;
        }
    }
    out
}

/// The same dome twice: made of faces along its axis, and read from an equirectangular picture whose faces lie otherwise. With
/// an eye in the middle of the data, for every way to draw. (The map's pixels are half as wide, which is what most of the tolerance is for: a
/// filter of spheres is some pixels wide.)
#[test]
fn every_technique_is_the_same_whatever_the_faces() {
    const SIZE: usize = 48;
    let folder = tempfile::tempdir().unwrap();
    let raw = |name: &str| folder.path().join(name);
    // Few, all around the eye.
    let source = write_box(folder.path());
    let camera = ["--eye", "45600,52600,47200", "--target", "80000,60000,20000"];
    let common = [&["--backend", "cpu", "--family", "dark"][..], &camera].concat();
    // Fewer cells and layers than usual show the same.
    for (mode, tolerance, setting) in [
        ("column-density", 0.05, ""),
        // Volumes and surfaces at once.
        ("volume-isosurface", 0.12, ""),
        ("cartesian", 0.05, "cells=96"),
        ("layered", 0.15, "layers=32"),
        ("sorted-splats", 0.3, ""),
        ("spheres", 0.7, ""),
    ] {
        let setting: &[&str] = if setting.is_empty() { &[] } else { &["--set", setting] };
        let make = |name: &str, projection: &[&str]| {
            let png = raw("out.png");
            let npy = raw(name);
            let (source, png, raw) = (source.to_str().unwrap(), png.to_str().unwrap(), npy.to_str().unwrap());
            let own = [source, "-o", png, "--raw", raw, "--mode", mode];
            render(folder.path(), &[&own[..], &common[..], setting, projection].concat());
            read(&npy)
        };
        // The front is in the dome's middle and the zenith at its top, as in the map.
        let (_, dome) = make("dome.npy", &["--projection", "dome", "--tilt", "57", "--size", "48x48"]);
        let (shape, map) = make("map.npy", &["--projection", "equirectangular", "--size", "192x96"]);
        let channels = shape.get(2).copied().unwrap_or(1) as usize;
        let (sin, cos) = 57f64.to_radians().sin_cos();
        let axes = [DVec3::X, sin * DVec3::Y - cos * DVec3::Z, cos * DVec3::Y + sin * DVec3::Z];
        let mut expected = vec![0.0f32; dome.len()];
        for index in 0..SIZE * SIZE {
            for sample in 0..9 {
                let point = [index % SIZE, index / SIZE].map(|at| at as f64);
                let point = [
                    point[0] + f64::from(sample % 3) / 3.0 + 1.0 / 6.0,
                    point[1] + f64::from(sample / 3) / 3.0 + 1.0 / 6.0,
                ];
                if (point[0] - 24.0).hypot(point[1] - 24.0) > 24.0 {
                    continue;
                }
                let shown = of_dome(point, axes, SIZE as f64, 180.0);
                let u = (shown.x.atan2(shown.z) / std::f64::consts::TAU + 0.5) * 192.0;
                let v = (0.5 - shown.y.asin() / std::f64::consts::PI) * 96.0;
                let at = (v as usize).min(95) * 192 + (u as usize).min(191);
                for channel in 0..channels {
                    expected[index * channels + channel] += map[at * channels + channel] / 9.0;
                }
            }
        }
        let [dome, expected] = [dome, expected].map(|values| blocks(&values, SIZE, 4));
        let difference: f64 = dome.iter().zip(&expected).map(|(a, b)| (a - b).abs()).sum();
        let all: f64 = expected.iter().map(|value| value.abs()).sum();
        assert!(all > 0.0 && difference < tolerance * all, "{mode}: {} of the picture", difference / all);
    }
}

/// Small pictures, as they were when somebody looked at them. `DEEPFIELD_BLESS=1` writes them anew.
#[test]
fn pictures_are_what_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let golden = in_repository("tests/golden");
    let dome = ["--projection", "dome", "--tilt", "25", "--size", "128x128"];
    let map = ["--projection", "equirectangular", "--size", "160x80", "--mode", "volume"];
    let cross = ["--projection", "cube", "--size", "40x40"];
    let circle = [
        "--projection",
        "dome",
        "--size",
        "96x96",
        "--stereo",
        "omnidirectional",
        "--eye-separation",
        "0.6",
        "--zero-parallax",
        "3",
    ];
    let pair = [
        "--projection",
        "flat",
        "--size",
        "80x60",
        "--stereo",
        "off-axis",
        "--eye-separation",
        "1.5",
        "--zero-parallax",
        "20",
    ];
    for (name, options) in [
        ("dome", &dome[..]),
        ("map", &map[..]),
        ("cross", &cross[..]),
        ("dome-stereo", &circle[..]),
        ("stereo", &pair[..]),
    ] {
        let out = folder.path().join(format!("{name}.png"));
        let own = [DEMO, "-o", out.to_str().unwrap(), "--backend", "cpu", "--eye", "25,25,25", "--target", "40,30,10"];
        render(folder.path(), &[&own[..], options].concat());
        let kept = golden.join(format!("projection-{name}.png"));
        if std::env::var_os("DEEPFIELD_BLESS").is_some() {
            std::fs::copy(&out, &kept).unwrap();
        }
        let [found, expected] = [out, kept].map(|path| {
            let mut reader =
                png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).unwrap())).read_info().unwrap();
            let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut bytes).unwrap();
            bytes
        });
        assert_eq!(found.len(), expected.len(), "{name}");
        let difference: u64 = found.iter().zip(&expected).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
        assert!((difference as f64) < 0.5 * found.len() as f64, "{name}: {difference} over {} bytes", found.len());
    }
    let pages = std::fs::read_dir(folder.path().join("deepfield").join("pages")).unwrap().count();
    assert_eq!(pages, 1, "the page file that was kept is the one that the program looks for");
}

#[test]
fn what_does_not_fit_together_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    keep_demo_pages(folder.path());
    let out = folder.path().join("o.png");
    for (options, expected) in [
        (&["--projection", "cube", "--aperture", "90"][..], "--projection dome"),
        (&["--projection", "dome", "--aperture", "361"][..], "at most 360"),
        (&["--projection", "dome", "--mode", "points", "--backend", "compute"][..], "cpu"),
        (
            &["--projection", "cube", "--stereo", "omnidirectional", "--eye-separation", "1", "--zero-parallax", "2"][..],
            "dome and equirectangular",
        ),
        (&["--stereo", "off-axis"][..], "--eye-separation"),
        (&["--eyes", "left"][..], "--stereo"),
    ] {
        let output = program()
            .env("XDG_CACHE_HOME", folder.path())
            .args(["render", DEMO, "-o", out.to_str().unwrap(), "--size", "16x16"])
            .args(options)
            .output()
            .unwrap();
        let told = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && told.contains(expected), "{options:?}: {told}");
    }
}
