//! Sums of nodes, a portion after the other: what is decoded at a time does not grow with the picture.

use super::decode::batches;
use super::subject::Subject;
use crate::cpu::Summation;
use crate::cpu::around::FaceSums;
use crate::cpu::volume::VolumeError;
use crate::mode::{Plan, Raw};
use crate::stream::SceneNode;
use crate::view::View;
use std::time::{Duration, Instant};

/// Particles that are decoded at a time, but for a single node that has more.
pub(super) const PORTION: u64 = 1 << 20;
/// The same for volumes, which take more memory for a particle: it is paired with all bricks that it reaches.
pub(super) const SUPPLIED: u64 = 1 << 17;

/// A picture of sums that nodes are added to: it has the same bits whichever are added together, as long as their order is the same.
pub struct Summing<'a> {
    subject: Subject<'a>,
    view: View,
    plan: Plan,
    sums: Sums,
    taken: u64,
    took: [Duration; 2],
}

/// What is drawn into.
pub(super) enum Sums {
    /// A flat picture.
    Flat(Summation),
    /// A face of a panorama.
    Face(Box<FaceSums>),
}

impl From<Summation> for Sums {
    fn from(sums: Summation) -> Sums {
        Sums::Flat(sums)
    }
}

impl From<FaceSums> for Sums {
    fn from(sums: FaceSums) -> Sums {
        Sums::Face(Box::new(sums))
    }
}

impl<'a> Summing<'a> {
    pub(super) fn new(subject: Subject<'a>, view: &View, plan: Plan, sums: Sums) -> Summing<'a> {
        Summing { subject, view: *view, plan, sums, taken: 0, took: [Duration::ZERO; 2] }
    }

    /// Adds nodes, one after the other.
    ///
    /// # Errors
    /// As [`Subject::draw`].
    pub fn add(&mut self, nodes: &[SceneNode]) -> Result<(), VolumeError> {
        for portion in portions(nodes, PORTION) {
            let start = Instant::now();
            let decoded = self.subject.decode(&self.view, portion, &self.plan);
            let batches = batches(self.subject.depiction, &decoded)?;
            let is_decoded = Instant::now();
            match &mut self.sums {
                Sums::Flat(sums) => sums.add(&batches),
                Sums::Face(sums) => sums.add(&batches)?,
            }
            self.taken += decoded.iter().map(|node| node.len() as u64).sum::<u64>();
            self.took[0] += is_decoded - start;
            self.took[1] += is_decoded.elapsed();
        }
        Ok(())
    }

    /// How many particles were decoded.
    pub fn taken(&self) -> u64 {
        self.taken
    }

    /// How long decoding took so far, and drawing.
    pub fn took(&self) -> [Duration; 2] {
        self.took
    }

    /// The picture.
    pub fn finish(self) -> Raw {
        let (sums, counts) = match self.sums {
            Sums::Flat(sums) => sums.finish(),
            Sums::Face(sums) => sums.finish(),
        };
        Raw::Sums(sums, counts)
    }
}

/// Nodes in portions of about so many particles.
pub(super) fn portions(nodes: &[SceneNode], most: u64) -> impl Iterator<Item = &[SceneNode]> {
    let mut rest = nodes;
    std::iter::from_fn(move || {
        let mut particles = 0;
        let fits = rest.iter().take_while(|drawn| {
            let node = drawn.page.nodes.get(drawn.node.node as usize);
            particles += u64::from(drawn.part.or(node.map(|node| node.particles)).unwrap_or(0));
            particles <= most
        });
        let (portion, others) = rest.split_at_checked(fits.count().max(1))?;
        rest = others;
        Some(portion)
    })
}
