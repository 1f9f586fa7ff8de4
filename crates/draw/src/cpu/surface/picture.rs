//! A picture of a surface, from the choice of its chunks to its colours.

use super::channels::channels;
use super::closed::Closed;
use super::coverage;
use super::darken::darken;
use super::holes::{Grown, Holes};
use super::labels::{self, ContourLabel, Letters};
use super::look::Attribute;
use super::means;
use super::photo::PhotoLook;
use super::pieces::Pieces;
use super::placed::Placed;
use super::raster::{self, Visibility};
use super::rays::Caster;
use super::resolve::CHANNELS;
use super::select::{Choice, Coarse, MOST_NODES, Primitive, SurfaceCut, Technique, UNSEEN, USUAL_TAU, choose, looked};
use super::shade::{Look, Shader};
use super::sight::Sight;
use super::source::SurfaceNodes;
use super::stitch::{Mesh, Scene};
use crate::color::Colors;
use crate::cpu::shadowing::Shadowing;
use deepfield_heights::measure::Form;
use rayon::prelude::*;
use std::f64::consts::FRAC_1_SQRT_2;
use std::sync::Arc;

/// How a surface is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceOptions {
    /// Points, triangles, rays, or what fits.
    pub technique: Technique,
    /// What coarse levels of flat pictures are; where they are means, the error, holes, walls and labels do not count, and rays are triangles.
    pub coarse: Coarse,
    /// The side of a point: samples of the picture, with [`Technique::Points`] pixels; 1 at least.
    pub point: u32,
    /// Largest error, pixels; 0: none.
    pub tau: f64,
    /// Samples of a pixel; the next square number is taken.
    pub samples: u32,
    /// Most chunks.
    pub most_nodes: usize,
    /// Whether raw channels are wanted.
    pub raw: bool,
    /// What it looks like; `None` where colours are not wanted.
    pub look: Option<Look>,
    /// What holes look like.
    pub holes: Holes,
    /// Whether holes grow with distance: coarse samples that stand for any that was not measured are left out, in raw channels, too.
    pub holes_grow: bool,
    /// The form that residuals are what is left of; without one they are heights.
    pub form: Option<Arc<Form>>,
    /// The height that walls at the field's border, and where it is cut, go down or up to; `None`: there are none.
    pub walls: Option<f64>,
    /// How it darkens itself in flat pictures.
    pub shadowing: Option<Shadowing>,
}

impl Default for SurfaceOptions {
    fn default() -> SurfaceOptions {
        let technique = Technique::default();
        SurfaceOptions {
            technique,
            coarse: Coarse::Nested,
            point: 1,
            tau: USUAL_TAU,
            samples: 4,
            most_nodes: MOST_NODES,
            raw: false,
            look: None,
            holes: Holes::Open,
            holes_grow: false,
            form: None,
            walls: None,
            shadowing: None,
        }
    }
}

/// What was drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfaceReport {
    /// The largest distance of what is drawn from where it is, pixels; infinite where a stand-in reaches the eye.
    pub error_px: f64,
    /// Whether nothing is missing.
    pub is_converged: bool,
    /// Whether it is not converged for want of room alone: then it is the same whenever it is drawn with as much.
    pub is_coarser: bool,
    /// Samples of the chunks that were drawn.
    pub samples_drawn: u64,
    /// Samples drawn as points.
    pub points: u64,
    /// Triangles drawn.
    pub triangles: u64,
    /// Chunks drawn.
    pub nodes_drawn: u64,
    /// The finest and the coarsest level drawn.
    pub levels: [u8; 2],
    /// The sum of alpha, pixels.
    pub covered: f64,
}

/// A picture of a surface.
#[derive(Clone, Debug, Default)]
pub struct SurfacePicture {
    /// Colours, where they are wanted.
    pub colors: Colors,
    /// Depth, x, y, height, row, column and coverage at pixels' centres, row by row; NaN where nothing is. Empty where not wanted.
    pub raw: Vec<[f64; CHANNELS]>,
    /// Depth at pixels' centres, row by row; infinite where nothing is. Of the first sample where only colours are wanted.
    pub depth: Vec<f32>,
    /// The heights that are written along lines, where there are letters.
    pub labels: Vec<ContourLabel>,
    /// What was drawn.
    pub report: SurfaceReport,
}

/// The chunks that a picture needs, for a view in its own pixels: as [`draw`] chooses them.
pub fn chosen(source: &dyn SurfaceNodes, placed: &Placed, sight: &Sight, options: &SurfaceOptions) -> SurfaceCut {
    let parts = if options.look.is_some() { parts(options.samples) } else { 1 };
    let choice = Choice {
        tau: options.tau * f64::from(parts),
        technique: options.technique,
        point: options.point,
        // By half a diagonal of what is more than a pixel.
        reach: FRAC_1_SQRT_2 * f64::from(options.technique.side(options.point.saturating_sub(1), parts)),
        looks: if options.look.is_some() { looked(options.tau) * f64::from(parts) } else { f64::INFINITY },
        lines: options.look.as_ref().and_then(|look| look.contours).map_or(f64::INFINITY, |lines| lines.interval),
        change: options
            .look
            .as_ref()
            .filter(|look| look.attribute == Attribute::Difference)
            .map_or(f64::INFINITY, |look| f64::from(UNSEEN) * (look.range[1] - look.range[0])),
        spans: if options.look.is_some() { options.holes.spans(placed).into_iter().fold(0.0, f64::max) } else { 0.0 },
        walls: options.walls.filter(|_| options.look.is_some() && placed.is_flat()),
        most: options.most_nodes,
    };
    let closed = Closed::of(source, placed);
    let source = closed.as_ref().map_or(source, |closed| closed as &dyn SurfaceNodes);
    choose(source, placed, &sight.refined(parts), &choice)
}

/// What a picture shows, for a view in its own pixels: chunks as [`draw`] draws them.
pub fn scene(source: &dyn SurfaceNodes, placed: &Placed, sight: &Sight, options: &SurfaceOptions) -> Scene {
    let cut = chosen(source, placed, sight, options);
    let closed = Closed::of(source, placed);
    let source = closed.as_ref().map_or(source, |closed| closed as &dyn SurfaceNodes);
    let grown = Grown(source);
    let source = if options.holes_grow { &grown } else { source };
    let mut scene = Scene::new(source, placed, cut);
    if options.look.is_some() {
        scene.close_poles();
    }
    if options.look.is_some() && matches!(options.holes, Holes::Filled(_)) {
        scene.fill(source, options.holes.spans(placed));
    }
    scene
}

/// Shades what is seen as options say.
pub(super) fn shader<'a>(plain: Shader<'a>, seen: &'a Visibility, options: &'a SurfaceOptions) -> Shader<'a> {
    dressed(plain.seeing(seen), options)
}

/// With holes, form and walls as options say.
pub(super) fn dressed<'a>(plain: Shader<'a>, options: &'a SurfaceOptions) -> Shader<'a> {
    let shader = plain.with_holes(&options.holes).without(options.form.as_deref());
    match options.walls {
        Some(base) => shader.with_walls(base),
        None => shader,
    }
}

/// Samples along a pixel's side.
pub fn parts(samples: u32) -> u32 {
    (1..8).find(|parts| parts * parts >= samples).unwrap_or(8)
}

/// Draws a surface. The picture does not depend on the number of threads.
pub fn draw(source: &dyn SurfaceNodes, placed: &Placed, sight: &Sight, options: &SurfaceOptions) -> SurfacePicture {
    draw_lettered(source, placed, sight, options, None)
}

/// As [`draw`], with heights written along lines where the look asks for them and there are letters.
pub fn draw_lettered(
    source: &dyn SurfaceNodes,
    placed: &Placed,
    sight: &Sight,
    options: &SurfaceOptions,
    letters: Option<&dyn Letters>,
) -> SurfacePicture {
    if let (Coarse::Means, Sight::Flat(view)) = (options.coarse, sight) {
        return means::draw(source, placed, view, options);
    }
    let mut picture = SurfacePicture::default();
    if let Some(look) = &options.look
        && let Some(pieces) = Pieces::of(source, placed, sight, options)
    {
        picture = pieces.colored(source, placed, sight, options, look);
        darken(&mut picture.colors, &picture.depth, (source, placed, sight), options);
    } else if let Some(look) = &options.look {
        let parts = parts(options.samples);
        let fine = sight.refined(parts);
        let scene = scene(source, placed, sight, options);
        let (seen, counts) = visible(&scene, &fine, options, parts);
        picture.report = report(&scene, counts, f64::from(parts));
        let [width, height] = sight.size();
        let photo = PhotoLook::of(source, look, placed);
        let size = [width as usize, height as usize];
        let mut shader = shader(Shader::new(&scene, &fine, look, photo, parts), &seen, options);
        let labelled = look.contours.and_then(|contours| Some((contours, contours.labels?, letters?)));
        if let Some((contours, em, letters)) = &labelled {
            picture.labels = labels::place(shader.resolver(), &seen, parts, (contours, *em), *letters);
            picture.labels.retain(|label| !shader.is_behind_wall(label));
            shader = shader.sparing(size[0], labels::spared(&picture.labels, size));
        }
        let (rgba, [depth, covered]) = shader.shade(&seen, size);
        let mut colors = Colors { width, height, rgba };
        darken(&mut colors, &depth, (source, placed, sight), options);
        if let Some((contours, _, letters)) = &labelled {
            labels::paint(&mut colors.rgba, size, &picture.labels, contours, *letters);
        }
        picture.report.covered = covered.into_iter().map(f64::from).sum();
        picture.colors = colors;
        picture.depth = depth;
    }
    if options.raw {
        // Raw channels are of the pixels' centres, and so drawn with one sample a pixel.
        let choice = SurfaceOptions { look: None, ..options.clone() };
        let (raw, report) = match Pieces::of(source, placed, sight, &choice) {
            Some(pieces) => pieces.raw(source, placed, sight, &choice),
            None => {
                let scene = scene(source, placed, sight, &choice);
                let (seen, counts) = visible(&scene, sight, options, 1);
                (channels(&scene, sight, &seen), report(&scene, counts, 1.0))
            }
        };
        picture.add_channels(raw, report);
    }
    picture
}

/// What is seen in each sample of a picture with `parts` of them along a pixel's side, and how many samples, points and triangles were drawn.
/// Points are `options.point` samples wide where they are drawn since they leave no gap so, and else as many pixels. What coarse samples stand
/// for beside their triangles is behind all else.
pub(crate) fn visible(scene: &Scene, sight: &Sight, options: &SurfaceOptions, parts: u32) -> (Visibility, [u64; 3]) {
    let seen = Visibility::new(sight.size());
    let counts = match sight {
        Sight::Flat(view) if options.technique != Technique::Rays => {
            raster::draw(scene, view, &seen, [options.technique.side(options.point, parts), parts])
        }
        _ => {
            Caster::new(scene).draw(sight, &seen);
            let points = raster::draw_lone(scene, sight, &seen, parts);
            if let Sight::Flat(view) = sight {
                raster::draw_poles(scene, view, &seen);
            }
            let samples = scene.meshes.iter().map(|mesh| mesh.samples.heights.len() as u64).sum();
            [samples, points, 0]
        }
    };
    coverage::draw_margins(scene, sight, &seen);
    (seen, counts)
}

/// How many samples, points and triangles a scene's chunks are, as they are drawn.
pub fn counted(scene: &Scene) -> [u64; 3] {
    let of = |mesh: &Mesh| {
        let (rows, columns) = (mesh.samples.rows, mesh.samples.columns);
        let is_points = mesh.node.primitive == Primitive::Points;
        let has_holes = !mesh.samples.coverage.is_empty();
        if !has_holes && !is_points {
            return [rows * columns, 0, 2 * (rows - 1) * (columns - 1)].map(|count| count as u64);
        }
        let samples = || (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column)));
        let is_point = |&(row, column): &(usize, usize)| {
            is_points && !mesh.is_on_laid(row, column) && !mesh.height(row * columns + column).is_nan()
                || mesh.is_lone(row, column)
        };
        let cells = samples().filter(|(row, column)| row + 1 < rows && column + 1 < columns);
        let drawn = cells.filter(|(row, column)| !is_points || mesh.is_strip(*row, *column));
        let triangles = drawn.map(|(row, column)| mesh.cell(row, column).triangles().count()).sum();
        [rows * columns, samples().filter(is_point).count(), triangles].map(|count| count as u64)
    };
    scene.meshes.par_iter().map(of).reduce(|| [0; 3], |a, b| std::array::from_fn(|k| a[k] + b[k]))
}

/// What is said of a scene of which so many samples, points and triangles were drawn, whose error is in parts of pixels.
pub fn report(scene: &Scene, counts: [u64; 3], parts: f64) -> SurfaceReport {
    reported(&scene.cut, counts, parts)
}

/// The same of the chunks of a scene.
pub(super) fn reported(cut: &SurfaceCut, [samples_drawn, points, triangles]: [u64; 3], parts: f64) -> SurfaceReport {
    let nodes = &cut.nodes;
    let error = nodes.iter().map(|node| node.error_px).fold(0.0, f64::max);
    let level = |pick: fn(u8, u8) -> u8, first: u8| nodes.iter().map(|node| node.key.level).fold(first, pick);
    SurfaceReport {
        error_px: error / parts,
        is_converged: cut.is_converged,
        is_coarser: cut.is_coarser,
        samples_drawn,
        points,
        triangles,
        nodes_drawn: nodes.len() as u64,
        levels: if nodes.is_empty() { [0; 2] } else { [level(u8::min, u8::MAX), level(u8::max, 0)] },
        covered: 0.0,
    }
}
