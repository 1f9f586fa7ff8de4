//! What keeping a resampled field is worth: the camera turns a little from picture to picture, and each is drawn by the perspective grid,
//! which resamples everything, and from an octree of bricks in world space, which resamples what is new.

use super::Times;
use super::compare::{Bench, Options, number, settings};
use super::splat::Failure;
use crate::color::composite::color_error;
use crate::cpu::cartesian::octree::Octree;
use crate::cpu::cartesian::{Region, march, region};
use crate::cpu::volume::particles::SMALLEST;
use crate::cpu::volume::{Classifier, Scenery, VolumeOptions, extents};
use crate::mode::{Depiction, SettingValue, Settings};
use crate::modes::{grid, volume};
use crate::picture::decode::{batches, decode};
use crate::view::View;
use glam::{DQuat, DVec3};
use serde::Serialize;
use std::time::{Duration, Instant};

/// How far the camera turns around the middle from one picture to the next, degrees.
const TURN: f64 = 0.5;
/// Widths of the octree's cells at most, in cells of the perspective grid.
const WIDTHS: [f64; 3] = [1.0, 2.0, 3.0];

/// One way to draw the pictures.
#[derive(Clone, Debug, Serialize)]
pub struct Orbit {
    /// What it is called.
    pub name: String,
    /// Resampling of the first picture, seconds.
    pub first: f64,
    /// Resampling of the later ones, seconds.
    pub resampling: Times,
    /// Casting rays, seconds.
    pub rendering: Times,
    /// Both, of the later pictures, seconds.
    pub total: Times,
    /// Bricks of the last picture.
    pub bricks: u64,
    /// Bricks that the later pictures resampled, on the average.
    pub resampled: f64,
    /// Memory after the last picture, bytes.
    pub memory: u64,
    /// Mean colour error against the finer volume, of 255: the larger of the first and the last picture's.
    pub error: f64,
}

/// The pictures of one way.
#[derive(Default)]
struct Series {
    resampling: Vec<Duration>,
    rendering: Vec<Duration>,
    bricks: u64,
    resampled: u64,
    memory: u64,
    error: f64,
}

impl Series {
    fn finish(mut self, name: String) -> Orbit {
        let first = self.resampling.first().map_or(0.0, Duration::as_secs_f64);
        let (later, rendering) = (self.resampling.split_off(1), self.rendering.split_off(1));
        let total = later.iter().zip(&rendering).map(|(a, b)| *a + *b).collect();
        let resampled = self.resampled as f64 / later.len().max(1) as f64;
        let (resampling, rendering, total) = (Times::of(later), Times::of(rendering), Times::of(total));
        let Series { bricks, memory, error, .. } = self;
        Orbit { name, first, resampling, rendering, total, bricks, resampled, memory, error }
    }
}

/// Turns around `middle` and draws.
///
/// # Errors
/// When a picture cannot be drawn.
pub(super) fn measure(bench: &Bench<'_>, middle: DVec3, options: &Options) -> Result<Vec<Orbit>, Failure> {
    let frames = usize::from(options.frames);
    if frames < 2 {
        return Ok(Vec::new());
    }
    let views: Vec<View> = (0..frames)
        .map(|frame| {
            let turn = DQuat::from_axis_angle(bench.view.up, (TURN * frame as f64).to_radians());
            let [right, up, forward] = [bench.view.right, bench.view.up, bench.view.forward].map(|axis| turn * axis);
            View { eye: middle + turn * (bench.view.eye - middle), right, up, forward, ..bench.view }
        })
        .collect();
    // The same planes for all, a little wider than the first picture's.
    let planes = bench.paint(&volume::MODE, Settings::default(), &bench.view)?.report.planes;
    let planes = [0.99 * planes[0], 1.01 * planes[1]];
    let between = |values: &[(&'static str, SettingValue)]| {
        let planes = [number(grid::NEAR.name, planes[0]), number(grid::FAR.name, planes[1])];
        settings(planes.into_iter().chain(values.iter().cloned()))
    };
    let finely = between(&[
        number(grid::RESOLUTION.name, options.reference),
        number(grid::SMALLEST_CELLS.name, SMALLEST * options.reference),
        number(grid::TERMINATION.name, 1.0),
    ]);
    let ends = [0, frames - 1];
    let references = [
        bench.paint(&volume::MODE, finely.clone(), &views[ends[0]])?.colors.image(),
        bench.paint(&volume::MODE, finely, &views[ends[1]])?.colors.image(),
    ];
    let errors = |frame: usize, image: &crate::color::Image| {
        let end = ends.iter().position(|&end| end == frame);
        end.map_or(0.0, |end| color_error(image, &references[end]).0)
    };
    let mut orbits = Vec::new();
    for (name, resolution) in [("perspective grid", 1.0), ("perspective grid, half as many cells", 0.5)] {
        let mut series = Series::default();
        for (frame, view) in views.iter().enumerate() {
            let set = between(&[number(grid::RESOLUTION.name, resolution)]);
            let painted = bench.paint(&volume::MODE, set, view)?;
            series.resampling.push(painted.report.resampling);
            series.rendering.push(painted.report.rendering);
            series.bricks = painted.report.bricks;
            series.resampled += if frame > 0 { painted.report.bricks } else { 0 };
            series.memory = series.memory.max(painted.report.memory.unwrap_or(0));
            series.error = series.error.max(errors(frame, &painted.colors.image()));
        }
        orbits.push(series.finish(name.into()));
    }
    let depiction = Depiction::new(&volume::MODE, Settings::default(), bench.attribute, bench.metadata)?;
    let decoded = decode(&depiction, bench.metadata, &bench.nodes);
    let batches = batches(&depiction, &decoded)?;
    let scenery = Scenery {
        classifier: Classifier::new(&bench.transfer, bench.levels, bench.attribute.is_some()),
        volume: true,
        surfaces: Vec::new(),
        light: None,
        volume_light: None,
        termination: 0.999,
    };
    let kernel = bench.metadata.kernel;
    let options = VolumeOptions { kernel, ..VolumeOptions::default() };
    let (bounds, _) = region(&bench.view, &extents::of(&batches), Region::Data, &options)?;
    for width in WIDTHS {
        let mut series = Series::default();
        let mut octree = None;
        for (frame, view) in views.iter().enumerate() {
            let start = Instant::now();
            let tree = match &mut octree {
                Some(tree) => tree,
                // Particles are about as large as in the perspective grid.
                none => none.insert(Octree::new(&batches, bounds, kernel, SMALLEST / width)?),
            };
            let need = tree.prepare(view, width, planes[0]);
            series.resampling.push(start.elapsed());
            let start = Instant::now();
            let (colors, _) = march::cast(view, tree, &scenery, planes);
            series.rendering.push(start.elapsed());
            series.bricks = need.bricks as u64;
            series.resampled += if frame > 0 { need.resampled as u64 } else { 0 };
            series.memory = tree.bytes();
            series.error = series.error.max(errors(frame, &colors.image()));
        }
        orbits.push(series.finish(format!("octree, cells up to {width} wide")));
    }
    eprintln!(
        "\n{:36} {:>8} {:>10} {:>8} {:>8} {:>8} {:>9} {:>8} {:>7}",
        "camera turns by half a degree",
        "first s",
        "resample s",
        "render s",
        "total s",
        "bricks",
        "new",
        "MiB",
        "error"
    );
    for o in &orbits {
        eprintln!(
            "{:36} {:>8.3} {:>10.3} {:>8.3} {:>8.3} {:>8} {:>9.1} {:>8.1} {:>7.2}",
            o.name,
            o.first,
            o.resampling.median,
            o.rendering.median,
            o.total.median,
            o.bricks,
            o.resampled,
            o.memory as f64 / f64::from(1 << 20),
            o.error
        );
    }
    Ok(orbits)
}
