//! One stroke and its coverage of pixels.
//!
//! Chords of one path share the lines where they meet: each pixel's centre lies on one side of such a line and belongs to one chord,
//! so that nothing is drawn twice where a path fades. Across, edges fall off over a pixel.

/// Flags of a stroke.
pub mod kind {
    /// The path begins here: the end is antialiased.
    pub const FREE_FROM: u8 = 1;
    /// The path ends here.
    pub const FREE_TO: u8 = 2;
    /// A ball around the first place.
    pub const BALL: u8 = 4;
    /// The head of an arrow: from its base to its tip.
    pub const HEAD: u8 = 8;
    /// Lit as a tube; of a ball, from where the eye is.
    pub const TUBE: u8 = 16;
}

/// A straight part of a path in the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stroke {
    /// Where it begins, pixels.
    pub from: [f32; 2],
    /// Where it ends.
    pub to: [f32; 2],
    /// Depth at both ends.
    pub depth: [f32; 2],
    /// Half its width at both ends, pixels; of a ball, its radii along and across it.
    pub half: [f32; 2],
    /// Width of the dark rim, pixels.
    pub halo: f32,
    /// Opacity at both ends.
    pub alpha: [f32; 2],
    /// How far the lines across its ends are shifted along it, for each pixel to the side.
    pub cuts: [f32; 2],
    /// Gamma-encoded sRGB.
    pub color: [u8; 3],
    /// [`kind`].
    pub kind: u8,
}

/// Where the light on balls comes from: from the upper left, in pixels' directions and towards the eye.
const LAMP: [f32; 3] = [-0.4, -0.5, 0.768];
/// Where it comes from in pictures of all directions, whose faces have no upper left in common.
const HEADLIGHT: [f32; 3] = [0.0, 0.0, 1.0];
/// Light that shaded parts have.
const AMBIENT: f32 = 0.35;

/// A stroke's part in a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Opacity there.
    pub alpha: f32,
    /// Factor on its light: 0 for the rim.
    pub shade: f32,
    /// Place along it, from 0 to 1.
    pub along: f32,
}

/// A stroke, ready to be sampled.
pub struct Sampler<'a> {
    stroke: &'a Stroke,
    /// Unit vector along it.
    along: [f32; 2],
    length: f32,
    /// One by the length, 0 for none.
    inverse: f32,
    /// How far it reaches to the sides.
    reach: f32,
}

impl<'a> Sampler<'a> {
    /// Of a stroke.
    pub fn new(stroke: &'a Stroke) -> Sampler<'a> {
        let [dx, dy] = [stroke.to[0] - stroke.from[0], stroke.to[1] - stroke.from[1]];
        let length = (dx * dx + dy * dy).sqrt();
        let (along, inverse) =
            if length > 0.0 { ([dx / length, dy / length], 1.0 / length) } else { ([1.0, 0.0], 0.0) };
        Sampler { stroke, along, length, inverse, reach: reach(stroke) }
    }

    /// First and last-but-one pixel of a row that it may reach, within `columns`.
    #[inline]
    pub fn columns(&self, row: usize, columns: [usize; 2]) -> [usize; 2] {
        let [ex, ey] = self.along;
        let [x0, y] = [self.stroke.from[0], row as f32 + 0.5 - self.stroke.from[1]];
        // To the sides |y ex - x ey| < reach, along it -reach < x ex + y ey < length + reach; x from its beginning on.
        let (mut low, mut high) = (f32::NEG_INFINITY, f32::INFINITY);
        let mut within = |slope: f32, from: f32, to: f32| {
            if slope.abs() > 1e-4 {
                let ends = [from / slope, to / slope];
                low = low.max(ends[0].min(ends[1]));
                high = high.min(ends[0].max(ends[1]));
            }
        };
        within(ey, y * ex - self.reach, y * ex + self.reach);
        let slack = if self.stroke.kind & (kind::BALL | kind::HEAD) == 0 { 0.5 + 1.5 * self.reach } else { self.reach };
        within(ex, -y * ey - slack, self.length - y * ey + slack);
        // A pixel more on both sides, for what slopes that count as none leave.
        let first = (x0 + low - 1.5).max(columns[0] as f32);
        let last = (x0 + high + 1.5).min(columns[1] as f32);
        if first.is_nan() || last.is_nan() || first >= last {
            return [columns[0]; 2];
        }
        [first as usize, (last.ceil() as usize).min(columns[1])]
    }

    /// First and last-but-one row that it may reach, within `rows`.
    pub fn rows(&self, rows: [usize; 2]) -> [usize; 2] {
        let [low, high] = reach_along(self.stroke, 1);
        let first = low.max(rows[0] as f32);
        let last = high.min(rows[1] as f32);
        if first.is_nan() || last.is_nan() || first >= last {
            return [rows[0]; 2];
        }
        [first as usize, (last.ceil() as usize).min(rows[1])]
    }

    /// What of it is in the pixel with this centre.
    #[inline]
    pub fn sample(&self, x: f32, y: f32) -> Option<Sample> {
        let stroke = self.stroke;
        let [dx, dy] = [x - stroke.from[0], y - stroke.from[1]];
        if stroke.kind & kind::BALL != 0 {
            return self.ball(dx, dy);
        }
        let [ex, ey] = self.along;
        let (t, side) = (dx * ex + dy * ey, dy * ex - dx * ey);
        let away = side.abs();
        if away >= self.reach {
            return None;
        }
        let along = (t * self.inverse).clamp(0.0, 1.0);
        let mut ends = 1.0f32;
        if stroke.kind & kind::FREE_FROM != 0 {
            ends = (t + 0.5).clamp(0.0, 1.0);
        } else if t < stroke.cuts[0] * side {
            return None;
        }
        if stroke.kind & kind::FREE_TO != 0 {
            ends = ends.min((self.length + 0.5 - t).clamp(0.0, 1.0));
        } else if t >= self.length + stroke.cuts[1] * side {
            return None;
        }
        let half = stroke.half[0] + (stroke.half[1] - stroke.half[0]) * along;
        let cover = |half: f32| (half + 0.5 - away).min(2.0 * half).clamp(0.0, 1.0);
        let outer = cover(half + stroke.halo) * ends;
        if outer <= 0.0 {
            return None;
        }
        let inner = cover(half) * ends;
        let lit = match stroke.kind & kind::TUBE {
            0 => 1.0,
            _ => {
                let share = (away / half.max(0.5)).min(1.0);
                AMBIENT + (1.0 - AMBIENT) * (1.0 - share * share).sqrt()
            }
        };
        let alpha = stroke.alpha[0] + (stroke.alpha[1] - stroke.alpha[0]) * along;
        Some(Sample { alpha: outer * alpha, shade: lit * inner / outer, along })
    }

    #[inline]
    fn ball(&self, dx: f32, dy: f32) -> Option<Sample> {
        let [long, radius] = self.stroke.half;
        let [dx, dy] = match long == radius {
            true => [dx, dy],
            false => {
                // As if it were round.
                let [ex, ey] = self.along;
                let (t, side) = ((dx * ex + dy * ey) * (radius / long), dy * ex - dx * ey);
                [t * ex - side * ey, t * ey + side * ex]
            }
        };
        let distance = (dx * dx + dy * dy).sqrt();
        let outer = (radius + self.stroke.halo + 0.5 - distance).clamp(0.0, 1.0);
        if outer <= 0.0 {
            return None;
        }
        let inner = (radius + 0.5 - distance).clamp(0.0, 1.0);
        let [nx, ny] = [dx, dy].map(|part| part / radius.max(distance).max(1e-6));
        let lamp = if self.stroke.kind & kind::TUBE == 0 { LAMP } else { HEADLIGHT };
        let facing = lamp[0] * nx + lamp[1] * ny + lamp[2] * (1.0 - nx * nx - ny * ny).max(0.0).sqrt();
        let lit = AMBIENT + (1.0 - AMBIENT) * facing.max(0.0);
        Some(Sample { alpha: outer * self.stroke.alpha[0], shade: lit * inner / outer, along: 0.0 })
    }
}

/// How far a stroke reaches to its sides.
#[inline]
fn reach(stroke: &Stroke) -> f32 {
    let [a, b] = stroke.half;
    match stroke.kind & kind::BALL {
        0 => a.max(b) + stroke.halo + 0.5,
        // Its rim is as much longer as it is itself.
        _ => (b + stroke.halo + 0.5) * (a / b.max(1e-6)).max(1.0),
    }
}

/// The pixels along an axis that a stroke may reach.
pub fn reach_along(stroke: &Stroke, axis: usize) -> [f32; 2] {
    let around = reach(stroke);
    // Lines across its ends may be shifted.
    let more = match stroke.kind & kind::BALL {
        0 => around * (1.0 + stroke.cuts[0].abs().max(stroke.cuts[1].abs()).min(MOST_SHIFT) * 0.5),
        _ => around,
    };
    let [a, b] = [stroke.from[axis], stroke.to[axis]];
    [a.min(b) - more, a.max(b) + more]
}

/// How far the line across an end is shifted at most, for each pixel to the side.
pub const MOST_SHIFT: f32 = 1.0;
