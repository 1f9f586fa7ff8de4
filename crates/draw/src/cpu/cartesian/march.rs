//! Ray casting through a field that is sampled in world space: emission and absorption with post-classification, isosurfaces, or
//! both, as the perspective grid's rays have them.
//!
//! A ray goes in steps of a share of the cell that it is in. Half of a step has the matter of its beginning, half that of its
//! end; surfaces that are crossed within it divide it. Boxes where nothing is visible are left in one step.

use crate::color::Colors;
use crate::cpu::volume::raycast::{Effort, Ray, SURFACE_BRIGHTNESS, Scenery};
use crate::cpu::volume::surface::Crossings;
use crate::view::{Projection, View};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Steps, in cells.
pub const STEP: f32 = 0.5;

/// A field that can be sampled anywhere within a box, in coordinates of its own, which are turned and scaled world coordinates.
pub trait Field: Sync {
    /// How far from a place its neighbours for a gradient are, cells.
    const REACH: f32;

    /// The field's coordinates of a world position.
    fn place(&self, world: DVec3) -> DVec3;

    /// World units to one of the field's.
    fn unit(&self) -> f64;

    /// The box outside which nothing is sampled.
    fn bounds(&self) -> [DVec3; 2];

    /// The room that a place is in; places beyond the bounds are in the nearest one.
    fn room(&self, place: Vec3, least: f32) -> Room;

    /// Density and `sum m A W` at a place in a room, or less than [`Field::REACH`] and a step beyond it.
    fn at(&self, room: &Room, place: Vec3) -> [f32; 2];
}

/// A box of the field with cells of one size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Room {
    /// Its corner with the least coordinates.
    pub min: Vec3,
    /// The opposite corner.
    pub max: Vec3,
    /// Width of a cell.
    pub cell: f32,
    /// Whether no sample in it is denser than what can be seen.
    pub empty: bool,
    /// What the field knows it by.
    pub index: usize,
}

impl Room {
    /// How far it is along a ray to the room's end.
    fn exit(&self, origin: Vec3, direction: Vec3) -> f32 {
        let axis = |k: usize| match direction[k] {
            d if d > 0.0 => (self.max[k] - origin[k]) / d,
            d if d < 0.0 => (self.min[k] - origin[k]) / d,
            _ => f32::INFINITY,
        };
        axis(0).min(axis(1)).min(axis(2))
    }
}

/// Draws what `scenery` says of a field, between two depths. The result does not depend on the number of threads.
pub fn cast<F: Field>(view: &View, field: &F, scenery: &Scenery, [near, far]: [f64; 2]) -> (Colors, Effort) {
    let perspective = matches!(view.projection, Projection::Perspective { .. });
    let focal = view.focal_pixels();
    let middle = view.middle();
    let least = scenery.least();
    let [low, high] = field.bounds();
    let pixel = |index: usize, effort: &mut Effort| -> [f32; 4] {
        let [x, y] = [index % view.width as usize, index / view.width as usize].map(|at| at as f64 + 0.5);
        let across = (x - middle[0]) / focal * view.right + (middle[1] - y) / focal * view.up;
        let (from, along) = match perspective {
            true => (view.eye, view.forward + across),
            false => (view.eye + across, view.forward),
        };
        // A depth along the ray is a distance of `scale` in the field.
        let origin = field.place(from);
        let direction = field.place(from + along) - origin;
        let scale = direction.length();
        let direction = direction / scale;
        let (mut start, mut end) = (near * scale, far * scale);
        for k in 0..3 {
            let (a, b) = ((low[k] - origin[k]) / direction[k], (high[k] - origin[k]) / direction[k]);
            match direction[k] == 0.0 {
                true if origin[k] < low[k] || origin[k] > high[k] => return [0.0; 4],
                true => {}
                false => (start, end) = (start.max(a.min(b)), end.min(a.max(b))),
            }
        }
        if start >= end || start.is_nan() || end.is_nan() {
            return [0.0; 4];
        }
        let walk =
            Walk { field, scenery, least, origin: (origin + start * direction).as_vec3(), along: direction.as_vec3() };
        let ray = walk.go((end - start) as f32, effort);
        [ray.color[0], ray.color[1], ray.color[2], ray.alpha]
    };
    let width = view.width as usize;
    let row = |y: usize| {
        let mut effort = Effort::default();
        let colors: Vec<[f32; 4]> = (y * width..(y + 1) * width).map(|index| pixel(index, &mut effort)).collect();
        (colors, effort)
    };
    let rows: Vec<_> = (0..view.height as usize).into_par_iter().map(row).collect();
    let effort = rows.iter().fold(Effort::default(), |sum, (_, effort)| Effort {
        samples: sum.samples + effort.samples,
        crossings: sum.crossings + effort.crossings,
    });
    let rgba = rows.into_iter().flat_map(|(colors, _)| colors).collect();
    (Colors { width: view.width, height: view.height, rgba }, effort)
}

/// One ray on its way.
struct Walk<'a, F> {
    field: &'a F,
    scenery: &'a Scenery,
    least: f32,
    origin: Vec3,
    along: Vec3,
}

/// A step of a ray.
struct Step {
    room: Room,
    /// Where it begins and ends.
    span: [f32; 2],
    /// The field there.
    ends: [[f32; 2]; 2],
}

impl<F: Field> Walk<'_, F> {
    fn at(&self, t: f32) -> Vec3 {
        self.origin + t * self.along
    }

    fn go(&self, end: f32, effort: &mut Effort) -> Ray {
        let mut ray = Ray::default();
        let mut t = 0.0f32;
        let mut last: Option<[f32; 2]> = None;
        while t < end && ray.alpha < self.scenery.termination {
            let room = self.field.room(self.at(t), self.least);
            let (exit, began) = (room.exit(self.origin, self.along).min(end), t);
            if !room.empty {
                while t < exit && ray.alpha < self.scenery.termination {
                    let from = last.unwrap_or_else(|| self.field.at(&room, self.at(t)));
                    let next = (t + STEP * room.cell).min(end);
                    if next <= t {
                        return ray;
                    }
                    let to = self.field.at(&room, self.at(next));
                    if from[0] > self.least || to[0] > self.least {
                        self.step(&mut ray, &Step { room, span: [t, next], ends: [from, to] }, effort);
                    }
                    (t, last) = (next, Some(to));
                }
            } else {
                last = None;
            }
            if t <= exit || t == began {
                // Beyond the face, by more than single precision rounds.
                t = t.max(exit);
                t += (1e-3 * room.cell).max(2e-6 * t);
                last = None;
            }
        }
        ray
    }

    fn step(&self, ray: &mut Ray, step: &Step, effort: &mut Effort) {
        let ([start, end], [from, to]) = (step.span, step.ends);
        let mut done = 0.0;
        let surfaces = &self.scenery.surfaces;
        if surfaces.iter().any(|surface| (from[0] < surface.value) != (to[0] < surface.value)) {
            let beyond = |t: f32| self.field.at(&step.room, self.at(t))[0];
            let length = end - start;
            let samples = [beyond(start - length), from[0], to[0], beyond(end + length)];
            for crossing in Crossings::find(samples, surfaces).iter() {
                effort.crossings += 1;
                self.through(ray, step, [done, crossing.at], effort);
                done = crossing.at;
                self.surface(ray, step, crossing.at, crossing.surface);
            }
        }
        self.through(ray, step, [done, 1.0], effort);
    }

    /// Passes a share of a step.
    fn through(&self, ray: &mut Ray, step: &Step, [from, to]: [f32; 2], effort: &mut Effort) {
        if !self.scenery.volume {
            return;
        }
        let length = (step.span[1] - step.span[0]) * self.field.unit() as f32;
        for ([density, weighted], [a, b]) in step.ends.into_iter().zip([[from, to.min(0.5)], [from.max(0.5), to]]) {
            if b > a && density > self.scenery.classifier.least() {
                effort.samples += 1;
                let matter = self.scenery.classifier.matter(density, weighted);
                ray.under(matter.color, 1.0 - (-matter.extinction * length * (b - a)).exp());
            }
        }
    }

    /// Meets a surface.
    fn surface(&self, ray: &mut Ray, step: &Step, share: f32, surface: usize) {
        let surface = &self.scenery.surfaces[surface];
        let mut color = surface.color.unwrap_or_else(|| {
            let [from, to] = step.ends;
            let [density, weighted] = [0, 1].map(|k| from[k] + share * (to[k] - from[k]));
            self.scenery.classifier.tinted(weighted / density, SURFACE_BRIGHTNESS)
        });
        if let Some(light) = &self.scenery.light {
            let place = self.at(step.span[0] + share * (step.span[1] - step.span[0]));
            let reach = F::REACH * step.room.cell;
            let density = |offset: Vec3| self.field.at(&step.room, place + offset)[0];
            let slope = |axis: Vec3| density(reach * axis) - density(-reach * axis);
            let gradient = Vec3::new(slope(Vec3::X), slope(Vec3::Y), slope(Vec3::Z));
            let length = gradient.length();
            color = light.shade(color, if length > 0.0 { gradient.dot(self.along) / length } else { 1.0 });
        }
        ray.under(color, surface.opacity);
    }
}
