//! What the left button does over the picture: move the camera, measure, or draw a region.

use crate::explore::{Lasso, Region};
use crate::view::View;
use bevy::math::DVec3;
use bevy::prelude::*;

/// What the left button does. Whatever it is, the right one and the wheel move the camera.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tool {
    /// A click says what is under the cursor, a drag turns the camera.
    #[default]
    Inspect,
    /// Two clicks measure the distance between what is under them.
    Measure,
    /// A drag from its centre draws a sphere.
    Sphere,
    /// A drag from its centre draws an axis-aligned cube.
    Cube,
    /// A drag draws around what is meant.
    Lasso,
    /// A drag draws a line over heights.
    Profile,
}

impl Tool {
    /// The tools of particles, images and volumes, in the order of their buttons.
    pub const OF_PARTICLES: [Tool; 5] = [Tool::Inspect, Tool::Measure, Tool::Sphere, Tool::Cube, Tool::Lasso];
    /// Those of heights.
    pub const OF_HEIGHTS: [Tool; 5] = [Tool::Inspect, Tool::Measure, Tool::Profile, Tool::Sphere, Tool::Cube];

    /// What its button says.
    pub const fn title(self) -> &'static str {
        match self {
            Tool::Inspect => "Inspect",
            Tool::Measure => "Measure",
            Tool::Sphere => "Sphere",
            Tool::Cube => "Box",
            Tool::Lasso => "Lasso",
            Tool::Profile => "Profile",
        }
    }

    /// What it does, a sentence.
    pub const fn help(self) -> &'static str {
        match self {
            Tool::Inspect => "Click a particle to read all its values (I).",
            Tool::Measure => "Click two particles to measure their distance (M).",
            Tool::Sphere => {
                "Drag from the centre of a sphere to its surface (R); what is inside is summed over the whole data."
            }
            Tool::Cube => "Drag from the centre of a box to its face (B).",
            Tool::Lasso => "Draw around what is meant (L); everything behind the line belongs to it.",
            Tool::Profile => "Drag from one end of a line to the other (G): the heights along it are plotted.",
        }
    }

    /// What it does with heights.
    pub const fn help_on_heights(self) -> &'static str {
        match self {
            Tool::Inspect => "Click the surface to read the samples there (I).",
            Tool::Measure => "Click two places to measure how far they are apart, in space and in plan (M).",
            Tool::Sphere => {
                "Drag from the middle of a disc to its edge (R): its roughness is found from all samples in it."
            }
            Tool::Cube => {
                "Drag from one corner of a rectangle to the other (B): its roughness is found from all samples in it."
            }
            Tool::Lasso | Tool::Profile => self.help(),
        }
    }

    /// What its button says where heights are shown.
    pub const fn title_on_heights(self) -> &'static str {
        match self {
            Tool::Sphere => "Disc",
            other => other.title(),
        }
    }

    /// Whether drags of the left button belong to it rather than to the camera.
    pub const fn takes_drags(self) -> bool {
        matches!(self, Tool::Sphere | Tool::Cube | Tool::Lasso | Tool::Profile)
    }
}

/// What is being drawn.
#[derive(Resource, Clone, Debug, Default, PartialEq)]
pub struct Stroke {
    /// Where it began: the place in the world, and the view that it is drawn on.
    pub origin: Option<(DVec3, View)>,
    /// Where the pointer was since, picture pixels.
    pub points: Vec<[f64; 2]>,
}

/// Pixels that the pointer moves at least between two points of a stroke.
const STEP_PX: f64 = 2.0;
/// Pixels that a region is large at least; less is a slip of the hand.
const LEAST_PX: f64 = 4.0;
/// Most points of a stroke.
const MOST_POINTS: usize = 8192;

impl Stroke {
    /// Begins one at a place in the world that is under the pointer.
    pub fn begin(&mut self, place: DVec3, view: View, at: [f64; 2]) {
        *self = Stroke { origin: Some((place, view)), points: vec![at] };
    }

    /// Goes on to where the pointer is.
    pub fn extend(&mut self, at: [f64; 2]) {
        let far = self.points.last().is_none_or(|last| distance(*last, at) >= STEP_PX);
        if self.origin.is_some() && far && self.points.len() < MOST_POINTS {
            self.points.push(at);
        }
    }

    /// The region that the stroke means so far; `None` where it is too small to mean one.
    pub fn region(&self, tool: Tool) -> Option<Region> {
        let (center, view) = self.origin?;
        let (first, last) = (*self.points.first()?, *self.points.last()?);
        let depth = view.to_camera(center).z;
        let reach = |at: [f64; 2]| view.at_depth(at, depth).distance(center);
        match tool {
            Tool::Sphere | Tool::Cube if distance(first, last) < LEAST_PX => None,
            Tool::Sphere => Some(Region::sphere(center, reach(last))),
            Tool::Cube => Some(Region::cuboid(center - reach(last), center + reach(last))),
            Tool::Lasso => {
                let spread = self.points.iter().map(|point| distance(first, *point)).fold(0.0, f64::max);
                let polygon = self.points.iter().map(|&[x, y]| (x, y)).collect();
                (self.points.len() >= 3 && spread >= LEAST_PX).then(|| Region::lasso(Lasso::on(&view, polygon)))
            }
            Tool::Inspect | Tool::Measure | Tool::Profile => None,
        }
    }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::explore::{Shape, Shapes};
    use crate::view::Projection;

    fn view() -> View {
        let projection = Projection::Perspective { fov_y: 0.7 };
        View::look_at(DVec3::new(40.0, 30.0, 90.0), DVec3::splat(25.0), DVec3::Y, projection, 800, 600).unwrap()
    }

    #[test]
    fn a_sphere_reaches_to_where_the_pointer_is() {
        let (view, center) = (view(), DVec3::new(24.0, 27.0, 22.0));
        let start = view.to_pixels(view.to_camera(center)).unwrap();
        let mut stroke = Stroke::default();
        stroke.begin(center, view, start);
        assert_eq!(stroke.region(Tool::Sphere), None, "a click is no sphere");
        stroke.extend([start[0] + 60.0, start[1] - 25.0]);
        let region = stroke.region(Tool::Sphere).unwrap();
        let (found, radius) = region.first_sphere().unwrap();
        assert_eq!(found, center);
        let expected = 65.0 * view.to_camera(center).z / view.focal_pixels();
        assert!((radius / expected - 1.0).abs() < 1e-9, "{radius} {expected}");
    }

    #[test]
    fn a_lasso_holds_what_is_seen_inside_it() {
        let view = view();
        let mut stroke = Stroke::default();
        let corners = [[300.0, 200.0], [500.0, 200.0], [500.0, 400.0], [300.0, 400.0]];
        stroke.begin(DVec3::splat(25.0), view, corners[0]);
        corners[1..].iter().for_each(|&corner| stroke.extend(corner));
        let region = stroke.region(Tool::Lasso).unwrap();
        assert!(matches!(region.shapes[..], [Shape::Lasso(_)]));
        let shapes = Shapes::new(&region, None).unwrap();
        for (pixel, inside) in
            [([400.0, 300.0], true), ([301.0, 399.0], true), ([299.0, 300.0], false), ([510.0, 300.0], false)]
        {
            for depth in [3.0, 70.0, 400.0] {
                assert_eq!(shapes.contains(view.at_depth(pixel, depth)), inside, "{pixel:?} at {depth}");
            }
        }
    }

    #[test]
    fn strokes_are_bounded() {
        let mut stroke = Stroke::default();
        stroke.begin(DVec3::ZERO, view(), [0.0, 0.0]);
        (0..50_000).for_each(|i| stroke.extend([f64::from(i % 500) * 3.0, f64::from(i / 500) * 3.0]));
        assert_eq!(stroke.points.len(), MOST_POINTS);
    }
}
