//! `sorted-splats`: particles sorted by depth, each classified on its own and blended front to back (F12 5.9).

use super::grid::{self, Look};
use crate::cpu::sorted;
use crate::cpu::volume::VolumeError;
use crate::mode::{
    Adapter, FindRanges, Job, LightPasses, LightPicture, LightPlan, Mode, Needs, Output, Raw, Settings, Technique,
    Terms,
};

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

    fn draw(&self, job: &Job<'_>) -> Result<Raw, VolumeError> {
        let look = Look::new(job)?;
        let termination = job.settings.number(&grid::TERMINATION) as f32;
        let way = (termination, job.density_scale);
        let (colors, report) = sorted::draw(job.view, job.batches, &look.classifier, way, &look.options)?;
        Ok(Raw::Light(LightPicture { colors, report, levels: look.levels, isovalues: Vec::new() }))
    }
}

/// Particles weigh their mass and are classified by their own density.
pub static MODE: Mode = Mode {
    name: "sorted-splats",
    help: "splats sorted by depth, each coloured by its own density or attribute and blended over those behind it",
    settings: &[&[&grid::OPACITY, &grid::OCCLUSION], grid::COMMON],
    technique: &SortedSplats,
    ..grid::MODE
};
