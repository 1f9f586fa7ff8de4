//! `cartesian`: a Cartesian grid in world space, resampled at one resolution and cast rays through (F12 5.9).

use super::grid::{self, Layers, Look};
use crate::cpu::Splats;
use crate::cpu::cartesian::{self, CartesianOptions, Region};
use crate::cpu::volume::VolumeError;
use crate::mode::{
    Adapter, FindRanges, Job, LightPasses, LightPicture, LightPlan, Mode, Needs, Output, Raw, Setting, SettingKind,
    SettingValue, Settings, Technique, Terms,
};
use crate::model::Kernel;

/// Cells along the longest side.
pub static CELLS: Setting = Setting {
    name: "cells",
    unit: "",
    kind: SettingKind::Number { min: 2.0, max: 4096.0, default: 256.0 },
    help: "cells of the grid along its longest side",
};

/// Which box is resampled.
pub static REGION: Setting = Setting {
    name: "region",
    unit: "",
    kind: SettingKind::Choice { options: &["view", "data"] },
    help: "the grid's box: around what is in view, or around all of the data, whatever is in view",
};

/// What is drawn of the grid.
pub static CONTENT: Setting = Setting {
    name: "content",
    unit: "",
    kind: SettingKind::Choice { options: &["volume", "isosurface", "volume-isosurface"] },
    help: "what is drawn of the grid, as the mode of that name does",
};

/// Memory for the grid.
pub static MEMORY: Setting = Setting {
    name: "memory",
    unit: "MiB",
    kind: SettingKind::Number { min: 1.0, max: 1_048_576.0, default: 2048.0 },
    help: "memory that the grid may take if none of its bricks is empty; a larger one is refused",
};

struct Cartesian;

impl Technique for Cartesian {
    fn output(&self) -> Output {
        Output::Light
    }

    fn needs(&self, _: &Settings) -> Needs {
        Needs { of_data: true, slices: true, ..Needs::default() }
    }

    fn for_panorama(&self, settings: &mut Settings, _: &[Splats<'_>], _: Kernel) {
        settings.set(&REGION, SettingValue::Name("data".into()));
    }

    fn takes_clusters(&self) -> bool {
        true
    }

    fn adapter(&self) -> Adapter {
        Adapter::Light
    }

    fn light(&self, terms: &Terms<'_>, ranges: &mut FindRanges<'_>) -> Result<Option<LightPlan>, VolumeError> {
        let look = Look::of(terms, ranges)?;
        let (scenery, isovalues) = look.scenery(terms, layers(terms.settings))?;
        let passes = LightPasses::Cartesian(scenery, look.options, options(terms.settings));
        Ok(Some(LightPlan { passes, levels: look.levels, isovalues }))
    }

    fn draw(&self, job: &Job<'_>) -> Result<Raw, VolumeError> {
        let look = Look::new(job)?;
        let (scenery, isovalues) = look.scenery(&job.terms(), layers(job.settings))?;
        let (colors, report) = cartesian::draw(job.view, job.batches, &scenery, &options(job.settings), &look.options)?;
        Ok(Raw::Light(LightPicture { colors, report, levels: look.levels, isovalues }))
    }
}

/// What is drawn of the grid.
fn layers(settings: &Settings) -> Layers {
    match settings.name(&CONTENT).as_str() {
        "isosurface" => Layers::SURFACES,
        "volume-isosurface" => Layers::BOTH,
        _ => Layers::VOLUME,
    }
}

/// How the grid is laid.
fn options(settings: &Settings) -> CartesianOptions {
    CartesianOptions {
        cells: settings.number(&CELLS).round() as u32,
        region: if settings.name(&REGION) == "data" { Region::Data } else { Region::View },
        memory: (settings.number(&MEMORY) * f64::from(1 << 20)) as u64,
    }
}

/// Particles weigh their mass, so that their sum with the kernel is the density.
pub static MODE: Mode = Mode {
    name: "cartesian",
    help: "a volume or isosurfaces of a Cartesian grid with one resolution everywhere, instead of one that follows the view",
    settings: &[&[&CONTENT, &CELLS, &REGION, &MEMORY, &grid::OPACITY], grid::SURFACES, grid::LIGHT, grid::COMMON],
    technique: &Cartesian,
    ..grid::MODE
};
