//! `layered`: splats in layers of depth, each classified and blended front to back (F12 5.10).

use super::grid::{self, Look};
use crate::cpu::layered::{self, Assignment, MOST_LAYERS};
use crate::cpu::volume::VolumeError;
use crate::mode::{
    Adapter, FindRanges, Job, LightPasses, LightPicture, LightPlan, Mode, Needs, Output, Raw, Setting, SettingKind,
    Settings, Technique, Terms,
};

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

/// Number of layers, which of them particles count in, and the opacity at which rays end.
fn way(settings: &Settings) -> (u32, Assignment, f32) {
    let assignment = match settings.name(&ASSIGNMENT).as_str() {
        "nearest" => Assignment::Nearest,
        _ => Assignment::Kernel,
    };
    (settings.number(&LAYERS).round() as u32, assignment, settings.number(&grid::TERMINATION) as f32)
}

struct Layered;

impl Technique for Layered {
    fn output(&self) -> Output {
        Output::Light
    }

    /// Planes lie between the near and the far one, so pictures hide only where the far one is set ([`Needs::slices`]).
    fn needs(&self, _: &Settings) -> Needs {
        Needs { slices: true, hides: true, ..Needs::default() }
    }

    fn adapter(&self) -> Adapter {
        Adapter::Light
    }

    fn takes_paths(&self) -> bool {
        true
    }

    fn light(&self, terms: &Terms<'_>, ranges: &mut FindRanges<'_>) -> Result<Option<LightPlan>, VolumeError> {
        let look = Look::of(terms, ranges)?;
        let (layers, assignment, termination) = way(terms.settings);
        let passes = LightPasses::Layered {
            classifier: look.classifier,
            options: look.options,
            layers,
            assignment,
            termination,
        };
        Ok(Some(LightPlan { passes, levels: look.levels, isovalues: Vec::new() }))
    }

    fn draw(&self, job: &Job<'_>) -> Result<Raw, VolumeError> {
        let look = Look::new(job)?;
        let way = way(job.settings);
        let (colors, report) =
            layered::draw_with_paths(job.view, job.batches, &look.classifier, way, &look.options, job.paths)?;
        Ok(Raw::Light(LightPicture { colors, report, levels: look.levels, isovalues: Vec::new() }))
    }
}

/// Particles weigh their mass, so that a layer's picture is its column density.
pub static MODE: Mode = Mode {
    name: "layered",
    help: "a volume for very large data: splats in layers of depth, each layer classified and blended front to back",
    settings: &[&[&grid::OPACITY, &LAYERS, &ASSIGNMENT, &grid::OCCLUSION], grid::COMMON],
    technique: &Layered,
    ..grid::MODE
};
