//! Ambient occlusion against hemispheres in closed form, shadows against the disc of the lamp, counted ray by ray.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use super::*;
use crate::view::Projection;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What scenes are made of.
#[derive(Clone, Copy)]
enum Shape {
    /// Places `p` with `normal p = offset`.
    Plane(DVec3, f64),
    /// The part of a plane through the origin on one side of an axis: `normal p = 0`, `side p >= 0`.
    Half(DVec3, DVec3),
    /// A middle and a radius.
    Sphere(DVec3, f64),
}

impl Shape {
    /// Where a ray meets it first, from its origin on.
    fn meets(&self, origin: DVec3, way: DVec3) -> f64 {
        let at = match *self {
            Shape::Plane(normal, offset) => (offset - normal.dot(origin)) / normal.dot(way),
            Shape::Half(normal, side) => {
                let at = -normal.dot(origin) / normal.dot(way);
                if side.dot(origin + at * way) >= 0.0 { at } else { f64::NAN }
            }
            Shape::Sphere(middle, radius) => {
                let from = origin - middle;
                let (square, half) = (way.length_squared(), way.dot(from));
                let root = (half * half - square * (from.length_squared() - radius * radius)).sqrt();
                (-half - root) / square
            }
        };
        if at > 0.0 { at } else { f64::INFINITY }
    }
}

/// The depths of a scene in a view, by a ray for each pixel.
fn depths(view: &View, shapes: &[Shape]) -> Vec<f32> {
    let pixel = |index: u32| {
        let at = [index % view.width, index / view.width].map(|at| f64::from(at) + 0.5);
        // Along a ray places change evenly with the depth.
        let origin = view.at_depth(at, 0.0);
        let way = view.at_depth(at, 1.0) - origin;
        shapes.iter().map(|shape| shape.meets(origin, way)).fold(f64::INFINITY, f64::min) as f32
    };
    (0..view.width * view.height).map(pixel).collect()
}

fn nobody(_: &View) -> Option<Vec<f32>> {
    None
}

fn occlusion(radius: f64) -> Shadowing {
    Shadowing {
        occlusion: 1.0,
        radius,
        shadows: 0.0,
        lamp: None,
        ambient: 0.0,
        scene: 10.0,
        slack: 0.0,
        is_costly: false,
        samples: 16,
    }
}

fn look(eye: [f64; 3], target: [f64; 3], projection: Projection, size: [u32; 2]) -> View {
    View::look_at(DVec3::from(eye), DVec3::from(target), DVec3::Y, projection, size[0], size[1]).unwrap()
}

const PERSPECTIVE: Projection = Projection::Perspective { fov_y: 0.7 };
const ORTHOGRAPHIC: Projection = Projection::Orthographic { height: 2.0 };

#[test]
fn nothing_occludes_a_plane_however_it_is_seen() {
    for projection in [PERSPECTIVE, ORTHOGRAPHIC] {
        for degrees in [0.0_f64, 37.0, 70.0, 85.0, 89.0] {
            for turned in [0.3_f64, 1.5] {
                let (sine, cosine) = degrees.to_radians().sin_cos();
                let normal = DVec3::new(sine * turned.cos(), sine * turned.sin(), cosine);
                let view = look([0.0, 0.0, 3.0], [0.0; 3], projection, [60, 48]);
                let seen = depths(&view, &[Shape::Plane(normal, 0.0)]);
                let factors = occlusion(5.0).factors(&view, &seen, &nobody, None).unwrap();
                assert!(factors.iter().all(|factor| *factor == 1.0), "{projection:?} {degrees} {turned}");
            }
        }
    }
}

/// Between two half-planes at an angle `b` the cosine-weighted share of the hemisphere that is open is `(1 - cos b) / 2`, at every place of either.
#[test]
fn a_groove_is_as_open_as_its_angle() {
    // A narrow and a wide one in each projection.
    for (projection, angles) in [(PERSPECTIVE, [60.0_f64, 120.0]), (ORTHOGRAPHIC, [90.0, 150.0])] {
        for degrees in angles {
            let half = (0.5 * degrees).to_radians();
            // The groove's edge is the y axis, it opens towards z, and is looked into from a little aside.
            let faces = [1.0, -1.0].map(|sign| {
                let along = DVec3::new(sign * half.sin(), 0.0, half.cos());
                Shape::Half(DVec3::new(-sign * half.cos(), 0.0, half.sin()), along)
            });
            let view = look([0.4, 0.3, 3.0], [0.0; 3], projection, [221, 221]);
            let seen = depths(&view, &faces);
            let factors = occlusion(4.0).factors(&view, &seen, &nobody, None).unwrap();
            let expected = 0.5 * (1.0 - degrees.to_radians().cos());
            // Two pixels from the edge, of which the picture shows 110 in each direction.
            for column in [108, 112] {
                let found = f64::from(factors[110 * 221 + column]);
                assert!((found - expected).abs() < 0.04, "{projection:?} {degrees}, {column}: {found}, not {expected}");
            }
        }
    }
}

/// What is beyond the radius occludes nothing, and half of the strength takes half.
#[test]
fn occlusion_ends_at_the_radius() {
    // A ball before a wall, seen from where both touch.
    let view = look([0.0, 3.0, 1.5], [0.0; 3], ORTHOGRAPHIC, [120, 120]);
    let ball = Shape::Sphere(DVec3::new(0.0, 0.0, 0.3), 0.3);
    let seen = depths(&view, &[Shape::Plane(DVec3::Z, 0.0), ball]);
    let of = |shadowing: Shadowing| shadowing.factors(&view, &seen, &nobody, None).unwrap();
    let (all, half) = (of(occlusion(0.2)), of(Shadowing { occlusion: 0.5, ..occlusion(0.2) }));
    assert!(all.iter().any(|factor| *factor < 0.8));
    for (index, (all, half)) in all.iter().zip(&half).enumerate() {
        assert!((half - 0.5 * (1.0 + all)).abs() < 1e-5);
        let place = view.at_depth([index % 120, index / 120].map(|at| at as f64 + 0.5), f64::from(seen[index]));
        let is_near = place.distance(DVec3::new(0.0, 0.0, 0.3)) < 0.3 + 0.21;
        assert!(is_near || *all == 1.0, "{place}: {all}");
    }
    assert!(!Shadowing { occlusion: 0.0, ..occlusion(0.2) }.is_on());
}

/// A ball over a plane under a lamp straight above: its shadow's core and edge lie where the disc's rim is seen past the ball, and between them as much
/// light comes as there is of the disc.
#[test]
fn a_shadow_is_as_soft_as_its_lamp_is_large() {
    let (middle, height) = (DVec3::new(0.0, 0.0, 3.0), 3.0);
    let shapes = [Shape::Plane(DVec3::Z, 0.0), Shape::Sphere(middle, 1.0)];
    let view = View::look_at(
        DVec3::new(0.0, -8.0, 8.0),
        DVec3::ZERO,
        DVec3::Z,
        Projection::Orthographic { height: 6.0 },
        96,
        96,
    )
    .unwrap();
    let seen = depths(&view, &shapes);
    // A costly picture is drawn once for what is near each other of the lamp, and its edges are half a pixel too far within.
    let pictures = [(0.0_f64, false, 1), (8.0, false, 16), (20.0, false, 16), (8.0, true, 1), (19.0, true, 4)];
    for (degrees, is_costly, expected) in pictures {
        let size = degrees.to_radians();
        let lamp = Lamp { toward: DVec3::Z, size, lights: true };
        let shadowing =
            Shadowing { occlusion: 0.0, shadows: 1.0, lamp: Some(lamp), scene: 12.0, is_costly, ..occlusion(1.0) };
        let drawn = AtomicUsize::new(0);
        let casters = |from: &View| {
            drawn.fetch_add(1, Ordering::Relaxed);
            Some(depths(from, &shapes))
        };
        let factors = shadowing.factors(&view, &seen, &casters, None).unwrap();
        assert_eq!(drawn.into_inner(), expected, "{degrees}");
        // The rim's rays that touch the ball on one and on the other side.
        let [core, edge] = [-1.0, 1.0].map(|sign| 1.0 / (0.5 * size).cos() + sign * height * (0.5 * size).tan());
        let square = (0..40).flat_map(|i| (0..40).map(move |j| [i, j].map(|k| (f64::from(k) + 0.5) / 20.0 - 1.0)));
        let disc: Vec<[f64; 2]> = square.filter(|[x, y]| x * x + y * y < 1.0).collect();
        let reach = (0.5 * size).tan();
        let exact = |place: DVec3| {
            let passes =
                |[x, y]: &&[f64; 2]| shapes[1].meets(place, DVec3::new(reach * x, reach * y, 1.0)).is_infinite();
            disc.iter().filter(passes).count() as f64 / disc.len() as f64
        };
        // A pixel of the lamp's picture, and places of the disc that are not its rim.
        let blurred = 0.12;
        let (mut cores, mut between, mut away) = (0, 0u32, 0.0);
        for (index, found) in factors.iter().map(|factor| f64::from(*factor)).enumerate() {
            let place = view.at_depth([index % 96, index / 96].map(|at| at as f64 + 0.5), f64::from(seen[index]));
            let radius = place.truncate().length();
            if place.z > 0.01 {
                continue;
            }
            if radius < core - blurred {
                cores += 1;
                assert!(found < 1e-3, "{degrees}: {found} at {radius} within {core}");
            } else if radius > edge + blurred {
                assert!(found > 0.999, "{degrees}: {found} at {radius} beyond {edge}");
            } else if degrees > 0.0 {
                let error = (found - exact(place)).abs();
                assert!(
                    error < if is_costly { 0.25 } else { 0.13 },
                    "{degrees}: {found} at {radius}, not {}",
                    exact(place)
                );
                (between, away) = (between + 1, away + error);
            }
        }
        assert!(cores > 5 && (degrees == 0.0 || between > 50), "{degrees}: {cores}, {between}");
        let (mean, most) = (away / f64::from(between.max(1)), if is_costly { 0.05 } else { 0.03 });
        assert!(mean < most, "{degrees}: {mean}");
    }
}

/// What is small in a picture has few pixels in a lamp's, too: as many for each length.
#[test]
fn lamps_see_as_finely_as_the_picture() {
    let ball = [Shape::Sphere(DVec3::ZERO, 1.5)];
    let orthographic = look([0.0, 0.0, 9.0], [0.0; 3], Projection::Orthographic { height: 8.0 }, [800, 800]);
    let perspective = look([0.0, 0.0, 9.0], [0.0; 3], PERSPECTIVE, [800, 800]);
    for (view, across) in [(orthographic, 300.0), (perspective, 3.0 * perspective.focal_pixels() / 7.5)] {
        let seen = depths(&view, &ball);
        for (degrees, is_costly, finer) in [(0.0_f64, false, 2.0), (2.0, false, 1.0), (2.0, true, 1.0)] {
            let lamp = Some(Lamp { toward: DVec3::Z, size: degrees.to_radians(), lights: true });
            let own = Shadowing { occlusion: 0.0, shadows: 1.0, lamp, is_costly, samples: 3, ..occlusion(1.0) };
            let longest = AtomicUsize::new(0);
            let casters = |from: &View| {
                longest.fetch_max(from.width.max(from.height) as usize, Ordering::Relaxed);
                Some(depths(from, &ball))
            };
            own.factors(&view, &seen, &casters, None).unwrap();
            let pixels = longest.into_inner() as f64 / (finer * across);
            // A costly picture has more around what is lit.
            assert!((0.9..1.25).contains(&pixels), "{degrees}, {is_costly}: {pixels} of {across}");
        }
    }
}

/// Nothing but the first fragment that covers a pixel is darkened.
#[test]
fn what_is_seen_through_keeps_its_light() {
    let view = look([1.5, 0.0, 3.0], [0.0; 3], ORTHOGRAPHIC, [64, 64]);
    let mut seen = depths(&view, &[Shape::Half(DVec3::Z, DVec3::X), Shape::Half(DVec3::X, DVec3::Z)]);
    // A hole.
    seen[20 * 64 + 50] = f32::INFINITY;
    let veil = PathFragment { depth: 0.1, color: [0.5; 3], alpha: 0.3 };
    let mut fragments = PathFragments::everywhere([64, 64], &[veil, veil]);
    let own = &mut fragments.tiles[0].fragments;
    for (pixel, depth) in seen.iter().enumerate().filter(|(_, depth)| depth.is_finite()) {
        own[2 * pixel + 1] = PathFragment { depth: *depth, color: [1.0; 3], alpha: 1.0 };
    }
    let shadowing = occlusion(0.5);
    let mut told = fragments.colors();
    shadowing.darken_fragments(&view, &mut fragments, &nobody, None);
    let factors = shadowing.factors(&view, &seen, &nobody, None).unwrap();
    assert!(factors.iter().any(|factor| *factor < 0.7));
    for (pixel, depth) in seen.iter().enumerate() {
        let [first, second] = fragments.of(pixel % 64, pixel / 64) else { panic!("two fragments") };
        let expected = if depth.is_finite() { factors[pixel] } else { 0.5 };
        assert!(*first == veil && second.color == [expected; 3]);
    }
    // Who has drawn the picture tells what covers it, and what light that adds behind the veil.
    let light = seen.iter().map(|depth| [if depth.is_finite() { 1.0 - veil.alpha } else { 0.0 }; 3]).collect();
    let covering = Covering { depths: seen.clone(), light: Some(light), slack: 0.0 };
    shadowing.darken_covering(&view, &covering, &mut told, &nobody, None);
    let mut pairs = told.rgba.iter().flatten().zip(fragments.colors().rgba.into_iter().flatten());
    assert!(pairs.all(|(told, own)| (told - own).abs() < 1e-6));
    let mut colors = Colors { width: 64, height: 64, rgba: vec![[1.0; 4]; 64 * 64] };
    shadowing.darken(&view, &seen, &mut colors, &nobody, None);
    assert!(colors.rgba.iter().zip(&factors).all(|(color, factor)| *color == [*factor, *factor, *factor, 1.0]));
}

/// A ball on a plane, each of another kind of data, is as dark as both are as one, and so is the plane: in the core of the shadow that the sun casts
/// there is no light of it, at the foot of the ball less of the sky, and beyond both all of it. The plane by itself is exactly as bright as it was.
#[test]
fn kinds_darken_each_other_as_one_darkens_itself() {
    let (plane, ball) = (Shape::Plane(DVec3::Z, 0.0), Shape::Sphere(DVec3::new(0.0, 0.0, 0.5), 0.5));
    let projection = Projection::Orthographic { height: 4.0 };
    let view =
        View::look_at(DVec3::new(0.0, -5.0, 6.0), DVec3::new(0.0, 0.0, 0.3), DVec3::Z, projection, 96, 96).unwrap();
    let sun = Lamp { toward: DVec3::new(1.0, 0.0, 1.0).normalize(), size: 0.1, lights: true };
    let all = |lamp: Lamp| Shadowing { shadows: 1.0, lamp: Some(lamp), ..occlusion(0.6) };
    let factors = |own: &[Shape], other: &[Shape], shadowing: Shadowing| {
        let drawn = |from: &View| Some(depths(from, own));
        let beside = |from: &View| Some(depths(from, other));
        let others = Others { casters: &beside, scene: 10.0, sun: Some(sun) };
        shadowing.factors(&view, &depths(&view, own), &drawn, Some(&others)).unwrap()
    };
    assert!(factors(&[plane], &[], all(sun)).iter().all(|factor| *factor == 1.0));
    let of_plane = factors(&[plane], &[ball], all(sun));
    let sky = factors(&[plane], &[ball], occlusion(0.6));
    // What has a lamp of its own beside the eye has the sun's direction.
    let of_ball = factors(&[ball], &[plane], all(Lamp { toward: DVec3::Y, size: 0.0, lights: false }));
    let [as_plane, as_ball] = [true, false].map(|lights| factors(&[plane, ball], &[], all(Lamp { lights, ..sun })));
    let [plane_depths, ball_depths] = [plane, ball].map(|shape| depths(&view, &[shape]));
    let (mut core, mut foot, mut beyond, mut apart) = (0, 0, 0, 0.0_f64);
    for (index, open) in sky.iter().enumerate() {
        let depth = plane_depths[index].min(ball_depths[index]);
        let place = view.at_depth([index % 96, index / 96].map(|at| at as f64 + 0.5), f64::from(depth));
        let (x, y) = (place.x, place.y);
        if ball_depths[index] < plane_depths[index] {
            apart += f64::from((of_ball[index] - as_ball[index]).abs());
            continue;
        }
        apart += f64::from((of_plane[index] - as_plane[index]).abs());
        if (x + 0.5).hypot(y) < 0.35 {
            core += 1;
            assert!(of_plane[index] < 1e-3, "{place}: {}", of_plane[index]);
        }
        let away = x.hypot(y);
        if (y + 0.3).hypot(x) < 0.1 {
            foot += 1;
            assert!((0.25..0.7).contains(open), "{place}: {open}");
        } else if (y + 0.7).hypot(x) < 0.1 {
            assert!((0.93..1.0).contains(open), "{place}: {open}");
        } else if away > 1.6 && x > 0.0 {
            beyond += 1;
            assert!(of_plane[index] == 1.0 && *open == 1.0, "{place}: {} {open}", of_plane[index]);
        }
    }
    assert!(core > 50 && foot > 5 && beyond > 500, "{core} {foot} {beyond}");
    assert!(apart / f64::from(96 * 96) < 1e-3, "{apart}");
    // A radius is a share of all that the picture shows.
    assert!(factors(&[plane], &[ball], Shadowing { radius: 0.3, scene: 5.0, ..all(sun) }) == of_plane);
}

/// With few samples shadows are as dark and about as wide, in fewer steps; with one, the lamp is a point.
#[test]
fn fewer_samples_are_steps_towards_the_same() {
    let shapes = [Shape::Plane(DVec3::Z, 0.0), Shape::Sphere(DVec3::new(0.0, 0.0, 2.0), 1.0)];
    let view = look([0.0, -6.0, 6.0], [0.0; 3], Projection::Orthographic { height: 6.0 }, [64, 64]);
    let seen = depths(&view, &shapes);
    let lit = |samples: u32, size: f64| {
        let lamp = Some(Lamp { toward: DVec3::Z, size, lights: true });
        let shadowing = Shadowing { occlusion: 0.0, shadows: 1.0, lamp, samples, ..occlusion(1.0) };
        shadowing.factors(&view, &seen, &|from: &View| Some(depths(from, &shapes)), None).unwrap()
    };
    let full = lit(16, 0.2);
    for (samples, most) in [(1, 0.05), (4, 0.02), (8, 0.01)] {
        let away: f32 = lit(samples, 0.2).iter().zip(&full).map(|(few, all)| (few - all).abs()).sum();
        assert!(away / 4096.0 < most, "{samples}: {}", away / 4096.0);
    }
    assert!(lit(1, 0.2) == lit(16, 0.0));
}
