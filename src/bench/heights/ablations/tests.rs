//! What is left out is missed, each of it on a field that needs it.

use super::*;
use crate::bench::Arguments;
use crate::heights::build::{HeightBuildOptions, HeightOrigin, build_heights};
use crate::heights::model::HeightField;
use crate::model::SampleType;
use clap::Parser;
use std::path::PathBuf;
use tempfile::TempDir;

#[derive(Parser)]
struct Words {
    #[command(flatten)]
    arguments: Arguments,
}

const SIDE: usize = 600;

/// From 0 to 1, without any order (a counter, well mixed).
fn noise(index: usize) -> f64 {
    let mixed = (index as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (mixed >> 11) as f64 / (1_u64 << 53) as f64
}

/// Samples along the side of what was measured or not as a whole.
const BLOCK: usize = 5;

/// Gentle waves, rough from sample to sample, of which a share was not measured; and how pictures of a size are measured.
fn built(open: f64, size: &str) -> (TempDir, PathBuf, Arguments) {
    let folder = tempfile::tempdir().unwrap();
    let height = |index: usize| {
        let [y, x] = [index / SIDE, index % SIDE].map(|at| at as f64 / 24.0);
        let height = 5.0 * (x.sin() + y.cos()) + noise(index);
        let block = index / SIDE / BLOCK * SIDE + index % SIDE / BLOCK;
        if noise(SIDE * SIDE + block) < open { f64::NAN } else { f64::from(height as f32) }
    };
    let mut field = HeightField::of(SIDE as u64, SIDE as u64, (0..SIDE * SIDE).map(height).collect());
    field.grid.sample_type = SampleType::F32;
    let path = folder.path().join("ground.df");
    build_heights(&field, &HeightOrigin::default(), &HeightBuildOptions::default(), &path, &()).unwrap();
    (folder, path, sized(size))
}

fn sized(size: &str) -> Arguments {
    Words::parse_from(["bench", "heights", "--repeat", "1", "--size", size]).arguments
}

fn of<'a>(found: &'a Ablations, view: &str, way: &str) -> &'a Ablated {
    found.pictures.iter().find(|own| own.view == view && own.way.contains(way)).unwrap()
}

#[test]
fn points_and_normals_are_worse_without_the_rest() {
    let (_folder, path, arguments) = built(0.0, "160x120");
    let found = Bench::open(&path, &arguments).unwrap().ablations().unwrap();
    assert_eq!(found.pictures.len(), 3 * WAYS.len());
    assert_eq!(found.cracks.unwrap().shared, 0);
    // Near by points leave gaps.
    let [ships, points] = ["ships", "points"].map(|way| of(&found, "near", way));
    assert!(points.open > 100 + 4 * ships.open, "{points:?}, {ships:?}");
    // Far away triangles are smaller than pixels.
    let arguments = sized("64x48");
    let found = Bench::open(&path, &arguments).unwrap().ablations().unwrap();
    let [ships, triangles, rays, plain] =
        ["ships", "triangles", "rays", "mean normals"].map(|way| of(&found, "above", way));
    assert!(ships.points > 0 && triangles.points == 0, "{ships:?}");
    assert!(triangles.triangles > ships.triangles + ships.points, "{triangles:?}");
    // Rough ground is lit as if it were smooth.
    assert!(plain.mean > 2.0 * ships.mean + 1.0, "{plain:?}, {ships:?}");
    assert!(ships.mean < 4.0 && rays.open == 0, "{ships:?}, {rays:?}");
}

#[test]
fn holes_are_worse_without_coverage() {
    let (_folder, path, arguments) = built(0.3, "64x48");
    let found = Bench::open(&path, &arguments).unwrap().ablations().unwrap();
    let [ships, whole, grown, means] = ["ships", "as if whole", "grow", "of means"].map(|way| of(&found, "above", way));
    assert!((ships.covered / ships.valid - 1.0).abs() < 0.03, "{ships:?}");
    assert!(whole.covered > 1.3 * whole.valid, "{whole:?}");
    assert!(grown.covered < 0.7 * grown.valid, "{grown:?}");
    assert!(whole.mean > ships.mean && grown.mean > ships.mean, "{ships:?}, {whole:?}, {grown:?}");
    assert!(means.points > 0 && means.mean > ships.mean, "{means:?}, {ships:?}");
}

#[test]
fn chunks_that_count_from_their_own_origins_leave_cracks() {
    let (_folder, path, arguments) = built(0.0, "64x48");
    let bench = Bench::open(&path, &arguments).unwrap();
    let surface = bench.fresh().unwrap();
    // In parallel from so far that a single of the distance is a part of a pixel.
    let target = DVec3::new(280.0, 270.0, 0.0);
    let (mut shared, mut own, mut views) = (0, 0, 0);
    for number in 0..12 {
        let (sine, cosine) = (0.4 + f64::from(number)).sin_cos();
        let eye = target + 1e7 * DVec3::new(0.6 * sine, 0.6 * cosine, 0.8);
        let camera = CameraConfig {
            eye: Some(eye.to_array()),
            target: Some(target.to_array()),
            up: Some(DVec3::Z.to_array()),
            fov: None,
            ortho: Some(200.0),
        };
        let Sight::Flat(view) = bench.sight(camera).unwrap() else { panic!("a flat picture") };
        let options = SurfaceOptions { technique: Technique::Triangles, tau: 0.05, ..SurfaceOptions::default() };
        let Some(found) = cracks_of(&surface, &bench.placed, &view, &options) else { continue };
        (shared, own, views) = (shared + found[0], own + found[1], views + 1);
    }
    assert!(views > 6 && shared == 0 && own > 0, "{shared} and {own} pixels of {views} pictures");
}
