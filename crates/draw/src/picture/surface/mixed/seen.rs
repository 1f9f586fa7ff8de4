//! Pictures of view after view of heights among other things, with what is known of them: what a window shows.

use super::{Fields, Looks, MixedSession};
use crate::color::transfer::{Levels, TransferFunction};
use crate::color::{Accumulation, Image};
use crate::cpu::surface::SurfaceReport;
use crate::cpu::surface::look::Attribute;
use crate::look::LookPatch;
use crate::picture::PictureError;
use crate::picture::ground::Ground;
use crate::picture::surface::SurfaceDepths;
use crate::view::View;
use std::sync::PoisonError;

/// A picture of a view, and what is known of it.
pub struct SeenMixed {
    /// Its colours.
    pub image: Image,
    /// What was drawn of heights.
    pub heights: SurfaceReport,
    /// What was drawn of particles.
    pub particles: ParticlesSeen,
    /// What colours the heights, and how, where the picture is about them.
    pub colored: Option<(Attribute, TransferFunction)>,
    /// The values that the first and the last colour of what it is about stand for; `None` where there is nothing of it in view.
    pub levels: Option<Levels>,
    /// How far the heights are away.
    pub depths: Option<SurfaceDepths>,
    /// What cannot be read of the heights.
    pub error: Option<String>,
}

/// What was drawn of particles.
#[derive(Default)]
pub struct ParticlesSeen {
    /// How many.
    pub taken: u64,
    /// Of how many nodes.
    pub nodes: usize,
    /// What was added up, in modes that add up.
    pub sums: Option<Accumulation>,
}

impl MixedSession {
    /// A look's picture of a view, of about `limit` particles at most; colours of what it is about have the ranges `levels`, or their own.
    ///
    /// # Errors
    /// As [`MixedSession::draw`].
    pub fn seen(
        &mut self,
        look: &LookPatch,
        view: &View,
        levels: Option<Levels>,
        limits: (f64, u64),
    ) -> Result<SeenMixed, PictureError> {
        let Looks { heights, particles: of_particles, is_of_heights } = self.looks(look)?;
        let mut prepared = self.prepare(&heights)?;
        if let (Some(levels), true) = (levels, is_of_heights) {
            prepared.iter_mut().for_each(|prepared| prepared.look.range = levels.p);
        }
        let about = prepared.first().filter(|_| is_of_heights);
        let own = about.map(|first| Levels { p: first.look.range, s: [0.0, 1.0] });
        let colored = about.map(|first| (first.attribute, first.look.transfer.clone()));
        let placements = self.placements(&prepared);
        let ground = Fields::new(&mut self.fields, &prepared, placements, &heights);
        let (image, levels, particles) = match &mut self.particles {
            None => (ground.fragments(view).colors().image(), own, ParticlesSeen::default()),
            Some(session) => {
                let levels = levels.filter(|_| !is_of_heights);
                let seen = session.seen_among(&of_particles, view, levels, limits, Some(&ground))?;
                let (taken, nodes, sums) = (seen.taken, seen.nodes, seen.sums);
                (seen.image, own.or(seen.levels), ParticlesSeen { taken, nodes, sums })
            }
        };
        let (heights, error) = (ground.report(), ground.error());
        let depths = ground.depths.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok(SeenMixed { image, heights, particles, colored, levels, depths, error })
    }
}
