//! What modes of images and volumes share: how near their values have to be, and what their colours come to.

use super::grid::{self, Layers, OPACITY};
use super::shadowing;
use super::slice_overlay;
use crate::color::colors::to_linear;
use crate::color::transfer::{Curve, Hue, Range, TransferFunction, UnitLength};
use crate::cpu::field::plane::{self, Plane};
use crate::cpu::field::{FieldBricks, ValueAxis};
use crate::cpu::paths::PathFragments;
use crate::cpu::shadowing::{Casters, Shadowing, covering_depths};
use crate::cpu::slice::Slice;
use crate::cpu::slice::arrows::ArrowKey;
use crate::cpu::volume::bricks::BrickGrid;
use crate::cpu::volume::{Classifier, Scenery, VolumeError, VolumeLevels, VolumeReport, cast, cast_in_parts};
use crate::mode::{
    FieldJob, FieldMarch, FieldPasses, FieldValues, Job, LightPicture, Mode, Output, Raw, Setting, SettingKind,
    Settings, Technique,
};
use crate::model::Kernel;
use crate::view::perspective_grid::{GridOptions, depth_range, planes, seen};
use crate::view::{Extent, PerspectiveGrid, Projection, View};
use glam::{DAffine3, DVec3};

/// How far a value may be off.
pub static ERROR_VALUE: Setting = Setting {
    name: "error-value",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1e30, default: 0.0 },
    help: "of images and volumes: how far values may be from the samples'; 0: half a step of whole numbers, a 512th of the range of others",
};
/// How far a colour may be off.
pub static TRANSFER_SENSITIVITY: Setting = Setting {
    name: "transfer-sensitivity",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 255.0, default: 0.5 },
    help: "of images and volumes: one point shows all values whose opacities and colours differ by no more than this, of 255; 0: none",
};

/// What a number of points keeps small.
pub static WEIGHTING: Setting = Setting {
    name: "weighting",
    unit: "",
    kind: SettingKind::Choice { options: &["rms", "max", "perceptual"] },
    help: "of images and volumes drawn from a number of points: whether these keep the mean squared error small, the largest one, or errors \
           as well as the eye sees them, by their cycles a degree",
};

/// Settings of every mode of images and volumes.
pub static SAMPLES: &[&Setting] = &[&ERROR_VALUE, &TRANSFER_SENSITIVITY, &WEIGHTING];

/// Width of a cell of the perspective grid in samples of the field: narrower ones would show nothing more.
const CELL: f64 = 0.67;
/// Cells a pixel are never fewer.
const RESOLUTION_LEAST: f64 = 0.05;

/// What the colours of a field come to.
pub struct FieldLook {
    /// The transfer function in use.
    pub transfer: TransferFunction,
    /// Numbers for its ranges.
    pub levels: VolumeLevels,
    /// The field's values as numbers.
    pub axis: ValueAxis,
    /// Its tables for these.
    pub classifier: Classifier,
    /// The isosurfaces' values.
    pub isovalues: Vec<f64>,
}

impl FieldLook {
    /// What settings and a transfer function come to for values.
    ///
    /// # Errors
    /// [`VolumeError`] for settings that do not fit the values.
    pub fn new(
        values: &FieldValues<'_>,
        settings: &Settings,
        transfer: Option<&TransferFunction>,
        diameter: f64,
        layers: &Layers,
    ) -> Result<FieldLook, VolumeError> {
        let mut transfer = transfer.cloned().unwrap_or_else(|| FieldLook::usual(values));
        if values.hue.is_some() && values.is_volume {
            transfer = transfer.for_volume();
        }
        let density = match transfer.range {
            Range::Fixed(low, high) => transfer.scale.usable([low, high]),
            Range::Auto if values.is_volume => values.shown.matter(transfer.scale),
            Range::Auto => transfer.scale.usable([0.002, 0.998].map(|share| values.shown.percentile(share))),
        };
        let hue = transfer.hue.clone().unwrap_or_default();
        let of_hue = |share: f64| values.hue.map_or(share, |values| values.percentile(share));
        let attribute = match hue.range {
            Range::Fixed(low, high) => [low, high],
            Range::Auto => Range::apart([0.02, 0.98].map(of_hue)),
        };
        let unit = match transfer.unit_length {
            UnitLength::Auto => 0.01 * diameter,
            UnitLength::Fixed(length) => length,
        };
        let unit_length = unit.max(1e-30) / settings.number(&OPACITY);
        let levels = VolumeLevels { density, attribute: hue.scale.usable(attribute), unit_length };
        let isovalues: Vec<f64> = match settings.numbers(&grid::ISOVALUES) {
            _ if layers.surfaces.is_empty() => Vec::new(),
            [] => layers.surfaces.iter().map(|&(place, _)| transfer.scale.value(place, density)).collect(),
            set => set.to_vec(),
        };
        let [least, most] = values.shown.range();
        if let Some((index, &value)) =
            isovalues.iter().enumerate().find(|(_, value)| !(least..=most).contains(*value)).filter(|_| {
                // Those that were chosen may lie outside of what there is.
                !settings.numbers(&grid::ISOVALUES).is_empty()
            })
        {
            let (field, found) = ("isovalues", format!("{value} (number {})", index + 1));
            return Err(VolumeError::Setting { field, found, expected: format!("values from {least} to {most}") });
        }
        // A little beyond what colours tell apart, so that what lies there is cut off where it does not show.
        let ends = isovalues.iter().fold(density, |[low, high], value| [low.min(*value), high.max(*value)]);
        let beyond = 0.02 * (ends[1] - ends[0]);
        let axis = ValueAxis::new(transfer.scale, [(ends[0] - beyond).max(least.min(ends[0])), ends[1] + beyond]);
        let classifier = Classifier::of_values(&transfer, levels, values.hue.is_some(), &axis);
        if values.hue.is_none() {
            // Colours are the colour map's at the values' places: what a legend shows.
            transfer.brightness = Some(Curve::identity());
        }
        Ok(FieldLook { transfer, levels, axis, classifier, isovalues })
    }

    /// The transfer function of values that nobody has chosen one for.
    pub fn usual(values: &FieldValues<'_>) -> TransferFunction {
        let usual = match (values.is_volume, values.hue) {
            (false, None) => TransferFunction::preset("grey").unwrap_or_default(),
            (_, hue) => TransferFunction::of_values(hue.is_some()),
        };
        TransferFunction { scale: values.shown.scale(), ..usual }
    }

    /// The same for pictures of a mode: where colours tell something else than values, they are the mode's usual ones.
    pub fn usual_of(mode: &Mode, settings: &Settings, values: &FieldValues<'_>) -> TransferFunction {
        let usual = FieldLook::usual(values);
        match mode.technique.own_colors(settings, &usual) {
            None => usual,
            Some(_) => {
                let own = TransferFunction::preset(mode.transfer[0]).unwrap_or_default();
                TransferFunction { color_map: own.color_map, ..usual }
            }
        }
    }

    /// What is drawn.
    fn scenery(&self, settings: &Settings, layers: &Layers) -> Result<Scenery, VolumeError> {
        let gradient = self.transfer.color_map.sample(256);
        let color = |value: f64| {
            grid::color_at(&gradient, f64::from(self.transfer.scale.place(value as f32, self.levels.density)))
        };
        let mut surfaces = grid::surfaces(settings, &self.isovalues, layers, self.classifier.has_hues(), color)?;
        surfaces.iter_mut().zip(&self.isovalues).for_each(|(surface, value)| {
            surface.value = self.axis.place(*value as f32);
        });
        Ok(Scenery {
            classifier: self.classifier.clone(),
            volume: layers.volume,
            surfaces,
            light: grid::light(settings),
            volume_light: grid::volume_light(settings),
            termination: settings.number(&grid::TERMINATION) as f32,
        })
    }
}

/// What marching along rays through the perspective grid shows of layers of a field.
///
/// # Errors
/// [`VolumeError`] for settings that do not fit the field, and when nothing is in view.
pub fn plan(job: &FieldJob<'_>, layers: &Layers) -> Result<FieldMarch, VolumeError> {
    let FieldJob { view, field, settings, .. } = *job;
    let look = FieldLook::new(&job.values, settings, job.transfer, job.diameter, layers)?;
    let scenery = look.scenery(settings, layers)?;
    let options = grid::options(settings, Kernel::default());
    let extent = Extent { bounds: field.bounds(), margin: 0.0 };
    let is_deep = matches!(view.projection, Projection::Perspective { .. });
    let range = depth_range(view, seen(view, [extent], 0.0));
    let ends = planes(range, options.near, options.far, is_deep)?;
    // In the middle of the way through; from within, where most of what is seen lies.
    let depth = if is_deep { (ends[0] * ends[1]).sqrt().max(0.5 * ends[1]) } else { 1.0 };
    let fine = depth / view.focal_pixels() / (CELL * field.spacing());
    let resolution = options.grid.resolution.min(fine.max(RESOLUTION_LEAST));
    let grid = PerspectiveGrid::new(view, ends, &GridOptions { resolution, ..options.grid })?;
    let FieldLook { axis, levels, isovalues, .. } = look;
    Ok(FieldMarch { grid, axis, scenery, options, levels, isovalues })
}

/// Draws layers of a field by marching along rays through the perspective grid.
///
/// # Errors
/// As [`plan`].
pub fn march(job: &FieldJob<'_>, layers: &Layers) -> Result<LightPicture, VolumeError> {
    let FieldMarch { grid, axis, scenery, options, levels, isovalues } = plan(job, layers)?;
    let planes = [grid.near, grid.far];
    let mut report = VolumeReport { grid: grid.size, planes, slabs: 0, ..VolumeReport::default() };
    let brick_grid = BrickGrid::new(&grid);
    let mut bricks = bricks(job, axis, (&grid, &brick_grid), &scenery);
    let colors = cast(job.view, (&grid, &brick_grid), &mut bricks, &scenery, &options, job.paths, &mut report);
    // What hides particles is told by their sizes; nothing of a field is left out for it.
    report.opaque = None;
    Ok(LightPicture { colors, report, levels, isovalues })
}

/// The same where surfaces darken each other.
///
/// # Errors
/// As [`plan`].
pub fn march_darkened(job: &FieldJob<'_>, layers: &Layers, shadowing: &Shadowing) -> Result<LightPicture, VolumeError> {
    let (parts, (report, levels, isovalues)) = darkened_parts(job, layers, shadowing)?;
    Ok(LightPicture { colors: shadowing::colors_among(&parts, job.paths), report, levels, isovalues })
}

/// What layers of a field show in each pixel, in parts from front to back that something else is drawn among; its surfaces may darken each other.
///
/// # Errors
/// As [`plan`].
pub fn march_in_parts(
    job: &FieldJob<'_>,
    layers: &Layers,
    shadowing: Option<&Shadowing>,
) -> Result<PathFragments, VolumeError> {
    Ok(match shadowing {
        Some(shadowing) => darkened_parts(job, layers, shadowing)?.0,
        None => parts(job, plan(job, layers)?).0,
    })
}

/// What a picture tells beside its colours: its report, their ranges, and the isosurfaces' values.
type Told = (VolumeReport, VolumeLevels, Vec<f64>);

fn parts(job: &FieldJob<'_>, march: FieldMarch) -> (PathFragments, Told) {
    let FieldMarch { grid, axis, scenery, options, levels, isovalues } = march;
    let planes = [grid.near, grid.far];
    let mut report = VolumeReport { grid: grid.size, planes, slabs: 0, ..VolumeReport::default() };
    let brick_grid = BrickGrid::new(&grid);
    let mut bricks = bricks(job, axis, (&grid, &brick_grid), &scenery);
    let parts = cast_in_parts(job.view, (&grid, &brick_grid), &mut bricks, &scenery, &options, &mut report);
    report.opaque = None;
    (parts, (report, levels, isovalues))
}

fn darkened_parts(
    job: &FieldJob<'_>,
    layers: &Layers,
    shadowing: &Shadowing,
) -> Result<(PathFragments, Told), VolumeError> {
    let (mut parts, told) = parts(job, plan(job, layers)?);
    shadowing.darken_fragments(job.view, &mut parts, &*casters(job, layers), job.lighting.others.as_ref());
    Ok((parts, told))
}

/// How the surfaces among layers of a field hide light. What is not there for a lamp casts no shadow.
pub fn casters<'j>(job: &'j FieldJob<'j>, layers: &'j Layers) -> Box<Casters<'j>> {
    // These planes are at depths from the eye.
    let beyond = job.settings.filtered(|name| name != grid::NEAR.name && name != grid::FAR.name);
    Box::new(move |view: &View| {
        let settings = if view == job.view { job.settings } else { &beyond };
        let job = FieldJob { view, settings, ..*job };
        let march = plan(&job, layers).ok()?;
        let march = FieldMarch { scenery: march.scenery.casting()?, ..march };
        Some(covering_depths(&parts(&job, march).0))
    })
}

/// What fills the perspective grid from a field.
fn bricks<'a>(
    job: &FieldJob<'a>,
    axis: ValueAxis,
    (grid, brick_grid): (&'a PerspectiveGrid, &'a BrickGrid),
    scenery: &Scenery,
) -> FieldBricks<'a> {
    let mut bricks = FieldBricks::new(job.field, axis, job.view, grid, brick_grid);
    (bricks.hue, bricks.least) = (job.hue, scenery.least());
    bricks
}

/// A picture's colours of the values of a field's channels, light and opacity: its own, or those of a transfer function.
///
/// # Errors
/// As [`FieldLook::new`].
pub fn colors_of(
    job: &FieldJob<'_>,
) -> Result<(VolumeLevels, impl Fn(&[f32]) -> [f32; 4] + Sync + use<>), VolumeError> {
    let values = FieldValues { is_volume: false, ..job.values };
    let look = FieldLook::new(&values, job.settings, job.transfer, job.diameter, &Layers::VOLUME)?;
    let full_light = job.field.full_light;
    let hue = job.hue;
    let levels = look.levels;
    let of_values = colors_at(&look.transfer, levels);
    let color = move |values: &[f32]| {
        if values[0].is_nan() {
            return [0.0; 4];
        }
        if let (Some(full), [r, g, b, rest @ ..]) = (full_light, values) {
            let light = [r, g, b].map(|value| to_linear((value / full).clamp(0.0, 1.0)));
            return [light[0], light[1], light[2], rest.first().map_or(1.0, |alpha| (alpha / full).clamp(0.0, 1.0))];
        }
        let [r, g, b] = of_values(values[0], hue.map(|hue| values[hue]));
        [r, g, b, 1.0]
    };
    Ok((levels, color))
}

/// A transfer function's colours of values in these ranges, and of what colours them where something does, linear light.
pub fn colors_at(
    transfer: &TransferFunction,
    levels: VolumeLevels,
) -> impl Fn(f32, Option<f32>) -> [f32; 3] + Sync + use<> {
    let (of_value, range) = (transfer.scale, levels.density);
    let lut = transfer.bake_colors();
    let scale = transfer.hue.clone().map_or_else(|| Hue::default().scale, |hue| hue.scale);
    move |value: f32, hue: Option<f32>| {
        let column = of_value.place(value, range) * (lut.width - 1) as f32;
        let row = hue.map_or(0.0, |hue| scale.place(hue, levels.attribute)) * (lut.height - 1) as f32;
        let texel = |column: usize| {
            let at = row.round() as usize * lut.width as usize + column.min(lut.width as usize - 1);
            lut.rgba[at].map(|byte| f32::from(byte) / 255.0)
        };
        let (low, high, share) = (texel(column as usize), texel(column as usize + 1), column.fract());
        [0, 1, 2].map(|k| to_linear(low[k] + share * (high[k] - low[k])))
    }
}

/// What lies on a plane, in its colours.
///
/// # Errors
/// As [`FieldLook::new`], and where a vector field is wanted that there is none of.
pub fn on_plane(job: &FieldJob<'_>, plane: &Plane) -> Result<Raw, VolumeError> {
    let (levels, slice, arrows) = slice_of(job, plane)?;
    let (colors, report) = (slice.colors(), VolumeReport { arrows: arrows.map(Box::new), ..VolumeReport::default() });
    Ok(Raw::Light(LightPicture { colors, report, levels, isovalues: Vec::new() }))
}

/// What lies on a plane, in its colours, as parts of pixels that something else is drawn among.
///
/// # Errors
/// As [`on_plane`].
pub fn parts_of_plane(job: &FieldJob<'_>, plane: &Plane) -> Result<PathFragments, VolumeError> {
    Ok(slice_of(job, plane)?.1.fragments())
}

/// What lies on a plane, with what settings have drawn over it, and how long arrows are.
fn slice_of(job: &FieldJob<'_>, plane: &Plane) -> Result<(VolumeLevels, Slice, Option<ArrowKey>), VolumeError> {
    let (levels, color) = colors_of(job)?;
    let overlay = slice_overlay::of(job.settings);
    let names: Vec<&str> = job.field.channels.iter().map(|channel| channel.name.as_str()).collect();
    let vector = overlay.vectors.map(|_| slice_overlay::channels(job.settings, &names)).transpose()?;
    let wanted = plane::Wanted { values: overlay.contours.is_some(), vector };
    let mut slice = plane::slice(job.view, job.field, plane, wanted, color);
    let arrows = slice.decorate(&overlay);
    Ok((levels, slice, arrows))
}

/// How a mode that draws images or volumes alone is drawn.
pub struct OfFields {
    /// What its pictures are made of.
    pub output: Output,
    /// What it draws: images, of 2 dimensions, or volumes, of 3.
    pub dimensions: &'static [usize],
    /// Whether it draws the line integrals that adapters draw too.
    pub is_integral: bool,
    /// See [`Technique::facing`].
    pub facing: Option<fn(&Settings, &DAffine3) -> Option<DVec3>>,
    /// Draws one of the kind.
    pub draw: fn(&FieldJob<'_>) -> Result<Raw, VolumeError>,
    /// See [`Technique::field_parts`].
    pub parts: Option<fn(&FieldJob<'_>) -> Result<PathFragments, VolumeError>>,
}

impl Technique for OfFields {
    fn output(&self) -> Output {
        self.output
    }

    fn takes_particles(&self) -> bool {
        false
    }

    fn field_dimensions(&self) -> &'static [usize] {
        self.dimensions
    }

    fn facing(&self, settings: &Settings, to_world: &DAffine3) -> Option<DVec3> {
        self.facing.and_then(|facing| facing(settings, to_world))
    }

    fn draw(&self, _: &Job<'_>) -> Result<Raw, VolumeError> {
        Err(VolumeError::OnlyFields)
    }

    fn has_field_passes(&self) -> bool {
        self.is_integral
    }

    fn field_passes(&self, _: &FieldJob<'_>) -> Result<Option<FieldPasses>, VolumeError> {
        Ok(self.is_integral.then_some(FieldPasses::Integrals))
    }

    fn draw_field(&self, job: &FieldJob<'_>) -> Result<Raw, VolumeError> {
        (self.draw)(job)
    }

    fn has_field_parts(&self) -> bool {
        self.parts.is_some()
    }

    fn field_parts(&self, job: &FieldJob<'_>) -> Result<PathFragments, VolumeError> {
        self.parts.map_or(Err(VolumeError::OnlyAlone), |parts| parts(job))
    }
}
