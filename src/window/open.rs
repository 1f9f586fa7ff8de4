//! Opening files: on a background thread, with progress that the window shows, and without stopping the program where
//! a file cannot be read.

mod heights;
mod mixed;
mod sketch;

use super::options::{OpenRequest, Opener};
use super::picture::Picture;
use super::preset::{Preset, ResidencyPreset};
use super::scene::{Scene, SceneField};
use super::state::notices::Notices;
use super::state::progress::SharedProgress;
use crate::hierarchy::spacetime::Interpolation;
use crate::look::{Member, OpenData, SceneFile, check_derived, is_field, is_scene_file, said_of_particles, say};
use crate::model::progress::Progress;
use crate::model::{Bounds, Moment, ReadMethod, When};
use crate::picture::mixed::MixedSession;
use crate::store::run::RunTree;
use crate::store::{PageFile, StoreError};
use crate::stream::first_frame;
use crate::tour::TourFile;
use bevy::prelude::*;
use sketch::Sketch;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};

/// How the window opens files, and what it is opening.
#[derive(Resource)]
pub struct Openings {
    opener: Opener,
    current: Option<Opening>,
    /// What is built meanwhile: its name and how far it has come.
    pub(super) behind: Option<(PathBuf, Arc<SharedProgress>)>,
    /// How page files are read.
    pub read: ReadMethod,
    /// Bytes that pages of particles may take among other data.
    pub page_memory: u64,
    /// Whether files that are dropped are shown with what is open, not in its place.
    pub adds_dropped: bool,
}

/// A file on its way.
struct Opening {
    path: PathBuf,
    /// What was asked for.
    members: Vec<Member>,
    progress: Arc<SharedProgress>,
    outcome: Mutex<Receiver<Result<Opened, String>>>,
    /// Whether a part of it is shown.
    is_shown: bool,
}

/// A scene that has been opened: with its data it is handed to the window.
#[derive(Clone, Debug)]
pub struct OpenedScene {
    /// The scene file.
    pub path: PathBuf,
    /// What it says.
    pub scene: SceneFile,
    /// What the user should know about its data.
    pub notes: Vec<String>,
}

/// How what is opened is to be seen.
#[derive(Clone)]
struct Seen {
    /// The scene that names it.
    scene: Option<OpenedScene>,
    /// How degrees of heights become places, in place of what the scene says.
    map: Option<String>,
}

/// A file has arrived.
#[derive(bevy::ecs::message::Message, Clone)]
pub struct Opened {
    /// What the user named.
    pub path: PathBuf,
    /// The datasets.
    pub members: Vec<Member>,
    /// What of them does not fit together.
    pub notes: Vec<String>,
    /// The datasets as they are open, and the moment that is shown, where one of them is a run.
    pub run: Option<(OpenData, Moment)>,
    /// Its tracks, where it has some.
    pub tracks: Option<Arc<RunTree>>,
    /// The image or the volume that is open, where it is one and alone.
    pub field: Option<SceneField>,
    /// The page file made of them; of runs, of the step that is shown.
    pub file: Arc<PageFile>,
    /// The box to look at first.
    pub frame: Bounds,
    /// The scene that names it.
    pub scene: Option<Arc<OpenedScene>>,
    /// How degrees of heights become places, in place of what the scene says.
    pub map: Option<String>,
    /// Whether it is more of what is open, so that the view of it stays as it is.
    pub keeps: bool,
    /// Whether more of it will come.
    pub has_more: bool,
}

/// A file that the user asks for otherwise than by dropping it: it is opened in the place of what is open.
#[derive(bevy::ecs::message::Message, Clone, Debug, PartialEq, Eq)]
pub struct Wanted(pub PathBuf);

impl Openings {
    /// Opens nothing yet.
    pub fn new(opener: Opener) -> Openings {
        let usual = ResidencyPreset::default();
        let (read, page_memory) = (usual.read, usual.memory_among_others());
        Openings { opener, current: None, behind: None, read, page_memory, adds_dropped: false }
    }

    /// Starts to open a file in the place of what is open, or where it `joins`, with it: with what is on its way, where something is.
    pub(super) fn open(&mut self, path: &Path, joins: bool, scene: Option<&Scene>) {
        let mut request = OpenRequest::of(path);
        if joins && !is_scene_file(path) {
            let is_data = |opening: &&Opening| !opening.members.iter().any(|member| is_scene_file(&member.path));
            let coming = self.current.as_ref().filter(|opening| !opening.is_shown).filter(is_data);
            let open = coming.map(|opening| &opening.members).or(scene.map(|scene| &scene.members));
            request.members.splice(0..0, open.into_iter().flatten().cloned());
        }
        self.start(request);
    }

    /// Starts to open a file; one that is still on its way is abandoned.
    pub fn start(&mut self, request: OpenRequest) {
        let progress = Arc::new(SharedProgress::default());
        progress.begin("reading", 0);
        let named = request.members.last().map(|member| member.path.clone()).or_else(|| request.scene.clone());
        let (opener, path, shared) = (Arc::clone(&self.opener), named.unwrap_or_default(), Arc::clone(&progress));
        let (read, page_memory, members) = (self.read, self.page_memory, request.members.clone());
        let (moment, (send, outcome)) = ((request.time, request.interpolation), channel());
        // A thread of its own: a disk that does not answer must not take one from a pool that draws.
        let (early, failed) = (send.clone(), send.clone());
        let open = move || {
            let map = request.map.clone();
            let Wished { members, scene, notes } = data_of(request)?;
            let opened = if matches!(&members[..], [only] if only.is_of_heights() && only.is_in_place()) {
                let seen = Seen { scene, map };
                heights::open_heights(members, &seen, read, &opener, shared.as_ref(), &early)
            } else if MixedSession::is_for(&members) {
                let seen = Seen { scene, map };
                mixed::open_mixed(members, &seen, (read, moment.0), page_memory, &opener, shared.as_ref())
            } else {
                let sketch = match &members[..] {
                    [only] if is_field(&only.path) => Some(Sketch::begin(&members, &scene, read, early)),
                    _ => None,
                };
                let open = || open_members(members, scene, moment, read, &opener, shared.as_ref());
                match sketch {
                    Some(Ok(sketch)) => sketch.end(open),
                    // What cannot be drawn as a field may be drawn by its voxels.
                    Some(Err(_)) | None => open(),
                }
            };
            opened.map(|opened| Opened { notes: [notes, opened.notes].concat(), ..opened })
        };
        // Nobody listens any more where another file was opened meanwhile.
        let thread = std::thread::Builder::new().name("deepfield open".into()).spawn(move || drop(send.send(open())));
        if let Err(error) = thread {
            drop(failed.send(Err(format!("{}: no thread can be started: {error}", path.display()))));
        }
        self.current = Some(Opening { path, members, progress, outcome: Mutex::new(outcome), is_shown: false });
    }

    /// Whether a file that was asked for is on its way.
    pub(super) fn is_opening(&self) -> bool {
        self.current.as_ref().is_some_and(|opening| !opening.is_shown)
    }

    /// What is being opened, or built meanwhile: its path, the stage and the share of the stage that is done.
    pub fn progress(&self) -> Option<(&Path, String, Option<f32>)> {
        let current = self.current.as_ref().map(|opening| (&opening.path, &opening.progress));
        let (path, progress) = current.or(self.behind.as_ref().map(|(path, progress)| (path, progress)))?;
        let (stage, share) = progress.state();
        Some((path, stage, share))
    }
}

/// Opens datasets as one scene, of a run at a moment and with how its particles move, in place of what the scene says of either.
pub(super) fn open_members(
    members: Vec<Member>,
    scene: Option<OpenedScene>,
    (time, interpolation): (Option<When>, Option<Interpolation>),
    read: ReadMethod,
    opener: &Opener,
    progress: &dyn Progress,
) -> Result<Opened, String> {
    let members = members.iter().map(Member::resolved).collect::<Result<Vec<_>, _>>();
    let members = members.map_err(|error| error.to_string())?;
    let path = members.first().map(|member| member.path.clone()).unwrap_or_default();
    let built = |path: &Path| opener(path, &said_of_particles(&members, path), progress).map_err(Failure);
    let data = OpenData::open(&members, read, built).map_err(|Failure(why)| why)?;
    let when = time.or(scene.as_ref().and_then(|opened| opened.scene.look.time));
    // A time that the data does not have is told, and the beginning is shown.
    let (moment, mut notes) = match data.moment(when) {
        Ok(moment) => (moment, Vec::new()),
        Err(error) => (data.moment(None).ok().flatten(), vec![error.to_string()]),
    };
    let (file, unlike) = data.at(moment.unwrap_or_default()).map_err(|error| error.to_string())?;
    notes.extend(unlike);
    let families: Vec<u32> = (0..file.metadata().families.len() as u32).collect();
    let frame = first_frame(&file, &families, 0.0);
    let interpolation = interpolation.or(scene.as_ref().and_then(|opened| opened.scene.look.interpolation));
    let tracks = tracks_of(&data, &members, interpolation.unwrap_or_default()).unwrap_or_else(|error| {
        notes.push(error.to_string());
        None
    });
    let run = moment.map(|moment| (data, moment));
    Ok(Opened {
        path,
        members,
        notes,
        run,
        tracks,
        field: None,
        file: Arc::new(file),
        frame,
        scene: scene.map(Arc::new),
        map: None,
        keeps: false,
        has_more: false,
    })
}

/// The tracks of the run that is the only dataset, where it lies as it is.
fn tracks_of(
    data: &OpenData,
    members: &[Member],
    interpolation: Interpolation,
) -> Result<Option<Arc<RunTree>>, StoreError> {
    let Some(run) = data.run().filter(|run| run.tracks().is_ok()) else { return Ok(None) };
    // Who is shown steps alone may want to see the rest.
    let interpolation = match interpolation {
        Interpolation::Hold if !run.has_stills() => return Ok(None),
        Interpolation::Hold => Interpolation::default(),
        moves => moves,
    };
    let units = (&run.directory().length_unit, &run.directory().mass_unit);
    match members {
        [only] if only.placement(units, units).is_here() => {
            Ok(Some(Arc::new(RunTree::new(Arc::clone(run), interpolation)?)))
        }
        _ => Ok(None),
    }
}

/// Why a file cannot be opened, in a line.
struct Failure(String);

impl From<StoreError> for Failure {
    fn from(error: StoreError) -> Failure {
        Failure(error.to_string())
    }
}

/// What is to be opened.
#[derive(Default)]
struct Wished {
    members: Vec<Member>,
    /// The scene that it is seen by.
    scene: Option<OpenedScene>,
    /// What is to be known of the data that a tour names; what is of a scene's is with that.
    notes: Vec<String>,
}

/// The datasets to open: what is named, or what the scene or the tour that is named says; its own data where both are. What is said of heights
/// among them is over what the scene says.
fn data_of(request: OpenRequest) -> Result<Wished, String> {
    let said = request.said.clone();
    let mut wished = data_and_scene(request)?;
    let members = &mut wished.members;
    say(members, &said);
    check_derived(members)?;
    let has_heights = members.iter().any(Member::is_of_heights);
    if let Some(photo) = said.texture.filter(|_| !has_heights) {
        return Err(format!("{}: --texture: found no heights to lay it over, expected some", photo.path.display()));
    }
    if let Some(before) = said.before.filter(|_| !has_heights) {
        return Err(format!("{}: --before: found no heights to compare it with, expected some", before.display()));
    }
    Ok(wished)
}

fn data_and_scene(request: OpenRequest) -> Result<Wished, String> {
    let mut own = request.members;
    let path = match request.scene {
        Some(scene) => scene,
        None if own.first().is_some_and(|first| is_scene_file(&first.path)) => match TourFile::read(&own[0].path) {
            Ok(tour) => return data_of_tour(&own[0].path, &tour),
            Err(_) => own.remove(0).path,
        },
        None => return Ok(Wished { members: own, ..Wished::default() }),
    };
    let mut scene = SceneFile::read(&path).map_err(|error| error.to_string())?;
    if let Some((surround, stereo)) = request.projection {
        (scene.projection, scene.stereo) = (surround, stereo);
    }
    scene.look = scene.look.then(&request.light);
    let mut notes = Vec::new();
    if own.is_empty() {
        let located = scene.locate(&path).map_err(|error| error.to_string())?;
        (own, notes) = (located.members, located.notes);
    } else if let Some(named) = scene.datasets.first() {
        own[0].families.clone_from(&named.families);
    }
    Ok(Wished { members: own, scene: Some(OpenedScene { path, scene, notes }), notes: Vec::new() })
}

/// The data that a tour names.
fn data_of_tour(path: &Path, tour: &TourFile) -> Result<Wished, String> {
    let Some(dataset) = &tour.dataset else {
        return Err(format!(
            "{}: dataset: found none, expected the tour's data: open some, and it plays",
            path.display()
        ));
    };
    let located = dataset.locate(path).map_err(|error| error.to_string())?;
    // As recordings have it.
    let as_it_lies = |member: Member| Member { said: member.said, ..Member::new(member.path) };
    let members = located.members.into_iter().map(as_it_lies).collect();
    Ok(Wished { members, scene: None, notes: located.notes })
}

/// Files that are opened from now on are read as the preset says.
pub(super) fn follow_preset(preset: Res<Preset>, mut openings: ResMut<Openings>) {
    openings.read = preset.residency.read;
    openings.page_memory = preset.residency.memory_among_others();
}

/// Hands over files that have arrived and reports those that cannot be opened. The first waits until the window has been laid out, since
/// how large the picture is says from how far away all of the data is seen.
pub(crate) fn finish_opening(
    picture: Res<Picture>,
    mut openings: ResMut<Openings>,
    mut notices: ResMut<Notices>,
    mut opened: MessageWriter<Opened>,
) {
    if !picture.is_placed {
        return;
    }
    let Some(opening) = openings.bypass_change_detection().current.as_mut() else { return };
    let outcome = opening.outcome.get_mut().unwrap_or_else(PoisonError::into_inner).try_recv();
    let path = std::mem::take(&mut opening.path);
    let result = match outcome {
        Ok(result) => result,
        Err(TryRecvError::Disconnected) => Err(format!("{}: opening it has failed", path.display())),
        Err(TryRecvError::Empty) => {
            opening.path = path;
            return;
        }
    };
    let known = openings.current.take();
    match result {
        Ok(file) => {
            if file.has_more {
                openings.current = known.map(|opening| Opening { path, is_shown: true, ..opening });
            }
            opened.write(file);
        }
        Err(error) => notices.error(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_has_arrived_waits_for_the_pictures_place() {
        let (send, outcome) = channel();
        send.send(Err("a.df: no page file".to_owned())).unwrap();
        let mut openings = Openings::new(Arc::new(|path, _, _| Ok(path.to_owned())));
        openings.current = Some(Opening {
            path: "a.df".into(),
            members: Vec::new(),
            progress: Arc::default(),
            outcome: Mutex::new(outcome),
            is_shown: false,
        });
        let picture = Picture::at(Rect::new(0.0, 0.0, 1280.0, 720.0));
        let mut app = App::new();
        app.insert_resource(Picture { is_placed: false, ..picture })
            .insert_resource(openings)
            .init_resource::<Notices>()
            .add_message::<Opened>()
            .add_systems(Update, finish_opening);
        app.update();
        let is_coming = |app: &App| app.world().resource::<Openings>().is_opening();
        assert!(is_coming(&app) && app.world().resource::<Notices>().all().count() == 0);
        app.world_mut().resource_mut::<Picture>().is_placed = true;
        app.update();
        assert!(!is_coming(&app) && app.world().resource::<Notices>().all().count() == 1);
    }

    #[test]
    fn a_scene_leads_to_its_data() {
        let folder = tempfile::tempdir().unwrap();
        let (data, path) = (folder.path().join("box.df"), folder.path().join("a.scene.ron"));
        std::fs::write(&data, b"data").unwrap();
        std::fs::write(&path, "(version: 1, datasets: [(path: \"box.df\")])").unwrap();
        let open = |path: &Path, scene: Option<&Path>| {
            let members = vec![Member::new(path)];
            data_of(OpenRequest { members, scene: scene.map(Path::to_owned), ..OpenRequest::default() })
        };
        let Wished { members, scene, .. } = open(&path, None).unwrap();
        assert_eq!((members, scene.unwrap().path), (vec![Member::new(&data)], path.clone()));
        let Wished { members, scene, .. } = open(Path::new("other.df"), Some(&path)).unwrap();
        assert!(members == [Member::new("other.df")] && scene.is_some(), "other data in the light of a scene");
        assert!(open(&data, None).unwrap().scene.is_none());
        // A tour leads to its data, too, and says nothing of how that is seen.
        let tour = folder.path().join("a.tour.ron");
        let keyframes = "keyframes: [(around: (what: data))])";
        std::fs::write(&tour, format!("(version: 1, dataset: (path: \"box.df\"), {keyframes}")).unwrap();
        let Wished { members, scene, .. } = open(&tour, None).unwrap();
        assert!(members == [Member::new(&data)] && scene.is_none());
        std::fs::write(&tour, format!("(version: 1, {keyframes}")).unwrap();
        let error = open(&tour, None).err().unwrap();
        assert!(error.contains("a.tour.ron: dataset: found none"), "{error}");
        std::fs::remove_file(&data).unwrap();
        let error = open(&path, None).err().unwrap();
        assert!(error.contains("a.scene.ron: the data is not at") && error.contains("--scene"), "{error}");
    }
}
