//! Measured surfaces in a picture of something else: one depth for all of it.

use crate::cpu::paths::PathFragments;
use crate::view::View;
use std::borrow::Cow;

/// What particles, paths and volumes are drawn among.
pub trait Ground: Sync {
    /// What each pixel of a view shows of it, from front to back, in colours and with depths in the view's lengths.
    fn fragments(&self, view: &View) -> PathFragments;
}

/// What something is drawn among: paths, surfaces or both.
pub(super) fn among(paths: Option<PathFragments>, surfaces: Option<&PathFragments>) -> Option<Cow<'_, PathFragments>> {
    match (paths, surfaces) {
        (Some(paths), Some(surfaces)) => Some(Cow::Owned(surfaces.merged(&paths))),
        (Some(paths), None) => Some(Cow::Owned(paths)),
        (None, surfaces) => surfaces.map(Cow::Borrowed),
    }
}
