//! Drawing a volume that is open alone with the adapter: its samples fill the grid of the data camera's passes, or are added up along rays.
//!
//! What is drawn (its samples, or the points that stand for them) is prepared on a background task; then every view is a job of the passes.
//! While the view moves, pictures have as many pixels as there is time for; one that is on its way is completed before the next begins.

use crate::color::Accumulation;
use crate::color::transfer::TransferFunction;
use crate::cpu::field::Field;
use crate::cpu::volume::VolumeError;
use crate::gpu::integrals::{IntegralNews, IntegralView};
use crate::gpu::measure::{Measure, Measured, MeasuredPicture};
use crate::gpu::volume::{VolumeJob, VolumeNews};
use crate::gpu::{Composite, DrawItem, Fading, LightView, SplatView, VolumeView};
use crate::look::{LookPatch, Shot};
use crate::mode::FieldPasses;
use crate::picture::field::PreparedField;
use crate::view::View;
use crate::view::perspective_grid::GridError;
use crate::window::exposure::Exposure;
use crate::window::look::{Held, Look};
use crate::window::pages::ViewSelection;
use crate::window::pass_times::LastPasses;
use crate::window::picture::{DataCamera, Picture};
use crate::window::picture_sizes::{Wanted, moving_ms};
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
    /// What light is painted with; none for sums.
    transfer: Option<TransferFunction>,
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
    job: Job,
}

/// What the passes do.
enum Job {
    /// Nothing is in view.
    Nothing,
    /// They march through the samples.
    March(Box<VolumeJob>),
    /// They add the samples up along rays.
    Integrals(Arc<Field>),
}

/// The pictures that the adapter draws of the volume that is open.
#[derive(Resource, Default)]
pub(in crate::window) struct FieldOnAdapter {
    task: Option<(Content, Task<Result<Ready, String>>)>,
    ready: Option<Ready>,
    failed: Option<Content>,
    asked: Option<Asked>,
    wanted: Wanted<(Content, View)>,
    items: Arc<[DrawItem]>,
    /// Slabs that a frame draws.
    slabs: u32,
    /// Counts jobs.
    number: u64,
    /// The sums that the exposure is of.
    exposed: Option<Arc<Measured>>,
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
                // That of sums is of the picture.
                if ready.content.transfer.is_some() {
                    exposure.set_if_neq(ready.exposure.clone());
                }
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
                let job = VolumeJob::of_field(number, &view, &prepared.field, prepared.hue_channel(), &march);
                Job::March(Box::new(job))
            }
            Ok(Some(FieldPasses::Integrals)) => {
                // Another list is another picture.
                self.items = Vec::new().into();
                Job::Integrals(Arc::clone(&prepared.field))
            }
            // A view without data is a black picture, and no error.
            Ok(None) | Err(VolumeError::Grid(GridError::NothingInView)) => Job::Nothing,
            Err(error) => {
                notices.error(error.to_string());
                Job::Nothing
            }
        };
        self.asked = Some(Asked { number, content: content.clone(), view, since: Instant::now(), job });
    }
}

/// Tells the data camera what to draw of a volume.
pub(in crate::window) fn draw_field_on_adapter(
    mut commands: Commands,
    mut field: ResMut<FieldOnAdapter>,
    (backend, last_passes): (Res<ActiveBackend>, Res<LastPasses>),
    (news, integral_news, measured): (Res<VolumeNews>, Res<IntegralNews>, Res<MeasuredPicture>),
    (scene, look, selection): (Option<Res<Scene>>, Option<Res<Look>>, Res<ViewSelection>),
    (settings, held): (Res<Settings>, Res<Held>),
    (picture, preset, before): (Res<Picture>, Res<Preset>, Res<Before>),
    (mut exposure, mut statistics): (ResMut<Exposure>, ResMut<Statistics>),
    (mut converged, mut notices): (ResMut<Converged>, ResMut<Notices>),
    camera: Single<(Entity, Option<&LightView>, Option<&Composite>), With<DataCamera>>,
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
    let is_light = look.depiction.mode.is_light();
    let (dataset, depiction) = (scene.dataset, look.depiction_revision);
    let content = Content { dataset, depiction, transfer: is_light.then(|| transfer.clone()) };
    let full = picture.size();
    let (size, rests) = field.wanted.follow(&(content.clone(), view), full, &preset);
    // Sums are composed pixel by pixel.
    let size = if is_light { size } else { full };
    let is_ready = field.ready.as_ref().is_some_and(|ready| ready.content == content);
    if !is_ready && field.task.is_none() && field.failed.as_ref() != Some(&content) {
        let patch = LookPatch { transfer: Some(transfer), time: None, ..settings.look.patch() };
        let (session, wanted) = (Arc::clone(&open.session), content.clone());
        let task = AsyncComputeTaskPool::get().spawn(async move {
            let mut session = session.lock().unwrap_or_else(PoisonError::into_inner);
            let session = session.field().ok_or("no passes draw heights")?;
            let prepared = session.prepare(&Shot { look: patch, ..Shot::default() });
            let prepared = prepared.map_err(|error| error.to_string())?;
            let exposure = if is_light { Exposure::of_field(&prepared) } else { Exposure::default() };
            Ok(Ready { content: wanted, exposure, prepared })
        });
        field.task = Some((content.clone(), task));
    }

    let (found, summed) = (news.now(), integral_news.now());
    let is_done = |asked: &Asked| match asked.job {
        Job::Nothing => true,
        Job::March(_) => found.drawn == Some(asked.number),
        Job::Integrals(_) => summed.number == asked.number && summed.is_drawn,
    };
    let is_drawn = field.asked.as_ref().is_some_and(is_done);
    if let Some(asked) = field.asked.as_ref().filter(|asked| is_drawn && field.seen != asked.number) {
        field.seen = asked.number;
        let milliseconds = 1e3 * asked.since.elapsed().as_secs_f64();
        field.wanted.took(UVec2::new(asked.view.width, asked.view.height), milliseconds);
        statistics.draw_ms = Some(milliseconds);
    }
    let of_sums = Some(summed.number).filter(|_| summed.no_room);
    if let Some(asked) = &field.asked
        && [found.no_room, of_sums].contains(&Some(asked.number))
    {
        notices.error("the graphics memory is too small for this volume: the processor draws it");
        field.refused = Some(scene.dataset);
    }
    let coarser = found.coarser.is_some_and(|(number, _)| number >= FIRST_NUMBER) || summed.coarser.is_some();
    if coarser && !std::mem::replace(&mut field.told_coarser, true) {
        notices.info("the graphics memory is too small for all samples: means of some are drawn");
    }

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
    let budget = moving_ms(&preset);
    let spent: f64 = statistics.passes.iter().map(|(_, milliseconds)| milliseconds).sum();
    field.slabs = match field.slabs {
        0 => 1,
        slabs if spent > budget => (slabs / 2).max(1),
        slabs if spent < 0.4 * budget && !is_drawn => (2 * slabs).min(1024),
        slabs => slabs,
    };
    // No copies of pages are there beside it.
    let memory = preset.residency.gpu_bytes().iter().sum();
    let (entity, shown, composed) = camera.into_inner();
    let mut camera = commands.entity(entity);
    let is_ready_picture = is_ready && is_current && is_drawn;
    let asked = field.asked.as_ref();
    match asked.map(|asked| (asked.number, asked.view, &asked.job)) {
        Some((number, from, Job::Integrals(samples))) => {
            let integrals = IntegralView { number, field: Arc::clone(samples), memory };
            camera.insert((integrals, SplatView::without_particles(from, &field.items), Measure));
            camera.remove::<(VolumeView, LightView)>();
            let composite = look.composite(before.fade(), None);
            let is_same = composed.is_some_and(|composed| composed.is_same(&composite));
            if !is_same {
                camera.insert(composite);
            }
            let is_own = |found: &Arc<Measured>| found.view == from && Arc::ptr_eq(&found.items, &field.items);
            let sums = measured.now().filter(is_own);
            if let Some(sums) = &sums
                && (field.exposed.as_ref().is_none_or(|known| !Arc::ptr_eq(known, sums)) || look.is_changed())
            {
                let cells = Accumulation { ps: Vec::new(), ..sums.cells.clone() };
                exposure.set_if_neq(Exposure::of(&cells, &look.transfer));
                field.exposed = Some(Arc::clone(sums));
            }
            converged.0 = is_ready_picture && is_same && sums.is_some();
        }
        drawn => {
            match drawn {
                Some((.., Job::March(job))) => {
                    camera.insert(VolumeView::of_field(VolumeJob::clone(job), memory, field.slabs));
                }
                _ => {
                    camera.remove::<VolumeView>();
                }
            }
            camera.remove::<(IntegralView, Composite, Measure)>();
            camera.insert(SplatView::without_particles(view, &field.items));
            let before = before.fade().map(|(image, share)| Fading { image: Arc::clone(image), share });
            let light = LightView { before };
            if shown != Some(&light) {
                camera.insert(light);
            }
            converged.0 = is_ready_picture;
        }
    }
    converged.0 &= rests && look.settled && before.is_settled();
}
