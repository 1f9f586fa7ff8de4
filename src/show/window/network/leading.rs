//! The leader's side of a show: what is sent of each frame, and what is heard of the followers.

use crate::hierarchy::spacetime::Interpolation;
use crate::look::{DatasetRef, LookPatch, SceneError, SceneFile};
use crate::show::protocol::{Frame, Leader, LeaderEvent, Ranges, RunTime, Severity, TourTime};
use crate::tour::TourFile;
use crate::window::camera::Viewpoint;
use crate::window::look::Look;
use crate::window::objects::Objects;
use crate::window::picture::{DataCamera, Picture};
use crate::window::playhead::Playhead;
use crate::window::scene::{Scene, Settings};
use crate::window::scene_io::{ShownData, camera_of};
use crate::window::state::notices::Notices;
use crate::window::touring::Player;
use bevy::prelude::*;
use std::path::{Path, PathBuf};

/// One who leads a show.
#[derive(Resource)]
pub struct Leading {
    leader: Leader,
    /// The data as followers are told of it.
    data: ShownData,
    sent: Option<Sent>,
    tour: Option<(TourFile, PathBuf)>,
    told_address: bool,
}

/// What was sent last.
struct Sent {
    settings: Settings,
    generation: u32,
    labels: Option<PathBuf>,
}

impl Leading {
    /// Leads.
    pub fn new(leader: Leader) -> Leading {
        Leading { leader, data: ShownData::default(), sent: None, tour: None, told_address: false }
    }

    /// The leader's end of the network, which knows the followers.
    pub fn leader(&self) -> &Leader {
        &self.leader
    }

    /// Forgets a follower that is gone.
    pub fn forget(&mut self, name: &str) {
        self.leader.forget(name);
    }

    /// Gives the followers all that is shown, where it has changed.
    fn send_scene(
        &mut self,
        scene: &Scene,
        playhead: Option<&Playhead>,
        settings: &Settings,
        labels: Option<&Path>,
        notices: &mut Notices,
    ) {
        if let Some(sent) = &self.sent {
            // The lens goes with the camera, and each window has a projection of its own.
            let Settings { lens, surround, stereo, .. } = sent.settings;
            let same = Settings { lens, surround, stereo, ..settings.clone() } == sent.settings;
            if same && sent.generation == scene.generation && sent.labels.as_deref() == labels {
                return;
            }
        }
        let datasets = self.data.of(scene, settings);
        // The moment goes with every frame, and whether anything moves then.
        let moves = playhead.and_then(Playhead::moves).filter(|own| *own != Interpolation::default());
        let look = LookPatch { interpolation: moves, ..settings.look.patch() };
        match Leading::text(datasets, look, labels).map(|text| self.leader.set_scene(text)) {
            Ok(true) => {}
            Ok(false) => notices.error("the settings are too long to be sent: followers keep those before"),
            Err(error) => notices.error(error.to_string()),
        }
        let labels = labels.map(Path::to_owned);
        self.sent = Some(Sent { settings: settings.clone(), generation: scene.generation, labels });
    }

    /// What followers of a window that shows these datasets with this look are told.
    ///
    /// # Errors
    /// [`SceneError`] if RON cannot say it.
    pub fn text(datasets: Vec<DatasetRef>, look: LookPatch, labels: Option<&Path>) -> Result<String, SceneError> {
        let labels = labels.map(|path| path.canonicalize().unwrap_or_else(|_| path.to_owned()));
        let file = SceneFile { look, labels, ..SceneFile::new(datasets) };
        file.text(Path::new("the show"))
    }

    /// Gives the followers the tour that is open, where it has changed.
    fn send_tour(&mut self, player: &Player, aspect: f64, notices: &mut Notices) {
        let folder = player.path().and_then(Path::parent).map(Path::to_owned).unwrap_or_default();
        let same = match (&self.tour, player.tour()) {
            (None, None) => true,
            (Some((sent, from)), Some(tour)) => sent == tour && *from == folder,
            _ => false,
        };
        if same {
            return;
        }
        self.tour = player.tour().map(|tour| (tour.clone(), folder.clone()));
        let text = player.tour().map(TourFile::to_ron).unwrap_or_default();
        let folder = std::path::absolute(&folder).unwrap_or(folder).to_string_lossy().into_owned();
        if !self.leader.set_tour(text, folder, aspect) {
            notices.error("the tour is too long to be sent: followers show no captions");
        }
    }
}

/// Takes in what followers say, and passes it on to the presenter.
pub(crate) fn receive_from_followers(
    mut leading: ResMut<Leading>,
    time: Res<Time<Real>>,
    mut notices: ResMut<Notices>,
) {
    let leading = leading.bypass_change_detection();
    if !std::mem::replace(&mut leading.told_address, true)
        && let Some(address) = leading.leader.address()
    {
        notices.info(format!("leads the show at {address}"));
    }
    for event in leading.leader.receive(time.elapsed()) {
        match event {
            LeaderEvent::Came { name, again: false } => notices.info(format!("{name} follows")),
            LeaderEvent::Came { name, again: true } => notices.info(format!("{name} follows again")),
            LeaderEvent::Gone { name } => {
                notices.error(format!("{name} is gone; its last picture stays, and it comes back by itself"));
            }
            LeaderEvent::Told { name, severity: Severity::Error, text } => notices.error(format!("{name}: {text}")),
            LeaderEvent::Told { name, severity: Severity::Info, text } => notices.info(format!("{name}: {text}")),
            LeaderEvent::Refused { address, why } => {
                let who = address.map_or_else(|| "somebody".to_owned(), |address| address.to_string());
                notices.error(format!("{who} cannot follow: {why}"));
            }
        }
    }
}

/// Sends what this frame shows.
pub(crate) fn send_frame(
    mut leading: ResMut<Leading>,
    time: Res<Time<Real>>,
    scene: Option<Res<Scene>>,
    settings: Res<Settings>,
    look: Option<Res<Look>>,
    (player, playhead): (Res<Player>, Option<Res<Playhead>>),
    objects: Res<Objects>,
    picture: Res<Picture>,
    mut notices: ResMut<Notices>,
    camera: Single<&Viewpoint, With<DataCamera>>,
) {
    let leading = leading.bypass_change_detection();
    let now = time.elapsed_secs_f64();
    let size = picture.size();
    leading.send_tour(&player, f64::from(size.x) / f64::from(size.y), notices.bypass_change_detection());
    if let Some(scene) = scene {
        let notices = notices.bypass_change_detection();
        leading.send_scene(&scene, playhead.as_deref(), &settings, objects.path(), notices);
    }
    let is_range = |[low, high]: [f64; 2]| low.is_finite() && high.is_finite() && low <= high;
    let ranges = look.map(|look| Ranges { p: look.levels.p, s: look.levels.s });
    let shows_tour = player.state().is_some() && player.timeline().is_some();
    let moment = || TourTime { time: player.clock().time(now), running: player.clock().is_running() };
    leading.leader.send(Frame {
        number: 0,
        time: now,
        camera: camera_of(&camera, &settings.lens),
        ranges: ranges.filter(|ranges| is_range(ranges.p) && is_range(ranges.s)),
        tour: shows_tour.then(moment),
        run: playhead.map(|playhead| RunTime { time: playhead.time(), holds: playhead.holds() }),
    });
}
