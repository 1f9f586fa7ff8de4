//! `paths`: pathlines of a run alone (F12 6.4).

use super::grid;
use crate::color::Colors;
use crate::cpu::paths::PathFragments;
use crate::cpu::volume::{VolumeError, VolumeLevels, VolumeReport};
use crate::mode::{Job, LightPicture, Mode, Needs, Output, Raw, Settings, Technique};

struct Paths;

impl Technique for Paths {
    fn output(&self) -> Output {
        Output::Light
    }

    fn needs(&self, _: &Settings) -> Needs {
        Needs { particles: false, ..Needs::default() }
    }

    fn takes_paths(&self) -> bool {
        true
    }

    fn draw(&self, job: &Job<'_>) -> Result<Raw, VolumeError> {
        Ok(picture(job.view.width, job.view.height, job.paths.map(PathFragments::colors)))
    }
}

/// A picture of paths in these colours; empty without.
pub fn picture(width: u32, height: u32, colors: Option<Colors>) -> Raw {
    let empty = || Colors { width, height, rgba: vec![[0.0; 4]; width as usize * height as usize] };
    let levels = VolumeLevels { density: [1.0, 10.0], attribute: [0.0, 1.0], unit_length: 1.0 };
    let (colors, report) = (colors.unwrap_or_else(empty), VolumeReport::default());
    Raw::Light(LightPicture { colors, report, levels, isovalues: Vec::new() })
}

/// The paths have settings of their own, which are those of every mode's pictures.
pub static MODE: Mode = Mode {
    name: "paths",
    help: "where particles of a run come from and go to, alone: all of them unless the paths' own settings say otherwise",
    settings: &[],
    technique: &Paths,
    ..grid::MODE
};
