//! Sums among surfaces against integrals along every ray.

use super::*;
use crate::cases::cases;
use crate::cpu::layered::caps::Caps;
use crate::cpu::paths::PathFragment;
use crate::cpu::paths::fragments::TileFragments;
use crate::cpu::{Method, Positions, draw_counted};
use crate::model::{Covariance, Kernel};
use crate::synth::random::Random;
use crate::view::Projection;
use proptest::prelude::*;

/// Pixels along a side.
const SIDE: u32 = 24;

fn view(orthographic: bool, side: u32) -> View {
    let projection = match orthographic {
        true => Projection::Orthographic { height: 2.0 },
        false => Projection::Perspective { fov_y: 0.5 },
    };
    View::look_at(DVec3::Z * 4.0, DVec3::ZERO, DVec3::Y, projection, side, side).expect("a view")
}

/// Fragments of each pixel, as `of` has them.
fn surfaces(side: u32, mut of: impl FnMut() -> Vec<PathFragment>) -> PathFragments {
    let mut tile = TileFragments { starts: vec![0], fragments: Vec::new() };
    for _ in 0..side * side {
        tile.fragments.extend(of());
        tile.starts.push(tile.fragments.len() as u32);
    }
    PathFragments { size: [side as usize; 2], side: side as usize, tiles: vec![tile], is_hazy: false }
}

fn fragment(depth: f64, alpha: f64) -> PathFragment {
    PathFragment { depth: depth as f32, color: [1.0; 3], alpha: alpha as f32 }
}

/// `P` of a pixel: the mean over many of its rays of the integral along each, from surface to surface.
fn expected(
    view: &View,
    kernel: Kernel,
    particles: &[(DVec3, f64, f64)],
    fragments: &[PathFragment],
    [x, y]: [u32; 2],
) -> f64 {
    const RAYS: u32 = 8;
    const STEPS: u32 = 24;
    let lens = Lens::new(view);
    let mut sum = 0.0;
    for (i, j) in (0..RAYS).flat_map(|j| (0..RAYS).map(move |i| (i, j))) {
        let at = |pixel: u32, part: u32| f64::from(pixel) + (f64::from(part) + 0.5) / f64::from(RAYS);
        let (start, direction) = lens.sight([at(x, i), at(y, j)]);
        for (place, h, weight) in particles {
            let camera = view.to_camera(*place);
            let middle = (camera - start).dot(direction) / direction.length_squared();
            let half = h / direction.length();
            let (mut from, last) = (middle - half, middle + half);
            let ends = fragments.iter().map(|fragment| f64::from(fragment.depth).clamp(from, last));
            for to in ends.chain([last]).collect::<Vec<_>>() {
                let share = f64::from(visible(fragments, (0.5 * (from + to)) as f32));
                let step = (to - from) / f64::from(STEPS);
                for k in 0..STEPS {
                    let place = start + (from + (f64::from(k) + 0.5) * step) * direction;
                    let value = kernel.value((place - camera).length() / h) / h.powi(3);
                    sum += weight * value * step * direction.length() * share;
                }
                from = to;
            }
        }
    }
    sum / f64::from(RAYS * RAYS)
}

proptest! {
    #![proptest_config(cases(24))]

    /// Pixel by pixel, whatever surfaces cover of it and at which depths.
    #[test]
    fn what_is_in_front_is_summed_and_nothing_else(seed in any::<u64>(), orthographic in any::<bool>(), kernel in prop::sample::select(Kernel::ALL.to_vec())) {
        let mut random = Random::new(seed, 1);
        let view = view(orthographic, SIDE);
        let particles: Vec<(DVec3, f64, f64)> = (0..5)
            .map(|_| {
                let place = DVec3::from_array(std::array::from_fn(|_| 1.4 * random.uniform() - 0.7));
                (place, 0.15 + 0.5 * random.uniform(), 1.0 + random.uniform())
            })
            .collect();
        let between = |random: &mut Random| 3.0 + 2.0 * random.uniform();
        let surfaces = surfaces(SIDE, || match (4.0 * random.uniform()) as u32 {
            0 => Vec::new(),
            1 => vec![fragment(between(&mut random), 1.0)],
            2 => vec![fragment(between(&mut random), random.uniform())],
            _ => {
                let (first, next) = (between(&mut random), between(&mut random));
                vec![fragment(first.min(next), random.uniform()), fragment(first.max(next), 1.0)]
            }
        });
        let places: Vec<[f64; 3]> = particles.iter().map(|(place, ..)| place.to_array()).collect();
        let (lengths, weights): (Vec<f32>, Vec<f32>) =
            particles.iter().map(|&(_, h, weight)| (h as f32, weight as f32)).unzip();
        let attribute: Vec<f32> = weights.iter().map(|weight| 3.0 * weight).collect();
        let covariances: Vec<Covariance> = lengths
            .iter()
            .map(|h| Covariance([(f64::from(h * h) * kernel.variance()) as f32; 3].into_iter().chain([0.0; 3]).collect::<Vec<_>>().try_into().expect("six")))
            .collect();
        let options = SplatOptions { kernel, method: Method::Exact, ..SplatOptions::default() };
        for extent in [Extent::World(&lengths), Extent::Ellipsoids(&covariances)] {
            let batch = Splats::new(Positions::World(&places), extent, &weights, Some(&attribute)).expect("columns");
            let (picture, counts) = draw(&view, &[batch], &options, &surfaces).expect("a picture");
            prop_assert!(counts.drawn <= 5);
            let most = picture.p.iter().copied().fold(0.0, f32::max);
            for (index, &found) in picture.p.iter().enumerate().step_by(11) {
                let pixel = [index as u32 % SIDE, index as u32 / SIDE];
                let fragments = surfaces.of(pixel[0] as usize, pixel[1] as usize);
                let expected = expected(&view, kernel, &particles, fragments, pixel);
                prop_assert!((f64::from(found) - expected).abs() < 0.012 * f64::from(most), "{pixel:?}: {found}, not {expected} of {most}");
            }
        }
    }

    /// However small and large particles are, none of the light in front of a plane is lost, and none from behind it added.
    #[test]
    fn light_in_front_of_a_plane_is_conserved(seed in any::<u64>(), kernel in prop::sample::select(Kernel::ALL.to_vec())) {
        let mut random = Random::new(seed, 2);
        let side = 96;
        let view = view(true, side);
        let plane = 3.8 + 0.4 * random.uniform();
        let surfaces = PathFragments::everywhere([side as usize; 2], &[fragment(plane, 1.0)]);
        let mut places = Vec::new();
        let (mut lengths, mut expected) = (Vec::new(), 0.0);
        for _ in 0..40 {
            let h = 10f64.powf(-4.0 + 3.3 * random.uniform());
            let spread = (1.0 - h) * 0.9;
            let depth = plane + 1.5 * h * (2.0 * random.uniform() - 1.0);
            places.push([spread * (2.0 * random.uniform() - 1.0), spread * (2.0 * random.uniform() - 1.0), 4.0 - depth]);
            lengths.push(h as f32);
            expected += Caps::of(kernel).between(-1.0, (plane - depth) / h).map_or(0.0, |part| part.mass);
        }
        let weights = vec![1.0_f32; places.len()];
        let batch = Splats::new(Positions::World(&places), Extent::World(&lengths), &weights, None).expect("columns");
        let options = SplatOptions { kernel, ..SplatOptions::default() };
        let (picture, _) = draw(&view, &[batch], &options, &surfaces).expect("a picture");
        let found = picture.sum() * (2.0 / f64::from(side)).powi(2);
        prop_assert!((found - expected).abs() < 1e-3 * expected.max(1.0), "{found}, not {expected}");
    }
}

#[test]
fn what_hides_nothing_changes_nothing_and_what_hides_all_leaves_nothing() {
    let mut random = Random::new(7, 3);
    for orthographic in [false, true] {
        let view = view(orthographic, 64);
        let places: Vec<[f64; 3]> = (0..500).map(|_| std::array::from_fn(|_| 1.6 * random.uniform() - 0.8)).collect();
        let lengths: Vec<f32> = (0..500).map(|_| 0.2 * random.uniform() as f32).collect();
        let weights = vec![1.0_f32; 500];
        for extent in [Extent::World(&lengths), Extent::Pixels(2.5)] {
            let batch = Splats::new(Positions::World(&places), extent, &weights, Some(&lengths)).expect("columns");
            let options = SplatOptions::default();
            let plain = draw_counted(&view, &[batch], &options);
            let at = |depth: f64| PathFragments::everywhere([64; 2], &[fragment(depth, 1.0)]);
            assert!(draw(&view, &[batch], &options, &at(9.0)).expect("a picture") == plain, "far behind");
            let (hidden, _) = draw(&view, &[batch], &options, &at(0.5)).expect("a picture");
            assert!(hidden.p.iter().chain(&hidden.ps).all(|value| *value == 0.0), "before the eye");
        }
    }
}

#[test]
fn glare_is_seen_as_far_as_its_middle_is() {
    let view = view(false, 32);
    let options = SplatOptions::default();
    let places = [[0.0, 0.0, 0.0]];
    let batch = Splats::new(Positions::World(&places), Extent::Pixels(3.0), &[8.0], None).expect("columns");
    let light = |depth: f64, alpha: f64| {
        let surfaces = PathFragments::everywhere([32; 2], &[fragment(depth, alpha)]);
        draw(&view, &[batch], &options, &surfaces).expect("a picture").0.sum()
    };
    assert_eq!(light(3.9, 1.0), 0.0);
    let [whole, part] = [light(4.1, 1.0), light(3.9, 0.25)];
    assert!((whole - 8.0).abs() < 0.01 && (part - 0.75 * whole).abs() < 1e-4 * whole, "{whole} {part}");
}
