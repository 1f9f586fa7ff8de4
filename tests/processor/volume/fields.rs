//! Isosurfaces of an attribute, as a mode draws them, against sums over all particles.

use crate::support::draw_nodes;
use deepfield::cpu::Method;
use deepfield::mode::{Depiction, Plan, SettingValue, Settings};
use deepfield::model::{Dataset, Kernel};
use deepfield::modes;
use deepfield::store::{InMemory, Tree};
use deepfield::stream::first_nodes;
use deepfield::synth::{dataset, merger::Merger};
use deepfield::view::{Projection, View};
use glam::DVec3;

const ISOVALUE: f64 = 4e5;

/// The pixels that a surface of the internal energy covers, row by row.
fn covered(data: &Dataset, view: &View, sum: &str) -> Vec<bool> {
    let tree = InMemory::new(data.clone());
    let settings = Settings(
        [
            ("surface-field".to_owned(), SettingValue::Name("internal-energy".into())),
            ("field-sum".to_owned(), SettingValue::Name(sum.into())),
            ("isovalues".to_owned(), SettingValue::Numbers(vec![ISOVALUE])),
        ]
        .into(),
    );
    let depiction = Depiction::new(modes::find("isosurface").unwrap(), settings, None, tree.metadata()).unwrap();
    let nodes = first_nodes(&tree, view).unwrap();
    let drawn = draw_nodes(view, &depiction, tree.metadata(), &nodes, Method::Pyramid, &Plan::default());
    drawn.light(depiction.mode).unwrap().colors.rgba.iter().map(|pixel| pixel[3] > 0.2).collect()
}

#[test]
fn a_surface_of_the_plain_sum_is_where_the_sum_over_all_particles_has_its_value() {
    let data = dataset(&Merger::new(1, 4_000));
    let projection = Projection::Orthographic { height: 80.0 };
    let view = View::look_at(250.0 * DVec3::Z, DVec3::ZERO, DVec3::Y, projection, 120, 80).unwrap();
    let [plain, mean] = ["plain", "normalised"].map(|sum| covered(&data, &view, sum));
    let family = &data.families[0];
    let energy = &family.attribute("internal-energy").unwrap().values;
    // Places, smoothing lengths and m A / (rho h^3).
    let particles: Vec<(DVec3, f64, f64)> = (0..family.len())
        .map(|i| {
            let [h, mass, density, energy] =
                [family.smoothing_length[i], family.mass[i], family.density[i], energy[i]].map(f64::from);
            (DVec3::from_array(family.positions[i]), h, mass * energy / (density * h.powi(3)))
        })
        .collect();
    let (mut inside, mut outside) = (0, 0);
    for (x, y) in (0..80_usize).step_by(2).flat_map(|y| (0..120_usize).step_by(2).map(move |x| (x, y))) {
        let ray = view.at_depth([x, y].map(|at| at as f64 + 0.5), 0.0);
        let near: Vec<_> =
            particles.iter().filter(|(at, h, _)| (at.truncate() - ray.truncate()).length() < *h).collect();
        // The dense gas is around the middle, and thin gas comes to less.
        let depths = (-40..=40).map(|k| DVec3::new(ray.x, ray.y, 0.5 * f64::from(k)));
        let sum = |place: DVec3| -> f64 {
            near.iter().map(|(at, h, weight)| weight * Kernel::CubicSpline.value(at.distance(place) / h)).sum()
        };
        let most = depths.map(sum).fold(0.0, f64::max);
        let is_covered = plain[y * 120 + x];
        // The grid is as fine as the picture: at the very edge a cell decides.
        match most / ISOVALUE {
            share if share > 1.05 => {
                inside += 1;
                assert!(is_covered, "({x}, {y}): no surface where the sum comes to {most}");
            }
            share if share < 0.95 => {
                outside += 1;
                assert!(!is_covered, "({x}, {y}): a surface where the sum comes to {most}");
            }
            _ => {}
        }
    }
    assert!(inside > 800 && outside > 800, "{inside} pixels inside, {outside} outside");
    // Where particles are close the sum is more than their mean, whose surface is smaller.
    let [of_sum, of_mean] = [plain, mean].map(|covered| covered.into_iter().filter(|is_covered| *is_covered).count());
    assert!(of_mean > 100 && 2 * of_mean < of_sum, "{of_sum} pixels by the sum, {of_mean} by the mean");
}
