//! The particles of a node, however the node holds them.

use super::content::Particles;
use super::metadata::FamilyMetadata;
use super::page::{Frame, NodeParticles, Page};
use crate::codec::Codebook;
use glam::DVec3;
use std::borrow::Cow;

/// The particles of a node at a time. Their values are entries of a table: a codebook of the family, or one of their own.
#[derive(Clone, Debug)]
pub struct Block<'a> {
    frame: Frame,
    coded: NodeParticles<'a>,
    own: Option<Cow<'a, Particles>>,
    codebook: Option<&'a Codebook>,
}

impl Page {
    /// The particles of node `node` of this page of `family` at a time; `None` if there is no such node.
    pub fn block<'a>(&'a self, node: usize, family: &'a FamilyMetadata, time: f64) -> Option<Block<'a>> {
        let record = self.nodes.get(node)?;
        let own = self.content(node).map(|content| content.particles(time));
        let codebook = family.codebooks.get(usize::from(record.codebook)).filter(|_| own.is_none());
        Some(Block { frame: record.frame, coded: self.particles(node), own, codebook })
    }
}

impl Block<'_> {
    /// Number of particles.
    pub fn len(&self) -> usize {
        self.own.as_ref().map_or(self.coded.len(), |own| own.len())
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// World position of particle `i`. Panics if there is none.
    pub fn position(&self, i: usize) -> DVec3 {
        match &self.own {
            Some(own) => DVec3::from_array(own.positions[i]),
            None => self.frame.position(self.coded.fraction(i)),
        }
    }

    /// How far at most each coordinate of particle `i` of a leaf is from its source's, world units (up to rounding of doubles).
    pub fn rounding(&self, i: usize) -> f64 {
        if self.own.is_some() { 0.0 } else { self.coded.rounding(i) * self.frame.size }
    }

    /// The table of the particles' values; `None` where the family lacks the codebook that the node names.
    pub fn table(&self) -> Option<&Codebook> {
        self.own.as_ref().map(|own| &own.values).or(self.codebook)
    }

    /// Entry of particle `i` in the table; `None` if there is no such particle.
    pub fn entry(&self, i: usize) -> Option<usize> {
        match &self.own {
            Some(own) => (i < own.len()).then_some(i),
            None => self.coded.codes.get(i).map(|&code| usize::from(code)),
        }
    }
}
