//! What is open, and how the user wants to see it.

use super::camera::{Lens, Viewpoint};
use super::facts::Facts;
use super::picture::Picture;
use super::preset::Preset;
use super::sampled::Sampled;
use crate::annotate::Units;
use crate::explore::Following;
use crate::explore::data::source_path;
use crate::hierarchy::spacetime::Interpolation;
use crate::look::{Attribute, Look, LookPatch, Member, OpenData};
use crate::mode::lod_budget::{PRESENCE, THINNING};
use crate::mode::{Depiction, Mode, Output, SettingValue, over};
use crate::model::{Bounds, Moment, PeriodicBox, StepTimes, When};
use crate::modes;
use crate::picture::look::depict;
use crate::picture::surface::{FieldInScene, OpenSurface};
use crate::picture::{AnySession, PictureError, Session};
use crate::store::run::RunTree;
use crate::store::{Metadata, PageFile, Tree};
use crate::view::{Stereo, Surround};
use bevy::prelude::*;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use tempfile::TempDir;

/// The open dataset.
#[derive(Resource)]
pub struct Scene {
    /// What the user named.
    pub path: PathBuf,
    /// The datasets: that, and those shown with it.
    pub members: Vec<Member>,
    /// Its page file, or theirs as one.
    pub file: Arc<PageFile>,
    /// The image, the volume or the heights, where these are open alone: the particles of the page file are some of its samples.
    pub field: Option<SceneField>,
    /// The box around all families, world units.
    pub bounds: Bounds,
    /// The box that the first picture shows: without far outliers.
    pub frame: Bounds,
    /// The periodic box that the particles fill, where they do.
    pub periodic: Option<PeriodicBox>,
    /// Unit of positions.
    pub length_unit: String,
    /// What the panel says about it.
    pub facts: Facts,
    /// What is drawn in its place while a run is between its steps.
    pub moving: Option<MovingRun>,
    /// When the steps of the run are, where it is one.
    pub times: Option<StepTimes>,
    /// What follows selections in the run, where it has tracks and is open alone.
    pub following: Option<Arc<Following>>,
    /// The run among the datasets.
    pub opened: Option<OpenData>,
    /// The time of the run that is shown.
    pub time: Option<f64>,
    /// Counts up with every file that is opened.
    pub dataset: u32,
    /// Counts up with every file that takes the place of another, and not with more of what is open.
    pub subject: u32,
    /// Counts up with every page file that is shown, of a run with every step; what belongs to another generation is stale.
    pub generation: u32,
}

/// What is open in place of particles, and what draws the window's own pictures of it.
#[derive(Clone)]
pub struct SceneField {
    /// Its samples.
    pub opened: Sampled,
    /// What draws it.
    pub session: Arc<Mutex<AnySession>>,
    /// Where the page file of a few of its samples lies, as long as anybody may read it.
    pub sketch: Option<Arc<TempDir>>,
}

impl SceneField {
    /// Of what is open.
    pub fn new(opened: Sampled) -> SceneField {
        let session = opened.drawer(Arc::new(()));
        SceneField { opened, session: Arc::new(Mutex::new(session)), sketch: None }
    }
}

/// The tracks of a run, at a moment.
#[derive(Clone, Debug)]
pub struct MovingRun {
    /// The tracks.
    pub tree: Arc<RunTree>,
    /// When, by the tree's clock.
    pub time: f64,
    /// When it will be in the intervals that come in a moment, while it plays.
    pub next: Vec<f64>,
}

#[cfg(test)]
impl Scene {
    /// A page file alone.
    pub fn of_file(file: Arc<PageFile>, members: Vec<Member>) -> Scene {
        let bounds = file.metadata().bounds();
        Scene {
            path: file.path().to_owned(),
            members,
            facts: Facts::of(&file, &[]),
            file,
            field: None,
            bounds,
            frame: bounds,
            periodic: None,
            length_unit: String::new(),
            moving: None,
            times: None,
            following: None,
            opened: None,
            time: None,
            dataset: 1,
            subject: 1,
            generation: 1,
        }
    }
}

impl Scene {
    /// Opens the data for pictures beside the window's own, which read within so many bytes of memory; on whatever thread that is to happen.
    pub fn opener(&self, budget_bytes: u64) -> impl FnOnce() -> Result<Session, PictureError> + Send + use<> {
        let (opened, file, members) = (self.opened.clone(), Arc::clone(&self.file), self.members.clone());
        move || match opened {
            // Of a run whatever moment is asked for.
            Some(opened) => Ok(Session::of_opened_within(opened, members, budget_bytes)?.0),
            None => Ok(Session::of(file, budget_bytes)),
        }
    }

    /// The same of the kind that a mode draws.
    pub fn opener_for(
        &self,
        mode: &Mode,
        budget_bytes: u64,
    ) -> impl FnOnce() -> Result<AnySession, PictureError> + Send + use<> {
        let field = self.field_for(mode).map(|field| field.opened.drawer(Arc::new(())));
        let open = self.opener(budget_bytes);
        move || match field {
            Some(field) => Ok(field),
            None => Ok(AnySession::Particles(Box::new(open()?))),
        }
    }

    /// The image, the volume or the heights, where they are open and a mode draws them.
    pub fn field_for(&self, mode: &Mode) -> Option<&SceneField> {
        self.field.as_ref().filter(|field| field.opened.is_drawn_by(mode))
    }

    /// The same where a mode's pictures are about them, not about particles among them.
    pub fn samples_for(&self, mode: &Mode) -> Option<&SceneField> {
        self.field_for(mode).filter(|field| field.opened.is_told_by(mode))
    }

    /// The first of the heights, where they are open and a mode's pictures are about them.
    pub fn surface_for(&self, mode: &Mode) -> Option<Arc<OpenSurface>> {
        self.samples_for(mode)?.opened.heights_of(mode)
    }

    /// The heights that are open alone, where a mode draws them.
    pub fn surface_alone(&self, mode: &Mode) -> Option<&Arc<OpenSurface>> {
        match &self.field_for(mode)?.opened {
            Sampled::Heights(opened) => Some(opened),
            Sampled::Field(_) | Sampled::Mixed(_) => None,
        }
    }

    /// Whether a mode's pictures are about heights.
    pub fn is_about_heights(&self, mode: &Mode) -> bool {
        self.surface_for(mode).is_some()
    }

    /// The fields of heights that are drawn, where settings place them; a map that does not fit is told where pictures are drawn.
    pub fn fields(&self, settings: &Settings) -> Vec<FieldInScene> {
        let fields = self.field_for(settings.mode).map(|field| field.opened.fields(&settings.look.settings));
        fields.and_then(Result::ok).unwrap_or_default()
    }

    /// Those of what is said of all members that is said of particles.
    pub fn of_particles<T: Clone>(&self, all: &[T]) -> Vec<T> {
        self.field.as_ref().map_or_else(|| all.to_vec(), |field| field.opened.of_particles(all))
    }

    /// The viewpoint that shows all of what is drawn with these settings.
    ///
    /// # Errors
    /// Why there is none, in a line.
    pub fn home(&self, settings: &Settings, fov_y: f64, picture: &Picture) -> Result<Viewpoint, String> {
        match self.field_for(settings.mode).filter(|field| field.opened.has_z_up()) {
            Some(field) => home_of(&field.opened, &settings.look.settings, fov_y, picture),
            None => home(self.frame, fov_y, picture).map_err(|error| error.to_string()),
        }
    }

    /// Whether a mode draws what is open.
    pub fn takes(&self, mode: &Mode) -> bool {
        let is_mixed = self.field.as_ref().is_some_and(|field| field.opened.mixed().is_some());
        mode.takes_particles() && !is_mixed || self.field_for(mode).is_some()
    }

    /// What a look comes to on what is open.
    ///
    /// # Errors
    /// The names of its attributes, where it has none that the look names.
    pub fn depict(&self, look: &LookPatch) -> Result<Depiction, String> {
        match look.mode.and_then(|mode| Some((mode, self.samples_for(mode)?))) {
            Some((mode, field)) => {
                let choice = look.budget.level_choice();
                field.opened.depiction(mode, look.settings.clone(), look.attribute_name(), choice)
            }
            None => depict(look, self.metadata()),
        }
    }

    /// The units of what a depiction shows.
    pub fn units(&self, depiction: &Depiction) -> Units {
        match self.samples_for(depiction.mode) {
            Some(field) => field.opened.units(depiction),
            None => Units::of(self.metadata(), depiction),
        }
    }

    /// What is drawn: the page file, or the tracks of its run.
    pub fn tree(&self) -> Arc<dyn Tree> {
        match &self.moving {
            Some(moving) => Arc::clone(&moving.tree) as Arc<dyn Tree>,
            None => Arc::clone(&self.file) as Arc<dyn Tree>,
        }
    }

    /// What is known of what is drawn.
    pub fn metadata(&self) -> &Metadata {
        match &self.moving {
            Some(moving) => moving.tree.metadata(),
            None => self.file.metadata(),
        }
    }

    /// The moment of the run that is shown, as files say it.
    pub fn when(&self) -> Option<When> {
        self.time.map(When::Time)
    }

    /// The source, where it is still there: what the user named, unless that is a page file itself. None where there are several.
    pub fn source(&self) -> Option<PathBuf> {
        if !self.file.is_as_its_source() {
            return None;
        }
        if self.path != self.file.path() { Some(self.path.clone()) } else { source_path(&self.file) }
    }
}

/// The run as it is at a moment.
#[derive(Clone)]
pub struct RunNow {
    /// What follows selections in it.
    pub following: Arc<Following>,
    /// When.
    pub moment: Moment,
    /// How its particles move.
    pub interpolation: Interpolation,
}

impl RunNow {
    /// The moment of the run that is shown; `None` where no run with tracks is open, or other datasets with it.
    pub fn of(scene: &Scene) -> Option<RunNow> {
        let following = scene.following.clone()?;
        let moment = following.run().moment(When::Time(scene.time?)).ok()?;
        let interpolation =
            scene.moving.as_ref().map_or_else(Interpolation::default, |moving| moving.tree.interpolation());
        Some(RunNow { following, moment, interpolation })
    }
}

/// How the user wants to see the data: everything that the panel edits.
#[derive(Resource, Clone, Deref, DerefMut)]
pub struct Settings {
    /// What the picture looks like.
    #[deref]
    pub look: Look,
    /// Whether the user chose the mode; else each file begins with its usual one.
    pub mode_chosen: bool,
    /// Whether each family is drawn, in the order of the file's families.
    pub families: Vec<bool>,
    /// Projection and field of view.
    pub lens: Lens,
    /// How directions become a picture.
    pub surround: Surround,
    /// A picture for each eye.
    pub stereo: Option<Stereo>,
}

/// The transfer function was set together with the mode and the attribute: it is not chosen anew for them.
#[derive(Message)]
pub struct TransferKept;

impl PartialEq for Settings {
    fn eq(&self, other: &Settings) -> bool {
        self.look == other.look
            && self.families == other.families
            && self.lens == other.lens
            && self.surround == other.surround
            && self.stereo == other.stereo
    }
}

impl Settings {
    /// The settings before anything is open; the first mode where `mode` names none.
    pub fn new(preset: &Preset, mode: Option<&str>) -> Settings {
        let look = Look::of(mode.and_then(modes::find).unwrap_or(modes::first()));
        Settings {
            look: Look { budget: budget_of(preset), error_px: preset.drawing.error_px, ..look },
            mode_chosen: mode.is_some(),
            families: Vec::new(),
            lens: Lens { fov_deg: preset.camera.field_of_view_deg, parallel: false },
            surround: Surround::Flat,
            stereo: None,
        }
    }

    /// Whether the picture is more than one flat view.
    pub fn is_projected(&self) -> bool {
        !self.surround.is_flat() || self.stereo.is_some()
    }

    /// Changes the mode as the user wants it; its settings begin with their defaults.
    pub fn choose_mode(&mut self, mode: &'static Mode) {
        self.mode_chosen = true;
        self.change_mode(mode);
    }

    pub(super) fn change_mode(&mut self, mode: &'static Mode) {
        if self.mode != mode {
            self.look.mode = mode;
            self.look.settings = crate::mode::Settings::default();
            // What says how splats come together is refused where none are added up.
            if mode.technique.output() != Output::Sums {
                self.look.budget = self.look.budget.without_blending();
            }
        }
    }

    /// What draws the picture: the mode, or the same with splats that lie over each other.
    pub fn drawn_mode(&self) -> &'static Mode {
        over::drawn(self.mode, &self.budget)
    }

    /// Makes them what a patch says of data with these attributes, with the settings of the mode that it says and no others. The name
    /// of an attribute that the data has not.
    pub fn show(&mut self, said: &LookPatch, attributes: &[String]) -> Option<String> {
        self.mode_chosen |= said.mode.is_some();
        self.look.settings = crate::mode::Settings::default();
        self.look = self.look.with(said);
        match &self.attribute {
            Attribute::Named(name) if !attributes.contains(name) => {
                let name = name.clone();
                self.attribute = Attribute::Automatic;
                Some(name)
            }
            _ => None,
        }
    }
}

/// What may be left undrawn by a preset.
pub(crate) fn budget_of(preset: &Preset) -> crate::mode::Settings {
    let mut budget = crate::mode::Settings::default();
    let drawing = &preset.drawing;
    for (setting, value) in [(&PRESENCE, drawing.presence), (&THINNING, drawing.thinning)] {
        budget.set(setting, SettingValue::Number(value));
    }
    budget
}

/// The viewpoint that shows the whole dataset in the picture.
pub fn home(bounds: Bounds, fov_y: f64, picture: &Picture) -> Result<Viewpoint, crate::view::camera::ViewError> {
    let size = picture.size();
    let mut viewpoint = Viewpoint::around(bounds, fov_y, size.x, size.y)?;
    // The sphere around a box is larger than what one sees of the box.
    viewpoint.eye = viewpoint.target + 0.82 * (viewpoint.eye - viewpoint.target);
    Ok(viewpoint)
}

/// The viewpoint that shows all of heights in the picture, or of the first of them where there are particles, too.
///
/// # Errors
/// Why there is none, in a line.
pub fn home_of(
    opened: &Sampled,
    settings: &crate::mode::Settings,
    fov_y: f64,
    picture: &Picture,
) -> Result<Viewpoint, String> {
    let (size, told) = (picture.size(), |error: PictureError| error.to_string());
    let (fov_deg, size) = (fov_y.to_degrees(), (size.x, size.y));
    let found = match opened {
        Sampled::Field(_) => None,
        Sampled::Heights(opened) => Some(opened.home(settings, fov_deg, size).map_err(told)?),
        Sampled::Mixed(opened) => opened.home(settings, fov_deg, size).map_err(told)?,
    };
    let (view, target) = found.ok_or("there are no heights")?;
    Ok(Viewpoint { eye: view.eye, target, up: view.up, fov_y })
}
