//! `sorted-splats`: particles sorted by depth, each classified on its own and blended front to back (F12 5.9).

use super::grid::{self, Look};
use crate::cpu::sorted;
use crate::cpu::volume::VolumeError;
use crate::mode::{Job, LightPicture, Mode, Needs, Output, Raw, Settings, Technique};

struct SortedSplats;

impl Technique for SortedSplats {
    fn output(&self) -> Output {
        Output::Light
    }

    fn needs(&self, _: &Settings) -> Needs {
        Needs { densities: true, ..Needs::default() }
    }

    fn draw(&self, job: &Job<'_>) -> Result<Raw, VolumeError> {
        let look = Look::new(job)?;
        let termination = job.settings.number(&grid::TERMINATION) as f32;
        let (colors, report) = sorted::draw(job.view, job.batches, &look.classifier, termination, &look.options)?;
        Ok(Raw::Light(LightPicture { colors, report, levels: look.levels, isovalues: Vec::new() }))
    }
}

/// Particles weigh their mass and are classified by their own density.
pub static MODE: Mode = Mode {
    name: "sorted-splats",
    help: "splats sorted by depth, each coloured by its own density or attribute and blended over those behind it",
    settings: &[&[&grid::OPACITY], grid::COMMON],
    technique: &SortedSplats,
    ..grid::MODE
};
