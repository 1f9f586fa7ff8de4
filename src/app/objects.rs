//! Named objects of a catalogue: their names over the picture, flights to them, and probes of them.

use super::looking::answer::Answer;
use super::messages::Messages;
use super::scene::Scene;
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
    /// What the list in the panel is narrowed to.
    pub search: String,
}

impl Objects {
    /// Opens a catalogue, in the place of the one that is open.
    pub fn open(&mut self, path: PathBuf) {
        self.labels.clear();
        self.catalogue = Answer::ask("catalogue", move |_| Catalogue::read(&path));
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

/// Whether a file that is dropped on the window names objects rather than being data: a group catalogue, or RON that is no scene.
pub fn is_catalogue(path: &Path) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    // A snapshot or a scene is no catalogue, and says so at once; a catalogue is small.
    matches!(extension, "hdf5" | "h5" | "ron") && Catalogue::read(path).is_ok()
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

/// Takes the catalogue that has been read.
pub(super) fn receive(mut objects: ResMut<Objects>, scene: Option<Res<Scene>>, mut messages: ResMut<Messages>) {
    let objects = objects.bypass_change_detection();
    if !objects.catalogue.receive() {
        return;
    }
    match &objects.catalogue {
        Answer::Here(catalogue) => {
            objects.labels = catalogue.labels();
            let count = crate::annotate::number::count(catalogue.objects.len() as u64);
            messages.info(format!("{count} objects of {}", catalogue.path.display()));
            let unit = scene.map(|scene| scene.file.metadata().length_unit.clone());
            if let Some(why) = unit.and_then(|unit| catalogue.unlike(&unit)) {
                messages.error(why);
            }
        }
        Answer::Failed(why) => messages.error(why),
        Answer::Nothing | Answer::Coming(_) => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn catalogues_are_told_from_data_and_searched() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("names.ron");
        std::fs::write(
            &path,
            r#"(objects: [(name: "Coma", position: (1.0, 2.0, 3.0), mass: 9.0), (name: "Virgo", position: (0.0, 0.0, 0.0))])"#,
        )
        .unwrap();
        assert!(is_catalogue(&path));
        let demo = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/demo/lcdm64_z0.hdf5");
        assert!(!is_catalogue(&demo));
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
