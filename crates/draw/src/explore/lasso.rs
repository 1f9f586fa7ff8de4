//! A polygon that was drawn on a picture, and which particles are seen inside it.
//!
//! A point belongs to the lasso if the view projects it into the polygon: by the even-odd rule, so that a loop inside a loop is a
//! hole. Edges are sorted into horizontal strips once, so that a test looks at few of them however long the polygon is.

use super::error::ExploreError;
use super::shape::Cover;
use crate::model::Bounds;
use crate::view::{Projection, View};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Most corners of a polygon; a hand draws a few hundred.
pub const MOST_CORNERS: usize = 1 << 16;

/// A polygon on a picture of a view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lasso {
    /// Where the camera is, world units.
    pub eye: DVec3,
    /// What it looks at.
    pub target: DVec3,
    /// What points up in the picture.
    #[serde(default = "up")]
    pub up: DVec3,
    /// How it projects.
    pub projection: LassoProjection,
    /// Width and height of the picture, pixels.
    pub size: (u32, u32),
    /// The polygon's corners: pixels to the right of and below the picture's top left corner.
    pub polygon: Vec<(f64, f64)>,
    /// Least depth in front of the eye, world units; none: no limit but the eye of a perspective view.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub near: Option<f64>,
    /// Largest depth; none: no limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub far: Option<f64>,
}

/// How the view of a lasso projects.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum LassoProjection {
    /// A pinhole.
    Perspective {
        /// Vertical field of view, degrees.
        fov_deg: f64,
    },
    /// Parallel lines of sight.
    Orthographic {
        /// Height of the picture, world units.
        height: f64,
    },
}

fn up() -> DVec3 {
    DVec3::Y
}

impl Lasso {
    /// The lasso that a polygon is on a picture of `view`.
    pub fn on(view: &View, polygon: Vec<(f64, f64)>) -> Lasso {
        Lasso {
            eye: view.eye,
            // As far away as the numbers are large, so that the direction keeps its digits.
            target: view.eye + view.forward * view.eye.abs().max_element().max(1.0),
            up: view.up,
            projection: match view.projection {
                Projection::Perspective { fov_y } => LassoProjection::Perspective { fov_deg: fov_y.to_degrees() },
                Projection::Orthographic { height } => LassoProjection::Orthographic { height },
            },
            size: (view.width, view.height),
            polygon,
            near: None,
            far: None,
        }
    }

    /// The view that the polygon was drawn on.
    ///
    /// # Errors
    /// [`ExploreError::Value`] for a camera that sees nothing.
    pub fn view(&self) -> Result<View, ExploreError> {
        let projection = match self.projection {
            LassoProjection::Perspective { fov_deg } => Projection::Perspective { fov_y: fov_deg.to_radians() },
            LassoProjection::Orthographic { height } => Projection::Orthographic { height },
        };
        View::look_at(self.eye, self.target, self.up, projection, self.size.0, self.size.1)
            .map_err(|error| ExploreError::value("lasso", error, "a camera that sees something"))
    }

    pub(super) fn check(&self, place: &str) -> Result<(), ExploreError> {
        self.view().map_err(|error| match error {
            ExploreError::Value { found, expected, .. } => ExploreError::Value { field: place.into(), found, expected },
            other => other,
        })?;
        let here = |name: &str| format!("{place}.{name}");
        let corners = self.polygon.len();
        if !(3..=MOST_CORNERS).contains(&corners) {
            let found = format!("{corners} corners");
            return Err(ExploreError::value(here("polygon"), found, format!("3 to {MOST_CORNERS} corners")));
        }
        if let Some((x, y)) = self.polygon.iter().find(|(x, y)| !(x.is_finite() && y.is_finite())) {
            return Err(ExploreError::value(here("polygon"), format!("({x}, {y})"), "finite pixels"));
        }
        for (name, depth) in [("near", self.near), ("far", self.far)] {
            if let Some(depth) = depth.filter(|depth| !depth.is_finite()) {
                return Err(ExploreError::value(here(name), depth, "a depth, or nothing for no limit"));
            }
        }
        match (self.near, self.far) {
            (Some(near), Some(far)) if near > far => {
                Err(ExploreError::value(here("near"), near, format!("at most far, which is {far}")))
            }
            _ => Ok(()),
        }
    }
}

/// A lasso that is ready for tests of many points.
#[derive(Clone, Debug)]
pub(super) struct LassoTest {
    view: View,
    polygon: Polygon,
    near: f64,
    far: f64,
}

impl LassoTest {
    pub(super) fn new(lasso: &Lasso) -> Result<LassoTest, ExploreError> {
        Ok(LassoTest {
            view: lasso.view()?,
            polygon: Polygon::new(&lasso.polygon),
            near: lasso.near.unwrap_or(f64::NEG_INFINITY),
            far: lasso.far.unwrap_or(f64::INFINITY),
        })
    }

    pub(super) fn contains(&self, point: DVec3) -> bool {
        let camera = self.view.to_camera(point);
        (self.near..=self.far).contains(&camera.z)
            && self.view.to_pixels(camera).is_some_and(|pixel| self.polygon.contains(pixel))
    }

    /// Whether a point within `reach` (a distance along each axis) of `point` may be on the other side of the surface.
    pub(super) fn is_near_surface(&self, point: DVec3, reach: f64) -> bool {
        // The point moves by at most this in any direction of the camera.
        let reach = 3f64.sqrt() * reach;
        let camera = self.view.to_camera(point);
        let (near, far) = (camera.z - reach, camera.z + reach);
        if far < self.near || near > self.far {
            return false;
        }
        let is_cut = near < self.near || far > self.far;
        let pixels = match self.view.projection {
            Projection::Orthographic { .. } => reach * self.view.focal_pixels(),
            Projection::Perspective { .. } if far <= 0.0 => return false,
            Projection::Perspective { .. } if near <= 0.0 => return true,
            Projection::Perspective { .. } => {
                // Sideways, and along the line of sight, which moves what is off the axis sideways too.
                reach * self.view.focal_pixels() / near * (1.0 + camera.x.abs().max(camera.y.abs()) / camera.z)
            }
        };
        let Some(at) = self.view.to_pixels(camera) else { return true };
        match self.polygon.cover(at.map(|x| x - pixels), at.map(|x| x + pixels)) {
            Cover::Outside => false,
            Cover::Inside => is_cut,
            Cover::Partly => true,
        }
    }

    /// How much of a box is inside; `Partly` where that is not certain.
    pub(super) fn cover(&self, bounds: Bounds) -> Cover {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let mut behind = 0;
        for corner in 0..8 {
            let pick = |axis: usize| if corner >> axis & 1 == 1 { bounds.max[axis] } else { bounds.min[axis] };
            let camera = self.view.to_camera(DVec3::new(pick(0), pick(1), pick(2)));
            (low.z, high.z) = (low.z.min(camera.z), high.z.max(camera.z));
            match self.view.to_pixels(camera) {
                Some([x, y]) => {
                    let pixel = DVec3::new(x, y, camera.z);
                    (low, high) = (low.min(pixel), high.max(pixel));
                }
                None => behind += 1,
            }
        }
        if behind == 8 || high.z < self.near || low.z > self.far {
            return Cover::Outside;
        }
        if behind > 0 {
            return Cover::Partly;
        }
        // The projected box lies in the rectangle around its projected corners.
        match self.polygon.cover([low.x, low.y], [high.x, high.y]) {
            Cover::Inside if low.z < self.near || high.z > self.far => Cover::Partly,
            cover => cover,
        }
    }
}

/// A polygon by the even-odd rule.
#[derive(Clone, Debug)]
struct Polygon {
    /// Both ends of each edge, the upper one (of smaller y) first.
    edges: Vec<[f64; 4]>,
    low: [f64; 2],
    high: [f64; 2],
    /// Numbers of the edges that reach into each strip of equal height, one strip after the other.
    strips: Vec<u32>,
    /// Where the edges of each strip begin in `strips`, and their end.
    starts: Vec<usize>,
    /// Strips per pixel.
    density: f64,
}

/// Most strips: more than a picture has rows would not help.
const MOST_STRIPS: usize = 1024;

impl Polygon {
    fn new(corners: &[(f64, f64)]) -> Polygon {
        let next = corners.iter().cycle().skip(1);
        let edges: Vec<[f64; 4]> = corners
            .iter()
            .zip(next)
            .map(|(a, b)| if a.1 <= b.1 { [a.0, a.1, b.0, b.1] } else { [b.0, b.1, a.0, a.1] })
            .collect();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for &(x, y) in corners {
            low = [low[0].min(x), low[1].min(y)];
            high = [high[0].max(x), high[1].max(y)];
        }
        let count = edges.len().clamp(1, MOST_STRIPS);
        let height = high[1] - low[1];
        let density = if height > 0.0 { count as f64 / height } else { 0.0 };
        let mut polygon = Polygon { edges, low, high, strips: Vec::new(), starts: vec![0; count + 1], density };
        // Counted, then filled: an edge is in each strip that it reaches into.
        let spans: Vec<(usize, usize)> =
            polygon.edges.iter().map(|edge| (polygon.strip(edge[1]), polygon.strip(edge[3]))).collect();
        for &(first, last) in &spans {
            (first..=last).for_each(|strip| polygon.starts[strip + 1] += 1);
        }
        for strip in 0..count {
            polygon.starts[strip + 1] += polygon.starts[strip];
        }
        polygon.strips = vec![0; polygon.starts[count]];
        let mut at = polygon.starts.clone();
        for (edge, &(first, last)) in spans.iter().enumerate() {
            for at in &mut at[first..=last] {
                polygon.strips[*at] = edge as u32;
                *at += 1;
            }
        }
        polygon
    }

    /// The strip of a row; rows above and below belong to the first and the last.
    fn strip(&self, y: f64) -> usize {
        // The cast saturates.
        (((y - self.low[1]) * self.density) as usize).min(self.starts.len() - 2)
    }

    fn edges_of(&self, strip: usize) -> impl Iterator<Item = &[f64; 4]> {
        self.strips[self.starts[strip]..self.starts[strip + 1]].iter().map(|&edge| &self.edges[edge as usize])
    }

    fn contains(&self, [x, y]: [f64; 2]) -> bool {
        if !(self.low[0]..=self.high[0]).contains(&x) || !(self.low[1]..=self.high[1]).contains(&y) {
            return false;
        }
        // Each edge that crosses the row to the left of the point turns inside into outside.
        let crosses = |&&[x0, y0, x1, y1]: &&[f64; 4]| y0 <= y && y < y1 && x0 + (y - y0) / (y1 - y0) * (x1 - x0) <= x;
        self.edges_of(self.strip(y)).filter(crosses).count() % 2 == 1
    }

    /// How much of a rectangle is inside.
    fn cover(&self, low: [f64; 2], high: [f64; 2]) -> Cover {
        if (0..2).any(|k| high[k] < self.low[k] || low[k] > self.high[k]) {
            return Cover::Outside;
        }
        let mut strips = self.strip(low[1])..=self.strip(high[1]);
        if strips.any(|strip| self.edges_of(strip).any(|edge| meets(edge, low, high))) {
            return Cover::Partly;
        }
        if self.contains([0, 1].map(|k| 0.5 * (low[k] + high[k]))) { Cover::Inside } else { Cover::Outside }
    }
}

/// Whether an edge reaches into a rectangle; edges that just miss it may count.
fn meets(&[x0, y0, x1, y1]: &[f64; 4], low: [f64; 2], high: [f64; 2]) -> bool {
    if y1 < low[1] || y0 > high[1] || x0.max(x1) < low[0] || x0.min(x1) > high[0] {
        return false;
    }
    // On which side of the edge's line the corners are; a hair's breadth counts as on it.
    let side = |x: f64, y: f64| (x - x0) * (y1 - y0) - (y - y0) * (x1 - x0);
    let scale =
        (x1 - x0).abs().max(y1 - y0) * [low[0], low[1], high[0], high[1]].iter().fold(1.0, |m: f64, v| m.max(v.abs()));
    let hair = scale * 1e-12;
    let sides = [side(low[0], low[1]), side(high[0], low[1]), side(low[0], high[1]), side(high[0], high[1])];
    !(sides.iter().all(|&s| s > hair) || sides.iter().all(|&s| s < -hair))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The even-odd rule over all edges, by winding of signed crossings written another way round: a ray to the right.
    fn brute(corners: &[(f64, f64)], [x, y]: [f64; 2]) -> bool {
        let mut inside = false;
        let mut j = corners.len() - 1;
        for i in 0..corners.len() {
            let ((xi, yi), (xj, yj)) = (corners[i], corners[j]);
            if (yi > y) != (yj > y) && x < (xj - xi) * (y - yi) / (yj - yi) + xi {
                inside = !inside;
            }
            j = i;
        }
        inside
    }

    fn corners() -> impl Strategy<Value = Vec<(f64, f64)>> {
        prop::collection::vec((-50.0..450.0_f64, -50.0..350.0_f64), 3..60)
    }

    proptest! {
        #[test]
        fn strips_agree_with_a_look_at_every_edge(
            corners in corners(),
            points in prop::collection::vec((-60.0..460.0_f64, -60.0..360.0_f64), 50),
        ) {
            let polygon = Polygon::new(&corners);
            for (x, y) in points {
                prop_assert_eq!(polygon.contains([x, y]), brute(&corners, [x, y]), "{} {}", x, y);
            }
        }

        /// What is covered, or not touched, holds for every point of the rectangle.
        #[test]
        fn rectangles_are_judged_safely(
            corners in corners(),
            center in (-60.0..460.0_f64, -60.0..360.0_f64),
            half in (0.1..60.0_f64, 0.1..60.0_f64),
            points in prop::collection::vec((0.0..1.0_f64, 0.0..1.0_f64), 30),
        ) {
            let polygon = Polygon::new(&corners);
            let (low, high) = ([center.0 - half.0, center.1 - half.1], [center.0 + half.0, center.1 + half.1]);
            let cover = polygon.cover(low, high);
            for (u, v) in points {
                let inside = polygon.contains([low[0] + u * (high[0] - low[0]), low[1] + v * (high[1] - low[1])]);
                prop_assert!(cover == Cover::Partly || inside == (cover == Cover::Inside));
            }
        }

        /// Boxes in space too, with perspective, also around the eye.
        #[test]
        fn boxes_are_judged_safely(
            corners in corners(),
            perspective: bool,
            near in prop_oneof![Just(None), (0.0..4.0_f64).prop_map(Some)],
            center in prop::array::uniform3(-6.0..6.0_f64),
            half in prop::array::uniform3(0.01..2.0_f64),
            points in prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 30),
        ) {
            let lasso = Lasso {
                eye: DVec3::new(1.0, 2.0, 5.0),
                target: DVec3::ZERO,
                up: DVec3::Y,
                projection: match perspective {
                    true => LassoProjection::Perspective { fov_deg: 50.0 },
                    false => LassoProjection::Orthographic { height: 8.0 },
                },
                size: (400, 300),
                polygon: corners.clone(),
                near,
                far: near.map(|near| near + 3.0),
            };
            lasso.check("l").unwrap();
            let test = LassoTest::new(&lasso).unwrap();
            let view = lasso.view().unwrap();
            let (center, half) = (DVec3::from_array(center), DVec3::from_array(half));
            let cover = test.cover(Bounds { min: center - half, max: center + half });
            let near_surface = test.is_near_surface(center, half.max_element());
            for at in points {
                let point = center + half * DVec3::from_array(at);
                // Projected by hand.
                let depth = (point - view.eye).dot(view.forward);
                let scale = match perspective {
                    true => 150.0 / 25f64.to_radians().tan() / depth,
                    false => 300.0 / 8.0,
                };
                let pixel = [
                    200.0 + (point - view.eye).dot(view.right) * scale,
                    150.0 - (point - view.eye).dot(view.up) * scale,
                ];
                let within = near.is_none_or(|near| depth >= near && depth <= near + 3.0);
                let inside = (!perspective || depth > 0.0) && within && brute(&corners, pixel);
                prop_assert_eq!(test.contains(point), inside);
                prop_assert!(near_surface || inside == test.contains(center));
                prop_assert!(cover == Cover::Partly || inside == (cover == Cover::Inside), "{:?}", cover);
            }
        }
    }

    #[test]
    fn a_lasso_on_a_view_sees_what_the_view_sees() {
        let projection = Projection::Perspective { fov_y: 0.7 };
        let eye = DVec3::new(3e4, -2.0, 1e3);
        let view = View::look_at(eye, eye - DVec3::new(1.0, 2.0, 3.0), DVec3::Z, projection, 800, 600).unwrap();
        let again = Lasso::on(&view, vec![(0.0, 0.0), (800.0, 0.0), (0.0, 600.0)]).view().unwrap();
        assert!((again.forward - view.forward).length() < 1e-14 && (again.up - view.up).length() < 1e-12);
        assert_eq!((again.eye, again.width), (view.eye, view.width));
    }

    #[test]
    fn lassos_that_make_no_sense_are_named() {
        let projection = Projection::Orthographic { height: 1.0 };
        let view = View::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y, projection, 10, 10).unwrap();
        let good = Lasso::on(&view, vec![(0.0, 0.0), (9.0, 0.0), (0.0, 9.0)]);
        good.check("s").unwrap();
        for (wrong, field) in [
            (Lasso { polygon: vec![(0.0, 0.0); 2], ..good.clone() }, "s.polygon"),
            (Lasso { polygon: vec![(f64::NAN, 0.0); 3], ..good.clone() }, "s.polygon"),
            (Lasso { near: Some(2.0), far: Some(1.0), ..good.clone() }, "s.near"),
            (Lasso { target: good.eye, ..good.clone() }, "s is"),
            (Lasso { size: (0, 10), ..good.clone() }, "s is"),
        ] {
            let message = wrong.check("s").unwrap_err().to_string();
            assert!(message.starts_with(field), "{message}");
        }
    }
}
