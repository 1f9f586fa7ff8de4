//! Where a dataset lies in a scene of several.

use super::{Bounds, Dataset};
use glam::DVec3;

/// Turns a dataset's own coordinates and masses into those of the scene: `x' = scale x + offset`, `m' = mass m`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Where the dataset's origin comes to lie, the scene's length unit.
    pub offset: DVec3,
    /// Scene lengths for one of the dataset's; positive.
    pub scale: f64,
    /// Scene masses for one of the dataset's; positive.
    pub mass: f64,
}

impl Default for Placement {
    fn default() -> Placement {
        Placement::HERE
    }
}

impl Placement {
    /// Everything stays as it is.
    pub const HERE: Placement = Placement { offset: DVec3::ZERO, scale: 1.0, mass: 1.0 };

    /// Whether nothing changes.
    pub fn is_here(&self) -> bool {
        *self == Placement::HERE
    }

    /// Whether it can be used: finite, and with factors between 1e-30 and 1e30.
    pub fn is_valid(&self) -> bool {
        let factor = |x: f64| (1e-30..=1e30).contains(&x);
        self.offset.is_finite() && factor(self.scale) && factor(self.mass)
    }

    /// This, and then `next`.
    pub fn then(&self, next: &Placement) -> Placement {
        Placement { offset: next.position(self.offset), scale: self.scale * next.scale, mass: self.mass * next.mass }
    }

    /// A place.
    pub fn position(&self, own: DVec3) -> DVec3 {
        own * self.scale + self.offset
    }

    /// A box; an empty one stays empty.
    pub fn bounds(&self, own: Bounds) -> Bounds {
        if own.is_empty() { own } else { Bounds { min: self.position(own.min), max: self.position(own.max) } }
    }

    /// Scene densities for one of the dataset's.
    pub fn density(&self) -> f64 {
        self.mass / (self.scale * self.scale * self.scale)
    }

    /// A particle's density there, held at the least or the largest one where that is beyond 32-bit floats: from parsecs to metres densities change by
    /// 50 decades.
    pub fn placed_density(&self, own: f32) -> f32 {
        let placed = f64::from(own) * self.density();
        if own > 0.0 { placed.clamp(f64::from(f32::MIN_POSITIVE), f64::from(f32::MAX)) as f32 } else { own }
    }

    /// Puts a dataset's particles there.
    pub fn place(&self, dataset: &mut Dataset) {
        if self.is_here() {
            return;
        }
        let times = |values: &mut [f32], factor: f64| {
            values.iter_mut().for_each(|value| *value = (f64::from(*value) * factor) as f32);
        };
        for family in &mut dataset.families {
            family.positions.iter_mut().for_each(|at| *at = self.position(DVec3::from(*at)).to_array());
            times(&mut family.mass, self.mass);
            family.density.iter_mut().for_each(|density| *density = self.placed_density(*density));
            times(&mut family.smoothing_length, self.scale);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn densities_end_where_32_bits_do() {
        let scaled = |scale: f64| Placement { scale, ..Placement::HERE };
        assert_eq!(scaled(10.0).placed_density(3.0), 0.003);
        let parsecs = scaled(3e16);
        assert_eq!([1.0, 0.0].map(|own| parsecs.placed_density(own)), [f32::MIN_POSITIVE, 0.0]);
        assert_eq!(scaled(3e-16).placed_density(1.0), f32::MAX);
    }
}
