//! How a mode is drawn: what a technique needs, which backends it has, what it is handed and what it hands back. What draws
//! asks the technique and never for the mode.

mod drawn;
mod job;
mod splat_sums;

pub use drawn::{LightPasses, LightPicture, LightPlan, OwnColors, Raw};
pub use job::{FindRanges, Job, Terms};
pub use splat_sums::{SPLAT_SUMS, SplatSums};

use super::{FieldJob, FieldPasses, Footprint, InView, Settings};
use crate::color::transfer::TransferFunction;
use crate::cpu::paths::PathFragments;
use crate::cpu::shadowing::{Casters, Lighting, Shadowing};
use crate::cpu::volume::{Supply, VolumeError, VolumeLevels};
use crate::cpu::{Splats, Summation};
use crate::hierarchy::Purpose;
use crate::model::{Bounds, Kernel};
use crate::view::{Detail, View};
use glam::{DAffine3, DVec3};

/// What a technique's pictures are made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// `P` and `P S`, sums over particles in any order, which a transfer function colours. Particles may be left out where
    /// others weigh more.
    Sums,
    /// `P` and `P S` of another kind (a maximum, a first hit), which a transfer function colours all the same.
    Values,
    /// Colours, straight from the particles and the transfer function.
    Light,
}

/// What draws a mode on a graphics adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Adapter {
    /// Nothing does.
    None,
    /// The splat passes.
    Splats,
    /// The passes for what [`Technique::light`] says.
    Light,
    /// Passes that the mode's plugin adds. They fill the cells of the picture in place of the splat passes.
    Plugin,
}

/// What a technique needs of the data, and of the view around the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Needs {
    /// What the inner nodes that are drawn are made for, where a file has several kinds.
    pub purpose: Purpose,
    /// The shape of a particle in the picture.
    pub footprint: Footprint,
    /// Whether each particle's own density is drawn with, beside its weight.
    pub densities: bool,
    /// Whether it draws particles; what draws paths alone needs none.
    pub particles: bool,
    /// How far beyond the picture it looks, pixels.
    pub margin_px: u32,
    /// How far its splats reach beyond their footprint, pixels.
    pub blur_px: f64,
    /// Whether depth is divided between the near and the far plane, so that where samples lie depends on both.
    pub slices: bool,
    /// Whether it resamples all of the data where that is, whatever the view.
    pub of_data: bool,
    /// Whether what lies behind a picture's opaque pixels may be left out of the next picture: whether each particle's part
    /// in the picture depends on itself alone, and on what is in front of it. Sums hide nothing, nor does what resamples all
    /// of the data, hidden or not.
    pub hides: bool,
}

impl Default for Needs {
    fn default() -> Needs {
        Needs {
            purpose: Purpose::Splats,
            footprint: Footprint::Kernel,
            densities: false,
            particles: true,
            margin_px: 1,
            blur_px: 0.0,
            slices: false,
            of_data: false,
            hides: false,
        }
    }
}

/// How a mode is drawn.
pub trait Technique: Sync {
    /// What its pictures are made of.
    fn output(&self) -> Output;

    /// What it needs with these settings.
    fn needs(&self, _settings: &Settings) -> Needs {
        Needs::default()
    }

    /// How far the nodes of levels that are made for volumes are refined, of data within `bounds` and where splats may be
    /// displaced by `tau` pixels.
    fn detail(&self, _view: &View, _settings: &Settings, _bounds: Bounds, tau: f64) -> Detail {
        Detail::Error { tau }
    }

    /// Whether [`Technique::draw`] draws splats of clusters as the ellipsoids that they are.
    fn takes_clusters(&self) -> bool {
        self.output() == Output::Sums
    }

    /// What draws it on an adapter.
    fn adapter(&self) -> Adapter {
        Adapter::None
    }

    /// The columns of particles whose fields it draws with these settings, by their names; particles weigh their volumes `m / rho` then, in
    /// place of what the mode has them weigh. None: what it draws is made of these weights.
    fn fields(&self, _settings: &Settings) -> Vec<String> {
        Vec::new()
    }

    /// Whether its opaque surfaces darken each other with these settings, which the processor finds in what has been drawn: an adapter does
    /// not show such a picture in frames of its own, nor does it draw one of an image or a volume.
    fn is_darkened(&self, _settings: &Settings) -> bool {
        false
    }

    /// How they do in a view of particles of this diameter; `None` where they do not.
    fn shadowing(
        &self,
        _settings: &Settings,
        _view: &View,
        _lighting: &Lighting<'_>,
        _diameter: f64,
    ) -> Option<Shadowing> {
        None
    }

    /// Whether [`Technique::draw`] draws.
    fn on_processor(&self) -> bool {
        true
    }

    /// Whether [`Technique::draw`] draws the paths of its job among what it draws, each at its own depth. Over other pictures they lie
    /// on top.
    fn takes_paths(&self) -> bool {
        false
    }

    /// Whether [`Technique::draw`] draws among measured surfaces: the fragments of its job's `paths` are these, then, and hide what is behind them.
    /// Sums are without them; light has them in it.
    fn meets_surfaces(&self) -> bool {
        self.takes_paths()
    }

    /// Whether a particle's colour is that of its own column ([`crate::color::splat_colors::OwnColumn`]) in place of its density, of
    /// techniques that draw light.
    fn tells_columns(&self) -> bool {
        false
    }

    /// What the colours of its pictures mean, where that is not what the transfer function's do.
    fn own_colors(&self, _settings: &Settings, _transfer: &TransferFunction) -> Option<OwnColors> {
        None
    }

    /// Towards whom what it draws of a volume is turned, where that is flat: from there a picture of it is taken unless it is told otherwise.
    fn facing(&self, _settings: &Settings, _to_world: &DAffine3) -> Option<DVec3> {
        None
    }

    /// The ranges of its colours, of techniques that draw light in colours of another quantity than densities and attributes.
    fn own_levels(&self, _job: &Job<'_>) -> Option<VolumeLevels> {
        None
    }

    /// Whether ranges of its colours or of its fields are looked for in what is in view ([`Technique::in_view`]), of techniques that draw light.
    /// Others find those of all the data, where a picture is put together of several views.
    fn looks_in_view(&self, _settings: &Settings, _transfer: &TransferFunction) -> bool {
        false
    }

    /// What such ranges are found by: one view's part of the [`Job::in_views`] of each of them.
    ///
    /// # Errors
    /// [`VolumeError`] as [`Technique::draw`].
    fn in_view(&self, _job: &Job<'_>) -> Result<Option<InView>, VolumeError> {
        Ok(None)
    }

    /// Changes settings that depend on the view, so that all faces of a panorama are drawn alike; `all` are particles of all the data, whose
    /// kernel this is.
    fn for_panorama(&self, _settings: &mut Settings, _all: &[Splats<'_>], _kernel: Kernel) {}

    /// What an adapter's passes draw, of techniques that have [`Adapter::Light`]; `ranges` finds those of the field for colours that
    /// have none.
    ///
    /// # Errors
    /// [`VolumeError`] as [`Technique::draw`], and as `ranges`.
    fn light(&self, _terms: &Terms<'_>, _ranges: &mut FindRanges<'_>) -> Result<Option<LightPlan>, VolumeError> {
        Ok(None)
    }

    /// The same of the fields of columns ([`Technique::fields`]), whose ranges are those of the job's particles.
    ///
    /// # Errors
    /// [`VolumeError`] as [`Technique::draw`].
    fn light_of_fields(&self, _job: &Job<'_>) -> Result<Option<LightPlan>, VolumeError> {
        Ok(None)
    }

    /// Whether it draws particles.
    fn takes_particles(&self) -> bool {
        true
    }

    /// Whether it draws measured heights.
    fn takes_surfaces(&self) -> bool {
        false
    }

    /// Of which dimensions the fields are that [`Technique::draw_field`] draws: 2 for images, 3 for volumes.
    fn field_dimensions(&self) -> &'static [usize] {
        &[]
    }

    /// Whether an adapter draws images or volumes by what [`Technique::field_passes`] says.
    fn has_field_passes(&self) -> bool {
        false
    }

    /// What an adapter's passes draw of an image or a volume; [`super::Mode::field_passes`] calls it for fields of the dimensions that it draws.
    ///
    /// # Errors
    /// [`VolumeError`] as [`Technique::draw_field`].
    fn field_passes(&self, _job: &FieldJob<'_>) -> Result<Option<FieldPasses>, VolumeError> {
        Ok(None)
    }

    /// Whether [`Technique::draw_field`] draws the points of images and volumes that have some, in place of their samples.
    fn takes_points(&self) -> bool {
        false
    }

    /// How many points it draws of images and volumes that have some, where nothing is said of their number or of errors; `None`: as many as
    /// values or colours ask for.
    fn usual_points(&self) -> Option<u64> {
        None
    }

    /// Draws an image or a volume on the processor; [`super::Mode::draw_field`] calls it for fields of such dimensions, or with their points.
    ///
    /// # Errors
    /// [`VolumeError`] for settings that do not fit the data or each other, and when nothing is in view.
    fn draw_field(&self, _job: &FieldJob<'_>) -> Result<Raw, VolumeError> {
        Err(VolumeError::OnlyParticles)
    }

    /// Whether an image or a volume may lie among other data: [`Technique::field_parts`].
    fn has_field_parts(&self) -> bool {
        false
    }

    /// What an image or a volume shows in each pixel, in parts from front to back that something else is drawn among; nothing where nothing of it is
    /// in view. [`super::Mode::field_parts`] calls it for fields of the dimensions that it draws.
    ///
    /// # Errors
    /// [`VolumeError`] for settings that do not fit the data or each other.
    fn field_parts(&self, _job: &FieldJob<'_>) -> Result<PathFragments, VolumeError> {
        Err(VolumeError::OnlyAlone)
    }

    /// How the opaque surfaces of an image or a volume hide light from something else in a job's picture; `None` of techniques without any.
    ///
    /// # Errors
    /// [`VolumeError`] as [`Technique::draw_field`].
    fn field_casters<'j>(&'j self, _job: &'j FieldJob<'j>) -> Result<Option<Box<Casters<'j>>>, VolumeError> {
        Ok(None)
    }

    /// How the opaque surfaces of particles hide light from something else in a job's picture; `None` of techniques without any.
    ///
    /// # Errors
    /// [`VolumeError`] as [`Technique::draw`].
    fn casters<'j>(&'j self, _job: &'j Job<'j>) -> Result<Option<Box<Casters<'j>>>, VolumeError> {
        Ok(None)
    }

    /// What draws on the processor a picture whose batches are not all there at once: it is given them in their order, and the job's own do
    /// not count. `None` where a picture needs all of them, as all but sums do.
    fn summation(&self, _job: &Job<'_>) -> Option<Summation> {
        None
    }

    /// Whether [`Technique::draw_supplied`] draws with these settings.
    fn takes_supply(&self, _settings: &Settings) -> bool {
        false
    }

    /// Draws on the processor what [`Technique::draw`] would draw of particles that are not all there at once, of techniques that can do with some
    /// at a time; the job has no batches.
    ///
    /// # Errors
    /// [`VolumeError`] as [`Technique::draw`].
    fn draw_supplied(&self, job: &Job<'_>, _supply: &mut dyn Supply) -> Result<Raw, VolumeError> {
        self.draw(job)
    }

    /// Finds the ranges of what [`Technique::draw_supplied`] draws, where colours have none of their own.
    ///
    /// # Errors
    /// [`VolumeError`] as [`Technique::draw`].
    fn supplied_levels(&self, _job: &Job<'_>, _supply: &mut dyn Supply) -> Result<Option<VolumeLevels>, VolumeError> {
        Ok(None)
    }

    /// Draws on the processor; [`super::Mode::draw`] calls it for techniques that do.
    ///
    /// # Errors
    /// [`VolumeError`] for settings that do not fit the data or each other, and when nothing is in view.
    fn draw(&self, job: &Job<'_>) -> Result<Raw, VolumeError>;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::SplatOptions;
    use crate::cpu::over::Order;
    use crate::mode::Mode;
    use crate::modes::{column_density, grid};
    use crate::view::Projection;

    struct AdapterOnly;

    impl Technique for AdapterOnly {
        fn output(&self) -> Output {
            Output::Values
        }

        fn adapter(&self) -> Adapter {
            Adapter::Plugin
        }

        fn on_processor(&self) -> bool {
            false
        }

        fn draw(&self, _: &Job<'_>) -> Result<Raw, VolumeError> {
            unreachable!("the processor is not asked")
        }
    }

    #[test]
    fn what_a_mode_cannot_do_it_says() {
        static MODE: Mode = Mode { name: "adapter-only", technique: &AdapterOnly, ..grid::MODE };
        let projection = Projection::Orthographic { height: 1.0 };
        let view = View::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y, projection, 2, 2).unwrap();
        let (settings, options) = (Settings::default(), SplatOptions::default());
        let (view, batches, settings) = (&view, &[][..], &settings);
        let job = Job {
            view,
            batches,
            options,
            settings,
            transfer: None,
            bounds: Bounds { min: DVec3::ZERO, max: DVec3::ONE },
            diameter: 1.0,
            densest: 1.0,
            density_scale: 1.0,
            mean_mass: 1.0,
            paths: None,
            around: None,
            in_views: None,
            lighting: Lighting::default(),
            order: Order::default(),
        };
        let refused = MODE.draw(&job).unwrap_err().to_string();
        assert!(refused.contains("adapter-only is drawn by a graphics adapter only"), "{refused}");
        assert_eq!(MODE.all_settings().count(), 0, "what may be left out of sums is no setting of others");
        let sums = column_density::MODE.draw(&job).unwrap();
        let refused = sums.light(&column_density::MODE).unwrap_err().to_string();
        assert!(refused.contains("mode is column-density, expected a mode that draws colours"), "{refused}");
    }
}
