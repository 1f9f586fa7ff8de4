//! From curves to chords in the picture.
//!
//! A projected Bézier curve in front of the eye lies in the hull of its projected control points, also in perspective, where it is a
//! rational curve with positive weights. It is halved until these are within [`TOLERANCE`] of the chord, so the curve is, too. What is
//! straight becomes a stroke ([`strokes`]).

mod strokes;

use super::curves::Curves;
use super::hidden::Hidden;
use super::lens::{Lens, Planes};
use super::palette::Quantity;
use super::stroke::{MOST_SHIFT, Stroke, kind};
use super::style::{PathShape, Style};
use crate::hierarchy::spacetime::TrackFlags;
use crate::view::View;
use glam::{DVec3, Vec3};

/// How far a chord may be from its curve, pixels.
pub const TOLERANCE: f32 = 0.25;
/// Halvings of a curve at most.
const MOST_HALVINGS: u32 = 12;
/// Halvings that give highlights their shape.
const HIGHLIGHT_HALVINGS: u32 = 4;
/// The radius of a comet's ball, and the half width of an arrow's head, in half widths of the path.
const HEAD_SIZE: f32 = 2.0;
/// Length of an arrow's head, in its half widths.
const HEAD_LENGTH: f32 = 2.5;
/// How many images of a curve along an axis are looked at: what goes further in one interval is lost anyway.
const MOST_IMAGES: i32 = 3;
/// The colour of what of a path is not meant, gamma-encoded sRGB.
pub const OTHERS: [u8; 3] = [96; 3];
/// How much faster a curve over several intervals may be at one end of a chord than at the other.
const EVEN_PACE: f32 = 1.25;
/// How far the colours there may be apart, of 255.
const EVEN_COLOR: u8 = 12;
/// Coordinates beyond this are of no picture, world units from the node.
const FARTHEST: f32 = 1e30;

/// Curves that are drawn, and which part of them.
#[derive(Clone, Copy)]
pub struct Drawn<'a> {
    /// The curves.
    pub curves: &'a Curves,
    /// Which of them; all where it is `None`.
    pub which: Option<&'a [u32]>,
    /// How much of each of the curves is meant, from 0 to 1: colours are mixed with [`OTHERS`]; all of it where it is `None`.
    pub shares: Option<&'a [f32]>,
    /// The part of the interval.
    pub part: Part,
    /// The edge of the periodic box, with its corner at the origin.
    pub box_size: Option<f64>,
}

impl Drawn<'_> {
    /// How many curves.
    pub fn len(&self) -> usize {
        self.which.map_or(self.curves.len(), <[u32]>::len)
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A part of an interval, or several whole ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Where it begins and ends, from 0 to 1.
    pub u: [f32; 2],
    /// Opacity there, by the distance to the present.
    pub fade: [f32; 2],
    /// Whether the present is at its end: heads are there.
    pub head: bool,
    /// Place in the whole time that is drawn, from 0 to 1, at both ends.
    pub place: [f32; 2],
    /// Number of the interval, the first of several.
    pub interval: usize,
    /// How many intervals; what a curve over several looks like is as fine in time as over each.
    pub intervals: usize,
}

/// Projects curves and divides them into chords.
pub struct Chopper<'a> {
    view: &'a View,
    style: &'a Style,
    lens: Lens,
}

/// One curve on its way into the picture.
struct Course<'a> {
    planes: &'a [(Vec3, f32)],
    part: Part,
    half: [f32; 2],
    faint: [f32; 2],
    kind: u8,
    color: Option<[u8; 3]>,
    /// How much of the path is meant.
    meant: f32,
    values: [f32; 2],
    /// From the curve's parameter to speeds.
    per_interval: f32,
}

/// A part of a curve: control points, where it is in the part that is drawn, and its directions in the picture at both ends.
#[derive(Clone, Copy)]
struct Piece {
    points: [Vec3; 4],
    share: [f32; 2],
    directions: [Option<[f32; 2]>; 2],
}

impl<'a> Chopper<'a> {
    /// For a view.
    pub fn new(view: &'a View, style: &'a Style) -> Chopper<'a> {
        Chopper { view, style, lens: Lens::new(view, style.around) }
    }

    /// Appends the strokes of some of the curves of `drawn`, by their places in it, and notes in `seen` which of these are in the view.
    /// Nothing need be appended of what is `hidden`.
    pub fn chop(
        &self,
        drawn: &Drawn<'_>,
        places: impl Iterator<Item = usize> + Clone,
        hidden: Option<&Hidden>,
        seen: &mut [bool],
        out: &mut Vec<Stroke>,
    ) {
        for offset in self.view.images.offsets() {
            self.image(drawn, places.clone(), offset, hidden, seen, out);
        }
    }

    /// Whether it can be told what is hidden; not in faces of panoramas, where sizes change along a curve.
    pub fn hides(&self) -> bool {
        self.lens.rate.is_none()
    }

    /// The same for an image of a periodic box.
    fn image(
        &self,
        drawn: &Drawn<'_>,
        places: impl Iterator<Item = usize>,
        offset: DVec3,
        hidden: Option<&Hidden>,
        seen: &mut [bool],
        out: &mut Vec<Stroke>,
    ) {
        let curves = drawn.curves;
        let cut = &self.view.cut;
        let bounds = curves.bounds;
        let sticks_out = |edge: f64| bounds.min.cmplt(DVec3::ZERO).any() || bounds.max.cmpge(DVec3::splat(edge)).any();
        let wrapping = drawn.box_size.filter(|edge| sticks_out(*edge));
        let is_cut = cut.clips() && {
            let moved = bounds.moved(offset);
            !(cut.keeps(moved.min) && cut.keeps(moved.max))
        };
        let mut cut_planes = self.lens.sides();
        if is_cut {
            cut_planes.extend(self.planes(cut.bounds.min, cut.bounds.max));
        }
        let base = self.view.to_camera(curves.origin + offset).as_vec3();
        let (right, up, forward) = (self.view.right.as_vec3(), self.view.up.as_vec3(), self.view.forward.as_vec3());
        for (place, seen) in places.zip(seen) {
            let i = drawn.which.map_or(place, |which| which[place] as usize);
            let turned = curves.points[i].map(|at| {
                let at = Vec3::from_array(at);
                Vec3::new(at.dot(right), at.dot(up), at.dot(forward))
            });
            let Some(edge) = wrapping else {
                *seen |= self.curve(drawn, i, turned.map(|at| at + base), &cut_planes, hidden, out);
                continue;
            };
            if self.style.unwrapped {
                // In the cell of its end that is nearer to the present, where its particle is then.
                let Part { u, fade, .. } = drawn.part;
                let at = if fade[1] < fade[0] { u[0] } else { u[1] };
                let [there, ..] = sub_curve(curves.points[i].map(Vec3::from_array), [at, at]);
                let cell = ((curves.origin + there.as_dvec3()) / edge).floor();
                if cell.is_finite() {
                    let base = self.view.to_camera(curves.origin + offset - edge * cell).as_vec3();
                    *seen |= self.curve(drawn, i, turned.map(|at| at + base), &cut_planes, hidden, out);
                }
                continue;
            }
            // The cells of the periodic lattice that the curve may be in; it is drawn once for each, cut to the box.
            let world = curves.points[i].map(|at| curves.origin + Vec3::from_array(at).as_dvec3());
            let low = world.iter().fold(DVec3::INFINITY, |low, at| low.min(*at)) / edge;
            let high = world.iter().fold(DVec3::NEG_INFINITY, |high, at| high.max(*at)) / edge;
            let cells = |axis: usize| {
                let first = (low[axis].floor() as i32).max(-MOST_IMAGES);
                first..=(high[axis].floor() as i32).min(first.saturating_add(MOST_IMAGES))
            };
            let inside = [0, 1, 2].map(cells).iter().all(|cells| *cells == (0..=0));
            let mut planes = cut_planes.clone();
            if !inside {
                planes.extend(self.planes(offset, offset + edge));
            }
            for x in cells(0) {
                for y in cells(1) {
                    for z in cells(2) {
                        let back = offset - edge * DVec3::new(f64::from(x), f64::from(y), f64::from(z));
                        let base = self.view.to_camera(curves.origin + back).as_vec3();
                        *seen |= self.curve(drawn, i, turned.map(|at| at + base), &planes, hidden, out);
                    }
                }
            }
        }
    }

    /// The sides of a box, world units.
    fn planes(&self, min: DVec3, max: DVec3) -> Planes {
        let view = self.view;
        let side = |axis: usize, sign: f64, at: f64| {
            let mut normal = DVec3::ZERO;
            normal[axis] = sign;
            let turned = DVec3::new(normal.dot(view.right), normal.dot(view.up), normal.dot(view.forward));
            // normal . world = normal . (eye + turned back), and the plane is where it is sign * at.
            (turned.as_vec3(), (normal.dot(view.eye) - sign * at) as f32)
        };
        let sides = (0..3).flat_map(|axis| [side(axis, 1.0, min[axis]), side(axis, -1.0, max[axis])]);
        sides.filter(|(_, offset)| offset.is_finite()).collect()
    }

    /// The strokes of one curve in camera coordinates; whether it is in view.
    fn curve(
        &self,
        drawn: &Drawn<'_>,
        i: usize,
        points: [Vec3; 4],
        planes: &[(Vec3, f32)],
        hidden: Option<&Hidden>,
        out: &mut Vec<Stroke>,
    ) -> bool {
        // What is no place, or farther than a picture reaches, has no chords.
        if !points.iter().all(|at| at.is_finite() && at.abs().max_element() < FARTHEST) {
            return false;
        }
        let (style, part) = (self.style, drawn.part);
        let curves = drawn.curves;
        let (mass, flags) = (curves.mass[i], curves.flags[i]);
        let at_ends = part.u.map(|u| mass[0] + (mass[1] - mass[0]) * u);
        let [half, faint] = {
            let [a, b] = at_ends.map(|mass| style.half_width(mass));
            [[a[0], b[0]], [a[1], b[1]]]
        };
        // What is too thin for a pixel is fainter, and what comes or goes has less weight.
        let weights = flags.weights();
        let weight = |u: f32| weights[0] as f32 * (1.0 - u) + weights[1] as f32 * u;
        let faint = [0, 1].map(|end| faint[end] * weight(part.u[end]) * style.opacity);
        let piece = Piece { points: sub_curve(points, part.u), share: [0.0, 1.0], directions: [None; 2] };
        if !self.may_be_seen(&piece.points, half) {
            return false;
        }
        // What fades has its heads at the ends of the whole curve.
        if hidden.is_some_and(|hidden| !flags.has(TrackFlags::FADES) && self.is_hidden(&piece.points, half, hidden)) {
            return true;
        }
        let values = curves.values.get(i).copied().unwrap_or([0.0; 2]);
        let color = match style.palette.quantity {
            Quantity::Plain(color) => Some(color),
            Quantity::Mass => Some(style.palette.of_value(0.5 * (at_ends[0] + at_ends[1]))),
            _ => None,
        };
        let length = (part.u[1] - part.u[0]).max(1e-9);
        let per_interval = 1.0 / (length * curves.length as f32);
        let kind = if style.shape == PathShape::Tube { kind::TUBE } else { 0 };
        let meant = drawn.shares.and_then(|shares| shares.get(i)).copied().unwrap_or(1.0).clamp(0.0, 1.0);
        let course = Course { planes, part, half, faint, kind, color, meant, values, per_interval };
        if flags.has(TrackFlags::FADES) {
            // No spline leads from its first place to its last.
            if part.head {
                let u = part.u[1];
                for (end, share) in [(0, 1.0 - u), (3, u)] {
                    self.ball(&course, points[end], &piece, share, out);
                }
            }
            return true;
        }
        if part.u[1] > part.u[0] {
            self.divide(&course, piece, 0, out);
        }
        if part.head {
            match style.shape {
                PathShape::Comet => self.ball(&course, piece.points[3], &piece, 1.0, out),
                PathShape::Arrow => self.head(&course, &points, &piece, out),
                PathShape::Line | PathShape::Tube => {}
            }
        }
        true
    }

    /// Whether a curve with these control points may reach into the picture.
    #[inline]
    fn may_be_seen(&self, points: &[Vec3; 4], half: [f32; 2]) -> bool {
        let lens = &self.lens;
        let around = (HEAD_SIZE * half[0].max(half[1]) + self.style.halo) * lens.most_scale() + 1.0;
        let far = points.iter().fold(f32::NEG_INFINITY, |far, at| far.max(at.z));
        if far.is_nan() || far <= lens.near {
            return false;
        }
        let beyond = |distance: &dyn Fn(Vec3) -> f32| points.iter().all(|at| distance(*at) < 0.0);
        // Signed distances from the sides of the frustum, of a perspective view times depth.
        let depth = |at: Vec3| if lens.perspective { at.z } else { 1.0 };
        let [width, height] = lens.size;
        let [x, y] = lens.middle;
        let left = |at: Vec3| (x + around) * depth(at) + at.x * lens.focal;
        let right = |at: Vec3| (width - x + around) * depth(at) - at.x * lens.focal;
        let top = |at: Vec3| (y + around) * depth(at) - at.y * lens.focal;
        let bottom = |at: Vec3| (height - y + around) * depth(at) + at.y * lens.focal;
        !(beyond(&left) || beyond(&right) || beyond(&top) || beyond(&bottom))
    }

    /// Whether nothing of a curve with these control points is seen behind what is known.
    #[inline]
    fn is_hidden(&self, points: &[Vec3; 4], half: [f32; 2], hidden: &Hidden) -> bool {
        let (nearest, farthest) = self.depths(points);
        if !self.is_in_front(nearest, farthest) {
            return false;
        }
        let pixels = points.map(|at| self.lens.pixel(at));
        let (mut low, mut high) = (pixels[0], pixels[0]);
        for [x, y] in pixels {
            low = [low[0].min(x), low[1].min(y)];
            high = [high[0].max(x), high[1].max(y)];
        }
        // As far as strokes reach to their sides, with the lines across their ends, and heads around their places.
        let (half, halo) = (half[0].max(half[1]), self.style.halo + 0.5);
        let sides = (1.0 + 0.5 * MOST_SHIFT) * (half + halo);
        let head = HEAD_SIZE * half + halo;
        let around = 1.0
            + match self.style.shape {
                PathShape::Line | PathShape::Tube => sides,
                PathShape::Comet => sides.max(head),
                PathShape::Arrow => (1.0 + 0.5 * MOST_SHIFT) * head + 0.5 * HEAD_LENGTH * HEAD_SIZE * half,
            };
        let is_known = pixels.as_flattened().iter().all(|at| at.is_finite());
        is_known && hidden.hides(low.map(|at| at - around), high.map(|at| at + around), nearest)
    }

    /// The smallest and largest depth of control points.
    #[inline]
    fn depths(&self, points: &[Vec3; 4]) -> (f32, f32) {
        let nearest = points.iter().fold(f32::INFINITY, |near, at| near.min(at.z));
        (nearest, points.iter().fold(f32::NEG_INFINITY, |far, at| far.max(at.z)))
    }

    /// Whether what is between these depths is far enough from the eye to be projected.
    #[inline]
    fn is_in_front(&self, nearest: f32, farthest: f32) -> bool {
        nearest > self.lens.near && (!self.lens.perspective || nearest > 1e-4 * farthest)
    }

    /// Divides a piece until it is straight.
    fn divide(&self, course: &Course<'_>, piece: Piece, halvings: u32, out: &mut Vec<Stroke>) {
        let points = &piece.points;
        let (nearest, farthest) = self.depths(points);
        if farthest.is_nan() || farthest <= self.lens.near {
            return;
        }
        let in_front = self.is_in_front(nearest, farthest);
        if !in_front && halvings >= MOST_HALVINGS {
            return;
        }
        if in_front {
            let pixels = points.map(|at| self.lens.pixel(at));
            let wanted = if self.style.highlights.is_some() { HIGHLIGHT_HALVINGS } else { 0 };
            let is_done = || {
                let is_straight = halvings >= wanted && is_flat(&pixels) && self.lens.is_short(pixels[0], pixels[3]);
                is_straight && self.is_even(course, &piece, halvings)
            };
            if halvings >= MOST_HALVINGS || is_done() {
                return self.stroke(course, &piece, &pixels, out);
            }
            if halvings > 0 && !self.may_be_seen(points, course.half) {
                return;
            }
        }
        let ([first, second], middle) = halves(points);
        let at = 0.5 * (piece.share[0] + piece.share[1]);
        // Both sides take the same direction, so that they meet in the same line.
        let direction = (in_front).then(|| {
            let [a, b] = [first[2], second[1]].map(|at| self.lens.pixel(at));
            [b[0] - a[0], b[1] - a[1]]
        });
        debug_assert!(middle.is_finite() || !points[0].is_finite());
        let [from, to] = piece.directions;
        let halvings = halvings + 1;
        let shares = [[piece.share[0], at], [at, piece.share[1]]];
        self.divide(course, Piece { points: first, share: shares[0], directions: [from, direction] }, halvings, out);
        self.divide(course, Piece { points: second, share: shares[1], directions: [direction, to] }, halvings, out);
    }

    /// Whether the piece of a curve over several intervals looks the same from one end to the other, as far as it is longer than one.
    fn is_even(&self, course: &Course<'_>, piece: &Piece, halvings: u32) -> bool {
        if 1_usize.checked_shl(halvings).is_none_or(|pieces| pieces >= course.part.intervals) {
            return true;
        }
        let [a, b, c, d] = piece.points;
        let (from, to) = ((b - a).length(), (d - c).length());
        if from.max(to) > EVEN_PACE * from.min(to) {
            return false;
        }
        // As it would be if all of it were as fast as one end.
        let color = |third: Vec3, share: f32| {
            let points = [a, a + third, a + 2.0 * third, a + 3.0 * third];
            course.color.unwrap_or_else(|| self.color(course, &Piece { points, ..*piece }, share))
        };
        let (from, to) = (color(b - a, piece.share[0]), color(d - c, piece.share[1]));
        from.iter().zip(to).all(|(from, to)| from.abs_diff(to) <= EVEN_COLOR)
    }
}

/// Whether the inner control points are near enough to the chord.
#[inline]
fn is_flat([a, b, c, d]: &[[f32; 2]; 4]) -> bool {
    let chord = [d[0] - a[0], d[1] - a[1]];
    let square = chord[0] * chord[0] + chord[1] * chord[1];
    let near = |at: &[f32; 2]| {
        let own = [at[0] - a[0], at[1] - a[1]];
        let along = if square > 0.0 { ((own[0] * chord[0] + own[1] * chord[1]) / square).clamp(0.0, 1.0) } else { 0.0 };
        let off = [own[0] - along * chord[0], own[1] - along * chord[1]];
        off[0] * off[0] + off[1] * off[1] <= TOLERANCE * TOLERANCE
    };
    near(b) && near(c)
}

/// Both halves of a curve, and its middle.
#[inline]
fn halves([a, b, c, d]: &[Vec3; 4]) -> ([[Vec3; 4]; 2], Vec3) {
    let (ab, bc, cd) = (0.5 * (*a + *b), 0.5 * (*b + *c), 0.5 * (*c + *d));
    let (abc, bcd) = (0.5 * (ab + bc), 0.5 * (bc + cd));
    let middle = 0.5 * (abc + bcd);
    ([[*a, ab, abc, middle], [middle, bcd, cd, *d]], middle)
}

/// The control points of a part of a curve.
fn sub_curve(points: [Vec3; 4], [from, to]: [f32; 2]) -> [Vec3; 4] {
    if from <= 0.0 && to >= 1.0 {
        return points;
    }
    // The polar form at these parameters.
    let polar = |u: f32, v: f32, w: f32| {
        let [a, b, c, d] = points;
        let (ab, bc, cd) = (a.lerp(b, u), b.lerp(c, u), c.lerp(d, u));
        ab.lerp(bc, v).lerp(bc.lerp(cd, v), w)
    };
    [polar(from, from, from), polar(from, from, to), polar(from, to, to), polar(to, to, to)]
}
