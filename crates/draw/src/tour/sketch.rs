//! Pictures of a tour's looks, drawn by the processor from the page file itself: to find the ranges of their colours in advance, and
//! for what another picture is blended with.

use super::exposure::Measured;
use crate::color::composite::composite_at;
use crate::color::transfer::{Levels, TransferFunction};
use crate::color::{Accumulation, Image};
use crate::cpu::volume::{Processor, VolumeError};
use crate::cpu::{Method, SplatError, SplatOptions};
use crate::hierarchy::Purpose;
use crate::look::{Camera, ERROR_PX, LookPatch};
use crate::mode::{Depiction, Footprint, Plan};
use crate::picture::around::{Alike, sketch, with_images};
use crate::picture::look::{self, transfer_of};
use crate::picture::paint::{Subject, densest_of, find_levels, paint_nodes};
use crate::picture::panorama::assemble;
use crate::picture::{governor, pilot, processor};
use crate::store::{Metadata, StoreError};
use crate::stream::Scene;
use crate::view::perspective_grid::GridError;
use crate::view::{Detail, Panorama, Sampling, Sections, Surround, View, ViewError};
use std::sync::Arc;
use thiserror::Error;

/// Pixels along the shorter side of a picture that ranges are found from, at most: they hardly depend on it, and so they are the
/// same for a window and for a recording of any size.
const SIDE: u32 = 540;
/// How the faces of a panorama are sampled: with a few more pixels than it has, since splats may be as small as one.
const FACES: Sampling = Sampling { oversampling: 1.5, density: 1.5, margin: 0 };

/// A picture that cannot be drawn.
#[derive(Debug, Error)]
pub enum SketchError {
    /// The look does not fit the data.
    #[error("{0}")]
    Depiction(String),
    /// A camera that sees nothing.
    #[error(transparent)]
    View(#[from] ViewError),
    /// A page file that cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Columns that do not fit together.
    #[error(transparent)]
    Raster(#[from] SplatError),
    /// A volume that cannot be drawn.
    #[error(transparent)]
    Volume(#[from] VolumeError),
}

/// How large a tour's pictures are, and which directions they show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Format {
    /// Width and height, pixels.
    pub size: (u32, u32),
    /// How directions become a picture.
    pub surround: Surround,
}

impl Format {
    /// The format of pictures that ranges are found from. Discs of a fixed number of pixels cover another share of a smaller
    /// picture, and are brighter in it, so that these need pictures as large as those that are shown.
    fn sketch(self, footprint: Footprint) -> Format {
        let (width, height) = self.size;
        let shrink = match footprint {
            Footprint::Pixels(_) => 1.0,
            Footprint::Kernel => (f64::from(SIDE) / f64::from(width.min(height).max(1))).min(1.0),
        };
        let side = |pixels: u32| ((f64::from(pixels) * shrink).round() as u32).max(1);
        Format { size: (side(width), side(height)), ..self }
    }
}

/// A look's mode and attribute on the data.
///
/// # Errors
/// When they do not fit the data.
pub fn depict(look: &LookPatch, metadata: &Metadata) -> Result<Depiction, SketchError> {
    look::depict(look, metadata).map_err(SketchError::Depiction)
}

/// Shows the families and levels of a look from now on.
fn choose(scene: &mut Scene, look: &LookPatch, depiction: &Depiction, metadata: &Metadata) {
    let is_shown = |index: &u32| {
        let name = metadata.families.get(*index as usize).map(|family| family.name);
        look.families.as_ref().is_none_or(|shown| name.is_some_and(|name| shown.contains(&name)))
    };
    scene.families = (0..metadata.families.len() as u32).filter(is_shown).collect();
    let painted = depiction.mode.is_light();
    scene.purpose = if painted { depiction.purpose(metadata) } else { Purpose::Splats };
}

/// What is known of a look's picture from a camera: its ranges. Pages that cannot be read are told and left out.
///
/// # Errors
/// [`SketchError`] when the look does not fit the data, or nothing of it can be read.
pub fn measure(
    scene: &mut Scene,
    look: &LookPatch,
    camera: &Camera,
    format: Format,
    tell: &mut dyn FnMut(String),
) -> Result<Measured, SketchError> {
    let file = Arc::clone(scene.streamer.residency.tree());
    let metadata = file.metadata();
    let depiction = depict(look, metadata)?;
    choose(scene, look, &depiction, metadata);
    let transfer = transfer_of(look, &depiction);
    let (width, height) = format.sketch(depiction.footprint()).size;
    let is_flat = format.surround.is_flat();
    let middle = if is_flat { camera.target } else { camera.eye };
    let mut view =
        look.cut.unwrap_or_default().applied(&camera.view(width, height)?, middle.into(), metadata.periodic_box());
    view.cut.around = !is_flat && view.cut.fade_rate > 0.0;
    let tau = look.error_px.unwrap_or(ERROR_PX);
    let panorama = Panorama::around(&view, format.surround)?;
    let levels = match (depiction.mode.is_light(), panorama) {
        (false, None) => transfer.levels(&splats(scene, look, &depiction, &transfer, (&view, tau, u64::MAX), tell)?.0),
        (false, Some(panorama)) => {
            let options = SplatOptions { kernel: metadata.kernel, ..SplatOptions::default() };
            let pixel = panorama.pixel_angle();
            let sections = Sections::new(panorama, None, FACES);
            let texels = assemble(&sections, &view, |face| {
                let seen = match depiction.footprint() {
                    Footprint::Kernel => *face,
                    // A face's pixels are narrower towards its edges, by half and more.
                    Footprint::Pixels(radius) => face.padded((3.0 * f64::from(radius)).ceil() as u32),
                };
                let selection = scene.converge(&seen, tau * sections.oversampling(), tell)?;
                let nodes = processor::cut(face, processor::decode(&depiction, metadata, &selection.nodes));
                let batches = processor::batches(&depiction, &nodes)?;
                let known = || (metadata.bounds(), densest_of(metadata));
                let (drawn, _) = processor::draw_face(face, &depiction, &batches, pixel, options, known)?;
                Ok::<_, SketchError>(drawn.into())
            })?;
            transfer.levels(&texels.accumulation(depiction.attribute.is_some()))
        }
        (true, None) => {
            let selection = scene.converge(&view, depiction.detail(&view, tau, metadata), tell)?;
            let nodes = processor::cut(&view, processor::decode(&depiction, metadata, &selection.nodes));
            let found = find_levels(&view, &depiction, metadata, &nodes, &transfer)?;
            Levels { p: found.density, s: found.attribute }
        }
        (true, Some(panorama)) => {
            // Those of all the data, as all faces have them.
            let bounds = with_images(&view, metadata.bounds());
            let all = sketch(&view, bounds)?;
            let detail = match scene.purpose {
                Purpose::Splats => Detail::Error { tau: 1.0 },
                Purpose::Samples => Detail::Sampling { sigma: 1.0 / all.focal_pixels(), near: 0.0 },
            };
            let selection = scene.converge(&all, detail, tell)?;
            let nodes = processor::cut(&view, processor::decode(&depiction, metadata, &selection.nodes));
            let batches = (&processor::batches(&depiction, &nodes)?[..], metadata.kernel);
            let alike = Alike::new(&view, &depiction, bounds, panorama.pixel_angle(), Some(&transfer), batches)?;
            // No picture is asked for ranges that are numbers by now.
            alike.transfer.levels(&Accumulation::default())
        }
    };
    let attribute = depiction.attribute.map(|coloring| coloring.name);
    Ok(Measured { mode: depiction.mode, attribute, transfer, levels })
}

/// How a picture is drawn.
#[derive(Clone, Copy, Debug)]
pub struct Drawing {
    /// Ranges of its colours; its own without.
    pub levels: Option<Levels>,
    /// The data's diameter without far outliers, world units.
    pub diameter: f64,
    /// How many particles it may take.
    pub limit: u64,
}

/// A look's picture of a view, black where nothing is in view; and how many particles it took.
///
/// # Errors
/// As [`measure`].
pub fn draw(
    scene: &mut Scene,
    look: &LookPatch,
    view: &View,
    Drawing { levels, diameter, limit }: Drawing,
    tell: &mut dyn FnMut(String),
) -> Result<(Image, u64), SketchError> {
    let file = Arc::clone(scene.streamer.residency.tree());
    let metadata = file.metadata();
    let depiction = depict(look, metadata)?;
    choose(scene, look, &depiction, metadata);
    let mut transfer = transfer_of(look, &depiction);
    let tau = look.error_px.unwrap_or(ERROR_PX);
    if !depiction.mode.is_light() {
        let (picture, taken) = splats(scene, look, &depiction, &transfer, (view, tau, limit), tell)?;
        let levels = levels.unwrap_or_else(|| transfer.levels(&picture));
        return Ok((composite_at(&picture, &transfer, &levels), taken));
    }
    if let Some(levels) = levels {
        transfer = transfer.with_levels(&levels);
    }
    let selection = scene.converge(view, depiction.detail(view, tau, metadata), tell)?;
    let important = governor::most_important(&depiction, metadata);
    let (plan, taken) =
        governor::within(limit, Plan::default(), view, &depiction, metadata, &selection.nodes, &important);
    let nodes = processor::decode_planned(view, &depiction, metadata, &selection.nodes, &plan);
    let subject = Subject { transfer: Some(&transfer), diameter, caster: &Processor };
    match paint_nodes(view, &depiction, metadata, &nodes, &subject) {
        Ok(painted) => Ok((painted.colors.image(), taken)),
        Err(VolumeError::Grid(GridError::NothingInView)) => {
            let rgba = vec![[0, 0, 0, 255]; view.width as usize * view.height as usize];
            Ok((Image { width: view.width, height: view.height, rgba }, taken))
        }
        Err(error) => Err(error.into()),
    }
}

/// `P` and `S` of a view, of so many particles at most; and how many it took.
fn splats(
    scene: &mut Scene,
    look: &LookPatch,
    depiction: &Depiction,
    transfer: &TransferFunction,
    (view, tau, limit): (&View, f64, u64),
    tell: &mut dyn FnMut(String),
) -> Result<(Accumulation, u64), SketchError> {
    let file = Arc::clone(scene.streamer.residency.tree());
    let metadata = file.metadata();
    let selection = scene.converge(&depiction.selection_view(view), tau, tell)?;
    let economy = look.budget.file_economy();
    let plan = pilot::plan(view, depiction, metadata, &selection.nodes, &economy, transfer, None)?;
    let important = governor::most_important(depiction, metadata);
    let (plan, taken) = governor::within(limit, plan, view, depiction, metadata, &selection.nodes, &important);
    let nodes = processor::decode_planned(view, depiction, metadata, &selection.nodes, &plan);
    Ok((processor::draw_planned(view, depiction, metadata, &nodes, Method::Pyramid, &plan)?.0, taken))
}
