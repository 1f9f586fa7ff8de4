//! `sorted-splats`: particles sorted by depth, each classified on its own and blended front to back (F12 5.9). Of images and volumes that were
//! built it draws the points so, as WM03 does: classified by their values before they are mixed, where volumes are classified after.

use super::grid::{self, Layers, Look};
use super::samples::{self, FieldLook};
use crate::color::Colors;
use crate::cpu::field::PointLook;
use crate::cpu::sorted;
use crate::cpu::volume::{VolumeError, VolumeOptions, VolumeReport};
use crate::mode::{
    Adapter, FieldJob, FindRanges, Job, LightPasses, LightPicture, LightPlan, Mode, Needs, Output, Raw, Settings,
    Technique, Terms,
};
use crate::model::Kernel;

/// Second moments of the splat of a point of an image or a volume, of those of what it stands for. A box that is smoothed by itself falls off
/// linearly to the middles of its neighbours, as values between samples do; splats as narrow as boxes would leave gaps.
const SPREAD: f32 = 2.0;

struct SortedSplats;

impl Technique for SortedSplats {
    fn output(&self) -> Output {
        Output::Light
    }

    fn needs(&self, _: &Settings) -> Needs {
        Needs { densities: true, hides: true, ..Needs::default() }
    }

    fn takes_clusters(&self) -> bool {
        true
    }

    fn meets_surfaces(&self) -> bool {
        true
    }

    fn adapter(&self) -> Adapter {
        Adapter::Light
    }

    fn light(&self, terms: &Terms<'_>, ranges: &mut FindRanges<'_>) -> Result<Option<LightPlan>, VolumeError> {
        let look = Look::of(terms, ranges)?;
        let passes = LightPasses::Sorted {
            classifier: look.classifier,
            options: look.options,
            termination: terms.settings.number(&grid::TERMINATION) as f32,
            density_scale: terms.density_scale,
        };
        Ok(Some(LightPlan { passes, levels: look.levels, isovalues: Vec::new() }))
    }

    fn takes_points(&self) -> bool {
        true
    }

    fn draw_field(&self, job: &FieldJob<'_>) -> Result<Raw, VolumeError> {
        let points = job.points.ok_or(VolumeError::OnlyParticles)?;
        let FieldJob { view, settings, .. } = *job;
        let look = FieldLook::new(&job.values, settings, job.transfer, job.diameter, &Layers::VOLUME)?;
        let options = VolumeOptions { occlusion: false, ..grid::options(settings, Kernel::default()) };
        // An image is as opaque as its transfer function says: a sheet as thick as the length that opacities are meant for.
        let unit = look.levels.unit_length * settings.number(&grid::OPACITY);
        let (axis, least, hue, kernel) = (look.axis, look.classifier.least(), job.hue, options.kernel);
        let thickness = if job.values.is_volume { 1.0 } else { unit };
        let seen = PointLook { view, axis, least, hue, spread: SPREAD, thickness, kernel }.seen(points);
        let (colors, report) = match seen.is_empty() {
            // What nobody sees is a picture, too.
            true => {
                let (width, height) = (view.width, view.height);
                let rgba = vec![[0.0; 4]; width as usize * height as usize];
                (Colors { width, height, rgba }, VolumeReport::default())
            }
            false => {
                let batches = seen.iter().map(|seen| seen.splats()).collect::<Result<Vec<_>, _>>()?;
                let way = (settings.number(&grid::TERMINATION) as f32, 1.0);
                sorted::draw(view, &batches, &look.classifier, way, &options)?
            }
        };
        Ok(Raw::Light(LightPicture { colors, report, levels: look.levels, isovalues: Vec::new() }))
    }

    fn draw(&self, job: &Job<'_>) -> Result<Raw, VolumeError> {
        let look = Look::new(job)?;
        let termination = job.settings.number(&grid::TERMINATION) as f32;
        let way = (termination, job.density_scale);
        let (colors, report) =
            sorted::draw_among(job.view, job.batches, &look.classifier, way, &look.options, job.paths)?;
        Ok(Raw::Light(LightPicture { colors, report, levels: look.levels, isovalues: Vec::new() }))
    }
}

/// Particles weigh their mass and are classified by their own density.
pub static MODE: Mode = Mode {
    name: "sorted-splats",
    help: "splats sorted by depth, each coloured by its own density or attribute and blended over those behind it; of images and volumes that \
           were built their points, each coloured by its value",
    settings: &[&[&grid::OPACITY, &grid::OCCLUSION], grid::COMMON, samples::SAMPLES],
    technique: &SortedSplats,
    ..grid::MODE
};
