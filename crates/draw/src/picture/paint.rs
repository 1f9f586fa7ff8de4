//! Colours that a mode draws straight from particles: of nodes of a page file, and of source particles.

use super::processor::{DecodedNode, SeenFamily, batches, seen_batches};
use crate::color::transfer::TransferFunction;
use crate::cpu::volume::{Caster, Processor, VolumeError, VolumeLevels};
use crate::cpu::{SplatOptions, Splats};
use crate::mode::{Depiction, Job, Painted};
use crate::model::{Dataset, Family, Kernel};
use crate::modes::grid::Look;
use crate::store::Metadata;
use crate::view::View;

/// What the pictures of a dataset share.
#[derive(Clone, Copy, Debug)]
pub struct Subject<'a> {
    /// What volumes emit and absorb; the mode's own where it is `None`.
    pub transfer: Option<&'a TransferFunction>,
    /// The data's diameter without far outliers, world units.
    pub diameter: f64,
    /// What draws modes of the perspective grid.
    pub caster: &'a dyn Caster,
}

/// Paints decoded nodes of a page file.
///
/// # Errors
/// [`VolumeError`] for settings that do not fit, or a mode that is made of splats.
pub fn paint_nodes(
    view: &View,
    depiction: &Depiction,
    metadata: &Metadata,
    nodes: &[DecodedNode],
    subject: &Subject<'_>,
) -> Result<Painted, VolumeError> {
    let batches = batches(depiction, nodes)?;
    paint(view, depiction, &batches, metadata.kernel, densest_of(metadata), subject)
}

/// Paints source particles at their full precision.
///
/// # Errors
/// As [`paint_nodes`].
pub fn paint_particles(
    view: &View,
    depiction: &Depiction,
    dataset: &Dataset,
    families: &[&Family],
    subject: &Subject<'_>,
) -> Result<Painted, VolumeError> {
    let seen = SeenFamily::of(view, depiction, families);
    let batches = seen_batches(depiction, &seen)?;
    paint(view, depiction, &batches, dataset.kernel, densest(families), subject)
}

/// The largest density in a page file.
pub fn densest_of(metadata: &Metadata) -> f64 {
    metadata.families.iter().map(|family| family.quantities[1].max).fold(0.0, f64::max)
}

/// The largest density of source particles.
pub fn densest(families: &[&Family]) -> f64 {
    let densities = families.iter().flat_map(|family| &family.density);
    f64::from(densities.copied().filter(|density| density.is_finite()).fold(0.0, f32::max))
}

/// The ranges that [`paint_nodes`] finds with a transfer function, without painting.
///
/// # Errors
/// [`VolumeError`] as [`paint_nodes`].
pub fn find_levels(
    view: &View,
    depiction: &Depiction,
    metadata: &Metadata,
    nodes: &[DecodedNode],
    transfer: &TransferFunction,
) -> Result<VolumeLevels, VolumeError> {
    let job = Job {
        view,
        batches: &batches(depiction, nodes)?,
        options: SplatOptions { kernel: metadata.kernel, ..SplatOptions::default() },
        settings: &depiction.settings,
        transfer: Some(transfer),
        // Neither has to do with ranges.
        diameter: 1.0,
        densest: densest_of(metadata),
        caster: &Processor,
    };
    Ok(Look::new(&job)?.levels)
}

/// Paints batches; `densest` is the data's largest density.
///
/// # Errors
/// As [`paint_nodes`].
pub fn paint(
    view: &View,
    depiction: &Depiction,
    batches: &[Splats<'_>],
    kernel: Kernel,
    densest: f64,
    &Subject { transfer, diameter, caster }: &Subject<'_>,
) -> Result<Painted, VolumeError> {
    let usual = depiction.suited(TransferFunction::of_volumes(depiction.attribute.is_some()));
    let transfer = Some(transfer.unwrap_or(&usual));
    let options = SplatOptions { kernel, ..SplatOptions::default() };
    let settings = &depiction.settings;
    let job = Job { view, batches, options, settings, transfer, diameter, densest, caster };
    depiction.mode.draw(&job)?.light(depiction.mode)
}
