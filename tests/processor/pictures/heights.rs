//! Golden images of measured heights, by the program: each attribute by each technique, holes, points that leave gaps,
//! and a globe on a dome. `DEEPFIELD_BLESS=1` writes them anew; look at them before committing.

use crate::support::golden::{TOLERANCE, check, difference, golden, picture_at};
use crate::support::{in_reference_data, in_repository, ok};
use deepfield::color::composite::Image;
use deepfield::color::output::write_png;
use std::path::Path;

/// Mean difference of colour channels between points and triangles, in 1/255: points show a place of their pixel, not
/// its middle.
const BY_POINTS: f64 = 0.5;

/// The techniques that draw what hybrid does.
const OTHERS: [&str; 3] = ["points", "triangles", "rays"];

/// Builds `NAME.df` of a synthetic field of this shape.
fn built(folder: &Path, name: &str, shape: &[&str]) {
    let source = format!("{name}.npy");
    ok(folder, &[&["synth", "surface", "-o", &source, "--shape"][..], shape].concat());
    ok(folder, &["build", &source, "-o", &format!("{name}.df"), "--spacing", "1,1"]);
}

fn hills(folder: &Path) {
    built(folder, "hills", &["fbm", "--hurst", "0.97", "--seed", "3", "--size", "800,600"]);
}

fn waves(folder: &Path) {
    built(folder, "waves", &["sines", "--size", "800,600"]);
}

/// From before fields of 800 x 600 samples. Of the hills near ground is triangles, behind it are points, and at the end
/// triangles of another level.
const ACROSS: [&str; 6] = ["--eye", "400,-260,300", "--target", "400,300,0", "--size", "160x120"];

fn drawn(folder: &Path, field: &str, arguments: &[&str]) -> Image {
    let common = ["render", field, "-o", "picture.png", "--backend", "cpu", "--up", "0,0,1"];
    ok(folder, &[&common[..], arguments].concat());
    picture_at(&folder.join("picture.png"))
}

/// Compares a picture with its golden image, and what these techniques draw in its place.
fn check_all(folder: &Path, name: &str, field: &str, arguments: &[&str], others: &[&str]) {
    check(name, &drawn(folder, field, arguments));
    let golden = golden(&format!("{name}.png"));
    for technique in others {
        let setting = format!("technique={technique}");
        let found = difference(&drawn(folder, field, &[arguments, &["--set", &setting]].concat()), &golden);
        let most = if *technique == "points" { BY_POINTS } else { TOLERANCE };
        assert!(found <= most, "{name} by {technique} differs by {found:.3}/255 a channel, tolerance {most}");
    }
}

#[test]
fn hills_are_their_golden_images_by_each_technique() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    hills(folder);
    let looks: [(&str, &[&str]); 2] = [
        ("heights-height", &["--attribute", "height", "--set", "contours=5.0"]),
        ("heights-residual", &["--attribute", "residual", "--set", "form=quadric"]),
    ];
    for (name, look) in looks {
        check_all(folder, name, "hills.df", &[&ACROSS[..], look].concat(), &OTHERS);
    }
    // How a picture was made differs by technique.
    for attribute in ["primitive", "level"] {
        let look = [&ACROSS[..], &["--attribute", attribute]].concat();
        check(&format!("heights-{attribute}"), &drawn(folder, "hills.df", &look));
    }
    let near = ["--eye", "400,260,30", "--target", "400,330,0", "--size", "160x120", "--set", "technique=points"];
    check("heights-points", &drawn(folder, "hills.df", &near));
    // What the tolerance is worth.
    let higher = [&ACROSS[..], looks[0].1, &["--set", "exaggeration=1.1"]].concat();
    let found = difference(&drawn(folder, "hills.df", &higher), &golden("heights-height.png"));
    assert!(found > 2.0 * TOLERANCE, "hills that are a tenth higher change only {found:.3}/255");
}

#[test]
fn slopes_are_their_golden_images_by_each_technique() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    waves(folder);
    // Colours from the curvature of a trough to that of a crest.
    let colors = r##"(0.0, "#2166ac"), (0.5, "#f7f7f7"), (1.0, "#b2182b")"##;
    let transfer = format!("(color_map: [{colors}], scale: linear, range: fixed(-0.012, 0.012))");
    std::fs::write(folder.join("curvature.ron"), transfer).unwrap();
    let looks: [(&str, &[&str]); 3] = [
        ("heights-slope", &["--attribute", "slope"]),
        ("heights-aspect", &["--attribute", "aspect"]),
        // Of the samples themselves: what coarse levels round is as large as what is curved there.
        ("heights-curvature", &["--attribute", "curvature", "--transfer", "curvature.ron", "--error-px", "0.001"]),
    ];
    for (name, look) in looks {
        check_all(folder, name, "waves.df", &[&ACROSS[..], look].concat(), &OTHERS);
    }
    hills(folder);
    check_all(folder, "heights-difference", "waves.df", &[&ACROSS[..], &["--before", "hills.df"]].concat(), &OTHERS);
}

#[test]
fn holes_are_their_golden_image_by_each_technique() {
    let folder = tempfile::tempdir().unwrap();
    built(folder.path(), "holes", &["holes", "--seed", "5", "--size", "420,300"]);
    let look = ["--eye", "210,-120,200", "--target", "210,150,0", "--size", "160x120", "--set", "holes=outlined"];
    check_all(folder.path(), "heights-holes", "holes.df", &look, &OTHERS);
}

/// An Alicona file of 400 x 300 samples, waves a metre apart, with how well they are known: rings.
fn scan(folder: &Path) {
    let [columns, rows] = [400_u16, 300];
    let at = || (0..rows).flat_map(move |row| (0..columns).map(move |column| [f64::from(column), f64::from(row)]));
    let mut file = b"AliconaImaging\0\r\n".to_vec();
    for (name, value) in [
        ("Version", "1"),
        ("TagCount", "8"),
        ("Cols", "400"),
        ("Rows", "300"),
        ("PixelSizeXMeter", "1"),
        ("PixelSizeYMeter", "1"),
        ("DepthImageOffset", "1024"),
        ("TextureImageOffset", "481024"),
        ("NumberOfPlanes", "1"),
        ("DepthImageResPtr", "0"),
    ] {
        let mut tag = [0; 52];
        tag[..name.len()].copy_from_slice(name.as_bytes());
        tag[20..20 + value.len()].copy_from_slice(value.as_bytes());
        tag[50..].copy_from_slice(b"\r\n");
        file.extend_from_slice(&tag);
    }
    file.resize(1024, 0);
    file.extend(at().flat_map(|[x, y]| ((12.0 * (x / 26.0).sin() * (y / 34.0).cos()) as f32).to_le_bytes()));
    file.extend(at().map(|[x, y]| (127.5 + 127.5 * (0.08 * (x - 200.0).hypot(y - 150.0)).cos()) as u8));
    std::fs::write(folder.join("scan.al3d"), file).unwrap();
}

#[test]
fn a_named_plane_is_its_golden_image_by_each_technique() {
    let folder = tempfile::tempdir().unwrap();
    scan(folder.path());
    let look = ["--eye", "200,-130,150", "--target", "200,150,0", "--size", "160x120", "--attribute", "quality"];
    check_all(folder.path(), "heights-plane", "scan.al3d", &look, &OTHERS);
}

/// Metres above the radius at a longitude and a latitude in degrees.
fn ground(longitude: f64, latitude: f64) -> f64 {
    let (longitude, latitude) = (longitude.to_radians(), latitude.to_radians());
    let ridges = 0.5 * (5.0 * longitude).sin() * (3.0 * latitude).cos();
    4000.0 * ((2.0 * longitude + latitude).sin() + ridges) * latitude.cos()
}

/// Longitudes and latitudes of the middles of so many degrees' cells, the northernmost row first.
fn cells(degrees: f64) -> impl Iterator<Item = [f64; 2]> {
    let count = move |whole: f64| (whole / degrees) as u32;
    let middle = move |index: u32| (f64::from(index) + 0.5) * degrees;
    (0..count(180.0))
        .flat_map(move |row| (0..count(360.0)).map(move |column| [middle(column) - 180.0, 90.0 - middle(row)]))
}

#[test]
fn a_globe_with_its_photo_is_its_golden_image_on_a_dome() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let heights: Vec<String> = cells(5.0).map(|[x, y]| format!("{:.0}", ground(x, y))).collect();
    let head = "ncols 72\nnrows 36\nxllcorner -180\nyllcorner -90\ncellsize 5\n";
    std::fs::write(folder.join("globe.asc"), format!("{head}{}\n", heights.join(" "))).unwrap();
    let color = |[longitude, latitude]: [f64; 2]| match ground(longitude, latitude) {
        _ if latitude.abs() > 70.0 => [240, 240, 250, 255],
        ..0.0 => [20, 60, 130, 255],
        ..2000.0 => [60, 120, 50, 255],
        _ => [150, 120, 80, 255],
    };
    let photo = Image { width: 144, height: 72, rgba: cells(2.5).map(color).collect() };
    write_png(&folder.join("photo.png"), &photo).unwrap();
    let units = ["--xy-unit", "deg", "--height-unit", "m", "--texture", "photo.png"];
    ok(folder, &[&["build", "globe.asc", "-o", "globe.df"][..], &units].concat());
    let dome = ["--map", "globe:moon", "--projection", "dome", "--tilt", "60", "--size", "144x144"];
    let camera = ["--eye", "2000000,1000000,-900000", "--target", "0,0,0"];
    let look = ["--set", "exaggeration=30.0", "--set", "contours=2000.0"];
    // Points leave gaps: a cell is several pixels wide.
    check_all(folder, "heights-dome", "globe.df", &[&dome[..], &camera, &look].concat(), &["triangles", "rays"]);
}

/// The shipped example: etopo20 under the Blue Marble, on a dome as a tour shows it and flat as its scene does.
#[test]
fn the_shipped_earth_is_its_golden_images() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let shipped = |name: &str| in_repository("assets").join(name).display().to_string();
    check("heights-earth", &drawn(folder, &shipped("earth/earth.scene.ron"), &["--size", "128x128"]));
    ok(folder, &["tour", &shipped("tours/earth-dome.ron"), "--frame", "480", "dome.png", "--size", "96x96"]);
    check("heights-earth-dome", &picture_at(&folder.join("dome.png")));
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn measured_surfaces_are_their_golden_images() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for (name, file, arguments) in [
        ("heights-al3d", "al3d-1.al3d", &["--attribute", "texture"][..]),
        ("heights-frt", "frt-2.frt", &["--set", "exaggeration=20.0"]),
    ] {
        let source = in_reference_data(&format!("heightfields/{file}")).display().to_string();
        check(name, &drawn(folder, &source, &[&["--size", "128x128"], arguments].concat()));
    }
}
