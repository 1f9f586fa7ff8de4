//! Tracks of one place over one interval as curves, in single precision around that place.

use crate::hierarchy::spacetime::{HermiteSpline, Interval, TrackFlags, Tracks};
use crate::model::Bounds;
use glam::DVec3;

/// Values of a quantity that are kept of each place to find ranges from.
const SAMPLES: usize = 64;

/// Tracks, in columns of one length.
#[derive(Clone, Debug, PartialEq)]
pub struct Curves {
    /// What coordinates are relative to, world units.
    pub origin: DVec3,
    /// A box around all control points, world units.
    pub bounds: Bounds,
    /// Length of the interval, in the clock's unit.
    pub length: f64,
    /// Control points of each curve in Bézier's form, from the origin.
    pub points: Vec<[[f32; 3]; 4]>,
    /// Masses at both ends, by the track's weight there.
    pub mass: Vec<[f32; 2]>,
    /// What else is known of each.
    pub flags: Vec<TrackFlags>,
    /// A quantity at both ends, where it is asked for.
    pub values: Vec<[f32; 2]>,
    /// Particles of each; one where it is empty.
    pub counts: Vec<u32>,
    /// The number of each among the tracks of its place, where these are not all.
    pub numbers: Vec<u32>,
}

impl Curves {
    /// The tracks that `keep` wants, with the attribute of that number.
    pub fn new(tracks: &Tracks, interval: &Interval, attribute: Option<usize>, keep: impl Fn(usize) -> bool) -> Curves {
        let kept: Vec<usize> = (0..tracks.len()).filter(|i| keep(*i)).collect();
        let splines: Vec<HermiteSpline> = kept.iter().map(|i| interval.spline(tracks, *i)).collect();
        let of_ends = |i: usize| [0, 1].map(|end| tracks.ends[end].mass[i]);
        let mut curves = Curves::of(&splines, interval.length);
        curves.mass = kept.iter().map(|i| of_ends(*i)).collect();
        curves.flags = kept.iter().map(|i| tracks.flags[*i]).collect();
        if kept.len() < tracks.len() {
            curves.numbers = kept.iter().map(|i| *i as u32).collect();
        }
        if let Some(k) = attribute {
            let value =
                |i: &usize| [0, 1].map(|end| tracks.ends[end].attributes.get(k).map_or(f32::NAN, |own| own[*i]));
            curves.values = kept.iter().map(value).collect();
        }
        curves
    }

    /// Splines over an interval of that length, of mass 1.
    pub fn of(splines: &[HermiteSpline], length: f64) -> Curves {
        let points = || splines.iter().flat_map(HermiteSpline::control_points);
        let mut bounds =
            points().fold(Bounds::EMPTY, |bounds, at| Bounds { min: bounds.min.min(at), max: bounds.max.max(at) });
        if bounds.is_empty() {
            bounds = Bounds { min: DVec3::ZERO, max: DVec3::ZERO };
        }
        let origin = bounds.center();
        let relative = |spline: &HermiteSpline| spline.control_points().map(|at| (at - origin).as_vec3().to_array());
        Curves {
            origin,
            bounds,
            length,
            points: splines.iter().map(relative).collect(),
            mass: vec![[1.0; 2]; splines.len()],
            flags: vec![TrackFlags::default(); splines.len()],
            values: Vec::new(),
            counts: Vec::new(),
            numbers: Vec::new(),
        }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Particles of a curve.
    pub fn count(&self, i: usize) -> u32 {
        self.counts.get(i).copied().unwrap_or(1)
    }

    /// The number of a curve among the tracks of its place.
    pub fn number(&self, i: usize) -> usize {
        self.numbers.get(i).map_or(i, |number| *number as usize)
    }

    /// Bytes that they take.
    pub fn memory(&self) -> u64 {
        let each = size_of::<[[f32; 3]; 4]>() + size_of::<[f32; 2]>() + size_of::<TrackFlags>();
        let more =
            self.values.len() * size_of::<[f32; 2]>() + (self.counts.len() + self.numbers.len()) * size_of::<u32>();
        (self.len() * each + more) as u64
    }

    /// A few of the curves, evenly spread, for ranges.
    pub fn sample(&self) -> impl Iterator<Item = usize> + use<> {
        (0..self.len()).step_by(self.len().div_ceil(SAMPLES).max(1))
    }

    /// The speed in the middle of a curve, world units by the clock's.
    pub fn speed(&self, i: usize) -> f32 {
        let [a, b, c, d] = self.points[i];
        let along: [f32; 3] = std::array::from_fn(|k| 0.75 * ((d[k] - a[k]) + (c[k] - b[k])));
        let [x, y, z] = along;
        (x * x + y * y + z * z).sqrt() / self.length as f32
    }
}
