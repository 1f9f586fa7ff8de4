//! A picture drawn by the processor: of nodes of the open file, or of live particles.

use crate::color::transfer::{Levels, TransferFunction};
use crate::color::{Accumulation, Image};
use crate::cpu::Method;
use crate::cpu::volume::{Caster, OpaqueDepths, Processor, VolumeError};
use crate::mode::{Depiction, Economy, Plan};
use crate::model::{Dataset, Family, FamilyName};
use crate::picture::paint::{Subject, paint_nodes, paint_particles};
use crate::picture::{governor, pilot, processor};
use crate::store::PageFile;
use crate::stream::SceneNode;
use crate::view::View;
use crate::view::perspective_grid::GridError;
use bevy::prelude::UVec2;
use std::sync::Arc;

/// A picture in colours, and what they mean.
pub(super) struct PaintedPicture {
    pub image: Image,
    pub levels: Levels,
    pub transfer: TransferFunction,
    /// Why not the adapter but the processor has drawn it.
    pub trouble: Option<String>,
    /// How many particles it took, where those are not all.
    pub sampled: Option<u64>,
    pub opaque: Option<Arc<OpaqueDepths>>,
}

/// Whose particles are drawn.
pub(super) enum Source {
    /// Nodes of the open file.
    Nodes(Arc<[SceneNode]>),
    /// Particles that another system hands over, and the families that are shown.
    Live(Arc<Dataset>, Vec<FamilyName>),
}

/// The families of live particles that are shown.
fn shown<'a>(dataset: &'a Dataset, families: &[FamilyName]) -> Vec<&'a Family> {
    dataset.families.iter().filter(|family| families.contains(&family.name)).collect()
}

/// Draws the source with `size` pixels; blocks for as long as it takes. What is left out is what `plan` says, or what
/// is found to be within the settings, which is handed back; and then as much as a sample of `limit` particles needs. Also
/// says how many it took. A picture that is not shown but measured is of splats where the processor does not draw the mode.
pub(super) fn draw(
    file: &PageFile,
    depiction: &Depiction,
    source: &Source,
    view: &View,
    size: UVec2,
    (economy, plan, limit): (Economy, Option<Plan>, u64),
    (transfer, levels): (&TransferFunction, Option<Levels>),
    is_shown: bool,
) -> Result<(Accumulation, Plan, (u64, bool)), String> {
    let metadata = file.metadata();
    let nodes = match source {
        Source::Nodes(nodes) => nodes,
        Source::Live(dataset, families) => {
            let view = View { width: size.x, height: size.y, ..*view };
            let families = shown(dataset, families);
            let drawn = processor::draw_particles(&view, depiction, dataset, &families, Method::Pyramid);
            let taken = families.iter().map(|family| family.len() as u64).sum();
            return drawn.map(|drawn| (drawn, Plan::default(), (taken, false))).map_err(|error| error.to_string());
        }
    };
    // What may be left out is decided for the whole picture, also where this one has fewer pixels.
    let plan = match plan {
        Some(plan) => Ok(plan),
        None => pilot::plan(view, depiction, metadata, nodes, &economy, transfer, levels),
    };
    let drawn = plan.and_then(|plan| {
        let important = governor::most_important(depiction, metadata);
        let (fitting, taken) = governor::within(limit, plan, view, depiction, metadata, nodes, &important);
        let decoded = processor::decode_planned(view, depiction, metadata, nodes, &fitting);
        let view = View { width: size.x, height: size.y, ..*view };
        let drawn = match is_shown || depiction.mode.technique.on_processor() {
            true => processor::draw_planned(&view, depiction, metadata, &decoded, Method::Pyramid, &fitting)?.0,
            false => processor::sum_planned(&view, depiction, metadata, &decoded, &fitting)?,
        };
        Ok((drawn, plan, (taken, fitting != plan)))
    });
    drawn.map_err(|error| error.to_string())
}

/// Draws the source in the colours of a mode that has no splats; blocks for as long as it takes.
pub(super) fn paint(
    file: &PageFile,
    depiction: &Depiction,
    source: &Source,
    view: &View,
    diameter: f64,
    (transfer, levels): (&TransferFunction, Levels),
    (caster, limit): (&dyn Caster, u64),
) -> Result<PaintedPicture, String> {
    let metadata = file.metadata();
    let (decoded, sampled) = match source {
        Source::Nodes(nodes) => {
            let important = governor::most_important(depiction, metadata);
            let (plan, taken) = governor::within(limit, Plan::default(), view, depiction, metadata, nodes, &important);
            let decoded = processor::decode_planned(view, depiction, metadata, nodes, &plan);
            (decoded, (!plan.is_complete()).then_some(taken))
        }
        Source::Live(..) => (Vec::new(), None),
    };
    let with = |caster| {
        let subject = Subject { transfer: Some(transfer), diameter, caster };
        match source {
            Source::Nodes(_) => paint_nodes(view, depiction, metadata, &decoded, &subject),
            Source::Live(dataset, families) => {
                paint_particles(view, depiction, dataset, &shown(dataset, families), &subject)
            }
        }
    };
    let (painted, trouble) = match with(caster) {
        Err(VolumeError::Device(why)) => (with(&Processor), Some(why)),
        painted => (painted, None),
    };
    // A view without data is a black picture, and no error.
    if matches!(painted, Err(VolumeError::Grid(GridError::NothingInView))) {
        let rgba = vec![[0, 0, 0, 255]; view.width as usize * view.height as usize];
        let image = Image { width: view.width, height: view.height, rgba };
        return Ok(PaintedPicture { image, levels, transfer: transfer.clone(), trouble, sampled: None, opaque: None });
    }
    let painted = painted.map_err(|error| error.to_string())?;
    let levels = Levels { p: painted.levels.density, s: painted.levels.attribute };
    let image = painted.colors.image();
    // A sample's wider kernels may hide what all particles together do not.
    let opaque = painted.report.opaque.filter(|_| sampled.is_none());
    Ok(PaintedPicture { image, levels, transfer: transfer.clone(), trouble, sampled, opaque })
}
