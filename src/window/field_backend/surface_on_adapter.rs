//! Drawing heights that are open alone with the adapter: chunks are chosen, read and joined on a background task, and the data camera's passes
//! draw them.
//!
//! While the view moves, pictures have as many pixels as there is time for. What of lines and marks lies behind the surface is found by the
//! processor when the view rests, which then writes heights along lines, too. Pictures that the passes do not draw are the processor's, as are
//! those that the adapter has no room for.

use super::Report;
use crate::color::Colors;
use crate::color::transfer::TransferFunction;
use crate::gpu::surface::{SurfaceNews, SurfaceView};
use crate::gpu::{DrawItem, Fading, LightView, SplatView, Technique};
use crate::look::LookPatch;
use crate::picture::AnySession;
use crate::picture::adapter::{AdapterSurface, Passes};
use crate::picture::surface::{SurfaceDepths, SurfaceSession};
use crate::view::View;
use crate::window::exposure::Exposure;
use crate::window::hidden::Hiding;
use crate::window::look::{Held, Look};
use crate::window::pages::ViewSelection;
use crate::window::pass_times::LastPasses;
use crate::window::picture::{DataCamera, Letterbox, Picture};
use crate::window::picture_sizes::Wanted;
use crate::window::preset::Preset;
use crate::window::scene::{Scene, Settings};
use crate::window::state::notices::Notices;
use crate::window::statistics::{ActiveBackend, Converged, Statistics};
use crate::window::touring::Before;
use crate::window::written::WrittenHeights;
use bevy::prelude::*;
use bevy::tasks::{AsyncComputeTaskPool, Task, futures::check_ready};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// Pictures of heights are named from here on, so that none has the name of one of a volume.
const FIRST_NUMBER: u64 = 1 << 41;

/// What a picture depends on, whatever its size.
#[derive(Clone, PartialEq)]
struct Content {
    dataset: u32,
    depiction: u64,
    view: View,
    transfer: TransferFunction,
    /// How far heights may be from where they are, pixels.
    error_px: f64,
    technique: Technique,
}

/// A picture.
#[derive(Clone, PartialEq)]
struct Key {
    content: Content,
    size: UVec2,
}

/// A picture that the adapter is asked for.
struct Asked {
    number: u64,
    key: Key,
    job: Arc<AdapterSurface>,
    report: Report,
    exposure: Exposure,
    /// Since when it is wanted.
    since: Instant,
}

/// What the processor finds in a picture when the view rests.
struct AtRest {
    /// How far away heights are.
    depths: Option<SurfaceDepths>,
    /// Heights along lines.
    heights: Option<Colors>,
}

/// A place in the queue of tasks.
type Awaited<T> = Option<(Key, Task<Result<T, String>>)>;

/// The pictures that the adapter draws of the heights that are open.
#[derive(Resource, Default)]
pub(in crate::window) struct SurfaceOnAdapter {
    task: Awaited<Asked>,
    asked: Option<Asked>,
    wanted: Wanted<Content>,
    failed: Option<Key>,
    /// What is found in the picture of a key at rest, or on the way to it.
    at_rest: Awaited<AtRest>,
    known_at_rest: Option<Key>,
    /// Counts pictures.
    number: u64,
    /// The last picture that was seen to be complete.
    seen: u64,
    items: Arc<[DrawItem]>,
    /// The dataset for which the adapter has no room.
    refused: Option<u32>,
}

impl SurfaceOnAdapter {
    /// Whether there is a picture to draw.
    pub(in crate::window) fn is_there(&self) -> bool {
        self.asked.is_some()
    }

    /// Whether the adapter's passes draw the heights that are open as settings have them, if they are open alone.
    pub(in crate::window) fn draws(&self, scene: &Scene, settings: &Settings) -> bool {
        let has_room = self.refused != Some(scene.dataset);
        let opened = scene.surface_alone(settings.mode).filter(|_| has_room);
        opened.is_some_and(|opened| {
            let look = settings.look.patch();
            opened.is_for_passes(&settings.look.settings, look.attribute_name())
        })
    }
}

/// Tells the data camera what to draw of heights.
pub(in crate::window) fn draw_surface_on_adapter(
    mut commands: Commands,
    mut surfaces: ResMut<SurfaceOnAdapter>,
    (backend, news, last_passes): (Res<ActiveBackend>, Res<SurfaceNews>, Res<LastPasses>),
    (scene, look, selection): (Option<Res<Scene>>, Option<Res<Look>>, Res<ViewSelection>),
    (settings, held): (Res<Settings>, Res<Held>),
    (picture, preset, before): (Res<Picture>, Res<Preset>, Res<Before>),
    (mut exposure, mut statistics): (ResMut<Exposure>, ResMut<Statistics>),
    (mut hiding, mut written, mut letterbox): (ResMut<Hiding>, ResMut<WrittenHeights>, ResMut<Letterbox>),
    (mut converged, mut notices): (ResMut<Converged>, ResMut<Notices>),
    camera: Single<(Entity, Option<&LightView>), With<DataCamera>>,
) {
    let ActiveBackend::SurfaceOnGpu(technique) = *backend else {
        if surfaces.asked.is_some() || surfaces.task.is_some() {
            hiding.0 = None;
            written.show(None);
            let (number, refused) = (surfaces.number, surfaces.refused);
            *surfaces = SurfaceOnAdapter { number, refused, ..default() };
        }
        return;
    };
    // Nothing waits for changes of it but who chooses what draws.
    let surfaces = surfaces.bypass_change_detection();
    converged.0 = false;
    letterbox.set_if_neq(Letterbox(None));
    if statistics.backend != technique.name() {
        technique.name().clone_into(&mut statistics.backend);
    }
    if let Some((key, outcome)) = arrived(&mut surfaces.task) {
        match outcome {
            Ok(mut asked) => {
                asked.report.told.drain(..).for_each(|message| notices.error(message));
                exposure.set_if_neq(asked.exposure.clone());
                surfaces.number += 1;
                surfaces.asked = Some(Asked { number: FIRST_NUMBER + surfaces.number, ..asked });
            }
            Err(why) => {
                notices.error(why);
                surfaces.failed = Some(key);
            }
        }
    }
    if let Some((key, outcome)) = arrived(&mut surfaces.at_rest) {
        let AtRest { depths, heights } = outcome.unwrap_or(AtRest { depths: None, heights: None });
        hiding.0 = depths.map(Arc::new);
        written.show(heights.map(|heights| (key.content.view, heights)));
        surfaces.known_at_rest = Some(key);
    }
    let (Some(scene), Some(look), Some(view)) = (scene, look, selection.view) else { return };
    let Some(open) = scene.field_for(look.depiction.mode) else { return };
    // Ranges that are given are not looked for in each picture.
    let given = held.0.filter(|levels| levels.p[0] < levels.p[1]);
    let transfer = given.map_or_else(|| look.chosen.clone(), |levels| look.chosen.clone().with_levels(&levels));
    let (dataset, depiction, error_px) = (scene.dataset, look.depiction_revision, settings.error_px);
    let content = Content { dataset, depiction, view, transfer, error_px, technique };
    let full = picture.size();
    let (size, rests) = surfaces.wanted.follow(&content, full, &preset);
    let key = Key { content, size };

    let found = news.now();
    let mut is_drawn = false;
    if let Some(asked) = &surfaces.asked {
        is_drawn = found.number == asked.number && found.is_drawn;
        if found.number == asked.number && found.no_room {
            notices.error("the graphics memory is too small for these heights: the processor draws them");
            surfaces.refused = Some(scene.dataset);
        }
        if is_drawn && surfaces.seen != asked.number {
            surfaces.seen = asked.number;
            surfaces.wanted.took(asked.key.size, 1e3 * asked.since.elapsed().as_secs_f64());
        }
        asked.report.tell(&mut statistics);
    }
    statistics.draw_ms = surfaces.wanted.milliseconds();
    statistics.passes = last_passes.of_picture().map(|times| times.passes).unwrap_or_default();
    let is_current = surfaces.asked.as_ref().is_some_and(|asked| asked.key == key);
    let is_due = surfaces.asked.as_ref().is_some_and(|asked| asked.report.is_due());
    // One picture at a time: what is on its way is shown before the next begins.
    let may_begin = surfaces.task.is_none() && (surfaces.asked.is_none() || is_drawn);
    let patch = || LookPatch {
        transfer: Some(key.content.transfer.clone()),
        error_px: Some(key.content.error_px),
        time: None,
        ..settings.look.patch()
    };
    if may_begin && (!is_current || is_due) && surfaces.failed.as_ref() != Some(&key) {
        let (wanted, patch, since, stall) = (key.clone(), patch(), Instant::now(), preset.residency.stall());
        let task = with_heights(&open.session, move |session| {
            session.wait_for(stall);
            ask(session, &patch, wanted, since)
        });
        surfaces.task = Some((key.clone(), task));
    }
    // Depths of another view hide the wrong things.
    if hiding.0.is_some() && surfaces.known_at_rest.as_ref().is_some_and(|known| known.content.view != view) {
        (hiding.0, surfaces.known_at_rest) = (None, None);
    }
    let is_known = surfaces.known_at_rest.as_ref() == Some(&key);
    if !is_known {
        // Heights of another picture are not on its lines.
        written.show(None);
    }
    if is_current && is_drawn && rests && !is_known && surfaces.at_rest.is_none() {
        let (view, patch) = (view.resized(size.x, size.y), patch());
        let task = with_heights(&open.session, move |session| find_at_rest(session, &patch, &view));
        surfaces.at_rest = Some((key.clone(), task));
    }
    let (entity, shown) = camera.into_inner();
    let mut camera = commands.entity(entity);
    let Some(asked) = &surfaces.asked else { return };
    // No copies of pages are there beside it.
    let memory = preset.residency.gpu_bytes().iter().sum();
    camera.insert((
        SurfaceView { number: asked.number, job: Arc::clone(&asked.job), memory, is_colored: true },
        SplatView::without_particles(view, &surfaces.items),
    ));
    let light = LightView { before: before.fade().map(|(image, share)| Fading { image: Arc::clone(image), share }) };
    if shown != Some(&light) {
        camera.insert(light);
    }
    let is_whole = asked.report.is_complete && is_current && is_drawn && is_known;
    converged.0 = is_whole && rests && size == full && look.settled && before.is_settled();
}

/// What a task has come to, once.
fn arrived<T>(awaited: &mut Awaited<T>) -> Option<(Key, Result<T, String>)> {
    let outcome = check_ready(&mut awaited.as_mut()?.1)?;
    awaited.take().map(|(key, _)| (key, outcome))
}

/// Does something with the heights that are open, on a background task.
fn with_heights<T: Send + 'static>(
    session: &Arc<Mutex<AnySession>>,
    work: impl FnOnce(&mut SurfaceSession) -> Result<T, String> + Send + 'static,
) -> Task<Result<T, String>> {
    let session = Arc::clone(session);
    AsyncComputeTaskPool::get().spawn(async move {
        match &mut *session.lock().unwrap_or_else(PoisonError::into_inner) {
            AnySession::Surface(session) => work(session),
            _ => Err("there are no heights that are open alone".to_owned()),
        }
    })
}

/// Depths, and heights along lines, of a picture.
fn find_at_rest(session: &mut SurfaceSession, patch: &LookPatch, view: &View) -> Result<AtRest, String> {
    let depths = session.depths(patch, view).map_err(|error| error.to_string())?;
    let heights = session.lettering(patch, view).map_err(|error| error.to_string())?;
    Ok(AtRest { depths, heights })
}

/// What the adapter is to draw of a picture.
fn ask(session: &mut SurfaceSession, patch: &LookPatch, key: Key, since: Instant) -> Result<Asked, String> {
    let view = key.content.view.resized(key.size.x, key.size.y);
    let passes = match key.content.technique {
        Technique::Compute => Passes::Compute,
        Technique::Raster => Passes::Raster,
    };
    let asked = session.asked(patch, &view, None, passes).map_err(|error| error.to_string())?;
    let exposure = Exposure::of_heights(session.opened(), asked.attribute, asked.transfer.scale, asked.levels);
    let (job, report) = asked.picture.ok_or("no passes draw this picture of heights")?;
    let report = Report::of_heights(&report, asked.error.is_none(), session);
    Ok(Asked { number: 0, key, job: Arc::new(job), report, exposure, since })
}
