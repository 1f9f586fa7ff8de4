//! The moment of a run that is shown: it stands or plays. Between its steps the run's tracks are drawn; the step that it stands at is opened
//! on a thread of its own and takes the place of what was shown. The clock never waits: what is not there yet is skipped.

use super::facts::Facts;
use super::preset::{Along, PlayingPreset, Preset, Repeat};
use super::scene::{MovingRun, Scene, Settings};
use super::state::choices::Choices;
use super::state::notices::Notices;
use super::statistics::Converged;
use crate::hierarchy::spacetime::Interpolation;
use crate::look::OpenData;
use crate::model::{Moment, StepTimes, When};
use crate::store::run::RunTree;
use crate::store::{Metadata, PageFile, Tree};
use bevy::prelude::*;
use std::collections::BTreeSet;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};

/// The longest time that one frame goes on for where each picture is waited for, seconds.
const LONGEST_FRAME_SECS: f64 = 0.04;

/// How many times as fast or as slow a run plays at most.
const FASTEST: f64 = 64.0;

/// Where the open run stands.
#[derive(Resource)]
pub struct Playhead {
    data: OpenData,
    times: StepTimes,
    time: f64,
    playing: bool,
    /// Whether it plays back, on its way to and fro.
    is_back: bool,
    speed: f64,
    /// How it is to be played from now on, where somebody has asked for that.
    asked: Option<PlayingPreset>,
    /// Seconds of playing for which whoever reads pages wants to know what comes.
    pub(super) lead_secs: f64,
    /// Frames in which what was shown was not of the present time, while it played.
    late_frames: u64,
    shown: usize,
    /// What moves between steps, and whether that is drawn.
    tracks: Option<Arc<RunTree>>,
    moving: bool,
    /// Whether only steps are shown because somebody wants that.
    holds: bool,
    opening: Option<Opening>,
    /// Steps that could not be opened.
    damaged: BTreeSet<usize>,
}

/// A step on its way.
struct Opening {
    step: usize,
    outcome: Mutex<Receiver<Result<PageFile, String>>>,
}

impl Playhead {
    /// Stands at a moment of the run among `data`, whose step is open, and whose tracks are these; `None` where there is none.
    pub fn new(data: OpenData, moment: Moment, tracks: Option<Arc<RunTree>>) -> Option<Playhead> {
        let times = data.run()?.times().clone();
        let time = times.time(moment);
        let (shown, damaged) = (moment.step, BTreeSet::new());
        Some(Playhead {
            data,
            times,
            time,
            playing: false,
            is_back: false,
            speed: 1.0,
            asked: None,
            lead_secs: 0.0,
            late_frames: 0,
            shown,
            tracks,
            moving: false,
            holds: false,
            opening: None,
            damaged,
        })
    }

    /// The run among the datasets.
    pub fn data(&self) -> &OpenData {
        &self.data
    }

    /// Goes on as another one that has less of the run: at its time, playing where it plays.
    pub fn go_on_from(&mut self, before: &Playhead) {
        (self.playing, self.is_back, self.speed) = (before.playing, before.is_back, before.speed);
        (self.late_frames, self.holds) = (before.late_frames, before.holds);
        self.seek(before.time);
    }

    /// When the steps are.
    pub fn times(&self) -> &StepTimes {
        &self.times
    }

    /// The present time, in the unit of the steps' times.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// The step that is shown, or the one before what is shown.
    pub fn shown(&self) -> usize {
        if self.moving { self.wanted() } else { self.shown }
    }

    /// Whether what moves between the steps is shown.
    pub fn is_moving(&self) -> bool {
        self.moving
    }

    /// How particles are shown between the steps, as files say it.
    pub fn interpolation(&self) -> Interpolation {
        let has_tracks = || self.data.run().is_some_and(|run| run.tracks().is_ok());
        match &self.tracks {
            Some(_) if self.holds() => Interpolation::Hold,
            Some(tree) => tree.interpolation(),
            None if has_tracks() => Interpolation::Hold,
            None => Interpolation::default(),
        }
    }

    /// How particles move between the steps where that is shown; `None` without tracks.
    pub fn moves(&self) -> Option<Interpolation> {
        self.tracks.as_ref().map(|tree| tree.interpolation())
    }

    /// Whether what is between the steps can be shown.
    pub fn has_tracks(&self) -> bool {
        self.tracks.is_some()
    }

    /// Whether only steps are shown, also where something moves between them.
    pub fn holds(&self) -> bool {
        self.holds && self.has_stills() || self.tracks.is_none()
    }

    /// Shows steps alone from now on, or what moves between them.
    pub fn hold(&mut self, holds: bool) {
        self.holds = holds;
    }

    fn has_stills(&self) -> bool {
        self.data.run().is_none_or(|run| run.has_stills())
    }

    /// Steps that cannot be shown.
    pub fn damaged(&self) -> &BTreeSet<usize> {
        &self.damaged
    }

    /// Whether time goes on.
    pub fn is_playing(&self) -> bool {
        self.playing
    }

    /// Plays in another way from now on.
    pub fn play_as(&mut self, how: PlayingPreset) {
        self.asked = Some(how);
    }

    /// Frames that showed another time than the present one, while it played.
    pub fn late_frames(&self) -> u64 {
        self.late_frames
    }

    /// How many times as fast as usual it plays.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// The step that is to be shown at the present time: the one at or before it.
    fn wanted(&self) -> usize {
        self.times.times.partition_point(|step| *step <= self.time).saturating_sub(1)
    }

    /// Whether what is shown is of the present time.
    pub fn is_there(&self) -> bool {
        match self.moves_now() {
            true => self.moving,
            false => !self.moving && self.wanted() == self.shown || self.damaged.contains(&self.wanted()),
        }
    }

    /// Whether tracks are to be drawn: while time goes on, and between steps.
    fn moves_now(&self) -> bool {
        let is_between = || self.times.times.get(self.wanted()).is_none_or(|step| *step != self.time);
        !self.holds() && (self.playing || !self.has_stills() || is_between())
    }

    /// The tracks' clock at a time.
    fn clock_at(&self, tree: &RunTree, time: f64) -> f64 {
        let moment = tree.run().moment(When::Time(time)).unwrap_or_default();
        tree.time(moment)
    }

    /// How far along a run a time is, from 0 to 1: by time, or as if its steps were evenly apart.
    pub fn share(&self, time: f64, along: Along) -> f64 {
        let ([first, last], times) = (self.ends(), &self.times.times);
        match along {
            _ if last <= first => 0.0,
            Along::Time => (time - first) / (last - first),
            Along::Steps => {
                let before = times.partition_point(|step| *step <= time).clamp(1, times.len() - 1) - 1;
                let within = (time - times[before]) / (times[before + 1] - times[before]);
                (before as f64 + within) / (times.len() - 1) as f64
            }
        }
    }

    /// The time that is so far along a run.
    pub fn time_at(&self, share: f64, along: Along) -> f64 {
        let ([first, last], times, share) = (self.ends(), &self.times.times, share.clamp(0.0, 1.0));
        match along {
            _ if last <= first => first,
            Along::Time => first + share * (last - first),
            Along::Steps => {
                let place = share * (times.len() - 1) as f64;
                let before = (place.floor() as usize).min(times.len() - 2);
                times[before] + (place - before as f64) * (times[before + 1] - times[before])
            }
        }
    }

    /// How far along the run it is so many seconds later, below 0 and above 1 where it would be beyond an end.
    fn later(&self, seconds: f64, how: &PlayingPreset) -> f64 {
        let way = if self.is_back { -seconds } else { seconds };
        self.share(self.time, how.pace) + way * self.speed / how.seconds
    }

    /// What is to be drawn of the tracks now, and what comes.
    fn motion(&self, how: &PlayingPreset) -> Option<MovingRun> {
        let tree = Arc::clone(self.tracks.as_ref().filter(|_| self.moves_now())?);
        let ahead = self.time_at(self.later(self.lead_secs, how), how.pace);
        let (time, ahead) = (self.clock_at(&tree, self.time), self.clock_at(&tree, ahead));
        let next = if self.playing { tree.next_intervals(time, ahead) } else { Vec::new() };
        Some(MovingRun { time, next, tree })
    }

    /// The times of the first and the last step.
    pub fn ends(&self) -> [f64; 2] {
        [self.times.times.first(), self.times.times.last()].map(|end| end.copied().unwrap_or(0.0))
    }

    /// Goes to a time, and goes on playing from there.
    pub fn seek(&mut self, time: f64) {
        let [first, last] = self.ends();
        self.time = time.clamp(first, last);
    }

    /// Goes where a tour leads; a tour's own clock plays.
    pub fn lead(&mut self, time: f64) {
        self.playing = false;
        self.seek(time);
    }

    /// Goes so many steps on, or back; stands there.
    pub fn step(&mut self, by: isize) {
        let step = self.wanted().saturating_add_signed(by).min(self.times.times.len().saturating_sub(1));
        self.playing = false;
        self.time = self.times.times.get(step).copied().unwrap_or(self.time);
    }

    /// Goes to the first step or the last; stands there.
    pub fn go_to_end(&mut self, last: bool) {
        self.playing = false;
        self.time = self.ends()[usize::from(last)];
    }

    /// Plays, from the beginning where it stands at the end, or stands.
    pub fn toggle(&mut self) {
        let [first, last] = self.ends();
        self.playing = !self.playing && last > first;
        if self.playing && self.time >= last {
            self.time = first;
        }
    }

    /// Plays twice as fast, or half as fast.
    pub fn change_speed(&mut self, faster: bool) {
        let factor = if faster { 2.0 } else { 0.5 };
        self.speed = (self.speed * factor).clamp(FASTEST.recip(), FASTEST);
    }

    /// Seconds later.
    fn advance(&mut self, seconds: f64, how: &PlayingPreset) {
        if !self.playing {
            return;
        }
        // Whoever goes to and fro may have changed his mind on the way back.
        self.is_back &= how.repeat == Repeat::ToAndFro;
        let share = self.later(seconds, how);
        let is_over = if self.is_back { share <= 0.0 } else { share >= 1.0 };
        self.time = self.time_at(share, how.pace);
        if is_over {
            match how.repeat {
                Repeat::Once => self.playing = false,
                Repeat::Again => self.time = self.time_at(share.fract(), how.pace),
                Repeat::ToAndFro => self.is_back = !self.is_back,
            }
        }
    }

    /// Begins to open the step that is wanted, unless one is on its way.
    fn open_wanted(&mut self) {
        let step = self.wanted();
        if self.opening.is_some() || self.moves_now() || self.is_there() {
            return;
        }
        let (data, (send, outcome)) = (self.data.clone(), channel());
        let open = move || data.at(Moment { step, u: 0.0 }).map(|(file, _)| file).map_err(|error| error.to_string());
        // A thread of its own: a disk that does not answer must not take one from a pool that draws.
        let thread = std::thread::Builder::new().name("deepfield step".into()).spawn(move || drop(send.send(open())));
        // Without a thread, the end of the channel is the answer.
        drop(thread);
        self.opening = Some(Opening { step, outcome: Mutex::new(outcome) });
    }

    /// The step that has been opened since the last call.
    fn arrived(&mut self) -> Option<(usize, Result<PageFile, String>)> {
        let opening = self.opening.as_mut()?;
        let outcome = opening.outcome.get_mut().unwrap_or_else(PoisonError::into_inner).try_recv();
        let step = opening.step;
        let result = match outcome {
            Ok(result) => result,
            Err(TryRecvError::Disconnected) => Err(format!("step {step}: opening it has failed")),
            Err(TryRecvError::Empty) => return None,
        };
        self.opening = None;
        Some((step, result))
    }
}

/// Lets time go on; where each picture is waited for, once it is complete.
pub(super) fn play(
    time: Res<Time<Real>>,
    (mut preset, converged): (ResMut<Preset>, Res<Converged>),
    playhead: Option<ResMut<Playhead>>,
) {
    let Some(mut playhead) = playhead else { return };
    let playhead = playhead.bypass_change_detection();
    if let Some(how) = playhead.asked.take() {
        preset.playing = how;
    }
    let seconds = time.delta_secs_f64();
    match preset.drawing.wait {
        true if converged.0 && playhead.is_there() => {
            playhead.advance(seconds.min(LONGEST_FRAME_SECS), &preset.playing);
        }
        true => {}
        false => {
            playhead.late_frames += u64::from(playhead.playing && !playhead.is_there());
            playhead.advance(seconds, &preset.playing);
        }
    }
}

/// Shows what the playhead has come to: camera, cut and settings stay as they are.
pub(super) fn show_moment(
    playhead: Option<ResMut<Playhead>>,
    scene: Option<ResMut<Scene>>,
    mut settings: ResMut<Settings>,
    mut choices: ResMut<Choices>,
    mut notices: ResMut<Notices>,
    preset: Res<Preset>,
) {
    let (Some(mut playhead), Some(mut scene)) = (playhead, scene) else { return };
    let playhead = playhead.bypass_change_detection();
    let arrived = playhead.arrived();
    let motion = playhead.motion(&preset.playing);
    let still = match arrived {
        Some((step, Ok(file))) => {
            playhead.shown = step;
            Some(Arc::new(file))
        }
        Some((step, Err(why))) => {
            playhead.damaged.insert(step);
            notices.error(why);
            None
        }
        // What has come back to the step that is open.
        None => (playhead.moving && playhead.wanted() == playhead.shown).then(|| Arc::clone(&scene.file)),
    };
    let before = match (&motion, &scene.moving) {
        (Some(_), Some(_)) => None,
        (Some(_), None) => Some(scene.tree()),
        (None, _) => still.is_some().then(|| scene.tree()),
    };
    if let Some(motion) = motion {
        // Nothing else than its time changes.
        let scene = scene.bypass_change_detection();
        scene.time = Some(playhead.time);
        scene.moving = Some(motion);
        playhead.moving = true;
    } else if let Some(file) = still {
        scene.time = playhead.times.times.get(playhead.shown).copied();
        scene.facts = Facts::of(&file, &scene.members);
        (scene.file, scene.moving) = (file, None);
        playhead.moving = false;
    }
    if let Some(before) = before {
        let tree = scene.tree();
        let families = families_of(before.metadata(), &settings.families, tree.metadata());
        if settings.families != families {
            settings.families = families;
        }
        let names = Choices::attributes_of(tree.metadata());
        if choices.attributes != names {
            choices.attributes = names;
        }
        let metadata = tree.metadata();
        (scene.bounds, scene.periodic) = (metadata.bounds(), metadata.periodic_box());
        scene.facts.families = Facts::families_of(metadata);
        scene.generation += 1;
    }
    playhead.open_wanted();
}

/// Whether each family of `next` is drawn: as it was in `before`; what comes is drawn.
pub fn families_of(before: &Metadata, shown: &[bool], next: &Metadata) -> Vec<bool> {
    let name = |data: &Metadata| data.families.iter().map(|family| family.name).collect::<Vec<_>>();
    let (before, next) = (name(before), name(next));
    // Several datasets may have families of the same name: they keep their order.
    if before == next {
        return shown.to_vec();
    }
    let known = |name| before.iter().position(|own| *own == name).and_then(|at| shown.get(at).copied());
    next.into_iter().map(|name| known(name).unwrap_or(true)).collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::build::{BuildOptions, RunBuild, TrackOptions};
    use crate::import::{LoadOptions, RunOptions, Times, open_run};
    use crate::look::{Member, SceneFile};
    use crate::model::ReadMethod;
    use crate::store::StoreError;
    use crate::window::adopt::adopt_opened;
    use crate::window::objects::Objects;
    use crate::window::open::{Opened, OpenedScene, open_members};
    use crate::window::options::Opener;
    use crate::window::scene_io::{Bookmarks, SceneFiles};
    use crate::window::state::panels::{Closed, Shown};
    use crate::window::state::plots::PlotChoice;
    use crate::window::touring::player::tests::Window;

    /// A run of three steps, at 0, 1 and 4.
    pub fn run_file(folder: &std::path::Path) -> std::path::PathBuf {
        run_with(folder, None)
    }

    /// The same with what moves between its steps.
    pub fn tracked_run_file(folder: &std::path::Path) -> std::path::PathBuf {
        run_with(folder, Some(&TrackOptions::default()))
    }

    fn run_with(folder: &std::path::Path, tracks: Option<&TrackOptions>) -> std::path::PathBuf {
        let more: String = (9..17).filter(|_| tracks.is_some()).map(|id| format!("{id},1,{id},1\n")).collect();
        let tables = [0, 1, 2].map(|step| {
            let path = folder.join(format!("t{step}.csv"));
            std::fs::write(&path, format!("id,x,y,z\n7,{step},0,0\n8,1,1,1\n{more}")).unwrap();
            path
        });
        let options = RunOptions { times: Some(Times::List(vec![0.0, 1.0, 4.0])), ..RunOptions::default() };
        let run = open_run(&tables, &options, ReadMethod::default()).unwrap();
        let out = folder.join("run.df");
        let (load, options) = (LoadOptions::default(), BuildOptions::default());
        let build = RunBuild { load: &load, options: &options, tracks, skip_damaged: false, still_of: None };
        build.build(run, &out, &()).unwrap();
        out
    }

    #[test]
    fn a_scene_that_holds_shows_steps_alone_until_somebody_wants_to_see_the_rest() {
        let folder = tempfile::tempdir().unwrap();
        let run = tracked_run_file(folder.path());
        let opener: Opener = Arc::new(|path, _, _| Ok(path.to_owned()));
        let mut scene = SceneFile::new(Vec::new());
        scene.look.interpolation = Some(Interpolation::Hold);
        let scene = OpenedScene { path: "a.scene.ron".into(), scene, notes: Vec::new() };
        let members = vec![Member::new(run)];
        let opened = open_members(members, Some(scene), (None, None), ReadMethod::default(), &opener, &()).unwrap();
        let mut window = Window::new();
        window
            .app
            .init_resource::<SceneFiles>()
            .init_resource::<PlotChoice>()
            .init_resource::<Bookmarks>()
            .init_resource::<Closed>()
            .init_resource::<Shown>()
            .init_resource::<Objects>()
            .add_message::<Opened>()
            .add_systems(First, adopt_opened);
        window.app.world_mut().write_message(opened.clone());
        window.frame(0.0);
        let mut playhead = window.app.world_mut().resource_mut::<Playhead>();
        assert!(playhead.has_tracks() && playhead.holds());
        assert_eq!(playhead.interpolation(), Interpolation::Hold, "a scene keeps it");
        playhead.hold(false);
        assert_eq!((playhead.holds(), playhead.interpolation()), (false, Interpolation::Auto));
        // More of it is seen as what was there.
        let before = [window.app.world().resource::<Scene>().dataset, window.app.world().resource::<Scene>().subject];
        window.app.world_mut().write_message(Opened { keeps: true, ..opened });
        window.frame(0.0);
        let world = window.app.world();
        assert!(!world.resource::<Playhead>().holds());
        let scene = world.resource::<Scene>();
        assert_eq!([scene.dataset, scene.subject], [before[0] + 1, before[1]]);
    }

    pub fn playhead(folder: &std::path::Path) -> Playhead {
        let out = run_file(folder);
        let built = |path: &std::path::Path| Ok::<_, StoreError>(path.to_owned());
        let data = OpenData::open(&[Member::new(out)], ReadMethod::default(), built).unwrap();
        Playhead::new(data, Moment::default(), None).unwrap()
    }

    fn wait(playhead: &mut Playhead) -> (usize, PageFile) {
        playhead.open_wanted();
        loop {
            if let Some((step, file)) = playhead.arrived() {
                playhead.shown = step;
                return (step, file.unwrap());
            }
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
    }

    #[test]
    fn time_goes_evenly_from_step_to_step_and_stands_at_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let mut playhead = playhead(folder.path());
        let how = PlayingPreset::default();
        assert!(playhead.is_there() && !playhead.is_playing());
        playhead.advance(100.0, &how);
        assert_eq!(playhead.time(), 0.0, "it stands");
        playhead.toggle();
        playhead.advance(how.seconds / 2.0, &how);
        assert_eq!((playhead.time(), playhead.wanted(), playhead.is_there()), (2.0, 1, false));
        let (step, file) = wait(&mut playhead);
        assert_eq!((step, file.metadata().bounds().min.x), (1, 1.0));
        assert!(playhead.is_there() && playhead.opening.is_none());
        playhead.change_speed(true);
        playhead.advance(how.seconds, &how);
        assert_eq!((playhead.time(), playhead.is_playing()), (4.0, false));
        playhead.toggle();
        assert_eq!((playhead.time(), playhead.is_playing()), (0.0, true), "once more from the beginning");
    }

    #[test]
    fn it_plays_again_or_to_and_fro_and_evenly_by_time_or_by_steps() {
        let folder = tempfile::tempdir().unwrap();
        let mut playhead = playhead(folder.path());
        let way = |repeat, pace, playhead: &mut Playhead| -> Vec<f64> {
            let how = PlayingPreset { seconds: 8.0, repeat, pace, ..PlayingPreset::default() };
            playhead.go_to_end(false);
            playhead.toggle();
            // Times are 0, 1 and 4.
            (0..6).map(|_| (playhead.advance(2.0, &how), playhead.time()).1).collect()
        };
        assert_eq!(way(Repeat::Once, Along::Time, &mut playhead), [1.0, 2.0, 3.0, 4.0, 4.0, 4.0]);
        assert!(!playhead.is_playing());
        assert_eq!(way(Repeat::Once, Along::Steps, &mut playhead), [0.5, 1.0, 2.5, 4.0, 4.0, 4.0]);
        assert_eq!(way(Repeat::Again, Along::Time, &mut playhead), [1.0, 2.0, 3.0, 0.0, 1.0, 2.0]);
        playhead.toggle();
        assert_eq!(way(Repeat::ToAndFro, Along::Steps, &mut playhead), [0.5, 1.0, 2.5, 4.0, 2.5, 1.0]);
        // Once more on from where it goes back.
        let how = PlayingPreset { seconds: 8.0, ..PlayingPreset::default() };
        playhead.advance(2.0, &how);
        assert_eq!((playhead.time(), playhead.is_playing()), (2.0, true));
        for along in [Along::Time, Along::Steps] {
            for time in [0.0, 0.3, 1.0, 2.0, 4.0] {
                assert!((playhead.time_at(playhead.share(time, along), along) - time).abs() < 1e-12, "{time}");
            }
        }
    }

    #[test]
    fn steps_are_gone_to_by_one_and_to_the_ends() {
        let folder = tempfile::tempdir().unwrap();
        let mut playhead = playhead(folder.path());
        let mut at = |go: &dyn Fn(&mut Playhead)| {
            go(&mut playhead);
            playhead.time()
        };
        assert_eq!(at(&|head| head.step(1)), 1.0);
        assert_eq!(at(&|head| head.seek(3.0)), 3.0);
        assert_eq!(at(&|head| head.step(-1)), 0.0, "from between the second and the third");
        assert_eq!(at(&|head| head.step(-1)), 0.0);
        assert_eq!(at(&|head| head.go_to_end(true)), 4.0);
        assert_eq!(at(&|head| head.step(1)), 4.0);
        assert_eq!(at(&|head| head.seek(99.0)), 4.0);
        (0..20).for_each(|_| playhead.change_speed(false));
        assert_eq!(playhead.speed(), 1.0 / FASTEST);
    }
}
