//! The one function that shades points, triangles and rays: it knows a place, and nothing of what was drawn there.
//!
//! What a place looks like is read from the level whose samples are as far apart as pixels (of the picture's samples) there: mean normals, mean
//! colours, and the range of heights that a sample stands for, over which elevation colours are averaged. So a far picture is the mean of a near
//! one, and techniques differ only by where they see the surface. Normals are turned to the eye.

mod lines;
mod texel;

use super::holes::Holes;
use super::labels::ContourLabel;
use super::lambert::Facets;
use super::look::{Attribute, Light, Ramp, toward_sun};
use super::photo::{self, PhotoLook};
use super::placed::Map;
use super::raster::Visibility;
use super::rays::Caster;
use super::resolve::{Hit, Resolver};
use super::rims::Rims;
use super::select::Primitive;
use super::sight::Sight;
use super::stitch::Scene;
use super::walls::{WallHit, Walls};
use deepfield_heights::measure::Form;
use deepfield_heights::model::Globe;
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use texel::Texel;

pub use super::look::{Contours, Look};
pub use lines::{REACH, SECANTS};
pub use texel::FINER;

/// How many times as far as from above a sample may reach where the surface is seen from its edge.
pub const MOST_LONGER: f64 = 16.0;
/// From a stripe of the membrane to the next, pixels.
pub const HATCH: f64 = 5.0;
/// The colour of what a form or an earlier field is not over, linear light.
pub const BESIDE: [f32; 3] = [0.2; 3];
/// The colour of walls, linear light.
pub const WALL: [f32; 3] = [0.34, 0.29, 0.24];
/// The colour of rims of holes, linear light.
pub const RIM: [f32; 3] = [0.8, 0.08, 0.01];
/// Rays along a pixel's side where a surface ends in it.
pub const ENDS: u32 = 4;

/// Shades a picture.
pub struct Shader<'a> {
    /// Where what is shown is.
    pub(super) resolver: Resolver<'a>,
    look: &'a Look,
    ramp: Ramp,
    /// Samples along a pixel's side.
    parts: u32,
    /// Towards the sun, in the frame of the surface.
    sun: Option<DVec3>,
    /// Which planes are read.
    planes: Vec<usize>,
    photo: Option<PhotoLook<'a>>,
    /// Pixels of a row, and which have no lines; empty where all have.
    spared: (usize, Vec<bool>),
    /// What is seen, where lines are looked for in it.
    seen: Option<&'a Visibility>,
    /// The form that residuals are what is left of.
    form: Option<&'a Form>,
    /// Rims of holes, where they are lines.
    rims: Option<Rims>,
    /// Sides of the field.
    walls: Option<Walls>,
    /// Whether there is a membrane over holes, and most cells that it spans.
    spans: Option<f64>,
    /// How many levels coarser its chunks are than they say.
    coarser: u8,
}

impl<'a> Shader<'a> {
    /// For a picture whose pixels are its samples, of which there are `parts` along a pixel's side; with a photo, where one is to be seen.
    pub fn new(
        scene: &'a Scene,
        sight: &'a Sight,
        look: &'a Look,
        photo: Option<PhotoLook<'a>>,
        parts: u32,
    ) -> Shader<'a> {
        let sun = match look.light {
            Light::Eye => None,
            Light::Sun { azimuth, altitude } => Some(toward_sun(azimuth, altitude)),
        };
        let planes = match look.attribute {
            Attribute::Plane(plane) => vec![plane],
            Attribute::Texture(planes) => planes.to_vec(),
            _ => Vec::new(),
        };
        let resolver = Resolver::new(scene, sight);
        Shader {
            resolver,
            look,
            ramp: Ramp::new(&look.transfer),
            parts,
            sun,
            planes,
            photo,
            spared: (0, Vec::new()),
            seen: None,
            form: None,
            rims: None,
            walls: None,
            spans: None,
            coarser: 0,
        }
    }

    /// Prepares rays where many pixels of a flat field are drawn by them: those under whose centre the point that they show is not, and those in
    /// which the surface ends.
    pub(super) fn prepare_rays(&self, seen: &Visibility) {
        let scene = self.resolver.scene;
        let has_points = || scene.meshes.iter().any(|mesh| mesh.node.primitive == Primitive::Points);
        let is_whole = || scene.meshes.iter().any(|mesh| mesh.samples.coverage.is_empty());
        let is_open = || (0..seen.width * seen.height).any(|index| !seen.is_shown(index));
        if scene.placed.is_flat() && (has_points() || self.parts > 1 && is_whole() && is_open()) {
            self.resolver.prepare_rays();
        }
    }

    /// What finds places.
    pub fn resolver(&self) -> &Resolver<'a> {
        &self.resolver
    }

    /// With what casts rays through its scene where that is there already.
    pub(super) fn casting(self, caster: &Arc<Caster<'a>>) -> Shader<'a> {
        Shader { resolver: self.resolver.casting(caster), ..self }
    }

    /// With what is seen in each sample: on a globe lines are looked for there.
    pub fn seeing(self, seen: &'a Visibility) -> Shader<'a> {
        Shader { seen: Some(seen), ..self }
    }

    /// With residuals that are what a form leaves.
    pub fn without(self, form: Option<&'a Form>) -> Shader<'a> {
        Shader { form, ..self }
    }

    /// Of chunks that are so many levels coarser than they say.
    pub(super) fn coarser_by(self, coarser: u8) -> Shader<'a> {
        Shader { coarser, ..self }
    }

    /// With holes that look so; a scene that has a membrane over them is given with it.
    pub fn with_holes(self, holes: &Holes) -> Shader<'a> {
        let scene = self.resolver.scene;
        let rims = match holes {
            Holes::Outlined(width) => Some(Rims::new(scene, width * f64::from(self.parts))),
            _ => None,
        };
        let spans = holes.spans(&scene.placed).into_iter().fold(0.0, f64::max);
        Shader { rims, spans: Some(spans).filter(|spans| *spans > 0.0), ..self }
    }

    /// With walls down or up to a height of the field.
    pub fn with_walls(self, base: f64) -> Shader<'a> {
        let Resolver { scene, sight, .. } = self.resolver;
        Shader { walls: Walls::new(scene, &sight.cut().bounds, base), ..self }
    }

    /// Whether a wall hides a height along a line.
    pub fn is_behind_wall(&self, label: &ContourLabel) -> bool {
        let parts = f64::from(self.parts);
        let [left, top, right, bottom] = label.area();
        let places = [label.middle, [left, top], [right, top], [left, bottom], [right, bottom]];
        places.into_iter().map(|place| place.map(|at| at * parts)).any(|place| {
            let seen = self.seen.and_then(|seen| seen.at(place[1] as usize * seen.width + place[0] as usize));
            let hit = seen.and_then(|shown| self.resolver.look(shown, place.map(|at| at.floor() + 0.5)));
            hit.is_some_and(|hit| self.wall(Some(&hit), place).is_some())
        })
    }

    /// The wall that is seen at a place of the picture, before a hit.
    fn wall(&self, hit: Option<&Hit>, place: [f64; 2]) -> Option<WallHit> {
        let walls = self.walls.as_ref()?;
        let (origin, direction) = self.resolver.ray(place)?;
        walls.cast(self.resolver.scene, origin, direction, hit.map_or(f64::INFINITY, |hit| hit.depth))
    }

    /// What a place of the picture shows: its colour, depth, and how much of it is covered by what was measured.
    pub(super) fn sample(&self, hit: Option<&Hit>, place: [f64; 2]) -> Option<([f32; 4], f64, f32)> {
        if let Some(wall) = self.wall(hit, place) {
            let (_, direction) = self.resolver.ray(place)?;
            let toward = self.sun.unwrap_or(-direction.normalize_or_zero());
            let lit = wall.normal.dot(toward).max(0.0) as f32;
            let light = self.look.ambient + (1.0 - self.look.ambient) * lit;
            let alpha = self.resolver.sight.cut().fade(wall.depth) as f32;
            let [r, g, b] = WALL.map(|color| color * light * alpha);
            return Some(([r, g, b, alpha], wall.depth, 0.0));
        }
        hit.map(|hit| (self.color(hit, place), hit.depth, self.alpha(hit)))
    }

    /// Without lines in some of the pixels; `width` are in a row.
    pub fn sparing(self, width: usize, pixels: Vec<bool>) -> Shader<'a> {
        Shader { spared: (width, pixels), ..self }
    }

    /// Whether a place of the picture's samples has no lines.
    fn is_spared(&self, place: [f64; 2]) -> bool {
        let (width, pixels) = &self.spared;
        let [x, y] = place.map(|at| (at / f64::from(self.parts)) as usize);
        pixels.get(y * width + x).copied().unwrap_or(false)
    }

    /// Colours in linear light, premultiplied with alpha; depths, infinite where some sample of a pixel shows nothing, and how much of each
    /// pixel is covered by what was measured. Where the surface ends, but for holes, more rays say how much of a pixel it covers.
    pub fn shade(&self, seen: &Visibility, [width, height]: [usize; 2]) -> (Vec<[f32; 4]>, [Vec<f32>; 2]) {
        self.shade_part(seen, &[0..width, 0..height])
    }

    /// The same of some columns and rows of pixels, row by row.
    pub(super) fn shade_part(
        &self,
        seen: &Visibility,
        [columns, rows]: &[Range<usize>; 2],
    ) -> (Vec<[f32; 4]>, [Vec<f32>; 2]) {
        self.prepare_rays(seen);
        let width = columns.len();
        let pixel = |index: usize| self.pixel(seen, [columns.start + index % width, rows.start + index / width]);
        let (colors, (depth, covered)) = (0..width * rows.len()).into_par_iter().map(pixel).unzip();
        (colors, [depth, covered])
    }

    /// The same colours of some pixels, which are numbered row by row.
    pub fn shade_some(&self, seen: &Visibility, width: usize, pixels: &[usize]) -> Vec<[f32; 4]> {
        pixels.par_iter().map(|index| self.pixel(seen, [index % width, index / width]).0).collect()
    }

    /// The colours of some pixels, columns and rows, by rays.
    pub(super) fn shade_by_rays(&self, pixels: &[[usize; 2]]) -> Vec<[f32; 4]> {
        let parts = self.parts as usize;
        pixels.par_iter().map(|pixel| self.end(pixel.map(|at| at * parts)).0).collect()
    }

    /// Colour, depth and cover of a pixel.
    fn pixel(&self, seen: &Visibility, pixel: [usize; 2]) -> ([f32; 4], (f32, f32)) {
        let parts = self.parts as usize;
        let [x, y] = [pixel[0] * parts, pixel[1] * parts];
        let is_end = parts > 1 && self.is_end(seen, [x, y]);
        let (mut color, mut depth, mut covered) = ([0.0_f32; 4], 0.0_f32, 0.0_f32);
        for (x, y) in (y..y + parts).flat_map(|y| (x..x + parts).map(move |x| (x, y))) {
            let place = [x as f64 + 0.5, y as f64 + 0.5];
            let hit = seen.at(y * seen.width + x).and_then(|shown| self.resolver.look(shown, place));
            let Some((sample, sample_depth, sample_covered)) = self.sample(hit.as_ref(), place) else {
                depth = f32::INFINITY;
                continue;
            };
            depth = depth.max(sample_depth as f32);
            (0..4).for_each(|k| color[k] += sample[k]);
            covered += sample_covered;
        }
        if is_end {
            let (color, covered) = self.end([x, y]);
            return (color, (depth, covered));
        }
        let all = (parts * parts) as f32;
        color.iter_mut().for_each(|sum| *sum /= all);
        (color, (depth, covered / all))
    }

    /// Whether a surface without holes ends in a pixel or next to it.
    pub(super) fn is_end(&self, seen: &Visibility, [left, top]: [usize; 2]) -> bool {
        let parts = self.parts as usize;
        let rows = top.saturating_sub(1)..(top + parts + 1).min(seen.height);
        let columns = left.saturating_sub(1)..(left + parts + 1).min(seen.width);
        if seen.is_even(&columns, &rows) || !self.resolver.scene.placed.is_flat() {
            return false;
        }
        let meshes = &self.resolver.scene.meshes;
        let mut around = rows.flat_map(|y| columns.clone().map(move |x| y * seen.width + x));
        !around.any(|index| seen.at(index).is_some_and(|shown| !meshes[shown.node].samples.coverage.is_empty()))
    }

    /// The colour of a pixel by more rays, and how much of it is covered.
    fn end(&self, [left, top]: [usize; 2]) -> ([f32; 4], f32) {
        let (mut color, mut covered) = ([0.0_f32; 4], 0.0_f32);
        let step = f64::from(self.parts) / f64::from(ENDS);
        for (i, j) in (0..ENDS).flat_map(|j| (0..ENDS).map(move |i| (i, j))) {
            let place = [left as f64 + (f64::from(i) + 0.5) * step, top as f64 + (f64::from(j) + 0.5) * step];
            if let Some((sample, _, sample_covered)) = self.sample(self.resolver.cast(place).as_ref(), place) {
                (0..4).for_each(|k| color[k] += sample[k]);
                covered += sample_covered;
            }
        }
        let all = (ENDS * ENDS) as f32;
        (color.map(|sum| sum / all), covered / all)
    }

    /// The colour of a hit at a place of the picture: linear light, premultiplied.
    fn color(&self, hit: &Hit, place: [f64; 2]) -> [f32; 4] {
        let scene = self.resolver.scene;
        let sight = self.resolver.sight;
        let placed = &scene.placed;
        let texel = if hit.is_membrane { Texel::default() } else { self.texel(hit) };
        let mesh = &scene.meshes[hit.shown.node];
        let mean = || std::array::from_fn(|k| f64::from(texel.normal[k]));
        let [x, y, z] = if hit.is_membrane { self.flat_normal(hit) } else { mean() };
        let plain = match self.look.attribute {
            _ if hit.is_membrane => self.hatch(place),
            Attribute::Height => self.ramp.mean([self.place(texel.range[0]), self.place(texel.range[1])]),
            Attribute::Residual => {
                let form = self.form.map_or(0.0, |form| form.height(placed.file_place(hit.under[0], hit.under[1])));
                match form.is_nan() {
                    // Beside a sphere.
                    true => BESIDE,
                    false => self.ramp.mean(texel.range.map(|height| self.place(height - form))),
                }
            }
            Attribute::Difference if texel.change.is_nan() => BESIDE,
            Attribute::Difference => self.ramp.at(self.place(f64::from(texel.change))),
            Attribute::Slope => self.ramp.at(self.place(x.hypot(y).atan2(z).to_degrees())),
            Attribute::Aspect => self.ramp.at(self.place(x.atan2(y).to_degrees().rem_euclid(360.0))),
            Attribute::Curvature => self.ramp.at(self.place(f64::from(texel.curvature))),
            Attribute::Level => self.ramp.at(self.place(f64::from(mesh.node.key.level + self.coarser))),
            Attribute::Primitive => {
                self.ramp.at(self.place(f64::from(u8::from(mesh.node.primitive == Primitive::Triangles))))
            }
            Attribute::Plane(_) => self.ramp.at(self.place(f64::from(texel.planes[0]))),
            Attribute::Texture(_) => [texel.planes[0], texel.planes[1], texel.planes[2]],
            Attribute::Photo => {
                let sides = self.sides(hit, texel.normal, place);
                self.photo.as_ref().map_or(photo::nothing(), |photo| photo.at([hit.under[0], hit.under[1]], sides))
            }
        };
        let [row, column, height] = hit.under;
        let world = placed.world(row, column, height);
        let mut toward = sight.toward_eye(world - sight.eye());
        if let Map::Globe(_) = placed.map {
            let [longitude, latitude] =
                [column.mul_add(placed.step[0], placed.origin[0]), row.mul_add(placed.step[1], placed.origin[1])];
            let up = DVec3::from(Globe::up(longitude, latitude));
            let east = DVec3::from(Globe::up(longitude + 90.0, 0.0));
            let north = up.cross(east);
            toward = DVec3::new(toward.dot(east), toward.dot(north), toward.dot(up));
        }
        let facets = Facets::new(DVec3::new(x, y, z), placed.lift / placed.true_lift);
        let lit = facets.lit(self.sun.unwrap_or(toward), toward) as f32;
        let light = self.look.ambient + (1.0 - self.look.ambient) * lit;
        let mut color = plain;
        color.iter_mut().for_each(|color| *color *= light);
        if let Some(contours) = &self.look.contours
            && !hit.is_membrane
            && !self.is_spared(place)
        {
            let share = self.line(contours, hit, place);
            (0..3).for_each(|k| color[k] += share * (contours.color[k] - color[k]));
        }
        if let Some(rims) = self.rims.as_ref().filter(|_| !hit.is_membrane) {
            let share = rims.share(&self.resolver, hit);
            (0..3).for_each(|k| color[k] += share * (RIM[k] - color[k]));
        }
        let alpha = (hit.coverage * sight.cut().fade(hit.depth)) as f32;
        // What a coarse sample leaves open are holes that are smaller than it.
        if hit.coverage < 1.0 && self.spans.is_some_and(|spans| spans >= (1_u64 << mesh.node.key.level) as f64) {
            let (whole, hatch) = (sight.cut().fade(hit.depth) as f32, self.hatch(place));
            let mixed = |k: usize| color[k] * alpha + hatch[k] * light * (whole - alpha);
            return [mixed(0), mixed(1), mixed(2), whole];
        }
        [color[0] * alpha, color[1] * alpha, color[2] * alpha, alpha]
    }

    /// How much of a hit is covered by what was measured.
    fn alpha(&self, hit: &Hit) -> f32 {
        match hit.is_membrane || hit.is_pole {
            true => 0.0,
            false => (hit.coverage * self.resolver.sight.cut().fade(hit.depth)) as f32,
        }
    }

    /// The normal of a hit's triangle, as mean normals are.
    fn flat_normal(&self, hit: &Hit) -> [f64; 3] {
        let placed = &self.resolver.scene.placed;
        let lengths = placed.lengths();
        let lean = [0, 1].map(|k| -hit.slope[k] * placed.true_lift / lengths[k]);
        DVec3::new(lean[0], lean[1], 1.0).normalize().to_array()
    }

    /// The colour of the membrane at a place of the picture: stripes, which no data has.
    fn hatch(&self, [x, y]: [f64; 2]) -> [f32; 3] {
        let across = (x + y) / (f64::from(self.parts) * HATCH * std::f64::consts::SQRT_2);
        let away = 2.0 * (across - across.floor() - 0.5).abs();
        let stripe = (((away - 0.5) * HATCH * 0.5 * f64::from(self.parts)) + 0.5).clamp(0.0, 1.0) as f32;
        [0.5 - 0.38 * stripe; 3]
    }

    /// The rows and columns that the sides of a sample of the picture, to the right and downwards, reach over on a surface with a mean normal; on a
    /// globe as many as if it were seen from above.
    fn sides(&self, hit: &Hit, normal: [f32; 3], [x, y]: [f64; 2]) -> [[f64; 2]; 2] {
        let placed = &self.resolver.scene.placed;
        let [across, along] = placed.spacing();
        let size = self.resolver.level_at(hit.depth).exp2() * across.max(along);
        let least = [size / along, size / across];
        let ([row, column, height], slope) = (hit.under, placed.slope(normal));
        let side = |x: f64, y: f64| {
            let (origin, direction) = self.resolver.ray([x, y])?;
            let [column_there, row_there, _] = placed.ray(origin, direction)?.on_plane([row, column], height, slope)?;
            let side = [2.0 * (row_there - row), 2.0 * (column_there - column)];
            let longer = (side[0] / least[0]).hypot(side[1] / least[1]) / MOST_LONGER;
            Some(if longer > 1.0 { side.map(|side| side / longer) } else { side })
        };
        match (side(x + 0.5, y), side(x, y + 0.5)) {
            (Some(right), Some(down)) => [right, down],
            _ => [[0.0, least[1]], [least[0], 0.0]],
        }
    }

    fn place(&self, value: f64) -> f64 {
        let [low, high] = self.look.range;
        match self.look.transfer.scale {
            crate::color::transfer::Scale::Linear => (value - low) / (high - low),
            scale => f64::from(scale.place(value as f32, self.look.range)),
        }
    }
}
