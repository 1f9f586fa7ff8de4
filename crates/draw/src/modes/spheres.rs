//! `spheres`: particles as spheres with a surface smoothed in the picture (F12 5.9).

use super::grid::{self, Look};
use crate::cpu::screen_spheres::{NEIGHBOURHOOD, SphereOptions, front};
use crate::cpu::volume::VolumeError;
use crate::cpu::volume::raycast::SURFACE_BRIGHTNESS;
use crate::mode::{Job, LightPicture, Mode, Needs, Output, Raw, Setting, SettingKind, Settings, Technique};
use std::time::Instant;

/// Radius of a sphere.
pub static RADIUS: Setting = Setting {
    name: "sphere-radius",
    unit: "h",
    kind: SettingKind::Number { min: 0.01, max: 2.0, default: 0.5 },
    help: "radius of a particle's sphere, in smoothing lengths",
};

/// Radius of the filter.
pub static SMOOTHING: Setting = Setting {
    name: "smoothing",
    unit: "radii",
    kind: SettingKind::Number { min: 0.0, max: 8.0, default: 1.5 },
    help: "how far the surface is smoothed, in radii of the spheres that are seen; 0: the spheres themselves",
};

/// Least density.
pub static THRESHOLD: Setting = Setting {
    name: "threshold",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1e38, default: 0.0 },
    help: "density below which particles are left out, in the data's units; 0: chosen from the data",
};

/// Place of the automatic threshold in the range of densities.
pub const PLACE: f32 = 0.62;

struct Spheres;

impl Technique for Spheres {
    fn output(&self) -> Output {
        Output::Light
    }

    fn needs(&self, _: &Settings) -> Needs {
        Needs { densities: true, margin_px: NEIGHBOURHOOD, ..Needs::default() }
    }

    fn draw(&self, job: &Job<'_>) -> Result<Raw, VolumeError> {
        let look = Look::new(job)?;
        let settings = job.settings;
        let threshold = match settings.number(&THRESHOLD) {
            set if set > 0.0 => set,
            _ => look.density_at(PLACE),
        };
        if threshold > job.densest {
            return Err(VolumeError::Setting {
                field: "threshold",
                found: threshold.to_string(),
                expected: format!("a density of at most the data's largest, {}", job.densest),
            });
        }
        let options = SphereOptions {
            radius: settings.number(&RADIUS),
            least: threshold,
            smoothing: settings.number(&SMOOTHING),
            near: look.options.near,
            far: look.options.far,
        };
        let (mut surface, mut report) = front(job.view, job.batches, &options)?;
        let start = Instant::now();
        surface.smooth(job.view, options.smoothing);
        let gradient = look.transfer.color_map.sample(256);
        let color = |density: f32, attribute: f32| match look.classifier.has_hues() {
            true => look.classifier.tinted(attribute, SURFACE_BRIGHTNESS),
            false => look.surface_color(&gradient, f64::from(density)),
        };
        let light = grid::light(settings);
        let colors = surface.shade(job.view, light.as_ref(), color);
        report.rendering = start.elapsed();
        Ok(Raw::Light(LightPicture { colors, report, levels: look.levels, isovalues: vec![threshold] }))
    }
}

/// Particles weigh their mass and are left out by their own density.
pub static MODE: Mode = Mode {
    name: "spheres",
    help: "dense particles as spheres under one surface that is smoothed in the picture; coloured by density or attribute",
    settings: &[&[&THRESHOLD, &RADIUS, &SMOOTHING], grid::LIGHT, &[&grid::NEAR, &grid::FAR]],
    technique: &Spheres,
    ..grid::MODE
};
