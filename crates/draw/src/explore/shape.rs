//! Regions made ready for tests of many particles, and of boxes around many particles at once; periodic boxes included.
//!
//! In a periodic box of edge L a particle is inside a sphere or box if any of its images `x + n L` is. A lasso is about what one
//! picture shows, which has no images.

use super::error::ExploreError;
use super::lasso::LassoTest;
use super::region::{Region, Shape};
use crate::model::Bounds;
use glam::DVec3;

/// How much of a box is inside a region.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cover {
    /// Nothing.
    Outside,
    /// Some of it, or that is not certain.
    Partly,
    /// All of it.
    Inside,
}

/// The shapes of a region, ready for tests.
#[derive(Clone, Debug)]
pub struct Shapes {
    shapes: Vec<Test>,
    /// Edge of the periodic box.
    edge: Option<f64>,
    reference: DVec3,
}

#[derive(Clone, Debug)]
enum Test {
    Sphere { center: DVec3, squared: f64, radius: f64 },
    Box { min: DVec3, max: DVec3 },
    Lasso(Box<LassoTest>),
}

impl Shapes {
    /// The shapes of a region, in a periodic box of edge `periodic` or none.
    ///
    /// # Errors
    /// [`ExploreError::Value`] where the region makes no sense.
    pub fn new(region: &Region, periodic: Option<f64>) -> Result<Shapes, ExploreError> {
        region.check()?;
        let shapes = region.shapes.iter().map(|shape| {
            Ok(match shape {
                Shape::Sphere { center, radius } => {
                    Test::Sphere { center: *center, squared: radius * radius, radius: *radius }
                }
                Shape::Box { min, max } => Test::Box { min: *min, max: *max },
                Shape::Lasso(lasso) => Test::Lasso(Box::new(LassoTest::new(lasso)?)),
            })
        });
        let shapes: Vec<Test> = shapes.collect::<Result<_, ExploreError>>()?;
        let reference = shapes.iter().find_map(|shape| match shape {
            Test::Sphere { center, .. } => Some(*center),
            Test::Box { min, max } => Some(0.5 * (*min + *max)),
            Test::Lasso(_) => None,
        });
        let edge = periodic.filter(|edge| *edge > 0.0 && edge.is_finite() && reference.is_some());
        Ok(Shapes { shapes, edge, reference: reference.unwrap_or(DVec3::ZERO) })
    }

    /// The centre of the first sphere or box, near which particles are seen: the origin of [`Shapes::relative`].
    pub fn reference(&self) -> DVec3 {
        self.reference
    }

    /// Whether there is no shape, so that every place is inside.
    pub fn are_everywhere(&self) -> bool {
        self.shapes.is_empty()
    }

    /// The edge of the periodic box, where distances are taken around it.
    pub fn edge(&self) -> Option<f64> {
        self.edge
    }

    /// From the reference to the nearest image of a point.
    #[inline]
    pub fn relative(&self, point: DVec3) -> DVec3 {
        let offset = point - self.reference;
        match self.edge {
            Some(edge) => offset - edge * (offset / edge).round(),
            None => offset,
        }
    }

    /// Whether a point is inside every shape.
    #[inline]
    pub fn contains(&self, point: DVec3) -> bool {
        self.shapes.iter().all(|shape| shape.contains(point, self.edge))
    }

    /// Whether a point within `reach` (a distance along each axis) of `point` may be on the other side of a surface: how a
    /// particle's rounded position may deceive.
    pub fn is_near_surface(&self, point: DVec3, reach: f64) -> bool {
        let bounds = Bounds { min: point - reach, max: point + reach };
        let covers = self.shapes.iter().map(|shape| match shape {
            Test::Lasso(lasso) if lasso.is_near_surface(point, reach) => Cover::Partly,
            Test::Lasso(lasso) => {
                if lasso.contains(point) {
                    Cover::Inside
                } else {
                    Cover::Outside
                }
            }
            shape => shape.cover(bounds, self.edge),
        });
        worst(covers) == Cover::Partly
    }

    /// How much of a box is inside every shape.
    pub fn cover(&self, bounds: Bounds) -> Cover {
        worst(self.shapes.iter().map(|shape| shape.cover(bounds, self.edge)))
    }
}

/// What is outside of one shape is outside of all, what is inside of each is inside.
fn worst(covers: impl Iterator<Item = Cover>) -> Cover {
    let mut all = Cover::Inside;
    for cover in covers {
        match cover {
            Cover::Outside => return Cover::Outside,
            Cover::Partly => all = Cover::Partly,
            Cover::Inside => {}
        }
    }
    all
}

impl Test {
    #[inline]
    fn contains(&self, point: DVec3, edge: Option<f64>) -> bool {
        match self {
            Test::Sphere { center, squared, .. } => {
                let offset = point - *center;
                let offset = edge.map_or(offset, |edge| offset - edge * (offset / edge).round());
                offset.length_squared() <= *squared
            }
            Test::Box { min, max } => match edge {
                None => point.cmpge(*min).all() && point.cmple(*max).all(),
                Some(edge) => (0..3).all(|k| above(point[k], min[k], edge) <= max[k] - min[k]),
            },
            Test::Lasso(lasso) => lasso.contains(point),
        }
    }

    fn cover(&self, bounds: Bounds, edge: Option<f64>) -> Cover {
        match self {
            Test::Sphere { center, radius, .. } => {
                let (mut nearest, mut farthest) = (DVec3::ZERO, DVec3::ZERO);
                for k in 0..3 {
                    [nearest[k], farthest[k]] = distances(bounds.min[k] - center[k], bounds.max[k] - center[k], edge);
                }
                // Boxes that touch the surface up to rounding are looked into.
                let hair = 1e-12 * (radius + center.abs().max_element() + edge.unwrap_or(0.0));
                match () {
                    () if nearest.length() > radius + hair => Cover::Outside,
                    () if farthest.length() < radius - hair => Cover::Inside,
                    () => Cover::Partly,
                }
            }
            Test::Box { min, max } => worst((0..3).map(|k| {
                let (low, high, size) = (bounds.min[k], bounds.max[k], max[k] - min[k]);
                let Some(edge) = edge else {
                    return match () {
                        () if high < min[k] || low > max[k] => Cover::Outside,
                        () if low >= min[k] && high <= max[k] => Cover::Inside,
                        () => Cover::Partly,
                    };
                };
                let hair = 1e-12 * (edge + low.abs() + high.abs() + min[k].abs() + max[k].abs());
                let above = above(low, min[k], edge);
                match () {
                    () if above + (high - low) + hair < size => Cover::Inside,
                    // Neither does the interval begin inside, nor does it reach the next image.
                    () if above > size + hair && above + (high - low) + hair < edge => Cover::Outside,
                    () => Cover::Partly,
                }
            })),
            Test::Lasso(lasso) => lasso.cover(bounds),
        }
    }
}

/// How far the image of `x` that follows `from` is above it: in `0..edge`.
#[inline]
fn above(x: f64, from: f64, edge: f64) -> f64 {
    let offset = (x - from) % edge;
    if offset < 0.0 { offset + edge } else { offset }
}

/// Smallest and largest distance of an interval of offsets from zero, around a periodic box where there is one.
fn distances(low: f64, high: f64, edge: Option<f64>) -> [f64; 2] {
    let Some(edge) = edge else {
        let nearest = if low <= 0.0 && high >= 0.0 { 0.0 } else { low.abs().min(high.abs()) };
        return [nearest, low.abs().max(high.abs())];
    };
    let around = |x: f64| (x - edge * (x / edge).round()).abs();
    let holds = |x: f64| ((low - x) / edge).ceil() * edge + x <= high;
    let nearest = if holds(0.0) { 0.0 } else { around(low).min(around(high)) };
    let farthest = if holds(0.5 * edge) { 0.5 * edge } else { around(low).max(around(high)) };
    [nearest, farthest]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn shape() -> impl Strategy<Value = Shape> {
        let place = || prop::array::uniform3(-0.5..10.5_f64).prop_map(DVec3::from_array);
        prop_oneof![
            (place(), 0.05..7.0_f64).prop_map(|(center, radius)| Shape::Sphere { center, radius }),
            (place(), prop::array::uniform3(0.0..9.0_f64))
                .prop_map(|(min, size)| Shape::Box { min, max: min + DVec3::from_array(size) }),
        ]
    }

    /// Membership by looking at all images.
    fn brute(shape: &Shape, point: DVec3, edge: Option<f64>) -> bool {
        let inside = |image: DVec3| match shape {
            Shape::Sphere { center, radius } => image.distance(*center) <= *radius,
            Shape::Box { min, max } => Bounds { min: *min, max: *max }.contains(image),
            Shape::Lasso(_) => unreachable!(),
        };
        let images =
            || (-3..=3).flat_map(|x| (-3..=3).flat_map(move |y| (-3..=3).map(move |z| [x, y, z].map(f64::from))));
        match edge {
            None => inside(point),
            Some(edge) => images().any(|n| inside(point + edge * DVec3::from_array(n))),
        }
    }

    proptest! {
        #[test]
        fn membership_is_that_of_any_image(
            shapes in prop::collection::vec(shape(), 0..3),
            periodic: bool,
            points in prop::collection::vec(prop::array::uniform3(0.0..10.0_f64), 40),
        ) {
            let edge = periodic.then_some(10.0);
            let region = Region { shapes, ..Region::default() };
            let test = Shapes::new(&region, edge).unwrap();
            for point in points.into_iter().map(DVec3::from_array) {
                let expected = region.shapes.iter().all(|shape| brute(shape, point, edge));
                if !test.is_near_surface(point, 1e-9) {
                    prop_assert_eq!(test.contains(point), expected);
                }
                let distance = test.relative(point).length();
                prop_assert!(distance <= (point - test.reference()).length() + 1e-12);
            }
        }

        /// What is said of a box holds for every point in it, and what is not near the surface is on one side of it.
        #[test]
        fn boxes_are_judged_safely(
            shapes in prop::collection::vec(shape(), 1..3),
            periodic: bool,
            center in prop::array::uniform3(0.0..10.0_f64),
            half in prop_oneof![0.001..0.1_f64, 0.1..6.0_f64],
            points in prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 40),
        ) {
            let test = Shapes::new(&Region { shapes, ..Region::default() }, periodic.then_some(10.0)).unwrap();
            let center = DVec3::from_array(center);
            let cover = test.cover(Bounds { min: center - half, max: center + half });
            let near = test.is_near_surface(center, half);
            for at in points {
                let inside = test.contains(center + half * DVec3::from_array(at));
                prop_assert!(cover == Cover::Partly || inside == (cover == Cover::Inside), "{:?} {}", cover, inside);
                prop_assert!(near || inside == test.contains(center));
            }
        }
    }

    #[test]
    fn most_boxes_are_judged_for_certain() {
        let region = Region::sphere(DVec3::splat(9.0), 3.0);
        let test = Shapes::new(&region, Some(10.0)).unwrap();
        let at = |center: f64| test.cover(Bounds { min: DVec3::splat(center - 0.2), max: DVec3::splat(center + 0.2) });
        assert_eq!([at(9.5), at(0.2), at(5.0), at(0.6)], [Cover::Inside, Cover::Inside, Cover::Outside, Cover::Partly]);
        let test = Shapes::new(&Region::cuboid(DVec3::splat(8.0), DVec3::splat(12.0)), Some(10.0)).unwrap();
        let at = |center: f64| test.cover(Bounds { min: DVec3::splat(center - 0.2), max: DVec3::splat(center + 0.2) });
        assert_eq!([at(9.9), at(1.0), at(5.0), at(2.0)], [Cover::Inside, Cover::Inside, Cover::Outside, Cover::Partly]);
    }
}
