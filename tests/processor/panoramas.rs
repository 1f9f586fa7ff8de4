//! Panoramas against sums along each pixel's own rays: no face shows, light is conserved, discs are as large everywhere.

use deepfield::cpu::around::{along_ray, draw_face};
use deepfield::cpu::{Extent, Method, Positions, SplatOptions, Splats, Sprite, draw};
use deepfield::model::{Covariance, Kernel};
use deepfield::picture::panorama::{Texels, assemble};
use deepfield::synth::random::Random;
use deepfield::view::{CubeLayout, Omnidirectional, Panorama, Projection, Sampling, Sections, Surround, View};
use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;
use std::f64::consts::PI;

const SAMPLING: Sampling = Sampling { oversampling: 1.5, density: 1.5, margin: 0 };
const OPTIONS: SplatOptions = SplatOptions {
    method: Method::Exact,
    kernel: Kernel::CubicSpline,
    culling: true,
    faintest: 0.0,
    sprite: Sprite::Kernel,
};

/// Particles in the cube from -1 to 1, the eye among them.
struct Cloud {
    positions: Vec<[f64; 3]>,
    h: Vec<f32>,
    weight: Vec<f32>,
    attribute: Vec<f32>,
}

impl Cloud {
    fn random(count: usize, h: [f64; 2], seed: u64) -> Cloud {
        let mut random = Random::new(seed, 1);
        let mut next = || random.uniform();
        let positions = (0..count).map(|_| [0; 3].map(|_| 2.0 * next() - 1.0)).collect();
        let h = (0..count).map(|_| (h[0] * (h[1] / h[0]).powf(next())) as f32).collect();
        let weight = (0..count).map(|_| (0.5 + next()) as f32).collect();
        let attribute = (0..count).map(|_| next() as f32).collect();
        Cloud { positions, h, weight, attribute }
    }

    fn splats(&self) -> Splats<'_> {
        let extent = Extent::World(&self.h);
        Splats::new(Positions::World(&self.positions), extent, &self.weight, Some(&self.attribute)).unwrap()
    }

    /// Second moments of ellipsoids of about these sizes, four times as long as thick, turned anyhow.
    fn covariances(&self) -> Vec<Covariance> {
        let covariance = |(h, turn): (&f32, &[f64; 3])| {
            let radii = f64::from(*h) * OPTIONS.kernel.variance().sqrt() * DVec3::new(2.0, 1.0, 0.5);
            let axes = DMat3::from_quat(DQuat::from_scaled_axis(4.0 * DVec3::from(*turn)));
            Covariance::of(axes * DMat3::from_diagonal(radii * radii) * axes.transpose())
        };
        self.h.iter().zip(&self.positions).map(covariance).collect()
    }

    fn ellipsoids<'a>(&'a self, covariances: &'a [Covariance]) -> Splats<'a> {
        let extent = Extent::Ellipsoids(covariances);
        Splats::new(Positions::World(&self.positions), extent, &self.weight, Some(&self.attribute)).unwrap()
    }

    fn discs(&self, radius: f32) -> Splats<'_> {
        Splats::new(Positions::World(&self.positions), Extent::Pixels(radius), &self.weight, None).unwrap()
    }
}

fn base(width: u32, height: u32) -> View {
    let projection = Projection::Perspective { fov_y: 1.0 };
    View::look_at(DVec3::new(0.05, -0.1, 0.02), DVec3::new(0.4, 0.3, -0.8), DVec3::Y, projection, width, height)
        .unwrap()
}

fn panorama(surround: Surround, width: u32, height: u32) -> Panorama {
    Panorama::around(&base(width, height), surround).unwrap().unwrap()
}

fn picture(panorama: Panorama, circle: Option<Omnidirectional>, splats: &Splats<'_>, sampling: Sampling) -> Texels<2> {
    let sections = Sections::new(panorama, circle, sampling);
    let pixel = panorama.pixel_angle();
    let draw = |view: &View| draw_face(view, &[*splats], pixel, &OPTIONS).map(|(face, _)| face.into());
    assemble(&sections, &base(panorama.width, panorama.height), draw).unwrap()
}

/// The mean of 3 x 3 rays in a pixel, each from its own eye; `None` where one shows nothing.
fn exact(
    panorama: &Panorama,
    circle: Option<Omnidirectional>,
    splats: &Splats<'_>,
    [x, y]: [usize; 2],
) -> Option<[f64; 2]> {
    let middle = base(panorama.width, panorama.height).eye;
    let mut sum = [0.0; 2];
    for sample in 0..9 {
        let point = [x as f64 + (f64::from(sample % 3) + 0.5) / 3.0, y as f64 + (f64::from(sample / 3) + 0.5) / 3.0];
        let ray = panorama.direction(point)?;
        let azimuth = ray.dot(panorama.right).atan2(ray.dot(panorama.forward));
        let away = circle.map_or(DVec3::ZERO, |circle| circle.eye(azimuth, panorama.right, panorama.forward));
        let found = along_ray(&[*splats], OPTIONS.kernel, middle + away, ray);
        sum = [sum[0] + found[0] / 9.0, sum[1] + found[1] / 9.0];
    }
    Some(sum)
}

/// Relative L1 error over the solid angle of `P`, of `P S`, and of `P` in the pixels whose samples lie on two faces. Of all other pixels one of
/// `stride` stands for all: rays through kernels that hold the eye take long.
fn errors(panorama: Panorama, circle: Option<Omnidirectional>, splats: &Splats<'_>, stride: usize) -> [f64; 3] {
    let sections = Sections::new(panorama, circle, SAMPLING);
    let found = picture(panorama, circle, splats, SAMPLING);
    let width = panorama.width as usize;
    let per_pixel: Vec<[f64; 6]> = (0..found.values.len())
        .into_par_iter()
        .filter_map(|index| {
            let [x, y] = [index % width, index / width];
            let mut sides = Vec::new();
            sections.samples([x, y], sections.axes(sections.owner(x, y)), |side, _, _| sides.push(side));
            let is_seam = sides.iter().any(|side| *side != sides[0]);
            if !is_seam && !(x + 2 * y).is_multiple_of(stride) {
                return None;
            }
            let expected = exact(&panorama, circle, splats, [x, y])?;
            let (seam, stands_for) = if is_seam { (1.0, 1) } else { (0.0, stride) };
            let area = stands_for as f64 * panorama.solid_angle([x as f64 + 0.5, y as f64 + 0.5]);
            let error = |k: usize| area * (f64::from(found.values[index][k]) - expected[k]).abs();
            let expected = expected.map(|expected| area * expected);
            Some([error(0), expected[0], error(1), expected[1], seam * error(0), seam * expected[0]])
        })
        .collect();
    let sum = |k: usize| per_pixel.iter().map(|values| values[k]).sum::<f64>();
    [sum(0) / sum(1), sum(2) / sum(3), if sum(5) > 0.0 { sum(4) / sum(5) } else { 0.0 }]
}

/// The relative L1 error over the solid angle that sampling leaves of `P` and `P S` at most: a pixel of a face is a mean over its
/// area (variance 1/12 of its squared width along each axis), and reading between pixels blurs it further (1/6 in the mean); a blur
/// of the variance `v` changes a kernel by `v/2` times the integrals of its second derivatives, which for the cubic spline are
/// 12.0 flux over its squared angular radius, along each axis. Means of 3 x 3 rays, here and in the reference, lack 1/9 of a
/// pixel's own variance. Particles around the eye are larger and smoother than the others, and left out of the mean.
fn sampling_error(panorama: &Panorama, cloud: &Cloud) -> [f64; 2] {
    let face = 1.0 / SAMPLING.oversampling;
    let variance = face * face * (1.0 / 12.0 + 1.0 / 6.0) + 1.0 / (9.0 * 12.0);
    let mut sums = [[0.0; 2]; 2];
    for (i, &place) in cloud.positions.iter().enumerate() {
        let away = DVec3::from(place) - base(9, 9).eye;
        let (h, distance) = (f64::from(cloud.h[i]), away.length());
        if distance < 2.0 * h || panorama.pixel(away).is_none() {
            continue;
        }
        let flux = f64::from(cloud.weight[i]) / (distance * distance);
        let blurred = variance * 12.0 * (panorama.pixel_angle() * distance / h).powi(2);
        for (sum, share) in sums.iter_mut().zip([1.0, f64::from(cloud.attribute[i])]) {
            *sum = [sum[0] + share * flux * blurred, sum[1] + share * flux];
        }
    }
    sums.map(|[error, flux]| error / flux)
}

/// The picture is the sum along each pixel's own rays, an eye among the particles, for every projection, to what sampling leaves,
/// which falls with the square of a pixel's size: where faces meet, too.
#[test]
fn panoramas_are_sums_along_rays_and_have_no_seams() {
    let cloud = Cloud::random(60, [0.1, 0.6], 1);
    for (surround, [width, height]) in [
        (Surround::Dome { aperture: 180.0, tilt: 25.0 }, [96, 96]),
        (Surround::Dome { aperture: 320.0, tilt: -10.0 }, [128, 128]),
        (Surround::Equirectangular, [160, 80]),
        (Surround::Cube { layout: CubeLayout::Cross }, [40, 40]),
    ] {
        let [coarse, fine] = [1, 2].map(|finer| panorama(surround, finer * width, finer * height));
        let bound = sampling_error(&coarse, &cloud);
        let [coarse, fine] =
            [(coarse, 1), (fine, 5)].map(|(panorama, stride)| errors(panorama, None, &cloud.splats(), stride));
        assert!(coarse[0] < bound[0] && coarse[1] < bound[1], "{surround:?}: {coarse:?} of {bound:?}");
        // A quarter, were all kernels wide against a pixel and those around the eye exact: they have 1e-3 of their peak.
        for (coarse, fine) in coarse.into_iter().zip(fine) {
            assert!(fine < 0.35 * coarse + 1e-3, "{surround:?}: {coarse} becomes {fine}");
        }
    }
}

/// Particles that hold the eye, and those beside it, are where every ray from the eye meets them.
#[test]
fn kernels_around_the_eye_are_half_lines() {
    let cloud = Cloud::random(40, [0.8, 3.0], 2);
    let [p, ps, seam] = errors(panorama(Surround::Equirectangular, 64, 32), None, &cloud.splats(), 5);
    assert!(p < 1e-2 && ps < 1e-2 && seam < 1e-2, "{p} {ps} {seam}");
    // Clusters too, whose own shape it is that the rays meet.
    let cloud = Cloud::random(12, [0.8, 3.0], 5);
    let covariances = cloud.covariances();
    let panorama = panorama(Surround::Equirectangular, 128, 64);
    let [p, ps, seam] = errors(panorama, None, &cloud.ellipsoids(&covariances), 5);
    assert!(p < 1e-2 && ps < 1e-2 && seam < 1e-2, "{p} {ps} {seam}");
}

/// What small distant particles add up to over the solid angle is their weight over their squared distance.
#[test]
fn light_is_conserved_over_the_solid_angle() {
    let cloud = Cloud::random(400, [1e-3, 4e-3], 3);
    let splats = cloud.splats();
    for (surround, [width, height]) in [
        (Surround::Dome { aperture: 360.0, tilt: 0.0 }, [300, 300]),
        (Surround::Equirectangular, [400, 200]),
        (Surround::Cube { layout: CubeLayout::Strip }, [120, 120]),
    ] {
        let panorama = panorama(surround, width, height);
        let found = picture(panorama, None, &splats, SAMPLING);
        let width = panorama.width as usize;
        let place = |index: usize| [(index % width) as f64 + 0.5, (index / width) as f64 + 0.5];
        let sum: f64 = found
            .values
            .iter()
            .enumerate()
            .map(|(index, value)| f64::from(value[0]) * panorama.solid_angle(place(index)))
            .sum();
        let eye = base(9, 9).eye;
        let terms = cloud.positions.iter().zip(&cloud.weight);
        let expected: f64 = terms.map(|(&at, &w)| f64::from(w) / DVec3::from(at).distance_squared(eye)).sum();
        assert!((sum / expected - 1.0).abs() < 0.02, "{surround:?}: {sum} of {expected}");
    }
}

/// Discs have their radius in the panorama's pixels in the middle of a face, across a seam and in a corner, and the flux of a flat
/// picture's.
#[test]
fn discs_are_as_large_everywhere() {
    let panorama = panorama(Surround::Dome { aperture: 180.0, tilt: 0.0 }, 256, 256);
    let axes = panorama.frame();
    for local in
        [DVec3::new(0.01, 0.02, 1.0), DVec3::new(1.0, 0.1, 1.0), DVec3::new(1.0, 1.0, 1.0), DVec3::new(-0.9, 0.3, 0.25)]
    {
        let direction = (local.x * axes[0] + local.y * axes[1] + local.z * axes[2]).normalize();
        let star = |distance: f64| Cloud {
            positions: vec![(base(9, 9).eye + distance * direction).to_array()],
            h: vec![1.0],
            weight: vec![3.0],
            attribute: vec![1.0],
        };
        let found = picture(panorama, None, &star(1e5).discs(4.0), SAMPLING);
        assert_eq!(found, picture(panorama, None, &star(1e5).discs(4.0), SAMPLING));
        let pixel = panorama.pixel_angle();
        let (mut flux, mut spread, mut reach) = (0.0, 0.0, 0.0f64);
        for (index, value) in found.values.iter().enumerate() {
            let point = [(index % 256) as f64 + 0.5, (index / 256) as f64 + 0.5];
            let (Some(shown), p) = (panorama.direction(point), f64::from(value[0])) else { continue };
            let (share, away) =
                (p * panorama.solid_angle(point) / pixel.powi(2), shown.angle_between(direction) / pixel);
            flux += share;
            spread += share * away * away;
            reach = if p > 0.0 { reach.max(away) } else { reach };
        }
        assert!((flux / 3.0 - 1.0).abs() < 0.05, "{local}: flux {flux}");
        // From the middle of a pixel to one of its samples, from there to the middles of the face's pixels that it is read between,
        // and from those to the disc's rim.
        let (own, face) = (0.5f64.sqrt(), 1.0 / SAMPLING.oversampling);
        let most = 4.0 + own + face * 2f64.sqrt() + face * own;
        assert!(reach > 4.0 - own && reach < most, "{local}: reaches {reach} of {most} pixels");
        // The cubic spline's mean square radius is 0.15 of its squared support; a face's pixels, reading between them, and the
        // panorama's own pixels add their variances along both axes, less where a face's pixels are narrower.
        let radius = (spread / flux).sqrt();
        let [least, most] = [0.0, 2.0 * face * face * (1.0 / 12.0 + 1.0 / 6.0) + 2.0 / 12.0];
        let range = (0.15 * 16.0 + least).sqrt() - 0.03..(0.15 * 16.0 + most).sqrt() + 0.03;
        assert!(range.contains(&radius), "{local}: {radius} pixels, {range:?}");
    }
}

/// A sphere's outline is no circle on a fisheye: the pixels that show one (its contour at 2 % of the peak) are those whose rays
/// meet it.
#[test]
fn outlines_of_spheres_are_those_of_their_rays() {
    let places = (0..27).map(|i| [i % 3, i / 3 % 3, i / 9].map(|k| 0.8 * (f64::from(k) - 1.0)));
    let positions: Vec<[f64; 3]> = places.filter(|place| place.iter().any(|x| *x != 0.0)).collect();
    let count = positions.len();
    let cloud = Cloud { positions, h: vec![0.22; count], weight: vec![1.0; count], attribute: vec![1.0; count] };
    let splats = cloud.splats();
    for surround in [Surround::Dome { aperture: 220.0, tilt: 10.0 }, Surround::Equirectangular] {
        let panorama = panorama(surround, 200, 200);
        let found = picture(panorama, None, &splats, SAMPLING);
        let peak = OPTIONS.kernel.projected(0.0) / 0.22f64.powi(2);
        let (mut inside, mut wrong) = (0, 0);
        for index in 0..found.values.len() {
            let place = [index % 200, index / 200];
            let rays = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.5, 0.5]].map(|[dx, dy]| {
                let ray = panorama.direction([place[0] as f64 + 2.0 * dx - 0.5, place[1] as f64 + 2.0 * dy - 0.5])?;
                Some(along_ray(&[splats], OPTIONS.kernel, base(9, 9).eye, ray)[0] / peak)
            });
            // Pixels that an outline goes through or beside may show it or not.
            let all = |holds: fn(f64) -> bool| rays.iter().all(|ray| ray.is_some_and(holds));
            let shown = f64::from(found.values[index][0]) > 0.02 * peak;
            inside += usize::from(all(|p| p > 0.04));
            wrong += usize::from(all(|p| p > 0.04) && !shown || all(|p| p < 0.005) && shown);
        }
        assert!(inside > 1000 && wrong == 0, "{surround:?}: {wrong} of {inside}");
    }
}

/// What slices add to the relative L1 error at most: an eye that stands `s` off moves a kernel by `s`, across the line of sight,
/// and changes it by `s` times its derivative that way, whose integral is 2.8 flux over its radius for the cubic spline. In the
/// mean, a slice's eye is off by half of what it is at the slice's edges.
fn slicing_error(circle: &Omnidirectional, cloud: &Cloud) -> f64 {
    let shift = 0.5 * circle.slice_error(1.0, PI / 2.0);
    let eye = base(9, 9).eye;
    let mut sums = [0.0; 2];
    for (i, &place) in cloud.positions.iter().enumerate() {
        let h = f64::from(cloud.h[i]);
        // No kernel is brighter than one that is as far away as it is large.
        let flux = f64::from(cloud.weight[i]) / DVec3::from(place).distance_squared(eye).max(h * h);
        sums = [sums[0] + flux * 2.8 * shift / h, sums[1] + flux];
    }
    sums[0] / sums[1]
}

/// Slices of azimuth come near the picture in which each pixel has its own eye: all but what sampling leaves, which is there without
/// slices too, falls with their number.
#[test]
fn omnidirectional_stereo_is_that_of_each_pixels_own_eye() {
    let cloud = Cloud::random(25, [0.15, 0.5], 4);
    let splats = cloud.splats();
    for surround in [Surround::Dome { aperture: 180.0, tilt: 0.0 }, Surround::Equirectangular] {
        let panorama = panorama(surround, 96, 64);
        let [sampled, ..] = errors(panorama, None, &splats, 1);
        let mut before = f64::INFINITY;
        for slices in [8, 24, 72] {
            let circle = Omnidirectional { offset: 0.05, slices };
            let ([error, ..], bound) = (errors(panorama, Some(circle), &splats, 1), slicing_error(&circle, &cloud));
            assert!(error < 1.1 * sampled + bound, "{surround:?}: {error} of {sampled} + {bound}");
            assert!(error < before, "{surround:?}: {error} after {before}");
            before = error;
        }
        // Where slices are as narrow as pixels are, there is only what sampling leaves.
        assert!(before < 1.3 * sampled, "{surround:?}: {before} of {sampled}");
        // And two eyes see something else.
        let [left, right] = [-0.05, 0.05]
            .map(|offset| picture(panorama, Some(Omnidirectional { offset, slices: 30 }), &splats, SAMPLING));
        let apart: f64 = left.values.iter().zip(&right.values).map(|(a, b)| f64::from((a[0] - b[0]).abs())).sum();
        let all: f64 = left.values.iter().map(|a| f64::from(a[0])).sum();
        assert!(apart > 0.1 * all, "{apart} of {all}");
    }
}

/// A cube's faces are what a camera of 90 degrees sees, bit for bit.
#[test]
fn faces_of_a_cube_are_drawn_as_they_are() {
    let cloud = Cloud::random(200, [0.01, 0.03], 5);
    let splats = cloud.splats();
    let panorama = panorama(Surround::Cube { layout: CubeLayout::Strip }, 50, 50);
    let found = picture(panorama, None, &splats, SAMPLING);
    let view = base(50, 50);
    let projection = Projection::Perspective { fov_y: std::f64::consts::FRAC_PI_2 };
    let front = draw(&View { projection, ..view }, &[splats], &OPTIONS);
    let mut sum = 0.0;
    for (index, &p) in front.p.iter().enumerate() {
        let shown = found.values[(index / 50) * 300 + 250 + index % 50][0];
        assert!((p - shown).abs() <= 1e-5 * p.max(1.0), "{index}: {p} {shown}");
        sum += p;
    }
    assert!(sum > 0.0);
}
