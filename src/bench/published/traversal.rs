//! HE03's traversal (figure 5): which clusters draw the points `delta_n` levels below them.

use super::relative::{Node, Relative};
use crate::view::{Projection, View};
use glam::DVec3;
use rayon::prelude::*;

/// Clusters of the coarsest level that one task begins with.
const CHUNK: usize = 32;

/// How deep a traversal goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Depth {
    /// A cluster is descended into if one of the points that it would draw is wider than this, pixels.
    pub threshold: f64,
    /// The finest level that is drawn.
    pub level: usize,
}

/// What a traversal comes to.
pub trait Sink: Send {
    /// A cluster draws its points.
    fn draw(&mut self, level: usize, index: usize);

    /// A cluster is outside of the picture.
    fn cull(&mut self, _level: usize, _index: usize) {}
}

/// Goes down from everything; each sink has a part, in the order of the clusters.
pub fn traverse<S: Sink>(structure: &Relative, view: &View, depth: Depth, sink: impl Fn() -> S + Sync) -> Vec<S> {
    let eye = Eye::new(view, structure.origin());
    let walk = Walk { structure, eye: &eye, depth };
    let mut first = sink();
    // Below the clusters of the coarsest level there is enough for all threads.
    if !walk.descends(0, 0) {
        first.draw(0, 0);
        return vec![first];
    }
    let children: Vec<usize> = structure.children(0, 0).collect();
    let parts = children.par_chunks(CHUNK).map(|children| {
        let mut sink = sink();
        children.iter().for_each(|&child| walk.visit(1, child, true, &mut sink));
        sink
    });
    parts.collect()
}

struct Walk<'a> {
    structure: &'a Relative,
    eye: &'a Eye,
    depth: Depth,
}

impl Walk<'_> {
    /// Draws a cluster or what it has; `cut` says whether a part of it may be outside of the picture.
    fn visit(&self, level: usize, index: usize, cut: bool, sink: &mut impl Sink) {
        let seen = if cut { self.eye.sees(self.structure.node(level, index)) } else { Seen::Whole };
        if seen == Seen::Nothing {
            return sink.cull(level, index);
        }
        if !self.descends(level, index) {
            return sink.draw(level, index);
        }
        for child in self.structure.children(level, index) {
            self.visit(level + 1, child, seen == Seen::Part, sink);
        }
    }

    fn descends(&self, level: usize, index: usize) -> bool {
        let below = level + self.structure.delta();
        below < self.depth.level.min(self.structure.finest())
            && self.eye.pixels(self.structure.node(level, index)) > self.depth.threshold
    }
}

/// How much of a cluster is in the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Seen {
    Nothing,
    Part,
    Whole,
}

/// A view in the coordinates of a structure.
struct Eye {
    /// Unit normals of the picture's sides and of the eye plane, which point inwards, and how far the origin is inside.
    sides: [(DVec3, f64); 5],
    /// Pixels for a length, at depth 1 in perspective.
    focal: f64,
    perspective: bool,
}

impl Eye {
    fn new(view: &View, origin: DVec3) -> Eye {
        let [[left, right], [bottom, top]] = view.edges();
        let perspective = matches!(view.projection, Projection::Perspective { .. });
        let camera = view.to_camera(origin);
        // A side in camera space, of all points whose `normal` is above `-offset`.
        let side = |normal: DVec3, edge: f64| {
            let (normal, offset) = match perspective {
                true => ((normal + edge * DVec3::Z).normalize(), 0.0),
                false => (normal, edge),
            };
            let inward = normal.x * view.right + normal.y * view.up + normal.z * view.forward;
            (inward, normal.dot(camera) + offset)
        };
        let sides = [
            (view.forward, camera.z),
            side(DVec3::X, -left),
            side(DVec3::NEG_X, right),
            side(DVec3::Y, -bottom),
            side(DVec3::NEG_Y, top),
        ];
        Eye { sides, focal: view.focal_pixels(), perspective }
    }

    fn sees(&self, node: &Node) -> Seen {
        let (centre, reach) = (centre(node), f64::from(node.reach));
        let inside =
            self.sides.iter().map(|(normal, offset)| normal.dot(centre) + offset).fold(f64::INFINITY, f64::min);
        match inside {
            inside if inside < -reach => Seen::Nothing,
            inside if inside < reach => Seen::Part,
            _ => Seen::Whole,
        }
    }

    /// How wide the largest of a cluster's points is where its centroid is.
    fn pixels(&self, node: &Node) -> f64 {
        let width = f64::from(node.diameter) * self.focal;
        let (forward, depth) = self.sides[0];
        match self.perspective {
            // What is beside the eye or behind it is as large as anything.
            true => width / (forward.dot(centre(node)) + depth).max(f64::MIN_POSITIVE),
            false => width,
        }
    }
}

fn centre(node: &Node) -> DVec3 {
    DVec3::from_array(node.centre.map(f64::from))
}
