//! Pictures of view after view of several kinds of data, with what is known of them: what a window shows.

use super::MixedSession;
use crate::color::transfer::{Levels, TransferFunction};
use crate::color::{Accumulation, Image};
use crate::cpu::shadowing::Lighting;
use crate::cpu::surface::SurfaceReport;
use crate::cpu::surface::look::Attribute;
use crate::look::{LookPatch, MemberKind};
use crate::picture::PictureError;
use crate::picture::field::PreparedField;
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
    /// What colours it, where it is about something else than particles.
    pub colored: Option<Colored>,
    /// The values that the first and the last colour of what it is about stand for; `None` where there is nothing of it in view.
    pub levels: Option<Levels>,
    /// How far heights and what else covers pixels are away.
    pub depths: Option<SurfaceDepths>,
    /// What cannot be read of it.
    pub error: Option<String>,
}

/// What colours a picture that is about something else than particles.
pub enum Colored {
    /// Of heights: an attribute of them, and how.
    Heights(Attribute, Box<TransferFunction>),
    /// The values of an image or a volume.
    Field(Box<PreparedField>),
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
        let mut looks = self.looks(look)?;
        let about = looks.about;
        let mut prepared = self.prepare(&looks)?;
        match (levels, about) {
            (Some(levels), MemberKind::Heights) => {
                prepared.heights.iter_mut().for_each(|prepared| prepared.look.range = levels.p);
            }
            (Some(levels), MemberKind::Field) => {
                let fields = looks.fields.iter_mut().zip(&prepared.fields);
                fields
                    .for_each(|(look, prepared)| look.transfer = Some(prepared.transfer.clone().with_levels(&levels)));
                prepared = self.prepare(&looks)?;
            }
            _ => {}
        }
        let (own, colored) = match about {
            MemberKind::Heights => {
                let first = prepared.heights.first();
                let own = first.map(|first| Levels { p: first.look.range, s: [0.0, 1.0] });
                (own, first.map(|first| Colored::Heights(first.attribute, Box::new(first.look.transfer.clone()))))
            }
            MemberKind::Field => {
                let first = prepared.fields.first();
                let own = first.map(|first| Levels { p: first.levels.density, s: first.levels.attribute });
                (own, first.map(|first| Colored::Field(Box::new(first.clone()))))
            }
            MemberKind::Particles => (None, None),
        };
        let placements = self.placements(&prepared);
        let scene = self.scene(&prepared, &looks)?;
        let (ground, particles) = self.among(&prepared, placements, &looks, scene);
        let (image, levels, particles) = match particles {
            None => {
                let bloom = look.bloom.unwrap_or_default();
                (bloom.image(&ground.fragments(view, &Lighting::default()).colors()), own, ParticlesSeen::default())
            }
            Some(session) => {
                let levels = levels.filter(|_| about == MemberKind::Particles);
                let seen = session.seen_among(&looks.particles, view, levels, limits, Some(&ground))?;
                let (taken, nodes, sums) = (seen.taken, seen.nodes, seen.sums);
                (seen.image, own.or(seen.levels), ParticlesSeen { taken, nodes, sums })
            }
        };
        let (heights, error) = (ground.heights.report(), ground.error());
        let depths = ground.depths.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok(SeenMixed { image, heights, particles, colored, levels, depths, error })
    }
}
