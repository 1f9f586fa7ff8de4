use super::*;
use crate::cases::cases;
use crate::cpu::Positions;
use crate::model::Covariance;
use proptest::prelude::*;
use std::f64::consts::TAU;

const SIZE: [u32; 2] = [80, 60];

/// Where the surface at so many standard deviations is seen from an eye: points of it whose normals are across the line of sight.
fn silhouette(view: &View, place: DVec3, axes: DMat3) -> Vec<[f64; 2]> {
    let eye = match view.projection {
        Projection::Perspective { .. } => axes.inverse() * (view.eye - place),
        // The eye is infinitely far away.
        Projection::Orthographic { .. } => axes.inverse() * (-1e9 * view.forward),
    };
    // In the space where the surface is the unit sphere, what is touched is the circle `t . eye = 1`.
    let toward = eye.normalize();
    let (middle, radius) = (toward / eye.length(), (1.0 - eye.length_squared().recip()).sqrt());
    let [across, up] = [toward.any_orthonormal_vector(), toward.cross(toward.any_orthonormal_vector())];
    let point = |k: u32| {
        let (sin, cos) = (f64::from(k) / 1500.0 * TAU).sin_cos();
        let world = place + axes * (middle + radius * (cos * across + sin * up));
        view.to_pixels(view.to_camera(world))
    };
    (0..1500).filter_map(point).collect()
}

proptest! {
    #![proptest_config(cases(100))]

    /// Pixels of a line are those near the silhouette of the surface, in either projection, and what is within is filled.
    #[test]
    fn lines_lie_on_the_silhouette_of_the_covariance(
        radii in prop::array::uniform3(0.02..0.6f64),
        turn in prop::array::uniform3(-3.0..3.0f64),
        place in prop::array::uniform3(-0.5..0.5f64),
        deviations in 0.5..2.0f64,
        width in 0.8..4.0f64,
        perspective in any::<bool>(),
        fill in prop_oneof![Just(0.0f32), Just(0.4f32)],
    ) {
        let projection = match perspective {
            true => Projection::Perspective { fov_y: 0.7 },
            false => Projection::Orthographic { height: 3.0 },
        };
        let view = View::look_at(DVec3::new(0.4, -0.3, 4.0), DVec3::ZERO, DVec3::Y, projection, SIZE[0], SIZE[1]).unwrap();
        let turned = glam::DQuat::from_scaled_axis(DVec3::from(turn));
        let factor = DMat3::from_quat(turned) * DMat3::from_diagonal(DVec3::from(radii));
        let covariances = [Covariance::of(factor * factor.transpose())];
        let positions = [place];
        let batch = Splats::new(Positions::World(&positions), Extent::Ellipsoids(&covariances), &[1.0], None).unwrap();
        let options = OutlineOptions { kernel: Kernel::default(), deviations, width, fill, dimmed: 1.0 };
        let (colors, report) = draw(&view, &[batch], &options, |_, _| [1.0, 0.5, 0.25]);
        prop_assert_eq!(report.particles, 1);
        let edge = silhouette(&view, DVec3::from(place), deviations * factor);
        let (ellipse, _) = ellipse(&view, &batch, 0, &options).unwrap();
        let [short, long] = ellipse.radii();
        // Distances are of first order: within sharp ends they are too far.
        let is_round = short * short / long > 3.0;
        let at = |[x, y]: [f64; 2]| colors.rgba[y as usize * SIZE[0] as usize + x as usize][3];
        for &[x, y] in edge.iter().filter(|at| (0..2).all(|k| (0.0..f64::from(SIZE[k])).contains(&at[k]))) {
            prop_assert!(at([x, y]) > 0.0, "{x} {y}");
        }
        for (index, rgba) in colors.rgba.iter().enumerate() {
            prop_assert!((rgba[0] - rgba[3]).abs() < 1e-5 && (rgba[2] - 0.25 * rgba[3]).abs() < 1e-5);
            if !is_round {
                continue;
            }
            let [x, y] = [index % SIZE[0] as usize, index / SIZE[0] as usize].map(|k| k as f64 + 0.5);
            let squares = edge.iter().map(|[u, v]| (u - x).powi(2) + (v - y).powi(2));
            let near = squares.fold(f64::INFINITY, f64::min).sqrt();
            let [right, down] = [x - ellipse.center[0], y - ellipse.center[1]];
            let square = ((right - ellipse.shear * down) / ellipse.half[0]).powi(2) + (down / ellipse.half[1]).powi(2);
            let (line, slack) = (0.5 * width, 0.35);
            if near < line - 0.5 - slack {
                prop_assert!(rgba[3] >= 0.99, "{x} {y}: {} at {near}", rgba[3]);
            }
            if near > line + 0.5 + slack {
                let expected = if square < 1.0 { fill } else { 0.0 };
                prop_assert!((rgba[3] - expected).abs() < 1e-5, "{x} {y}: {} at {near}, {square}", rgba[3]);
            }
        }
    }
}

/// The line's light is its length times its width, wherever its edge lies among the pixels and however thin it is.
#[test]
fn lines_have_the_same_area_at_any_place() {
    let projection = Projection::Orthographic { height: f64::from(SIZE[1]) };
    let view = View::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y, projection, SIZE[0], SIZE[1]).unwrap();
    let kernel = Kernel::default();
    for (radius, width) in [(20.0, 0.5), (20.3, 1.0), (23.7, 2.5), (0.001, 3.0)] {
        let positions = [[0.31, -0.17, -5.0]];
        let lengths = [(radius / kernel.variance().sqrt()) as f32];
        let batch = Splats::new(Positions::World(&positions), Extent::World(&lengths), &[1.0], None).unwrap();
        let options = OutlineOptions { kernel, deviations: 1.0, width, fill: 0.0, dimmed: 1.0 };
        let (colors, _) = draw(&view, &[batch], &options, |_, _| [1.0; 3]);
        let area: f64 = colors.rgba.iter().map(|rgba| f64::from(rgba[3])).sum();
        let half = 0.5 * width;
        let hole = f64::max(radius - half, 0.0);
        let expected = 0.5 * TAU * ((radius + half).powi(2) - hole * hole);
        assert!((area / expected - 1.0).abs() < 0.05, "{radius} {width}: {area} of {expected}");
    }
}

#[test]
fn near_ones_cover_far_ones_and_the_others_are_left_out() {
    let projection = Projection::Perspective { fov_y: 0.8 };
    let view = View::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, projection, 64, 64).unwrap();
    // The near one second; one behind the eye, one that reaches behind it, one beside the picture, and ones without a size.
    let positions =
        [[0.0, 0.0, -4.0], [0.0, 0.0, -2.0], [0.0, 0.0, 3.0], [0.0, 0.0, -0.5], [9.0, 0.0, -2.0], [0.0; 3], [0.0; 3]];
    let variance = Kernel::default().variance().sqrt() as f32;
    let lengths = [0.4, 0.2, 0.2, 0.6, 0.2, f32::NAN, 0.0].map(|radius| radius / variance);
    let batch = Splats::new(Positions::World(&positions), Extent::World(&lengths), &[1.0; 7], None).unwrap();
    let options = OutlineOptions { kernel: Kernel::default(), deviations: 1.0, width: 2.0, fill: 1.0, dimmed: 0.25 };
    let color = |_: &Splats<'_>, index: usize| if index == 1 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let (colors, report) = draw(&view, &[batch], &options, color);
    assert_eq!(report.particles, 2);
    assert_eq!(colors.rgba[32 * 64 + 32], [0.25, 0.0, 0.0, 1.0]);
    assert_eq!(colors.rgba[0], [0.0; 4]);
}
