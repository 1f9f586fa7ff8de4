//! Paths in pictures of all directions, put together from faces.

use crate::color::Colors;
use crate::cpu::paths::{Canvas, Curves, Drawn, Palette, Part, PathShape, Style};
use crate::hierarchy::spacetime::HermiteSpline;
use crate::picture::panorama::{Texels, assemble};
use crate::view::{CubeLayout, Panorama, Projection, Sampling, Sections, Surround, View};
use glam::DVec3;
use proptest::prelude::*;

const SAMPLING: Sampling = Sampling { oversampling: 1.5, density: 1.5, margin: 0 };
const EYE: DVec3 = DVec3::new(0.5, -0.25, 1.0);
const WHOLE: Part = Part { u: [0.0, 1.0], fade: [1.0, 1.0], head: true, place: [0.0, 1.0], interval: 0, intervals: 1 };

fn style(shape: PathShape, width: f32) -> Style {
    Style {
        shape,
        width,
        widest: 100.0,
        mean_mass: 1.0,
        opacity: 1.0,
        halo: 0.0,
        palette: Palette::plain([255; 3]),
        highlights: None,
        unwrapped: false,
        around: None,
    }
}

fn base(surround: Surround) -> View {
    let projection = Projection::Perspective { fov_y: 1.0 };
    let [width, height] = match surround {
        Surround::Equirectangular => [512, 256],
        Surround::Dome { .. } => [512, 512],
        _ => [128, 128],
    };
    View::look_at(EYE, EYE + DVec3::new(0.3, 0.2, -1.0), DVec3::Y, projection, width, height).unwrap()
}

fn panorama(surround: Surround, curves: &Curves, style: &Style) -> (Panorama, Texels<4>) {
    let base = base(surround);
    let panorama = Panorama::around(&base, surround).unwrap().unwrap();
    let sections = Sections::new(panorama, None, SAMPLING);
    let style = Style { around: Some(panorama.pixel_angle()), ..style.clone() };
    let mut canvas = Canvas::default();
    let texels = assemble(&sections, &base, |view| {
        canvas.gather(view, &[Drawn { curves, which: None, shares: None, part: WHOLE, box_size: None }], &style);
        Ok::<_, std::convert::Infallible>(Texels::from(canvas.colors()))
    });
    (panorama, texels.unwrap())
}

/// The solid angle that a picture covers, by opacity.
fn covered(panorama: &Panorama, picture: &Texels<4>) -> f64 {
    let width = panorama.width as usize;
    let of = |(index, value): (usize, &[f32; 4])| {
        let at = [index % width, index / width].map(|place| place as f64 + 0.5);
        f64::from(value[3]) * panorama.solid_angle(at)
    };
    picture.values.iter().enumerate().filter(|(_, value)| value[3] > 0.0).map(of).sum()
}

/// All directions: nothing is cut off.
const ALL: [Surround; 3] = [
    Surround::Dome { aperture: 360.0, tilt: 20.0 },
    Surround::Equirectangular,
    Surround::Cube { layout: CubeLayout::Cross },
];

fn direction() -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-1.0..1.0f64)
        .prop_map(DVec3::from)
        .prop_filter("too short", |way| (0.2..1.0).contains(&way.length()))
        .prop_map(DVec3::normalize)
}

proptest! {
    #![proptest_config(crate::cases::cases(6))]

    /// A straight path is an arc of a great circle: every place on it is where it is seen, over the seams of faces too, and it has its width
    /// times its length.
    #[test]
    fn a_path_goes_on_over_the_seams_of_faces(begin in direction(), end in direction(), near in 0.5..2.0f64, far in 0.5..2.0f64) {
        let angle = begin.angle_between(end);
        prop_assume!((0.3..2.5).contains(&angle));
        let ends = [EYE + near * begin, EYE + far * end];
        let curves = Curves::of(&[HermiteSpline { positions: ends, tangents: [ends[1] - ends[0]; 2] }], 1.0);
        for surround in ALL {
            let (panorama, picture) = panorama(surround, &curves, &style(PathShape::Line, 4.0));
            for i in 1..400 {
                let way = ends[0].lerp(ends[1], f64::from(i) / 400.0) - EYE;
                // Its ends are as blurred as its sides.
                if ends.iter().any(|end| (*end - EYE).angle_between(way) < 2.0 * panorama.pixel_angle()) {
                    continue;
                }
                let Some([x, y]) = panorama.pixel(way) else { continue };
                let index = (y as usize).min(panorama.height as usize - 1) * panorama.width as usize
                    + (x as usize).min(panorama.width as usize - 1);
                // Pixels at the rims of a picture lie on both sides of it.
                prop_assert!(picture.values[index][3] > 0.75, "{surround:?} {way}: {:?}", picture.values[index]);
            }
            let expected = angle * 4.0 * panorama.pixel_angle();
            let found = covered(&panorama, &picture);
            prop_assert!((found - expected).abs() < 0.05 * expected, "{surround:?}: {found} {expected}");
        }
    }

    /// A ball is as large in every direction, as long as it is small: sizes on a face are those in the ball's middle.
    #[test]
    fn heads_are_as_large_in_every_direction(at in direction(), distance in 0.5..2.0f64) {
        let place = EYE + distance * at;
        let curves = Curves::of(&[HermiteSpline { positions: [place; 2], tangents: [DVec3::ZERO; 2] }], 1.0);
        for surround in ALL {
            let (panorama, picture) = panorama(surround, &curves, &style(PathShape::Comet, 4.0));
            let radius = 4.0 * panorama.pixel_angle();
            let (found, expected) = (covered(&panorama, &picture), std::f64::consts::PI * radius * radius);
            prop_assert!((found - expected).abs() < 0.1 * expected, "{surround:?} {at}: {found} {expected}");
        }
    }
}

/// The face of a cube is the flat picture of that view, but for widths, which are angles there.
#[test]
fn a_face_is_a_flat_picture() {
    let ends = [EYE + DVec3::new(-0.2, 0.1, -2.0), EYE + DVec3::new(0.7, 0.3, -2.0)];
    let curves = Curves::of(&[HermiteSpline { positions: ends, tangents: [ends[1] - ends[0]; 2] }], 1.0);
    let projection = Projection::Perspective { fov_y: std::f64::consts::FRAC_PI_2 };
    let view = View::look_at(EYE, EYE - DVec3::Z, DVec3::Y, projection, 200, 200).unwrap();
    let drawn = |around: Option<f64>| -> Colors {
        let mut canvas = Canvas::default();
        let style = Style { around, ..style(PathShape::Line, 3.0) };
        canvas.gather(
            &view,
            &[Drawn { curves: &curves, which: None, shares: None, part: WHOLE, box_size: None }],
            &style,
        );
        canvas.colors()
    };
    let rows = |colors: &Colors, column: usize| -> [f64; 2] {
        let column = |row: usize| f64::from(colors.rgba[row * 200 + column][3]);
        let sum: f64 = (0..200).map(column).sum();
        [sum, (0..200).map(|row| row as f64 * column(row)).sum::<f64>() / sum]
    };
    let (flat, face) = (drawn(None), drawn(Some(0.01)));
    for column in 95..130 {
        let [width, at] = rows(&flat, column);
        let [wider, same] = rows(&face, column);
        assert!((at - same).abs() < 0.1 && wider / width > 0.99 && wider / width < 1.2, "{column}: {width} {wider}");
    }
}
