//! Piecewise linear curves over the places of a range.

use serde::{Deserialize, Serialize};

/// Points that a curve may have.
pub const MOST_POINTS: usize = 64;

/// A piecewise linear curve through points of ascending place, all coordinates within [0, 1]; constant beyond its ends.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<(f32, f32)>", into = "Vec<(f32, f32)>")]
pub struct Curve(Vec<(f32, f32)>);

impl Curve {
    /// The curve through points.
    ///
    /// # Errors
    /// What is wrong with them, when there are none, they are not sorted, or one is outside [0, 1].
    pub fn new(points: Vec<(f32, f32)>) -> Result<Curve, String> {
        if points.is_empty() {
            return Err("no points, expected one or more (place, value)".into());
        }
        if points.len() > MOST_POINTS {
            return Err(format!("{} points, expected up to {MOST_POINTS}", points.len()));
        }
        for (index, (place, value)) in points.iter().enumerate() {
            if !((0.0..=1.0).contains(place) && (0.0..=1.0).contains(value)) {
                return Err(format!("point {} is ({place}, {value}), expected numbers from 0 to 1", index + 1));
            }
            if index > 0 && points[index - 1].0 >= *place {
                let before = points[index - 1].0;
                return Err(format!("points are not sorted: {before} comes before {place}, expected ascending places"));
            }
        }
        Ok(Curve(points))
    }

    /// From 0 at the beginning to 1 at the end.
    pub fn identity() -> Curve {
        Curve(vec![(0.0, 0.0), (1.0, 1.0)])
    }

    /// The same value everywhere, within [0, 1].
    pub fn constant(value: f32) -> Curve {
        Curve(vec![(0.0, value.clamp(0.0, 1.0)), (1.0, value.clamp(0.0, 1.0))])
    }

    /// How a volume's opacity rises with the density, unless it is set: thin matter is a haze.
    pub fn usual_opacity() -> Curve {
        Curve(vec![(0.0, 0.0), (0.15, 0.006), (0.4, 0.03), (0.7, 0.13), (1.0, 0.6)])
    }

    /// How a volume's brightness rises with the density, unless it is set.
    pub fn usual_brightness() -> Curve {
        Curve(vec![(0.0, 0.25), (0.5, 0.65), (1.0, 1.0)])
    }

    /// Its points: place and value.
    pub fn points(&self) -> &[(f32, f32)] {
        &self.0
    }

    /// What lies at a share of the way to another curve, at every place of either's points; as it is where they would be too many.
    pub fn mixed(&self, other: &Curve, share: f32) -> Curve {
        let mut places: Vec<f32> = self.0.iter().chain(&other.0).map(|point| point.0).collect();
        places.sort_by(f32::total_cmp);
        places.dedup();
        let value = |place: f32| self.at(place) + (other.at(place) - self.at(place)) * share.clamp(0.0, 1.0);
        let points = places.into_iter().map(|place| (place, value(place).clamp(0.0, 1.0))).collect();
        Curve::new(points).unwrap_or_else(|_| self.clone())
    }

    /// The value at a place.
    pub fn at(&self, place: f32) -> f32 {
        let after = self.0.partition_point(|point| point.0 <= place);
        match (after.checked_sub(1).map(|before| self.0[before]), self.0.get(after)) {
            (Some((from, low)), Some((to, high))) => low + (high - low) * (place - from) / (to - from),
            (Some((_, value)), None) => value,
            (None, first) => first.map_or(0.0, |first| first.1),
        }
    }
}

impl TryFrom<Vec<(f32, f32)>> for Curve {
    type Error = String;

    fn try_from(points: Vec<(f32, f32)>) -> Result<Curve, String> {
        Curve::new(points)
    }
}

impl From<Curve> for Vec<(f32, f32)> {
    fn from(curve: Curve) -> Vec<(f32, f32)> {
        curve.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_curve_goes_through_its_points_and_not_beyond_them(
            mut points in proptest::collection::vec((0.0..1.0f32, 0.0..1.0f32), 1..12), place in -0.5..1.5f32
        ) {
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            points.dedup_by(|a, b| a.0 == b.0);
            let curve = Curve::new(points.clone()).unwrap();
            for &(place, value) in &points {
                prop_assert!((curve.at(place) - value).abs() < 1e-6);
            }
            let found = curve.at(place);
            let next = points.iter().position(|point| point.0 > place).unwrap_or(points.len());
            let around = [points[next.max(1) - 1].1, points[next.min(points.len() - 1)].1];
            prop_assert!(found >= around[0].min(around[1]) - 1e-6 && found <= around[0].max(around[1]) + 1e-6);
        }
    }

    #[test]
    fn the_usual_curves_are_curves() {
        for curve in [Curve::identity(), Curve::constant(0.3), Curve::usual_opacity(), Curve::usual_brightness()] {
            assert_eq!(Curve::new(curve.points().to_vec()), Ok(curve));
        }
        assert!(Curve::new(vec![(0.0, 0.0); 99]).unwrap_err().contains("up to 64"));
    }
}
