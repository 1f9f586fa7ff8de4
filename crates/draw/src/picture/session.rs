//! Open data, of which pictures are drawn: what one picture has read is there for the next.

mod blend;
mod clusters;
mod flat;
mod gaussian_splats;
mod moments;
mod passes;
mod paths;
mod projection;
mod reporter;
mod seen;
mod selected;
mod slabs;

pub use reporter::Reporter;

use super::account::{Account, Task};
use super::adapter::{self, Adapter, Passes};
use super::annotation::Annotation;
use super::drawn::{Picture, ShownMoment};
use super::error::PictureError;
use super::ground::{Ground, Solid};
use super::hiding::Hiding;
use super::left_out::LeftOut;
use super::level_report::LevelReport;
use super::look::{depict, transfer_of};
use super::paths::PathLayer;
use super::projected::Means;
use super::source::{self, Wanted};
use super::subject::{self, Subject};
use crate::annotate::Units;
use crate::color::Image;
use crate::color::transfer::TransferFunction;
use crate::cpu::Method;
use crate::look::{Backend, LookPatch, Member, OpenData, SceneFile, Shot};
use crate::mode::{Depiction, Mode, Raw};
use crate::model::{Bounds, FamilyName, Moment, ReadMethod};
use crate::modes;
use crate::store::run::{RunSnapshot, RunTree};
use crate::store::{InMemory, PageFile, RunFile, Tree};
use crate::stream::{ResidencyStatistics, Scene, SceneSelection, first_frame};
use crate::view::View;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How data is opened and drawn, whatever the picture.
#[derive(Clone, Default)]
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
    /// Bytes that the samples of an image or a volume may take; more are thinned.
    pub memory: Option<u64>,
    /// Bytes that pages of particles may take, with what is drawn of them at a time: sums whose pages do not fit are drawn in passes, flat pictures of
    /// volumes in slabs, and all else is drawn coarser then, by these bytes alone. `None`: whatever a picture needs is held at once.
    pub page_memory: Option<u64>,
    /// Bytes that decoded chunks of heights may take; what needs more is drawn coarser, by these bytes alone. `None`: 1 GiB.
    pub chunk_memory: Option<u64>,
    /// Whether the raw channels of heights are wanted, too.
    pub raw: bool,
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
    /// What pages of what is open may take.
    budget_bytes: u64,
    /// The shares of the memory that is kept to: sums whose pages take more than theirs are drawn in passes then, and volumes in slabs. Without
    /// any they are drawn coarser, as all else is.
    account: Option<Account>,
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
    /// What was told of that is left out or drawn otherwise.
    told_once: Vec<&'static str>,
    /// Whether it was told that not all that is drawn has the attribute.
    has_told_of_attribute: bool,
    /// Whether it was told that the file has not got what was asked of its levels.
    has_told_of_levels: bool,
    /// What the picture that was drawn last had no memory for, and whether that was told of any.
    shortage: Shortage,
    has_told_of_memory: bool,
    /// The most that a picture was told to take whatever the memory, MiB.
    told_mebibytes: u64,
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
            // Each picture has shares of its own.
            let account = options.page_memory.map(|memory| Account::of(memory, Task::default()));
            let budget_bytes = account.map_or(u64::MAX, |account| account.pages);
            let (session, notes) = Session::of_opened_within(opened, members.to_vec(), budget_bytes)?;
            notes.into_iter().for_each(|note| reporter.tell(note));
            return Ok(Session { account, options, reporter, ..session });
        }
        let from = |shot: &'a Shot| shot.film.as_ref().and_then(|film| Some(&film.from.as_ref()?.look));
        let looks = shots.into_iter().flat_map(|shot| [Some(&shot.look), from(shot)]).flatten();
        let start = Instant::now();
        let (path, dataset) = source::particles(members, &Wanted::of(looks, options.family), &*reporter)?;
        let loading = Some(start.elapsed());
        let framed = source::framed(&dataset);
        let scene = Scene::new(InMemory::new(dataset), u64::MAX);
        let framed = Some((scene.families.clone(), framed));
        let members = members.to_vec();
        let session = Session::new(Data::Source(path), scene, u64::MAX);
        Ok(Session { options, members, framed, loading, reporter, ..session })
    }

    /// Draws open datasets, of runs whatever moment is asked for; and what does not fit together, a sentence each.
    ///
    /// # Errors
    /// When a file cannot be read or shown with the others.
    pub fn of_opened(opened: OpenData, members: Vec<Member>) -> Result<(Session, Vec<String>), PictureError> {
        // Nothing limits what a picture holds: it has to be converged.
        Session::of_opened_within(opened, members, u64::MAX)
    }

    /// The same for pages that may take `budget_bytes`.
    ///
    /// # Errors
    /// As [`Session::of_opened`].
    pub fn of_opened_within(
        opened: OpenData,
        members: Vec<Member>,
        budget_bytes: u64,
    ) -> Result<(Session, Vec<String>), PictureError> {
        let (file, notes) = opened.at(Moment::default())?;
        let session = Session::of(Arc::new(file), budget_bytes);
        Ok((Session { members, opened: Some(opened), ..session }, notes))
    }

    /// Draws an open page file; its pages may take `budget_bytes`, and what needs more is drawn coarser.
    pub fn of(file: Arc<PageFile>, budget_bytes: u64) -> Session {
        let scene = Scene::new(Arc::clone(&file), budget_bytes);
        Session::new(Data::Pages(file), scene, budget_bytes)
    }

    fn new(data: Data, scene: Scene, budget_bytes: u64) -> Session {
        Session {
            options: SessionOptions::default(),
            members: Vec::new(),
            scene,
            budget_bytes,
            account: None,
            data,
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
            told_once: Vec::new(),
            has_told_of_attribute: false,
            has_told_of_levels: false,
            shortage: Shortage::default(),
            has_told_of_memory: false,
            told_mebibytes: 0,
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

    /// Which pages are in memory, and how much they take.
    pub fn residency(&self) -> ResidencyStatistics {
        self.scene.streamer.residency.statistics()
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
        self.draw_among(shot, None)
    }

    /// The same among measured surfaces.
    ///
    /// # Errors
    /// As [`Session::draw`], and for modes and adapters that draw nothing among surfaces.
    pub fn draw_among(&mut self, shot: &Shot, ground: Option<&dyn Ground>) -> Result<Picture, PictureError> {
        // What was found of earlier views is not about this picture.
        self.note_memory(true);
        self.shortage = Shortage::default();
        let framed = self.framed(&shot.look)?;
        let (tree, depiction, transfer) = self.show(&shot.look)?;
        if ground.is_some() {
            self.check_among(&depiction)?;
        }
        if let Some(mode) = shot.look.mode.filter(|mode| mode.is_light()) {
            self.check_light(&shot.look, mode)?;
        }
        self.check_levels(&depiction, tree.metadata())?;
        self.check_blend(&depiction, shot)?;
        let has_paths_in_it = depiction.mode.technique.takes_paths() && self.has_paths(&shot.look);
        let (drawn_as, as_a_whole) = (depiction.blended(), shot.is_projected() || has_paths_in_it);
        let task = Task::of(&drawn_as, shot.size(), as_a_whole);
        let may_be_on_adapter = self.account.is_some() && ground.is_none() && !as_a_whole;
        let on_adapter = may_be_on_adapter && self.is_on_adapter(&drawn_as);
        self.share_memory(if on_adapter { task.on_adapter() } else { task });
        let depiction = self.within_slabs(depiction);
        let view = shot.view(framed, tree.metadata().periodic_box())?;
        let shown = Shown { shot, view, framed, depiction: &depiction, transfer: &transfer, ground };
        let mut drawn = match shot.is_projected() {
            true => self.draw_projected(&*tree, &shown),
            false => self.draw_flat(&*tree, &shown),
        };
        if let (Ok(picture), Some(ground)) = (&mut drawn, ground.filter(|ground| ground.is_filter()))
            && matches!(picture.values, Raw::Sums(..))
        {
            let solid = Solid(ground);
            let shown = Shown { ground: Some(&solid), ..shown };
            let whole = match shot.is_projected() {
                true => self.draw_projected(&*tree, &shown)?,
                false => self.draw_flat(&*tree, &shown)?,
            };
            if let Raw::Sums(whole, _) = whole.values {
                picture.unfiltered = Some(Arc::new(whole));
            }
        }
        self.tell_of_memory();
        if let Ok(picture) = &mut drawn {
            picture.is_coarser = self.shortage.is_coarser && picture.converged;
            picture.converged &= !self.shortage.is_coarser;
            self.tell_of_levels(picture, &depiction, tree.metadata());
        }
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

    /// What messages about settings name.
    fn named(&self) -> &Path {
        match self.options.named.as_os_str().is_empty() {
            true => self.path(),
            false => &self.options.named,
        }
    }

    /// Refuses what is not drawn among surfaces.
    fn check_among(&self, depiction: &Depiction) -> Result<(), PictureError> {
        let asked = |why: String| Err(PictureError::Asked(why));
        match self.options.backend {
            _ if self.options.overdraw.is_some() => asked("--overdraw: is for pictures of particles alone".into()),
            _ if !depiction.blended().mode.technique.meets_surfaces() => {
                let modes =
                    modes::all().into_iter().filter(|mode| mode.takes_particles() && mode.technique.meets_surfaces());
                let modes: Vec<&str> = modes.map(|mode| mode.name).collect();
                let (found, expected) = (depiction.mode.name, modes.join(", "));
                asked(format!(
                    "mode: found {found}, which draws no particles among other data, expected one of {expected}"
                ))
            }
            Some(Backend::Compute | Backend::Raster) => {
                asked("--backend: expected cpu, which alone draws particles among other data".into())
            }
            _ => Ok(()),
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
        if let (Some(_), Some(coloring)) = (look.attribute_name(), &depiction.attribute) {
            self.tell_of_mean_colors(coloring, tree.metadata());
        }
        let transfer = transfer_of(look, &depiction);
        Ok((tree, depiction, transfer))
    }

    /// Refuses a look that names what the data does not have, before it is drawn. What a run has depends on the step, and is not looked at.
    ///
    /// # Errors
    /// The names that there are.
    pub(super) fn check(&self, look: &LookPatch) -> Result<(), PictureError> {
        if self.run().is_some() {
            return Ok(());
        }
        depict(look, self.tree().metadata()).map(|_| ()).map_err(|why| PictureError::of(self.path(), why))
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
        let selection = self.scene.converge(&depiction.selection_view(view), detail, &mut |why| reporter.tell(why))?;
        self.note_memory(selection.converged);
        Ok(selection)
    }

    /// Asks whether anybody still waits for the picture.
    fn go_on(&self) -> Result<(), PictureError> {
        if self.reporter.is_stopped() { Err(PictureError::Stopped) } else { Ok(()) }
    }

    /// What draws faces of panoramas on the processor.
    pub(super) fn means(&mut self) -> Means<'_> {
        let lists = self.lists();
        Means { scene: &mut self.scene, lists, adapter: None, reporter: &*self.reporter, paths: None, ground: None }
    }

    /// What a user calls the data.
    fn path(&self) -> &Path {
        self.members.first().map_or_else(|| self.tree().path(), |member| &member.path)
    }

    /// A picture of nothing, which says what it shows.
    fn blank(&self, shown: &Shown<'_>, view: View) -> Result<Picture, PictureError> {
        let Shown { shot, framed, depiction, transfer, .. } = *shown;
        let metadata = self.tree().metadata();
        let time = self.run().map(|run| (run.time(self.moment), run.times().words(run.time(self.moment))));
        Ok(Picture {
            values: Raw::Sums(Default::default(), Default::default()),
            annotation: {
                let units = Units::of(metadata, depiction);
                let own = metadata.provenance.time;
                Annotation::new(shot, view, framed, time, units, own, depiction, &*self.reporter)?
            },
            transfer: transfer.clone(),
            converged: true,
            is_coarser: false,
            error_px: 0.0,
            particles: 0,
            nodes: 0,
            drawn_from: self.drawn_from(),
            left_out: LeftOut::default(),
            level_report: LevelReport::default(),
            drawn_by: ["cpu", "cpu"].map(str::to_owned),
            milliseconds: Default::default(),
            moment: self.shown_moment(0),
            paths: None,
            ground: None,
            unfiltered: None,
            told: None,
            points: None,
            surface: None,
        })
    }

    /// What pictures are drawn from, by name.
    fn drawn_from(&self) -> &'static str {
        if matches!(self.data, Data::Source(_)) { "source" } else { self.scene.purpose.name() }
    }

    fn subject<'a>(&self, tree: &'a dyn Tree, shown: &Shown<'a>) -> Subject<'a> {
        let method = self.options.exact.filter(|_| !shown.depiction.mode.is_light()).unwrap_or_default();
        let diameter = shown.framed.size().length();
        let mean_mass = self.mean_mass(tree);
        Subject { method, mean_mass, ..Subject::new(tree.metadata(), shown.depiction, shown.transfer, diameter) }
    }

    /// Mean mass of a source particle of the families that are drawn.
    fn mean_mass(&self, tree: &dyn Tree) -> f64 {
        let families = &tree.metadata().families;
        subject::mean_mass(self.scene.families.iter().filter_map(|index| families.get(*index as usize)))
    }

    /// The passes of an adapter that draw a depiction.
    fn passes(&mut self, depiction: &Depiction) -> Result<Option<Passes>, PictureError> {
        let backend = match self.options.exact {
            Some(Method::Exact) => Some(Backend::Cpu),
            _ => self.options.backend,
        };
        adapter::passes(depiction, backend, self.adapter.as_deref_mut()).map_err(PictureError::Asked)
    }
}

/// What a picture has no memory for.
#[derive(Clone, Copy, Default)]
struct Shortage {
    /// It is in less detail than was asked for.
    is_coarser: bool,
    /// Some of what it needs in that detail is missing.
    is_missing: bool,
}

/// A shot on the open data.
#[derive(Clone, Copy)]
struct Shown<'a> {
    shot: &'a Shot,
    view: View,
    framed: Bounds,
    depiction: &'a Depiction,
    transfer: &'a TransferFunction,
    /// What it is drawn among.
    ground: Option<&'a dyn Ground>,
}
