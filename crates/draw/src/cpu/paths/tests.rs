//! Chords, coverage, order and faces.

use super::chords::{Chopper, TOLERANCE};
use super::stroke::{Stroke, kind};
use super::*;
use crate::color::Colors;
use crate::hierarchy::spacetime::HermiteSpline;
use crate::view::{Projection, View};
use glam::DVec3;
use proptest::prelude::*;

fn style(shape: PathShape) -> Style {
    Style {
        shape,
        width: 3.0,
        widest: 40.0,
        mean_mass: 1.0,
        opacity: 1.0,
        halo: 0.0,
        palette: Palette::plain([255; 3]),
        highlights: None,
        unwrapped: false,
        around: None,
    }
}

fn view(projection: Projection) -> View {
    View::look_at(DVec3::new(0.3, 0.2, 6.0), DVec3::ZERO, DVec3::Y, projection, 320, 240).unwrap()
}

const WHOLE: Part = Part { u: [0.0, 1.0], fade: [1.0, 1.0], head: true, place: [0.0, 1.0], interval: 0, intervals: 1 };

fn strokes(view: &View, curves: &Curves, style: &Style, part: Part, box_size: Option<f64>) -> Vec<Stroke> {
    let mut out = Vec::new();
    let drawn = Drawn { curves, which: None, shares: None, part, box_size };
    Chopper::new(view, style).chop(&drawn, 0..curves.len(), None, &mut vec![false; curves.len()], &mut out);
    out
}

fn drawn(view: &View, curves: &[Curves], style: &Style) -> Colors {
    let mut canvas = Canvas::default();
    let drawn: Vec<Drawn<'_>> =
        curves.iter().map(|curves| Drawn { curves, which: None, shares: None, part: WHOLE, box_size: None }).collect();
    canvas.gather(view, &drawn, style);
    let colors = canvas.colors();
    assert_eq!(canvas.fragments().colors(), colors, "both ways to a picture are one");
    colors
}

fn vector(size: f64) -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-size..size).prop_map(DVec3::from)
}

fn spline() -> impl Strategy<Value = HermiteSpline> {
    (vector(2.0), vector(2.0), vector(6.0), vector(6.0))
        .prop_map(|(r0, r1, v0, v1)| HermiteSpline { positions: [r0, r1], tangents: [v0, v1] })
}

/// Distance of a point from a chord.
fn distance([x, y]: [f64; 2], stroke: &Stroke) -> f64 {
    let [[x0, y0], [x1, y1]] = [stroke.from, stroke.to].map(|at| at.map(f64::from));
    let (dx, dy) = (x1 - x0, y1 - y0);
    let square = dx * dx + dy * dy;
    let along = if square > 0.0 { (((x - x0) * dx + (y - y0) * dy) / square).clamp(0.0, 1.0) } else { 0.0 };
    (x - x0 - along * dx).hypot(y - y0 - along * dy)
}

proptest! {
    #![proptest_config(crate::cases::cases(64))]

    #[test]
    fn chords_are_within_a_quarter_of_a_pixel(spline in spline(), from in 0.0..0.6f32, length in 0.05..0.4f32) {
        for projection in [Projection::Perspective { fov_y: 0.9 }, Projection::Orthographic { height: 7.0 }] {
            let view = view(projection);
            let part = Part { u: [from, from + length], head: false, ..WHOLE };
            let all = strokes(&view, &Curves::of(&[spline], 1.0), &style(PathShape::Line), part, None);
            for i in 0..=200 {
                let u = f64::from(from) + f64::from(length) * f64::from(i) / 200.0;
                let camera = view.to_camera(spline.position(u));
                let Some([x, y]) = view.to_pixels(camera).filter(|_| camera.z > 0.1) else { continue };
                if !(0.0..320.0).contains(&x) || !(0.0..240.0).contains(&y) {
                    continue;
                }
                let nearest = all.iter().map(|stroke| distance([x, y], stroke)).fold(f64::INFINITY, f64::min);
                prop_assert!(nearest <= f64::from(TOLERANCE) + 0.01, "{nearest} at {u}");
            }
            // And none of them leads elsewhere: they join.
            for pair in all.windows(2) {
                prop_assert!(pair[0].to == pair[1].from || pair[0].to.iter().chain(&pair[1].from).any(|x| !(-50.0..400.0).contains(x)));
            }
        }
    }

    #[test]
    fn a_stroke_has_its_width_times_its_length(
        angle in 0.0..std::f64::consts::TAU, length in 1.0..2.5f64, width in 0.3..9.0f32, at in vector(0.3),
    ) {
        let view = view(Projection::Orthographic { height: 6.0 });
        let way = DVec3::new(angle.cos(), angle.sin(), 0.0) * length;
        let at = DVec3::new(at.x, at.y, 0.0);
        // In three parts, which meet in lines that no pixel is on both sides of.
        let part = |i: f64| {
            let ends = [at + way * (i / 3.0 - 0.5), at + way * ((i + 1.0) / 3.0 - 0.5)];
            Curves::of(&[HermiteSpline { positions: ends, tangents: [way / 3.0; 2] }], 1.0)
        };
        let curves = [0.0, 1.0, 2.0].map(part);
        let style = Style { width, ..style(PathShape::Line) };
        let mut canvas = Canvas::default();
        let drawn: Vec<Drawn<'_>> = curves.iter().enumerate().map(|(i, curves)| {
            Drawn { curves, which: None, shares: None, part: Part { head: i == 2, ..WHOLE }, box_size: None }
        }).collect();
        canvas.gather(&view, &drawn, &style);
        let sum: f64 = canvas.colors().rgba.iter().map(|pixel| f64::from(pixel[3])).sum();
        let expected = f64::from(width) * length * 40.0;
        // Only where it begins a pixel is drawn or not as a whole.
        let slack = 0.03 * expected + f64::from(width.max(1.0)) * 0.8;
        prop_assert!((sum - expected).abs() <= slack, "{sum} {expected}");
    }

    #[test]
    fn the_order_of_tracks_changes_nothing(splines in prop::collection::vec(spline(), 1..40), turn in 0usize..40, shape in 0usize..4) {
        let view = view(Projection::Perspective { fov_y: 0.9 });
        let style = Style { opacity: 0.7, halo: 1.0, ..style(PathShape::ALL[shape]) };
        let one = [Curves::of(&splines, 1.0)];
        let mut other = splines.clone();
        other.rotate_left(turn % splines.len());
        other.reverse();
        // The same place for all, so that single precision rounds alike.
        let mut turned = Curves::of(&other, 1.0);
        turned.origin = one[0].origin;
        turned.points = other.iter().map(|spline| spline.control_points().map(|at| (at - turned.origin).as_vec3().to_array())).collect();
        let bits = |colors: Colors| colors.rgba.as_flattened().iter().map(|c| c.to_bits()).collect::<Vec<_>>();
        let first = bits(drawn(&view, &one, &style));
        prop_assert_eq!(&first, &bits(drawn(&view, &[turned], &style)));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        prop_assert_eq!(&first, &bits(pool.install(|| drawn(&view, &one, &style))));
    }

    #[test]
    fn paths_are_cut_at_the_faces_of_a_periodic_box(begin in prop::array::uniform3(0.0..1.0f64), way in vector(0.8)) {
        let begin = DVec3::from(begin);
        let eye = DVec3::new(0.5, 0.5, 9.0);
        let projection = Projection::Orthographic { height: 3.0 };
        let view = View::look_at(eye, DVec3::new(0.5, 0.5, 0.0), DVec3::Y, projection, 300, 300).unwrap();
        let straight = HermiteSpline { positions: [begin, begin + way], tangents: [way; 2] };
        let part = Part { head: false, ..WHOLE };
        let all = strokes(&view, &Curves::of(&[straight], 1.0), &style(PathShape::Line), part, Some(1.0));
        let (mut sum, whole) = (0.0, 100.0 * way.truncate().length());
        for stroke in all.iter().filter(|stroke| stroke.kind & (kind::BALL | kind::HEAD) == 0) {
            // The box is in the middle third.
            for at in stroke.from.iter().chain(&stroke.to) {
                prop_assert!((99.99..=200.01).contains(at), "{stroke:?}");
            }
            sum += f64::from(stroke.to[0] - stroke.from[0]).hypot(f64::from(stroke.to[1] - stroke.from[1]));
        }
        prop_assert!((sum - whole).abs() < 0.02 * whole + 0.05, "{sum} {whole}");
        // In one piece, to where its particle is in the box at the present; or from there on.
        let unwrapped = Style { unwrapped: true, ..style(PathShape::Line) };
        for (fade, end) in [([0.5, 1.0], 1.0), ([1.0, 0.5], 0.0)] {
            let part = Part { fade, ..part };
            let all = strokes(&view, &Curves::of(&[straight], 1.0), &unwrapped, part, Some(1.0));
            let place = begin + way * end;
            let shift = -place.floor();
            for (stroke, place, at) in [
                (&all[0], begin + shift, all[0].from),
                (&all[all.len() - 1], begin + way + shift, all[all.len() - 1].to),
            ] {
                let [x, y] = view.to_pixels(view.to_camera(place)).unwrap();
                let away = (f64::from(at[0]) - x).hypot(f64::from(at[1]) - y);
                let is_within = |at: f64| (0.0..300.0).contains(&at);
                prop_assert!(away < 0.01 || !is_within(x) || !is_within(y), "{stroke:?} {place}");
            }
        }
    }
}

#[test]
fn waves_leave_nothing_out_that_is_seen() {
    // So many that they hide each other but at the rim, some of which fade, and some of which come close to the eye.
    let mut random = 1_u64;
    let mut next = || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 40) as f64 / f64::from(1 << 24) - 0.5
    };
    let mut vector = |size: f64| DVec3::new(next(), next(), next()) * (2.0 * size);
    let splines: Vec<HermiteSpline> = (0..40_000)
        .map(|_| {
            let (begin, way) = (vector(1.5), vector(0.2));
            HermiteSpline { positions: [begin, begin + way], tangents: [way + vector(0.1), way + vector(0.1)] }
        })
        .collect();
    let mut curves = Curves::of(&splines, 1.0);
    curves.flags.iter_mut().step_by(17).for_each(|flags| flags.0 = crate::hierarchy::spacetime::TrackFlags::FADES);
    for (shape, projection) in PathShape::ALL.into_iter().zip([
        Projection::Perspective { fov_y: 0.5 },
        Projection::Orthographic { height: 4.0 },
        Projection::Perspective { fov_y: 2.0 },
        Projection::Orthographic { height: 2.0 },
    ]) {
        let view = view(projection);
        let style = Style { opacity: 0.9, halo: 1.0, width: 8.0, ..style(shape) };
        let drawn = || [Drawn { curves: &curves, which: None, shares: None, part: WHOLE, box_size: None }];
        let [mut whole, mut waves] = [Canvas::default(), Canvas::default()];
        whole.gather_in(&raster::AT_ONCE, &view, &drawn(), &style);
        waves.gather_in(&raster::IN_WAVES, &view, &drawn(), &style);
        // So wide heads of so long arrows reach more blocks than are looked up.
        let counts = [&waves, &whole].map(|canvas| canvas.strokes().count());
        assert!(shape == PathShape::Arrow || 4 * counts[0] < 3 * counts[1], "{shape:?}: {counts:?}");
        assert_eq!(waves.colors(), whole.colors(), "{shape:?}");
        let seen = |canvas: &Canvas| {
            let mut seen = Vec::new();
            canvas.each_seen(|_, place| seen.push(place));
            seen.sort_unstable();
            seen
        };
        assert_eq!(seen(&waves), seen(&whole), "{shape:?}");
    }
}

#[test]
fn what_is_in_front_hides_what_is_behind() {
    let view = view(Projection::Perspective { fov_y: 0.9 });
    let line = |z: f64, way: DVec3| HermiteSpline {
        positions: [DVec3::new(0.0, 0.0, z) - way, DVec3::new(0.0, 0.0, z) + way],
        tangents: [2.0 * way; 2],
    };
    let mut curves = Curves::of(&[line(1.0, DVec3::X), line(-1.0, DVec3::Y)], 1.0);
    // Told apart by their masses.
    curves.mass = vec![[1.0; 2], [2.0; 2]];
    let palette = Palette {
        quantity: Quantity::Mass,
        colors: vec![[255, 0, 0], [0, 0, 255]],
        scale: crate::color::transfer::Scale::Linear,
        range: [1.0, 2.0],
    };
    let picture = drawn(&view, &[curves], &Style { palette, halo: 1.0, ..style(PathShape::Line) });
    let [x, y] = view.to_pixels(view.to_camera(DVec3::new(0.0, 0.0, 1.0))).unwrap();
    let middle = picture.rgba[y as usize * 320 + x as usize];
    assert!(middle[0] > 0.99 && middle[2] < 1e-3 && middle[3] > 0.999, "{middle:?}");
    let blue = picture.rgba.iter().filter(|pixel| pixel[2] > 0.9).count();
    assert!(blue > 100, "{blue}");
}

#[test]
fn nothing_hostile_panics() {
    let huge = [f64::NAN, f64::INFINITY, 1e300, -1e300, 0.0, 1e-300];
    for a in huge {
        for b in huge {
            let spline = HermiteSpline {
                positions: [DVec3::new(a, b, 1.0), DVec3::new(1.0, a, b)],
                tangents: [DVec3::new(b, 0.0, a), DVec3::new(a, a, b)],
            };
            for projection in [Projection::Perspective { fov_y: 0.9 }, Projection::Orthographic { height: 7.0 }] {
                for box_size in [None, Some(1.0)] {
                    let mut canvas = Canvas::default();
                    let curves = Curves::of(&[spline], 1.0);
                    let drawn = Drawn { curves: &curves, which: None, shares: None, part: WHOLE, box_size };
                    canvas.gather(&view(projection), &[drawn], &style(PathShape::Comet));
                    drop(canvas.colors());
                }
            }
        }
    }
}
