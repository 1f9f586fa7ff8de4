//! Faces of panoramas, and pictures of one eye, drawn by an adapter so that no face shows where it ends.
//!
//! An adapter's passes draw a flat picture of whole nodes, with kernels that are summed along each pixel's own ray as the processor does. What
//! a flat picture does otherwise than a panorama's face stays with the processor: nodes of which a particle may surround the eye
//! ([`around`]) are few, and their sums are added. What light needs to be alike on all faces, planes and ranges, comes with the look
//! that they share. An adapter raises particles that are too small for the picture to the least size at the face's depth, the
//! processor to the same at their distance: they are smaller towards the face's edges, on both sides alike.

use super::adapter::{Adapter, AdapterJob, Passes, draw_on};
use super::around::unless_empty;
use super::decode::reach;
use super::error::PictureError;
use super::subject::Subject;
use crate::color::Accumulation;
use crate::cpu::{Counts, about_eye, around};
use crate::mode::{LightPicture, Plan};
use crate::stream::SceneNode;
use crate::view::View;
use glam::DVec3;

/// An adapter, and the passes that draw the mode.
pub(super) type Painter<'a> = (Passes, &'a mut (dyn Adapter + 'static));

/// Sums of nodes on a face whose panorama's pixels are `pixel` radians wide, or in a flat picture. Notes what drew.
///
/// # Errors
/// As [`Adapter::draw`].
pub(super) fn sums(
    (passes, adapter): Painter<'_>,
    subject: &Subject<'_>,
    view: &View,
    nodes: &[SceneNode],
    pixel: Option<f64>,
    drawn_by: &mut Option<[String; 2]>,
) -> Result<(Accumulation, Counts), PictureError> {
    let is_about = |node: &SceneNode| pixel.is_some() && surrounds(view.eye, node);
    let (near, far): (Vec<SceneNode>, Vec<SceneNode>) = nodes.iter().cloned().partition(is_about);
    let (mut sums, mut counts) = match far.is_empty() {
        true => {
            let attribute = subject.depiction.attribute.is_some();
            (Accumulation::new(view.width, view.height, attribute), Counts::default())
        }
        false => {
            let (raw, frame) = draw_on(adapter, subject, job(subject, view, &far, passes, &Plan::default()))?;
            *drawn_by = Some([frame.backend.to_owned(), frame.adapter]);
            let (sums, counts) = raw.sums(subject.depiction.mode)?;
            (sums, Counts { drawn: frame.splats.unwrap_or(counts.drawn), ..counts })
        }
    };
    if !near.is_empty() {
        let (others, drawn) = subject.sum_face(view, &near, pixel, None)?;
        around::add(&mut sums, &others);
        counts += drawn;
    }
    Ok((sums, counts))
}

/// The light of nodes on a face, with a look that all faces share; `None` where it shows nothing. Notes what drew.
///
/// # Errors
/// As [`Adapter::draw`].
pub(super) fn light(
    (passes, adapter): Painter<'_>,
    subject: &Subject<'_>,
    view: &View,
    nodes: &[SceneNode],
    drawn_by: &mut Option<[String; 2]>,
) -> Result<Option<LightPicture>, PictureError> {
    if nodes.is_empty() {
        return Ok(None);
    }
    let drawn =
        draw_on(adapter, subject, job(subject, view, nodes, passes, &Plan::default())).and_then(|(raw, frame)| {
            *drawn_by = Some([frame.backend.to_owned(), frame.adapter]);
            raw.light(subject.depiction.mode)
        });
    Ok(unless_empty(drawn)?)
}

fn job<'a>(
    subject: &Subject<'a>,
    view: &'a View,
    nodes: &'a [SceneNode],
    passes: Passes,
    plan: &'a Plan,
) -> AdapterJob<'a> {
    let &Subject { metadata, depiction, .. } = subject;
    AdapterJob { view, depiction, metadata, nodes, plan, passes, light: None, repeat: 1 }
}

/// Whether the eye may be among the kernels of a node's particles, or about them.
fn surrounds(eye: DVec3, node: &SceneNode) -> bool {
    let extent = reach(node, 1.0);
    let nearest = eye.clamp(extent.bounds.min, extent.bounds.max);
    eye.distance_squared(nearest) < (about_eye::NEAR * extent.margin).powi(2)
}
