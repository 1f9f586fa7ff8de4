//! `layered`: splats in layers of depth, each classified and blended front to back (F12 5.10).

use super::grid::{self, Look};
use crate::cpu::layered::{self, Assignment, MOST_LAYERS};
use crate::cpu::volume::VolumeError;
use crate::mode::{Job, LightPicture, Mode, Output, Raw, Setting, SettingKind, Technique};

/// Number of layers.
pub static LAYERS: Setting = Setting {
    name: "layers",
    unit: "",
    kind: SettingKind::Number { min: 1.0, max: MOST_LAYERS as f64, default: 128.0 },
    help: "number of depth layers: more are slower and nearer to the volume; a sixth of its slices hardly flickers",
};

/// Which layers a particle counts in.
pub static ASSIGNMENT: Setting = Setting {
    name: "assignment",
    unit: "",
    kind: SettingKind::Choice { options: &["kernel", "nearest"] },
    help: "kernel: each layer gets what of a particle lies in it; nearest: all goes to its centre's layer (F12 5.10)",
};

struct Layered;

impl Technique for Layered {
    fn output(&self) -> Output {
        Output::Light
    }

    fn draw(&self, job: &Job<'_>) -> Result<Raw, VolumeError> {
        let look = Look::new(job)?;
        let settings = job.settings;
        let assignment = match settings.name(&ASSIGNMENT).as_str() {
            "nearest" => Assignment::Nearest,
            _ => Assignment::Kernel,
        };
        let way = (settings.number(&LAYERS).round() as u32, assignment, settings.number(&grid::TERMINATION) as f32);
        let (colors, report) = layered::draw(job.view, job.batches, &look.classifier, way, &look.options)?;
        Ok(Raw::Light(LightPicture { colors, report, levels: look.levels, isovalues: Vec::new() }))
    }
}

/// Particles weigh their mass, so that a layer's picture is its column density.
pub static MODE: Mode = Mode {
    name: "layered",
    help: "a volume for very large data: splats in layers of depth, each layer classified and blended front to back",
    settings: &[&[&grid::OPACITY, &LAYERS, &ASSIGNMENT], grid::COMMON],
    technique: &Layered,
    ..grid::MODE
};
