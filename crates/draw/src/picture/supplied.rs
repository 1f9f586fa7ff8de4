//! The particles of a listed view as a volume asks for them, part of its grid by part: their pages do not fit into memory together.

use super::PictureError;
use super::decode::{DecodedNode, batches};
use super::session::Reporter;
use super::subject::Subject;
use super::summing::{SUPPLIED, portions};
use crate::cpu::volume::{Supply, VolumeError, extents};
use crate::cpu::{self, Splats};
use crate::mode::Plan;
use crate::store::NodeRef;
use crate::stream::{Listing, Scene, SceneNode, Visited};
use crate::view::{Drawn, Extent, View};

/// What a listed view draws, and what reads it.
pub(super) struct Supplied<'a> {
    subject: Subject<'a>,
    view: View,
    scene: &'a mut Scene,
    reporter: &'a dyn Reporter,
    /// The nodes that have particles, those of ellipsoids last.
    listing: Listing,
    /// What each of them reaches.
    extents: Vec<Extent>,
    particles: u64,
    slab_bytes: u64,
    visited: Visited,
    /// Why the rest is left out.
    failure: Option<Failure>,
}

/// Why not all particles were supplied.
enum Failure {
    Stopped,
    Drawing(VolumeError),
}

impl From<Failure> for PictureError {
    fn from(failure: Failure) -> PictureError {
        match failure {
            Failure::Stopped => PictureError::Stopped,
            Failure::Drawing(error) => error.into(),
        }
    }
}

/// What is known of a node before its particles are drawn.
struct Known {
    drawn: Drawn<NodeRef>,
    extent: Extent,
    particles: u64,
    is_stretched: bool,
}

impl<'a> Supplied<'a> {
    /// What `listing` lists of a view; a slab's cells may take `slab_bytes`. Nodes that do not say what they reach are looked at once.
    ///
    /// # Errors
    /// As [`Supplied::finish`].
    pub fn new(
        subject: Subject<'a>,
        view: &View,
        (scene, reporter): (&'a mut Scene, &'a dyn Reporter),
        listing: &Listing,
        slab_bytes: u64,
    ) -> Result<Supplied<'a>, PictureError> {
        let tell = |drawn: &Drawn<NodeRef>| {
            // What is cut off is known when it has been.
            let extent = scene.extent_of(drawn).filter(|_| view.cut.is_none())?;
            Some(Known { drawn: *drawn, extent, particles: drawn.particles, is_stretched: false })
        };
        let mut known: Vec<Option<Known>> = listing.nodes.iter().map(tell).collect();
        let unknown: Vec<usize> = (0..known.len()).filter(|index| known[*index].is_none()).collect();
        let mut supplied = Supplied {
            subject,
            view: *view,
            scene,
            reporter,
            listing: listing.of_nodes(unknown.iter().map(|index| listing.nodes[*index]).collect()),
            extents: Vec::new(),
            particles: 0,
            slab_bytes,
            visited: Visited { is_complete: true, error_pixels: 0.0 },
            failure: None,
        };
        // Those whose pages cannot be had are left out here, too.
        let mut unknown = unknown.into_iter();
        let looked_at = supplied.listing.clone();
        supplied.visit(&looked_at, &mut |nodes: &[SceneNode], batches: &[Splats<'_>]| {
            for (node, batch) in nodes.iter().zip(batches) {
                let is_it = |drawn: &Drawn<NodeRef>| drawn.id == node.node && drawn.offset == node.offset;
                let Some(index) = unknown.by_ref().find(|index| is_it(&listing.nodes[*index])) else { return };
                known[index] = extents::of(&[*batch]).first().map(|extent| Known {
                    drawn: listing.nodes[index],
                    extent: *extent,
                    particles: batch.len() as u64,
                    is_stretched: matches!(batch.extent(), cpu::Extent::Ellipsoids(_)),
                });
            }
        });
        if let Some(failure) = supplied.failure.take() {
            return Err(failure.into());
        }
        let (round, stretched): (Vec<Known>, Vec<Known>) =
            known.into_iter().flatten().partition(|known| !known.is_stretched);
        let ordered: Vec<Known> = round.into_iter().chain(stretched).collect();
        supplied.particles = ordered.iter().map(|known| known.particles).sum();
        supplied.extents = ordered.iter().map(|known| known.extent).collect();
        supplied.listing = listing.of_nodes(ordered.into_iter().map(|known| known.drawn).collect());
        Ok(supplied)
    }

    /// What became of the nodes that were visited.
    ///
    /// # Errors
    /// [`PictureError`] where nobody waits for the picture any more, or columns do not fit together.
    pub fn finish(self) -> Result<Visited, PictureError> {
        self.failure.map_or(Ok(self.visited), |failure| Err(failure.into()))
    }

    /// Hands over listed nodes with their particles, some at a time.
    fn visit(&mut self, listing: &Listing, each: &mut dyn FnMut(&[SceneNode], &[Splats<'_>])) {
        let Supplied { subject, view, scene, reporter, .. } = self;
        let (subject, view, reporter) = (&*subject, &*view, *reporter);
        let mut part = |nodes: &[SceneNode]| -> Result<(), Failure> {
            for portion in portions(nodes, SUPPLIED) {
                if reporter.is_stopped() {
                    return Err(Failure::Stopped);
                }
                let decoded: Vec<DecodedNode<'_>> = subject.decode(view, portion, &Plan::default());
                let batches =
                    batches(subject.depiction, &decoded).map_err(|error| Failure::Drawing(VolumeError::from(error)))?;
                each(portion, &batches);
            }
            Ok(())
        };
        let outcome = scene.visit::<Failure>(listing, &[], &mut |why| reporter.tell(why), &mut part);
        match outcome {
            Ok(visited) => {
                let Visited { is_complete, error_pixels } = &mut self.visited;
                *is_complete &= visited.is_complete;
                *error_pixels = error_pixels.max(visited.error_pixels);
            }
            Err(failure) => self.failure = Some(failure),
        }
    }
}

impl Supply for Supplied<'_> {
    fn extents(&self) -> Vec<Extent> {
        self.extents.clone()
    }

    fn particles(&self) -> u64 {
        self.particles
    }

    fn has_attribute(&self) -> bool {
        self.subject.depiction.attribute.is_some()
    }

    fn slab_bytes(&self) -> u64 {
        self.slab_bytes
    }

    fn supply(&mut self, is_wanted: &dyn Fn(&Extent) -> bool, each: &mut dyn FnMut(&[Splats<'_>])) {
        if self.failure.is_some() {
            return;
        }
        let nodes = self.listing.nodes.iter().zip(&self.extents);
        let wanted = nodes.filter(|(_, extent)| is_wanted(extent)).map(|(drawn, _)| *drawn).collect();
        let wanted = self.listing.of_nodes(wanted);
        self.visit(&wanted, &mut |_: &[SceneNode], batches: &[Splats<'_>]| each(batches));
    }
}
