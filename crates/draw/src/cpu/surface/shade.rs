//! The one function that shades points, triangles and rays: it knows a place, and nothing of what was drawn there.
//!
//! What a place looks like is read from the level whose samples are as far apart as pixels (of the picture's samples) there: mean normals, mean
//! colours, and the range of heights that a sample stands for, over which elevation colours are averaged. So a far picture is the mean of a near
//! one, and techniques differ only by where they see the surface. Normals are turned to the eye.

use super::lambert::Facets;
use super::look::{Attribute, Light, Ramp};
use super::photo::{self, PhotoLook};
use super::placed::Map;
use super::raster::Visibility;
use super::resolve::{Hit, Resolver};
use super::select::Primitive;
use super::sight::Sight;
use super::stitch::Scene;
use glam::DVec3;
use rayon::prelude::*;

pub use super::look::{Contours, Look};

/// Most colour planes that a place is read with.
const PLANES: usize = 4;

/// How much finer than a pixel a level is taken: what is read between its samples is a mean over about twice their distance, and pixels of a
/// small picture are nearest to the means of a large one with this.
pub const FINER: f64 = 0.65;

/// How many times as far as from above a sample may reach where the surface is seen from its edge.
const MOST_LONGER: f64 = 16.0;
/// Widths of a line from it within which a sample looks where it really is.
pub const REACH: f64 = 1.2;
/// Most steps to where a line is.
pub const SECANTS: u32 = 8;
/// Rays along a pixel's side where a surface ends in it.
pub const ENDS: u32 = 4;

/// What a place looks like.
#[derive(Clone, Copy, Debug, Default)]
struct Texel {
    /// Mean normal: world directions of x and y, z up, at true height.
    normal: [f32; 3],
    /// Least and largest height.
    range: [f64; 2],
    curvature: f32,
    planes: [f32; PLANES],
}

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
            Light::Sun { azimuth, altitude } => {
                let (up, level) = altitude.to_radians().sin_cos();
                let (east, north) = azimuth.to_radians().sin_cos();
                Some(DVec3::new(level * east, level * north, up))
            }
        };
        let planes = match look.attribute {
            Attribute::Plane(plane) => vec![plane],
            Attribute::Texture(planes) => planes.to_vec(),
            _ => Vec::new(),
        };
        let resolver = Resolver::new(scene, sight);
        Shader { resolver, look, ramp: Ramp::new(&look.transfer), parts, sun, planes, photo, spared: (0, Vec::new()) }
    }

    /// What finds places.
    pub fn resolver(&self) -> &Resolver<'a> {
        &self.resolver
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

    /// Colours in linear light, premultiplied with alpha, and depths: infinite where some sample of a pixel shows nothing. Where the surface
    /// ends, but for holes, more rays say how much of a pixel it covers.
    pub fn shade(&self, seen: &Visibility, [width, height]: [usize; 2]) -> (Vec<[f32; 4]>, Vec<f32>) {
        let parts = self.parts as usize;
        let pixel = |index: usize| {
            let (x, y) = (index % width * parts, index / width * parts);
            let is_end = parts > 1 && self.is_end(seen, [x, y]);
            let (mut color, mut depth) = ([0.0_f32; 4], 0.0_f32);
            for (x, y) in (y..y + parts).flat_map(|y| (x..x + parts).map(move |x| (x, y))) {
                let place = [x as f64 + 0.5, y as f64 + 0.5];
                let hit = seen.at(y * seen.width + x).and_then(|shown| self.resolver.look(shown, place));
                let Some(hit) = hit else {
                    depth = f32::INFINITY;
                    continue;
                };
                depth = depth.max(hit.depth as f32);
                if !is_end {
                    let sample = self.color(&hit, place);
                    (0..4).for_each(|k| color[k] += sample[k]);
                }
            }
            if is_end {
                return (self.end([x, y]), depth);
            }
            (color.map(|sum| sum / (parts * parts) as f32), depth)
        };
        (0..width * height).into_par_iter().map(pixel).unzip()
    }

    /// Whether a surface without holes ends in a pixel or next to it.
    pub(super) fn is_end(&self, seen: &Visibility, [left, top]: [usize; 2]) -> bool {
        let parts = self.parts as usize;
        let (mut hits, mut misses) = (false, false);
        for y in top.saturating_sub(1)..(top + parts + 1).min(seen.height) {
            for x in left.saturating_sub(1)..(left + parts + 1).min(seen.width) {
                match seen.at(y * seen.width + x) {
                    Some(shown) if !self.resolver.scene.meshes[shown.node].samples.coverage.is_empty() => return false,
                    Some(_) => hits = true,
                    None => misses = true,
                }
            }
        }
        hits && misses && self.resolver.scene.placed.is_flat()
    }

    /// The colour of a pixel in which a surface ends.
    fn end(&self, [left, top]: [usize; 2]) -> [f32; 4] {
        let mut color = [0.0_f32; 4];
        let step = f64::from(self.parts) / f64::from(ENDS);
        for (i, j) in (0..ENDS).flat_map(|j| (0..ENDS).map(move |i| (i, j))) {
            let place = [left as f64 + (f64::from(i) + 0.5) * step, top as f64 + (f64::from(j) + 0.5) * step];
            if let Some(hit) = self.resolver.cast(place) {
                let sample = self.color(&hit, place);
                (0..4).for_each(|k| color[k] += sample[k]);
            }
        }
        color.map(|sum| sum / (ENDS * ENDS) as f32)
    }

    /// The colour of a hit at a place of the picture: linear light, premultiplied.
    pub fn color(&self, hit: &Hit, place: [f64; 2]) -> [f32; 4] {
        let scene = self.resolver.scene;
        let sight = self.resolver.sight;
        let placed = &scene.placed;
        let texel = self.texel(hit);
        let mesh = &scene.meshes[hit.shown.node];
        let [x, y, z] = texel.normal.map(f64::from);
        let plain = match self.look.attribute {
            Attribute::Height => {
                let scale = |height: f64| self.place(height);
                self.ramp.mean(texel.range.map(scale))
            }
            Attribute::Slope => self.ramp.at(self.place(x.hypot(y).atan2(z).to_degrees())),
            Attribute::Aspect => self.ramp.at(self.place(x.atan2(y).to_degrees().rem_euclid(360.0))),
            Attribute::Curvature => self.ramp.at(self.place(f64::from(texel.curvature))),
            Attribute::Level => self.ramp.at(self.place(f64::from(mesh.node.key.level))),
            Attribute::Primitive => {
                self.ramp.at(self.place(f64::from(u8::from(mesh.node.primitive == Primitive::Triangles))))
            }
            Attribute::Plane(_) => self.ramp.at(self.place(f64::from(texel.planes[0]))),
            Attribute::Texture(_) => [texel.planes[0], texel.planes[1], texel.planes[2]],
            Attribute::Photo => {
                let reach = self.reach(hit, texel.normal, place);
                self.photo.as_ref().map_or(photo::nothing(), |photo| photo.at([hit.under[0], hit.under[1]], reach))
            }
        };
        let [row, column, height] = hit.under;
        let world = placed.world(row, column, height);
        let mut toward = sight.toward_eye(world - sight.eye());
        if let Map::Globe { .. } = placed.map {
            let [longitude, latitude] =
                [column.mul_add(placed.step[0], placed.origin[0]), row.mul_add(placed.step[1], placed.origin[1])];
            let up = super::placed::Placed::direction(longitude, latitude);
            let east = super::placed::Placed::direction(longitude + 90.0, 0.0);
            let north = up.cross(east);
            toward = DVec3::new(toward.dot(east), toward.dot(north), toward.dot(up));
        }
        let facets = Facets::new(DVec3::new(x, y, z), placed.lift / placed.true_lift);
        let lit = facets.lit(self.sun.unwrap_or(toward), toward) as f32;
        let light = self.look.ambient + (1.0 - self.look.ambient) * lit;
        let mut color = plain.map(|color| color * light);
        if let Some(contours) = &self.look.contours
            && !self.is_spared(place)
        {
            let share = self.line(contours, hit, place);
            (0..3).for_each(|k| color[k] += share * (contours.color[k] - color[k]));
        }
        let alpha = (hit.coverage * sight.cut().fade(hit.depth)) as f32;
        [color[0] * alpha, color[1] * alpha, color[2] * alpha, alpha]
    }

    /// How many rows and columns a sample of the picture reaches over on a surface with a mean normal; on a globe as many as it would if it were
    /// seen from above.
    fn reach(&self, hit: &Hit, normal: [f32; 3], [x, y]: [f64; 2]) -> [f64; 2] {
        let placed = &self.resolver.scene.placed;
        let [across, along] = placed.spacing();
        let size = self.resolver.level_at(hit.depth).exp2() * across.max(along);
        let least = [size / along, size / across];
        let ([row, column, height], slope) = (hit.under, placed.slope(normal));
        let apart = |x: f64, y: f64| {
            let (origin, direction) = self.resolver.sight.ray([x, y])?;
            let [column_there, row_there, _] = placed.ray(origin, direction)?.on_plane([row, column], height, slope)?;
            Some([(row_there - row).abs(), (column_there - column).abs()])
        };
        let (Some(beside), Some(below)) = (apart(x + 0.5, y), apart(x, y + 0.5)) else { return least };
        std::array::from_fn(|axis| {
            (2.0 * (beside[axis] + below[axis])).clamp(least[axis] / MOST_LONGER, least[axis] * MOST_LONGER)
        })
    }

    fn place(&self, value: f64) -> f64 {
        let [low, high] = self.look.range;
        match self.look.transfer.scale {
            crate::color::transfer::Scale::Linear => (value - low) / (high - low),
            scale => f64::from(scale.place(value as f32, self.look.range)),
        }
    }

    /// How much of a place is a line of equal height.
    fn line(&self, contours: &Contours, hit: &Hit, [x, y]: [f64; 2]) -> f32 {
        let placed = &self.resolver.scene.placed;
        let ([row, column, here], slope) = (hit.under, hit.slope);
        let height = |x: f64, y: f64| {
            let (origin, direction) = self.resolver.sight.ray([x, y])?;
            let ray = placed.ray(origin, direction)?;
            ray.on_plane([row, column], here, slope).map(|[_, _, height]| height)
        };
        const STEP: f64 = 0.25;
        let parts = f64::from(self.parts);
        let nearest = contours.nearest(here);
        // A surface that is seen from its edge has all of its lines there.
        let (Some(right), Some(below)) = (height(x + STEP, y), height(x, y + STEP)) else {
            return contours.share(nearest, 0.0, f64::MAX, 1.0);
        };
        // Widths are in pixels, this is in samples.
        let rise = [(right - here) / STEP, (below - here) / STEP];
        let steep = rise[0].hypot(rise[1]);
        let mut away = (nearest - here).abs() / steep;
        // Where the line is told to be the surface may have another slope: by secants to where it is.
        let is_single = contours.interval > contours.width * steep * parts;
        // What is well within the line stays so.
        if is_single && (0.02..REACH).contains(&(away / (contours.width * parts))) {
            let up = rise.map(|rise| rise / steep * (nearest - here).signum());
            let (mut last, mut is_found) = ((0.0, here), false);
            for _ in 0..SECANTS {
                let Some(there) = self.resolver.cast([x + up[0] * away, y + up[1] * away]) else { break };
                let next = away + (nearest - there.under[2]) * (away - last.0) / (there.under[2] - last.1);
                if next.is_nan() || next <= 0.0 {
                    break;
                }
                last = (away, there.under[2]);
                away = next.clamp(0.25 * away, 4.0 * away);
                if (next - last.0).abs() < 0.02 {
                    is_found = true;
                    break;
                }
            }
            // The surface ends before, or another one is in front of it.
            if !is_found {
                away = f64::INFINITY;
            }
        }
        contours.share(nearest, away / parts, steep * parts, 1.0 / parts)
    }

    /// What a hit looks like at the distance of its pixels.
    fn texel(&self, hit: &Hit) -> Texel {
        let wanted = self.resolver.level_at(hit.depth) - FINER;
        let (first, share) = self.resolver.levels(hit.shown.node, wanted);
        let nothing = Texel { normal: [0.0, 0.0, 1.0], range: [hit.under[2]; 2], ..Texel::default() };
        let mut texel = self.texel_at(hit, first).unwrap_or(nothing);
        if share > 0.0
            && let Some(coarse) = self.texel_at(hit, first + 1)
        {
            let mix = |a: f32, b: f32| a + share as f32 * (b - a);
            texel.normal = std::array::from_fn(|k| mix(texel.normal[k], coarse.normal[k]));
            texel.curvature = mix(texel.curvature, coarse.curvature);
            texel.planes = std::array::from_fn(|k| mix(texel.planes[k], coarse.planes[k]));
            texel.range = std::array::from_fn(|k| texel.range[k] + share * (coarse.range[k] - texel.range[k]));
        }
        let level = f64::from(first) + share;
        if wanted < level {
            // A sample stands for more than the pixel does.
            let shrunk = (wanted - level).exp2();
            texel.range = texel.range.map(|end| hit.under[2] + shrunk * (end - hit.under[2]));
        }
        texel
    }

    /// What a hit looks like in a level: between four samples, of which only those count that stand for something.
    fn texel_at(&self, hit: &Hit, level: u8) -> Option<Texel> {
        let between = self.resolver.between(hit.shown.node, level, [hit.under[0], hit.under[1]])?;
        let samples = between.samples;
        let mut texel = Texel::default();
        let mut sum = 0.0_f64;
        let mut normal = [0.0_f64; 3];
        let mut planes = [0.0_f64; PLANES];
        let mut leans = [[0.0_f64; 2]; 4];
        for ((index, weight), lean) in between.indices.into_iter().zip(between.weights).zip(&mut leans) {
            let weight = weight * f64::from(samples.coverage_at(index)) / 255.0;
            let found = samples.normals[index].map(f64::from);
            *lean = [found[0] / found[2].max(1e-6), found[1] / found[2].max(1e-6)];
            if weight <= 0.0 {
                continue;
            }
            sum += weight;
            (0..3).for_each(|k| normal[k] += weight * found[k]);
            let range = samples.range_at(index);
            (0..2).for_each(|k| texel.range[k] += weight * f64::from(range[k]));
            for (value, plane) in planes.iter_mut().zip(&self.planes) {
                *value += weight * samples.planes.get(*plane).map_or(0.0, |plane| f64::from(plane[index]));
            }
        }
        if sum <= 0.0 {
            return None;
        }
        texel.normal = normal.map(|value| (value / sum) as f32);
        texel.planes = planes.map(|value| (value / sum) as f32);
        texel.range = match level {
            0 => [hit.under[2]; 2],
            _ => texel.range.map(|end| end / sum),
        };
        let step = self.resolver.scene.placed.step;
        let across = 0.5 * (leans[1][0] + leans[3][0] - leans[0][0] - leans[2][0]) / (step[0] * between.apart[1]);
        let along = 0.5 * (leans[2][1] + leans[3][1] - leans[0][1] - leans[1][1]) / (step[1] * between.apart[0]);
        texel.curvature = (0.5 * (across + along)) as f32;
        Some(texel)
    }
}
