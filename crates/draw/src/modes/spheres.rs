//! `spheres`: particles as spheres with a surface smoothed in the picture (F12 5.9).

use super::grid::{self, Look};
use super::shadowing;
use crate::color::transfer::Scale;
use crate::cpu::screen_spheres::{NEIGHBOURHOOD, SphereOptions, SurfaceColors, front};
use crate::cpu::shadowing::{Casters, Lighting, Shadowing};
use crate::cpu::volume::VolumeError;
use crate::cpu::volume::classify::BRIGHTNESSES;
use crate::cpu::volume::raycast::SURFACE_BRIGHTNESS;
use crate::mode::{
    Adapter, FindRanges, Job, LightPasses, LightPicture, LightPlan, Mode, Needs, Output, Raw, Setting, SettingKind,
    Settings, Technique, Terms,
};
use crate::view::View;
use std::sync::Arc;
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

/// The least density of a particle that is drawn.
fn threshold(look: &Look, terms: &Terms<'_>) -> Result<f64, VolumeError> {
    let threshold = match terms.settings.number(&THRESHOLD) {
        set if set > 0.0 => set,
        _ => look.density_at(PLACE),
    };
    if threshold > terms.densest {
        return Err(VolumeError::Setting {
            field: "threshold",
            found: threshold.to_string(),
            expected: format!("a density of at most the data's largest, {}", terms.densest),
        });
    }
    Ok(threshold)
}

fn options(look: &Look, settings: &Settings, least: f64) -> SphereOptions {
    SphereOptions {
        radius: settings.number(&RADIUS),
        least,
        smoothing: settings.number(&SMOOTHING),
        near: look.options.near,
        far: look.options.far,
        occlusion: look.options.occlusion,
    }
}

/// Steps of a colour map on surfaces.
const STEPS: usize = 200;

/// The colours of the surface: those of the attribute, or of the density where there is none.
pub fn surface_colors(look: &Look) -> SurfaceColors {
    let opaque = |[r, g, b]: [f32; 3]| [r, g, b, 1.0];
    if look.classifier.has_hues() {
        let tables = look.classifier.tables();
        let column = (SURFACE_BRIGHTNESS * (BRIGHTNESSES - 1) as f32).round() as usize;
        let colors = tables.hues.chunks(BRIGHTNESSES).map(|row| opaque(row[column])).collect();
        return SurfaceColors { colors, of_attribute: true, scale: tables.scale, range: tables.attribute };
    }
    let gradient = look.transfer.color_map.sample(256);
    let color = |step: usize| opaque(look.surface_color(&gradient, look.density_at(step as f32 / STEPS as f32)));
    let colors = (0..=STEPS).map(color).collect();
    SurfaceColors { colors, of_attribute: false, scale: Scale::Log, range: look.levels.density }
}

/// The depths of the surface from any view; planes are at depths from the eye.
fn casters<'j>(job: &'j Job<'j>, options: SphereOptions) -> Box<Casters<'j>> {
    Box::new(move |from: &View| {
        let own = if from == job.view { options } else { options.for_lamp() };
        let (mut seen, _) = front(from, job.batches, job.density_scale, &own).ok()?;
        seen.smooth(from, own.smoothing);
        Some(seen.depths())
    })
}

impl Technique for Spheres {
    fn output(&self) -> Output {
        Output::Light
    }

    fn needs(&self, settings: &Settings) -> Needs {
        let own = Needs { densities: true, margin_px: NEIGHBOURHOOD, hides: true, ..Needs::default() };
        shadowing::needs(own, settings)
    }

    fn is_darkened(&self, settings: &Settings) -> bool {
        shadowing::is_on(settings)
    }

    fn shadowing(&self, settings: &Settings, view: &View, lighting: &Lighting<'_>, diameter: f64) -> Option<Shadowing> {
        shadowing::beside_eye(settings, view, lighting, diameter)
    }

    fn meets_surfaces(&self) -> bool {
        true
    }

    fn adapter(&self) -> Adapter {
        Adapter::Light
    }

    fn light(&self, terms: &Terms<'_>, ranges: &mut FindRanges<'_>) -> Result<Option<LightPlan>, VolumeError> {
        let look = Look::of(terms, ranges)?;
        let threshold = threshold(&look, terms)?;
        let passes = LightPasses::Spheres {
            options: options(&look, terms.settings, threshold),
            light: grid::light(terms.settings),
            colors: surface_colors(&look),
            density_scale: terms.density_scale,
        };
        Ok(Some(LightPlan { passes, levels: look.levels, isovalues: vec![threshold] }))
    }

    fn casters<'j>(&'j self, job: &'j Job<'j>) -> Result<Option<Box<Casters<'j>>>, VolumeError> {
        let look = Look::new(job)?;
        let threshold = threshold(&look, &job.terms())?;
        Ok(Some(casters(job, options(&look, job.settings, threshold))))
    }

    fn draw(&self, job: &Job<'_>) -> Result<Raw, VolumeError> {
        let look = Look::new(job)?;
        let settings = job.settings;
        let threshold = threshold(&look, &job.terms())?;
        let options = options(&look, settings, threshold);
        let (mut surface, mut report) = front(job.view, job.batches, job.density_scale, &options)?;
        let start = Instant::now();
        report.opaque = options.occlusion.then(|| Arc::new(surface.opaque(job.view, options.radius)));
        surface.smooth(job.view, options.smoothing);
        let gradient = look.transfer.color_map.sample(256);
        let color = |density: f32, attribute: f32| match look.classifier.has_hues() {
            true => look.classifier.tinted(attribute, SURFACE_BRIGHTNESS),
            false => look.surface_color(&gradient, f64::from(density)),
        };
        let light = grid::light(settings);
        let mut colors = surface.shade(job.view, light.as_ref(), color);
        if let Some(shadowing) = self.shadowing(settings, job.view, &job.lighting, job.diameter) {
            let (covering, others) = (surface.covering(options.smoothing), job.lighting.others.as_ref());
            shadowing.darken_covering(job.view, &covering, &mut colors, &*casters(job, options), others);
        }
        if let Some(surfaces) = job.paths {
            surface.lie_among(surfaces, &mut colors);
        }
        report.rendering = start.elapsed();
        Ok(Raw::Light(LightPicture { colors, report, levels: look.levels, isovalues: vec![threshold] }))
    }
}

/// Particles weigh their mass and are left out by their own density.
pub static MODE: Mode = Mode {
    name: "spheres",
    help: "dense particles as spheres under one surface that is smoothed in the picture; coloured by density or attribute",
    settings: &[
        &[&THRESHOLD, &RADIUS, &SMOOTHING],
        grid::LIGHT,
        &[&grid::NEAR, &grid::FAR, &grid::OCCLUSION],
        shadowing::BESIDE_EYE,
    ],
    technique: &Spheres,
    ..grid::MODE
};
