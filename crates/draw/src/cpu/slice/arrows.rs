//! A vector field on a slice as arrows: one for each cell of a lattice over the picture, through its middle pixel.

use super::{DARK, LIGHT, Slice, mix};

/// The share of arrows that are no longer than the lattice's spacing, where their scale is found from them.
const SHARE: f64 = 0.95;
/// The longest arrow, in spacings: one that is far longer than all others would hide them.
const LONGEST: f64 = 1.5;
/// Length of an arrow's barbs, of its own length, and in spacings at most.
const BARBS: [f64; 2] = [0.4, 0.35];
/// Cosine and sine of the angle between a barb and the shaft: 28 degrees.
const BARB: [f64; 2] = [0.882_947_592_858_927, 0.469_471_562_785_891];
/// Half of a line's width, and the width of the dark rim around it, pixels.
const HALF: f64 = 0.7;
const RIM: f64 = 1.1;
/// How opaque the rim is.
const RIM_OPACITY: f32 = 0.7;

/// An arrow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrow {
    /// Its middle, pixels.
    pub middle: [f64; 2],
    /// From its tail to its tip, pixels to the right and down.
    pub reach: [f64; 2],
}

/// How long arrows are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArrowKey {
    /// Length of a vector whose arrow is as long as arrows are apart, in the field's unit.
    pub scale: f64,
    /// That, pixels.
    pub spacing: f64,
}

/// Arrows of a slice.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Arrows {
    /// Row by row.
    pub arrows: Vec<Arrow>,
    /// Length of a vector whose arrow is as long as the lattice's spacing, in the field's unit; 0 where there are no arrows.
    pub scale: f64,
}

/// The arrows of a lattice of that spacing in pixels; `scale` as [`Arrows::scale`], or found from those that are drawn.
pub fn of(slice: &Slice, spacing: f64, scale: Option<f64>) -> Arrows {
    let [columns, rows] = slice.size.map(|side| places(side, spacing));
    let lattice = rows.iter().flat_map(|y| columns.iter().map(move |x| [*x, *y]));
    let found = lattice.filter_map(|[x, y]| {
        let pixel = &slice.pixels[y * slice.size[0] + x];
        let speed = f64::from(pixel.speed);
        (pixel.has_direction() && speed > 0.0).then(|| ([x, y].map(|at| at as f64 + 0.5), pixel.along, speed))
    });
    let found: Vec<_> = found.collect();
    let usual = || {
        let mut speeds: Vec<f64> = found.iter().map(|(.., speed)| *speed).collect();
        speeds.sort_unstable_by(f64::total_cmp);
        let last = speeds.len().saturating_sub(1) as f64;
        speeds.get((SHARE * last).round() as usize).copied().unwrap_or(0.0)
    };
    let scale = scale.unwrap_or_else(usual);
    let arrow = |(middle, along, speed): &([f64; 2], [f32; 2], f64)| {
        let length = spacing * (speed / scale).min(LONGEST);
        Arrow { middle: *middle, reach: along.map(|part| length * f64::from(part)) }
    };
    Arrows { arrows: found.iter().map(arrow).collect(), scale: if found.is_empty() { 0.0 } else { scale } }
}

/// The pixels along a side of a picture that a lattice has arrows at, as far from one end as from the other.
fn places(side: usize, spacing: f64) -> Vec<usize> {
    let spacing = spacing.max(1.0);
    let count = (side as f64 / spacing).floor().max(1.0);
    let first = 0.5 * (side as f64 - (count - 1.0) * spacing);
    let place = |index: usize| (first + index as f64 * spacing) as usize;
    (0..count as usize).map(place).filter(|place| *place < side).collect()
}

/// Draws arrows over the colours, light with a dark rim, where there is something of the slice.
pub fn draw(slice: &mut Slice, arrows: &Arrows, spacing: f64) {
    let [width, height] = slice.size;
    // How much of each pixel is arrow, and rim: where arrows meet, their rims do not part them.
    let mut covered = vec![[0.0f32; 2]; slice.pixels.len()];
    for arrow in &arrows.arrows {
        for line in lines(arrow, spacing) {
            let span = |axis: usize, side: usize| {
                let (low, high) = (line[0][axis].min(line[1][axis]), line[0][axis].max(line[1][axis]));
                let beyond = HALF + RIM + 1.0;
                // Casts saturate, so that what lies outside becomes the border.
                (low - beyond).floor() as usize..((high + beyond).ceil() as usize).min(side)
            };
            for y in span(1, height) {
                for x in span(0, width) {
                    let away = distance([x as f64 + 0.5, y as f64 + 0.5], line);
                    let share = |half: f64| (half - away + 0.5).clamp(0.0, 1.0) as f32;
                    let [core, rim] = &mut covered[y * width + x];
                    (*core, *rim) = (core.max(share(HALF)), rim.max(share(HALF + RIM)));
                }
            }
        }
    }
    for (pixel, [core, rim]) in slice.pixels.iter_mut().zip(covered) {
        pixel.color = mix(mix(pixel.color, DARK, RIM_OPACITY * rim), LIGHT, core);
    }
}

/// The shaft and the barbs of an arrow, from end to end.
fn lines(arrow: &Arrow, spacing: f64) -> [[[f64; 2]; 2]; 3] {
    let [x, y] = arrow.reach;
    let length = x.hypot(y);
    let end = |share: f64| [arrow.middle[0] + share * x, arrow.middle[1] + share * y];
    let (tail, tip) = (end(-0.5), end(0.5));
    let barb = |side: f64| {
        let share = (BARBS[0] * length).min(BARBS[1] * spacing) / length.max(1e-30);
        let [cosine, sine] = [BARB[0] * share, side * BARB[1] * share];
        [tip, [tip[0] - cosine * x + sine * y, tip[1] - cosine * y - sine * x]]
    };
    [[tail, tip], barb(1.0), barb(-1.0)]
}

/// Distance of a point from a line between two ends.
fn distance(point: [f64; 2], [from, to]: [[f64; 2]; 2]) -> f64 {
    let along = [to[0] - from[0], to[1] - from[1]];
    let away = [point[0] - from[0], point[1] - from[1]];
    let square = along[0].mul_add(along[0], along[1] * along[1]);
    let share = if square > 0.0 { ((away[0] * along[0] + away[1] * along[1]) / square).clamp(0.0, 1.0) } else { 0.0 };
    (away[0] - share * along[0]).hypot(away[1] - share * along[1])
}

#[cfg(test)]
mod tests {
    use super::super::SlicePixel;
    use super::*;
    use crate::view::{Projection, View};
    use glam::DVec3;

    /// A turning disc in a plane across the line of sight.
    fn disc(rate: f64) -> Slice {
        let projection = Projection::Orthographic { height: 2.0 };
        let view = View::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y, projection, 160, 120).expect("a view");
        let mut slice = Slice::new(&view);
        for (at, pixel) in slice.pixels.iter_mut().enumerate() {
            let place = view.at_depth([(at % 160) as f64 + 0.5, (at / 160) as f64 + 0.5], 1.0);
            let solid = SlicePixel { alpha: 1.0, ..SlicePixel::NOTHING };
            // What is across the plane does not count.
            let vector = rate * DVec3::new(-place.y, place.x, 5.0);
            *pixel = solid.with_vector(&view, DVec3::Z, place, vector);
        }
        slice
    }

    /// Arrows of solid rotation are tangential, and as long as they are far from the middle.
    #[test]
    fn arrows_of_solid_rotation_are_tangential_and_grow_with_the_radius() {
        for (rate, scale) in [(3.0, Some(6.0)), (-0.02, None)] {
            let found = of(&disc(rate), 15.0, scale);
            assert_eq!(found.arrows.len(), 10 * 8);
            let is_longest = |arrow: &&Arrow| arrow.reach[0].hypot(arrow.reach[1]) > 15.0 * (LONGEST - 1e-6);
            assert_eq!(found.arrows.iter().filter(is_longest).count(), 0, "none is cut short");
            for Arrow { middle, reach } in &found.arrows {
                // Pixels run down; 60 of them are a unit of length.
                let (x, y) = (middle[0] - 80.0, 60.0 - middle[1]);
                let (right, up) = (reach[0], -reach[1]);
                let (radius, length) = (x.hypot(y), right.hypot(up));
                let sine = (right * x + up * y) / (radius * length);
                let turns = (x * up - y * right) * rate;
                assert!(sine.abs() < 1f64.to_radians().sin() && turns > 0.0, "{middle:?}: {reach:?}");
                let expected = 15.0 * rate.abs() * radius / 60.0 / found.scale;
                assert!((length / expected - 1.0).abs() < 1e-5, "{middle:?}: {length} for {expected}");
            }
            if scale.is_none() {
                let mut lengths: Vec<f64> =
                    found.arrows.iter().map(|arrow| arrow.reach[0].hypot(arrow.reach[1])).collect();
                lengths.sort_unstable_by(f64::total_cmp);
                assert!((lengths[75] / 15.0 - 1.0).abs() < 1e-5, "{}", lengths[75]);
            }
        }
    }

    /// What is drawn lies along the arrow, its heavier end at the tip, and nowhere else.
    #[test]
    fn an_arrow_is_drawn_from_its_tail_to_its_tip() {
        let size = [60usize, 40];
        let pixels = vec![SlicePixel { alpha: 1.0, ..SlicePixel::NOTHING }; size[0] * size[1]];
        let mut slice = Slice { size, pixels };
        let arrow = Arrow { middle: [30.5, 20.5], reach: [24.0, 0.0] };
        draw(&mut slice, &Arrows { arrows: vec![arrow], scale: 1.0 }, 30.0);
        let light = |x: usize| (0..size[1]).map(|y| slice.pixels[y * size[0] + x].color[0]).sum::<f32>();
        assert!((19..=42).all(|x| light(x) > 0.7), "the shaft is whole");
        assert!((0..16).chain(46..60).all(|x| light(x) == 0.0), "nothing beyond its ends");
        let [front, back] = [37..42, 19..24].map(|columns| columns.map(light).sum::<f32>());
        assert!(front > 1.5 * back, "{front} {back}");
    }

    #[test]
    fn a_field_of_nothing_has_no_arrows() {
        let mut slice = disc(1.0);
        slice.pixels.iter_mut().for_each(|pixel| *pixel = SlicePixel { along: [0.0; 2], speed: f32::NAN, ..*pixel });
        let before = slice.clone();
        let arrows = of(&slice, 15.0, None);
        assert_eq!(arrows, Arrows::default());
        draw(&mut slice, &arrows, 15.0);
        assert!(slice.pixels.iter().zip(&before.pixels).all(|(now, before)| now.color == before.color));
    }
}
