//! Heights written along lines of equal height.
//!
//! Where a height may stand is a matter of the field alone: where a line crosses a row or a column of it. Rows and columns whose numbers are
//! multiples of a higher power of two come first, so that a picture from a place near by, or with other pixels, mostly has the same heights at
//! the same places of the field. Of these places those are taken, stronger lines first, around which the line is straight enough in the picture
//! and nothing is written yet.

mod candidates;
pub(crate) mod eyes;
mod level;
mod relief;

use super::look::Contours;
use super::raster::Visibility;
use super::resolve::Resolver;
use candidates::Candidate;
use relief::Relief;

/// Who knows letters: their sizes and their shapes.
pub trait Letters: Sync {
    /// Width of a text where an em has `size` pixels.
    fn width(&self, text: &str, size: f32) -> f32;

    /// Calls `pixel` with place and coverage (0 to 1) of each pixel of a text whose box has its middle at a place of the picture and is turned
    /// about it by `angle`, radians clockwise.
    fn write(&self, text: &str, size: f32, middle: [f32; 2], angle: f32, pixel: &mut dyn FnMut(i64, i64, f32));
}

/// A height on its line.
#[derive(Clone, Debug, PartialEq)]
pub struct ContourLabel {
    /// The height, in units of heights.
    pub level: f64,
    /// The same, exactly.
    pub text: String,
    /// Its middle in the picture, pixels: a place of the line.
    pub middle: [f64; 2],
    /// How far it is turned clockwise, radians, from -pi / 2 to pi / 2.
    pub angle: f64,
    /// Half of its width and of its height along these, pixels.
    pub half: [f64; 2],
    /// Which line it is of.
    number: i64,
}

/// Half the height of digits' boxes, in ems.
const HALF_HEIGHT: f64 = 0.45;
/// Room at either end of a text, in ems.
const ROOM: f64 = 0.3;
/// A line is within so much of a straight one behind its text, in ems.
const BENT: f64 = 0.28;
/// Stronger lines whose height is written are so far apart, others so far, in ems.
const APART: [f64; 2] = [1.2, 2.5];
/// Texts of one height are so far apart, and any so far, in ems.
const BETWEEN: [f64; 2] = [16.0, 4.0];
/// Room between boxes, and between them and the picture's edge, in ems.
const MARGIN: f64 = 0.4;
/// How opaque what is behind letters becomes, and how far around them, in ems.
const HALO: (f32, f64) = (0.38, 0.14);
/// Thin dark strokes look thinner than they are: what of a pixel they leave counts as its power.
const INK: f32 = 2.2;

impl ContourLabel {
    /// The upright box around it: left, top, right, bottom.
    pub fn area(&self) -> [f64; 4] {
        let (sin, cos) = self.angle.sin_cos();
        let [x, y] = self.middle;
        let [wide, tall] = self.half;
        let reach = [wide * cos.abs() + tall * sin.abs(), wide * sin.abs() + tall * cos.abs()];
        [x - reach[0], y - reach[1], x + reach[0], y + reach[1]]
    }

    /// Whether a place of the picture is in its turned box, which may be `room` larger on every side.
    fn holds(&self, [x, y]: [f64; 2], room: f64) -> bool {
        let (sin, cos) = self.angle.sin_cos();
        let away = [x - self.middle[0], y - self.middle[1]];
        let at = [cos * away[0] + sin * away[1], cos * away[1] - sin * away[0]];
        (0..2).all(|k| at[k].abs() <= self.half[k] + room)
    }
}

/// Writes heights where there is room. `em` is in pixels, of which there are `parts` samples along a side.
pub fn place(
    resolver: &Resolver<'_>,
    seen: &Visibility,
    parts: u32,
    (contours, em): (&Contours, f64),
    letters: &dyn Letters,
) -> Vec<ContourLabel> {
    let relief = Relief::new(resolver, seen, parts, em);
    let mut labels: Vec<ContourLabel> = Vec::new();
    for candidate in candidates::of(&relief, contours, em) {
        let near = |label: &&ContourLabel| {
            let away = (0..2).map(|k| (label.middle[k] - candidate.at[k]).powi(2)).sum::<f64>().sqrt();
            let is_same = label.number == candidate.number;
            away < em * if is_same { BETWEEN[0] } else { BETWEEN[1] }
        };
        if labels.iter().any(|label| near(&label)) {
            continue;
        }
        let Some(label) = written(&relief, contours, em, letters, &candidate) else { continue };
        if labels.iter().all(|other| are_apart(&label, other, MARGIN * em)) {
            labels.push(label);
        }
    }
    labels
}

/// Whether there is so much room between the boxes of two heights.
fn are_apart(a: &ContourLabel, b: &ContourLabel, room: f64) -> bool {
    let ([left, top, right, bottom], other) = (a.area(), b.area());
    left > other[2] + room || right + room < other[0] || top > other[3] + room || bottom + room < other[1]
}

/// The height at a candidate's place, if its line is straight enough there and the surface behind it in one piece.
fn written(
    relief: &Relief<'_, '_>,
    contours: &Contours,
    em: f64,
    letters: &dyn Letters,
    candidate: &Candidate,
) -> Option<ContourLabel> {
    let (level, text) = level::level(contours.base, contours.interval, candidate.number);
    let half = [0.5 * f64::from(letters.width(&text, em as f32)), HALF_HEIGHT * em];
    let middle = relief.onto(candidate.at, level)?;
    let reach = half[0] + ROOM * em;
    let [ahead, behind] = [1.0, -1.0].map(|way| relief.along(middle, level, way, reach));
    let (ahead, behind) = (ahead?, behind?);
    let (Some(from), Some(to)) = (behind.last(), ahead.last()) else { return None };
    let mut angle = (to[1] - from[1]).atan2(to[0] - from[0]);
    // Upright: read from left to right.
    if angle.abs() > std::f64::consts::FRAC_PI_2 {
        angle -= std::f64::consts::PI.copysign(angle);
    }
    let (sin, cos) = angle.sin_cos();
    let bent = |at: &[f64; 2]| (cos * (at[1] - middle[1]) - sin * (at[0] - middle[0])).abs();
    if ahead.iter().chain(&behind).any(|at| bent(at) > BENT * em) {
        return None;
    }
    let label = ContourLabel { level, text, middle, angle, half, number: candidate.number };
    let [left, top, right, bottom] = label.area();
    let room = MARGIN * em;
    let [width, height] = relief.size;
    let is_in = left >= room && top >= room && right + room <= width && bottom + room <= height;
    (is_in && relief.is_whole(&label)).then_some(label)
}

/// Which pixels of a picture so large have no lines, as heights stand there; empty where all have.
pub fn spared(labels: &[ContourLabel], [width, height]: [usize; 2]) -> Vec<bool> {
    let mut spared = if labels.is_empty() { Vec::new() } else { vec![false; width * height] };
    for label in labels {
        each_spared(label, [width, height], |x, y| spared[y * width + x] = true);
    }
    spared
}

/// The pixels of a picture so large that have no lines, as a height stands there.
fn each_spared(label: &ContourLabel, size: [usize; 2], mut each: impl FnMut(usize, usize)) {
    let room = 0.5 * ROOM * label.half[1] / HALF_HEIGHT;
    each_pixel(label.area(), room, size, |x, y| {
        if label.holds([x as f64 + 0.5, y as f64 + 0.5], room) {
            each(x, y);
        }
    });
}

/// The pixels of a box of the picture, which may be `room` larger on every side.
fn each_pixel(area: [f64; 4], room: f64, [width, height]: [usize; 2], mut each: impl FnMut(usize, usize)) {
    let [left, top, right, bottom] = [area[0] - room, area[1] - room, area[2] + room, area[3] + room];
    let ends =
        |from: f64, to: f64, count: usize| from.floor().max(0.0) as usize..(to.ceil().max(0.0) as usize).min(count);
    for y in ends(top, bottom, height) {
        ends(left, right, width).for_each(|x| each(x, y));
    }
}

/// Writes heights into colours in linear light, premultiplied with alpha, in the colour of lines; around them what is behind is lighter, or
/// darker where lines are light.
pub fn paint(
    colors: &mut [[f32; 4]],
    [width, height]: [usize; 2],
    labels: &[ContourLabel],
    contours: &Contours,
    letters: &dyn Letters,
) {
    let light = if contours.color.iter().sum::<f32>() < 1.5 { 1.0 } else { 0.0 };
    for label in labels {
        let em = label.half[1] / HALF_HEIGHT;
        let reach = (HALO.1 * em).max(1.0);
        // A true minus sign is what the picture shows.
        let text = label.text.replace('-', "\u{2212}");
        let write = |away: [f64; 2], put: &mut dyn FnMut(usize, f32)| {
            let middle = [0, 1].map(|k| (label.middle[k] + away[k]) as f32);
            letters.write(&text, em as f32, middle, label.angle as f32, &mut |x, y, coverage| {
                let is_in = (0..width as i64).contains(&x) && (0..height as i64).contains(&y);
                if is_in && coverage > 0.0 {
                    put(y as usize * width + x as usize, coverage.min(1.0));
                }
            });
        };
        let mut around: std::collections::BTreeMap<usize, f32> = Default::default();
        for turn in 0..16 {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(turn) / 16.0).sin_cos();
            write([reach * cos, reach * sin], &mut |index, coverage| {
                let most = around.entry(index).or_default();
                *most = most.max(coverage);
            });
        }
        let lay = |color: &mut [f32; 4], over: [f32; 3], share: f32| {
            (0..3).for_each(|k| color[k] += share * (over[k] * color[3] - color[k]));
        };
        around.into_iter().for_each(|(index, share)| lay(&mut colors[index], [light; 3], HALO.0 * share));
        let ink = |coverage: f32| if light > 0.0 { 1.0 - (1.0 - coverage).powf(INK) } else { coverage };
        write([0.0; 2], &mut |index, coverage| lay(&mut colors[index], contours.color, ink(coverage)));
    }
}

#[cfg(test)]
mod tests;
