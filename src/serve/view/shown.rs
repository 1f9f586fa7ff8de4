//! What is shown to visitors, opened once: the data, what it holds, and the scene and the tour beside it.

use crate::color::ColorMap;
use crate::color::transfer::TransferFunction;
use crate::command_line::cache::page_file_with;
use crate::command_line::progress_bar::{Terminal, TerminalProgress};
use crate::look::{Backend, Member, MemberKind, SceneFile, data_file, said_of_particles};
use crate::picture::asked::{Failure, about};
use crate::picture::{AnySession, PictureError, Reporter, SessionOptions};
use crate::tour::{Show, TourFile};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What is to be shown, and to how many.
#[derive(Clone, Debug)]
pub struct ViewOptions {
    /// The data.
    pub path: PathBuf,
    /// A scene, whose look, camera and bookmarks hold.
    pub scene: Option<PathBuf>,
    /// A tour of the data.
    pub tour: Option<PathBuf>,
    /// Visitors at a time.
    pub visitors: usize,
    /// Bytes that what is read for all of them may take.
    pub memory: u64,
}

/// What is shown.
pub(super) struct Shown {
    /// The data, with a page file in place of a source of particles.
    pub(super) member: Member,
    /// What visitors call it.
    pub(super) name: String,
    /// A scene's file and text.
    pub(super) scene: Option<(PathBuf, String)>,
    pub(super) tour: Option<(PathBuf, TourFile)>,
    /// Bytes that what is read for one visitor may take.
    pub(super) memory: u64,
    /// What it holds, as the page needs it.
    pub(super) about: Value,
    /// Folders, which are nobody's business.
    folders: Vec<String>,
}

impl Shown {
    pub(super) fn open(options: &ViewOptions) -> Result<Shown, Failure> {
        let path = data_file(&options.path)?;
        let mut own = Member::new(&path);
        let scene = options.scene.as_ref().map(|file| -> Result<_, Failure> {
            let scene = SceneFile::read(file)?;
            let text = std::fs::read_to_string(file).map_err(|error| format!("{}: {error}", file.display()))?;
            Ok((file, text, scene))
        });
        let scene = scene.transpose()?;
        if let Some((file, _, scene)) = &scene {
            let notes = scene.say_of(file, std::slice::from_mut(&mut own));
            notes.into_iter().for_each(|note| Terminal.tell(note));
        }
        let member = match own.kind() {
            MemberKind::Particles => {
                let said = said_of_particles(std::slice::from_ref(&own), &path);
                Member { path: page_file_with(&path, &said, &TerminalProgress::new())?, ..own }
            }
            MemberKind::Field | MemberKind::Heights => own,
        };
        let as_it_is = |path: &Path| Ok(path.to_owned());
        let mut found = about(std::slice::from_ref(&member), as_it_is, &Terminal)?;
        let tour =
            options.tour.as_ref().map(|file| Ok::<_, Failure>((file.clone(), TourFile::read(file)?))).transpose()?;
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        let files = [Some(&path), Some(&member.path), options.scene.as_ref(), options.tour.as_ref()];
        let folders =
            files.into_iter().flatten().filter_map(|file| file.parent()).map(|folder| folder.display().to_string());
        let mut shown = Shown {
            folders: folders.filter(|folder| !folder.is_empty()).collect(),
            name,
            memory: options.memory / options.visitors.max(1) as u64,
            about: Value::Null,
            scene: scene.as_ref().map(|(file, text, _)| ((*file).clone(), text.clone())),
            tour,
            member,
        };
        // A tour that does not fit the data is told now.
        let seconds = match &shown.tour {
            Some((_, tour)) => Some(shown.show(tour.size, Arc::new(Terminal))?.duration()),
            None => None,
        };
        let of_scene = scene.as_ref().map(|(_, _, scene)| scene);
        let look = of_scene.map(|scene| &scene.look);
        found["name"] = json!(shown.name);
        found["fields"] = fields(&found);
        found["camera"] = json!(of_scene.and_then(|scene| scene.camera));
        found["bookmarks"] = json!(of_scene.map(|scene| &scene.bookmarks));
        found["mode"] = json!(look.and_then(|look| look.mode).map(|mode| mode.name));
        found["colors"] = json!(TransferFunction::presets().collect::<Vec<_>>());
        found["color_maps"] = json!(ColorMap::all().map(|map| map.name()).collect::<Vec<_>>());
        found["tour"] = json!(seconds);
        // What the page does not need; notes may name files.
        (found["families"], found["notes"]) = (Value::Null, Value::Null);
        shown.about = found;
        Ok(shown)
    }

    /// The tour in pictures of a size.
    ///
    /// # Errors
    /// When there is none, or it does not fit the data.
    pub(super) fn show(&self, size: (u32, u32), reporter: Arc<dyn Reporter>) -> Result<Show, Failure> {
        let (file, tour) = self.tour.as_ref().ok_or("tour: found none, expected one: deepfield serve --tour")?;
        let tour = TourFile { size, ..tour.clone() };
        let options = SessionOptions {
            backend: Some(Backend::Cpu),
            memory: Some(self.memory),
            page_memory: Some(self.memory),
            chunk_memory: Some(self.memory),
            ..SessionOptions::default()
        };
        let session = self.session(options, &[], Arc::clone(&reporter))?;
        Show::open(tour, Some(file.clone()), self.member.clone(), session, &mut |note| reporter.tell(note))
    }

    /// The data, open for pictures of these shots.
    ///
    /// # Errors
    /// As [`AnySession::open`].
    pub(super) fn session(
        &self,
        options: SessionOptions,
        shots: &[crate::look::Shot],
        reporter: Arc<dyn Reporter>,
    ) -> Result<AnySession, PictureError> {
        let as_it_is = |path: &Path| Ok(path.to_owned());
        AnySession::open(std::slice::from_ref(&self.member), options, shots, as_it_is, reporter)
    }

    /// Whether the data is asked what particles are around a place.
    pub(super) fn has_particles(&self) -> bool {
        self.member.kind() == MemberKind::Particles
    }

    /// A message without the folders in which the data lies.
    pub(super) fn without_folders(&self, message: &str) -> String {
        let without =
            |text: String, folder: &String| text.replace(&format!("{folder}{}", std::path::MAIN_SEPARATOR), "");
        self.folders.iter().fold(message.to_owned(), without)
    }
}

/// The names of all fields, each once.
fn fields(about: &Value) -> Value {
    let mut names: Vec<&Value> = Vec::new();
    let families = about["families"].as_array().into_iter().flatten();
    for field in families.flat_map(|family| family["fields"].as_array().into_iter().flatten()) {
        if !names.contains(&&field["name"]) {
            names.push(&field["name"]);
        }
    }
    json!(names)
}
