//! Fields of columns against sums over all particles, and what pictures of them show.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use super::*;
use crate::color::transfer::{Curve, Scale, TransferFunction};
use crate::cpu::volume::bricks::{BORDER, BRICK, Slab};
use crate::cpu::volume::supply::tests::{Group, Groups};
use crate::cpu::volume::tests::{Cloud, RAMP, draw, look, perspective, scenery};
use crate::cpu::volume::{Classifier, Light, Surface, VolumeLevels, cast_in_parts};
use crate::cpu::{Extent, Positions};
use crate::model::Kernel;
use crate::synth::merger::Merger;
use crate::synth::random::Random;
use crate::view::Projection;
use glam::DVec3;
use proptest::prelude::*;

/// Particles whose columns are drawn.
struct Gas {
    positions: Vec<[f64; 3]>,
    h: Vec<f32>,
    mass: Vec<f32>,
    density: Vec<f32>,
    volumes: Vec<f32>,
    fields: Vec<Vec<f32>>,
}

impl Gas {
    /// With an attribute as the first column, and the density as the second one.
    fn new(positions: Vec<[f64; 3]>, h: Vec<f32>, mass: Vec<f32>, density: Vec<f32>, attribute: Vec<f32>) -> Gas {
        let volumes = mass.iter().zip(&density).map(|(mass, density)| mass / density).collect();
        let fields = vec![attribute, density.clone()];
        Gas { positions, h, mass, density, volumes, fields }
    }

    /// A lattice of density 1 whose attribute is its first coordinate.
    fn lattice() -> Gas {
        let Cloud { positions, h, mass, attribute } = Cloud::lattice(24, 2.0);
        let density = vec![1.0; h.len()];
        Gas::new(positions, h, mass, density, attribute)
    }

    fn batch(&self) -> Splats<'_> {
        let (positions, extent) = (Positions::World(&self.positions), Extent::World(&self.h));
        Splats::new(positions, extent, &self.volumes, Some(&self.fields[0])).unwrap().with_fields(&self.fields).unwrap()
    }

    /// Particle by particle: `sum m / rho W`, `sum m A / rho W` (F12 3.2) and `sum m W`.
    fn sums(&self, at: DVec3) -> [f64; 3] {
        let mut sums = [0.0; 3];
        for (i, &h) in self.h.iter().enumerate() {
            let q = (at - DVec3::from_array(self.positions[i])).length() / f64::from(h);
            if q < 1.0 {
                let [mass, density, value] = [self.mass[i], self.density[i], self.fields[0][i]].map(f64::from);
                let kernel = Kernel::CubicSpline.value(q) / f64::from(h).powi(3);
                sums[0] += mass / density * kernel;
                sums[1] += mass * value / density * kernel;
                sums[2] += mass * kernel;
            }
        }
        sums
    }
}

#[test]
fn fields_are_the_exact_sums_on_a_merger() {
    let dataset = crate::synth::dataset(&Merger::new(3, 4_000));
    let family = &dataset.families[0];
    let energy = family.attribute("internal-energy").unwrap().values.clone();
    // Where particles lie close to each other the sum is more than any of them.
    let most = 2.0 * f64::from(energy.iter().copied().fold(0.0, f32::max));
    let axis = ValueAxis::new(Scale::Linear, [0.0, most]);
    let (positions, h) = (family.positions.clone(), family.smoothing_length.clone());
    let gas = Gas::new(positions, h, family.mass.clone(), family.density.clone(), energy);
    let options = VolumeOptions {
        smallest: 0.0,
        near: Some(20.0),
        far: Some(220.0),
        memory: 1 << 30,
        ..VolumeOptions::default()
    };
    for view in [
        perspective(DVec3::new(60.0, 40.0, 90.0), 96, 64),
        look(DVec3::new(60.0, 40.0, 90.0), Projection::Orthographic { height: 60.0 }, 80, 60),
    ] {
        let wanted = [Column::Field(0), Column::Field(1)];
        let columns = Columns::prepare(&view, &[gas.batch()], &wanted, &options).unwrap();
        assert_eq!(columns.filling, 1.0, "densities have the unit of the masses");
        let (grid, brick_grid) = (columns.prepared[0].grid, columns.prepared[0].brick_grid());
        let [k, l, m] = grid.size.map(|size| size as usize);
        for volume in [Reading::Sum(axis), Reading::Mean(axis)] {
            let shown = Shown { volume, surface: Some(Reading::Density), opacity: None, has_hue: false };
            let (layers, _) = columns.fields(&shown).fill(0..brick_grid.bricks[2], &[]);
            let slab = Slab { first: 0, layers };
            let (mut squares, mut norms, mut samples) = ([0.0; 2], [0.0; 2], 0);
            for index in (0..k * l * m).step_by(197) {
                let cell = [index % k, index / k % l, index / k / l];
                let [x, y, z] = [cell[0] + BORDER, cell[1] + BORDER, cell[2]];
                let Some(brick) = slab.brick(x / BRICK, y / BRICK, z / BRICK, brick_grid) else { continue };
                let within = (z % BRICK * BRICK + y % BRICK) * BRICK + x % BRICK;
                let center = grid.center(cell.map(|c| c as u32));
                let at = view.eye + center.x * view.right + center.y * view.up + center.z * view.forward;
                let [share, sum, density] = gas.sums(at);
                let expected = if matches!(volume, Reading::Sum(_)) { sum } else { sum / share };
                // At the edge of what is known rounding decides.
                if share < 2.0 * f64::from(LEAST_FILLED) {
                    continue;
                }
                samples += 1;
                let found = [axis.value(brick.density[within]), f64::from(brick.surface[within])];
                for (k, (found, expected)) in found.into_iter().zip([expected, density]).enumerate() {
                    squares[k] += (found - expected).powi(2);
                    norms[k] += expected.powi(2);
                }
            }
            let errors = [0, 1].map(|k| f64::sqrt(squares[k] / norms[k]));
            println!("{volume:?}: {errors:?} in {samples} cells");
            assert!(samples > 300 && errors[0] < 1e-3 && errors[1] < 1e-4, "{volume:?}: {errors:?} {samples}");
        }
    }
}

impl Group for Gas {
    fn batch(&self) -> Splats<'_> {
        self.batch()
    }
}

/// Groups of very different sizes, here and there; densities in a unit of their own. A few particles have no value.
fn random_groups(seed: u64, count: usize, unit: f64, (together, slab_bytes): (usize, u64)) -> Groups {
    let mut random = Random::new(seed, 8);
    let group = |_: usize| -> Box<dyn Group> {
        let middle = DVec3::from_array([0; 3].map(|_| 2.0 * random.signed()));
        let width = 0.05 + 1.5 * random.uniform().powi(3);
        let (mut positions, mut columns) = (Vec::new(), [(); 4].map(|()| Vec::new()));
        for _ in 0..200 {
            let place = middle + width * DVec3::from_array([0; 3].map(|_| random.signed()));
            let h = width * (0.02 + 1.5 * random.uniform().powi(10));
            let value = if random.uniform() < 0.05 { f64::NAN } else { random.signed() };
            let density = unit * (0.1 + random.uniform());
            positions.push(place.to_array());
            let own = [h, 0.1 * h.powi(3) * density / unit, density, value];
            columns.iter_mut().zip(own).for_each(|(column, value)| column.push(value as f32));
        }
        let [h, mass, density, value] = columns;
        Box::new(Gas::new(positions, h, mass, density, value))
    };
    Groups::of((0..count).map(group).collect(), together, slab_bytes)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]

    /// Volumes and surfaces of several columns at once, with slabs of a layer, some layers and all of them.
    #[test]
    fn columns_that_come_some_at_a_time_have_the_same_bits(
        (seed, count, together) in (any::<u64>(), 1_usize..16, 1_usize..6),
        (memory, occlusion, variant) in (0_usize..3, any::<bool>(), 0_usize..3),
        (unit, distance) in (prop::sample::select(vec![1.0, 1e9]), 0.5_f64..8.0),
    ) {
        let memory = [0, 300 << 10, 1 << 30][memory];
        let mut groups = random_groups(seed, count, unit, (together, SLAB_SHARE * memory));
        let view = perspective(distance * DVec3::new(0.3, 0.2, 0.93), 66, 50);
        let axis = ValueAxis::new(Scale::Linear, [-1.2, 1.2]);
        let opacity = Some(ByDensity { range: [1e-3 * unit, unit] });
        let (value, density) = ((Column::Field(0), false), (Column::Field(1), true));
        let (volume, surface, opacity, columns) = match variant {
            0 => (Reading::Mean(axis), None, opacity, [value, density]),
            1 => (Reading::Sum(axis), Some(Reading::Density), opacity, [value, density]),
            _ => (Reading::Density, Some(Reading::Mean(axis)), None, [density, value]),
        };
        let shown = Shown { volume, surface, opacity, has_hue: true };
        let columns = columns.into_iter().chain([(Column::Attribute, false)]);
        let (wanted, densities): (Vec<Column>, Vec<bool>) = columns.unzip();
        let surface = Surface { value: 1.5, color: None, opacity: 0.9 };
        let scenery = scenery(RAMP, [1e-3, 2.0], 0.3, vec![surface]);
        let options = VolumeOptions { memory: SLAB_SHARE * memory, occlusion, ..VolumeOptions::default() };
        let whole = Columns::prepare(&view, &groups.batches(), &wanted, &options);
        let supplied = Columns::prepare_supplied(&view, &mut groups, &wanted, &densities, &options);
        let (whole, (columns, histograms)) = match (whole, supplied) {
            (Ok(whole), Ok(supplied)) => (whole, supplied),
            (whole, supplied) => {
                prop_assert_eq!(whole.err(), supplied.err());
                return Ok(());
            }
        };
        prop_assert_eq!(whole.filling, columns.filling);
        for (index, (histogram, is_density)) in histograms.iter().zip(densities).enumerate() {
            prop_assert!(histogram.0 == whole.histogram(index, is_density).0, "column {}", index);
        }
        let (expected, all) = whole.draw(&view, &shown, &scenery, &options, None);
        let unlimited = VolumeOptions { memory: 1 << 40, ..options };
        let (colors, report) = columns.draw_supplied(&view, &mut groups, &shown, &scenery, &unlimited);
        prop_assert!(expected == colors, "{:?} {:?}", all, report);
        let counts = |report: &VolumeReport| {
            let VolumeReport { grid, slabs, pairs, bricks, samples, hidden, .. } = *report;
            (grid, slabs, pairs, bricks, samples, hidden)
        };
        prop_assert_eq!(counts(&all), counts(&report));
        prop_assert!(all.opaque == report.opaque && report.particles <= all.particles);
        prop_assert!(memory > 0 || report.slabs > 1 || report.grid[2] < 64, "{:?}", report);
    }
}

/// Surfaces of the first column alone, seen as said.
fn surface_scenery(value: f32, axis: ValueAxis, light: Light) -> Scenery {
    let levels = VolumeLevels { density: axis.range, attribute: [0.0, 1.0], unit_length: 1.0 };
    Scenery {
        classifier: Classifier::of_values(&TransferFunction::of_values(false), levels, false, &axis),
        volume: false,
        surfaces: vec![Surface { value, color: Some([1.0, 0.0, 0.0]), opacity: 1.0 }],
        light: Some(light),
        volume_light: None,
        termination: 0.999,
    }
}

#[test]
fn a_surface_of_a_linear_attribute_is_a_plane_that_ends_with_the_gas() {
    let gas = Gas::lattice();
    let view = look(DVec3::new(3.0, 0.6, 0.5), Projection::Orthographic { height: 3.0 }, 60, 60);
    let options = VolumeOptions::default();
    let columns = Columns::prepare(&view, &[gas.batch()], &[Column::Field(0)], &options).unwrap();
    let axis = ValueAxis::new(Scale::Linear, [-1.2, 1.2]);
    let shown = Shown { volume: Reading::Mean(axis), surface: None, opacity: None, has_hue: false };
    let light = Light { ambient: 0.0, specular: 0.0, shininess: 1.0 };
    let scenery = surface_scenery(axis.place(0.2), axis, light);
    let (grid, brick_grid) = (&columns.prepared[0].grid, columns.prepared[0].brick_grid());
    let report = &mut VolumeReport::default();
    let parts = cast_in_parts(&view, (grid, brick_grid), &mut columns.fields(&shown), &scenery, &options, report);
    let (mut met, mut missed) = (0, 0);
    for (x, y) in (0..60).flat_map(|y| (0..60).map(move |x| (x, y))) {
        let [across, up] = [x as f64 + 0.5 - 30.0, 30.0 - (y as f64 + 0.5)].map(|pixels| pixels * 3.0 / 60.0);
        let origin = view.eye + across * view.right + up * view.up;
        let depth = (0.2 - origin.x) / view.forward.x;
        let hit = origin + depth * view.forward;
        let edge = hit.y.abs().max(hit.z.abs());
        match parts.of(x, y) {
            [part] if edge < 0.8 => {
                assert!((f64::from(part.depth) - depth).abs() < 0.03, "{} {depth} at {hit}", part.depth);
                // It faces along the axis, where the gas ends as well.
                let cosine = view.forward.x.abs();
                assert!((f64::from(part.color[0]) - cosine).abs() < 0.03, "{:?} {cosine} at {hit}", part.color);
                met += 1;
            }
            parts if edge < 0.8 => panic!("{} surfaces at {hit}", parts.len()),
            parts if edge > 1.2 => {
                assert!(parts.is_empty(), "the gas has ended at {hit}");
                missed += 1;
            }
            _ => {}
        }
    }
    assert!(met > 700 && missed > 300, "{met} {missed}");
}

#[test]
fn a_surface_of_density_in_another_volume_is_that_of_density_alone() {
    let gas = Gas::lattice();
    let view = perspective(DVec3::new(2.0, 1.5, 3.0), 64, 48);
    let options = VolumeOptions::default();
    let axis = ValueAxis::new(Scale::Linear, [-1.2, 1.2]);
    let scenery = surface_scenery(0.5, axis, Light { ambient: 0.2, specular: 0.3, shininess: 20.0 });
    let wanted = [Column::Field(0), Column::Field(1), Column::Attribute];
    let columns = Columns::prepare(&view, &[gas.batch()], &wanted, &options).unwrap();
    let shown = Shown { volume: Reading::Mean(axis), surface: Some(Reading::Density), opacity: None, has_hue: true };
    let (apart, _) = columns.draw(&view, &shown, &scenery, &options, None);
    // Of density 1 volumes are masses.
    let (alone, _) = draw(&view, &[gas.batch()], &scenery, &options).unwrap();
    let seen = alone.rgba.iter().filter(|pixel| pixel[3] > 0.5).count();
    assert!(seen > 200, "{seen}");
    for (a, b) in apart.rgba.iter().zip(&alone.rgba) {
        assert!((0..4).all(|k| (a[k] - b[k]).abs() < 1e-4), "{a:?} {b:?}");
    }
}

#[test]
fn opacity_goes_by_density_where_that_is_asked_for() {
    let mut gas = Gas::lattice();
    let view = look(DVec3::new(0.0, 0.0, 5.0), Projection::Orthographic { height: 3.0 }, 60, 60);
    let options = VolumeOptions::default();
    let axis = ValueAxis::new(Scale::Linear, [-1.2, 1.2]);
    let levels = VolumeLevels { density: axis.range, attribute: [0.0, 1.0], unit_length: 1.0 };
    let even = TransferFunction { opacity: Some(Curve::constant(0.3)), ..TransferFunction::of_values(false) };
    let scenery = Scenery {
        classifier: Classifier::of_values(&even, levels, false, &axis),
        volume: true,
        surfaces: Vec::new(),
        light: None,
        volume_light: None,
        termination: 0.999,
    };
    let picture = |gas: &Gas, opacity: Option<ByDensity>| {
        let wanted = [Column::Field(0), Column::Field(1)];
        let columns = Columns::prepare(&view, &[gas.batch()], &wanted, &options).unwrap();
        let shown = Shown { volume: Reading::Mean(axis), surface: None, opacity, has_hue: false };
        columns.draw(&view, &shown, &scenery, &options, None).0.rgba
    };
    let bits = |rgba: &[[f32; 4]]| rgba.as_flattened().iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    let by_values = picture(&gas, None);
    // Where all of the gas is as dense as it gets, it is as opaque as by its values.
    let dense = Some(ByDensity { range: [1e-31, 1e-30] });
    assert_eq!(bits(&picture(&gas, dense)), bits(&by_values));
    // One half is a thousandth as dense, with the same values.
    for (density, position) in gas.fields[1].iter_mut().zip(&gas.positions) {
        *density = if position[0] < 0.0 { 1e-3 } else { 1.0 };
    }
    assert_eq!(bits(&picture(&gas, None)), bits(&by_values), "values alone know nothing of densities");
    let by_density = picture(&gas, Some(ByDensity { range: [1e-3, 5e-3] }));
    for y in 22..38 {
        for x in 14..22 {
            let [thin, dense] = [60 * y + x, 60 * y + 59 - x];
            assert!(by_values[thin][3] > 0.3 && by_density[thin][3] < 0.02 * by_values[thin][3], "{x} {y}");
            assert_eq!(bits(&by_density[dense..=dense]), bits(&by_values[dense..=dense]), "{x} {y}");
        }
    }
}

#[test]
fn particles_without_a_value_are_not_there() {
    let mut gas = Gas::lattice();
    // Half of the lattice has none.
    for (value, position) in gas.fields[0].iter_mut().zip(&gas.positions) {
        if position[1] > 0.0 {
            *value = f32::NAN;
        }
    }
    let view = perspective(DVec3::new(3.0, 2.5, 5.5), 64, 48);
    let prepare = |column: usize| {
        Columns::prepare(&view, &[gas.batch()], &[Column::Field(column)], &VolumeOptions::default()).unwrap()
    };
    let [half, whole] = [0, 1].map(|column| prepare(column).prepared[0].particles.len());
    assert_eq!(2 * half, whole);
    let [low, high] = Columns::range(&prepare(0).histogram(0, false), false).unwrap();
    assert!((low + 0.94).abs() < 0.06 && (high - 0.94).abs() < 0.06, "{low} {high}");
    gas.fields[0].fill(f32::NAN);
    let nothing = Columns::prepare(&view, &[gas.batch()], &[Column::Field(0)], &VolumeOptions::default());
    assert!(nothing.is_err());
}

#[test]
fn volumes_are_lit_where_that_is_asked_for_and_nowhere_else() {
    let cloud = Cloud::lattice(16, 2.0);
    let view = perspective(DVec3::new(1.0, 0.7, 4.0), 64, 48);
    let options = VolumeOptions::default();
    let picture = |volume_light: Option<Light>| {
        let scenery = Scenery { volume_light, ..scenery(RAMP, [0.01, 2.0], 0.3, Vec::new()) };
        draw(&view, &[cloud.batch()], &scenery, &options).unwrap().0.rgba
    };
    let bits = |rgba: &[[f32; 4]]| rgba.as_flattened().iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    let plain = picture(None);
    // Light from everywhere lights nothing more than what is there without.
    let everywhere = picture(Some(Light { ambient: 1.0, specular: 0.0, shininess: 1.0 }));
    assert_eq!(bits(&plain), bits(&everywhere));
    let lit = picture(Some(Light { ambient: 0.2, specular: 0.0, shininess: 1.0 }));
    let mut darker = 0;
    for (plain, lit) in plain.iter().zip(&lit) {
        assert_eq!(plain[3].to_bits(), lit[3].to_bits(), "light takes no opacity away");
        assert!((0..3).all(|k| lit[k] <= plain[k] && lit[k] >= 0.19 * plain[k]), "{plain:?} {lit:?}");
        darker += u32::from(lit[1] < 0.97 * plain[1]);
    }
    assert!(darker > 300, "{darker}");
}
