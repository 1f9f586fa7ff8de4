//! Axis-aligned boxes in world coordinates.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// The smallest axis-aligned box around a set of points, in the source's length unit. An empty box has
/// `min > max` in every component.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bounds {
    /// Smallest coordinate along each axis.
    pub min: DVec3,
    /// Largest coordinate along each axis.
    pub max: DVec3,
}

impl Bounds {
    /// The box that holds nothing: the neutral element of [`Bounds::union`].
    pub const EMPTY: Bounds = Bounds { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// The box that holds everything.
    pub const EVERYTHING: Bounds = Bounds { min: DVec3::NEG_INFINITY, max: DVec3::INFINITY };

    /// The box around `points`; [`Bounds::EMPTY`] for none.
    pub fn of(points: impl IntoIterator<Item = [f64; 3]>) -> Bounds {
        points.into_iter().fold(Bounds::EMPTY, |bounds, point| bounds.with(DVec3::from_array(point)))
    }

    /// This box, grown to hold `point`.
    pub fn with(self, point: DVec3) -> Bounds {
        Bounds { min: self.min.min(point), max: self.max.max(point) }
    }

    /// The box around both boxes.
    pub fn union(self, other: Bounds) -> Bounds {
        Bounds { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// This box, displaced.
    pub fn moved(self, offset: DVec3) -> Bounds {
        Bounds { min: self.min + offset, max: self.max + offset }
    }

    /// Whether the box holds no point at all.
    pub fn is_empty(&self) -> bool {
        self.min.cmpgt(self.max).any()
    }

    /// Whether `point` lies in the box or on its surface.
    pub fn contains(&self, point: DVec3) -> bool {
        point.cmpge(self.min).all() && point.cmple(self.max).all()
    }

    /// The middle of the box; the origin for an empty one.
    pub fn center(&self) -> DVec3 {
        if self.is_empty() { DVec3::ZERO } else { 0.5 * (self.min + self.max) }
    }

    /// Edge lengths; zero for an empty box.
    pub fn size(&self) -> DVec3 {
        if self.is_empty() { DVec3::ZERO } else { self.max - self.min }
    }
}
