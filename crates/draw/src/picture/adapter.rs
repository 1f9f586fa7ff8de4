//! What a graphics adapter does for pictures that no window shows. Nothing here knows of one: a program that has adapters hands
//! one to its sessions.

use super::darkening;
use super::subject::Subject;
use crate::color::{Accumulation, Colors};
use crate::cpu::field::Field;
use crate::cpu::overdraw::Overdraw;
use crate::cpu::shadowing::Covering;
use crate::cpu::surface::holes::Holes;
use crate::cpu::surface::look::Look;
use crate::cpu::surface::photo::PhotoCut;
use crate::cpu::surface::select::Technique;
use crate::cpu::surface::stitch::Scene;
use crate::cpu::volume::{FieldRange, VolumeError, VolumeOptions, VolumeReport};
use crate::look::Backend;
use crate::mode;
use crate::mode::{Depiction, FieldPasses, LightPicture, LightPlan, Mode, Plan, Raw, Settings};
use crate::store::Metadata;
use crate::stream::SceneNode;
use crate::view::View;
use deepfield_heights::measure::Form;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A graphics adapter. What one does not do the processor does.
pub trait Adapter: Send + Sync {
    /// Whether it is a graphics card. A driver without one draws on the processor too, and slower than our own renderer.
    fn is_card(&mut self) -> bool;

    /// Draws nodes.
    ///
    /// # Errors
    /// [`VolumeError::Device`]: what is missing; others as [`crate::mode::Mode::draw`].
    fn draw(&mut self, _job: &AdapterJob<'_>) -> Result<AdapterFrame, VolumeError> {
        lacks("draw particles")
    }

    /// The same of modes with opaque surfaces, with what covers the picture's pixels; without colours where they are not wanted.
    ///
    /// # Errors
    /// As [`Adapter::draw`].
    fn draw_covering(
        &mut self,
        _job: &AdapterJob<'_>,
        _is_colored: bool,
    ) -> Result<(AdapterFrame, Covering), VolumeError> {
        lacks("tell what covers its pictures")
    }

    /// Draws a volume of samples.
    ///
    /// # Errors
    /// As [`Adapter::draw`].
    fn field(&mut self, _job: &AdapterField<'_>) -> Result<AdapterFrame, VolumeError> {
        lacks("draw volumes of samples")
    }

    /// Draws measured heights, seen by a camera that stands in a flat world.
    ///
    /// # Errors
    /// [`VolumeError::Device`]: what is missing.
    fn surface(&mut self, _job: Arc<AdapterSurface>) -> Result<AdapterFrame, VolumeError> {
        lacks("draw heights")
    }

    /// The same, with the number of what each of the picture's samples shows ([`Shown::pack`](crate::cpu::surface::raster::Shown::pack)), row by
    /// row, and [`NO_NUMBER`](crate::cpu::surface::raster::NO_NUMBER) where nothing is; without colours where they are not wanted.
    ///
    /// # Errors
    /// As [`Adapter::surface`].
    fn surface_seen(
        &mut self,
        _job: Arc<AdapterSurface>,
        _is_colored: bool,
    ) -> Result<(AdapterFrame, Vec<u32>), VolumeError> {
        lacks("tell what its pictures of heights show")
    }

    /// Between which values the mass of the nodes' field lies.
    ///
    /// # Errors
    /// [`VolumeError::Device`]: what is missing; [`VolumeError::Grid`] where nothing is in view.
    fn ranges(&mut self, _job: &AdapterJob<'_>, _options: &VolumeOptions) -> Result<FieldRange, VolumeError> {
        lacks("find the range of a field")
    }

    /// How many of the nodes' splats lie over each pixel: what [`crate::cpu::overdraw`] counts, but for rounding.
    ///
    /// # Errors
    /// [`VolumeError::Device`]: what is missing.
    fn overdraw(&mut self, _job: &AdapterJob<'_>) -> Result<Overdraw, VolumeError> {
        lacks("count the splats of pixels")
    }
}

/// The error of an adapter that does not do what it is asked for.
fn lacks<T>(what: &str) -> Result<T, VolumeError> {
    Err(VolumeError::Device(format!("the adapter does not {what}")))
}

/// What an adapter draws.
#[derive(Clone, Copy)]
pub struct AdapterJob<'a> {
    /// The camera and the picture's size.
    pub view: &'a View,
    /// The mode and the attribute.
    pub depiction: &'a Depiction,
    /// What is known of the data.
    pub metadata: &'a Metadata,
    /// What is drawn of it.
    pub nodes: &'a [SceneNode],
    /// What of that is left out.
    pub plan: &'a Plan,
    /// By which passes sums are drawn.
    pub passes: Passes,
    /// What is drawn of modes that draw light.
    pub light: Option<&'a LightPlan>,
    /// How often, for times.
    pub repeat: u32,
}

/// What an adapter draws of a volume of samples.
#[derive(Clone, Copy)]
pub struct AdapterField<'a> {
    /// The camera and the picture's size.
    pub view: &'a View,
    /// The samples. Those of the picture before are on the adapter already.
    pub field: &'a Arc<Field>,
    /// The channel that colours what the first one shows.
    pub hue: Option<usize>,
    /// By which passes, and with what.
    pub passes: &'a FieldPasses,
    /// How often, for times.
    pub repeat: u32,
}

/// What an adapter draws of measured heights.
pub struct AdapterSurface {
    /// The chunks that are drawn, and what they lie in. Samples of the picture before are on the adapter already.
    pub scene: Arc<Scene>,
    /// The camera, whose pixels are the samples of the picture.
    pub view: View,
    /// Samples along the side of a pixel of the picture; 1 at least.
    pub parts: u32,
    /// What it looks like.
    pub look: Look,
    /// The form that residuals are what is left of; without one they are heights.
    pub form: Option<Arc<Form>>,
    /// What is shown of the photo that lies over it, where that is what colours it.
    pub photo: Option<PhotoCut>,
    /// What it is drawn as.
    pub technique: Technique,
    /// The side of a point: samples, with [`Technique::Points`] pixels; 1 at least.
    pub point: u32,
    /// What is shown where nothing was measured; a membrane is in the scene.
    pub holes: Holes,
    /// The height that walls of a flat field go down or up to; `None`: there are none.
    pub walls: Option<f64>,
    /// A height in the middle of the field's, which others are counted from in 32 bits.
    pub reference: f64,
    /// By which passes.
    pub passes: Passes,
}

impl AdapterSurface {
    /// Width and height of the picture, pixels.
    pub fn size(&self) -> [u32; 2] {
        [self.view.width, self.view.height].map(|samples| samples / self.parts.max(1))
    }

    /// Whether the field stands on a globe.
    pub fn is_globe(&self) -> bool {
        !self.scene.placed.is_flat()
    }

    /// Whether rays find what is seen: compute passes cast them, and the rasteriser draws triangles in their place.
    pub fn casts_rays(&self) -> bool {
        self.technique == Technique::Rays && !self.is_raster()
    }

    /// Whether the adapter's rasteriser finds what is seen, and not compute passes.
    pub fn is_raster(&self) -> bool {
        self.passes == Passes::Raster
    }
}

/// Passes of an adapter that draw splats and surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Passes {
    /// The best that it has.
    Best,
    /// Compute passes.
    Compute,
    /// Rasterised discs.
    Raster,
}

/// What an adapter has drawn.
#[derive(Clone, Debug)]
pub struct AdapterFrame {
    /// The picture's values.
    pub values: AdapterValues,
    /// Splats that reach the picture, where they are counted.
    pub splats: Option<u64>,
    /// The passes that drew.
    pub backend: &'static str,
    /// Name and driver.
    pub adapter: String,
    /// Median of each pass, milliseconds.
    pub milliseconds: BTreeMap<String, f64>,
    /// Pixels that are covered by what was measured, of heights in colours.
    pub covered: Option<f64>,
    /// What is not as it was asked for, in a sentence.
    pub note: Option<String>,
}

/// The values of a picture.
#[derive(Clone, Debug)]
pub enum AdapterValues {
    /// `P` and `P S`.
    Sums(Accumulation),
    /// Colours, and what is known of the work.
    Light(Colors, VolumeReport),
}

/// Has an adapter draw a subject's picture: its values, and what else there is to say. Where surfaces darken each other, the processor does that to
/// what has been drawn.
///
/// # Errors
/// As [`Adapter::draw`].
pub fn draw_on(
    adapter: &mut dyn Adapter,
    subject: &Subject<'_>,
    job: AdapterJob<'_>,
) -> Result<(Raw, AdapterFrame), VolumeError> {
    let light = match subject.depiction.mode.is_light() {
        true if subject.depiction.draws_fields() => subject.light_of_fields(job.view, job.nodes, job.plan)?,
        true => subject.light(job.view, &mut |options| adapter.ranges(&job, options))?,
        false => None,
    };
    let mut frame = match subject.shadowing(job.view).zip(light.as_ref()) {
        Some((shadowing, plan)) => darkening::draw(adapter, (job, plan), &shadowing, subject.lighting.others.as_ref())?,
        None => adapter.draw(&AdapterJob { light: light.as_ref(), ..job })?,
    };
    let values = match (std::mem::replace(&mut frame.values, AdapterValues::Sums(Default::default())), light) {
        (AdapterValues::Light(colors, report), Some(LightPlan { levels, isovalues, .. })) => {
            Raw::Light(LightPicture { colors, report, levels, isovalues })
        }
        (AdapterValues::Sums(sums), None) => Raw::Sums(sums, Default::default()),
        _ => return Err(VolumeError::Device(format!("the adapter does not draw {}", subject.depiction.mode.name))),
    };
    Ok((values, frame))
}

/// Why nothing but the processor draws.
pub const WITHOUT_ADAPTER: &str = "this deepfield was built without the feature `viewer`, so only --backend cpu draws";

/// Whether an adapter draws images and volumes of a mode with settings for somebody who asks for `backend`; the processor draws all of them.
///
/// # Errors
/// What draws the mode, where the backend that is asked for does not.
pub fn draws_fields(
    mode: &Mode,
    settings: &Settings,
    backend: Option<Backend>,
    adapter: Option<&mut (dyn Adapter + 'static)>,
) -> Result<bool, String> {
    let has_passes = mode.technique.has_field_passes() && !mode.technique.is_darkened(settings);
    match (backend, adapter) {
        (Some(Backend::Compute | Backend::Raster), None) => Err(WITHOUT_ADAPTER.into()),
        (Some(Backend::Raster), Some(_)) if has_passes => {
            Err(format!("--backend: only compute and cpu draw the mode {}", mode.name))
        }
        (Some(Backend::Compute), Some(_)) => Ok(has_passes),
        (None, Some(adapter)) => Ok(has_passes && adapter.is_card()),
        _ => Ok(false),
    }
}

/// The passes of an adapter that draw a mode for somebody who asks for `backend`; `None` where the processor does.
///
/// # Errors
/// What draws the mode, where the backend that is asked for does not.
pub fn passes(
    depiction: &Depiction,
    backend: Option<Backend>,
    adapter: Option<&mut (dyn Adapter + 'static)>,
) -> Result<Option<Passes>, String> {
    use mode::Adapter as Has;
    let mode = depiction.mode;
    let on_processor = mode.technique.on_processor();
    let only = |names: &str| Err(format!("--backend: only {names} the mode {}", mode.name));
    let Some(adapter) = adapter else {
        return match backend {
            Some(Backend::Compute | Backend::Raster) => Err(WITHOUT_ADAPTER.into()),
            _ => Ok(None),
        };
    };
    match (backend, depiction.adapter()) {
        (Some(Backend::Cpu), _) | (None, Has::None) => Ok(None),
        (Some(Backend::Compute), Has::Splats | Has::Plugin | Has::Light) => Ok(Some(Passes::Compute)),
        (Some(Backend::Raster), Has::Splats) => Ok(Some(Passes::Raster)),
        (Some(_), Has::Plugin) if !on_processor => only("compute draws"),
        (Some(_), Has::Plugin | Has::Light) => only("compute and cpu draw"),
        (Some(_), _) => only("cpu draws"),
        (None, Has::Splats) => Ok(adapter.is_card().then_some(Passes::Best)),
        (None, Has::Light) => Ok(adapter.is_card().then_some(Passes::Compute)),
        (None, Has::Plugin) => Ok((!on_processor || adapter.is_card()).then_some(Passes::Compute)),
    }
}
