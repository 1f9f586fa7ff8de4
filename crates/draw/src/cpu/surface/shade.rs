//! The one function that shades points, triangles and rays: it knows a place, and nothing of what was drawn there.
//!
//! What a place looks like is read from the level whose samples are as far apart as pixels (of the picture's samples) there: mean normals, mean
//! colours, and the range of heights that a sample stands for, over which elevation colours are averaged. So a far picture is the mean of a near
//! one, and techniques differ only by where they see the surface. Normals are turned to the eye.

use super::look::{Attribute, Light, Ramp};
use super::placed::Map;
use super::raster::Visibility;
use super::resolve::{Hit, Resolver};
use super::select::Primitive;
use super::sight::Sight;
use super::source::NodeSamples;
use super::stitch::Scene;
use glam::DVec3;
use rayon::prelude::*;

pub use super::look::{Contours, Look};

/// Most colour planes that a place is read with.
const PLANES: usize = 4;

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
    resolver: Resolver<'a>,
    look: &'a Look,
    ramp: Ramp,
    /// Samples along a pixel's side.
    parts: u32,
    /// For each chunk its samples and those of the chunks that it lies in, from its level up.
    chains: Vec<Vec<Option<&'a NodeSamples>>>,
    /// Towards the sun, in the frame of the surface.
    sun: Option<DVec3>,
    /// Which planes are read.
    planes: Vec<usize>,
}

impl<'a> Shader<'a> {
    /// For a picture whose pixels are its samples, of which there are `parts` along a pixel's side.
    pub fn new(scene: &'a Scene, sight: &'a Sight, look: &'a Look, parts: u32) -> Shader<'a> {
        let chain = |mesh: &'a super::stitch::Mesh| {
            let key = mesh.node.key;
            (key.level..=scene.lattice.top()).map(|level| scene.samples(key.ancestor(level))).collect()
        };
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
        let chains = scene.meshes.iter().map(chain).collect();
        let resolver = Resolver::new(scene, sight);
        Shader { resolver, look, ramp: Ramp::new(&look.transfer), parts, chains, sun, planes }
    }

    /// Colours in linear light, premultiplied with alpha, and depths: infinite where some sample of a pixel shows nothing.
    pub fn shade(&self, seen: &Visibility, [width, height]: [usize; 2]) -> (Vec<[f32; 4]>, Vec<f32>) {
        let parts = self.parts as usize;
        let pixel = |index: usize| {
            let (x, y) = (index % width * parts, index / width * parts);
            let (mut color, mut depth) = ([0.0_f32; 4], 0.0_f32);
            for (x, y) in (y..y + parts).flat_map(|y| (x..x + parts).map(move |x| (x, y))) {
                let place = [x as f64 + 0.5, y as f64 + 0.5];
                let hit = seen.at(y * seen.width + x).and_then(|shown| self.resolver.hit(shown, place));
                let Some(hit) = hit else {
                    depth = f32::INFINITY;
                    continue;
                };
                depth = depth.max(hit.depth as f32);
                let sample = self.color(&hit, place);
                (0..4).for_each(|k| color[k] += sample[k]);
            }
            (color.map(|sum| sum / (parts * parts) as f32), depth)
        };
        (0..width * height).into_par_iter().map(pixel).unzip()
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
        };
        let world = placed.world(hit.row, hit.column, hit.height);
        let mut toward = sight.toward_eye(world - sight.eye());
        if let Map::Globe { .. } = placed.map {
            let [longitude, latitude] = [hit.column.mul_add(placed.step[0], placed.origin[0]), hit.row.mul_add(placed.step[1], placed.origin[1])];
            let up = super::placed::Placed::direction(longitude, latitude);
            let east = super::placed::Placed::direction(longitude + 90.0, 0.0);
            let north = up.cross(east);
            toward = DVec3::new(toward.dot(east), toward.dot(north), toward.dot(up));
        }
        // Slopes grow with the exaggeration; what the mean of normals lost in length stays lost.
        let steeper = placed.lift / placed.true_lift;
        let raised = DVec3::new(x * steeper, y * steeper, z);
        let length = (x * x + y * y + z * z).sqrt();
        let normal = raised.normalize_or_zero() * length;
        let facing = if normal.dot(toward) < 0.0 { -normal } else { normal };
        let lit = facing.dot(self.sun.unwrap_or(toward)).max(0.0) as f32;
        let light = self.look.ambient + (1.0 - self.look.ambient) * lit;
        let mut color = plain.map(|color| color * light);
        if let Some(contours) = &self.look.contours {
            let share = self.line(contours, hit, &texel, place);
            (0..3).for_each(|k| color[k] += share * (contours.color[k] - color[k]));
        }
        let alpha = (hit.coverage * sight.cut().fade(hit.depth)) as f32;
        [color[0] * alpha, color[1] * alpha, color[2] * alpha, alpha]
    }

    fn place(&self, value: f64) -> f64 {
        let [low, high] = self.look.range;
        match self.look.transfer.scale {
            crate::color::transfer::Scale::Linear => (value - low) / (high - low),
            scale => f64::from(scale.place(value as f32, self.look.range)),
        }
    }

    /// How much of a place is a line of equal height.
    fn line(&self, contours: &Contours, hit: &Hit, texel: &Texel, [x, y]: [f64; 2]) -> f32 {
        let placed = &self.resolver.scene.placed;
        // On a point the surface is as steep as its mean normal says.
        let slope = hit.slope.unwrap_or_else(|| {
            let [nx, ny, nz] = texel.normal.map(f64::from);
            let nz = nz.max(1e-6) * placed.true_lift;
            [-nx / nz * placed.step[0], -ny / nz * placed.step[1]]
        });
        let height = |x: f64, y: f64| {
            let (origin, direction) = self.resolver.sight.ray([x, y])?;
            let ray = placed.ray(origin, direction)?;
            let ([column, row, height], [right, down, up]) = (ray.origin, ray.direction);
            let plane = hit.height + slope[0] * (column - hit.column) + slope[1] * (row - hit.row);
            let t = (plane - height) / (up - slope[0] * right - slope[1] * down);
            (t > 0.0 && t.is_finite()).then(|| t.mul_add(up, height))
        };
        const STEP: f64 = 0.25;
        let (Some(here), Some(right), Some(below)) = (height(x, y), height(x + STEP, y), height(x, y + STEP)) else {
            return contours.share(hit.height, f64::MAX);
        };
        let here = if hit.slope.is_some() { hit.height } else { here };
        let change = (right - here).hypot(below - here) / STEP;
        // Widths are in pixels, this is in samples.
        contours.share(here, change * f64::from(self.parts)).min(1.0)
    }

    /// What a hit looks like at the distance of its pixels.
    fn texel(&self, hit: &Hit) -> Texel {
        let scene = self.resolver.scene;
        let chain = &self.chains[hit.shown.node];
        let own = scene.meshes[hit.shown.node].node.key.level;
        let [across, along] = scene.placed.spacing();
        let pixel = 1.0 / (self.resolver.sight.pixels_at(hit.depth.max(f64::MIN_POSITIVE)) * across.max(along));
        let wanted = pixel.log2();
        let level = wanted.clamp(f64::from(own), f64::from(own) + (chain.len() - 1) as f64);
        let first = level as u8;
        let share = level - f64::from(first);
        let mut texel = self.texel_at(hit, first, chain).unwrap_or(Texel { normal: [0.0, 0.0, 1.0], range: [hit.height; 2], ..Texel::default() });
        if share > 0.0
            && let Some(coarse) = self.texel_at(hit, first + 1, chain)
        {
            let mix = |a: f32, b: f32| a + share as f32 * (b - a);
            texel.normal = std::array::from_fn(|k| mix(texel.normal[k], coarse.normal[k]));
            texel.curvature = mix(texel.curvature, coarse.curvature);
            texel.planes = std::array::from_fn(|k| mix(texel.planes[k], coarse.planes[k]));
            texel.range = std::array::from_fn(|k| texel.range[k] + share * (coarse.range[k] - texel.range[k]));
        }
        if wanted < level {
            // A sample stands for more than the pixel does.
            let shrunk = (wanted - level).exp2();
            texel.range = texel.range.map(|end| hit.height + shrunk * (end - hit.height));
        }
        texel
    }

    /// What a hit looks like in a level: between four samples, of which only those count that stand for something.
    fn texel_at(&self, hit: &Hit, level: u8, chain: &[Option<&NodeSamples>]) -> Option<Texel> {
        let scene = self.resolver.scene;
        let own = scene.meshes[hit.shown.node].node.key;
        let samples = chain.get(usize::from(level - own.level)).copied().flatten()?;
        let key = own.ancestor(level);
        let place = |axis: usize, at: f64, count: usize| {
            let (first, _) = scene.lattice.span(key, axis);
            let index = ((at / (1_u64 << level) as f64) as usize).saturating_sub(first as usize).min(count.saturating_sub(2));
            let [from, to] = [0, 1].map(|next| scene.lattice.position(axis, level, first + index as u64 + next));
            (index, ((at - from as f64) / (to - from) as f64).clamp(0.0, 1.0), (to - from) as f64)
        };
        let (row, down, height) = place(0, hit.row, samples.rows);
        let (column, right, width) = place(1, hit.column, samples.columns);
        let mut texel = Texel::default();
        let mut sum = 0.0_f64;
        let mut normal = [0.0_f64; 3];
        let mut planes = [0.0_f64; PLANES];
        let mut leans = [[0.0_f64; 2]; 4];
        for (corner, lean) in leans.iter_mut().enumerate() {
            let index = (row + corner / 2) * samples.columns + column + corner % 2;
            let weight = (if corner / 2 == 0 { 1.0 - down } else { down }) * (if corner % 2 == 0 { 1.0 - right } else { right });
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
            0 => [hit.height; 2],
            _ => texel.range.map(|end| end / sum),
        };
        let [x, y] = [scene.placed.step[0] * width, scene.placed.step[1] * height];
        let across = 0.5 * (leans[1][0] + leans[3][0] - leans[0][0] - leans[2][0]) / x;
        let along = 0.5 * (leans[2][1] + leans[3][1] - leans[0][1] - leans[1][1]) / y;
        texel.curvature = (0.5 * (across + along)) as f32;
        Some(texel)
    }
}
