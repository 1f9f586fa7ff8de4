//! How a surface hides light from itself: depths at pixels' centres, for the eye and for a lamp.

use super::means;
use super::picture::{SurfaceOptions, scene, visible};
use super::pieces::Pieces;
use super::placed::Placed;
use super::resolve::Resolver;
use super::select::Coarse;
use super::sight::Sight;
use super::source::SurfaceNodes;
use crate::color::Colors;
use crate::view::View;
use rayon::prelude::*;

/// Darkens the colours of a flat picture that was drawn with such options; `shown` are the depths that its samples told, if they did.
pub(crate) fn darken(
    colors: &mut Colors,
    shown: &[f32],
    (source, placed, sight): (&dyn SurfaceNodes, &Placed, &Sight),
    options: &SurfaceOptions,
) {
    let (Some(shadowing), Sight::Flat(view)) = (&options.shadowing, sight) else { return };
    let plain = SurfaceOptions { look: None, raw: false, ..options.clone() };
    let centres = |sight: &Sight| depths((source, placed, sight), &plain);
    // Samples are beside the centre, but know walls.
    let own = if options.walls.is_some() && !shown.is_empty() { shown.to_vec() } else { centres(sight) };
    shadowing.darken(view, &own, colors, &|from: &View| Some(centres(&Sight::Flat(*from))), None);
}

/// The depth at each pixel's centre, row by row, with options for pictures without colours; infinite where nothing is.
pub(crate) fn depths(
    (source, placed, sight): (&dyn SurfaceNodes, &Placed, &Sight),
    options: &SurfaceOptions,
) -> Vec<f32> {
    if let (Coarse::Means, Sight::Flat(view)) = (options.coarse, sight) {
        return means::draw(source, placed, view, &SurfaceOptions { look: None, raw: true, ..options.clone() }).depth;
    }
    if let Some(pieces) = Pieces::of(source, placed, sight, options) {
        let (raw, _) = pieces.raw(source, placed, sight, options);
        return raw.iter().map(|[depth, ..]| if depth.is_nan() { f32::INFINITY } else { *depth as f32 }).collect();
    }
    let scene = scene(source, placed, sight, options);
    let (seen, _) = visible(&scene, sight, options, 1);
    let resolver = Resolver::new(&scene, sight);
    let depth = |index: usize| {
        let place = [index % seen.width, index / seen.width].map(|at| at as f64 + 0.5);
        let hit = seen.at(index).and_then(|shown| resolver.hit(shown, place));
        hit.map_or(f32::INFINITY, |hit| hit.depth as f32)
    };
    (0..seen.width * seen.height).into_par_iter().map(depth).collect()
}
