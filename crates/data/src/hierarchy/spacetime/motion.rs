//! Tracks for whoever evaluates them where they are drawn: what [`Tracks::drawn_at`] gives at every moment of an interval, written so
//! that nothing has to be decided track by track. What fades is two particles that stand, and straight lines are splines.

use super::tracks::{Interpolation, Interval, Moving, TrackEnd, Tracks};
use crate::codec::AttributeMerge;
use glam::DVec3;

/// Particles on their way through an interval; row `i` of both ends is of one particle. Between the ends the place is the cubic Hermite
/// spline of places and velocities, mass is linear, density and smoothing length are linear in the logarithm where both are
/// positive, and so are the attributes that say so; other values are linear.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// Both ends. Places at the last one are those of the images that are reached; there are no ids.
    pub ends: [Moving; 2],
    /// The clock at both ends. Before and after, particles stand.
    pub span: [f64; 2],
    /// Whether particles stay where they begin until the end is there.
    pub holds: bool,
    /// The edge of the periodic box that places are wrapped into, whose corner is the origin.
    pub box_size: Option<f64>,
    /// Which attributes are linear in the logarithm.
    pub is_logarithmic: Vec<bool>,
}

impl Motion {
    /// Where in the interval a time is, from 0 to 1.
    pub fn place(span: [f64; 2], holds: bool, time: f64) -> f64 {
        let u = ((time - span[0]) / (span[1] - span[0])).clamp(0.0, 1.0);
        if holds && u < 1.0 { 0.0 } else { u }
    }
}

impl Tracks {
    /// Their motion through an interval that begins at `begin` by the clock; `rules` says of each attribute how it is averaged. Rows are
    /// those of [`Tracks::drawn_at`].
    pub fn motion(
        &self,
        interval: &Interval,
        begin: f64,
        interpolation: Interpolation,
        rules: &[AttributeMerge],
    ) -> Motion {
        let fades = |i: usize| self.fades(i, interpolation);
        let twice = (0..self.len()).filter(|i| fades(*i)).map(|i| (i, Some(1)));
        // Each track, and the end where it stands.
        let drawn: Vec<(usize, Option<usize>)> =
            (0..self.len()).map(|i| (i, fades(i).then_some(0))).chain(twice).collect();
        let end = |end: usize| {
            let of = |stands: Option<usize>| &self.ends[stands.unwrap_or(end)];
            let column = |values: &dyn Fn(&TrackEnd) -> &[f32]| -> Vec<f32> {
                drawn.iter().map(|&(i, stands)| values(of(stands))[i]).collect()
            };
            let place =
                |&(i, stands): &(usize, Option<usize>)| DVec3::from(interval.lattice.position(of(stands).places[i]));
            let velocity = |&(i, stands): &(usize, Option<usize>)| match (stands, interpolation) {
                (Some(_), _) => DVec3::ZERO,
                (None, Interpolation::Linear) => {
                    let [begin, end] = interval.spline(self, i).positions;
                    (end - begin) / interval.length
                }
                (None, _) => interval.spline(self, i).tangents[end] / interval.length,
            };
            // What stands at the other end has nothing here.
            let mass = |&(i, stands): &(usize, Option<usize>)| match stands {
                Some(other) if other != end => 0.0,
                _ => self.flags[i].weights()[end] as f32 * self.ends[end].mass[i],
            };
            Moving {
                ids: Vec::new(),
                positions: drawn.iter().map(|row| place(row).to_array()).collect(),
                velocities: drawn.iter().map(|row| velocity(row).to_array()).collect(),
                mass: drawn.iter().map(mass).collect(),
                density: column(&|end| &end.density),
                smoothing_length: column(&|end| &end.smoothing_length),
                attributes: (0..rules.len()).map(|k| column(&|end| &end.attributes[k])).collect(),
            }
        };
        Motion {
            ends: [end(0), end(1)],
            span: [begin, begin + interval.length],
            holds: interpolation == Interpolation::Hold,
            box_size: interval.box_size,
            is_logarithmic: rules.iter().map(|rule| *rule != AttributeMerge::Magnitude).collect(),
        }
    }
}
