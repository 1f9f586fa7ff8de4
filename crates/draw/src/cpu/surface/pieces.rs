//! Pictures without error of more chunks than there is room for: drawn piece by piece, each with the chunks that it shows, and to the bit as if all had
//! been there.
//!
//! Chunks are chosen for the whole picture, by what is known of them without their samples. A piece has those that may be seen in it or next to it
//! (where lines of equal height and ends of the surface look), in the order that they have in the whole; and of other levels those that they
//! touch, and whatever coarser ones these touch in turn: what these make of a shared border is what all of them do. So in each pixel of a piece the same
//! triangle is nearest. Pictures that look at all of the surface at once are drawn whole: with labels, membranes, rims and walls, of globes, in
//! all directions, and by rays.

use super::channels::channels_of;
use super::holes::{Grown, Holes};
use super::photo::PhotoLook;
use super::picture::{SurfaceOptions, SurfacePicture, SurfaceReport, chosen, parts, reported, shader, visible};
use super::placed::Placed;
use super::resolve::{CHANNELS, NOTHING};
use super::select::{SurfaceCut, Technique};
use super::shade::{Look, Shader};
use super::sight::Sight;
use super::source::SurfaceNodes;
use super::stitch::Scene;
use crate::color::Colors;
use crate::view::View;
use deepfield_heights::hierarchy::chunks::{ChunkKey, Lattice};
use std::collections::BTreeSet;
use std::ops::Range;

/// Pixels about a piece that are looked at from it, and how many widths of a line of equal height.
const BESIDE: f64 = 8.0;
const WIDTHS: f64 = 8.0;
/// Pieces of as many pixels a side, or fewer, are drawn with whatever they show.
const LEAST: usize = 16;

/// A piece of a picture.
struct Piece {
    /// Its columns and rows of pixels.
    pixels: [Range<usize>; 2],
    /// The chunks that it is drawn with.
    cut: SurfaceCut,
}

/// The pieces of a picture, and what is drawn in all of them.
pub(super) struct Pieces {
    /// The chunks of the whole.
    cut: SurfaceCut,
    /// They fill the picture.
    pieces: Vec<Piece>,
}

/// What of the pieces was drawn.
#[derive(Clone, Copy)]
struct Drawn {
    /// Samples, points and triangles: those of a chunk that several pieces show count for each of them.
    counts: [u64; 3],
    /// Whether all samples were there.
    is_all: bool,
}

impl Drawn {
    const NOTHING: Drawn = Drawn { counts: [0; 3], is_all: true };

    fn add(&mut self, scene: &Scene, counts: [u64; 3]) {
        (0..3).for_each(|k| self.counts[k] += counts[k]);
        self.is_all &= scene.cut.is_converged || scene.cut.is_coarser;
    }
}

/// A picture that is divided.
struct Whole<'a> {
    source: &'a dyn SurfaceNodes,
    lattice: Lattice,
    view: &'a View,
    cut: &'a SurfaceCut,
    /// Of each chunk the chunks of other levels that it touches.
    touching: Vec<Vec<usize>>,
    /// Pixels about a piece.
    beside: f64,
}

impl Pieces {
    /// The pieces of a picture that allows no error and whose chunks have no room together; `None` of any other.
    pub(super) fn of(
        source: &dyn SurfaceNodes,
        placed: &Placed,
        sight: &Sight,
        options: &SurfaceOptions,
    ) -> Option<Pieces> {
        let Sight::Flat(view) = sight else { return None };
        let lines = options.look.as_ref().and_then(|look| look.contours);
        let is_local = options.technique != Technique::Rays
            && options.holes == Holes::Open
            && options.walls.is_none()
            && lines.is_none_or(|lines| lines.labels.is_none());
        if options.tau > 0.0 || !placed.is_flat() || !is_local || source.room() == u64::MAX {
            return None;
        }
        let cut = chosen(source, placed, sight, options);
        let lattice = source.lattice();
        let touching = (0..cut.nodes.len()).map(|number| touching(&cut, &lattice, number)).collect();
        let beside = BESIDE + f64::from(options.point) + WIDTHS * lines.map_or(0.0, |lines| lines.width);
        let mut pieces = Vec::new();
        let all = [0..view.width as usize, 0..view.height as usize];
        Whole { source, lattice, view, cut: &cut, touching, beside }.divide(all, &mut pieces);
        (pieces.len() > 1).then_some(Pieces { cut, pieces })
    }

    /// The picture in colours.
    pub(super) fn colored(
        &self,
        source: &dyn SurfaceNodes,
        placed: &Placed,
        sight: &Sight,
        options: &SurfaceOptions,
        look: &Look,
    ) -> SurfacePicture {
        let parts = parts(options.samples);
        let (fine, [width, height]) = (sight.refined(parts), sight.size());
        let (columns, count) = (width as usize, width as usize * height as usize);
        let (mut rgba, mut depth, mut covered) = (vec![[0.0; 4]; count], vec![0.0; count], vec![0.0_f32; count]);
        let mut drawn = Drawn::NOTHING;
        for piece in &self.pieces {
            let scene = piece.scene(source, placed, options);
            let (seen, counts) = visible(&scene, &fine, options, parts);
            let photo = PhotoLook::of(source, look, placed);
            let shader = shader(Shader::new(&scene, &fine, look, photo, parts), &seen, options);
            let (colors, [depths, shares]) = shader.shade_part(&seen, &piece.pixels);
            piece.put(&colors, columns, &mut rgba);
            piece.put(&depths, columns, &mut depth);
            piece.put(&shares, columns, &mut covered);
            drawn.add(&scene, counts);
        }
        let covered = covered.into_iter().map(f64::from).sum();
        let report = SurfaceReport { covered, ..self.report(&drawn, f64::from(parts)) };
        SurfacePicture { colors: Colors { width, height, rgba }, depth, report, ..SurfacePicture::default() }
    }

    /// Raw channels at pixels' centres.
    pub(super) fn raw(
        &self,
        source: &dyn SurfaceNodes,
        placed: &Placed,
        sight: &Sight,
        options: &SurfaceOptions,
    ) -> (Vec<[f64; CHANNELS]>, SurfaceReport) {
        let [columns, rows] = sight.size().map(|size| size as usize);
        let (mut raw, mut drawn) = (vec![NOTHING; columns * rows], Drawn::NOTHING);
        for piece in &self.pieces {
            let scene = piece.scene(source, placed, options);
            let (seen, counts) = visible(&scene, sight, options, 1);
            piece.put(&channels_of(&scene, sight, &seen, &piece.pixels), columns, &mut raw);
            drawn.add(&scene, counts);
        }
        (raw, self.report(&drawn, 1.0))
    }

    fn report(&self, drawn: &Drawn, parts: f64) -> SurfaceReport {
        let report = reported(&self.cut, drawn.counts, parts);
        let (is_converged, is_coarser) = (report.is_converged && drawn.is_all, report.is_coarser && drawn.is_all);
        SurfaceReport { is_converged, is_coarser, ..report }
    }
}

impl Piece {
    /// What is drawn of it, and around it.
    fn scene(&self, source: &dyn SurfaceNodes, placed: &Placed, options: &SurfaceOptions) -> Scene {
        let grown = Grown(source);
        let source = if options.holes_grow { &grown } else { source };
        Scene::new(source, placed, self.cut.clone())
    }

    /// Puts values of its pixels, row by row, where they are in a picture of so many columns.
    fn put<T: Copy>(&self, values: &[T], columns: usize, out: &mut [T]) {
        let [across, down] = &self.pixels;
        for (row, values) in down.clone().zip(values.chunks(across.len().max(1))) {
            out[row * columns + across.start..row * columns + across.end].copy_from_slice(values);
        }
    }
}

impl Whole<'_> {
    /// Divides pixels until the chunks of each piece have room.
    fn divide(&self, pixels: [Range<usize>; 2], out: &mut Vec<Piece>) {
        let numbers = self.numbers(&pixels);
        let sizes = [pixels[0].len(), pixels[1].len()];
        if self.bytes(&numbers) <= self.source.room() || sizes.into_iter().all(|size| size <= LEAST) {
            let kept: BTreeSet<ChunkKey> = numbers.into_iter().map(|number| self.cut.nodes[number].key).collect();
            out.push(Piece { pixels, cut: self.cut.clone().without(|key| !kept.contains(key)) });
            return;
        }
        let axis = usize::from(sizes[1] >= sizes[0]);
        let middle = pixels[axis].start + sizes[axis] / 2;
        let (mut first, mut second) = (pixels.clone(), pixels);
        (first[axis].end, second[axis].start) = (middle, middle);
        self.divide(first, out);
        self.divide(second, out);
    }

    /// The chunks that pixels are drawn with.
    fn numbers(&self, [columns, rows]: &[Range<usize>; 2]) -> BTreeSet<usize> {
        let corner = [columns.start, rows.start].map(|at| at as f64 - self.beside);
        let [width, height] = [columns, rows].map(|pixels| (pixels.len() as f64 + 2.0 * self.beside).ceil() as u32);
        let part = self.view.part(corner, width, height);
        let nodes = &self.cut.nodes;
        let seen: Vec<usize> = (0..nodes.len()).filter(|number| part.sees(&nodes[*number].extent)).collect();
        let mut waiting: Vec<usize> = seen.iter().flat_map(|number| &self.touching[*number]).copied().collect();
        let mut found: BTreeSet<usize> = seen.into_iter().collect();
        while let Some(number) = waiting.pop() {
            if found.insert(number) {
                let level = nodes[number].key.level;
                waiting.extend(self.touching[number].iter().filter(|other| nodes[**other].key.level > level));
            }
        }
        found
    }

    /// About how many bytes their samples take, with those of the chunks that they lie in.
    fn bytes(&self, numbers: &BTreeSet<usize>) -> u64 {
        let keys = numbers.iter().map(|number| self.cut.nodes[*number].key);
        let all: BTreeSet<ChunkKey> =
            keys.flat_map(|key| (key.level..=self.lattice.top()).map(move |level| key.ancestor(level))).collect();
        all.into_iter().map(|key| self.source.bytes(key)).sum()
    }
}

/// The chunks of other levels that touch one, at its corners, too.
fn touching(cut: &SurfaceCut, lattice: &Lattice, number: usize) -> Vec<usize> {
    let key = cut.nodes[number].key;
    let [rows, columns] = lattice.rectangle(key);
    // From just before the chunk to just after it, in steps of the least chunks.
    let places = |[first, last]: [u64; 2]| {
        let inside = (first..last).step_by(lattice.side() as usize);
        first.checked_sub(1).into_iter().chain(inside).chain([last])
    };
    let mut found = BTreeSet::new();
    for row in places(rows) {
        let is_beside = !(rows[0]..rows[1]).contains(&row);
        for column in places(columns).filter(|column| is_beside || !(columns[0]..columns[1]).contains(column)) {
            found.extend(cut.at(row, column).filter(|other| cut.nodes[*other].key.level != key.level));
        }
    }
    found.into_iter().collect()
}

#[cfg(test)]
mod tests;
