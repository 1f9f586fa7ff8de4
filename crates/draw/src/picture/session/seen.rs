//! What is seen of particles, view after view, as the processor draws it.

use super::Session;
use crate::color::composite::{composite_glowing, composite_over};
use crate::color::transfer::Levels;
use crate::color::{Accumulation, Image};
use crate::cpu::shadowing::Lighting;
use crate::cpu::volume::VolumeError;
use crate::look::LookPatch;
use crate::mode::Raw;
use crate::picture::account::Task;
use crate::picture::ground::{Ground, lighting, through};
use crate::picture::{PictureError, Subject};
use crate::view::View;
use crate::view::perspective_grid::GridError;

/// A picture of a view, and what is known of it.
pub struct SeenParticles {
    /// Its colours.
    pub image: Image,
    /// How many particles it took.
    pub taken: u64,
    /// Nodes drawn.
    pub nodes: usize,
    /// The ranges of its colours; `None` of a view without particles.
    pub levels: Option<Levels>,
    /// What was added up, in modes that add up.
    pub sums: Option<Accumulation>,
}

impl Session {
    /// A look's picture of a view as the processor draws it, of about `limit` particles at most, black where nothing is in view; its
    /// colours have the ranges `levels`, or their own. And how many particles it took.
    ///
    /// # Errors
    /// As [`Session::draw`].
    pub fn image(
        &mut self,
        look: &LookPatch,
        view: &View,
        levels: Option<Levels>,
        diameter: f64,
        limit: u64,
    ) -> Result<(Image, u64), PictureError> {
        self.image_among(look, view, levels, (diameter, limit), None)
    }

    /// The same among measured surfaces.
    ///
    /// # Errors
    /// As [`Session::draw_among`].
    pub fn image_among(
        &mut self,
        look: &LookPatch,
        view: &View,
        levels: Option<Levels>,
        limits: (f64, u64),
        ground: Option<&dyn Ground>,
    ) -> Result<(Image, u64), PictureError> {
        let seen = self.seen_among(look, view, levels, limits, ground)?;
        Ok((seen.image, seen.taken))
    }

    /// The same with what is known of it.
    ///
    /// # Errors
    /// As [`Session::draw_among`].
    pub fn seen_among(
        &mut self,
        look: &LookPatch,
        view: &View,
        levels: Option<Levels>,
        (diameter, limit): (f64, u64),
        ground: Option<&dyn Ground>,
    ) -> Result<SeenParticles, PictureError> {
        let (tree, depiction, mut transfer) = self.show(look)?;
        let depiction = depiction.blended();
        if let Some(levels) = levels.filter(|_| depiction.mode.is_light()) {
            transfer = transfer.with_levels(&levels);
        }
        self.share_memory(Task::of(&depiction, (view.width, view.height), true));
        let selection = self.select(&depiction, view, look.error_px())?;
        self.tell_of_memory();
        let subject = Subject {
            mean_mass: self.mean_mass(&*tree),
            ..Subject::new(tree.metadata(), &depiction, &transfer, diameter)
        };
        let plan = subject.plan(view, &selection.nodes, &look.budget.file_budget(), None)?;
        let (plan, taken) = subject.within(limit, plan, view, &selection.nodes);
        if ground.is_some() {
            self.check_among(&depiction)?;
        }
        let in_the_way = |from: &View| ground.and_then(|ground| ground.opaque(from, view));
        let subject = Subject { lighting: lighting(ground, &in_the_way), ..subject };
        let surfaces = ground.map(|ground| subject.ground_among(ground, view, &selection.nodes, &plan)).transpose()?;
        let nodes = subject.decode(view, &selection.nodes, &plan);
        let bloom = look.bloom.unwrap_or_default();
        let (image, levels, sums) = match subject.draw_with_paths(view, &nodes, &plan, surfaces.as_ref()) {
            Ok(Raw::Sums(sums, _)) => {
                let solid =
                    ground.filter(|ground| ground.is_filter()).map(|ground| ground.solid(view, &Lighting::default()));
                let whole = solid.map(|solid| subject.draw_with_paths(view, &nodes, &plan, Some(&solid)));
                let whole = match whole.transpose()? {
                    Some(Raw::Sums(whole, _)) => Some(whole),
                    _ => None,
                };
                let shown = whole.as_ref().unwrap_or(&sums);
                let levels = levels.unwrap_or_else(|| transfer.levels(shown));
                let image = match &surfaces {
                    None => composite_glowing(shown, &transfer, &levels, &bloom),
                    Some(surfaces) => {
                        let through = whole.as_ref().map(|whole| through(&sums, whole));
                        let behind = surfaces.colors().image();
                        let mut image = composite_over(shown, &transfer, &levels, &behind, through.as_deref());
                        bloom.spread_image(&mut image);
                        image
                    }
                };
                (image, Some(levels), Some(sums))
            }
            Ok(Raw::Light(painted)) => {
                let levels = Levels { p: painted.levels.density, s: painted.levels.attribute };
                (bloom.image(&painted.colors), Some(levels), None)
            }
            Err(VolumeError::Grid(GridError::NothingInView)) => match &surfaces {
                None => (Image::black(view.width, view.height), None, None),
                Some(surfaces) => (bloom.image(&surfaces.colors()), None, None),
            },
            Err(error) => return Err(error.into()),
        };
        Ok(SeenParticles { image, taken, nodes: selection.nodes.len(), levels, sums })
    }
}
