//! What a surface looks like: what colours it, the light, and lines of equal height.

use crate::color::TransferFunction;
use crate::color::colors::to_linear;
use glam::DVec3;

/// What colours the surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Attribute {
    /// True height.
    #[default]
    Height,
    /// Angle of steepest rise, degrees, at true height.
    Slope,
    /// Direction of steepest descent, degrees clockwise from `y`.
    Aspect,
    /// Mean curvature per world unit of the slopes, positive on hills.
    Curvature,
    /// What a form leaves of the height.
    Residual,
    /// How much higher it is than an earlier field was there.
    Difference,
    /// Level of the chunk.
    Level,
    /// 0 for points, 1 for triangles.
    Primitive,
    /// A colour plane, from 0 to 1 of its light, through the transfer function.
    Plane(usize),
    /// Three colour planes as they are: red, green, blue.
    Texture([usize; 3]),
    /// The photo that lies over the field.
    Photo,
}

/// Where light comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Light {
    /// From the eye.
    #[default]
    Eye,
    /// From far away.
    Sun {
        /// Degrees clockwise from `y`.
        azimuth: f64,
        /// Degrees above the plane of `x` and `y`.
        altitude: f64,
    },
}

/// The direction to a sun, in the frame of the surface, a unit vector; angles as those of [`Light::Sun`].
pub fn toward_sun(azimuth: f64, altitude: f64) -> DVec3 {
    let (up, level) = altitude.to_radians().sin_cos();
    let (east, north) = azimuth.to_radians().sin_cos();
    DVec3::new(level * east, level * north, up)
}

/// Lines of equal height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contours {
    /// From a line to the next, in units of height, above 0.
    pub interval: f64,
    /// A height with a line.
    pub base: f64,
    /// Every so many lines one is stronger; 0: none.
    pub major: u32,
    /// Width, pixels.
    pub width: f64,
    /// Colour, linear light.
    pub color: [f32; 3],
    /// Pixels of an em of the heights that are written along lines; `None`: none are.
    pub labels: Option<f64>,
}

/// What a surface looks like.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// What colours it.
    pub attribute: Attribute,
    /// Colours of values.
    pub transfer: TransferFunction,
    /// The range of values that the colours are spread over.
    pub range: [f64; 2],
    /// Where light comes from.
    pub light: Light,
    /// The share of light that comes from everywhere, from 0 to 1.
    pub ambient: f32,
    /// Lines of equal height.
    pub contours: Option<Contours>,
}

/// Colours over the places of a range, in linear light, and their means between two places.
pub struct Ramp {
    colors: Vec<[f32; 3]>,
    /// Sums of the colours' integrals from the first place on, in steps of the table.
    sums: Vec<[f64; 3]>,
}

impl Ramp {
    /// The colours of a transfer function.
    pub fn new(transfer: &TransferFunction) -> Ramp {
        let table = transfer.bake_colors();
        let row = table.rgba.iter().take(table.width as usize);
        let colors: Vec<[f32; 3]> =
            row.map(|[r, g, b, _]| [r, g, b].map(|byte| to_linear(f32::from(*byte) / 255.0))).collect();
        let mut sums = vec![[0.0; 3]];
        for (index, pair) in colors.windows(2).enumerate() {
            let before = sums[index];
            sums.push(std::array::from_fn(|k| before[k] + 0.5 * f64::from(pair[0][k] + pair[1][k])));
        }
        Ramp { colors, sums }
    }

    /// The colours, from the first place to the last.
    pub fn colors(&self) -> &[[f32; 3]] {
        &self.colors
    }

    /// The colour at a place from 0 to 1.
    #[inline]
    pub fn at(&self, place: f64) -> [f32; 3] {
        let last = self.colors.len() - 1;
        let at = place.clamp(0.0, 1.0) * last as f64;
        let index = (at as usize).min(last.saturating_sub(1));
        let share = (at - index as f64) as f32;
        let next = (index + 1).min(last);
        std::array::from_fn(|k| self.colors[index][k] + share * (self.colors[next][k] - self.colors[index][k]))
    }

    /// The mean of the colours between two places in ascending order, which may lie beyond the ends.
    pub fn mean(&self, [from, to]: [f64; 2]) -> [f32; 3] {
        let steps = (self.colors.len() - 1) as f64;
        if (to - from) * steps < 0.25 {
            return self.at(0.5 * (from + to));
        }
        let [low, high] = [self.integral(from), self.integral(to)];
        std::array::from_fn(|k| ((high[k] - low[k]) / ((to - from) * steps)) as f32)
    }

    /// The integral from the first place to this one, in steps of the table.
    fn integral(&self, place: f64) -> [f64; 3] {
        let last = self.colors.len() - 1;
        let at = place * last as f64;
        if at <= 0.0 {
            return self.colors[0].map(|color| f64::from(color) * at);
        }
        if at >= last as f64 {
            let beyond = at - last as f64;
            return std::array::from_fn(|k| self.sums[last][k] + beyond * f64::from(self.colors[last][k]));
        }
        let index = at as usize;
        let share = at - index as f64;
        let end = self.at(place);
        std::array::from_fn(|k| self.sums[index][k] + 0.5 * share * f64::from(self.colors[index][k] + end[k]))
    }
}

impl Contours {
    /// The height of the line that is nearest to a height.
    pub fn nearest(&self, height: f64) -> f64 {
        ((height - self.base) / self.interval).round().mul_add(self.interval, self.base)
    }

    /// Whether a line is a stronger one, as all are where none is.
    pub fn is_major(&self, number: i64) -> bool {
        self.major < 2 || number.rem_euclid(i64::from(self.major)) == 0
    }

    /// How much of a sample is line: from the height of the line nearest to it, how far that is in pixels, how much the height changes within a
    /// pixel, and the sample's size in pixels. Lines that are closer than two of their widths fade to their mean.
    pub fn share(&self, nearest: f64, away: f64, change: f64, size: f64) -> f32 {
        if change <= 0.0 {
            return 0.0;
        }
        let number = ((nearest - self.base) / self.interval).round();
        let (strength, all) = match self.major {
            0 | 1 => (1.0, 1.0),
            major if self.is_major(number as i64) => (1.0, MINOR + (1.0 - MINOR) / f64::from(major)),
            major => (MINOR, MINOR + (1.0 - MINOR) / f64::from(major)),
        };
        let apart = self.interval / change;
        let line = strength * ((0.5 * self.width - away) / (2.0 * EDGE * size) + 0.5).clamp(0.0, 1.0);
        // All lines at once: what they cover.
        let mean = all * (self.width / apart).min(0.5);
        let single = (apart / self.width - 1.0).clamp(0.0, 1.0);
        (single * line + (1.0 - single) * mean) as f32
    }
}

/// How opaque lines are that are not stronger ones.
pub const MINOR: f64 = 0.92;
/// Half of a line's soft edge, samples.
pub const EDGE: f64 = 0.3;
