//! Paths over the picture: drawn by the processor on a thread of its own, and laid over whatever draws. In modes whose pictures have a depth
//! the processor draws them among the rest, as [`super::cpu_backend`] does with what is told here.

use super::look::Look;
use super::pages::ViewSelection;
use super::preset::Preset;
use super::scene::{RunNow, Scene, Settings};
use super::sheet::Sheet;
use super::state::answer::Answer;
use super::state::notices::Notices;
use super::statistics::Converged;
use super::touring::Player;
use crate::color::Colors;
use crate::color::colors::to_encoded;
use crate::color::transfer::TransferFunction;
use crate::cpu::paths::PathFragments;
use crate::explore::{IdSet, SelectionSet};
use crate::hierarchy::spacetime::Interpolation;
use crate::mode::{Depiction, PathSettings, PathsOf};
use crate::model::{FamilyName, Moment};
use crate::picture::PictureError;
use crate::picture::paths::{PathLayer, PathRequest, PickedPath};
use crate::view::View;
use bevy::prelude::*;
use bevy_egui::egui::{self, Color32, TextureHandle, TextureOptions};
use rayon::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// The share of the memory for pages that tracks of paths may take.
const MEMORY_SHARE: u64 = 4;
/// A picture of paths that takes longer has fewer pixels while the view or the time moves, milliseconds.
const SLOW_MS: f64 = 40.0;
/// How far from a path it is picked, pixels.
const REACH_PX: f64 = 8.0;

/// What paths are of, from wherever one looks.
#[derive(Clone, PartialEq)]
struct Key {
    dataset: u32,
    moment: Moment,
    interpolation: Interpolation,
    settings: PathSettings,
    of: PathsOf,
    selections: Vec<SelectionSet>,
    families: Vec<FamilyName>,
    depiction: u64,
    transfer: TransferFunction,
}

/// Paths that can be drawn in any view.
#[derive(Clone)]
pub struct Job {
    key: Key,
    depiction: Depiction,
    layer: Arc<Mutex<PathLayer>>,
}

impl Job {
    /// Calls `then` with the layer and what is asked of it for a picture with `share` of the full one's pixels along a side.
    fn with<T>(
        &self,
        view: &View,
        share: f64,
        then: impl FnOnce(&mut PathLayer, &PathRequest<'_>) -> Result<T, PictureError>,
    ) -> Result<T, String> {
        let key = &self.key;
        let settings =
            PathSettings { width: share * key.settings.width, halo: share * key.settings.halo, ..key.settings.clone() };
        let request = PathRequest {
            view,
            settings: &settings,
            of: &key.of,
            selections: &key.selections,
            moment: key.moment,
            interpolation: key.interpolation,
            families: &key.families,
            depiction: &self.depiction,
            transfer: &key.transfer,
        };
        let mut layer = self.layer.lock().unwrap_or_else(PoisonError::into_inner);
        then(&mut layer, &request).map_err(|error| error.to_string())
    }

    /// The fragments of a picture, among which others are drawn.
    ///
    /// # Errors
    /// What cannot be read, or does not fit the run.
    pub fn fragments(&self, view: &View, share: f64) -> Result<PathFragments, String> {
        self.with(view, share, |layer, request| {
            layer.gather(request)?;
            Ok(layer.fragments())
        })
    }
}

/// A finished picture of paths.
struct Drawn {
    revision: u64,
    view: View,
    size: [usize; 2],
    pixels: Vec<Color32>,
    tracks: u64,
    milliseconds: f64,
}

/// The paths of the window.
#[derive(Resource, Default)]
pub struct Paths {
    layer: Option<(u32, Arc<Mutex<PathLayer>>)>,
    job: Option<Arc<Job>>,
    /// Counts up with every other moment, setting or data.
    revision: u64,
    /// Whether they are drawn among what the mode shows.
    among: bool,
    asked: Option<(u64, View)>,
    /// The revisions of the view and of the paths, and since when they are so.
    moved: Option<([u64; 2], Instant)>,
    coming: Answer<Drawn>,
    drawn: Option<Drawn>,
    /// What could not be drawn.
    failed: Option<u64>,
    sheet: Sheet,
    uploaded: bool,
    /// The path that was clicked, and who is in it.
    pub picked: Answer<Option<PickedPath>>,
    /// Who is in it.
    pub members: Answer<IdSet>,
}

impl Paths {
    /// Whether they are drawn among what the mode shows.
    pub fn is_among(&self) -> bool {
        self.among
    }

    /// Whether any are wanted.
    pub fn is_wanted(&self) -> bool {
        self.job.is_some()
    }

    /// What is drawn among what the mode shows, and its revision.
    pub fn among(&self) -> Option<(u64, Arc<Job>)> {
        let job = self.job.as_ref().filter(|_| self.among)?;
        Some((self.revision, Arc::clone(job)))
    }

    /// Tracks that the picture has paths of, in the interval where they are most; `None` where none is laid over it.
    pub fn tracks(&self) -> Option<u64> {
        self.drawn.as_ref().filter(|_| self.job.is_some() && !self.among).map(|drawn| drawn.tracks)
    }

    /// What draws them of this data, if it is known; of other data nothing stays, nor is it waited for.
    fn layer_of(&mut self, dataset: u32) -> Option<Arc<Mutex<PathLayer>>> {
        let known = self.layer.take().filter(|(known, _)| *known == dataset).map(|(_, layer)| layer);
        if known.is_none() {
            *self = Paths { revision: self.revision, failed: self.failed, ..Paths::default() };
        }
        known
    }

    /// Whether what is laid over the picture is of this view and of now.
    fn is_there(&self, view: &View) -> bool {
        let is_current = |drawn: &Drawn| drawn.revision == self.revision && drawn.view == *view;
        self.job.is_none()
            || self.among
            || self.failed == Some(self.revision)
            || self.drawn.as_ref().is_some_and(is_current)
    }

    /// The textures that lie over the picture, with their places as shares of it.
    pub fn textures(&mut self, ctx: &egui::Context) -> &[(TextureHandle, egui::Rect)] {
        let Some(drawn) = self.drawn.as_ref().filter(|_| self.job.is_some() && !self.among) else { return &[] };
        if !self.uploaded {
            self.sheet.fill(ctx, ("paths", TextureOptions::LINEAR), drawn.size, |at| drawn.pixels[at]);
            self.uploaded = true;
        }
        self.sheet.tiles()
    }

    /// Looks for the path at a place in the picture, pixels.
    pub fn pick(&mut self, view: View, at: [f64; 2]) {
        let Some(job) = self.job.clone() else { return };
        self.members = Answer::Nothing;
        self.picked =
            Answer::ask("path", move |_| job.with(&view, 1.0, |layer, request| layer.pick(request, at, REACH_PX)));
    }

    /// Finds out who is in the path that was clicked.
    pub fn ask_members(&mut self) {
        let (Some(job), Some(Some(picked))) = (self.job.clone(), self.picked.here().cloned()) else { return };
        self.members =
            Answer::ask("path", move |_| job.layer.lock().unwrap_or_else(PoisonError::into_inner).members(&picked));
    }
}

/// Whether paths have begun or ceased to be drawn among what the mode shows since the last call.
pub(super) fn among_changed(paths: Res<Paths>, mut before: Local<bool>) -> bool {
    std::mem::replace(&mut *before, paths.among) != paths.among
}

/// Finds out what paths are wanted now.
pub(super) fn follow_paths(
    mut paths: ResMut<Paths>,
    scene: Option<Res<Scene>>,
    look: Option<Res<Look>>,
    (settings, preset, time): (Res<Settings>, Res<Preset>, Res<Time<Real>>),
    player: Res<Player>,
    mut notices: ResMut<Notices>,
) {
    let paths = paths.bypass_change_detection();
    let of = settings.paths.whose(settings.mode);
    let now =
        scene.as_ref().filter(|_| of != PathsOf::None && !settings.is_projected()).and_then(|scene| RunNow::of(scene));
    let (Some(scene), Some(look), Some(now)) = (scene, look, now) else {
        *paths = Paths { revision: paths.revision, layer: paths.layer.take(), ..Paths::default() };
        return;
    };
    let budget = (preset.residency.budget_mib << 20) / MEMORY_SHARE;
    let layer = match paths
        .layer_of(scene.dataset)
        .map_or_else(|| PathLayer::new(Arc::clone(now.following.run()), budget).map(Mutex::new).map(Arc::new), Ok)
    {
        Ok(layer) => layer,
        Err(error) => {
            if paths.failed.replace(paths.revision) != Some(paths.revision) {
                notices.error(error.to_string());
            }
            return;
        }
    };
    paths.layer = Some((scene.dataset, Arc::clone(&layer)));
    let mut own = settings.paths.clone();
    // Highlights run on by the window's clock, and whoever waits for a picture does not wait for them; in a tour by the tour's.
    if player.state().is_none() {
        own.phase += own.run * time.elapsed_secs_f64();
    }
    let shown = scene.metadata().families.iter().zip(&settings.families).filter(|(_, shown)| **shown);
    let key = Key {
        dataset: scene.dataset,
        moment: now.moment,
        interpolation: now.interpolation,
        settings: own,
        of,
        selections: settings.selections.clone(),
        families: shown.map(|(family, _)| family.name).collect(),
        depiction: look.depiction_revision,
        transfer: look.transfer.clone(),
    };
    paths.among = settings.mode.technique.takes_paths();
    let same = |known: &Key| {
        let phase = if settings.paths.run == 0.0 { known.settings.phase } else { key.settings.phase };
        let settings = PathSettings { phase, ..known.settings.clone() };
        Key { settings, ..known.clone() } == key
    };
    if !paths.job.as_ref().is_some_and(|job| same(&job.key)) {
        paths.revision += 1;
    }
    if paths.job.as_ref().is_none_or(|job| job.key != key) {
        paths.job = Some(Arc::new(Job { key, depiction: look.depiction.clone(), layer }));
    }
}

/// Takes in what has been drawn, and has drawn what is wanted now.
pub(super) fn draw_paths(
    mut paths: ResMut<Paths>,
    selection: Res<ViewSelection>,
    (preset, settings): (Res<Preset>, Res<Settings>),
    mut converged: ResMut<Converged>,
    mut notices: ResMut<Notices>,
) {
    let paths = paths.bypass_change_detection();
    paths.picked.receive();
    paths.members.receive();
    let Some(view) = selection.view else { return };
    if paths.coming.receive() {
        match std::mem::take(&mut paths.coming) {
            Answer::Here(drawn) => (paths.drawn, paths.uploaded) = (Some(drawn), false),
            Answer::Failed(why) => {
                paths.failed = paths.asked.map(|(revision, _)| revision);
                notices.error(why);
            }
            Answer::Nothing | Answer::Coming(_) => {}
        }
    }
    let revisions = [selection.revision, paths.revision];
    if paths.moved.is_none_or(|(known, _)| known != revisions) {
        paths.moved = Some((revisions, Instant::now()));
    }
    converged.0 &= paths.is_there(&view);
    let Some(job) = paths.job.clone().filter(|_| !paths.among) else { return };
    let runs_on = settings.paths.run != 0.0;
    if matches!(paths.coming, Answer::Coming(_)) || (paths.is_there(&view) && !runs_on) {
        return;
    }
    let is_moving =
        paths.moved.is_some_and(|(_, since)| since.elapsed().as_millis() < u128::from(preset.motion.rest_ms));
    let slow = paths.drawn.as_ref().is_some_and(|drawn| drawn.milliseconds > SLOW_MS);
    let share = if slow && is_moving { 0.5 } else { 1.0 };
    let size = [view.width, view.height].map(|side| ((f64::from(side) * share).round() as u32).max(1));
    let revision = paths.revision;
    paths.asked = Some((revision, view));
    paths.coming = Answer::ask("paths", move |_| {
        let start = Instant::now();
        let small = view.resized(size[0], size[1]);
        let (colors, tracks) = job.with(&small, share, |layer, request| {
            let tracks = layer.gather(request)?.tracks;
            Ok((layer.colors(), tracks))
        })?;
        // A picture with fewer pixels does not count as that of the view.
        let view = if share == 1.0 { view } else { small };
        let milliseconds = 1e3 * start.elapsed().as_secs_f64();
        let size = size.map(|side| side as usize);
        Ok::<_, String>(Drawn { revision, view, size, pixels: encoded(&colors), tracks, milliseconds })
    });
}

/// Light as egui blends it: gamma-encoded, premultiplied with opacity.
fn encoded(colors: &Colors) -> Vec<Color32> {
    let pixel = |&[r, g, b, a]: &[f32; 4]| {
        if a <= 0.0 {
            return Color32::TRANSPARENT;
        }
        let byte = |share: f32| (255.0 * share.clamp(0.0, 1.0)).round() as u8;
        let [r, g, b] = [r, g, b].map(|light| byte(a * to_encoded((light / a).clamp(0.0, 1.0))));
        Color32::from_rgba_premultiplied(r, g, b, byte(a))
    };
    colors.rgba.par_iter().map(pixel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_that_was_picked_in_other_data_is_forgotten() {
        let (picked, members) = (Answer::Here(None), Answer::Failed("it was not read".into()));
        let mut paths = Paths { picked, members, revision: 3, ..Paths::default() };
        assert!(paths.layer_of(2).is_none());
        assert!(matches!((&paths.picked, &paths.members), (Answer::Nothing, Answer::Nothing)));
        assert_eq!(paths.revision, 3, "it counts on");
    }
}
