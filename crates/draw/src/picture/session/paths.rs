//! Paths of the run in a session's pictures.

use super::{Session, Shown};
use crate::cpu::paths::PathFragments;
use crate::cpu::paths::fragments::lay_over_colors;
use crate::cpu::shadowing::Lighting;
use crate::look::LookPatch;
use crate::mode::{Mode, PathsOf};
use crate::model::FamilyName;
use crate::modes;
use crate::picture::paths::{ChosenPaths, KEPT_BYTES, PathCounts, PathLayer, PathRequest, Sight};
use crate::picture::times::Times;
use crate::picture::{Picture, PictureError};
use glam::DVec3;
use std::sync::Arc;
use std::time::Instant;

impl Session {
    /// Tells once, however many pictures are drawn, that something is left out or drawn otherwise.
    pub(super) fn tell_once(&mut self, what: &'static str) {
        if !self.told_once.contains(&what) {
            self.told_once.push(what);
            self.reporter.tell(what.into());
        }
    }

    /// Why a look's paths are not drawn; `None` where they are, or nobody's are asked for.
    fn why_no_paths(&self, look: &LookPatch) -> Option<&'static str> {
        match self.run() {
            _ if look.paths_of() == PathsOf::None => None,
            None => Some("the data is no run: paths are left out"),
            Some(run) if run.tracks().is_err() => Some("the run has no tracks: paths are left out"),
            Some(_) if !matches!(&self.members[..], [only] if only.offset == DVec3::ZERO && only.scale.is_none()) => {
                Some("paths are drawn of one run alone, where it lies: they are left out")
            }
            Some(_) => None,
        }
    }

    /// Whether paths are drawn in a picture; says why not where they are wanted all the same, unless the picture is of nothing else and fails by it.
    pub(super) fn has_paths(&mut self, look: &LookPatch) -> bool {
        let why_not = self.why_no_paths(look);
        if let Some(why) = why_not
            && !look.mode.is_some_and(Mode::is_of_paths)
        {
            self.tell_once(why);
        }
        why_not.is_none() && look.paths_of() != PathsOf::None
    }

    /// That paths are all that is asked for, and there are none.
    pub(super) fn no_paths(&self, look: &LookPatch) -> PictureError {
        let why = self.why_no_paths(look).unwrap_or("nobody's paths are asked for");
        PictureError::of(self.path(), format!("mode paths: {why}"))
    }

    /// Calls `then` with the layer and what is asked of it; `None` where there is no run.
    fn with_layer<T>(
        &mut self,
        shown: &Shown<'_>,
        then: impl FnOnce(&mut PathLayer, &PathRequest<'_>) -> Result<T, PictureError>,
    ) -> Result<Option<T>, PictureError> {
        let Shown { shot, view, depiction, transfer, .. } = *shown;
        let Some(run) = self.run().cloned() else { return Ok(None) };
        let mut layer = match self.paths.take() {
            Some(layer) if Arc::ptr_eq(layer.run(), &run) => layer,
            _ => PathLayer::new(run, KEPT_BYTES.min(self.budget_bytes))?,
        };
        let tree = self.tree();
        let shown = self.scene.families.iter().filter_map(|index| tree.metadata().families.get(*index as usize));
        let families: Vec<FamilyName> = shown.map(|family| family.name).collect();
        let request = PathRequest {
            view: &view,
            settings: &shot.look.paths.clone().unwrap_or_default(),
            of: &shot.look.paths_of(),
            selections: shot.look.selections.as_deref().unwrap_or_default(),
            moment: self.moment,
            interpolation: shot.look.interpolation.unwrap_or_default(),
            families: &families,
            depiction,
            transfer,
        };
        let done = then(&mut layer, &request);
        self.paths = Some(layer);
        done.map(Some)
    }

    /// Reads and projects the paths of a picture; how many they are.
    pub(super) fn gather_paths(&mut self, shown: &Shown<'_>) -> Result<PathCounts, PictureError> {
        Ok(self.with_layer(shown, PathLayer::gather)?.unwrap_or_default())
    }

    /// Reads the paths of a picture that is put together from several views.
    pub(super) fn choose_paths(
        &mut self,
        shown: &Shown<'_>,
        sight: &Sight,
    ) -> Result<Option<ChosenPaths>, PictureError> {
        self.with_layer(shown, |layer, request| layer.choose_for(request, sight))
    }

    /// Draws paths alone.
    pub(super) fn draw_paths_alone(&mut self, shown: &Shown<'_>) -> Result<Picture, PictureError> {
        let mut times = Times::default();
        if !self.has_paths(&shown.shot.look) {
            return Err(self.no_paths(&shown.shot.look));
        }
        let blank = self.blank(shown, shown.view)?;
        let (mut values, mut counts) = (blank.values, PathCounts::default());
        let surfaces = shown.ground.map(|ground| ground.fragments(&shown.view, &Lighting::default()));
        // Everything is read before times are measured.
        let start = Instant::now();
        self.gather_paths(shown)?;
        times.note("load", start.elapsed() + self.loading.take().unwrap_or_default());
        for _ in 0..self.options.repeat.max(1) {
            (values, counts) = times.frame(|times| {
                let counts = times.measure("project", || self.gather_paths(shown))?;
                let colors = times.measure("draw", || {
                    let colors = self.paths.as_ref().map(|layer| layer.colors_behind(surfaces.as_ref()));
                    match (colors, surfaces.as_ref().map(PathFragments::colors)) {
                        (Some(paths), Some(mut under)) => {
                            lay_over_colors(&paths, &mut under);
                            Some(under)
                        }
                        (paths, under) => paths.or(under),
                    }
                });
                Ok::<_, PictureError>((modes::paths::picture(shown.view.width, shown.view.height, colors), counts))
            })?;
        }
        let moment = blank.moment.map(|moment| moment.with_paths(counts));
        Ok(Picture { values, moment, milliseconds: times.medians(), ..blank })
    }

    /// A picture that an adapter has drawn, with paths on top.
    pub(super) fn with_paths(
        &mut self,
        picture: Picture,
        shown: &Shown<'_>,
        times: &mut Times,
    ) -> Result<Picture, PictureError> {
        let counts = times.measure("paths", || self.gather_paths(shown))?;
        let paths = times.measure("paths", || self.paths.as_ref().map(|layer| Arc::new(layer.colors())));
        let moment = picture.moment.map(|moment| moment.with_paths(counts));
        Ok(Picture { moment, paths, ..picture })
    }
}
