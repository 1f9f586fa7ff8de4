//! Strokes of pieces of curves that are straight, and of the heads of paths: where they are, how wide, and in which colours.

use super::super::palette::{Palette, Quantity};
use super::super::stroke::{MOST_SHIFT, Stroke, kind};
use super::super::style::PathShape;
use super::{Chopper, Course, HEAD_LENGTH, HEAD_SIZE, OTHERS, Piece};
use glam::Vec3;

/// Opacity that is not seen.
const UNSEEN: f32 = 1.0 / 512.0;

impl Chopper<'_> {
    /// The stroke of a piece that is straight.
    pub(super) fn stroke(&self, course: &Course<'_>, piece: &Piece, pixels: &[[f32; 2]; 4], out: &mut Vec<Stroke>) {
        let [a, b] = [piece.points[0], piece.points[3]];
        let (mut low, mut high) = (0.0f32, 1.0f32);
        for (normal, offset) in course.planes {
            let [from, to] = [a, b].map(|at| normal.dot(at) + offset);
            match (from >= 0.0, to >= 0.0) {
                (true, true) => {}
                (false, false) => return,
                (true, false) => high = high.min(from / (from - to)),
                (false, true) => low = low.max(from / (from - to)),
            }
        }
        if low >= high {
            return;
        }
        let is_whole = low == 0.0 && high == 1.0;
        let at = |share: f32| a + (b - a) * share;
        let ends = if is_whole { [a, b] } else { [at(low), at(high)] };
        let [from, to] = if is_whole { [pixels[0], pixels[3]] } else { ends.map(|at| self.lens.pixel(at)) };
        let share = |at: f32| piece.share[0] + (piece.share[1] - piece.share[0]) * at;
        let shares = [share(low), share(high)];
        let mix = |pair: [f32; 2]| shares.map(|share| pair[0] + (pair[1] - pair[0]) * share);
        let (fade, faint, mut half) = (mix(course.part.fade), mix(course.faint), mix(course.half));
        let mut alpha = [fade[0] * faint[0], fade[1] * faint[1]];
        if self.view.cut.fade_rate > 0.0 {
            [0, 1].into_iter().for_each(|end| alpha[end] *= self.fade(ends[end]));
        }
        if alpha[0].max(alpha[1]) < UNSEEN {
            return;
        }
        if self.style.shape == PathShape::Comet {
            // Its tail is thin where it ends.
            [0, 1].into_iter().for_each(|end| half[end] = (half[end] * fade[end]).max(0.5));
        }
        let mut color = self.color(course, piece, 0.5 * (shares[0] + shares[1]));
        if let Some(phase) = self.style.highlights {
            let [u, v] = course.part.u;
            let at = course.part.interval as f32 + u + (v - u) * 0.5 * (shares[0] + shares[1]);
            // A bell, an eighth of an interval wide.
            let away = (at - phase).rem_euclid(1.0);
            let away = away.min(1.0 - away) * 8.0;
            let share = (-away * away).exp();
            color = color.map(|byte| (f32::from(byte) + (255.0 - f32::from(byte)) * share) as u8);
        }
        let chord = [to[0] - from[0], to[1] - from[1]];
        let mut kind = course.kind;
        let direction = |end: usize| {
            piece.directions[end].unwrap_or_else(|| {
                let [p, q] = if end == 0 { [pixels[0], pixels[1]] } else { [pixels[2], pixels[3]] };
                [q[0] - p[0], q[1] - p[1]]
            })
        };
        let mut cuts = [shift(chord, direction(0)), shift(chord, direction(1))];
        if low > 0.0 {
            cuts[0] = 0.0;
        }
        if high < 1.0 {
            cuts[1] = 0.0;
        }
        if course.part.head && shares[1] >= 1.0 {
            kind |= kind::FREE_TO;
        }
        let mut halo = self.style.halo;
        if self.lens.rate.is_some() {
            let length = chord[0].hypot(chord[1]).max(1e-6);
            let across = [-chord[1] / length, chord[0] / length];
            let scales = [from, to].map(|at| self.lens.scale(at, across));
            half = [half[0] * scales[0], half[1] * scales[1]];
            halo *= 0.5 * (scales[0] + scales[1]);
        }
        out.push(Stroke { from, to, depth: ends.map(|at| at.z), half, halo, alpha, cuts, color, kind });
    }

    /// The factor on opacity that the cut leaves at a place.
    fn fade(&self, at: Vec3) -> f32 {
        let cut = &self.view.cut;
        cut.fade(f64::from(if cut.around { at.length() } else { at.z })) as f32
    }

    /// The colour in the middle of a piece, `share` of the part that is drawn; of what is meant of the path as much as there is.
    pub(super) fn color(&self, course: &Course<'_>, piece: &Piece, share: f32) -> [u8; 3] {
        let color = course.color.unwrap_or_else(|| self.whole_color(course, piece, share));
        if course.meant >= 1.0 {
            return color;
        }
        let mix = |(own, other): (u8, u8)| f32::from(other) + course.meant * (f32::from(own) - f32::from(other));
        let [r, g, b] = color;
        [(r, OTHERS[0]), (g, OTHERS[1]), (b, OTHERS[2])].map(|pair| mix(pair).round() as u8)
    }

    /// The colour of a path that is meant as a whole.
    fn whole_color(&self, course: &Course<'_>, piece: &Piece, share: f32) -> [u8; 3] {
        let [a, b, c, d] = piece.points;
        let palette = &self.style.palette;
        let along = || 0.75 * ((d - a) + (c - b));
        match palette.quantity {
            Quantity::Speed => {
                let range = (piece.share[1] - piece.share[0]).max(1e-9);
                palette.of_value(along().length() * course.per_interval / range)
            }
            Quantity::Direction => {
                let (view, along) = (self.view, along().as_dvec3());
                let world = along.x * view.right + along.y * view.up + along.z * view.forward;
                Palette::of_direction(world.as_vec3().to_array())
            }
            Quantity::Time => {
                let [first, last] = course.part.place;
                palette.of_value(first + (last - first) * share)
            }
            Quantity::Value => {
                let [u, v] = course.part.u;
                let [begin, end] = course.values;
                palette.of_value(begin + (end - begin) * (u + (v - u) * share))
            }
            Quantity::Mass | Quantity::Plain(_) => course.color.unwrap_or([255; 3]),
        }
    }

    /// Whether a place is within the planes of a course.
    fn keeps(course: &Course<'_>, at: Vec3) -> bool {
        course.planes.iter().all(|(normal, offset)| normal.dot(at) + offset >= 0.0)
    }

    /// A comet's ball.
    pub(super) fn ball(&self, course: &Course<'_>, at: Vec3, piece: &Piece, share: f32, out: &mut Vec<Stroke>) {
        let is_in_front = at.z > self.lens.near;
        let mut alpha = course.faint[1] * course.part.fade[1] * share;
        alpha *= self.fade(at);
        if !is_in_front || alpha < UNSEEN || !Chopper::keeps(course, at) {
            return;
        }
        let color = self.color(course, piece, 1.0);
        let from = self.lens.pixel(at);
        let radius = HEAD_SIZE * course.half[1];
        let mut ball = Stroke {
            from,
            to: from,
            depth: [at.z; 2],
            half: [radius; 2],
            halo: self.style.halo,
            alpha: [alpha; 2],
            cuts: [0.0; 2],
            color,
            kind: kind::BALL,
        };
        if self.lens.rate.is_some() {
            // Longer away from the middle, as whatever is round is drawn there.
            let [qx, qy] = self.lens.tangents(from);
            let away = qx.hypot(qy);
            let along = if away > 1e-3 { [qx / away, qy / away] } else { [1.0, 0.0] };
            let [long, across] = [along, [-along[1], along[0]]].map(|along| self.lens.scale(from, along));
            ball.to = [from[0] + along[0], from[1] + along[1]];
            (ball.half, ball.halo) = ([radius * long, radius * across], self.style.halo * across);
            ball.kind |= kind::TUBE;
        }
        out.push(ball);
    }

    /// An arrow's head.
    pub(super) fn head(&self, course: &Course<'_>, whole: &[Vec3; 4], piece: &Piece, out: &mut Vec<Stroke>) {
        let at = piece.points[3];
        let alpha = course.faint[1] * course.part.fade[1] * self.fade(at);
        if at.z <= self.lens.near || alpha < UNSEEN || !Chopper::keeps(course, at) {
            return;
        }
        // Where it goes: by what was drawn, or without that by the whole curve.
        let before = [piece.points[2], piece.points[1], piece.points[0], whole[0] + (at - whole[3])];
        let tip = self.lens.pixel(at);
        let direction = before.into_iter().filter(|before| before.z > self.lens.near).find_map(|before| {
            let from = self.lens.pixel(before);
            let [dx, dy] = [tip[0] - from[0], tip[1] - from[1]];
            let length = (dx * dx + dy * dy).sqrt();
            (length > 1e-3).then(|| [dx / length, dy / length])
        });
        let Some([dx, dy]) = direction else { return };
        let half = HEAD_SIZE * course.half[1];
        let [along, across] = [[dx, dy], [-dy, dx]].map(|along| self.lens.scale(tip, along));
        let reach = HEAD_LENGTH * half * along;
        let color = self.color(course, piece, 1.0);
        // The tip is half a head beyond the place, so that the line does not stick out.
        let [from, to] = [
            [tip[0] - 0.5 * reach * dx, tip[1] - 0.5 * reach * dy],
            [tip[0] + 0.5 * reach * dx, tip[1] + 0.5 * reach * dy],
        ];
        out.push(Stroke {
            from,
            to,
            depth: [at.z; 2],
            half: [half * across, 0.0],
            halo: self.style.halo * across,
            alpha: [alpha; 2],
            cuts: [0.0; 2],
            color,
            kind: kind::HEAD | kind::FREE_FROM | kind::FREE_TO,
        });
    }
}

/// How far the line across a chord's end is shifted, for each pixel to the side, where the path has another direction there.
#[inline]
fn shift([cx, cy]: [f32; 2], [dx, dy]: [f32; 2]) -> f32 {
    let along = dx * cx + dy * cy;
    let across = dy * cx - dx * cy;
    if along <= 0.0 || along.is_nan() { 0.0 } else { (-across / along).clamp(-MOST_SHIFT, MOST_SHIFT) }
}
