//! Surfaces among other things: what each pixel shows of them, each part of it at its own depth.
//!
//! Surfaces hide each other sample by sample, so that where two of them cross each has its share of the pixel. A pixel's samples become
//! fragments: those that are about as deep are one. A fragment's opacity is the share of the pixel's area that it covers, of the area that those
//! in front of it leave. So all fragments together are the mean of the samples, and what lies between two of them is seen in the share of the
//! area that the front ones leave: an edge is as smooth before a star as before the dark.

use super::photo::PhotoLook;
use super::picture::{self, SurfaceOptions, SurfaceReport, counted, parts, report, visible};
use super::placed::Placed;
use super::raster::Visibility;
use super::shade::{ENDS, Shader};
use super::sight::Sight;
use super::source::SurfaceNodes;
use super::stitch::Scene;
use crate::cpu::paths::fragments::TileFragments;
use crate::cpu::paths::{PathFragment, PathFragments};
use rayon::prelude::*;
use std::sync::Arc;

/// Pixels along the side of what one task does.
const SIDE: usize = 32;
/// Samples whose depths differ by less than so many pixels' widths are one fragment.
const APART: f64 = 3.0;
/// A pixel that is covered but for this share is covered.
const COVERED: f32 = 1e-5;

/// A surface of a picture.
#[derive(Clone, Copy)]
pub struct Layer<'a> {
    /// Its chunks.
    pub source: &'a dyn SurfaceNodes,
    /// Where it is in its own world.
    pub placed: &'a Placed,
    /// Who looks, in its own world.
    pub sight: &'a Sight,
    /// How it is drawn; its samples are those of all surfaces of the picture.
    pub options: &'a SurfaceOptions,
    /// Lengths of the picture for one of its own.
    pub scale: f64,
}

/// What a sample shows.
struct Part {
    /// Lengths of the picture.
    depth: f64,
    /// Linear light, of its share of the pixel.
    light: [f32; 3],
    /// Share of the pixel.
    share: f32,
}

/// A surface whose samples are known.
struct Shaded<'a> {
    shader: Shader<'a>,
    seen: &'a Visibility,
    scale: f64,
}

/// What each pixel shows of surfaces that have colours, and what was drawn. Pictures of one size; they do not depend on the number of threads.
pub fn fragments(layers: &[Layer<'_>]) -> (PathFragments, SurfaceReport) {
    fragments_found(layers, &|_, _| None)
}

/// The same where something else may find what is seen: what each sample of a picture, whose pixels are these samples, shows of a scene; the
/// processor finds it where that is `None`.
pub fn fragments_found(
    layers: &[Layer<'_>],
    find: &dyn Fn(&Arc<Scene>, &Sight) -> Option<Visibility>,
) -> (PathFragments, SurfaceReport) {
    let layers: Vec<&Layer<'_>> = layers.iter().filter(|layer| layer.options.look.is_some()).collect();
    let mut whole = SurfaceReport { is_converged: true, ..SurfaceReport::default() };
    let Some(first) = layers.first() else { return (PathFragments::default(), whole) };
    let parts = parts(first.options.samples);
    let [width, height] = first.sight.size().map(|pixels| pixels as usize);
    let drawn: Vec<(Arc<Scene>, Sight, Visibility)> = layers
        .iter()
        .map(|layer| {
            let scene = Arc::new(picture::scene(layer.source, layer.placed, layer.sight, layer.options));
            let fine = layer.sight.refined(parts);
            let (seen, counts) = match find(&scene, &fine) {
                Some(seen) => (seen, counted(&scene)),
                None => visible(&scene, &fine, layer.options, parts),
            };
            whole.add(&report(&scene, counts, f64::from(parts)));
            (scene, fine, seen)
        })
        .collect();
    let shaded: Vec<Shaded<'_>> = layers
        .iter()
        .zip(&drawn)
        .filter_map(|(layer, (scene, fine, seen))| {
            let look = layer.options.look.as_ref()?;
            let photo = PhotoLook::of(layer.source, look, layer.placed);
            let shader = picture::shader(Shader::new(scene, fine, look, photo, parts), seen, layer.options);
            Some(Shaded { shader, seen, scale: layer.scale })
        })
        .collect();
    shaded.iter().for_each(|one| one.shader.prepare_rays(one.seen));
    // A length of 1 at depth 1, in the picture's pixels.
    let pixel = 1.0 / first.sight.pixels_at(1.0);
    let is_flat = matches!(first.sight, Sight::Flat(view) if matches!(view.projection, crate::view::Projection::Orthographic { .. }));
    let together = |depth: f64| APART * pixel * if is_flat { first.scale } else { depth };
    let across = width.div_ceil(SIDE);
    let tile = |index: usize| {
        let (left, top) = (index % across * SIDE, index / across * SIDE);
        let mut tile = TileFragments { starts: vec![0], fragments: Vec::new() };
        let (mut samples, mut hits) = (Vec::new(), Vec::new());
        let mut covered = 0.0;
        for y in top..(top + SIDE).min(height) {
            for x in left..(left + SIDE).min(width) {
                covered += pixel_parts(&shaded, parts as usize, [x, y], &mut samples, &mut hits);
                gather(&mut samples, together, &mut tile.fragments);
                tile.starts.push(tile.fragments.len() as u32);
            }
        }
        (tile, covered)
    };
    let (tiles, covered): (Vec<TileFragments>, Vec<f64>) =
        (0..across * height.div_ceil(SIDE)).into_par_iter().map(tile).unzip();
    whole.covered = covered.iter().sum();
    (PathFragments { size: [width, height], side: SIDE, tiles, is_hazy: false }, whole)
}

/// What the samples of a pixel show of all surfaces, in any order, and how much of it is covered by what was measured.
fn pixel_parts(
    shaded: &[Shaded<'_>],
    parts: usize,
    [x, y]: [usize; 2],
    out: &mut Vec<Part>,
    hits: &mut Vec<(f64, [f32; 4], f32)>,
) -> f64 {
    out.clear();
    let mut covered = 0.0;
    let corner = [x * parts, y * parts];
    // Where a surface ends more rays say how much of a pixel it covers, as alone.
    let is_end = parts > 1 && shaded.iter().any(|one| one.shader.is_end(one.seen, corner));
    let side = if is_end { ENDS as usize } else { parts };
    let step = parts as f64 / side as f64;
    let share = 1.0 / (side * side) as f32;
    for (i, j) in (0..side).flat_map(|j| (0..side).map(move |i| (i, j))) {
        let place = [corner[0] as f64 + (i as f64 + 0.5) * step, corner[1] as f64 + (j as f64 + 0.5) * step];
        hits.clear();
        for one in shaded {
            let Shader { resolver, .. } = &one.shader;
            let (hit, place) = match is_end && resolver.scene.placed.is_flat() {
                true => (resolver.cast(place), place),
                false => {
                    let [x, y] = place.map(|at| at as usize);
                    let middle = [x as f64 + 0.5, y as f64 + 0.5];
                    let shown = one.seen.at(y * one.seen.width + x);
                    (shown.and_then(|shown| resolver.look(shown, middle)), middle)
                }
            };
            if let Some((color, depth, measured)) = one.shader.sample(hit.as_ref(), place) {
                hits.push((depth * one.scale, color, measured));
            }
        }
        hits.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut through = share;
        for &(depth, [r, g, b, alpha], measured) in &*hits {
            covered += f64::from(measured * through);
            out.push(Part { depth, light: [r, g, b].map(|light| light * through), share: alpha * through });
            through *= 1.0 - alpha;
        }
    }
    covered
}

/// Makes fragments of the parts of a pixel: of those that are `together`, in lengths at a depth, one.
fn gather(parts: &mut [Part], together: impl Fn(f64) -> f64, out: &mut Vec<PathFragment>) {
    parts.sort_by(|a, b| a.depth.total_cmp(&b.depth));
    let mut left = 1.0_f32;
    let mut rest = &*parts;
    while let [first, ..] = rest {
        let end = first.depth + together(first.depth);
        let (own, others) = rest.split_at(rest.partition_point(|part| part.depth <= end).max(1));
        rest = others;
        let (mut share, mut depth, mut light) = (0.0_f32, 0.0_f64, [0.0_f32; 3]);
        for part in own {
            share += part.share;
            depth += f64::from(part.share) * part.depth;
            light.iter_mut().zip(part.light).for_each(|(sum, light)| *sum += light);
        }
        if share <= 0.0 || left <= 0.0 {
            continue;
        }
        let alpha = if left - share < COVERED { 1.0 } else { share / left };
        let depth = (depth / f64::from(share)) as f32;
        out.push(PathFragment { depth, color: light.map(|light| light / share), alpha });
        left -= share;
    }
}

impl SurfaceReport {
    /// Whether what could be read of it is all that there is room for.
    pub fn is_whole(&self) -> bool {
        self.is_converged || self.is_coarser
    }

    /// Both keep within what is told then.
    pub fn bound(&mut self, other: &SurfaceReport) {
        let is_whole = self.is_whole() && other.is_whole();
        self.error_px = self.error_px.max(other.error_px);
        self.is_converged &= other.is_converged;
        self.is_coarser = is_whole && !self.is_converged;
    }

    /// Adds what was drawn of another surface, or of another part of the picture.
    pub fn add(&mut self, other: &SurfaceReport) {
        let is_first = self.nodes_drawn == 0;
        self.bound(other);
        self.samples_drawn += other.samples_drawn;
        self.points += other.points;
        self.triangles += other.triangles;
        self.nodes_drawn += other.nodes_drawn;
        self.covered += other.covered;
        let [finest, coarsest] = self.levels;
        self.levels = match (is_first, other.nodes_drawn) {
            (_, 0) => self.levels,
            (true, _) => other.levels,
            (false, _) => [finest.min(other.levels[0]), coarsest.max(other.levels[1])],
        };
    }
}
