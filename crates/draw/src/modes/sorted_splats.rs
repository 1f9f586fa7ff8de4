//! `sorted-splats`: particles sorted by depth, each classified on its own and blended front to back (F12 5.9).

use super::grid::{self, Look};
use crate::cpu::sorted;
use crate::cpu::volume::VolumeError;
use crate::mode::{Mode, Painted, Painting, Technique};

fn paint(painting: &Painting<'_>) -> Result<Painted, VolumeError> {
    let look = Look::new(painting)?;
    let termination = painting.settings.number(&grid::TERMINATION) as f32;
    let (colors, report) = sorted::draw(painting.view, painting.batches, &look.classifier, termination, &look.options)?;
    Ok(Painted { colors, report, levels: look.levels, isovalues: Vec::new() })
}

/// Particles weigh their mass and are classified by their own density.
pub static MODE: Mode = Mode {
    name: "sorted-splats",
    help: "splats sorted by depth, each coloured by its own density or attribute and blended over those behind it",
    settings: &[&[&grid::OPACITY], grid::COMMON],
    technique: Technique::Colors(paint),
    densities: true,
    ..grid::MODE
};
