//! Faces of panoramas: what they show in a direction does not depend on where their plane is.

use super::*;
use crate::cpu::around::along_ray;

/// Relative L2 distance of all channels.
fn apart(found: &Colors, expected: &Colors) -> f64 {
    let square = |pairs: &mut dyn Iterator<Item = (f32, f32)>| -> f64 {
        pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt()
    };
    let (found, expected) = (found.rgba.as_flattened(), expected.rgba.as_flattened());
    let all = || expected.iter().copied();
    square(&mut found.iter().copied().zip(all())) / square(&mut all().map(|value| (value, 0.0)))
}

fn face(view: &View, batch: Splats<'_>, colors: &SplatColors, pixel: f64) -> Colors {
    let over = Over { order: Order::Exact, kernel: Kernel::CubicSpline, colors, column: COLUMN, around: Some(pixel) };
    draw(view, &[batch], &over).0
}

/// Balls of these radii in the cube from -1 to 1.
struct Balls {
    scene: Scene,
    h: Vec<f32>,
}

impl Balls {
    fn random(count: usize, [least, most]: [f64; 2], seed: u64) -> Balls {
        let mut random = Random::new(seed, 1);
        let (mut scene, mut h) = (Scene::default(), Vec::new());
        for _ in 0..count {
            let mut value = || 2.0 * random.uniform() - 1.0;
            scene.push([value(), value(), value()], Covariance::default(), 1.0 + value() as f32, value() as f32);
            h.push((least + (most - least) * random.uniform()) as f32);
        }
        Balls { scene, h }
    }

    fn batch(&self) -> Splats<'_> {
        let Scene { positions, weight, density, attribute, .. } = &self.scene;
        let batch = Splats::new(Positions::World(positions), Extent::World(&self.h), weight, Some(attribute)).unwrap();
        batch.with_density(Some(density)).unwrap()
    }

    fn discs(&self, radius: f32) -> Splats<'_> {
        let Scene { positions, weight, attribute, .. } = &self.scene;
        Splats::new(Positions::World(positions), Extent::Pixels(radius), weight, Some(attribute)).unwrap()
    }
}

/// From afar, in the middle of the picture, a pixel of the panorama is one of the picture.
#[test]
fn a_face_is_the_flat_picture_of_its_direction() {
    let eye = DVec3::new(65.0, 97.0, 162.0);
    let view = look(eye, Projection::Perspective { fov_y: 2.2 / eye.length() }, 96, 80);
    let pixel = view.focal_pixels().recip();
    let (colors, balls) = (colors([0.1, 100.0]), Balls::random(400, [0.02, 0.3], 3));
    let flat = picture(&view, balls.batch(), &colors, Order::Exact);
    assert!(flat.rgba.iter().any(|pixel| pixel[3] > 0.5));
    let found = apart(&face(&view, balls.batch(), &colors, pixel), &flat);
    println!("balls: {found:.1e}");
    assert!(found < 5e-5, "balls: {found}");
    let bright = super::colors([0.001, 0.3]);
    let flat = picture(&view, balls.discs(4.0), &bright, Order::Exact);
    let found = apart(&face(&view, balls.discs(4.0), &bright, pixel), &flat);
    println!("discs: {found:.1e}");
    assert!(found < 2e-3, "discs: {found}");
    // A flat picture draws what is so far away as ellipses, to second order.
    let scene = Scene::random(400, 5, false);
    let flat = picture(&view, scene.batch(), &colors, Order::Exact);
    let found = apart(&face(&view, scene.batch(), &colors, pixel), &flat);
    println!("ellipsoids: {found:.1e}");
    assert!(found < 1e-3, "ellipsoids: {found}");
}

/// With an eye among the splats: a direction looks the same on a face where it is at the edge as on one around it.
#[test]
fn no_direction_depends_on_the_face() {
    let eye = DVec3::new(0.1, -0.05, 0.15);
    let wide = Projection::Perspective { fov_y: std::f64::consts::FRAC_PI_2 };
    let view = View::look_at(eye, eye + DVec3::new(0.3, 0.2, -1.0), DVec3::Y, wide, 65, 65).unwrap();
    let pixel = view.focal_pixels().recip();
    let (colors, bright) = (colors([0.1, 100.0]), colors([0.001, 0.3]));
    let mut scene = Scene::random(300, 9, false);
    scene.covariances.iter_mut().for_each(|covariance| {
        *covariance = Covariance::of(0.6 * covariance.matrix() + glam::DMat3::from_diagonal(DVec3::splat(1e-3)));
    });
    let balls = Balls::random(300, [0.1, 0.8], 4);
    for (batch, colors) in [(scene.batch(), &colors), (balls.batch(), &colors), (balls.discs(5.0), &bright)] {
        let whole = face(&view, batch, colors, pixel);
        let mut opaque = 0.0f32;
        for [x, y] in [[0, 0], [64, 5], [32, 0], [40, 40], [3, 60], [64, 64], [20, 31]] {
            let place = [f64::from(x) + 0.5, f64::from(y) + 0.5];
            let ahead = view.at_depth(place, 1.0) - eye;
            let small = Projection::Perspective { fov_y: 3.0 * pixel };
            let small = View::look_at(eye, eye + ahead, DVec3::Y, small, 3, 3).unwrap();
            let (expected, found) =
                (face(&small, batch, colors, pixel).rgba[4], whole.rgba[y as usize * 65 + x as usize]);
            assert!((0..4).all(|k| (found[k] - expected[k]).abs() < 3e-3), "{x} {y}: {found:?} {expected:?}");
            opaque = opaque.max(found[3]);
        }
        assert!(opaque > 0.1, "{opaque}");
    }
}

/// An eye among the splats sees what lies before it along each ray, none of it twice.
#[test]
fn rays_begin_at_the_eye() {
    let eye = DVec3::new(0.1, -0.05, 0.15);
    let wide = Projection::Perspective { fov_y: std::f64::consts::FRAC_PI_2 };
    let view = View::look_at(eye, eye + DVec3::new(-0.7, 0.2, 0.4), DVec3::Y, wide, 64, 48).unwrap();
    let colors = colors([0.1, 300.0]);
    let balls = Balls::random(300, [0.3, 1.0], 8);
    // As narrow pixels as blur nothing.
    let found = face(&view, balls.batch(), &colors, 1e-4);
    for (index, pixel) in found.rgba.iter().enumerate().step_by(7) {
        let place = [(index % 64) as f64 + 0.5, (index / 64) as f64 + 0.5];
        let ray = view.at_depth(place, 1.0) - eye;
        let [p, _] = along_ray(&[balls.batch()], Kernel::CubicSpline, eye, ray);
        let expected = 1.0 - (-colors.depth() * p).exp();
        assert!((f64::from(pixel[3]) - expected).abs() < 2e-3, "{place:?}: {pixel:?} {expected}");
    }
}
