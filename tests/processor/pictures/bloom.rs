//! Bloom as it is asked for on the command line.

use crate::support::golden::{difference, picture_at};
use crate::support::{text, write_demo_pages};
use deepfield::color::Bloom;
use deepfield::color::composite::composite_glowing;
use deepfield::hierarchy::Kinds;
use deepfield::look::{Camera, LookPatch, SceneFile, Shot};
use deepfield::mode::Raw;
use deepfield::modes;
use deepfield::picture::Session;
use deepfield::store::PageFile;
use std::path::Path;
use std::sync::Arc;

#[test]
fn pictures_glow_as_they_are_asked_to() {
    let folder = tempfile::tempdir().unwrap();
    let pages = folder.path().join("demo.df");
    write_demo_pages(&pages, Kinds::default());
    let out = folder.path().join("a.png");
    let render = |options: &[&str]| {
        let picture = ["render", "demo.df", "-o", "a.png", "--backend", "cpu", "--mode", "density-squared"];
        let view = ["--size", "90x60", "--eye", "60,45,90", "--target", "25,25,25", "--up", "0,1,0", "--fov", "45"];
        text(folder.path(), &[&picture[..], &view, options].concat());
        std::fs::read(&out).unwrap()
    };
    let plain = render(&[]);
    let plain_image = picture_at(&out);
    assert!(render(&["--bloom", "0", "--bloom-threshold", "0.2", "--bloom-radius", "0.15"]) == plain);

    // The same sums, in colours whose light spreads.
    let up = [0.0, 1.0, 0.0];
    let camera = Camera { eye: [60.0, 45.0, 90.0], target: [25.0; 3], up, fov: 45.0, ortho: None };
    let look = LookPatch { mode: modes::find("density-squared"), ..LookPatch::default() };
    let scene = SceneFile { look, size: Some((90, 60)), camera: Some(camera), ..SceneFile::new(Vec::new()) };
    let shot = Shot::of_scene(scene, Path::new(""));
    let mut session = Session::of(Arc::new(PageFile::open(&pages).unwrap()), u64::MAX);
    let picture = session.draw(&shot).unwrap();
    assert!(picture.image(&shot).unwrap() == plain_image);
    let Raw::Sums(sums, _) = &picture.values else { panic!("colours") };
    let colors = picture.coloration();
    let bloom = Bloom { strength: 0.8, threshold: 0.2, radius: 0.15 };
    let expected = composite_glowing(sums, &colors.transfer, &colors.levels, &bloom);
    // None of them is what it usually is.
    render(&["--bloom", "0.8", "--bloom-threshold", "0.2", "--bloom-radius", "0.15"]);
    let glowing = picture_at(&out);
    assert!(glowing == expected, "{} of 255 from what it should be", difference(&glowing, &expected));
    assert!(difference(&glowing, &plain_image) > 0.5, "{} of 255 from no glow", difference(&glowing, &plain_image));
}
