//! Drawing a volume that is open alone with the adapter: its samples fill the grid of the data camera's passes.
//!
//! What is drawn (its samples, or the points that stand for them) is prepared on a background task; then every view is a job of the passes.
//! While the view moves, pictures have as many pixels as there is time for; one that is on its way is completed before the next begins.

use crate::color::transfer::TransferFunction;
use crate::cpu::volume::VolumeError;
use crate::gpu::volume::{VolumeJob, VolumeNews};
use crate::gpu::{self, DrawItem, Fading, LightView, SplatView, VolumeView};
use crate::look::{LookPatch, Shot};
use crate::mode::FieldPasses;
use crate::model::Kernel;
use crate::picture::field::PreparedField;
use crate::view::View;
use crate::view::perspective_grid::GridError;
use crate::window::exposure::Exposure;
use crate::window::look::{Held, Look};
use crate::window::pages::ViewSelection;
use crate::window::pass_times::LastPasses;
use crate::window::picture::{DataCamera, Picture};
use crate::window::picture_sizes::moving_size;
use crate::window::preset::Preset;
use crate::window::scene::{Scene, Settings};
use crate::window::state::notices::Notices;
use crate::window::statistics::{ActiveBackend, Converged, Statistics};
use crate::window::touring::Before;
use bevy::prelude::*;
use bevy::tasks::{AsyncComputeTaskPool, Task, futures::check_ready};
use std::sync::{Arc, PoisonError};
use std::time::Instant;

/// Jobs of fields are named from here on, so that none has the name of one of particles.
const FIRST_NUMBER: u64 = 1 << 40;

/// What is drawn, from wherever.
#[derive(Clone, PartialEq)]
struct Content {
    dataset: u32,
    depiction: u64,
    transfer: TransferFunction,
}

/// What is drawn, ready for any view.
struct Ready {
    content: Content,
    prepared: PreparedField,
    exposure: Exposure,
}

/// The picture that was asked for last.
struct Asked {
    number: u64,
    content: Content,
    view: View,
    since: Instant,
    /// `None` where nothing is in view.
    job: Option<VolumeJob>,
}

/// The pictures that the adapter draws of the volume that is open.
#[derive(Resource, Default)]
pub(in crate::window) struct FieldOnAdapter {
    task: Option<(Content, Task<Result<Ready, String>>)>,
    ready: Option<Ready>,
    failed: Option<Content>,
    asked: Option<Asked>,
    /// What is wanted, and since when.
    moved: Option<(Content, View, Instant)>,
    /// Size and milliseconds of the last picture.
    cost: Option<(UVec2, f64)>,
    items: Arc<[DrawItem]>,
    /// Slabs that a frame draws.
    slabs: u32,
    /// Counts jobs.
    number: u64,
    /// The last picture that was seen to be complete.
    seen: u64,
    told_coarser: bool,
    /// The dataset for which the adapter has no room.
    refused: Option<u32>,
}

impl FieldOnAdapter {
    /// Whether the adapter has no room for what is open.
    pub(in crate::window) fn is_refused(&self, scene: &Scene) -> bool {
        self.refused == Some(scene.dataset)
    }

    /// Takes in what has been prepared.
    fn receive(&mut self, exposure: &mut ResMut<Exposure>, notices: &mut Notices) {
        let Some((_, task)) = &mut self.task else { return };
        let Some(outcome) = check_ready(task) else { return };
        let content = self.task.take().map(|(content, _)| content);
        match outcome {
            Ok(ready) => {
                exposure.set_if_neq(ready.exposure.clone());
                self.ready = Some(ready);
            }
            Err(why) => {
                notices.error(why);
                self.failed = content;
            }
        }
    }

    /// Asks for a picture of what is ready, as large as said.
    fn ask(&mut self, view: View, notices: &mut Notices) {
        let Some(Ready { content, prepared, .. }) = &self.ready else { return };
        self.number += 1;
        let number = FIRST_NUMBER + self.number;
        let job = match prepared.passes(&view) {
            Ok(Some(FieldPasses::March(march))) => {
                Some(VolumeJob::of_field(number, &view, &prepared.field, prepared.hue_channel(), &march))
            }
            // A view without data is a black picture, and no error.
            Ok(_) | Err(VolumeError::Grid(GridError::NothingInView)) => None,
            Err(error) => {
                notices.error(error.to_string());
                None
            }
        };
        self.asked = Some(Asked { number, content: content.clone(), view, since: Instant::now(), job });
    }
}

/// Tells the data camera what to draw of a volume.
pub(in crate::window) fn draw_field_on_adapter(
    mut commands: Commands,
    mut field: ResMut<FieldOnAdapter>,
    (backend, news, last_passes): (Res<ActiveBackend>, Res<VolumeNews>, Res<LastPasses>),
    (scene, look, selection): (Option<Res<Scene>>, Option<Res<Look>>, Res<ViewSelection>),
    (settings, held): (Res<Settings>, Res<Held>),
    (picture, preset, before): (Res<Picture>, Res<Preset>, Res<Before>),
    (mut exposure, mut statistics): (ResMut<Exposure>, ResMut<Statistics>),
    (mut converged, mut notices): (ResMut<Converged>, ResMut<Notices>),
    camera: Single<(Entity, Option<&LightView>), With<DataCamera>>,
) {
    if *backend != ActiveBackend::FieldOnGpu {
        if field.ready.is_some() || field.task.is_some() {
            (statistics.points, statistics.slabs, statistics.work_bytes) = (None, None, 0);
            let (number, refused) = (field.number, field.refused);
            *field = FieldOnAdapter { number, refused, ..default() };
        }
        return;
    }
    // Nothing waits for changes of it but who chooses what draws.
    let field = field.bypass_change_detection();
    converged.0 = false;
    if statistics.backend != "compute" {
        "compute".clone_into(&mut statistics.backend);
    }
    field.receive(&mut exposure, &mut notices);
    let (Some(scene), Some(look), Some(view)) = (scene, look, selection.view) else { return };
    let Some(open) = scene.field_for(look.depiction.mode) else { return };
    // Ranges that are given are not looked for in each picture.
    let given = held.0.filter(|levels| levels.p[0] < levels.p[1]);
    let transfer = given.map_or_else(|| look.transfer.clone(), |levels| look.transfer.clone().with_levels(&levels));
    let content = Content { dataset: scene.dataset, depiction: look.depiction_revision, transfer };
    if field.moved.as_ref().is_none_or(|(known, from, _)| *known != content || *from != view) {
        field.moved = Some((content.clone(), view, Instant::now()));
    }
    let motion = &preset.motion;
    let rests =
        field.moved.as_ref().is_some_and(|(.., since)| since.elapsed().as_millis() >= u128::from(motion.rest_ms));
    let is_ready = field.ready.as_ref().is_some_and(|ready| ready.content == content);
    if !is_ready && field.task.is_none() && field.failed.as_ref() != Some(&content) {
        let patch = LookPatch { transfer: Some(content.transfer.clone()), time: None, ..settings.look.patch() };
        let (session, wanted) = (Arc::clone(&open.session), content.clone());
        let task = AsyncComputeTaskPool::get().spawn(async move {
            let mut session = session.lock().unwrap_or_else(PoisonError::into_inner);
            let session = session.field().ok_or("no passes draw heights")?;
            let prepared = session.prepare(&Shot { look: patch, ..Shot::default() });
            let prepared = prepared.map_err(|error| error.to_string())?;
            Ok(Ready { content: wanted, exposure: Exposure::of_field(&prepared), prepared })
        });
        field.task = Some((content.clone(), task));
    }

    let found = news.now();
    let budget = if preset.drawing.frame_ms > 0.0 { preset.drawing.frame_ms } else { motion.volume_ms };
    if let Some(asked) = &field.asked
        && found.drawn == Some(asked.number)
        && field.seen != asked.number
    {
        field.seen = asked.number;
        let milliseconds = 1e3 * asked.since.elapsed().as_secs_f64();
        field.cost = Some((UVec2::new(asked.view.width, asked.view.height), milliseconds));
        statistics.draw_ms = Some(milliseconds);
    }
    let wants = |asked: &Asked| asked.job.is_some() && found.drawn != Some(asked.number);
    let is_drawn = field.asked.as_ref().is_some_and(|asked| !wants(asked));
    if let Some(asked) = field.asked.as_ref().filter(|asked| asked.job.is_some())
        && found.no_room == Some(asked.number)
    {
        notices.error("the graphics memory is too small for this volume: the processor draws it");
        field.refused = Some(scene.dataset);
    }
    if found.coarser.is_some_and(|(number, _)| number >= FIRST_NUMBER)
        && !std::mem::replace(&mut field.told_coarser, true)
    {
        notices.info("the graphics memory is too small for all samples: means of some are drawn");
    }

    let full = picture.size();
    let size = if rests { full } else { moving_size(full, field.cost, budget, motion) };
    let seen = view.resized(size.x, size.y);
    let is_asked =
        |asked: &Asked| asked.view == seen && field.ready.as_ref().is_some_and(|ready| ready.content == asked.content);
    let is_current = field.asked.as_ref().is_some_and(is_asked);
    if !is_current && (is_drawn || field.asked.is_none()) {
        field.ask(seen, &mut notices);
    }
    if let Some(ready) = &field.ready {
        (statistics.points, statistics.levels) = (Some(ready.prepared.report), ready.prepared.drawn_from());
        (statistics.particles, statistics.nodes) = (0, ready.prepared.report.nodes as usize);
        (statistics.sampled, statistics.live, statistics.missing) = (None, None, 0);
        (statistics.error_px, statistics.hidden) = (0.0, 0);
    }
    statistics.passes = last_passes.of_picture().map(|times| times.passes).unwrap_or_default();
    (statistics.slabs, statistics.work_bytes) = (Some(found.slabs), found.bytes);
    // As many slabs a frame as there is time for: twice as many while frames are short, half where they are long.
    let spent: f64 = statistics.passes.iter().map(|(_, milliseconds)| milliseconds).sum();
    field.slabs = match field.slabs {
        0 => 1,
        slabs if spent > budget => (slabs / 2).max(1),
        slabs if spent < 0.4 * budget && !is_drawn => (2 * slabs).min(1024),
        slabs => slabs,
    };
    // No copies of pages are there beside it.
    let memory = preset.residency.gpu_bytes().iter().sum();
    let (entity, shown) = camera.into_inner();
    let mut camera = commands.entity(entity);
    match field.asked.as_ref().and_then(|asked| asked.job.clone()) {
        Some(job) => {
            camera.insert(VolumeView::of_field(job, memory, field.slabs));
        }
        None => {
            camera.remove::<VolumeView>();
        }
    }
    camera.insert(SplatView {
        view,
        footprint: gpu::Footprint::Kernel(Kernel::default()),
        backend: gpu::Backend::Compute,
        culling: true,
        faintest: 0.0,
        items: Arc::clone(&field.items),
        keeps_last: false,
        always: false,
    });
    let light = LightView { before: before.fade().map(|(image, share)| Fading { image: Arc::clone(image), share }) };
    if shown != Some(&light) {
        camera.insert(light);
    }
    converged.0 = is_ready && is_current && is_drawn && rests && look.settled && before.is_settled();
}
