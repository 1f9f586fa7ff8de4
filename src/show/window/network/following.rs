//! A follower's side of a show: the leader's picture, with data of its own, without panels, keys or words.

use super::data::{self, Found};
use crate::color::transfer::Levels;
use crate::hierarchy::spacetime::Interpolation;
use crate::look::dataset::located;
use crate::look::{DatasetRef, LookPatch, Member, OwnLook, SceneFile, shown_families};
use crate::show::protocol::{Follower, FollowerEvent, Report, Severity as Told};
use crate::window::camera::{Flight, Navigation, Viewpoint};
use crate::window::input::is_control;
use crate::window::look::Held;
use crate::window::objects::Objects;
use crate::window::open::Openings;
use crate::window::options::OpenRequest;
use crate::window::pages::Upcoming;
use crate::window::picture::DataCamera;
use crate::window::playhead::{Playhead, families_of};
use crate::window::scene::{Scene, Settings, TransferKept};
use crate::window::scene_io::viewpoint_of;
use crate::window::state::answer::Answer;
use crate::window::state::choices::Choices;
use crate::window::state::notices::{Notices, Severity};
use crate::window::statistics::{Converged, FrameClock, Statistics};
use crate::window::touring::Player;
use bevy::math::DVec3;
use bevy::prelude::*;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Time without a frame of the leader after which a tour that plays goes on by this machine's clock. That is the same way, so that
/// it may be short.
const GRACE: Duration = Duration::from_millis(100);

/// One who follows a show.
#[derive(Resource)]
pub struct Following {
    follower: Follower,
    /// The data that the command line names.
    own: Vec<PathBuf>,
    /// What the leader shows, and whether it is still to be shown here.
    scene: Option<Box<SceneFile>>,
    is_new: bool,
    /// The [`Scene::generation`] that it was shown with.
    generation: u32,
    labels: Option<PathBuf>,
    finding: Answer<Found>,
    /// The data to show it with.
    members: Option<Vec<Member>>,
    /// How what moves in it was asked to move when it was opened.
    interpolation: Option<Interpolation>,
    is_led: bool,
    /// The number of the frame that is shown.
    shown: u64,
    /// How many messages of this window were passed on.
    told: u64,
}

impl Following {
    /// Follows, with data that the command line names.
    pub fn new(follower: Follower, own: Vec<PathBuf>) -> Following {
        Following {
            follower,
            own,
            scene: None,
            is_new: false,
            generation: 0,
            labels: None,
            finding: Answer::Nothing,
            members: None,
            interpolation: None,
            is_led: false,
            shown: 0,
            told: 0,
        }
    }

    /// The follower's end of the network.
    pub fn follower(&self) -> &Follower {
        &self.follower
    }

    /// The number of the leader's frame that is shown.
    pub fn shown(&self) -> u64 {
        self.shown
    }

    /// Whether the open data is what the leader shows.
    fn fits(&self, scene: &Scene) -> bool {
        fn data(member: &Member) -> (&Path, DVec3, Option<f64>, Option<&OwnLook>) {
            (member.path.as_path(), member.offset, member.scale, member.own_look.as_ref())
        }
        let same = |wanted: &Vec<Member>| wanted.iter().map(data).eq(scene.members.iter().map(data));
        self.members.as_ref().is_some_and(same)
    }

    /// Takes what the leader shows from now on; its data is looked for where it is not the one before.
    fn take(&mut self, scene: Box<SceneFile>) {
        let data = |scene: &SceneFile| -> Vec<DatasetRef> {
            scene.datasets.iter().map(|dataset| DatasetRef { families: None, ..dataset.clone() }).collect()
        };
        let wanted = data(&scene);
        let is_same = self
            .scene
            .as_deref()
            .is_some_and(|before| data(before) == wanted && before.look.interpolation == scene.look.interpolation);
        if !is_same || matches!(self.finding, Answer::Failed(_)) {
            let own = self.own.clone();
            self.finding = Answer::ask("data of the show", move |_| data::find(&wanted, &own));
        }
        (self.scene, self.is_new) = (Some(scene), true);
    }
}

/// Whether the camera and the settings are the leader's, as it last told them. They are not in every other window, and where the
/// leader is silent while a tour plays, which then goes on by itself.
pub fn is_led(following: Option<Res<Following>>) -> bool {
    following.is_some_and(|following| following.is_led)
}

/// Takes in what the leader says.
pub(crate) fn receive_from_leader(
    mut following: ResMut<Following>,
    time: Res<Time<Real>>,
    mut player: ResMut<Player>,
    mut notices: ResMut<Notices>,
) {
    let following = following.bypass_change_detection();
    let now = time.elapsed();
    for event in following.follower.receive(now) {
        match event {
            FollowerEvent::Joined => notices.info(format!("follows the leader at {}", following.follower.leader())),
            FollowerEvent::Lost(why) | FollowerEvent::Refused(why) => notices.error(why),
            FollowerEvent::Scene(scene) => following.take(scene),
            FollowerEvent::Tour(None) => *player = Player::default(),
            FollowerEvent::Tour(Some(led)) => player.follow(led.tour, led.text, &led.folder, led.aspect),
        }
    }
    let is_silent = following.follower.heard().is_some_and(|heard| now.saturating_sub(heard) > GRACE);
    let moment = following.follower.frame().and_then(|frame| frame.tour);
    following.is_led = !(is_silent && moment.is_some_and(|moment| moment.running));
}

/// Opens the data that the leader shows, where it is found.
pub(crate) fn find_data(
    mut following: ResMut<Following>,
    scene: Option<Res<Scene>>,
    mut openings: ResMut<Openings>,
    mut notices: ResMut<Notices>,
) {
    let following = following.bypass_change_detection();
    if !following.finding.receive() {
        return;
    }
    match &following.finding {
        Answer::Here(found) => {
            found.notes.iter().for_each(|note| notices.error(note));
            following.members = Some(found.members.clone());
            let interpolation = following.scene.as_ref().and_then(|scene| scene.look.interpolation);
            if following.interpolation != interpolation || !scene.is_some_and(|scene| following.fits(&scene)) {
                following.interpolation = interpolation;
                openings.start(OpenRequest { members: found.members.clone(), interpolation, ..OpenRequest::default() });
            }
        }
        Answer::Failed(why) => {
            notices.error(why);
            following.members = None;
        }
        Answer::Nothing | Answer::Coming(_) => {}
    }
}

/// Shows what the leader shows, as soon as its data is open; else the last picture stays.
pub(crate) fn show_led_picture(
    mut commands: Commands,
    mut following: ResMut<Following>,
    time: Res<Time<Real>>,
    scene: Option<Res<Scene>>,
    choices: Res<Choices>,
    mut settings: ResMut<Settings>,
    (mut player, playhead): (ResMut<Player>, Option<ResMut<Playhead>>),
    mut objects: ResMut<Objects>,
    mut upcoming: ResMut<Upcoming>,
    mut notices: ResMut<Notices>,
    mut kept: MessageWriter<TransferKept>,
    camera: Single<(Entity, &mut Viewpoint, &mut Navigation), With<DataCamera>>,
) {
    let following = following.bypass_change_detection();
    let Some(scene) = scene.filter(|scene| following.fits(scene)) else { return };
    let is_new = std::mem::take(&mut following.is_new) || following.generation != scene.generation;
    following.generation = scene.generation;
    if let Some(file) = following.scene.as_deref().filter(|_| is_new) {
        show_scene(file, &scene, &choices, &mut settings);
        if file.look.transfer.is_some() {
            kept.write(TransferKept);
        }
        if following.labels != file.labels {
            following.labels.clone_from(&file.labels);
            objects.open_of_scene(file.labels.as_deref().map(|labels| located(labels, Path::new(""))));
        }
    }
    let (entity, mut viewpoint, mut navigation) = camera.into_inner();
    commands.entity(entity).remove::<Flight>();
    navigation.set_if_neq(Navigation::Tour);
    let Some(frame) = following.follower.frame().copied().filter(|_| following.is_led) else { return };
    let (place, lens) = viewpoint_of(&frame.camera);
    viewpoint.set_if_neq(place);
    if settings.lens != lens {
        settings.lens = lens;
    }
    if let Some((mut playhead, run)) = playhead.zip(frame.run) {
        let playhead = playhead.bypass_change_detection();
        playhead.hold(run.holds);
        playhead.lead(run.time);
    }
    following.shown = frame.number;
    let heard = following.follower.heard().unwrap_or_default().as_secs_f64();
    let moment = frame.tour.map(|moment| (moment.time, moment.running));
    let next = player.show_moment(moment, (heard, time.elapsed_secs_f64()), &scene, &mut notices);
    upcoming.set_if_neq(Upcoming(next));
}

/// The leader's settings, exactly.
fn show_scene(file: &SceneFile, scene: &Scene, choices: &Choices, settings: &mut Settings) {
    settings.show(&LookPatch::beginning().then(&file.look), &choices.attributes);
    settings.budget.clone_from(&file.look.budget);
    let with =
        |(member, dataset): (&Member, &DatasetRef)| Member { families: dataset.families.clone(), ..member.clone() };
    let members: Vec<Member> = scene.members.iter().zip(&file.datasets).map(with).collect();
    settings.families = families_of(
        scene.file.metadata(),
        &shown_families(&scene.file, &scene.of_particles(&members)).0,
        scene.metadata(),
    );
}

/// Colours are for the leader's ranges: those of this part of the picture are others.
pub(crate) fn hold_levels(following: Res<Following>, mut held: ResMut<Held>) {
    // A tour that goes on by itself has ranges of its own.
    let frame = following.follower.frame().filter(|_| following.is_led);
    if let Some(ranges) = frame.and_then(|frame| frame.ranges) {
        held.set_if_neq(Held(Some(Levels { p: ranges.p, s: ranges.s })));
    }
}

/// The only keys: Escape and Ctrl+Q close the window.
pub(crate) fn close_on_keys(keys: Res<ButtonInput<KeyCode>>, mut exit: MessageWriter<AppExit>) {
    if keys.just_pressed(KeyCode::Escape) || (is_control(&keys) && keys.just_pressed(KeyCode::KeyQ)) {
        exit.write(AppExit::Success);
    }
}

/// Tells the leader how it is here.
pub(crate) fn report_to_leader(
    mut following: ResMut<Following>,
    clock: Res<FrameClock>,
    statistics: Res<Statistics>,
    converged: Res<Converged>,
    notices: Res<Notices>,
) {
    let following = following.bypass_change_detection();
    let new = notices.said().saturating_sub(following.told) as usize;
    following.told = notices.said();
    let skipped = notices.all().count().saturating_sub(new);
    for notice in notices.all().skip(skipped).filter(|notice| notice.severity == Severity::Error) {
        following.follower.tell(Told::Error, &notice.text);
    }
    following.follower.send(Report {
        session: 0,
        frame: following.shown,
        frame_ms: clock.milliseconds(),
        missing: statistics.missing as u64,
        failed: statistics.pages_failed as u64,
        converged: converged.0,
    });
}
