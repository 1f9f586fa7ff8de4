//! Domes, cubes, maps of all directions and stereo pairs in the window: put together on a thread of its own, around the present camera
//! and from the data itself, whatever it is; idle while the picture is flat. Their faces are drawn by the processor, or where the preset asks for
//! the adapter, or has a graphics card, by a renderer beside the window's, which is closed with the last of them.
//!
//! What is drawn is the [`Shot`] that the scene would be as a file, so that the window shows what `deepfield render` writes, words
//! included. While what is shown changes, pictures are as small as the preset's time for one demands; when it rests, the full one follows,
//! which is given up between two views when it is not wanted any more. Sums are kept, so that other colours need no other picture.

mod task;

use super::camera::Viewpoint;
use super::exposure::Exposure;
use super::live::LiveParticles;
use super::look::{Held, Look};
use super::objects::Objects;
use super::picture::{DataCamera, Letterbox, Picture, to_image};
use super::picture_sizes::{moving_size, panorama_size};
use super::playhead::Playhead;
use super::preset::{Backend, Preset};
use super::scene::{Scene, Settings};
use super::scene_io::{camera_of, families_of};
use super::state::aim::Aim;
use super::state::answer::Answer;
use super::state::notices::Notices;
use super::statistics::{ActiveBackend, Converged, Statistics};
use super::touring::{Player, Ranges};
use crate::annotate::overlay::Overlay;
use crate::color::transfer::Levels;
use crate::hierarchy::spacetime::Interpolation;
use crate::look::{CameraConfig, Film, LookPatch, Member, SceneFile, Shot};
use crate::picture::{AnySession, PictureError, Session};
use bevy::ecs::system::SystemParam;
use bevy::prelude::*;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;
use task::{Done, Drawn, Facts, Told, draw};

/// Share of the preset's memory for pages that a panorama's may take, beside those of the flat view.
const MEMORY_SHARE: u64 = 2;

/// What a picture's values depend on, whatever its size.
#[derive(Clone, PartialEq)]
struct Content {
    /// The [`Scene::dataset`].
    dataset: u32,
    /// What is asked to draw it.
    backend: Backend,
    members: Vec<Member>,
    /// Without what is done to the finished picture.
    shot: Shot,
}

/// A picture that is wanted.
#[derive(Clone, PartialEq)]
struct Wanted {
    content: Content,
    /// The room for it, pixels.
    area: UVec2,
    /// All of it.
    shot: Shot,
    /// The ranges of sums' colours; their own where nothing is known of them.
    levels: Option<Levels>,
    /// Whether any family is shown.
    is_empty: bool,
}

impl Wanted {
    /// The same in another room.
    fn within(self, area: UVec2) -> Wanted {
        let size = panorama_size(area, self.shot.surround, self.shot.stereo);
        Wanted { area, shot: Shot { size: Some((size.x, size.y)), ..self.shot }, ..self }
    }

    /// Has these numbers for automatic ranges, of a picture of light.
    fn fix_ranges(&mut self, found: &Levels) {
        for look in [&mut self.shot.look, &mut self.content.shot.look] {
            look.transfer = look.transfer.take().map(|transfer| transfer.with_levels(found));
        }
    }

    /// Leaves what hue alone asks for, a share of the error ([`Depiction::error_share`]), to the picture at rest, as flat views do
    /// ([`Depiction::detail_in_motion`]).
    ///
    /// [`Depiction::error_share`]: crate::mode::Depiction::error_share
    /// [`Depiction::detail_in_motion`]: crate::mode::Depiction::detail_in_motion
    fn leave_hue(&mut self, share: f64) {
        // Else it stays what is wanted at rest, too, and need not be drawn again.
        if share < 1.0 {
            for look in [&mut self.shot.look, &mut self.content.shot.look] {
                look.error_px = Some(look.error_px() / share);
            }
        }
    }

    /// The picture that it is blended with, and how much of it is seen.
    fn blend(&self) -> Option<(&SceneFile, f32)> {
        let film = self.shot.film.as_ref()?;
        Some((film.from.as_deref()?, film.share))
    }
}

/// A picture that is being drawn.
struct Coming {
    wanted: Wanted,
    /// Whether it is meant to stay.
    at_rest: bool,
    answer: Answer<(AnySession, Result<Done, PictureError>)>,
}

/// What the window shows of all directions or to two eyes, and what draws it.
#[derive(Resource, Default)]
pub struct SurroundPicture {
    coming: Option<Coming>,
    /// What is shown.
    shown: Option<Wanted>,
    /// Its values, while nobody works with them.
    drawn: Option<Drawn>,
    facts: Facts,
    /// What cannot be drawn.
    failed: Option<Wanted>,
    /// What was wanted last, and since when it has been that but for sizes and colours.
    rests: Option<(Wanted, Instant)>,
    /// Room and milliseconds of the last picture.
    cost: Option<(UVec2, f64)>,
    /// What draws it, the [`Scene::dataset`] that it has open, what it asks to draw, and whether that is a field.
    session: Option<((u32, Backend, bool), AnySession)>,
    told: Told,
}

impl Drop for SurroundPicture {
    fn drop(&mut self) {
        self.told.stop(true);
    }
}

impl SurroundPicture {
    /// Takes in what has been drawn; the image, if there is a new one.
    fn receive(&mut self, notices: &mut Notices) -> Option<Done> {
        self.told.messages().into_iter().for_each(|message| notices.error(message));
        let mut coming = self.coming.take()?;
        if !coming.answer.receive() {
            self.coming = Some(coming);
            return None;
        }
        let Coming { wanted, answer, .. } = coming;
        let outcome = match answer {
            Answer::Here((session, outcome)) => {
                let is_field = !matches!(session, AnySession::Particles(_));
                self.session = Some(((wanted.content.dataset, wanted.content.backend, is_field), session));
                outcome
            }
            Answer::Failed(why) => Err(PictureError::Asked(why)),
            Answer::Nothing | Answer::Coming(_) => return None,
        };
        match outcome {
            Ok(done) => {
                self.shown = Some(wanted);
                Some(done)
            }
            Err(PictureError::Stopped) => None,
            Err(error) => {
                notices.error(error.to_string());
                self.failed = Some(wanted);
                None
            }
        }
    }

    /// Notes what is wanted; whether that was another picture a moment ago.
    fn is_moving(&mut self, wanted: &Wanted, rest_ms: u64) -> bool {
        let same = |known: &Wanted| known.content == wanted.content && known.blend() == wanted.blend();
        let since = match &self.rests {
            Some((known, since)) if same(known) => *since,
            _ => {
                if self.coming.as_ref().is_some_and(|coming| coming.at_rest) {
                    self.told.stop(true);
                }
                self.rests = Some((wanted.clone(), Instant::now()));
                return true;
            }
        };
        since.elapsed().as_millis() < u128::from(rest_ms)
    }

    /// Whether the same values are shown as are wanted, from wherever.
    fn has_shown(&self, wanted: &Wanted) -> bool {
        let same = |shown: &Wanted| {
            let [known, next] = [&shown.content, &wanted.content];
            known.dataset == next.dataset
                && known.members == next.members
                && known.shot.look.is_measured_like(&next.shot.look)
        };
        self.shown.as_ref().is_some_and(same)
    }

    /// Begins to draw.
    fn start(&mut self, wanted: Wanted, at_rest: bool, scene: &Scene, budget: u64) {
        let backend = wanted.content.backend;
        let field = wanted.content.shot.look.mode.and_then(|mode| scene.field_for(mode)).cloned();
        let of = (scene.dataset, backend, field.is_some());
        let known = self.session.take().filter(|(known, _)| *known == of);
        let (opened, file) = (scene.opened.clone(), Arc::clone(&scene.file));
        let (told, members) = (self.told.clone(), wanted.content.members.clone());
        let open = move || {
            let session = match field {
                Some(field) => field.opened.drawer(Arc::new(told)),
                None => {
                    // Of a run whatever moment is asked for.
                    let session = match opened {
                        Some(opened) => Session::of_opened_within(opened, members, budget)?.0,
                        None => Session::of(file, budget),
                    };
                    AnySession::Particles(Box::new(session.with_reporter(Arc::new(told))))
                }
            };
            Ok::<_, PictureError>(session.with_adapter(backend.beside()))
        };
        let values = self.drawn.take();
        let asked = wanted.clone();
        self.told.stop(false);
        let answer = Answer::ask("panorama", move |_| {
            let mut session = known.map_or_else(open, |(_, session)| Ok(session))?;
            let done = draw(&mut session, &asked, values);
            Ok::<_, PictureError>((session, done))
        });
        self.coming = Some(Coming { wanted, at_rest, answer });
    }
}

/// Whether panoramas or stereo pictures are to be shown. Particles that move are not in the file, and an output of a show displays a part
/// of the flat picture.
pub(super) fn is_wanted(settings: &Settings, live: &LiveParticles, aim: Option<&Aim>) -> bool {
    settings.is_projected() && live.particles().is_none() && aim.is_none()
}

/// Whether they are wanted now and were not before, or the other way round.
pub(super) fn came_or_went(
    settings: Res<Settings>,
    live: Res<LiveParticles>,
    aim: Option<Res<Aim>>,
    mut before: Local<bool>,
) -> bool {
    let now = is_wanted(&settings, &live, aim.as_deref());
    std::mem::replace(&mut *before, now) != now
}

/// Whether they are shown.
pub(super) fn is_active(backend: Res<ActiveBackend>) -> bool {
    *backend == ActiveBackend::Surround
}

/// What the picture is made of.
#[derive(SystemParam)]
pub(super) struct Shown<'w, 's> {
    scene: Option<Res<'w, Scene>>,
    look: Option<Res<'w, Look>>,
    settings: Res<'w, Settings>,
    objects: Res<'w, Objects>,
    player: Res<'w, Player>,
    ranges: Res<'w, Ranges>,
    held: Res<'w, Held>,
    picture: Res<'w, Picture>,
    preset: Res<'w, Preset>,
    playhead: Option<Res<'w, Playhead>>,
    camera: Single<'w, 's, &'static Viewpoint, With<DataCamera>>,
}

impl Shown<'_, '_> {
    /// The picture that is wanted at rest; `measured`: the look's ranges are those of a picture.
    fn wanted(&self, scene: &Scene, look: &Look, measured: bool) -> Wanted {
        let settings = &*self.settings;
        let camera = camera_of(&self.camera, &settings.lens);
        let is_light = look.depiction.mode.is_light();
        let mut transfer = look.transfer.clone();
        // Ranges that are given are not looked for in each picture.
        if let Some(given) = self.held.0.filter(|levels| is_light && levels.p[0] > 0.0 && levels.p[0] < levels.p[1]) {
            transfer = transfer.with_levels(&given);
        }
        let shot = Shot {
            look: LookPatch {
                transfer: Some(transfer),
                // What is left out for speed is left out of flat pictures, and behind the window's there is nothing.
                budget: settings.budget.blending(),
                background: None,
                time: scene.when(),
                interpolation: self.playhead.as_ref().map(|playhead| match playhead.holds() {
                    true => Interpolation::Hold,
                    false => playhead.interpolation(),
                }),
                ..settings.look.patch()
            },
            camera: CameraConfig {
                eye: Some(camera.eye),
                target: Some(camera.target),
                up: Some(camera.up),
                fov: Some(camera.fov),
                ortho: camera.ortho,
            },
            size: None,
            surround: settings.surround,
            stereo: settings.stereo,
            labels: self.objects.path().map(Path::to_owned),
            film: self.film(scene, settings),
        };
        let families = families_of(scene, settings);
        let members = scene.members.iter().cloned().zip(families);
        let content = Content {
            dataset: scene.dataset,
            backend: self.preset.drawing.backend,
            members: scene
                .of_particles(&members.map(|(member, families)| Member { families, ..member }).collect::<Vec<_>>()),
            shot: Shot {
                look: LookPatch {
                    transfer: shot.look.transfer.clone().filter(|_| is_light),
                    annotations: None,
                    ..shot.look.clone()
                },
                film: None,
                ..shot.clone()
            },
        };
        let levels = (measured && !is_light).then_some(look.levels);
        let is_empty = !settings.families.is_empty() && !settings.families.contains(&true);
        let area = self.picture.size();
        Wanted { content, area, shot, levels, is_empty }.within(area)
    }

    /// What a tour does to the finished picture.
    fn film(&self, scene: &Scene, settings: &Settings) -> Option<Film> {
        let (state, timeline) = self.player.state().zip(self.player.timeline())?;
        let folder = self.player.path().and_then(Path::parent).unwrap_or(Path::new(""));
        let mut images = state.images.clone();
        images.iter_mut().for_each(|image| image.path = folder.join(&image.path));
        let caption = &state.caption;
        let overlay = Overlay { caption: caption.text.clone(), caption_opacity: caption.opacity, images };
        let from = state.blend.as_ref().map(|blend| {
            let exposed = self.ranges.exposed(timeline, state.keyframe.saturating_sub(1), state.time, &blend.look);
            let look = exposed.unwrap_or_else(|| blend.look.clone());
            Box::new(SceneFile {
                look: LookPatch { time: look.time.or(scene.when()), ..look },
                camera: Some(blend.camera),
                projection: settings.surround,
                stereo: settings.stereo,
                ..SceneFile::new(Vec::new())
            })
        });
        let share = state.blend.as_ref().map_or(0.0, |blend| blend.share as f32);
        (from.is_some() || !overlay.is_empty()).then_some(Film { from, share, overlay })
    }
}

/// Takes in what has been drawn, shows it, and starts to draw what is wanted now.
pub(super) fn draw_surround(
    mut surround: ResMut<SurroundPicture>,
    backend: Res<ActiveBackend>,
    shown: Shown,
    mut exposure: ResMut<Exposure>,
    (mut images, mut letterbox): (ResMut<Assets<Image>>, ResMut<Letterbox>),
    (mut statistics, mut converged): (ResMut<Statistics>, ResMut<Converged>),
    mut notices: ResMut<Notices>,
) {
    if *backend != ActiveBackend::Surround {
        if surround.coming.is_some() || surround.session.is_some() {
            statistics.points = None;
            *surround = SurroundPicture::default();
        }
        return;
    }
    let surround = surround.bypass_change_detection();
    let measured = exposure.levels.is_some();
    if let Some(done) = surround.receive(&mut notices) {
        if let Some(found) = done.exposure {
            exposure.set_if_neq(found);
        }
        if let Some(milliseconds) = done.milliseconds {
            surround.cost = Some((done.drawn.area, milliseconds));
        }
        letterbox.0 = Some(UVec2::new(done.image.width, done.image.height));
        if images.insert(&shown.picture.image, to_image(done.image)).is_err() {
            warn!("the picture's image is gone");
        }
        surround.facts = done.drawn.facts();
        surround.drawn = Some(done.drawn);
    }
    surround.facts.tell(surround.cost.map(|(_, milliseconds)| milliseconds), &mut statistics);
    converged.0 = false;
    let (Some(scene), Some(look)) = (&shown.scene, &shown.look) else { return };
    let wanted = shown.wanted(scene, look, measured);
    let Preset { motion, drawing, residency, .. } = &*shown.preset;
    let is_moving = surround.is_moving(&wanted, motion.rest_ms);
    let wanted = match is_moving {
        true => {
            let budget = if drawing.frame_ms > 0.0 { drawing.frame_ms } else { motion.volume_ms };
            // What other values cost says nothing.
            let cost = surround.cost.filter(|_| surround.has_shown(&wanted));
            let area = moving_size(wanted.area, cost, budget, motion);
            let mut small = wanted.clone().within(area);
            let is_light = look.depiction.mode.is_light();
            // In a small picture words hide much and are hardly legible.
            small.shot.look.annotations = None;
            // Ranges of light are those of all the data, wherever the camera is: they are not looked for in each picture.
            if let Some(found) = exposure.levels.filter(|_| is_light && surround.has_shown(&wanted)) {
                small.fix_ranges(&found);
            }
            small.leave_hue(look.depiction.error_share(scene.file.metadata()));
            small
        }
        false => wanted,
    };
    if surround.coming.is_some() {
        return;
    }
    if surround.shown.as_ref() == Some(&wanted) {
        converged.0 = !is_moving && look.settled && surround.facts.converged;
        return;
    }
    // What could not be drawn once cannot be drawn again either.
    if surround.failed.as_ref() != Some(&wanted) {
        surround.start(wanted, !is_moving, scene, (residency.budget_mib << 20) / MEMORY_SHARE);
    }
}
