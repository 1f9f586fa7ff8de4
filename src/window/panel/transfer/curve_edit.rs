//! Editing a curve: points are taken hold of, dragged, added, removed and typed. No drawing here.

use crate::color::transfer::{Curve, MOST_POINTS};

/// A point of a curve: place and value.
type Point = (f32, f32);

/// Points may not come closer than this.
const NEAREST: f32 = 1e-3;
/// A point that is dragged this far out of the plot is let go of for good.
const OUT: f32 = 0.2;

/// What is being dragged: which point, and the others as they were.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CurveEdit {
    held: Option<(usize, Vec<Point>)>,
}

/// The point nearest to a place, if it is within `reach` of it.
pub fn nearest(curve: &Curve, at: Point, reach: Point) -> Option<usize> {
    let distance = |point: &Point| ((point.0 - at.0) / reach.0).hypot((point.1 - at.1) / reach.1);
    let found = curve.points().iter().enumerate().min_by(|a, b| distance(a.1).total_cmp(&distance(b.1)));
    found.filter(|(_, point)| distance(point) <= 1.0).map(|(index, _)| index)
}

/// The places that a point between these neighbours may have; `None` where there is no room.
fn room(points: &[Point], index: usize) -> Option<[f32; 2]> {
    let low = index.checked_sub(1).map_or(0.0, |before| points[before].0 + NEAREST);
    let high = points.get(index).map_or(1.0, |after| after.0 - NEAREST);
    (low <= high).then_some([low, high])
}

/// The curve with a point put in at `index`, as near to where it should be as its neighbours allow.
fn put(mut points: Vec<Point>, index: usize, (place, value): Point) -> Option<Curve> {
    if !(place.is_finite() && value.is_finite()) {
        return None;
    }
    let [low, high] = room(&points, index)?;
    points.insert(index, (place.clamp(low, high), value.clamp(0.0, 1.0)));
    Curve::new(points).ok()
}

/// The curve with another point at a place; `None` where there is no room for one.
pub fn add(curve: &Curve, at: Point) -> Option<Curve> {
    if curve.points().len() >= MOST_POINTS || !(0.0..=1.0).contains(&at.0) {
        return None;
    }
    let index = curve.points().partition_point(|point| point.0 <= at.0);
    put(curve.points().to_vec(), index, at)
}

/// The curve with another point on it, in the middle of the widest gap, and its index; `None` where there is no room for one.
pub fn add_in_gap(curve: &Curve) -> Option<(Curve, usize)> {
    let places = curve.points().iter().map(|point| point.0);
    let edges: Vec<f32> = std::iter::once(0.0).chain(places).chain(std::iter::once(1.0)).collect();
    let gap = edges.windows(2).max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])))?;
    let place = 0.5 * (gap[0] + gap[1]);
    let index = curve.points().partition_point(|point| point.0 <= place);
    Some((add(curve, (place, curve.at(place)))?, index))
}

/// The curve without a point; `None` where it is the last one.
pub fn remove(curve: &Curve, index: usize) -> Option<Curve> {
    let mut points = curve.points().to_vec();
    if points.len() < 2 || index >= points.len() {
        return None;
    }
    points.remove(index);
    Curve::new(points).ok()
}

/// The curve with a point moved between its neighbours.
pub fn set(curve: &Curve, index: usize, to: Point) -> Option<Curve> {
    let mut points = curve.points().to_vec();
    if index >= points.len() {
        return None;
    }
    points.remove(index);
    put(points, index, to)
}

impl CurveEdit {
    /// Takes hold of a point.
    pub fn grab(&mut self, curve: &Curve, index: usize) {
        let mut others = curve.points().to_vec();
        if index < others.len() {
            others.remove(index);
            self.held = Some((index, others));
        }
    }

    /// The point that is held.
    pub fn held(&self) -> Option<usize> {
        self.held.as_ref().map(|held| held.0)
    }

    /// The curve with the held point dragged to a place. Far out of the plot it is gone, as long as another one is left; it
    /// comes back with the pointer.
    pub fn drag(&self, to: Point) -> Option<Curve> {
        let (index, others) = self.held.as_ref()?;
        let out = !(-OUT..=1.0 + OUT).contains(&to.0) || !(-OUT..=1.0 + OUT).contains(&to.1);
        if out && !others.is_empty() {
            return Curve::new(others.clone()).ok();
        }
        put(others.clone(), *index, to)
    }

    /// Lets go.
    pub fn release(&mut self) {
        self.held = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn points_are_added_dragged_removed_and_typed() {
        let curve = add(&Curve::identity(), (0.5, 0.2)).unwrap();
        assert_eq!(curve.points(), [(0.0, 0.0), (0.5, 0.2), (1.0, 1.0)]);
        assert_eq!(nearest(&curve, (0.52, 0.22), (0.05, 0.05)), Some(1));
        assert_eq!(nearest(&curve, (0.7, 0.9), (0.05, 0.05)), None);
        let mut edit = CurveEdit::default();
        assert_eq!(edit.drag((0.1, 0.1)), None);
        edit.grab(&curve, 1);
        assert_eq!(edit.held(), Some(1));
        assert_eq!(edit.drag((0.7, 0.4)).unwrap().points()[1], (0.7, 0.4));
        // Neighbours hold it back, the plot's edges too.
        assert_eq!(edit.drag((1.1, 1.1)).unwrap().points()[1], (1.0 - NEAREST, 1.0));
        // Dragged out it is gone, and it comes back with the pointer.
        assert_eq!(edit.drag((0.5, -0.5)).unwrap(), Curve::identity());
        assert_eq!(edit.drag((0.5, 0.2)).unwrap(), curve);
        edit.release();
        assert_eq!(edit.drag((0.5, 0.5)), None);
        assert_eq!(set(&curve, 0, (0.25, 0.75)).unwrap().points()[0], (0.25, 0.75));
        assert_eq!(remove(&curve, 1), Some(Curve::identity()));
        assert_eq!(remove(&Curve::new(vec![(0.3, 0.3)]).unwrap(), 0), None, "the last point stays");
        assert_eq!(add(&curve, (f32::NAN, 0.5)), None);
    }

    #[test]
    fn a_point_in_the_widest_gap_lies_on_the_curve() {
        let (curve, index) = add_in_gap(&Curve::identity()).unwrap();
        assert_eq!((curve.points(), index), ([(0.0, 0.0), (0.5, 0.5), (1.0, 1.0)].as_slice(), 1));
        // Beyond the ends there may be most room.
        let (curve, index) = add_in_gap(&Curve::new(vec![(0.75, 0.25)]).unwrap()).unwrap();
        assert_eq!((curve.points(), index), ([(0.375, 0.25), (0.75, 0.25)].as_slice(), 0));
        let full = Curve::new((0..MOST_POINTS).map(|k| (k as f32 / MOST_POINTS as f32, 0.5)).collect()).unwrap();
        assert_eq!(add_in_gap(&full), None);
    }

    proptest! {
        #[test]
        fn whatever_is_done_it_stays_a_curve(
            steps in proptest::collection::vec((0..5u8, -0.6..1.6f32, -0.6..1.6f32, 0..12usize), 1..80)
        ) {
            let mut curve = Curve::identity();
            let mut edit = CurveEdit::default();
            for (what, x, y, index) in steps {
                let before = curve.points().len();
                let next = match what {
                    0 => { edit.release(); add(&curve, (x, y)) }
                    1 => { edit.release(); remove(&curve, index) }
                    2 => { edit.release(); set(&curve, index, (x, y)) }
                    3 => { edit.grab(&curve, index); None }
                    _ => edit.drag((x, y)),
                };
                if let Some(next) = next {
                    prop_assert_eq!(Curve::new(next.points().to_vec()), Ok(next.clone()));
                    let change = next.points().len() as i64 - before as i64;
                    let expected = match what {
                        0 => 1..=1,
                        1 => -1..=-1,
                        2 => 0..=0,
                        _ => -1..=1,
                    };
                    prop_assert!(expected.contains(&change));
                    curve = next;
                }
            }
        }
    }
}
