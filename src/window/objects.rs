//! Named objects of a catalogue: their names over the picture, flights to them, and probes of them.

use super::open::Openings;
use super::options::OpenRequest;
use super::playhead::Playhead;
use super::scene::Scene;
use super::state::answer::Answer;
use super::state::notices::Notices;
use crate::annotate::Label;
use crate::explore::{Catalogue, Object, Region};
use crate::model::Bounds;
use bevy::math::DVec3;
use bevy::prelude::*;
use std::path::{Path, PathBuf};

/// The catalogue that is open, if any.
#[derive(Resource, Default)]
pub struct Objects {
    /// What is being read or has been read.
    pub catalogue: Answer<Catalogue>,
    /// Its objects as names over the picture, the most important first.
    pub labels: Vec<Label>,
    /// The time of objects of a catalogue of several steps.
    time: Option<f64>,
    /// What the list in the panel is narrowed to.
    pub search: String,
    /// A file that was dropped and may be a catalogue, on its way; `None` comes of one that is not.
    dropped: Answer<Option<Catalogue>>,
    /// How it is opened as data.
    as_data: OpenRequest,
    /// Whether the command line has named the catalogue, so that the first scene does not change it.
    pub is_given: bool,
}

impl Objects {
    /// Opens a catalogue, in the place of the one that is open.
    pub fn open(&mut self, path: PathBuf) {
        self.labels.clear();
        self.time = None;
        self.catalogue = Answer::ask("catalogue", move |_| Catalogue::read_at(&path, None, true));
    }

    /// Opens the catalogue that a scene names, if it names one.
    pub fn open_of_scene(&mut self, path: Option<PathBuf>) {
        if let Some(path) = path.filter(|_| !std::mem::take(&mut self.is_given)) {
            self.open(path);
        }
    }

    /// The file of the open catalogue.
    pub fn path(&self) -> Option<&Path> {
        self.catalogue.here().map(|catalogue| catalogue.path.as_path())
    }

    /// Looks whether a file that was dropped on the window is a catalogue, and opens it as that, or else `as_data`.
    pub fn consider(&mut self, path: PathBuf, as_data: OpenRequest) {
        self.as_data = as_data;
        self.dropped = Answer::ask("catalogue", move |_| Ok::<_, String>(Catalogue::read(&path).ok()));
    }

    /// The first objects whose names hold what is searched for, and how many there are.
    pub fn found(&self, most: usize) -> (Vec<&Object>, usize) {
        let Some(catalogue) = self.catalogue.here() else { return (Vec::new(), 0) };
        let wanted = self.search.trim().to_lowercase();
        let mut all = catalogue.objects.iter().filter(|object| object.name.to_lowercase().contains(&wanted));
        let first: Vec<&Object> = all.by_ref().take(most).collect();
        let count = first.len() + all.count();
        (first, count)
    }
}

/// Whether a file that is dropped on the window may name objects rather than being data: a group catalogue, or RON that is no scene.
pub fn may_be_catalogue(path: &Path) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    matches!(extension.to_ascii_lowercase().as_str(), "hdf5" | "h5" | "ron")
}

/// What an object takes up: a ball of its radius, or of `usual` where it has none.
pub fn extent(object: &Object, usual: f64) -> (Region, Bounds) {
    let radius = object.radius.unwrap_or(usual);
    let bounds = Bounds { min: object.position - radius, max: object.position + radius };
    (Region::sphere(object.position, radius), bounds)
}

/// How large an object without a radius is taken to be: a hundredth of the data's box.
pub fn usual_radius(bounds: Bounds) -> f64 {
    let size: DVec3 = bounds.size();
    (0.01 * size.max_element()).max(f64::MIN_POSITIVE)
}

/// Objects of a catalogue that are moved at most between steps; of more, those of the step are shown.
const MOST_MOVING: usize = 20_000;

/// Shows the objects of the time that is shown, where the catalogue has those of several steps.
pub(super) fn follow_time(mut objects: ResMut<Objects>, scene: Option<Res<Scene>>, playhead: Option<Res<Playhead>>) {
    let Some(tree) = objects.catalogue.here().and_then(|catalogue| catalogue.tree.as_ref()) else { return };
    // Without a run the catalogue of one step is that of what is shown.
    let own = || scene.filter(|_| tree.format != "groups").and_then(|scene| scene.file.metadata().provenance.time);
    let Some(time) = playhead.map(|playhead| playhead.time()).or_else(own) else { return };
    let step = tree.step_at(time);
    let time = if tree.count(step) > MOST_MOVING { tree.steps()[step].time } else { time };
    if objects.time == Some(time) {
        return;
    }
    objects.time = Some(time);
    if let Some(now) = objects.catalogue.here().and_then(|catalogue| catalogue.at(Some(time))) {
        objects.labels = now.labels();
        objects.catalogue = Answer::Here(now);
    }
}

/// Takes the catalogue that has been read.
pub(super) fn receive_catalogue(
    mut objects: ResMut<Objects>,
    mut openings: ResMut<Openings>,
    scene: Option<Res<Scene>>,
    mut notices: ResMut<Notices>,
) {
    let objects = objects.bypass_change_detection();
    if objects.dropped.receive() {
        match std::mem::take(&mut objects.dropped) {
            Answer::Here(Some(catalogue)) => {
                objects.labels.clear();
                objects.catalogue = Answer::ready(catalogue);
            }
            // A snapshot or a scene, or nothing that can be read: opening it says so.
            _ => openings.start(std::mem::take(&mut objects.as_data)),
        }
    }
    if !objects.catalogue.receive() {
        return;
    }
    match &objects.catalogue {
        Answer::Here(catalogue) => {
            objects.labels = catalogue.labels();
            let count = crate::annotate::number::count(catalogue.objects.len() as u64);
            notices.info(format!("{count} objects of {}", catalogue.path.display()));
            let unit = scene.map(|scene| scene.file.metadata().length_unit.clone());
            if let Some(why) = unit.and_then(|unit| catalogue.unlike(&unit)) {
                notices.error(why);
            }
        }
        Answer::Failed(why) => notices.error(why),
        Answer::Nothing | Answer::Coming(_) => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn catalogues_are_searched() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("names.ron");
        std::fs::write(
            &path,
            r#"(objects: [(name: "Coma", position: (1.0, 2.0, 3.0), mass: 9.0), (name: "Virgo", position: (0.0, 0.0, 0.0))])"#,
        )
        .unwrap();
        assert!(
            may_be_catalogue(&path) && may_be_catalogue(Path::new("a.HDF5")) && !may_be_catalogue(Path::new("a.csv"))
        );
        let mut objects = Objects { catalogue: Answer::Here(Catalogue::read(&path).unwrap()), ..Objects::default() };
        assert_eq!(objects.found(1).1, 2);
        objects.search = "vir".into();
        let (found, count) = objects.found(10);
        assert_eq!((found[0].name.as_str(), count), ("Virgo", 1));
        let (region, bounds) = extent(found[0], 2.0);
        assert_eq!(region.first_sphere(), Some((DVec3::ZERO, 2.0)));
        assert_eq!(bounds.size(), DVec3::splat(4.0));
    }
}
