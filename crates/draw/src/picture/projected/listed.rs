//! Faces of sums whose pages do not fit into memory together: each is listed, and drawn some pages at a time.

use super::{Face, Means, Tally};
use crate::color::Accumulation;
use crate::cpu::Counts;
use crate::cpu::around::add;
use crate::mode::Output;
use crate::picture::adapter_faces;
use crate::picture::error::PictureError;
use crate::picture::subject::Subject;
use crate::stream::SceneNode;
use crate::view::{Detail, View};

/// The sums of a face, for which nodes are selected by `seen` in this detail; `None` of a mode whose pictures need all nodes at once.
///
/// # Errors
/// As [`super::Projector::draw`].
pub(super) fn sums(
    means: &mut Means<'_>,
    subject: &Subject<'_>,
    face: &Face<'_>,
    (seen, detail): (&View, Detail),
    tally: &mut Tally,
) -> Result<Option<Accumulation>, PictureError> {
    let technique = subject.depiction.mode.technique;
    let pixel = face.around.map(|[pixel, _]| pixel);
    let summing = subject.summing_face(face.view, pixel);
    if technique.output() != Output::Sums || (means.adapter.is_none() && summing.is_none()) {
        return Ok(None);
    }
    let (reporter, scene) = (means.reporter, &mut *means.scene);
    let mut tell = |why: String| reporter.tell(why);
    let listing = scene.list(seen, detail, &mut tell)?;
    let (sums, counts, visited) = match (&mut means.adapter, summing) {
        (None, Some(mut summing)) => {
            let mut part = |nodes: &[SceneNode]| -> Result<(), PictureError> { Ok(summing.add(nodes)?) };
            let visited = scene.visit::<PictureError>(&listing, &[], &mut tell, &mut part)?;
            let (sums, counts) = summing.finish().sums(subject.depiction.mode)?;
            (sums, counts, visited)
        }
        (adapter, _) => {
            let has_attribute = subject.depiction.attribute.is_some();
            let mut sums = Accumulation::new(face.view.width, face.view.height, has_attribute);
            let (mut counts, drawn_by) = (Counts::default(), &mut tally.drawn_by);
            let mut part = |nodes: &[SceneNode]| -> Result<(), PictureError> {
                let Some((passes, adapter)) = adapter else { return Ok(()) };
                let painter = (*passes, &mut **adapter);
                let (own, drawn) = adapter_faces::sums(painter, subject, face.view, nodes, pixel, drawn_by)?;
                add(&mut sums, &own);
                counts += drawn;
                Ok(())
            };
            let visited = scene.visit::<PictureError>(&listing, &[], &mut tell, &mut part)?;
            (sums, counts, visited)
        }
    };
    tally.counts += counts;
    tally.converged &= listing.converged && visited.is_complete;
    tally.error_px = tally.error_px.max(visited.error_pixels / face.scale());
    tally.particles += listing.particles;
    tally.nodes += listing.nodes.len();
    tally.has_clusters |= listing.has_clusters;
    Ok(Some(sums))
}
