//! Drawing an image, a volume or heights that are open alone, with the processor, on background tasks: the samples, or what stands for them.
//! Where an adapter draws a volume, [`on_adapter`] does; where it draws heights, [`surface_on_adapter`].
//!
//! While the view moves, or what is drawn changes, pictures have as many pixels as there is time for; when it rests, the full one follows.
//! Sums are kept, so that other colours need no other picture.

pub(super) mod on_adapter;
pub(super) mod surface_on_adapter;

use self::on_adapter::FieldOnAdapter;
use self::surface_on_adapter::SurfaceOnAdapter;
use super::exposure::Exposure;
use super::hidden::Hiding;
use super::live::LiveParticles;
use super::look::{Held, Look};
use super::pages::ViewSelection;
use super::picture::{Letterbox, Picture, to_image};
use super::picture_sizes::{LightSamples, Wanted, volume_limit};
use super::preset::{Backend, Preset};
use super::scene::{Scene, Settings};
use super::scene_io::families_of;
use super::state::notices::Notices;
use super::statistics::{ActiveBackend, Converged, Statistics};
use super::touring::Before;
use crate::color::composite::composite_glowing;
use crate::color::transfer::{Levels, TransferFunction};
use crate::color::{Accumulation, Bloom, Image as Colors};
use crate::cpu::surface::SurfaceReport;
use crate::cpu::volume::VolumeError;
use crate::look::{LookPatch, Member, Shot};
use crate::mode::{Depiction, Raw};
use crate::model::FamilyName;
use crate::picture::fade::faded;
use crate::picture::field::{FieldSession, PointsReport};
use crate::picture::mixed::{Colored, MixedSession, OpenMixed};
use crate::picture::surface::{SurfaceDepths, SurfaceSession};
use crate::picture::{AnySession, PictureError, Subject};
use crate::view::View;
use crate::view::perspective_grid::GridError;
use bevy::prelude::*;
use bevy::tasks::{AsyncComputeTaskPool, Task, futures::check_ready};
use std::sync::{Arc, PoisonError};
use std::time::Instant;

/// What a picture depends on, whatever its size and the colours of its sums.
#[derive(Clone, PartialEq)]
struct Content {
    dataset: u32,
    depiction: u64,
    view: View,
    /// What light is painted with; none for sums.
    transfer: Option<TransferFunction>,
    /// How far heights may be from where they are, pixels.
    error_px: f64,
    /// Of particles among heights: which families of each dataset are drawn.
    families: Vec<Option<Vec<FamilyName>>>,
    /// How its light spreads.
    bloom: Bloom,
}

/// A picture.
#[derive(Clone, PartialEq)]
struct Key {
    content: Content,
    size: UVec2,
    /// From how many samples its light is found, where surfaces darken each other.
    light_samples: Option<u32>,
}

/// What was drawn: sums, or light in its own colours.
#[derive(Clone)]
enum Values {
    Sums(Arc<Accumulation>),
    Light(Arc<Colors>),
}

/// A finished picture.
struct Drawn {
    key: Key,
    values: Values,
    /// What colours sums were given.
    colored: (Levels, TransferFunction),
    image: Arc<Colors>,
    exposure: Exposure,
    report: Report,
    /// How far heights are away.
    depths: Option<Arc<SurfaceDepths>>,
    /// How long it took, where it was drawn anew.
    milliseconds: Option<f64>,
}

/// What is known of a picture.
#[derive(Clone, Debug)]
struct Report {
    /// Of images and volumes: how near points come to the samples.
    points: Option<PointsReport>,
    /// Nodes or chunks drawn.
    nodes: u64,
    /// Samples of heights drawn.
    samples: u64,
    /// The largest distance from where it is, pixels.
    error_px: f64,
    /// What it was drawn from.
    drawn_from: &'static str,
    /// Whether nothing is missing.
    is_complete: bool,
    /// What is to be told of pages, once.
    told: Vec<String>,
    /// When another picture may have pages that this one does without.
    again: Option<Instant>,
}

impl Report {
    /// Of heights, all of which could be read or not.
    fn of_heights(report: &SurfaceReport, is_readable: bool, session: &SurfaceSession) -> Report {
        Report {
            points: None,
            nodes: report.nodes_drawn,
            samples: report.samples_drawn,
            error_px: report.error_px,
            drawn_from: "chunks",
            is_complete: report.is_converged && is_readable,
            told: session.take_messages(),
            again: session.again(),
        }
    }

    /// Whether another picture may have what this one does without.
    fn is_due(&self) -> bool {
        self.again.is_some_and(|at| at <= Instant::now())
    }

    /// Tells it.
    fn tell(&self, statistics: &mut Statistics) {
        (statistics.points, statistics.levels) = (self.points, self.drawn_from);
        (statistics.sampled, statistics.live, statistics.slabs) = (None, None, None);
        (statistics.particles, statistics.nodes, statistics.missing) = (self.samples, self.nodes as usize, 0);
        (statistics.error_px, statistics.hidden) = (self.error_px, 0);
    }
}

/// The picture of the field that is open, and the task that draws the next one.
#[derive(Resource, Default)]
pub(super) struct FieldPicture {
    task: Option<(Key, Task<Result<Drawn, String>>)>,
    drawn: Option<Drawn>,
    wanted: Wanted<Content>,
    failed: Option<Key>,
    /// The dataset whose several kinds have what draws beside the processor, and for which backend.
    given: Option<(u32, Backend)>,
    /// Counts pictures.
    number: u64,
    /// What the window shows: the number, and what is blended with it.
    shown: Option<(u64, Option<(u64, u32)>)>,
}

/// Whether a mode of fields is shown of the field that is open. Particles that move are drawn in its place.
pub(super) fn is_wanted(scene: Option<&Scene>, settings: &Settings, live: &LiveParticles) -> bool {
    scene.is_some_and(|scene| scene.field_for(settings.mode).is_some()) && live.particles().is_none()
}

/// Whether it is shown now and was not before, or the other way round; or whether the adapter has room for it, and draws it.
pub(super) fn came_or_went(
    scene: Option<Res<Scene>>,
    settings: Res<Settings>,
    live: Res<LiveParticles>,
    (adapter, surfaces): (Res<FieldOnAdapter>, Res<SurfaceOnAdapter>),
    mut before: Local<[bool; 3]>,
) -> bool {
    let is_refused = scene.as_ref().is_some_and(|scene| adapter.is_refused(scene));
    let has_passes = scene.as_ref().is_some_and(|scene| surfaces.draws(scene, &settings));
    let now = [is_wanted(scene.as_deref(), &settings, &live), is_refused, has_passes];
    std::mem::replace(&mut *before, now) != now
}

/// Takes in what has been drawn, and starts to draw what is wanted now.
pub(super) fn draw_field(
    mut field: ResMut<FieldPicture>,
    backend: Res<ActiveBackend>,
    (scene, look, selection): (Option<Res<Scene>>, Option<Res<Look>>, Res<ViewSelection>),
    (settings, held): (Res<Settings>, Res<Held>),
    (picture, preset): (Res<Picture>, Res<Preset>),
    (mut exposure, mut statistics, mut hiding): (ResMut<Exposure>, ResMut<Statistics>, ResMut<Hiding>),
    (mut converged, mut notices): (ResMut<Converged>, ResMut<Notices>),
) {
    let field = field.bypass_change_detection();
    if *backend != ActiveBackend::Field {
        if field.drawn.is_some() || field.task.is_some() {
            statistics.points = None;
            hiding.0 = None;
            *field = FieldPicture::default();
        }
        return;
    }
    converged.0 = false;
    if statistics.backend != "cpu" {
        "cpu".clone_into(&mut statistics.backend);
    }
    if let Some((_, task)) = &mut field.task
        && let Some(outcome) = check_ready(task)
    {
        let key = field.task.take().map(|(key, _)| key);
        match outcome {
            Ok(mut drawn) => {
                drawn.report.told.drain(..).for_each(|message| notices.error(message));
                exposure.set_if_neq(drawn.exposure.clone());
                hiding.0.clone_from(&drawn.depths);
                if let Some(milliseconds) = drawn.milliseconds {
                    let light = LightSamples::of(&settings.look.settings).zip(drawn.key.light_samples);
                    let in_motion =
                        light.map_or(milliseconds, |(light, samples)| light.in_motion(milliseconds, samples));
                    field.wanted.took(drawn.key.size, in_motion);
                }
                field.number += 1;
                field.drawn = Some(drawn);
            }
            Err(why) => {
                notices.error(why);
                field.failed = key;
            }
        }
    }
    if let Some(drawn) = &field.drawn {
        statistics.draw_ms = drawn.milliseconds.or(field.wanted.milliseconds());
        drawn.report.tell(&mut statistics);
        statistics.passes.clear();
    }
    let (Some(scene), Some(look), Some(view)) = (scene, look, selection.view) else { return };
    let Some(open) = scene.field_for(look.depiction.mode) else { return };
    // Sums among heights are coloured where these are drawn.
    let is_mixed = open.opened.mixed().is_some();
    let is_light = look.depiction.mode.is_light() || is_mixed;
    // Ranges that are given are not looked for in each picture.
    let given = held.0.filter(|levels| is_light && levels.p[0] < levels.p[1]);
    // Each field has it in its own way.
    let transfer = given.map_or_else(|| look.chosen.clone(), |levels| look.chosen.clone().with_levels(&levels));
    let (dataset, depiction) = (scene.dataset, look.depiction_revision);
    let families = if is_mixed { families_of(&scene, &settings) } else { Vec::new() };
    let (transfer_of_light, error_px) = (is_light.then(|| transfer.clone()), settings.error_px);
    let bloom = settings.bloom;
    let content = Content { dataset, depiction, view, transfer: transfer_of_light, error_px, families, bloom };
    let full = picture.size();
    let (size, rests) = field.wanted.follow(&content, full, &preset);
    let last = field.drawn.as_ref().filter(|drawn| drawn.key.content == content && drawn.key.size == size);
    let last = last.and_then(|drawn| drawn.key.light_samples);
    let light_samples = LightSamples::of(&settings.look.settings).map(|light| light.next(rests, last));
    let key = Key { content, size, light_samples };
    let drawn = field.drawn.as_ref().filter(|drawn| drawn.key == key);
    let colored = (look.levels, transfer.clone());
    let is_current = drawn.is_some_and(|drawn| is_light || drawn.colored == colored);
    converged.0 =
        is_current && drawn.is_some_and(|drawn| drawn.report.is_complete) && rests && size == full && look.settled;
    let is_due = drawn.is_some_and(|drawn| drawn.report.is_due());
    if field.task.is_some() || (is_current && !is_due) || field.failed.as_ref() == Some(&key) {
        return;
    }
    let reused = drawn.map(|drawn| drawn.values.clone());
    let shown = look.depiction.clone();
    let mut look = LookPatch { transfer: Some(transfer), time: None, ..settings.look.patch() };
    LightSamples::set(&mut look.settings, light_samples);
    let (session, wanted) = (Arc::clone(&open.session), key.clone());
    let (backend, stall) = (preset.drawing.backend, preset.residency.stall());
    let is_given = field.given.replace((dataset, backend)) == Some((dataset, backend));
    let among = open.opened.mixed().cloned().map(|opened| {
        let members = scene.members.iter().cloned().zip(&wanted.content.families);
        let members: Vec<Member> =
            members.map(|(member, families)| Member { families: families.clone(), ..member }).collect();
        Among {
            members: opened.of_particles(&members),
            opened,
            depiction: shown.clone(),
            diameter: scene.frame.size().length(),
            limit: volume_limit(!rests, false, scene.metadata().particles(), &preset.motion),
            by: (!is_given).then_some(backend),
        }
    });
    let task = AsyncComputeTaskPool::get().spawn(async move {
        let mut session = session.lock().unwrap_or_else(PoisonError::into_inner);
        match &mut *session {
            AnySession::Field(session) => draw(session, &Shot { look, ..Shot::default() }, wanted, reused, colored),
            AnySession::Surface(session) => {
                session.wait_for(stall);
                draw_surface(session, &look, wanted, colored)
            }
            AnySession::Mixed(session) => match among {
                Some(among) => {
                    session.wait_for(stall);
                    draw_mixed(session, &look, wanted, colored, among)
                }
                None => Err("it is not open as several kinds of data".to_owned()),
            },
            AnySession::Particles(_) => Err("particles are drawn elsewhere".to_owned()),
        }
    });
    field.task = Some((key, task));
}

/// Draws a picture, or colours what was drawn.
fn draw(
    session: &mut FieldSession,
    shot: &Shot,
    key: Key,
    reused: Option<Values>,
    (levels, transfer): (Levels, TransferFunction),
) -> Result<Drawn, String> {
    let start = Instant::now();
    let told = |error: PictureError| error.to_string();
    let prepared = session.prepare(shot).map_err(told)?;
    let is_new = reused.is_none();
    let (width, height) = (key.size.x, key.size.y);
    let values = match reused {
        Some(values) => values,
        None => match prepared.draw(&key.content.view.resized(width, height)) {
            Ok(Raw::Light(light)) => Values::Light(Arc::new(key.content.bloom.image(&light.colors))),
            Ok(Raw::Sums(sums, _)) => Values::Sums(Arc::new(sums)),
            // A view without data is a black picture, and no error.
            Err(VolumeError::Grid(GridError::NothingInView)) => Values::Light(Arc::new(Colors::black(width, height))),
            Err(error) => return Err(error.to_string()),
        },
    };
    let (image, exposure) = match &values {
        Values::Light(image) => (Arc::clone(image), Exposure::of_field(&prepared)),
        Values::Sums(sums) => {
            let image = composite_glowing(sums, &transfer, &levels, &key.content.bloom);
            (Arc::new(image), Exposure::of(sums, &transfer))
        }
    };
    Ok(Drawn {
        key,
        values,
        colored: (levels, transfer),
        image,
        exposure,
        report: Report {
            points: Some(prepared.report),
            nodes: prepared.report.nodes,
            samples: 0,
            error_px: 0.0,
            drawn_from: prepared.drawn_from(),
            is_complete: true,
            told: Vec::new(),
            again: None,
        },
        depths: None,
        milliseconds: is_new.then(|| 1e3 * start.elapsed().as_secs_f64()),
    })
}

/// Draws a picture of heights.
fn draw_surface(
    session: &mut SurfaceSession,
    look: &LookPatch,
    key: Key,
    colored: (Levels, TransferFunction),
) -> Result<Drawn, String> {
    let start = Instant::now();
    let (width, height) = (key.size.x, key.size.y);
    let view = key.content.view.resized(width, height);
    let seen = session.seen(look, &view, None).map_err(|error| error.to_string())?;
    let exposure = Exposure::of_heights(session.opened(), seen.attribute, seen.transfer.scale, seen.levels);
    let report = Report::of_heights(&seen.picture.report, seen.error.is_none(), session);
    let image = Arc::new(key.content.bloom.image(&seen.picture.colors));
    let depths = SurfaceDepths::new(view, seen.picture.depth).map(Arc::new);
    let milliseconds = Some(1e3 * start.elapsed().as_secs_f64());
    Ok(Drawn { key, values: Values::Light(Arc::clone(&image)), colored, image, exposure, report, depths, milliseconds })
}

/// What is drawn of particles among other data.
struct Among {
    opened: Arc<OpenMixed>,
    /// The particles, with the families that are drawn.
    members: Vec<Member>,
    depiction: Depiction,
    /// How large they are.
    diameter: f64,
    /// How many particles there is time for.
    limit: u64,
    /// What is asked to draw from now on, where that is not what was asked before.
    by: Option<Backend>,
}

/// Draws a picture of several kinds of data.
fn draw_mixed(
    session: &mut MixedSession,
    look: &LookPatch,
    key: Key,
    colored: (Levels, TransferFunction),
    among: Among,
) -> Result<Drawn, String> {
    let start = Instant::now();
    let Among { opened, members, depiction, diameter, limit, by } = among;
    if let Some(backend) = by {
        session.use_adapter(backend.beside());
    }
    if let Some(particles) = session.particles() {
        particles.show_members(members);
    }
    let view = key.content.view.resized(key.size.x, key.size.y);
    let seen = session.seen(look, &view, None, (diameter, limit)).map_err(|error| error.to_string())?;
    let exposure = match (&seen.colored, &seen.particles.sums, opened.particles(), seen.levels) {
        (Some(Colored::Heights(attribute, transfer)), _, _, Some(levels)) => match opened.heights().first() {
            Some(first) => Exposure::of_heights(&first.opened, *attribute, transfer.scale, levels),
            None => Exposure::default(),
        },
        (Some(Colored::Field(prepared)), ..) => Exposure::of_field(prepared),
        (None, Some(sums), ..) => Exposure::of(sums, &colored.1),
        (None, None, Some(file), Some(levels)) => {
            Exposure::of_codebooks(&Subject::new(file.metadata(), &depiction, &colored.1, diameter), levels)
        }
        _ => Exposure::default(),
    };
    let report = Report {
        points: None,
        nodes: seen.heights.nodes_drawn + seen.particles.nodes as u64,
        samples: seen.heights.samples_drawn + seen.particles.taken,
        error_px: seen.heights.error_px,
        drawn_from: "chunks",
        is_complete: seen.heights.is_converged && seen.error.is_none(),
        told: session.take_messages(),
        again: session.again(),
    };
    let depths = seen.depths.map(Arc::new);
    let (image, milliseconds) = (Arc::new(seen.image), Some(1e3 * start.elapsed().as_secs_f64()));
    Ok(Drawn { key, values: Values::Light(Arc::clone(&image)), colored, image, exposure, report, depths, milliseconds })
}

/// Shows the finished picture, where a tour says so blended with the one before it.
pub(super) fn show_field(
    mut field: ResMut<FieldPicture>,
    (backend, before, picture): (Res<ActiveBackend>, Res<Before>, Res<Picture>),
    mut images: ResMut<Assets<Image>>,
    mut letterbox: ResMut<Letterbox>,
    mut converged: ResMut<Converged>,
) {
    if *backend != ActiveBackend::Field {
        return;
    }
    let field = field.bypass_change_detection();
    converged.0 &= before.is_settled();
    let Some(drawn) = &field.drawn else { return };
    // Without the picture before, what was shown last stays.
    if before.is_awaited() {
        return;
    }
    let fade = before.fade();
    let wanted = (field.number, fade.map(|(_, share)| (before.number(), share.to_bits())));
    if field.shown == Some(wanted) {
        return;
    }
    let colors = match fade {
        Some((image, share)) => faded(image, &drawn.image, share),
        None => Colors::clone(&drawn.image),
    };
    if images.insert(&picture.image, to_image(colors)).is_err() {
        warn!("the picture's image is gone");
    }
    letterbox.set_if_neq(Letterbox(None));
    field.shown = Some(wanted);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::HeightsSaid;
    use crate::mode::SettingValue;
    use crate::model::Unit;
    use crate::modes::shadowing::{LIGHT_SAMPLES, LIGHT_SIZE, SHADOWS};
    use crate::modes::surface;
    use crate::picture::SessionOptions;
    use crate::window::look::{follow_settings, glide_levels};
    use crate::window::sampled::Sampled;
    use crate::window::scene::SceneField;
    use crate::window::touring::player::tests::Window;
    use crate::window::transfer_presets::TransferPresets;
    use bevy::tasks::TaskPool;
    use std::time::Duration;

    #[test]
    fn shadows_of_heights_have_few_samples_in_motion_and_at_rest_those_of_a_file() {
        AsyncComputeTaskPool::get_or_init(TaskPool::new);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cliff.asc");
        let row = [["8"; 12], ["0"; 12]].concat().join(" ") + "\n";
        let head = "ncols 24\nnrows 16\nxllcenter 0\nyllcenter 0\ncellsize 1\n";
        std::fs::write(&path, head.to_owned() + &row.repeat(16)).unwrap();
        let metre = Some(Unit::new("m"));
        let said = HeightsSaid { xy_unit: metre.clone(), height_unit: metre, ..HeightsSaid::default() };
        let mut session = SurfaceSession::open(&path, &said, SessionOptions::default(), Arc::new(())).unwrap();
        let opened = Arc::clone(session.opened());
        let full = UVec2::new(60, 40);
        let mut window = Window::new();
        let app = &mut window.app;
        app.world_mut().resource_mut::<Picture>().rect = Rect::new(0.0, 0.0, 60.0, 40.0);
        app.world_mut().resource_mut::<Preset>().motion.rest_ms = u64::MAX;
        let mut settings = app.world_mut().resource_mut::<Settings>();
        settings.choose_mode(&surface::MODE);
        for (setting, number) in [(&SHADOWS, 0.7), (&LIGHT_SIZE, 20.0), (&LIGHT_SAMPLES, 20.0)] {
            settings.look.settings.set(setting, SettingValue::Number(number));
        }
        let look = settings.look.patch();
        let (view, _) = opened.home(&settings.look.settings, 40.0, (full.x, full.y)).unwrap();
        app.world_mut().resource_mut::<Scene>().field = Some(SceneField::new(Sampled::Heights(opened)));
        app.insert_resource(ViewSelection { view: Some(view), ..default() })
            .insert_resource(ActiveBackend::Field)
            .init_resource::<FieldPicture>()
            .init_resource::<Exposure>()
            .init_resource::<Statistics>()
            .init_resource::<Hiding>()
            .init_resource::<Converged>()
            .init_resource::<Held>()
            .init_resource::<TransferPresets>()
            .add_systems(Last, (follow_settings, glide_levels, draw_field).chain());
        let latest = |app: &App| {
            let drawn = app.world().resource::<FieldPicture>().drawn.as_ref()?;
            Some((drawn.key.light_samples?, drawn.key.size, Arc::clone(&drawn.image)))
        };
        window.wait("a picture in motion", |app| latest(app).is_some());
        // Others of more pixels follow.
        for _ in 0..30 {
            assert_eq!(latest(&window.app).unwrap().0, 4);
            window.frame(0.0);
            std::thread::sleep(Duration::from_millis(1));
        }
        window.app.world_mut().resource_mut::<Preset>().motion.rest_ms = 0;
        let mut found = Vec::new();
        window.wait("all samples", |app| {
            found.extend(latest(app).filter(|(_, size, _)| *size == full));
            app.world().resource::<Converged>().0
        });
        found.dedup_by_key(|(samples, ..)| *samples);
        let samples: Vec<u32> = found.iter().map(|(samples, ..)| *samples).collect();
        assert_eq!(samples, [4, 16, 20]);
        let transfer = window.app.world().resource::<Look>().chosen.clone();
        let expected = session.image(&LookPatch { transfer: Some(transfer), ..look }, &view, None).unwrap();
        assert!(*found[2].2 == expected, "at rest it is the picture of a file");
        assert!(*found[0].2 != expected, "each is drawn from its own samples");
        // What it takes in motion is with few pictures of what the sun sees.
        let field = window.app.world().resource::<FieldPicture>();
        let took = field.drawn.as_ref().and_then(|drawn| drawn.milliseconds).unwrap();
        assert_eq!(field.wanted.milliseconds(), Some(took * f64::from(1 + 4) / f64::from(1 + 20)));
    }
}
