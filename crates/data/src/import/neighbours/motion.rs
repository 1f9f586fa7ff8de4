//! How particles move among their neighbours: velocity dispersion, divergence and vorticity.
//!
//! Sums go over the neighbours within a particle's own smoothing length, with its kernel `W(r_ij, h_i)`. The gradient of the velocity is
//! the SPH estimate, corrected so that it is exact for any velocity that is linear in space, however particles lie:
//! `sum_j V_j (v_j - v_i) (x) grad W`, times the inverse of `sum_j V_j (x_j - x_i) (x) grad W`, with volumes `V_j = m_j / rho_j`
//! (Bonet and Lok 1999, Computer Methods in Applied Mechanics and Engineering 180, 97).
//!
//! No ball is larger than half a periodic box, so that nobody is found twice.

use super::tree::Near;
use super::{MOST_NEIGHBOURS, Neighbours};
use crate::model::covariance::principal_axes;
use crate::model::{Kernel, Progress};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::cmp::Ordering;

/// Share of the neighbours' spread that lies along a direction below which the velocity's change along it is not told from that along
/// others: a thickness of about a hundredth of the width. Rounding and noise would be all that is seen.
const SEEN: f64 = 1e-4;

/// Particles that move, one column each.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moving<'a> {
    /// Where they are.
    pub positions: &'a [[f64; 3]],
    /// Masses.
    pub mass: &'a [f32],
    /// Densities.
    pub density: &'a [f32],
    /// Smoothing lengths; only those of wanted particles count.
    pub smoothing_length: &'a [f32],
    /// Velocities. A particle without a finite one is no neighbour of others.
    pub velocities: &'a [[f64; 3]],
    /// Edge of the periodic box that positions lie in, or a little beside; `None` where there is none.
    pub edge: Option<f64>,
}

impl Moving<'_> {
    /// How far neighbours of a particle with this smoothing length are looked for: not beyond half of a periodic box.
    pub(crate) fn reach(smoothing_length: f32, edge: Option<f64>) -> f64 {
        f64::from(smoothing_length).min(edge.map_or(f64::INFINITY, |edge| 0.5 * edge))
    }
}

/// How the neighbours of a particle move. What cannot be known is NaN.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct LocalMotion {
    /// Root of the mean square distance, in three dimensions, from the mean velocity.
    pub dispersion: f64,
    /// Trace of the velocity's gradient, velocity by length.
    pub divergence: f64,
    /// Length of its curl, velocity by length.
    pub vorticity: f64,
}

impl LocalMotion {
    /// Of a particle of which nothing is known.
    pub(crate) const UNKNOWN: LocalMotion =
        LocalMotion { dispersion: f64::NAN, divergence: f64::NAN, vorticity: f64::NAN };
}

/// All particles of an entry of the tree; looked up in no order, so that its numbers are one record.
#[derive(Clone, Copy)]
struct Body {
    mass: f64,
    /// Sum of masses by densities.
    volume: f64,
    /// Mean velocity by mass.
    velocity: DVec3,
    /// Sum of masses times squared distances from it.
    spread: f64,
    /// Mean velocity by volume.
    flow: DVec3,
}

impl Body {
    const NOTHING: Body = Body { mass: 0.0, volume: 0.0, velocity: DVec3::ZERO, spread: 0.0, flow: DVec3::ZERO };

    fn single(particle: u32, all: &Moving) -> Body {
        let particle = particle as usize;
        let velocity = DVec3::from_array(all.velocities[particle]);
        if !velocity.is_finite() {
            return Body::NOTHING;
        }
        let mass = f64::from(all.mass[particle]);
        Body { mass, volume: mass / f64::from(all.density[particle]), velocity, spread: 0.0, flow: velocity }
    }

    /// The particles of one place, the same to the last bit in whatever order they come.
    fn of(particles: &[u32], all: &Moving) -> Body {
        if let [only] = particles {
            return Body::single(*only, all);
        }
        let mut bodies: Vec<Body> = particles.iter().map(|&particle| Body::single(particle, all)).collect();
        bodies.sort_unstable_by(Body::compare);
        let (mut sum, mut velocity, mut flow) = (Body::NOTHING, DVec3::ZERO, DVec3::ZERO);
        for body in &bodies {
            sum.mass += body.mass;
            sum.volume += body.volume;
            velocity += body.mass * body.velocity;
            flow += body.volume * body.velocity;
        }
        if sum.mass > 0.0 {
            (sum.velocity, sum.flow) = (velocity / sum.mass, flow / sum.volume);
        }
        sum.spread = bodies.iter().map(|body| body.mass * body.velocity.distance_squared(sum.velocity)).sum();
        sum
    }

    /// An order of bodies that differ in anything.
    fn compare(&self, other: &Body) -> Ordering {
        let (own, others) = (self.velocity.to_array(), other.velocity.to_array());
        let velocity = || own.iter().zip(&others).map(|(a, b)| a.total_cmp(b)).find(|order| order.is_ne());
        let mass = self.mass.total_cmp(&other.mass).then_with(|| self.volume.total_cmp(&other.volume));
        mass.then_with(|| velocity().unwrap_or(Ordering::Equal))
    }
}

/// An entry of the tree, or an image of it, near a place.
#[derive(Clone, Copy)]
struct Neighbour {
    /// Squared distance.
    squared: f64,
    /// From the place to it.
    away: DVec3,
    entry: u32,
}

/// Memory for the neighbours of a place.
#[derive(Default)]
struct Scratch {
    /// Those of one image of it.
    near: Vec<Near>,
    all: Vec<Neighbour>,
}

/// What the neighbours of a place tell, whatever moves there.
#[derive(Clone, Copy)]
struct Moments {
    /// Mean velocity by mass and kernel.
    mean: DVec3,
    dispersion: f64,
    /// Sum of the kernel's slopes along each direction.
    directions: DVec3,
    /// The same times the components of velocities, from the mean.
    changes: [DVec3; 3],
    /// Inverse of the sum of positions times slopes, 0 along directions that no neighbour is in; `None` where there is no neighbour.
    inverse: Option<DMat3>,
}

impl Moments {
    /// What it is for a particle with this velocity.
    fn seen_from(&self, velocity: DVec3) -> LocalMotion {
        if !velocity.is_finite() {
            return LocalMotion::UNKNOWN;
        }
        let dispersion = self.dispersion;
        let Some(inverse) = self.inverse else {
            return LocalMotion { dispersion, ..LocalMotion::UNKNOWN };
        };
        let own = (velocity - self.mean).to_array();
        // The gradient of each component.
        let [x, y, z]: [DVec3; 3] =
            std::array::from_fn(|axis| inverse * (self.changes[axis] - own[axis] * self.directions));
        let curl = DVec3::new(z.y - y.z, x.z - z.x, y.x - x.y);
        LocalMotion { dispersion, divergence: x.x + y.y + z.z, vorticity: curl.length() }
    }
}

impl Neighbours {
    /// For every particle how those within its smoothing length move; of more than 512 places the nearest so many, within a smoothing
    /// length that reaches to the last of them. `wanted` as in [`Neighbours::estimate`]. The positions of `all` and its periodic box
    /// are those of the tree.
    /// Smoothing lengths of more than half a periodic box are taken as that.
    pub(crate) fn local_motion(
        &self,
        kernel: Kernel,
        all: &Moving,
        wanted: Option<&[bool]>,
        progress: &dyn Progress,
    ) -> Vec<LocalMotion> {
        let entries = (0..self.tree.at.len() as u32).into_par_iter();
        let bodies: Vec<Body> = entries.map(|entry| Body::of(self.tree.particles_of(entry), all)).collect();
        self.for_each_leaf(wanted, progress, |_, leaf, out: &mut Vec<LocalMotion>| {
            let mut scratch = Scratch::default();
            let node = self.tree.nodes[self.tree.leaves[leaf as usize] as usize];
            for entry in node.start..node.end {
                let mut known: Option<(f32, Moments)> = None;
                for &particle in self.tree.particles_of(entry) {
                    let particle = particle as usize;
                    let h = all.smoothing_length[particle];
                    if wanted.is_some_and(|wanted| !wanted[particle]) {
                        out.push(LocalMotion::default());
                        continue;
                    }
                    let moments = match known {
                        Some((of, moments)) if of == h => moments,
                        _ => {
                            let reach = Moving::reach(h, all.edge);
                            self.moments(kernel, &bodies, entry, reach, &mut scratch)
                        }
                    };
                    known = Some((h, moments));
                    out.push(moments.seen_from(DVec3::from_array(all.velocities[particle])));
                }
            }
        })
    }

    /// Sums over the neighbours of an entry and its images within `support`; the same to the last bit whatever else is in the tree.
    fn moments(&self, kernel: Kernel, bodies: &[Body], entry: u32, support: f64, scratch: &mut Scratch) -> Moments {
        let at = self.tree.at[entry as usize];
        let mut h = support / self.scale;
        let Scratch { near: of_image, all: near } = scratch;
        near.clear();
        self.around_images(at, MOST_NEIGHBOURS, h * h, of_image, |place, found| {
            near.extend(found.iter().map(|&Near { squared, entry }| {
                let away = self.tree.at[entry as usize] - place;
                Neighbour { squared, away, entry }
            }));
        });
        if near.len() > MOST_NEIGHBOURS {
            near.select_nth_unstable_by(MOST_NEIGHBOURS - 1, |a, b| a.squared.total_cmp(&b.squared));
            near.truncate(MOST_NEIGHBOURS);
        }
        if near.len() == MOST_NEIGHBOURS {
            // The kernel vanishes where the last ones are, so that it does not matter which of several there are among them.
            h = near.iter().map(|near| near.squared).fold(0.0, f64::max).sqrt().min(h);
        }
        near.sort_unstable_by(|a, b| {
            let [place, others] = [a, b].map(|near| near.away.to_array());
            let places = || place.iter().zip(&others).map(|(a, b)| a.total_cmp(b)).find(|order| order.is_ne());
            let body = || bodies[a.entry as usize].compare(&bodies[b.entry as usize]);
            a.squared.total_cmp(&b.squared).then_with(|| places().unwrap_or_else(body))
        });
        let (mut weights, mut mean) = (0.0, DVec3::ZERO);
        for other in near.iter() {
            let body = &bodies[other.entry as usize];
            let weight = body.mass * kernel.value(other.squared.sqrt() / h);
            weights += weight;
            mean += weight * body.velocity;
        }
        mean /= weights;
        let (mut spread, mut directions, mut changes) = (0.0, DVec3::ZERO, [DVec3::ZERO; 3]);
        let mut positions = DMat3::ZERO;
        for other in near.iter() {
            let body = &bodies[other.entry as usize];
            let r = other.squared.sqrt();
            let q = r / h;
            spread += kernel.value(q) * (body.spread + body.mass * body.velocity.distance_squared(mean));
            if r > 0.0 {
                let direction = other.away / r;
                let slope = -kernel.slope(q) * body.volume * direction;
                let flow = body.flow - mean;
                directions += slope;
                changes[0] += flow.x * slope;
                changes[1] += flow.y * slope;
                changes[2] += flow.z * slope;
                positions += outer(q * direction, slope);
            }
        }
        let inverse = inverse(positions).map(|inverse| inverse * (h * self.scale).recip());
        Moments { mean, dispersion: (spread / weights).sqrt(), directions, changes, inverse }
    }
}

/// The matrix `a (x) b`.
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// The inverse of a symmetric matrix without negative eigenvalues, 0 along those axes along which it is 0 beside its trace; `None` for
/// nothing.
fn inverse(matrix: DMat3) -> Option<DMat3> {
    let trace = matrix.x_axis.x + matrix.y_axis.y + matrix.z_axis.z;
    if !(trace > 0.0 && trace.is_finite()) {
        return None;
    }
    let matrix = matrix * trace.recip();
    let (values, axes) = principal_axes(matrix);
    let mut sum = DMat3::ZERO;
    for (axis, value) in [axes.x_axis, axes.y_axis, axes.z_axis].into_iter().zip(values.to_array()) {
        if value > SEEN {
            sum += outer(axis, axis) * value.recip();
        }
    }
    Some(sum * trace.recip())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Particles as columns, in a periodic box or none.
    #[derive(Clone, Default)]
    struct Cloud {
        positions: Vec<[f64; 3]>,
        mass: Vec<f32>,
        density: Vec<f32>,
        smoothing_length: Vec<f32>,
        velocities: Vec<[f64; 3]>,
        edge: Option<f64>,
    }

    impl Cloud {
        /// Particles at these places, of different masses and densities, whose velocities depend on their place and number.
        fn new(positions: Vec<[f64; 3]>, h: f32, velocity: impl Fn([f64; 3], usize) -> [f64; 3]) -> Cloud {
            let numbers = 0..positions.len();
            let several = |base: f32, step: f32, period: usize| -> Vec<f32> {
                numbers.clone().map(|i| base + step * (i % period) as f32).collect()
            };
            Cloud {
                mass: several(1.0, 0.5, 3),
                density: several(0.5, 0.3, 5),
                smoothing_length: several(h, 0.05 * h, 4),
                velocities: positions.iter().enumerate().map(|(i, at)| velocity(*at, i)).collect(),
                positions,
                edge: None,
            }
        }

        fn motions(&self, kernel: Kernel) -> Vec<LocalMotion> {
            let all = Moving {
                positions: &self.positions,
                mass: &self.mass,
                density: &self.density,
                smoothing_length: &self.smoothing_length,
                velocities: &self.velocities,
                edge: self.edge,
            };
            Neighbours::of(&self.positions, self.edge, &()).unwrap().local_motion(kernel, &all, None, &())
        }

        fn push(&mut self, other: &Cloud, i: usize) {
            self.positions.push(other.positions[i]);
            self.mass.push(other.mass[i]);
            self.density.push(other.density[i]);
            self.smoothing_length.push(other.smoothing_length[i]);
            self.velocities.push(other.velocities[i]);
        }
    }

    /// Whether two are the same to the last bit; a NaN has many.
    fn are_same(one: &LocalMotion, other: &LocalMotion) -> bool {
        let values = |motion: &LocalMotion| [motion.dispersion, motion.divergence, motion.vorticity];
        values(one).into_iter().zip(values(other)).all(|(a, b)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan())
    }

    fn times(gradient: &[f64; 9], [x, y, z]: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| gradient[3 * a] * x + gradient[3 * a + 1] * y + gradient[3 * a + 2] * z)
    }

    proptest! {
        #![proptest_config(crate::cases::cases(32))]

        /// Whatever the places, masses, densities and smoothing lengths: a rigid rotation, an expansion, a shear and any sum of them.
        #[test]
        fn velocities_that_are_linear_in_space_have_their_gradient(
            positions in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 100..300),
            gradient in prop::array::uniform9(-3.0..3.0f64), drift in prop::array::uniform3(-5.0..5.0f64),
            kernel in 0..Kernel::ALL.len(),
        ) {
            let velocity = |at: [f64; 3], _| {
                let linear = times(&gradient, at);
                std::array::from_fn(|axis| drift[axis] + linear[axis])
            };
            let cloud = Cloud::new(positions, 1.2, velocity);
            let [_, xy, xz, yx, _, yz, zx, zy, _] = gradient;
            let divergence = gradient[0] + gradient[4] + gradient[8];
            let vorticity = DVec3::new(zy - yz, xz - zx, yx - xy).length();
            for found in cloud.motions(Kernel::ALL[kernel]) {
                prop_assert!((found.divergence - divergence).abs() < 1e-9, "{found:?}, divergence {divergence}");
                prop_assert!((found.vorticity - vorticity).abs() < 1e-9, "{found:?}, vorticity {vorticity}");
                prop_assert!(found.dispersion > 0.0);
            }
        }

        /// Neither the order of particles nor others far away change a bit, whichever share a place or a distance: a build looks at
        /// some buckets at a time.
        #[test]
        fn others_and_their_order_change_nothing(
            grid in prop::collection::vec(prop::array::uniform3(0..5i32), 2..150), shared in 0..40usize,
            turn in 1..1000usize, far in 1.0..1e5f64,
        ) {
            let mut positions: Vec<[f64; 3]> = grid.iter().map(|at| at.map(f64::from)).collect();
            positions.extend(vec![positions[0]; shared]);
            let velocity = |at: [f64; 3], i: usize| [at[1] * at[2], (i % 7) as f64, 0.1 * i as f64];
            let cloud = Cloud::new(positions, 1.9, velocity);
            let count = cloud.positions.len();
            let mut other = Cloud::default();
            let order: Vec<usize> = (0..count).rev().map(|i| (i + turn) % count).collect();
            order.iter().for_each(|&i| other.push(&cloud, i));
            let away = Cloud::new(vec![[-4.0 * far - 10.0, 20.0, far + 30.0]; 3], 0.5, |_, _| [1e3; 3]);
            (0..3).for_each(|i| other.push(&away, i));
            let (own, others) = (cloud.motions(Kernel::CubicSpline), other.motions(Kernel::CubicSpline));
            for (at, &i) in order.iter().enumerate() {
                prop_assert!(are_same(&own[i], &others[at]), "{:?} {:?}", own[i], others[at]);
            }
        }

        /// It does not matter where the faces of a periodic box are, to the last bit: places are whole 1024ths of its edge. Smoothing
        /// lengths of more than half of it are among them.
        #[test]
        fn the_faces_of_a_periodic_box_may_be_anywhere(
            grid in prop::collection::vec(prop::array::uniform3(0..1024u32), 2..150),
            shift in prop::array::uniform3(0..1024u32), h in 0.05..0.9f32,
        ) {
            let at = |shift: [u32; 3]| -> Vec<[f64; 3]> {
                let place = |at: &[u32; 3]| [0, 1, 2].map(|axis| f64::from((at[axis] + shift[axis]) % 1024) / 1024.0);
                grid.iter().map(place).collect()
            };
            let mut cloud = Cloud::new(at([0; 3]), h, |_, i| [(i % 7) as f64, 0.3 * i as f64, (i * i % 11) as f64]);
            cloud.edge = Some(1.0);
            let moved = Cloud { positions: at(shift), ..cloud.clone() };
            let (own, others) = (cloud.motions(Kernel::CubicSpline), moved.motions(Kernel::CubicSpline));
            for (own, other) in own.iter().zip(&others) {
                prop_assert!(are_same(own, other), "{own:?} {other:?}");
            }
        }
    }

    /// Waves as long as a periodic box that a lattice fills: at its faces as within, gradients are the true ones times one factor, that of
    /// a wave's differences over the kernel, which is below 1 and above `1 - (k h)^2 / 6`.
    #[test]
    fn waves_in_a_periodic_box_have_their_gradient_at_its_faces_too() {
        let (cells, spacing, h) = (12_u32, 0.5, 1.1_f32);
        let edge = f64::from(cells) * spacing;
        let k = std::f64::consts::TAU / edge;
        let place = |i: u32| [i % cells, i / cells % cells, i / cells / cells].map(|x| spacing * f64::from(x));
        let velocity = |[x, y, z]: [f64; 3], _: usize| [(k * x).sin() + (k * y).sin(), (k * y).sin(), (k * z).cos()];
        let mut cloud = Cloud::new((0..cells.pow(3)).map(place).collect(), h, velocity);
        let even = |value: f32| vec![value; cloud.positions.len()];
        (cloud.mass, cloud.density, cloud.smoothing_length) = (even(1.0), even(8.0), even(h));
        cloud.edge = Some(edge);
        let found = cloud.motions(Kernel::CubicSpline);
        // The first one is in a corner, where the curl is the wave number.
        let factor = found[0].vorticity / k;
        assert!(factor < 1.0 && factor > 1.0 - (k * f64::from(h)).powi(2) / 6.0, "{factor}");
        for (&[x, y, z], found) in cloud.positions.iter().zip(&found) {
            let divergence = factor * k * ((k * x).cos() + (k * y).cos() - (k * z).sin());
            let vorticity = factor * k * (k * y).cos().abs();
            assert!((found.divergence - divergence).abs() < 1e-9, "{x} {y} {z}: {found:?}, divergence {divergence}");
            assert!((found.vorticity - vorticity).abs() < 1e-9, "{x} {y} {z}: {found:?}, vorticity {vorticity}");
        }
    }

    #[test]
    fn a_sheet_has_the_gradient_within_it_and_a_lone_particle_none() {
        let positions: Vec<[f64; 3]> = (0..400).map(|i: u32| [f64::from(i % 20), f64::from(i / 20), 0.0]).collect();
        let turning = Cloud::new(positions.clone(), 2.5, |[x, y, _], _| [-2.0 * y, 2.0 * x, 7.0]);
        for found in turning.motions(Kernel::WendlandC2) {
            assert!((found.vorticity - 4.0).abs() < 1e-9 && found.divergence.abs() < 1e-9, "{found:?}");
        }
        let mut growing = Cloud::new(positions, 2.5, |[x, y, _], _| [3.0 * x, 3.0 * y, 0.0]);
        growing.push(&Cloud::new(vec![[90.0, 0.0, 0.0]], 1.0, |_, _| [1.0, 2.0, 3.0]), 0);
        let mut found = growing.motions(Kernel::CubicSpline);
        let lone = found.pop().unwrap();
        assert!(lone.dispersion == 0.0 && lone.divergence.is_nan() && lone.vorticity.is_nan(), "{lone:?}");
        for found in found {
            assert!((found.divergence - 6.0).abs() < 1e-9 && found.vorticity < 1e-9, "{found:?}");
        }
    }

    /// Who has no velocity is as good as not there.
    #[test]
    fn a_particle_without_a_velocity_is_no_neighbour() {
        let positions: Vec<[f64; 3]> = (0..343).map(|i: u32| [i % 7, i / 7 % 7, i / 49].map(f64::from)).collect();
        let cloud = Cloud::new(positions, 2.2, |[x, y, z], i| [x * y, z + (i % 5) as f64, y - x]);
        let mut without = Cloud::default();
        (0..343).filter(|i| *i != 171).for_each(|i| without.push(&cloud, i));
        let mut unknown = cloud.clone();
        unknown.velocities[171][1] = f64::NAN;
        let (mut found, expected) = (unknown.motions(Kernel::CubicSpline), without.motions(Kernel::CubicSpline));
        let own = found.remove(171);
        assert!(own.dispersion.is_nan() && own.divergence.is_nan());
        assert_eq!(found, expected);
    }

    /// Where too many places lie within a smoothing length, it is as if that were shorter.
    #[test]
    fn very_many_neighbours_are_those_within_a_shorter_smoothing_length() {
        let positions: Vec<[f64; 3]> = (0..4096).map(|i: u32| [i % 16, i / 16 % 16, i / 256].map(f64::from)).collect();
        let velocity = |[x, y, z]: [f64; 3], _: usize| [(x * y).sin(), (y + z).cos(), x * z];
        let mut cloud = Cloud::new(positions, 100.0, velocity);
        let far = cloud.motions(Kernel::CubicSpline);
        // The 512th place about one near the middle.
        let middle = 8 + 16 * 8 + 256 * 8;
        let at = DVec3::from_array(cloud.positions[middle]);
        let mut distances: Vec<f64> =
            cloud.positions.iter().map(|other| DVec3::from_array(*other).distance(at)).collect();
        distances.sort_by(f64::total_cmp);
        cloud.smoothing_length[middle] = distances[MOST_NEIGHBOURS - 1] as f32;
        let near = cloud.motions(Kernel::CubicSpline)[middle];
        assert!((far[middle].dispersion / near.dispersion - 1.0).abs() < 1e-6, "{:?} {near:?}", far[middle]);
        assert!((far[middle].vorticity / near.vorticity - 1.0).abs() < 1e-5, "{:?} {near:?}", far[middle]);
    }
}
