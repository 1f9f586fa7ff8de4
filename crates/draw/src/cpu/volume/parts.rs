//! What a marched volume shows along each ray in parts, from front to back: what something else is drawn among.

use super::raycast::Ray;
use crate::cpu::paths::PathFragment;

/// A part ends where opacity, as the eye sees it, has grown by so much: a ray has no more than 17 parts, and a light within one of them is off by no more than
/// that share of itself.
const PART: f32 = 1.0 / 16.0;

/// The parts of some rays.
#[derive(Clone, Debug)]
pub(in crate::cpu) struct Parts {
    /// What is known of the present part of each ray.
    begun: Vec<Begun>,
    /// Those that have ended, with their rays; each ray's from front to back.
    ended: Vec<(u32, PathFragment)>,
}

/// A part that has begun.
#[derive(Clone, Copy, Debug, Default)]
struct Begun {
    /// Light and opacity that its ray had gathered before it.
    color: [f32; 3],
    alpha: f32,
    /// Opacity gathered since, and the sum of its depths by their opacity.
    gathered: f32,
    depths: f32,
    /// The depth of the part before, which rounding must not put behind this one.
    before: f32,
}

impl Parts {
    /// Those of so many rays before anything is drawn.
    pub fn new(rays: usize) -> Parts {
        Parts { begun: vec![Begun::default(); rays], ended: Vec::new() }
    }

    /// Takes note of what a ray has gathered at a depth.
    #[inline]
    pub fn note(&mut self, index: usize, ray: &Ray, depth: f32) {
        let begun = &mut self.begun[index];
        let more = ray.alpha - (begun.alpha + begun.gathered);
        if more <= 0.0 {
            return;
        }
        begun.depths += more * depth;
        begun.gathered += more;
        if begun.gathered >= PART {
            self.end(index, ray);
        }
    }

    /// Ends a ray's part, if there is something of it.
    pub fn end(&mut self, index: usize, ray: &Ray) {
        let begun =
            std::mem::replace(&mut self.begun[index], Begun { color: ray.color, alpha: ray.alpha, ..Begun::default() });
        let added = ray.alpha - begun.alpha;
        let depth = if begun.gathered > 0.0 { (begun.depths / begun.gathered).max(begun.before) } else { begun.before };
        self.begun[index].before = depth;
        if added <= 0.0 || begun.gathered <= 0.0 {
            return;
        }
        let color = [0, 1, 2].map(|k| (ray.color[k] - begun.color[k]) / added);
        let alpha = (added / (1.0 - begun.alpha)).min(1.0);
        self.ended.push((index as u32, PathFragment { depth, color, alpha }));
    }

    /// Those that have ended, with their rays.
    pub fn ended(&self) -> &[(u32, PathFragment)] {
        &self.ended
    }
}
