//! Plays a tour: its time from the program's, the camera and the settings from its state.

use super::clock::{Clock, ClockState};
use super::{draft, look};
use crate::look::DatasetRef;
use crate::look::LookPatch;
use crate::model::{FamilyName, When};
use crate::tour::{State, Surroundings, Timeline, TourFile};
use crate::window::camera::{Anchor, Flight, Navigation, Viewpoint};
use crate::window::free_name::free_name;
use crate::window::input::{PointerOwner, is_control};
use crate::window::pages::Upcoming;
use crate::window::picture::{DataCamera, Picture};
use crate::window::playhead::Playhead;
use crate::window::scene::{Scene, Settings, TransferKept};
use crate::window::scene_io::{camera_of, viewpoint_of};
use crate::window::state::choices::Choices;
use crate::window::state::notices::Notices;
use bevy::input::mouse::AccumulatedMouseScroll;
use bevy::prelude::*;
use bevy_panorbit_camera::PanOrbitCamera;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Seconds between two keyframes of a flight that is recorded.
const SAMPLE_SECS: f64 = 1.5;
/// How far ahead of the camera data is read, seconds.
const FORESIGHT_SECS: f64 = 1.0;

/// What is asked of the player, by a key or the panel.
#[derive(Clone, Debug, PartialEq)]
pub enum Asked {
    /// Open a tour file.
    Open(PathBuf),
    /// Close the tour.
    Close,
    /// Play, or stand where it is.
    Toggle,
    /// Go to the next keyframe with a name or a presenter's stop.
    Next,
    /// Go back to the last one.
    Back,
    /// Go to a time, seconds; it goes on running or standing.
    Seek(f64),
    /// Play from a time.
    Go(f64),
    /// Make a keyframe of what is shown: at the clock's time where it is on the tour, else behind its end.
    Keep,
    /// Begin to make keyframes of the user's flight, or end it.
    Record,
    /// Move a keyframe to another time.
    Retime(usize, f64),
    /// Copy a keyframe.
    Copy(usize),
    /// Remove a keyframe.
    Remove(usize),
    /// Name a keyframe; no name for an empty text.
    Label(usize, String),
    /// The words at the foot from a keyframe on.
    Caption(usize, String),
    /// Save it.
    Save,
    /// Go on where another window was.
    GoOn(ClockState),
}

/// The open tour.
#[derive(Resource, Default)]
pub struct Player {
    tour: Option<TourFile>,
    path: Option<PathBuf>,
    text: String,
    timeline: Option<Arc<Timeline>>,
    clock: Clock,
    state: Option<State>,
    shown: Option<LookPatch>,
    asked: Vec<Asked>,
    /// The keyframe that is edited in the panel.
    pub selected: Option<usize>,
    recording: Option<Recording>,
    /// Whether there are edits that are not saved.
    edited: bool,
    /// The [`Scene::dataset`] that the timeline was made for.
    dataset: u32,
    /// Width over height of the picture that the tour is for; this window's where it is `None`.
    aspect: Option<f64>,
    /// The exposure and the bloom of the tour that is opened first.
    light: LookPatch,
}

/// A flight that becomes keyframes.
#[derive(Clone, Copy, Debug)]
struct Recording {
    /// The program's time at its begin, less the tour's time then, seconds.
    since_secs: f64,
    /// The tour's time of the last keyframe, seconds.
    last_secs: f64,
}

impl Player {
    /// Asks for something; it is done in the next frame.
    pub fn ask(&mut self, what: Asked) {
        self.asked.push(what);
    }

    /// The tour.
    pub fn tour(&self) -> Option<&TourFile> {
        self.tour.as_ref()
    }

    /// Its file.
    pub fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }

    /// The tour resolved for the open data.
    pub fn timeline(&self) -> Option<&Arc<Timeline>> {
        self.timeline.as_ref()
    }

    /// What was shown in the last frame, if the tour shows anything.
    pub fn state(&self) -> Option<&State> {
        self.state.as_ref()
    }

    /// Its clock.
    pub fn clock(&self) -> &Clock {
        &self.clock
    }

    /// Whether a flight is recorded.
    pub fn is_recording(&self) -> bool {
        self.recording.is_some()
    }

    /// Whether edits are not saved.
    pub fn is_edited(&self) -> bool {
        self.edited
    }

    /// Takes a tour that another window had.
    pub fn restore(&mut self, tour: TourFile, path: Option<PathBuf>, edited: bool) {
        *self = Player { tour: Some(tour), path, edited, ..Player::default() };
    }

    /// Opens a tour with this exposure and bloom, whatever it says itself.
    pub fn begin_with(&mut self, path: PathBuf, light: LookPatch) {
        self.light = light;
        self.ask(Asked::Open(path));
    }

    /// Opens a tour, which then plays. One that cannot be read is told, and what was open goes on as if nothing had been.
    fn open(&mut self, path: PathBuf, notices: &mut Notices) {
        match TourFile::read(&path) {
            Ok(mut tour) => {
                tour.expose(&self.light);
                let text = std::fs::read_to_string(&path).unwrap_or_default();
                let (path, asked) = (Some(path), vec![Asked::Toggle]);
                *self = Player { tour: Some(tour), path, text, asked, ..Player::default() };
            }
            Err(error) => notices.error(error.to_string()),
        }
    }

    /// Resolves the tour for the open data; where that fails there is no timeline.
    fn resolve(&mut self, scene: &Scene, aspect: f64, notices: &mut Notices) {
        self.dataset = scene.dataset;
        let Some(tour) = &self.tour else {
            self.timeline = None;
            return;
        };
        let file = self.path.as_ref().map_or_else(|| "the tour".to_owned(), |path| path.display().to_string());
        let folder = self.path.as_ref().and_then(|path| path.parent()).map(Path::to_owned).unwrap_or_default();
        let surroundings = Surroundings {
            file,
            text: self.text.clone(),
            folder,
            framed: scene.frame,
            aspect,
            times: scene.times.clone(),
            data: scene.opened.clone(),
        };
        self.timeline = match Timeline::new(tour, &surroundings) {
            Ok(timeline) => Some(Arc::new(timeline)),
            Err(error) => {
                notices.error(error.to_string());
                None
            }
        };
    }

    /// Saves the tour: where it came from, or beside the data.
    fn save(&mut self, scene: &Scene, notices: &mut Notices) {
        let Some(tour) = &mut self.tour else { return };
        let stem = scene.path.file_stem().map_or_else(|| "tour".into(), |stem| stem.to_string_lossy().into_owned());
        let path = self.path.clone().unwrap_or_else(|| free_name(&scene.path, &stem, "tour.ron"));
        if tour.dataset.is_none() {
            tour.dataset = Some(DatasetRef::of(&scene.path, &path));
        }
        match tour.write(&path) {
            Ok(()) => {
                notices.info(format!("tour saved in {}", path.display()));
                self.path = Some(path);
                self.edited = false;
            }
            Err(error) => notices.error(error.to_string()),
        }
    }
}

/// The camera and what is turned about it.
type Cameras<'w, 's> = Single<
    'w,
    's,
    (
        Entity,
        &'static mut Viewpoint,
        &'static mut Anchor,
        &'static mut PanOrbitCamera,
        &'static mut Navigation,
        Has<Flight>,
    ),
    With<DataCamera>,
>;

/// What the keys ask for.
pub fn take_keys(
    keys: Res<ButtonInput<KeyCode>>,
    owner: Res<PointerOwner>,
    scene: Option<Res<Scene>>,
    mut player: ResMut<Player>,
) {
    if scene.is_none() || !owner.keyboard_is_free() || is_control(&keys) {
        return;
    }
    // The first keyframe makes a tour.
    if keys.just_pressed(KeyCode::KeyK) {
        player.ask(Asked::Keep);
    }
    if player.timeline.is_none() {
        return;
    }
    for (key, asked) in [
        (KeyCode::Space, Asked::Toggle),
        (KeyCode::ArrowRight, Asked::Next),
        (KeyCode::PageDown, Asked::Next),
        (KeyCode::ArrowLeft, Asked::Back),
        (KeyCode::PageUp, Asked::Back),
    ] {
        if keys.just_pressed(key) {
            player.ask(asked);
        }
    }
}

/// The presenter's own keys, which lead to keyframes by their names.
pub fn take_presenter_keys(
    mut typed: MessageReader<bevy::input::keyboard::KeyboardInput>,
    owner: Res<PointerOwner>,
    mut player: ResMut<Player>,
) {
    for input in typed.read() {
        if !input.state.is_pressed() || input.repeat || !owner.keyboard_is_free() {
            continue;
        }
        let key = input.text.as_ref().and_then(|text| text.chars().next());
        let time = key.and_then(|key| player.timeline.as_ref()?.key(key));
        if let Some(time) = time {
            player.ask(Asked::Go(time));
        }
    }
}

/// Carries out what is asked, lets time pass, and shows what the tour shows then.
pub fn play_tour(
    mut commands: Commands,
    time: Res<Time<Real>>,
    scene: Option<Res<Scene>>,
    picture: Res<Picture>,
    choices: Res<Choices>,
    (buttons, scroll, owner): (Res<ButtonInput<MouseButton>>, Res<AccumulatedMouseScroll>, Res<PointerOwner>),
    mut kept: MessageWriter<TransferKept>,
    mut player: ResMut<Player>,
    mut settings: ResMut<Settings>,
    mut upcoming: ResMut<Upcoming>,
    mut notices: ResMut<Notices>,
    camera: Cameras,
) {
    let player = player.bypass_change_detection();
    let Some(scene) = scene else {
        // A tour is opened before its data; everything else needs data.
        if let Some(at) = player.asked.iter().position(|asked| matches!(asked, Asked::Open(_)))
            && let Asked::Open(path) = player.asked.remove(at)
        {
            player.open(path, &mut notices);
        }
        return;
    };
    let (entity, mut viewpoint, mut anchor, mut orbit, mut navigation, in_flight) = camera.into_inner();
    let now = time.elapsed_secs_f64();
    let size = picture.size();
    let aspect = player.aspect.unwrap_or(f64::from(size.x) / f64::from(size.y.max(1)));
    if player.dataset != scene.dataset {
        player.resolve(&scene, aspect, &mut notices);
        player.shown = None;
    }
    let names: Vec<FamilyName> = scene.file.metadata().families.iter().map(|family| family.name).collect();
    let shown = LookPatch { time: scene.when(), ..look::of(&settings, &names) };
    let seen = (camera_of(&viewpoint, &settings.lens), shown);
    for asked in std::mem::take(&mut player.asked) {
        let take_over =
            matches!(asked, Asked::Toggle | Asked::Next | Asked::Back | Asked::Seek(_) | Asked::Go(_) | Asked::GoOn(_));
        carry_out(player, asked, now, &scene, &seen, &mut notices);
        if player.timeline.is_none() {
            player.resolve(&scene, aspect, &mut notices);
        }
        if take_over && player.timeline.is_some() {
            commands.entity(entity).remove::<Flight>();
            *navigation = Navigation::Tour;
        }
    }
    record(player, now, &seen);

    // Using the mouse on the picture, or a flight, leaves the tour.
    let takes_mouse = owner.is_picture() && (buttons.get_pressed().len() > 0 || scroll.delta != Vec2::ZERO);
    if *navigation == Navigation::Tour && (takes_mouse || in_flight || player.timeline.is_none()) {
        *navigation = Navigation::Orbit;
        *anchor = anchor.adopt(&viewpoint, &mut orbit);
    }
    let Some(timeline) = player.timeline.clone().filter(|_| *navigation == Navigation::Tour) else {
        player.clock.stand(now);
        player.state = None;
        upcoming.set_if_neq(Upcoming(None));
        return;
    };
    let at = player.clock.tick(now, &timeline);
    let state = timeline.state(at);
    let (place, lens) = viewpoint_of(&state.camera);
    *viewpoint = place;
    if settings.lens != lens {
        settings.lens = lens;
    }
    if player.shown.as_ref() != Some(&state.look) {
        if look::show(player.shown.as_ref(), &state.look, &choices.attributes, &names, &mut settings) {
            kept.write(TransferKept);
        }
        player.shown = Some(state.look.clone());
    }
    let next = player.clock.is_running().then(|| viewpoint_of(&timeline.state(at + FORESIGHT_SECS).camera).0);
    upcoming.set_if_neq(Upcoming(next));
    player.state = Some(state);
}

/// Leads the playhead to the time of the data that the tour shows.
pub fn lead_time(player: Res<Player>, playhead: Option<ResMut<Playhead>>) {
    let time = player.state().and_then(|state| state.look.time);
    if let (Some(When::Time(time)), Some(mut playhead)) = (time, playhead) {
        playhead.lead(time);
    }
}

/// Makes keyframes of a flight that is recorded.
fn record(player: &mut Player, now: f64, (camera, look): &(crate::look::Camera, LookPatch)) {
    let Some(recording) = player.recording else { return };
    let time = now - recording.since_secs;
    if time >= recording.last_secs + SAMPLE_SECS {
        add_keyframe(player, Some(time), camera, look);
        player.recording = Some(Recording { last_secs: time, ..recording });
    }
}

fn add_keyframe(player: &mut Player, time: Option<f64>, camera: &crate::look::Camera, look: &LookPatch) {
    let tour = player.tour.get_or_insert_with(|| TourFile::new(Vec::new()));
    let kept = draft::keep(tour, player.timeline.as_deref(), time, *camera, look);
    player.selected = Some(kept);
    changed(player);
}

/// After an edit the timeline is made anew.
fn changed(player: &mut Player) {
    player.edited = true;
    player.timeline = None;
    player.text.clear();
    if player.tour.as_ref().is_some_and(|tour| tour.keyframes.is_empty()) {
        player.tour = None;
    }
}

fn carry_out(
    player: &mut Player,
    asked: Asked,
    now: f64,
    scene: &Scene,
    (camera, look): &(crate::look::Camera, LookPatch),
    notices: &mut Notices,
) {
    let timeline = player.timeline.clone();
    match (asked, timeline) {
        (Asked::Open(path), _) => {
            player.open(path, notices);
            player.dataset = scene.dataset;
        }
        (Asked::Close, _) => *player = Player { dataset: player.dataset, ..Player::default() },
        (Asked::Save, _) => player.save(scene, notices),
        (Asked::Record, timeline) => {
            let is_new = player.recording.is_none();
            player.clock.stand(now);
            let end = timeline.as_ref().map_or(0.0, |timeline| timeline.duration() + SAMPLE_SECS);
            match player.recording.take() {
                Some(recording) => add_keyframe(player, Some(now - recording.since_secs), camera, look),
                None => add_keyframe(player, Some(end), camera, look),
            }
            player.recording = is_new.then_some(Recording { since_secs: now - end, last_secs: end });
            notices.info(match is_new {
                true => "the flight is recorded: go where the tour is to go, then press Record again".to_owned(),
                false => {
                    let count = player.tour.as_ref().map_or(0, |tour| tour.keyframes.len());
                    format!("the flight is recorded in {count} keyframes")
                }
            });
        }
        (Asked::Keep, timeline) => {
            // On the tour: the moment that is shown; elsewhere a new one at its end.
            let time = player.state.as_ref().map(|state| state.time).filter(|_| timeline.is_some());
            add_keyframe(player, time, camera, look);
        }
        (_, None) => {}
        (Asked::Toggle, Some(timeline)) => match player.clock.is_running() && player.state.is_some() {
            true => player.clock.stand(now),
            false => player.clock.run(now, &timeline),
        },
        (Asked::Next, Some(timeline)) => {
            let time = timeline.within(player.clock.time(now));
            match player.clock.waiting() {
                Some(_) => player.clock.run(now, &timeline),
                None => player.clock.set(now, timeline.next(time)),
            }
        }
        (Asked::GoOn(moment), Some(_)) => {
            player.clock.resume(now, moment.time, moment.running, moment.waiting);
        }
        (Asked::Back, Some(timeline)) => {
            let time = timeline.within(player.clock.time(now));
            player.clock.set(now, timeline.back(time));
        }
        (asked @ (Asked::Seek(time) | Asked::Go(time)), Some(timeline)) => {
            let time = if time.is_finite() { time.clamp(0.0, timeline.duration()) } else { 0.0 };
            player.clock.set(now, time);
            if matches!(asked, Asked::Go(_)) {
                player.clock.run(now, &timeline);
            }
        }
        (edit, Some(timeline)) => {
            let Some(tour) = &mut player.tour else { return };
            match edit {
                Asked::Retime(index, time) => draft::retime(tour, &timeline, index, time),
                Asked::Copy(index) => player.selected = draft::copy(tour, &timeline, index),
                Asked::Remove(index) => draft::remove(tour, &timeline, index),
                Asked::Label(index, text) => {
                    if let Some(keyframe) = tour.keyframes.get_mut(index) {
                        keyframe.label = Some(text).filter(|text| !text.trim().is_empty());
                    }
                }
                Asked::Caption(index, text) => {
                    if let Some(keyframe) = tour.keyframes.get_mut(index) {
                        keyframe.caption = Some(text);
                    }
                }
                _ => return,
            }
            changed(player);
        }
    }
}

mod led;

#[cfg(test)]
pub(crate) mod tests;
