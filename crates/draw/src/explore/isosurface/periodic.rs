//! A periodic box that the density goes round: its lattice, on which opposite faces hold the same points, and the images
//! of particles.

use super::particles::{Leaf, Particle};
use crate::cpu::mesh::Lattice;
use crate::model::Bounds;
use glam::DVec3;

/// Numbers of cells that are tried before a power of two, which divides every edge without rounding.
const TRIES: u32 = 64;

/// A periodic box between the origin and its edge along each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PeriodicSpace {
    /// Its edge, world units; positive.
    pub edge: f64,
}

impl PeriodicSpace {
    /// The box itself.
    pub fn bounds(self) -> Bounds {
        Bounds { min: DVec3::ZERO, max: DVec3::splat(self.edge) }
    }

    /// A lattice of the box with points at most `spacing` apart. So many that the last ones lie at the edge to the last
    /// bit. `None` where there are more than lattices have.
    pub fn lattice(self, spacing: f64) -> Option<Lattice> {
        let cells = (self.edge / spacing).ceil().max(1.0);
        if cells > f64::from(crate::cpu::mesh::MOST_CELLS / 2) {
            return None;
        }
        let least = cells as u32;
        let is_exact = |cells: &u32| self.edge / f64::from(*cells) * f64::from(*cells) == self.edge;
        let cells = (least..least + TRIES).find(is_exact).unwrap_or_else(|| least.next_power_of_two());
        let spacing = self.edge / f64::from(cells);
        (spacing > 0.0).then_some(Lattice { origin: DVec3::ZERO, spacing, cells: [cells; 3] })
    }

    /// A difference of coordinates, to the nearest image.
    #[inline]
    pub fn nearest(self, difference: f64) -> f64 {
        let half = 0.5 * self.edge;
        if difference > half {
            difference - self.edge
        } else if difference < -half {
            difference + self.edge
        } else {
            difference
        }
    }

    /// From a particle to its images, the lowest first.
    pub fn shifts(self) -> [f64; 3] {
        [-self.edge, 0.0, self.edge]
    }

    /// Whether the kernel of a leaf's particle or of its image may reach a box.
    pub fn reaches(self, leaf: &Leaf, bounds: &Bounds) -> bool {
        let around = leaf.reached();
        (0..3).all(|axis| {
            self.shifts().into_iter().any(|shift| {
                around.min[axis] + shift <= bounds.max[axis] && around.max[axis] + shift >= bounds.min[axis]
            })
        })
    }

    /// Calls `take` for each image of a particle, itself included, whose kernel may reach a box.
    pub fn each_image(self, particle: &Particle, bounds: &Bounds, mut take: impl FnMut(&Particle)) {
        let reach = particle.smoothing_length;
        let near = [0, 1, 2].map(|axis| {
            self.shifts().map(|shift| {
                let at = particle.position[axis] + shift;
                (at + reach >= bounds.min[axis] && at - reach <= bounds.max[axis]).then_some(at)
            })
        });
        for z in near[2].into_iter().flatten() {
            for y in near[1].into_iter().flatten() {
                for x in near[0].into_iter().flatten() {
                    take(&Particle { position: DVec3::new(x, y, z), ..*particle });
                }
            }
        }
    }
}
