//! What is drawn, whatever the view: a mode with its colours on some data. Nodes in memory become a picture's values here: what
//! a picture may leave out is planned, the rest is decoded and drawn.

use super::decode::{DecodedNode, batches, cut, decode, decode_planned};
use super::ground::{Ground, SceneLight};
use super::sampling_error::Estimate;
use super::summing::Summing;
use super::{drawing_cost, sampling_error};
use crate::codec::{Codebook, CodebookScope};
use crate::color::Accumulation;
use crate::color::transfer::{Levels, TransferFunction};
use crate::cpu::overdraw::{Overdraw, overdraw};
use crate::cpu::paths::PathFragments;
use crate::cpu::shadowing::{Lighting, Others, Shadowing};
use crate::cpu::volume::particles::{density_scale, density_scale_of};
use crate::cpu::volume::{Supply, VolumeError};
use crate::cpu::{Counts, Method, SplatError, SplatOptions, Splats, around};
use crate::mode::over::own_column;
use crate::mode::{
    CodeTable, Conserved, Depiction, FindRanges, Footprint, InView, Job, LightPlan, LodBudget, Output, Plan, Raw, Terms,
};
use crate::modes::grid::Look;
use crate::store::{FamilyMetadata, Metadata};
use crate::stream::SceneNode;
use crate::view::View;
use std::f64::consts::TAU;

/// What is drawn, and how.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    /// What is known of the data.
    pub metadata: &'a Metadata,
    /// The mode and the attribute.
    pub depiction: &'a Depiction,
    /// The colours: what volumes emit and absorb, and what may be left out of sums without being seen.
    pub transfer: &'a TransferFunction,
    /// The data's diameter without far outliers, world units.
    pub diameter: f64,
    /// How splats are evaluated.
    pub method: Method,
    /// Mean mass of a source particle of the families that are drawn.
    pub mean_mass: f64,
    /// What all views of a picture that is put together of several show: see [`Job::in_views`].
    pub in_views: Option<&'a InView>,
    /// What lamps go with, and what else hides light: see [`Job::lighting`].
    pub lighting: Lighting<'a>,
}

/// Mean mass of a source particle of families; 0 where there is none.
pub(super) fn mean_mass<'a>(families: impl Iterator<Item = &'a FamilyMetadata>) -> f64 {
    let (mass, count) = families.fold((0.0, 0), |(mass, count), family| (mass + family.mass, count + family.count));
    if count > 0 { mass / count as f64 } else { 0.0 }
}

impl<'a> Subject<'a> {
    /// As the processor draws it fast.
    pub fn new(
        metadata: &'a Metadata,
        depiction: &'a Depiction,
        transfer: &'a TransferFunction,
        diameter: f64,
    ) -> Subject<'a> {
        let mean_mass = mean_mass(metadata.families.iter());
        Subject {
            metadata,
            depiction,
            transfer,
            diameter,
            method: Method::default(),
            mean_mass,
            in_views: None,
            lighting: Lighting::default(),
        }
    }

    /// The same of those families alone that are `shown`, in their order; of all that it says nothing of.
    #[must_use]
    pub fn of_shown(self, shown: &[bool]) -> Subject<'a> {
        let is_shown = shown.iter().copied().chain(std::iter::repeat(true));
        let families = self.metadata.families.iter().zip(is_shown).filter(|(_, shown)| *shown);
        Subject { mean_mass: mean_mass(families.map(|(family, _)| family)), ..self }
    }

    /// What `lod_budget` comes to for the picture of `nodes`, whose colours have the ranges `levels`, or those that are found for
    /// it. Nothing is left out of pictures that are not sums.
    ///
    /// # Errors
    /// [`VolumeError`] as [`Subject::draw`].
    pub fn plan(
        &self,
        view: &View,
        nodes: &[SceneNode],
        lod_budget: &LodBudget,
        levels: Option<Levels>,
    ) -> Result<Plan, VolumeError> {
        match self.depiction.mode.technique.output() {
            Output::Sums => sampling_error::plan(self, view, nodes, lod_budget, levels),
            Output::Values | Output::Light => Ok(Plan::default()),
        }
    }

    /// What the plan for a picture is found by where that takes a look at its nodes, of which there are `particles`: they are added to it. `None`
    /// where it does not, and [`Subject::plan`] needs none.
    pub(super) fn estimating(&self, view: &View, particles: u64, lod_budget: &LodBudget) -> Option<Estimate<'a>> {
        let is_sum = self.depiction.mode.technique.output() == Output::Sums;
        (is_sum && lod_budget.needs_levels()).then(|| Estimate::new(self, view, particles))
    }

    /// `plan`, or as even a sample as is within `limit` particles; and how many that are.
    pub fn within(&self, limit: u64, plan: Plan, view: &View, nodes: &[SceneNode]) -> (Plan, u64) {
        let important = drawing_cost::most_important(self.depiction, self.metadata);
        drawing_cost::within(limit, plan, view, self.depiction, self.metadata, nodes, &important)
    }

    /// What a plan draws of nodes in a view.
    pub fn decode<'n>(&self, view: &View, nodes: &'n [SceneNode], plan: &Plan) -> Vec<DecodedNode<'n>> {
        decode_planned(view, self.depiction, self.metadata, nodes, plan)
    }

    /// Draws decoded nodes with a plan's culling and presence acceleration.
    ///
    /// # Errors
    /// [`VolumeError`] as [`crate::mode::Mode::draw`].
    pub fn draw(&self, view: &View, nodes: &[DecodedNode<'_>], plan: &Plan) -> Result<Raw, VolumeError> {
        self.draw_with_paths(view, nodes, plan, None)
    }

    /// The same with paths among what is drawn, of modes that take them, or with surfaces that hide some of it, of modes that meet these.
    ///
    /// # Errors
    /// As [`Subject::draw`].
    pub fn draw_with_paths(
        &self,
        view: &View,
        nodes: &[DecodedNode<'_>],
        plan: &Plan,
        paths: Option<&PathFragments>,
    ) -> Result<Raw, VolumeError> {
        self.draw_batches(view, &batches(self.depiction, nodes)?, plan, paths)
    }

    /// Decodes nodes and draws them; for sums a portion after the other.
    ///
    /// # Errors
    /// As [`Subject::draw`].
    pub fn draw_nodes(&self, view: &View, nodes: &[SceneNode], plan: &Plan) -> Result<Raw, VolumeError> {
        match self.summing(view, plan) {
            Some(mut summing) => {
                summing.add(nodes)?;
                Ok(summing.finish())
            }
            None => self.draw(view, &self.decode(view, nodes, plan), plan),
        }
    }

    /// Whether [`Subject::draw_supplied`] draws.
    pub(super) fn takes_supply(&self) -> bool {
        let Depiction { mode, settings, .. } = self.depiction;
        mode.technique.on_processor() && mode.technique.takes_supply(settings)
    }

    /// Draws particles that are not all there at once.
    ///
    /// # Errors
    /// As [`Subject::draw`].
    pub(super) fn draw_supplied(&self, view: &View, supply: &mut dyn Supply) -> Result<Raw, VolumeError> {
        self.depiction.mode.technique.draw_supplied(&self.job(view, &[], &Plan::default()), supply)
    }

    /// The ranges of the colours of such a picture.
    ///
    /// # Errors
    /// As [`Subject::draw`].
    pub(super) fn supplied_levels(&self, view: &View, supply: &mut dyn Supply) -> Result<Option<Levels>, VolumeError> {
        let job = self.job(view, &[], &Plan::default());
        let found = self.depiction.mode.technique.supplied_levels(&job, supply)?;
        Ok(found.map(|found| Levels { p: found.density, s: found.attribute }))
    }

    /// What sums nodes that are not all there at once; `None` for pictures that are no sums of splats, each by itself.
    pub fn summing(&self, view: &View, plan: &Plan) -> Option<Summing<'a>> {
        let mode = self.depiction.mode;
        if mode.technique.output() != Output::Sums || !mode.technique.on_processor() {
            return None;
        }
        let sums = mode.technique.summation(&self.job(view, &[], plan))?;
        Some(Summing::new(*self, view, *plan, sums.into()))
    }

    /// The same of a face of a panorama whose pixels are `pixel` radians wide, or of a flat picture.
    pub(super) fn summing_face(&self, view: &View, pixel: Option<f64>) -> Option<Summing<'a>> {
        let plan = Plan::default();
        match (pixel, self.depiction.mode.technique.output()) {
            (Some(pixel), Output::Sums) => {
                let sums = around::FaceSums::new(view, pixel, &self.options(&plan));
                Some(Summing::new(*self, view, plan, sums.into()))
            }
            _ => self.summing(view, &plan),
        }
    }

    /// Draws batches of particles, with paths among them where the mode takes some.
    ///
    /// # Errors
    /// As [`Subject::draw`].
    pub fn draw_batches(
        &self,
        view: &View,
        batches: &[Splats<'_>],
        plan: &Plan,
        paths: Option<&PathFragments>,
    ) -> Result<Raw, VolumeError> {
        self.depiction.mode.draw(&Job { paths, ..self.job(view, batches, plan) })
    }

    /// The same as a face of a panorama whose pixels are `around` radians wide, or as a flat picture.
    ///
    /// # Errors
    /// As [`Subject::draw`].
    pub(super) fn draw_face(
        &self,
        view: &View,
        batches: &[Splats<'_>],
        paths: Option<&PathFragments>,
        around: Option<f64>,
    ) -> Result<Raw, VolumeError> {
        self.depiction.mode.draw(&Job { paths, around, ..self.job(view, batches, &Plan::default()) })
    }

    /// What a view, or a face of a panorama around a camera, shows of a ground, darkened by the surfaces of batches of particles, too.
    pub(super) fn ground(
        &self,
        ground: &dyn Ground,
        view: &View,
        batches: &[Splats<'_>],
        camera: Option<&View>,
    ) -> PathFragments {
        let SceneLight { scene, sun, is_darkened, .. } = ground.light();
        let job = self.job(view, batches, &Plan::default());
        // What is wrong with them, their picture says itself.
        let casters = match is_darkened {
            true => self.depiction.mode.technique.casters(&job).ok().flatten(),
            false => None,
        };
        let others = casters.as_deref().map(|casters| Others { casters, scene, sun });
        ground.fragments(view, &Lighting { camera, others })
    }

    /// The same of nodes in a flat picture.
    ///
    /// # Errors
    /// As [`Subject::draw`].
    pub(super) fn ground_among(
        &self,
        ground: &dyn Ground,
        view: &View,
        nodes: &[SceneNode],
        plan: &Plan,
    ) -> Result<PathFragments, VolumeError> {
        let decoded = if ground.light().is_darkened { self.decode(view, nodes, plan) } else { Vec::new() };
        Ok(self.ground(ground, view, &batches(self.depiction, &decoded)?, None))
    }

    /// What ranges of a face, or of a flat picture, are found by where they are looked for in what is in view.
    ///
    /// # Errors
    /// As [`Subject::draw`].
    pub(super) fn in_view(
        &self,
        view: &View,
        batches: &[Splats<'_>],
        around: Option<f64>,
    ) -> Result<Option<InView>, VolumeError> {
        self.depiction.mode.technique.in_view(&Job { around, ..self.job(view, batches, &Plan::default()) })
    }

    /// Sums of nodes on a face of a panorama whose pixels are `pixel` radians wide, or in a flat picture; without what is behind `surfaces`.
    ///
    /// # Errors
    /// As [`Subject::draw`].
    pub(super) fn sum_face(
        &self,
        view: &View,
        nodes: &[SceneNode],
        pixel: Option<f64>,
        surfaces: Option<&PathFragments>,
    ) -> Result<(Accumulation, Counts), VolumeError> {
        if surfaces.is_none()
            && let Some(mut summing) = self.summing_face(view, pixel)
        {
            summing.add(nodes)?;
            return summing.finish().sums(self.depiction.mode);
        }
        let nodes = cut(view, decode(self.depiction, self.metadata, nodes));
        self.sum_batches(view, &batches(self.depiction, &nodes)?, pixel, surfaces)
    }

    /// The same of batches of particles.
    ///
    /// # Errors
    /// As [`Subject::draw`].
    pub(super) fn sum_batches(
        &self,
        view: &View,
        batches: &[Splats<'_>],
        pixel: Option<f64>,
        surfaces: Option<&PathFragments>,
    ) -> Result<(Accumulation, Counts), VolumeError> {
        match (pixel, self.depiction.mode.technique.output()) {
            (Some(pixel), Output::Sums) => {
                Ok(around::draw_face_among(view, batches, pixel, &self.options(&Plan::default()), surfaces)?)
            }
            _ => self.draw_batches(view, batches, &Plan::default(), surfaces)?.sums(self.depiction.mode),
        }
    }

    /// How the opaque surfaces of what is drawn darken each other in a view; `None` where they do not.
    pub(super) fn shadowing(&self, view: &View) -> Option<Shadowing> {
        let Depiction { mode, settings, .. } = self.depiction;
        mode.technique.shadowing(settings, view, &self.lighting, self.diameter)
    }

    /// What an adapter's passes draw in a view, of modes that draw light; `ranges` finds those of the field.
    ///
    /// # Errors
    /// As [`Subject::draw`], and as `ranges`.
    pub fn light(&self, view: &View, ranges: &mut FindRanges<'_>) -> Result<Option<LightPlan>, VolumeError> {
        let terms = Terms {
            view,
            settings: &self.depiction.settings,
            transfer: Some(self.transfer),
            attribute: self.depiction.attribute.is_some(),
            kernel: self.metadata.kernel,
            diameter: self.diameter,
            densest: self.densest(),
            density_scale: self.density_scale(&[]),
            mean_mass: self.mean_mass,
        };
        self.depiction.mode.technique.light(&terms, ranges)
    }

    /// The same of fields of columns: the processor finds their ranges, of the particles of all nodes that are drawn.
    ///
    /// # Errors
    /// As [`Subject::draw`].
    pub fn light_of_fields(
        &self,
        view: &View,
        nodes: &[SceneNode],
        plan: &Plan,
    ) -> Result<Option<LightPlan>, VolumeError> {
        let nodes = self.decode(view, nodes, plan);
        let batches = batches(self.depiction, &nodes)?;
        self.depiction.mode.technique.light_of_fields(&self.job(view, &batches, plan))
    }

    /// What the colours of a codebook's entries tell, of modes that draw light: densities, or own columns.
    pub fn told_values(&self, table: &CodeTable, codebook: &Codebook) -> Vec<f32> {
        let Subject { metadata, depiction, mean_mass, .. } = *self;
        if !depiction.mode.technique.tells_columns() {
            return codebook.density.clone();
        }
        let kernel = metadata.kernel;
        let column = own_column(depiction.mode.conserves, kernel, (mean_mass, self.density_scale(&[])));
        let deviation = match depiction.footprint() {
            Footprint::Kernel => kernel.variance().sqrt(),
            // The column in a disc's middle.
            Footprint::Pixels(radius) => f64::from(radius) * (TAU * kernel.projected(0.0)).sqrt().recip(),
        };
        let value = |i: usize| {
            let density = table.density.as_ref().map(|densities| densities[i]);
            let size = match depiction.footprint() {
                Footprint::Kernel => f64::from(table.smoothing_length[i]),
                Footprint::Pixels(_) => 1.0,
            };
            column.of(f64::from(table.weight[i]), density, size * deviation) as f32
        };
        (0..table.weight.len()).map(value).collect()
    }

    /// How many of the splats lie over each pixel.
    ///
    /// # Errors
    /// [`SplatError`] as [`Splats::new`].
    pub fn overdraw(&self, view: &View, nodes: &[DecodedNode<'_>], plan: &Plan) -> Result<Overdraw, SplatError> {
        Ok(overdraw(view, &batches(self.depiction, nodes)?, &self.options(plan)))
    }

    /// The ranges of the colours of these nodes' picture.
    ///
    /// # Errors
    /// As [`Subject::draw`].
    pub fn levels_of_nodes(&self, view: &View, nodes: &[SceneNode], plan: &Plan) -> Result<Levels, VolumeError> {
        match self.depiction.mode.is_light() {
            true => self.levels(view, &self.decode(view, nodes, plan), plan),
            false => Ok(self.transfer.levels(&self.draw_nodes(view, nodes, plan)?.sums(self.depiction.mode)?.0)),
        }
    }

    /// The ranges of the colours of these nodes' picture, found without drawing it where that can be.
    ///
    /// # Errors
    /// As [`Subject::draw`].
    pub fn levels(&self, view: &View, nodes: &[DecodedNode<'_>], plan: &Plan) -> Result<Levels, VolumeError> {
        if !self.depiction.mode.is_light() {
            return Ok(self.transfer.levels(&self.draw(view, nodes, plan)?.sums(self.depiction.mode)?.0));
        }
        let batches = batches(self.depiction, nodes)?;
        let job = self.job(view, &batches, plan);
        let found = match self.depiction.mode.technique.own_levels(&job) {
            Some(own) => own,
            None => Look::new(&job)?.levels,
        };
        Ok(Levels { p: found.density, s: found.attribute })
    }

    fn options(&self, plan: &Plan) -> SplatOptions {
        let Plan { culling, faintest, .. } = *plan;
        let sprite = self.depiction.choice.sprite;
        SplatOptions { method: self.method, kernel: self.metadata.kernel, culling, faintest, sprite }
    }

    fn job<'j>(&'j self, view: &'j View, batches: &'j [Splats<'j>], plan: &Plan) -> Job<'j> {
        let Subject { metadata, depiction, .. } = *self;
        let (transfer, diameter) = match depiction.mode.technique.output() {
            Output::Sums => (None, 0.0),
            Output::Values => (None, metadata.bounds().size().length()),
            Output::Light => (Some(self.transfer), self.diameter),
        };
        let (options, settings) = (self.options(plan), &depiction.settings);
        let density_scale = self.density_scale(batches);
        Job {
            view,
            batches,
            options,
            settings,
            transfer,
            bounds: metadata.bounds(),
            diameter,
            densest: self.densest(),
            density_scale,
            mean_mass: self.mean_mass,
            paths: None,
            around: None,
            in_views: self.in_views,
            lighting: self.lighting,
            order: depiction.choice.order.unwrap_or_default(),
        }
    }

    /// The factor on particles' own densities, by what the codebooks of leaves have; of data without any, by what `batches` have.
    pub(super) fn density_scale(&self, batches: &[Splats<'_>]) -> f32 {
        if !self.depiction.needs().densities {
            return 1.0;
        }
        let books = self.metadata.families.iter().flat_map(|family| &family.codebooks);
        let mut leaves = books.filter(|book| book.scope == CodebookScope::Leaves).peekable();
        if leaves.peek().is_none() {
            // Other weights tell nothing of masses.
            let is_mass = self.depiction.mode.conserves == Conserved::Mass;
            return if is_mass { density_scale_of(batches) } else { 1.0 };
        }
        let ratio = |book: &Codebook, i: usize| book.density[i] * book.smoothing_length[i].powi(3) / book.mass[i];
        density_scale(leaves.flat_map(|book| (0..book.len()).map(move |i| ratio(book, i))))
    }

    fn densest(&self) -> f64 {
        self.metadata.families.iter().map(|family| family.quantities[1].max).fold(0.0, f64::max)
    }
}
