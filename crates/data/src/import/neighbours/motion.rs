//! How particles move among their neighbours: velocity dispersion, divergence and vorticity.
//!
//! Sums go over the neighbours within a particle's own smoothing length, with its kernel `W(r_ij, h_i)`. The gradient of the velocity is
//! the SPH estimate, corrected so that it is exact for any velocity that is linear in space, however particles lie:
//! `sum_j V_j (v_j - v_i) (x) grad W`, times the inverse of `sum_j V_j (x_j - x_i) (x) grad W`, with volumes `V_j = m_j / rho_j`
//! (Bonet and Lok 1999, Computer Methods in Applied Mechanics and Engineering 180, 97).

use super::tree::Near;
use super::{MOST_NEIGHBOURS, Neighbours};
use crate::model::covariance::principal_axes;
use crate::model::{Kernel, Progress};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::cmp::Ordering;

/// Share of the neighbours' spread that lies along a direction below which the velocity's change along it is not told from that along
/// others: a thickness of about a thousandth of the width.
const SEEN: f64 = 1e-6;

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
    /// length that reaches to the last of them. `wanted` as in [`Neighbours::estimate`]. The positions of `all` are those of the tree.
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
            let mut near = Vec::new();
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
                        _ => self.moments(kernel, &bodies, entry, f64::from(h), &mut near),
                    };
                    known = Some((h, moments));
                    out.push(moments.seen_from(DVec3::from_array(all.velocities[particle])));
                }
            }
        })
    }

    /// Sums over the neighbours of an entry within `support`; the same to the last bit whatever else is in the tree.
    fn moments(&self, kernel: Kernel, bodies: &[Body], entry: u32, support: f64, near: &mut Vec<Near>) -> Moments {
        let at = self.tree.at[entry as usize];
        let mut h = support / self.scale;
        self.tree.nearest(at, MOST_NEIGHBOURS, h * h, near);
        if near.len() == MOST_NEIGHBOURS {
            // The kernel vanishes where the last ones are, so that it does not matter which of several there are among them.
            h = near.iter().map(|near| near.squared).fold(0.0, f64::max).sqrt().min(h);
        }
        near.sort_unstable_by(|a, b| {
            let [place, others] = [a, b].map(|near| self.tree.at[near.entry as usize].to_array());
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
                let direction = (self.tree.at[other.entry as usize] - at) / r;
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
