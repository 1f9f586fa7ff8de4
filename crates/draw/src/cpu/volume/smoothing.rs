//! Smoothing of isosurfaces in a picture (F12 5.11 proposes it, after van der Laan, Green and Sainz 2009): where particles
//! make a surface bumpy, the directions that it faces flow towards those around until what is left are the larger forms.
//!
//! As in their paper it is done in screen space, by steps in which every pixel goes part of the way to the mean of its
//! neighbours, so that what is curved most moves most, and silhouettes end it. Here the directions flow and not the
//! depths: the surface stays where it is, and so does its outline. Of several surfaces in a pixel it is the one that adds
//! most.

use super::raycast::Rays;
use super::surface::Light;
use crate::view::PerspectiveGrid;
use rayon::prelude::*;

/// Share of the way to the mean of its neighbours that a direction goes in a step.
pub const STEP: f32 = 0.8;

/// How far a neighbour may lie from the plane of a pixel's surface, as a share of a pixel's width, or behind a silhouette.
pub const APART: f32 = 1.0;

/// The surface that adds most to a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Face {
    /// Its depth, world units.
    pub depth: f32,
    /// Which way the field rises, camera axes, of any length.
    pub slope: [f32; 3],
    /// The way from the eye, camera axes, to depth 1.
    pub line: [f32; 3],
    /// Its colour, linear light, as it is before light.
    pub color: [f32; 3],
    /// The share of the pixel that it is; 0 for none.
    pub share: f32,
}

impl Face {
    /// Takes another one of the same pixel where that adds more.
    pub fn offer(&mut self, other: Face) {
        if other.share > self.share {
            *self = other;
        }
    }
}

impl Rays {
    /// The same that keep which surface adds most to each.
    #[must_use]
    pub fn with_faces(mut self) -> Rays {
        self.tiles.iter_mut().for_each(|tile| tile.faces = vec![Face::default(); tile.rays.len()]);
        self
    }

    /// For each pixel of a picture of this size, row by row, the surface that adds most to it, where that is kept.
    pub fn faces(&self, width: usize, height: usize) -> Vec<Face> {
        let mut out = vec![Face::default(); width * height];
        for tile in &self.tiles {
            let across = tile.columns[1] - tile.columns[0];
            for (row, faces) in (tile.rows[0]..tile.rows[1]).zip(tile.faces.chunks(across.max(1))) {
                let start = row * width + tile.columns[0];
                out[start..start + across].copy_from_slice(faces);
            }
        }
        out
    }
}

/// How many pixels away what changes a direction is in so many steps: all that is farther adds less than 3e-3 of it.
pub fn reach(steps: u32) -> u32 {
    // A step spreads a direction over its neighbours, of which half are along each axis: three standard deviations.
    let deviation = (0.5 * f64::from(STEP) * f64::from(steps)).sqrt();
    steps.min((3.0 * deviation).ceil() as u32)
}

/// The cosine between a slope and a ray; 1 where there is no slope.
pub fn cosine([x, y, z]: [f32; 3], ray: [f32; 3]) -> f32 {
    let length = (x * x + y * y + z * z).sqrt();
    let along = (x * ray[0] + y * ray[1] + z * ray[2]) / ray.iter().map(|c| c * c).sum::<f32>().sqrt();
    if length > 0.0 { along / length } else { 1.0 }
}

/// Smoothes the light on the surfaces of a picture of this width, whose pixels are red, green, blue and opacity.
pub fn smooth(rgba: &mut [[f32; 4]], faces: &[Face], width: usize, grid: &PerspectiveGrid, light: &Light, steps: u32) {
    if width == 0 || faces.len() != rgba.len() {
        return;
    }
    // A pixel's width: at depth 1 where lines of sight diverge.
    let pixel = (grid.sigma / grid.cell) as f32;
    let places: Vec<Place> =
        faces.par_iter().enumerate().map(|(at, face)| Place::of(face, at, width, pixel, grid)).collect();
    let joined: Vec<[bool; 2]> = (0..faces.len())
        .into_par_iter()
        .map(|at| {
            [(at % width + 1 < width).then_some(at + 1), Some(at + width)]
                .map(|next| next.and_then(|next| places.get(next)).is_some_and(|next| places[at].meets(next)))
        })
        .collect();
    let mut normals: Vec<[f32; 3]> = places.iter().map(|place| place.normal).collect();
    let mut moved = normals.clone();
    for _ in 0..steps {
        moved.par_iter_mut().enumerate().for_each(|(at, to)| *to = stepped(&normals, &joined, at, width));
        std::mem::swap(&mut normals, &mut moved);
    }
    rgba.par_iter_mut().zip(faces).zip(&normals).for_each(|((pixel, face), &normal)| {
        if face.share > 0.0 {
            let before = light.shade(face.color, cosine(face.slope, face.line));
            let after = light.shade(face.color, cosine(normal, face.line));
            for (sum, (before, after)) in pixel.iter_mut().zip(before.into_iter().zip(after)) {
                *sum = (*sum + face.share * (after - before)).max(0.0);
            }
        }
    });
}

/// Where a pixel's surface lies and which way it faces.
#[derive(Clone, Copy)]
struct Place {
    at: [f32; 3],
    /// Away from the eye, of length 1; 0 where there is no surface.
    normal: [f32; 3],
    /// A pixel's width there, world units.
    pixel: f32,
}

impl Place {
    fn of(face: &Face, index: usize, width: usize, pixel: f32, grid: &PerspectiveGrid) -> Place {
        let Face { depth, slope, line, share, .. } = *face;
        let [x, y] = [index % width, index / width].map(|pixels| pixels as f32 * pixel);
        let (at, pixel) = match grid.perspective {
            true => (line.map(|c| c * depth), pixel * depth),
            false => ([x, -y, depth], pixel),
        };
        let along: f32 = slope.iter().zip(line).map(|(a, b)| a * b).sum();
        let length = slope.iter().map(|c| c * c).sum::<f32>().sqrt();
        // Surfaces are lit on both sides.
        let scale = if share > 0.0 && length > 0.0 { 1.0_f32.copysign(along) / length } else { 0.0 };
        Place { at, normal: slope.map(|c| c * scale), pixel }
    }

    /// Whether both are of one surface: each lies near the plane of the other.
    fn meets(&self, other: &Place) -> bool {
        let way = [0, 1, 2].map(|axis| other.at[axis] - self.at[axis]);
        let most = APART * self.pixel.min(other.pixel);
        [self.normal, other.normal].iter().all(|normal| {
            let apart: f32 = normal.iter().zip(way).map(|(a, b)| a * b).sum();
            *normal != [0.0; 3] && apart.abs() <= most
        })
    }
}

/// The direction of a pixel after a step.
fn stepped(normals: &[[f32; 3]], joined: &[[bool; 2]], at: usize, width: usize) -> [f32; 3] {
    let own = normals[at];
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    let mut add = |other: usize| {
        sum = [0, 1, 2].map(|axis| sum[axis] + normals[other][axis]);
        count += 1.0;
    };
    let [right, below] = joined[at];
    if right {
        add(at + 1);
    }
    if below {
        add(at + width);
    }
    if !at.is_multiple_of(width) && joined[at - 1][0] {
        add(at - 1);
    }
    if at >= width && joined[at - width][1] {
        add(at - width);
    }
    if count == 0.0 {
        return own;
    }
    let flown = [0, 1, 2].map(|axis| own[axis] + STEP * (sum[axis] / count - own[axis]));
    let length = flown.iter().map(|c| c * c).sum::<f32>().sqrt();
    if length > 0.0 { flown.map(|c| c / length) } else { own }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

    use super::super::VolumeOptions;
    use super::super::raycast::Scenery;
    use super::super::surface::Surface;
    use super::super::tests::{Cloud, RAMP, draw, look, scenery};
    use super::*;
    use crate::model::Kernel;
    use crate::view::Projection;
    use crate::view::perspective_grid::GridOptions;
    use glam::DVec3;

    const LIGHT: Light = Light { ambient: 0.0, specular: 0.0, shininess: 1.0 };

    /// Pixels of an orthographic view of two planes, the right one far behind, with noise on their slopes.
    fn planes(width: usize, height: usize) -> (PerspectiveGrid, Vec<Face>, Vec<[f32; 4]>) {
        let grid = PerspectiveGrid {
            size: [width as u32, height as u32, 10],
            near: 1.0,
            far: 9.0,
            sigma: 0.1,
            cell: 1.0,
            middle: [0.5 * width as f64, 0.5 * height as f64],
            perspective: false,
        };
        let mut state = 1_u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 - 0.5
        };
        let faces: Vec<Face> = (0..width * height)
            .map(|at| {
                let is_left = at % width < width / 2;
                // The left plane is tilted, and its depths are those of its slope; it is red.
                let tilt = if is_left { [-0.6, 0.0, 0.8] } else { [0.0, 0.0, 1.0] };
                let depth = if is_left { 2.0 + 0.075 * (at % width) as f32 } else { 8.0 };
                let slope = tilt.map(|c| 3.0 * (c + 0.3 * noise()));
                let color = if is_left { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
                Face { depth, slope, line: [0.0, 0.0, 1.0], color, share: 1.0 }
            })
            .collect();
        let lit = |face: &Face| {
            let [r, g, b] = LIGHT.shade(face.color, cosine(face.slope, face.line));
            [r, g, b, 1.0]
        };
        let rgba = faces.iter().map(lit).collect();
        (grid, faces, rgba)
    }

    #[test]
    fn light_becomes_that_of_the_planes_up_to_the_silhouette() {
        let (width, height) = (40, 30);
        let (grid, mut faces, before) = planes(width, height);
        let mut rgba = before.clone();
        smooth(&mut rgba, &faces, width, &grid, &LIGHT, 40);
        let off = |rgba: &[[f32; 4]]| {
            let of = |(at, pixel): (usize, &[f32; 4])| match at % width < width / 2 {
                true => f64::from(pixel[0] - 0.8).powi(2),
                false => f64::from(pixel[1] - 1.0).powi(2),
            };
            (rgba.iter().enumerate().map(of).sum::<f64>() / rgba.len() as f64).sqrt()
        };
        assert!(off(&rgba) < 0.2 * off(&before), "{} {}", off(&rgba), off(&before));
        // Nothing goes from one plane to the other, and opacities stay.
        for (at, pixel) in rgba.iter().enumerate() {
            let other = if at % width < width / 2 { pixel[1] } else { pixel[0] };
            assert_eq!((other, pixel[2], pixel[3]), (0.0, 0.0, 1.0));
        }
        // No steps, or no surface, change nothing.
        let mut none = before.clone();
        smooth(&mut none, &faces, width, &grid, &LIGHT, 0);
        let close = |a: &[f32; 4], b: &[f32; 4]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(none.iter().zip(&before).all(|(none, before)| close(none, before)));
        faces.fill(Face::default());
        let mut empty = before.clone();
        smooth(&mut empty, &faces, width, &grid, &LIGHT, 40);
        assert_eq!(empty, before);
    }

    #[test]
    fn what_is_farther_than_the_reach_adds_next_to_nothing() {
        let (width, height, first, steps) = (80, 24, 20, 40);
        let (grid, faces, before) = planes(width, height);
        let mut whole = before.clone();
        smooth(&mut whole, &faces, width, &grid, &LIGHT, steps);
        // How much the light differs where the picture begins so many pixels before.
        let off = |margin: usize| {
            let skipped = first - margin;
            let faces: Vec<Face> = faces.chunks(width).flat_map(|row| row[skipped..].iter().copied()).collect();
            let mut part: Vec<[f32; 4]> = before.chunks(width).flat_map(|row| row[skipped..].iter().copied()).collect();
            smooth(&mut part, &faces, width - skipped, &grid, &LIGHT, steps);
            let found = part.chunks(width - skipped).flat_map(|row| &row[margin..]);
            let expected = whole.chunks(width).flat_map(|row| &row[first..]);
            found.zip(expected).map(|(found, expected)| (found[0] - expected[0]).abs()).fold(0.0, f32::max)
        };
        let (near, far) = (off(1), off(reach(steps) as usize));
        assert!(far < 5e-4 && near > 2e-3, "{near} {far}");
        assert_eq!([0, 1, 3].map(reach), [0, 1, 3]);
    }

    #[test]
    fn a_ball_looks_like_a_ball() {
        let mut cloud = Cloud::default();
        cloud.push([0.0; 3], 1.0, 1.0, 1.0);
        let value = 0.5 * Kernel::CubicSpline.value(0.0) as f32;
        let surface = Surface { value, color: Some([1.0; 3]), opacity: 1.0 };
        let plain = scenery(RAMP, [1e-2, 10.0], 1.0, vec![surface]);
        let scenery = Scenery { volume: false, light: Some(LIGHT), ..plain };
        for projection in [Projection::Orthographic { height: 1.6 }, Projection::Perspective { fov_y: 0.5 }] {
            for resolution in [1.0, 0.5] {
                let view = look(DVec3::new(0.0, 0.0, 3.2), projection, 101, 101);
                let with = |smoothing| {
                    let grid = GridOptions { resolution, lambda: true };
                    let options = VolumeOptions { grid, smoothing, ..VolumeOptions::default() };
                    draw(&view, &[cloud.batch()], &scenery, &options).unwrap().0.rgba
                };
                let (plain, smooth) = (with(0), with(5));
                assert!(plain != smooth);
                let mut seen = 0;
                for (plain, smooth) in plain.iter().zip(&smooth) {
                    assert_eq!(plain[3], smooth[3]);
                    // Steep parts lean inwards, where all of their neighbours are.
                    if plain[0] > 0.5 {
                        assert!(
                            (plain[0] - smooth[0]).abs() < 0.03,
                            "{projection:?} {resolution} {plain:?} {smooth:?}"
                        );
                        seen += 1;
                    }
                }
                assert!(seen > 500, "{seen}");
            }
        }
    }
}
