//! What of a globe is behind its own horizon: chunks that nobody can see are neither chosen nor read, and what may be seen of the far side, through
//! holes, is behind all of the near side.

use super::placed::{Map, Placed};
use super::sight::Sight;
use super::stitch::Scene;
use crate::view::{Projection, View};
use deepfield_heights::model::Globe;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// How far away the horizon of a globe that is closed all around is. Lengths are those of a ball: a globe is stretched along its axis until it is
/// one, which leaves straight lines straight.
#[derive(Clone, Copy, Debug)]
pub struct Horizon {
    placed: Placed,
    globe: Globe,
    /// Longitude and latitude of the eye in the stretched world, radians.
    under: [f64; 2],
    /// The angle from there to where lines of sight touch the lowest part.
    touched: f64,
    /// The radius of the largest ball that is in the globe everywhere.
    low: f64,
}

/// Radii of the balls, in the stretched world, that are within and around what is so high everywhere.
fn balls(globe: &Globe, height: f64) -> [f64; 2] {
    // The same ellipsoid `s` times as large is at least `(s - 1)` times its shortest half axis away, and at most as many times its longest.
    let (short, long) = (globe.equator.min(globe.pole), globe.reach());
    let shares = [height / short, height / long];
    [shares[0].min(shares[1]), shares[0].max(shares[1])].map(|share| globe.equator * (1.0 + share))
}

impl Horizon {
    /// For a globe whose surface is closed and is nowhere lower than a height above it; `None` where everything may be seen.
    pub fn new(placed: &Placed, sight: &Sight, lowest: f64) -> Option<Horizon> {
        let Map::Globe(globe) = placed.map else { return None };
        let [low, _] = balls(&globe, lowest);
        let stretched = |place: DVec3| DVec3::new(place.x, place.y, place.z * globe.equator / globe.pole);
        let (to_eye, touched) = match sight {
            Sight::Flat(View { projection: Projection::Orthographic { .. }, forward, .. }) => {
                (-stretched(*forward), FRAC_PI_2)
            }
            _ => {
                let eye = stretched(sight.eye());
                (eye, (low / eye.length()).acos())
            }
        };
        let under = [to_eye.y.atan2(to_eye.x), to_eye.z.atan2(to_eye.x.hypot(to_eye.y))];
        // What is cut away hides nothing, and within the globe there is no horizon.
        let is_there = low > 0.0 && touched.is_finite() && !sight.cut().clips();
        is_there.then_some(Horizon { placed: *placed, globe, under, touched, low })
    }

    /// Whether all of a rectangle of samples, as high as this at most, is behind the horizon; never true where some may be seen.
    pub fn hides(&self, [rows, columns]: [[u64; 2]; 2], highest: f64) -> bool {
        let [_, high] = balls(&self.globe, highest);
        let beyond = self.touched + (self.low / high.max(self.low)).acos();
        if beyond >= PI {
            return false;
        }
        let Placed { origin, step, .. } = self.placed;
        let ends = |ends: [u64; 2], axis: usize| {
            let [a, b] = ends.map(|end| (end as f64).mul_add(step[axis], origin[axis]));
            [a.min(b), a.max(b)]
        };
        let (longitudes, latitudes) = (ends(columns, 0), ends(rows, 1));
        // As seen from the middle of the stretched world; heights change that a little.
        let seen = |latitude: f64, height: f64| {
            let [x, _, z] = self.globe.place(0.0, latitude.clamp(-90.0, 90.0), height);
            (z * self.globe.equator / self.globe.pole).atan2(x)
        };
        let low = self.low - self.globe.reach();
        let between = |latitude: f64| [seen(latitude, low), seen(latitude, highest)];
        let (south, north) = (between(latitudes[0]), between(latitudes[1]));
        let (south, north) = (south[0].min(south[1]), north[0].max(north[1]));
        // The nearest longitude, and on it the nearest latitude.
        let [first, last] = longitudes.map(f64::to_radians);
        let after = (self.under[0] - first).rem_euclid(TAU);
        let aside = if after <= last - first { 0.0 } else { (after - (last - first)).min(TAU - after) };
        let (up, level) = self.under[1].sin_cos();
        let (up, level) = (up, level * aside.cos());
        let nearest = |latitude: f64| up * latitude.sin() + level * latitude.cos();
        let turning = up.atan2(level);
        let most = match (south..=north).contains(&turning) {
            true => up.hypot(level),
            false => nearest(south).max(nearest(north)),
        };
        // A little for rounding.
        most.clamp(-1.0, 1.0).acos() > beyond + 1e-9
    }
}

/// The plane through all places where lines of sight touch a globe: between its near side and its far side, whatever line of sight passes both.
#[derive(Clone, Copy, Debug)]
pub struct Limb {
    /// Away from the eye, a unit vector.
    pub normal: DVec3,
    /// How far along that from the eye it is.
    pub away: f64,
}

impl Limb {
    /// That of the lowest place of a scene, beyond those of all that is higher; `None` of what is flat, or has no chunks.
    pub fn of(scene: &Scene, sight: &Sight) -> Option<Limb> {
        let Map::Globe(globe) = scene.placed.map else { return None };
        let facts = scene.meshes.iter().map(|mesh| &mesh.node.facts).filter(|facts| !facts.is_empty());
        let heights = facts.flat_map(|facts| [facts.min, facts.max]).map(|height| scene.placed.lifted(height));
        Limb::new(&globe, heights.fold(f64::INFINITY, f64::min), sight)
    }

    /// That of a globe which is so much larger along all its axes.
    fn new(globe: &Globe, lowest: f64, sight: &Sight) -> Option<Limb> {
        let axes = DVec3::new(globe.equator, globe.equator, globe.pole) + lowest;
        if !(axes.is_finite() && axes.min_element() > 0.0) {
            return None;
        }
        // The polar plane of the eye is where this times a place is 1, that of a direction where it is 0.
        let polar = |place: DVec3| place / (axes * axes);
        let eye = sight.eye();
        let (normal, away) = match sight {
            Sight::Flat(View { projection: Projection::Orthographic { .. }, forward, .. }) => {
                (polar(*forward), -polar(*forward).dot(eye))
            }
            _ => (-polar(eye), polar(eye).dot(eye) - 1.0),
        };
        let length = normal.length();
        (length > 0.0).then(|| Limb { normal: normal / length, away: away / length })
    }

    /// Whether what is so far from the eye is on the near side of it.
    pub fn is_beyond(&self, relative: DVec3) -> bool {
        self.normal.dot(relative) < self.away
    }

    /// The parameter at which a ray that begins so far from the eye passes from the near side to the far side; `None` where it does not.
    pub fn passed(&self, start: DVec3, direction: DVec3) -> Option<f64> {
        let t = (self.away - self.normal.dot(start)) / self.normal.dot(direction);
        (self.normal.dot(direction) > 0.0 && t > 0.0).then_some(t)
    }
}

#[cfg(test)]
mod tests;
