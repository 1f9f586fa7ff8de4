//! Open data, of which pictures are drawn: what one picture has read is there for the next.

use super::adapter::{self, Adapter, AdapterJob, Passes, draw_on};
use super::annotation::{Annotation, FollowedPlaces};
use super::drawn::{Picture, ShownMoment};
use super::error::PictureError;
use super::hiding::{self, Hiding};
use super::left_out::LeftOut;
use super::look::{depict, transfer_of};
use super::paths::{self, PathCounts, PathLayer, PathRequest};
use super::projected::{Means, Projector};
use super::source::{self, Wanted};
use super::subject::Subject;
use super::times::Times;
use crate::color::composite::composite_at;
use crate::color::transfer::{Levels, TransferFunction};
use crate::color::{Image, output};
use crate::cpu::Method;
use crate::cpu::overdraw::Overdraw;
use crate::cpu::paths::PathFragments;
use crate::cpu::volume::VolumeError;
use crate::explore::selection::Show;
use crate::explore::{Members, Places, Work};
use crate::hierarchy::spacetime::Interpolation;
use crate::import::{AttributeChoice, LoadOptions, Source, load_source, open};
use crate::look::{Backend, LookPatch, Member, OpenData, SceneFile, Shot, shown_families};
use crate::mode::{Depiction, LodBudget, Mode, Output, PathsOf, Plan, Raw};
use crate::model::{Bounds, FamilyName, Moment, Progress, ReadMethod};
use crate::modes;
use crate::store::run::{RunSnapshot, RunTree};
use crate::store::{InMemory, NodeRef, PageFile, RunFile, Tree};
use crate::stream::{Scene, SceneNode, SceneSelection, first_frame};
use crate::view::perspective_grid::GridError;
use crate::view::{Hidden, View};
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Who is told what there is to tell while data is opened and pictures are drawn, and shows how long it takes.
pub trait Reporter: Send + Sync {
    /// A sentence for the user.
    fn tell(&self, message: String);

    /// Shows the progress of one long work.
    fn progress(&self) -> Box<dyn Progress + '_>;

    /// Whether nobody waits for the picture any more. Asked between the views that pictures of all directions and for two eyes are put
    /// together from.
    fn is_stopped(&self) -> bool {
        false
    }
}

/// Nobody is told.
impl Reporter for () {
    fn tell(&self, _: String) {}

    fn progress(&self) -> Box<dyn Progress + '_> {
        Box::new(())
    }
}

/// How data is opened and drawn, whatever the picture.
#[derive(Default)]
pub struct SessionOptions {
    /// Draws every source particle at full precision, in this way; the page file where it is `None`.
    pub exact: Option<Method>,
    /// The one family that is drawn.
    pub family: Option<FamilyName>,
    /// How bytes of page files come into memory.
    pub read: ReadMethod,
    /// What draws; the best there is where it is `None`.
    pub backend: Option<Backend>,
    /// Where a picture of how many splats lie over each pixel goes.
    pub overdraw: Option<PathBuf>,
    /// How many times a picture is drawn, for times; 0 counts as 1.
    pub repeat: u32,
    /// What messages about settings name: the file that has them; the data where it is empty.
    pub named: PathBuf,
}

/// What the data is.
enum Data {
    /// A page file, or several as one.
    Pages(Arc<PageFile>),
    /// The particles of sources, of which the first is here.
    Source(PathBuf),
    /// The particles of a run between two steps.
    Moment(Box<RunSnapshot>),
}

/// Pages of earlier intervals are kept while all take no more than so much.
const KEPT_BYTES: u64 = 1 << 30;

/// Open data, and what draws pictures of it.
pub struct Session {
    options: SessionOptions,
    members: Vec<Member>,
    data: Data,
    /// What the page files are of, where they can be steps of runs.
    opened: Option<OpenData>,
    /// The moment of the run that is open.
    moment: Moment,
    /// What moves there along tracks; `None` where a stored step is open.
    moving: Option<ShownMoment>,
    /// The tracks that are drawn, or were last.
    tracks: Option<Arc<RunTree>>,
    scene: Scene,
    /// What the first picture of some families shows, since that takes reading.
    framed: Option<(Vec<u32>, Bounds)>,
    /// How long the source took to load, until a picture has told it.
    loading: Option<Duration>,
    ahead: Option<View>,
    adapter: Option<Box<dyn Adapter>>,
    /// What the last picture hides.
    hiding: Option<Hiding>,
    /// The paths of the run, where they were drawn.
    paths: Option<PathLayer>,
    /// What was told of paths last.
    told_of_paths: Option<&'static str>,
    reporter: Arc<dyn Reporter>,
}

impl Session {
    /// Opens datasets as one. `page_file` turns what a user names into a page file; source particles are loaded as the shots
    /// that will be drawn need them.
    ///
    /// # Errors
    /// When a source cannot be read or built, or they do not fit together.
    pub fn open<'a>(
        members: &[Member],
        options: SessionOptions,
        shots: impl IntoIterator<Item = &'a Shot>,
        page_file: impl FnMut(&Path) -> Result<PathBuf, PictureError>,
        reporter: Arc<dyn Reporter>,
    ) -> Result<Session, PictureError> {
        if options.exact.is_none() {
            let opened = OpenData::open(members, options.read, page_file)?;
            let (session, notes) = Session::of_opened(opened, members.to_vec())?;
            notes.into_iter().for_each(|note| reporter.tell(note));
            return Ok(Session { options, reporter, ..session });
        }
        let from = |shot: &'a Shot| shot.film.as_ref().and_then(|film| Some(&film.from.as_ref()?.look));
        let looks = shots.into_iter().flat_map(|shot| [Some(&shot.look), from(shot)]).flatten();
        let start = Instant::now();
        let (path, dataset) = source::particles(members, &Wanted::of(looks, options.family), &*reporter)?;
        let loading = Some(start.elapsed());
        let framed = source::framed(&dataset);
        let scene = Scene::new(InMemory::new(dataset), u64::MAX);
        let framed = Some((scene.families.clone(), framed));
        let data = Data::Source(path);
        let members = members.to_vec();
        Ok(Session {
            options,
            members,
            data,
            opened: None,
            moment: Moment::default(),
            moving: None,
            tracks: None,
            scene,
            framed,
            loading,
            ahead: None,
            adapter: None,
            hiding: None,
            paths: None,
            told_of_paths: None,
            reporter,
        })
    }

    /// Draws open datasets, of runs whatever moment is asked for; and what does not fit together, a sentence each.
    ///
    /// # Errors
    /// When a file cannot be read or shown with the others.
    pub fn of_opened(opened: OpenData, members: Vec<Member>) -> Result<(Session, Vec<String>), PictureError> {
        let (file, notes) = opened.at(Moment::default())?;
        // Nothing limits what a picture holds: it has to be converged.
        let session = Session::of(Arc::new(file), u64::MAX);
        Ok((Session { members, opened: Some(opened), ..session }, notes))
    }

    /// Draws an open page file; its pages may take `budget_bytes`.
    pub fn of(file: Arc<PageFile>, budget_bytes: u64) -> Session {
        Session {
            options: SessionOptions::default(),
            members: Vec::new(),
            scene: Scene::new(Arc::clone(&file), budget_bytes),
            data: Data::Pages(file),
            opened: None,
            moment: Moment::default(),
            moving: None,
            tracks: None,
            framed: None,
            loading: None,
            ahead: None,
            adapter: None,
            hiding: None,
            paths: None,
            told_of_paths: None,
            reporter: Arc::new(()),
        }
    }

    /// The same with somebody who is told.
    #[must_use]
    pub fn with_reporter(self, reporter: Arc<dyn Reporter>) -> Session {
        Session { reporter, ..self }
    }

    /// Draws these families of the datasets of the page file from now on.
    pub fn show_members(&mut self, members: Vec<Member>) {
        self.members = members;
    }

    /// The same with an adapter, which draws what it is asked for or is faster at.
    #[must_use]
    pub fn with_adapter(self, adapter: Option<Box<dyn Adapter>>) -> Session {
        Session { adapter, ..self }
    }

    /// The open tree.
    pub fn tree(&self) -> &Arc<dyn Tree> {
        self.scene.streamer.residency.tree()
    }

    /// Forgets pages where they take more than so many bytes.
    pub fn keep_within(&mut self, bytes: u64) {
        if self.scene.streamer.residency.statistics().bytes > bytes {
            let time = self.scene.time;
            self.scene = Scene { time, ..Scene::new(Arc::clone(self.tree()), u64::MAX) };
        }
    }

    /// What this view needs, the one of the picture after the next one, is read while the next one is drawn.
    pub fn look_ahead(&mut self, view: Option<View>) {
        self.ahead = view;
    }

    /// What is open, where it can be steps of runs.
    pub fn opened(&self) -> Option<&OpenData> {
        self.opened.as_ref()
    }

    /// The run whose clock is the data's.
    pub fn run(&self) -> Option<&Arc<RunFile>> {
        self.opened.as_ref().and_then(OpenData::run)
    }

    /// Opens what is shown at a moment, unless it is open: between the steps of a run its tracks, else the step at or before it. Data
    /// without times has but one.
    fn go_to(&mut self, look: &LookPatch) -> Result<(), PictureError> {
        let Some(opened) = &self.opened else { return Ok(()) };
        let Some(moment) = opened.moment(look.time)? else { return Ok(()) };
        let interpolation = look.interpolation.unwrap_or_default();
        let run = opened.run().filter(|run| {
            let moves = moment.u > 0.0 && interpolation != Interpolation::Hold || !run.has_stills();
            // Runs among other datasets are shown by their steps.
            moves && self.members.len() == 1 && run.tracks().is_ok()
        });
        let is_open = |moving: &ShownMoment| (self.moment, moving.interpolation) == (moment, interpolation);
        match run {
            Some(_) if self.moving.as_ref().is_some_and(is_open) => {}
            Some(run) => {
                let snapshot = run.at(moment, interpolation)?;
                let directory = run.directory();
                let units = (&directory.length_unit, &directory.mass_unit);
                let placement = self.members[0].placement(units, units);
                let is_open = |tree: &RunTree| tree.interpolation() == interpolation;
                let held = self.scene.streamer.residency.statistics().bytes;
                let is_kept = moment.step == self.moment.step || held <= KEPT_BYTES;
                match &self.tracks {
                    _ if !placement.is_here() => {
                        let options = LoadOptions { attributes: AttributeChoice::All, ..LoadOptions::default() };
                        let mut dataset = load_source(&snapshot, &options, &())?;
                        placement.place(&mut dataset);
                        self.scene = Scene::new(InMemory::new(dataset), u64::MAX);
                    }
                    Some(tree) if self.moving.is_some() && is_open(tree) && is_kept => {
                        self.scene.time = Some(tree.time(moment));
                    }
                    _ => {
                        let known = self.tracks.take().filter(|tree| is_open(tree));
                        let tree =
                            known.map_or_else(|| RunTree::new(Arc::clone(run), interpolation).map(Arc::new), Ok)?;
                        self.scene = Scene::new(Arc::clone(&tree), u64::MAX);
                        self.scene.time = Some(tree.time(moment));
                        self.tracks = Some(tree);
                    }
                }
                let faded_mass = snapshot.faded_mass();
                self.moving = Some(ShownMoment { interpolation, faded_mass, ..ShownMoment::of(run, moment) });
                self.data = Data::Moment(Box::new(snapshot));
                (self.framed, self.hiding) = (None, None);
            }
            None if moment.step != self.moment.step || self.moving.is_some() => {
                let file = Arc::new(opened.at(moment)?.0);
                self.scene = Scene::new(Arc::clone(&file), u64::MAX);
                self.data = Data::Pages(file);
                (self.framed, self.hiding, self.moving) = (None, None, None);
            }
            None => {}
        }
        self.moment = moment;
        Ok(())
    }

    /// The moment of the run that a picture of so many particles shows; `None` for data without times.
    fn shown_moment(&self, particles: u64) -> Option<ShownMoment> {
        let moving = self.moving.map(|moving| ShownMoment { tracks_drawn: particles, ..moving });
        moving.or_else(|| Some(ShownMoment::of(self.run()?, self.moment)))
    }

    /// The box that a picture of a look's families is framed by.
    ///
    /// # Errors
    /// When the data has none of them, or its step cannot be opened.
    pub fn framed(&mut self, look: &LookPatch) -> Result<Bounds, PictureError> {
        self.go_to(look)?;
        let families = self.families(look)?;
        match &self.framed {
            Some((known, framed)) if *known == families => Ok(*framed),
            _ => {
                let framed = first_frame(&**self.tree(), &families, self.scene.time.unwrap_or(0.0));
                self.framed = Some((families, framed));
                Ok(framed)
            }
        }
    }

    /// Draws a shot, converged.
    ///
    /// # Errors
    /// [`PictureError`] when the data cannot be read, a setting does not fit it, or nothing draws the mode.
    pub fn draw(&mut self, shot: &Shot) -> Result<Picture, PictureError> {
        let framed = self.framed(&shot.look)?;
        let (tree, depiction, transfer) = self.show(&shot.look)?;
        if let Some(mode) = shot.look.mode.filter(|mode| mode.is_light()) {
            self.check_light(&shot.look, mode)?;
        }
        let view = shot.view(framed, tree.metadata().periodic_box())?;
        let shown = Shown { shot, view, framed, depiction: &depiction, transfer: &transfer };
        let drawn = match shot.is_projected() {
            true => self.draw_projected(&*tree, &shown),
            false => self.draw_flat(&*tree, &shown),
        };
        // Settings come from the file that the user wrote, if there is one.
        drawn.map_err(|error| match error {
            PictureError::Volume(error) => PictureError::of(self.named(), error),
            error => error,
        })
    }

    /// A drawn picture in colours, with what the shot's film does to it.
    ///
    /// # Errors
    /// As [`Session::draw`] for the picture that it is blended with, and where a picture over it cannot be read.
    pub fn finished(&mut self, shot: &Shot, picture: &Picture) -> Result<Image, PictureError> {
        let Some(film) = &shot.film else { return picture.image(shot) };
        let before = film.from.as_deref().map(|from| self.before(shot, from)).transpose()?;
        picture.filmed(shot, film, before)
    }

    /// The picture that a film blends the one of `shot` with: another scene of the same data, as large, drawn by the same.
    fn before(&mut self, shot: &Shot, from: &SceneFile) -> Result<Image, PictureError> {
        let mut before = Shot::of_scene(from.clone(), Path::new(""));
        before.size = shot.size;
        before.look.background = shot.look.background;
        let own = from.datasets.first().and_then(|dataset| dataset.families.clone());
        before.look.families = own.or(before.look.families);
        before.film = None;
        let shown = self.members.first_mut().and_then(|first| first.families.take());
        let drawn = self.draw(&before);
        if let Some(first) = self.members.first_mut() {
            first.families = shown;
        }
        drawn?.image(&before)
    }

    /// A look's picture of a view as the processor draws it, of about `limit` particles at most, black where nothing is in view; its
    /// colours have the ranges `levels`, or their own. And how many particles it took.
    ///
    /// # Errors
    /// As [`Session::draw`].
    pub fn image(
        &mut self,
        look: &LookPatch,
        view: &View,
        levels: Option<Levels>,
        diameter: f64,
        limit: u64,
    ) -> Result<(Image, u64), PictureError> {
        let (tree, depiction, mut transfer) = self.show(look)?;
        if let Some(levels) = levels.filter(|_| depiction.mode.is_light()) {
            transfer = transfer.with_levels(&levels);
        }
        let selection = self.select(&depiction, view, look.error_px())?;
        let subject = Subject::new(tree.metadata(), &depiction, &transfer, diameter);
        let plan = subject.plan(view, &selection.nodes, &look.budget.file_budget(), None)?;
        let (plan, taken) = subject.within(limit, plan, view, &selection.nodes);
        let image = match subject.draw_nodes(view, &selection.nodes, &plan) {
            Ok(Raw::Sums(sums, _)) => composite_at(&sums, &transfer, &levels.unwrap_or_else(|| transfer.levels(&sums))),
            Ok(Raw::Light(painted)) => painted.colors.image(),
            Err(VolumeError::Grid(GridError::NothingInView)) => Image::black(view.width, view.height),
            Err(error) => return Err(error.into()),
        };
        Ok((image, taken))
    }

    /// What messages about settings name.
    fn named(&self) -> &Path {
        match self.options.named.as_os_str().is_empty() {
            true => self.path(),
            false => &self.options.named,
        }
    }

    fn check_light(&self, look: &LookPatch, mode: &Mode) -> Result<(), PictureError> {
        if self.options.overdraw.is_some() {
            return Err(PictureError::Asked(format!("--overdraw: the mode {} has no splats", mode.name)));
        }
        look.settings.check(mode).map_err(|error| PictureError::of(self.named(), error))
    }

    /// Draws a look's families and levels from now on. What it comes to on the data.
    pub(super) fn show(
        &mut self,
        look: &LookPatch,
    ) -> Result<(Arc<dyn Tree>, Depiction, TransferFunction), PictureError> {
        self.go_to(look)?;
        let tree = Arc::clone(self.tree());
        let depiction = depict(look, tree.metadata()).map_err(|why| PictureError::of(self.path(), why))?;
        self.scene.families = self.families(look)?;
        self.scene.purpose = depiction.purpose(tree.metadata());
        let transfer = transfer_of(look, &depiction);
        Ok((tree, depiction, transfer))
    }

    /// Selects what a view of a picture needs, and waits for it.
    pub(super) fn select(
        &mut self,
        depiction: &Depiction,
        view: &View,
        tau: f64,
    ) -> Result<SceneSelection, PictureError> {
        let detail = depiction.detail(view, tau, self.tree().metadata());
        let reporter = &*self.reporter;
        Ok(self.scene.converge(&depiction.selection_view(view), detail, &mut |why| reporter.tell(why))?)
    }

    /// What draws faces of panoramas on the processor.
    pub(super) fn means(&mut self) -> Means<'_> {
        Means { scene: &mut self.scene, adapter: None, reporter: &*self.reporter }
    }

    /// Indices of the families that a look draws.
    fn families(&self, look: &LookPatch) -> Result<Vec<u32>, PictureError> {
        let families = &self.tree().metadata().families;
        let (shown, missing): (Vec<bool>, _) = match (&self.data, self.options.family) {
            // Nothing else was loaded.
            (Data::Source(_), _) => (vec![true; families.len()], Vec::new()),
            (Data::Moment(_), None) => {
                let named = self.members.first().and_then(|member| member.families.as_ref()).or(look.families.as_ref());
                let is_shown = |name| named.is_none_or(|named| named.contains(name));
                let missing = named.into_iter().flatten();
                let missing = missing.filter(|name| families.iter().all(|family| family.name != **name));
                (families.iter().map(|family| is_shown(&family.name)).collect(), missing.copied().collect())
            }
            (_, Some(only)) => (families.iter().map(|family| family.name == only).collect(), vec![only]),
            (Data::Pages(file), None) => {
                let own = |member: &Member| Member {
                    families: member.families.clone().or_else(|| look.families.clone()),
                    ..member.clone()
                };
                match self.members.is_empty() {
                    true => shown_families(file, &[own(&Member::default())]),
                    false => shown_families(file, &self.members.iter().map(own).collect::<Vec<_>>()),
                }
            }
        };
        let found: Vec<u32> = (0..).zip(shown).filter_map(|(index, shown)| shown.then_some(index)).collect();
        match (found.is_empty(), missing.first()) {
            (false, _) => Ok(found),
            (true, Some(name)) => Err(PictureError::of(self.path(), format!("no particles of family {name}"))),
            (true, None) => Err(PictureError::of(self.path(), "the scene shows no family")),
        }
    }

    /// What a user calls the data.
    fn path(&self) -> &Path {
        self.members.first().map_or_else(|| self.tree().path(), |member| &member.path)
    }

    fn draw_projected(&mut self, tree: &dyn Tree, shown: &Shown<'_>) -> Result<Picture, PictureError> {
        let asked = |why: &str| Err(PictureError::Asked(why.to_owned()));
        if self.options.overdraw.is_some() {
            return asked("--overdraw: is for flat pictures");
        }
        let Shown { shot, view, depiction, .. } = *shown;
        let lod_budget = shot.look.budget.file_budget();
        if lod_budget.presence > 0.0 || lod_budget.thinning > 0.0 {
            self.reporter.tell("presence and thinning are for flat pictures; nothing is left out".into());
        }
        if shot.look.selections.as_ref().is_some_and(|sets| !sets.is_empty()) {
            self.reporter.tell("selections are shown in flat pictures only".into());
        }
        if depiction.mode.is_of_paths() {
            return asked("mode paths: is for flat pictures");
        }
        if shot.look.paths_of() != PathsOf::None {
            self.tell_of_paths("paths are drawn in flat pictures only");
        }
        let projector = Projector::new(view, shot.surround, shot.stereo)?;
        let passes = self.passes(depiction.mode)?;
        let passes = match (passes, projector.only_on_processor(depiction), self.options.backend) {
            (Some(_), Some(why), Some(_)) => return asked(&format!("--backend: only cpu draws {why}")),
            (Some(_), Some(_), None) => None,
            (passes, _, _) => passes,
        };
        let mut times = Times::default();
        let subject = self.subject(tree, shown);
        let (tau, is_asked) = (shot.look.error_px(), self.options.backend.is_some());
        let on_adapter = passes.zip(self.adapter.as_deref_mut());
        let mut means = Means { scene: &mut self.scene, adapter: on_adapter, reporter: &*self.reporter };
        let drawn = times.measure("frame", || projector.draw(&mut means, &subject, tau));
        let (values, tally) = match drawn {
            Err(PictureError::Volume(VolumeError::Device(error))) if is_asked => return asked(&error),
            Err(PictureError::Volume(VolumeError::Device(error))) => {
                self.reporter.tell(format!("{error}; drawing with the CPU instead"));
                let mut means = Means { scene: &mut self.scene, adapter: None, reporter: &*self.reporter };
                times.measure("frame", || projector.draw(&mut means, &subject, tau))?
            }
            drawn => drawn?,
        };
        let on_processor = tally.drawn_by.is_none();
        let (outside, splats) = match depiction.mode.is_light() {
            true => (None, None),
            // An adapter does not count what lies outside.
            false => (on_processor.then_some(tally.counts.outside), Some(tally.counts.drawn)),
        };
        let blank = self.blank(shown, projector.base)?;
        Ok(Picture {
            values,
            converged: tally.converged,
            error_px: tally.error_px,
            particles: tally.particles,
            moment: self.shown_moment(tally.particles),
            nodes: tally.nodes,
            left_out: LeftOut { outside, splats, ..LeftOut::new(&LodBudget::NONE, &Plan::default()) },
            milliseconds: times.medians(),
            drawn_by: tally.drawn_by.unwrap_or(blank.drawn_by),
            ..blank
        })
    }

    /// A picture of nothing, which says what it shows.
    fn blank(&self, shown: &Shown<'_>, view: View) -> Result<Picture, PictureError> {
        let Shown { shot, framed, depiction, transfer, .. } = *shown;
        let metadata = self.tree().metadata();
        let is_source = matches!(self.data, Data::Source(_));
        let time = self.run().map_or_else(String::new, |run| run.times().words(run.time(self.moment)));
        Ok(Picture {
            values: Raw::Sums(Default::default(), Default::default()),
            annotation: Annotation::new(shot, view, framed, time, metadata, depiction, &*self.reporter)?,
            transfer: transfer.clone(),
            converged: true,
            error_px: 0.0,
            particles: 0,
            nodes: 0,
            drawn_from: if is_source { "source" } else { self.scene.purpose.name() },
            left_out: LeftOut::default(),
            drawn_by: ["cpu", "cpu"].map(str::to_owned),
            milliseconds: Default::default(),
            moment: self.shown_moment(0),
            paths: None,
        })
    }

    /// Tells something about paths that are left out or drawn otherwise, once.
    fn tell_of_paths(&mut self, what: &'static str) {
        if self.told_of_paths != Some(what) {
            self.told_of_paths = Some(what);
            self.reporter.tell(what.into());
        }
    }

    /// Whether paths are drawn in a flat picture; says why not where they are wanted all the same.
    fn has_paths(&mut self, look: &LookPatch) -> bool {
        if look.paths_of() == PathsOf::None {
            return false;
        }
        let why_not = match self.run() {
            None => "the data is no run: paths are left out",
            Some(run) if run.tracks().is_err() => "the run has no tracks: paths are left out",
            Some(_) if !matches!(&self.members[..], [only] if only.offset == DVec3::ZERO && only.scale.is_none()) => {
                "paths are drawn of one run alone, where it lies: they are left out"
            }
            Some(_) => return true,
        };
        self.tell_of_paths(why_not);
        false
    }

    /// Reads and projects the paths of a picture; how many they are.
    fn gather_paths(&mut self, shown: &Shown<'_>) -> Result<PathCounts, PictureError> {
        let Shown { shot, view, depiction, transfer, .. } = *shown;
        let Some(run) = self.run().cloned() else { return Ok(PathCounts::default()) };
        let mut layer = match self.paths.take() {
            Some(layer) if Arc::ptr_eq(layer.run(), &run) => layer,
            _ => PathLayer::new(run, paths::KEPT_BYTES)?,
        };
        let tree = self.tree();
        let shown = self.scene.families.iter().filter_map(|index| tree.metadata().families.get(*index as usize));
        let families: Vec<FamilyName> = shown.map(|family| family.name).collect();
        let request = PathRequest {
            view: &view,
            settings: &shot.look.paths.clone().unwrap_or_default(),
            of: &shot.look.paths_of(),
            selections: shot.look.selections.as_deref().unwrap_or_default(),
            moment: self.moment,
            interpolation: shot.look.interpolation.unwrap_or_default(),
            families: &families,
            depiction,
            transfer,
        };
        let counts = layer.gather(&request);
        self.paths = Some(layer);
        counts
    }

    /// Draws paths alone.
    fn draw_paths_alone(&mut self, shown: &Shown<'_>) -> Result<Picture, PictureError> {
        let mut times = Times::default();
        if !self.has_paths(&shown.shot.look) {
            let why = self.told_of_paths.unwrap_or("nobody's paths are asked for");
            return Err(PictureError::of(self.path(), format!("mode paths: {why}")));
        }
        let blank = self.blank(shown, shown.view)?;
        let (mut values, mut counts) = (blank.values, PathCounts::default());
        // Everything is read before times are measured.
        let start = Instant::now();
        self.gather_paths(shown)?;
        times.note("load", start.elapsed() + self.loading.take().unwrap_or_default());
        for _ in 0..self.options.repeat.max(1) {
            (values, counts) = times.frame(|times| {
                let counts = times.measure("project", || self.gather_paths(shown))?;
                let colors = times.measure("draw", || self.paths.as_ref().map(PathLayer::colors));
                Ok::<_, PictureError>((modes::paths::picture(shown.view.width, shown.view.height, colors), counts))
            })?;
        }
        let moment = blank.moment.map(|moment| moment.with_paths(counts));
        Ok(Picture { values, moment, milliseconds: times.medians(), ..blank })
    }

    fn subject<'a>(&self, tree: &'a dyn Tree, shown: &Shown<'a>) -> Subject<'a> {
        let method = self.options.exact.filter(|_| !shown.depiction.mode.is_light()).unwrap_or_default();
        let diameter = shown.framed.size().length();
        Subject { method, ..Subject::new(tree.metadata(), shown.depiction, shown.transfer, diameter) }
    }

    /// The passes of an adapter that draw a mode.
    fn passes(&mut self, mode: &Mode) -> Result<Option<Passes>, PictureError> {
        let backend = match self.options.exact {
            Some(Method::Exact) => Some(Backend::Cpu),
            _ => self.options.backend,
        };
        adapter::passes(mode, backend, self.adapter.as_deref_mut()).map_err(PictureError::Asked)
    }

    /// Draws a picture. Where it is certain that what is hidden changes nothing, what the picture before hides (or a sketch, if there was
    /// none) is neither read nor drawn, as long as the picture itself hides it too.
    fn draw_flat(&mut self, tree: &dyn Tree, shown: &Shown<'_>) -> Result<Picture, PictureError> {
        let Shown { view, depiction, transfer, .. } = *shown;
        if depiction.mode.is_of_paths() {
            return self.draw_paths_alone(shown);
        }
        let start = Instant::now();
        let is_sure = matches!(self.data, Data::Pages(_)) && hiding::is_sure(depiction, transfer);
        let mut known = match self.hiding.take() {
            _ if !is_sure => None,
            Some(hiding) if hiding.is_of(depiction) => Some(hiding),
            // The processor decodes nothing for an adapter's picture.
            _ if self.flat_passes(shown)?.is_some() => None,
            _ => self.sketch(tree, shown)?,
        };
        let mut attempts = 0..hiding::ATTEMPTS;
        loop {
            // The last one hides nothing.
            known = known.filter(|_| attempts.next().is_some());
            let mut times = Times::default();
            if is_sure {
                times.note("hide", start.elapsed());
            }
            self.scene.streamer.occluder = known.as_ref().and_then(|known| known.opaque.occluder(&view));
            let drawn = self.draw_selected(tree, shown, &mut times, known.as_ref());
            self.scene.streamer.occluder = None;
            let (picture, hidden) = drawn?;
            known = Hiding::of(depiction, &picture.values).filter(|_| is_sure);
            if hidden.is_empty() || known.as_ref().is_some_and(|known| known.shows(&hidden, &picture.values, depiction))
            {
                self.hiding = known;
                return Ok(Picture { milliseconds: times.medians(), ..picture });
            }
        }
    }

    /// What a small picture hides.
    fn sketch(&mut self, tree: &dyn Tree, shown: &Shown<'_>) -> Result<Option<Hiding>, PictureError> {
        let Shown { shot, view, depiction, .. } = *shown;
        let small = hiding::sketch_view(&view);
        let selection = self.select(depiction, &small, shot.look.error_px())?;
        let drawn = self.subject(tree, shown).draw_nodes(&small, &selection.nodes, &Plan::default());
        // What is wrong with the picture, it says itself.
        Ok(drawn.ok().and_then(|values| Hiding::of(depiction, &values)))
    }

    /// Selects and draws with what hides nodes; and what was hidden.
    fn draw_selected(
        &mut self,
        tree: &dyn Tree,
        shown: &Shown<'_>,
        times: &mut Times,
        known: Option<&Hiding>,
    ) -> Result<(Picture, Vec<Hidden<NodeRef>>), PictureError> {
        let Shown { shot, view, depiction, .. } = *shown;
        let (metadata, mode) = (tree.metadata(), depiction.mode);
        let is_sum = mode.technique.output() == Output::Sums;
        let has_paths = self.has_paths(&shot.look);
        let takes_paths = mode.technique.takes_paths();
        let passes = self.flat_passes(shown)?;
        let subject = self.subject(tree, shown);
        let tau = shot.look.error_px();
        let (seen, detail) = (depiction.selection_view(&view), depiction.detail(&view, tau, metadata));
        let start = Instant::now();
        let selection = self.select(depiction, &view, tau)?;
        times.note("load", start.elapsed() + self.loading.take().unwrap_or_default());
        if let Some(ahead) = self.ahead.take() {
            let from_there = known.and_then(|known| known.opaque.occluder(&ahead));
            let from_here = std::mem::replace(&mut self.scene.streamer.occluder, from_there);
            self.scene.select(&ahead, detail);
            self.scene.streamer.serve();
            self.scene.streamer.occluder = from_here;
        }
        // What is asked for at full precision is drawn as a whole.
        let lod_budget = if self.options.exact.is_some() { LodBudget::NONE } else { shot.look.budget.file_budget() };
        let plan = match is_sum && self.options.exact.is_none() {
            true => times.measure("plan", || subject.plan(&view, &selection.nodes, &lod_budget, None))?,
            false => Plan::default(),
        };
        let mut left_out = LeftOut::new(&lod_budget, &plan);
        let repeat = self.options.repeat.max(1);
        let nodes = &selection.nodes;
        let job = passes.map(|passes| AdapterJob {
            view: &view,
            depiction,
            metadata,
            nodes,
            plan: &plan,
            passes,
            light: None,
            repeat,
        });
        if let Some(path) = self.options.overdraw.clone() {
            let overdraw = self.overdraw(&subject, &view, nodes, &plan, job.as_ref())?;
            output::write_png(&path, &overdraw.image())?;
            left_out.overdraw = Some((overdraw.mean(), overdraw.max()));
        }
        let blank = self.blank(shown, view)?;
        let picture = Picture {
            annotation: self.marked(blank.annotation, &shot.look, &selection)?,
            converged: selection.converged,
            error_px: selection.error_pixels,
            particles: selection.particles,
            moment: self.shown_moment(selection.particles),
            nodes: selection.nodes.len(),
            ..blank
        };
        if let Some((job, adapter)) = job.zip(self.adapter.as_mut()) {
            match draw_on(&mut **adapter, &subject, job) {
                Ok((values, frame)) => {
                    times.extend(frame.milliseconds);
                    let left_out = LeftOut { splats: frame.splats, ..left_out };
                    let drawn_by = [frame.backend.to_owned(), frame.adapter];
                    let picture = Picture { values, left_out, drawn_by, ..picture };
                    let picture = if has_paths { self.with_paths(picture, shown, times)? } else { picture };
                    return Ok((picture, selection.hidden));
                }
                Err(VolumeError::Device(error)) if self.options.backend.is_some() => {
                    return Err(PictureError::Asked(error));
                }
                Err(VolumeError::Device(error)) => {
                    self.reporter.tell(format!("{error}; drawing with the CPU instead"));
                }
                Err(error) => return Err(error.into()),
            }
        }
        let mut values = picture.values;
        let (mut counts, mut on_top) = (None, None);
        if has_paths {
            // Everything is read before times are measured.
            self.gather_paths(shown)?;
        }
        for _ in 0..repeat {
            values = times.frame(|times| {
                let mut among: Option<PathFragments> = None;
                if has_paths {
                    counts = Some(times.measure("paths", || self.gather_paths(shown))?);
                    times.measure("paths", || match takes_paths {
                        true => among = self.paths.as_ref().map(PathLayer::fragments),
                        false => on_top = self.paths.as_ref().map(|layer| Arc::new(layer.colors())),
                    });
                }
                let selection = times.measure("select", || self.scene.select(&seen, detail));
                let nodes = times.measure("decode", || subject.decode(&view, &selection.nodes, &plan));
                let drawn = || subject.draw_with_paths(&view, &nodes, &plan, among.as_ref());
                let drawn = times.measure("draw", drawn)?;
                let kept: u64 = nodes.iter().map(|node| node.len() as u64).sum();
                left_out.thinned = Some(selection.particles - kept);
                Ok::<_, PictureError>(drawn)
            })?;
            match &values {
                Raw::Sums(_, counts) => {
                    (left_out.faint, left_out.outside) = (Some(counts.faint), Some(counts.outside));
                    left_out.splats = Some(counts.drawn);
                }
                Raw::Light(painted) => {
                    times.note("resample", painted.report.resampling);
                    times.note("render", painted.report.rendering);
                }
            }
        }
        let moment = picture.moment.map(|moment| counts.map_or(moment, |counts| moment.with_paths(counts)));
        Ok((Picture { values, left_out, moment, paths: on_top, ..picture }, selection.hidden))
    }

    /// A picture that an adapter has drawn, with paths on top.
    fn with_paths(&mut self, picture: Picture, shown: &Shown<'_>, times: &mut Times) -> Result<Picture, PictureError> {
        let counts = times.measure("paths", || self.gather_paths(shown))?;
        let paths = times.measure("paths", || self.paths.as_ref().map(|layer| Arc::new(layer.colors())));
        let moment = picture.moment.map(|moment| moment.with_paths(counts));
        Ok(Picture { moment, paths, ..picture })
    }

    /// The passes of an adapter that draw a flat picture: none where paths lie among what it shows.
    fn flat_passes(&mut self, shown: &Shown<'_>) -> Result<Option<Passes>, PictureError> {
        let mode = shown.depiction.mode;
        let passes = self.passes(mode)?;
        if passes.is_some() && mode.technique.takes_paths() && self.has_paths(&shown.shot.look) {
            self.tell_of_paths("volumes with paths are drawn by the processor");
            return Ok(None);
        }
        Ok(passes)
    }

    /// How many of a picture's splats lie over each pixel, counted by what draws it.
    fn overdraw(
        &mut self,
        subject: &Subject<'_>,
        view: &View,
        nodes: &[SceneNode],
        plan: &Plan,
        job: Option<&AdapterJob<'_>>,
    ) -> Result<Overdraw, PictureError> {
        if let Some((job, adapter)) = job.zip(self.adapter.as_mut()) {
            match adapter.overdraw(job) {
                Err(VolumeError::Device(error)) => {
                    // An adapter that draws may still be one that does not count.
                    self.reporter.tell(format!("{error}; counting the overdraw with the CPU instead"));
                }
                counted => return Ok(counted?),
            }
        }
        Ok(subject.overdraw(view, &subject.decode(view, nodes, plan), plan)?)
    }

    /// An annotation with a look's selections.
    fn marked(
        &self,
        annotation: Annotation,
        look: &LookPatch,
        selection: &SceneSelection,
    ) -> Result<Annotation, PictureError> {
        let selections = look.selections.as_deref().unwrap_or_default();
        let families = &self.tree().metadata().families;
        let names: Vec<FamilyName> =
            self.scene.families.iter().filter_map(|index| Some(families.get(*index as usize)?.name)).collect();
        let following = self.opened.as_ref().and_then(OpenData::following);
        let interpolation = look.interpolation.unwrap_or_default();
        let places = following.map(|following| {
            move |members: &Members| {
                let progress = self.reporter.progress();
                let found = following.of(members, Work::told(&*progress))?;
                let places = found.map(|found| found.places(self.moment, interpolation)).transpose()?;
                Ok(Places::new(places.unwrap_or_default()))
            }
        });
        let run = places.as_ref().map(|places| places as FollowedPlaces<'_>);
        Ok(match &self.data {
            Data::Pages(file) => {
                annotation.with_selections(selections, file, &selection.nodes, run, &names, &*self.reporter)?
            }
            _ if selections.iter().all(|set| set.show == Show::Hidden) => annotation,
            Data::Source(_) | Data::Moment(_) => {
                if !matches!(&self.members[..], [only] if only.is_in_place()) {
                    let why = "a picture of particles of several or moved datasets leaves the selections out";
                    self.reporter.tell(why.into());
                    return Ok(annotation);
                }
                let opened;
                let source: &dyn Source = match &self.data {
                    Data::Source(path) => {
                        opened = open(path)?;
                        opened.as_ref()
                    }
                    Data::Moment(snapshot) => &**snapshot,
                    Data::Pages(_) => return Ok(annotation),
                };
                annotation.with_source_selections(selections, source, run, &names, &*self.reporter)?
            }
        })
    }
}

/// A shot on the open data.
#[derive(Clone, Copy)]
struct Shown<'a> {
    shot: &'a Shot,
    view: View,
    framed: Bounds,
    depiction: &'a Depiction,
    transfer: &'a TransferFunction,
}
